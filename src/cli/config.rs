//! `harmzone config`: what the settings of each stage are, and what a file and overrides make of them.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use super::{ExitStatus, one_of, print};
use crate::config::{self, Check, ConfigKey};
use crate::drive::DriveConfig;
use crate::eval::EvalConfig;
use crate::eval::sweep::SweepConfig;
use crate::generate::GenerateConfig;
use crate::import::ImportConfig;
use crate::train::TrainConfig;
use crate::zone::ZoneConfig;

#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Print a stage's config, each key under what it is: the defaults with a file and overrides over them
    Show(ShowArgs),
    /// Tell what a key is, its default and what is valid
    Explain(ExplainArgs),
    /// Print all keys of all stages as Markdown, as docs/reference/config.md
    Reference,
}

#[derive(Debug, Args)]
struct ShowArgs {
    /// The stage: whose config
    #[arg(value_parser = one_of(Stage::ALL, Stage::name))]
    stage: Stage,
    /// Config (TOML) over the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key, as the stage's own `--set`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Print only what differs from the defaults, as `--set` takes it
    #[arg(long)]
    changed: bool,
    /// Print the config as JSON
    #[arg(long, conflicts_with = "changed")]
    json: bool,
}

#[derive(Debug, Args)]
struct ExplainArgs {
    /// The key, whole (`scene.ood_spacing_m`) or its end (`ood_spacing_m`); a table's tells all its keys
    key: String,
    /// Look only in this stage's config
    #[arg(long, value_parser = one_of(Stage::ALL, Stage::name))]
    stage: Option<Stage>,
    /// Print what is found as JSON
    #[arg(long)]
    json: bool,
}

/// Whose config.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Gen,
    Import,
    Zone,
    Train,
    Eval,
    Sweep,
    Drive,
}

impl Stage {
    const ALL: [Self; 7] =
        [Self::Gen, Self::Import, Self::Zone, Self::Train, Self::Eval, Self::Sweep, Self::Drive];

    fn name(self) -> &'static str {
        match self {
            Self::Gen => "gen",
            Self::Import => "import",
            Self::Zone => "zone",
            Self::Train => "train",
            Self::Eval => "eval",
            Self::Sweep => "sweep",
            Self::Drive => "drive",
        }
    }

    /// The command that takes it, and the flag for its file.
    fn command(self) -> (&'static str, &'static str) {
        match self {
            Self::Gen => ("harmzone gen", "--config"),
            Self::Import => ("harmzone import FORMAT", "--config"),
            Self::Zone => ("harmzone label", "--zone"),
            Self::Train => ("harmzone train", "--config"),
            Self::Eval => ("harmzone eval", "--config"),
            Self::Sweep => ("harmzone sweep", "--config"),
            Self::Drive => ("harmzone drive", "--config"),
        }
    }

    fn entries(self) -> Vec<ConfigKey> {
        match self {
            Self::Gen => config::entries::<GenerateConfig>(),
            Self::Import => config::entries::<ImportConfig>(),
            Self::Zone => config::entries::<ZoneConfig>(),
            Self::Train => config::entries::<TrainConfig>(),
            Self::Eval => config::entries::<EvalConfig>(),
            Self::Sweep => config::entries::<SweepConfig>(),
            Self::Drive => config::entries::<DriveConfig>(),
        }
    }
}

pub fn run(args: ConfigArgs) -> anyhow::Result<ExitStatus> {
    match args.action {
        Action::Show(args) => print(match args.stage {
            Stage::Gen => show::<GenerateConfig>(&args),
            Stage::Import => show::<ImportConfig>(&args),
            Stage::Zone => show::<ZoneConfig>(&args),
            Stage::Train => show::<TrainConfig>(&args),
            Stage::Eval => show::<EvalConfig>(&args),
            Stage::Sweep => show::<SweepConfig>(&args),
            Stage::Drive => show::<DriveConfig>(&args),
        }?)?,
        Action::Explain(args) => explain(&args)?,
        Action::Reference => print(reference())?,
    }
    Ok(ExitStatus::Done)
}

fn show<T>(args: &ShowArgs) -> anyhow::Result<String>
where
    T: Check + Default + DeserializeOwned + Serialize,
{
    let base = T::default();
    let asked: T = config::load_over(&base, args.config.as_deref(), &args.overrides)?;
    asked.check()?;
    if args.json {
        return Ok(serde_json::to_string_pretty(&asked)?);
    }
    if args.changed {
        return Ok(config::differences(&base, &asked).join("\n"));
    }
    Ok(config::commented_toml(&asked))
}

fn explain(args: &ExplainArgs) -> anyhow::Result<()> {
    let stages = Stage::ALL.into_iter().filter(|stage| args.stage.is_none_or(|only| only == *stage));
    let all: Vec<(Stage, ConfigKey)> =
        stages.flat_map(|stage| stage.entries().into_iter().map(move |entry| (stage, entry))).collect();
    let wanted = args.key.trim();
    let found = named(&all, wanted);
    if found.is_empty() {
        let keys = all.iter().map(|(_, entry)| entry.key.as_str());
        let ends = all.iter().map(|(_, entry)| entry.key.rsplit('.').next().unwrap_or_default());
        return Err(match config::nearest(wanted, keys.chain(ends)) {
            Some(near) => anyhow!("no config has a key `{wanted}`; did you mean `{near}`?"),
            None => {
                anyhow!("no config has a key `{wanted}`; `harmzone config show STAGE` prints all of a stage")
            }
        });
    }
    if args.json {
        let found: Vec<_> =
            found.iter().map(|(stage, entry)| json!({"stage": stage.name(), "entry": entry})).collect();
        return print(serde_json::to_string_pretty(&found)?);
    }
    let told: Vec<String> = found.iter().map(|(stage, entry)| tell_of(*stage, entry)).collect();
    print(told.join("\n"))
}

/// The entries of a name: the key itself, else those that end in it; with all that a table holds.
fn named<'a>(all: &'a [(Stage, ConfigKey)], name: &str) -> Vec<&'a (Stage, ConfigKey)> {
    let of = |keys: &dyn Fn(&str) -> bool| -> Vec<(Stage, &'a str)> {
        let found = all.iter().filter(|(_, entry)| keys(&entry.key));
        found.map(|(stage, entry)| (*stage, entry.key.as_str())).collect()
    };
    let mut heads = of(&|key| key == name);
    if heads.is_empty() {
        heads = of(&|key| key.ends_with(&format!(".{name}")));
    }
    let belongs = |(stage, entry): &&(Stage, ConfigKey)| {
        heads.iter().any(|(of, head)| {
            let rest = entry.key.strip_prefix(head);
            of == stage && rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        })
    };
    all.iter().filter(belongs).collect()
}

fn tell_of(stage: Stage, entry: &ConfigKey) -> String {
    let ConfigKey { key, doc, default, valid, is_table } = entry;
    let (command, flag) = stage.command();
    let mut out = format!("{}: {key}\n", stage.name());
    if !doc.is_empty() {
        out += &format!("  {doc}\n");
    }
    if *is_table {
        return out;
    }
    let default = default.as_ref().map_or_else(|| "not set".to_owned(), shown);
    out += &format!("  default: {default}\n  valid: {valid}\n");
    let value = if default == "not set" { "VALUE" } else { &default };
    // The shell would take brackets and quotes for its own.
    let set = format!("{key}={}", value.trim_matches('"'));
    let set = shlex::try_quote(&set).map_or(set.clone(), std::borrow::Cow::into_owned);
    out + &format!("  set by: {command} --set {set}, or in the file of {flag}\n")
}

/// A default, a number of single precision with the digits that it was given.
fn shown(value: &toml::Value) -> String {
    let plain = value.to_string();
    let Some(number) = value.as_float() else { return plain };
    let single = format!("{:?}", number as f32);
    if f64::from(number as f32) == number && single.len() < plain.len() { single } else { plain }
}

/// All keys as Markdown.
pub fn reference() -> String {
    let mut out = "# Config\n\nEvery key of every stage, as `harmzone config reference` prints it. \
                   `harmzone config explain KEY` tells of one.\n"
        .to_owned();
    for stage in Stage::ALL {
        let (command, flag) = stage.command();
        out += &format!(
            "\n## {}\n\nOf `{command}`: `--set KEY=VALUE`, or a file by `{flag} TOML`.\n\n",
            stage.name()
        );
        out += "| key | default | valid | |\n|---|---|---|---|\n";
        // The world and the zone of a drive have the keys of `gen` and `zone`.
        let entries = stage.entries().into_iter().filter(|entry| {
            stage != Stage::Drive || !["world.", "zone."].iter().any(|of| entry.key.starts_with(of))
        });
        for ConfigKey { key, doc, default, valid, is_table } in entries {
            let cell = |text: &str| text.replace('|', "\\|").replace('<', "&lt;");
            let default = match default {
                _ if is_table => String::new(),
                Some(value) => format!("`{}`", shorten(&shown(&value))),
                None => "not set".to_owned(),
            };
            let valid = if is_table { String::new() } else { cell(&valid) };
            out += &format!("| `{key}` | {} | {valid} | {} |\n", cell(&default), cell(&doc));
        }
    }
    out
}

/// A value cut to what fits into a table.
fn shorten(value: &str) -> String {
    const MOST: usize = 60;
    if value.chars().count() <= MOST {
        return value.to_owned();
    }
    value.chars().take(MOST).collect::<String>() + " .."
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(key: &str) -> anyhow::Result<Vec<String>> {
        let all: Vec<(Stage, ConfigKey)> = Stage::ALL
            .into_iter()
            .flat_map(|stage| stage.entries().into_iter().map(move |entry| (stage, entry)))
            .collect();
        let found = named(&all, key);
        if found.is_empty() {
            anyhow::bail!("none");
        }
        Ok(found.iter().map(|(stage, entry)| tell_of(*stage, entry)).collect())
    }

    #[test]
    fn a_key_is_found_by_its_end_and_a_table_with_its_keys() {
        let of_key = told("ood_spacing_m").unwrap().concat();
        assert!(of_key.contains("gen: scene.ood_spacing_m") && of_key.contains("two numbers"), "{of_key}");
        let of_table = told("safety").unwrap().concat();
        assert!(of_table.contains("eval: safety.confirm_n"), "{of_table}");
        assert!(told("no_such_key").is_err());
    }

    #[test]
    fn the_page_in_the_docs_is_what_the_configs_say() {
        super::super::assert_is_in_docs("reference/config.md", &reference());
    }

    #[test]
    fn what_is_shown_is_a_config_file_with_the_same_values() {
        let overrides = vec!["scene.ood=true".to_owned()];
        let args = ShowArgs { stage: Stage::Gen, config: None, overrides, changed: false, json: false };
        let file: GenerateConfig = toml::from_str(&show::<GenerateConfig>(&args).unwrap()).unwrap();
        assert!(file.scene.ood);
        let args = ShowArgs { changed: true, ..args };
        assert_eq!(show::<GenerateConfig>(&args).unwrap(), "scene.ood=true");
    }

    #[test]
    fn nearly_every_key_is_explained() {
        let entries: Vec<ConfigKey> = Stage::ALL.into_iter().flat_map(Stage::entries).collect();
        let silent: Vec<&str> = entries
            .iter()
            .filter(|entry| entry.doc.is_empty() && !entry.is_table)
            .map(|entry| entry.key.as_str())
            .collect();
        assert!(silent.len() * 3 < entries.len(), "{} of {}: {silent:?}", silent.len(), entries.len());
    }
}
