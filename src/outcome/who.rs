//! Who drives: what a WHO argument means.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::DriveSummary;
use crate::eval::judge::Judge;

/// The source of the boxes by which the ego brakes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// Sees nothing: the floor.
    Blind,
    /// The zone over the true boxes, seen or not: the ceiling.
    Truth,
    /// A network's boxes, whose harm a judge decides.
    Network {
        run: PathBuf,
        judge: Judge,
        /// From which on a box counts; `None`: the config's, else the network's own.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        score: Option<f64>,
        /// From which on it counts for a partial brake; `None`: the one that the network warns from.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        warning: Option<f64>,
    },
    /// A program that is asked for each sample (docs/drive.md).
    External { command: String },
}

/// A driver under test, by its name in folders and tables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Who {
    pub name: String,
    pub source: Source,
}

/// Of the rules by which a driver under test drives and its drives are counted; one more with each change of a figure. Drives of
/// two are not compared.
pub const DRIVING: u32 = 4;

/// The rules before they had a number.
fn first_driving() -> u32 {
    1
}

/// Who drove, as its folder says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    pub who: Who,
    /// Of the network's checkpoint, or of the files that a command names; empty for others.
    #[serde(alias = "source_sha256")]
    pub sha256: String,
    /// Score from which on it brakes hard for its boxes; `None`: for all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_score: Option<f64>,
    /// Score from which on it brakes a little for them, where that is a lower one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_from: Option<f64>,
    pub generator_version: String,
    /// [`DRIVING`], of then.
    #[serde(default = "first_driving")]
    pub driving: u32,
    pub device: String,
    /// Architectures and extensions of the processors that drove: drives of two of them may differ in their last bits.
    #[serde(default)]
    pub cpus: Vec<String>,
}

impl Origin {
    /// Name of the file in a driver's folder: who drove, and by which weights.
    pub const FILE: &'static str = "who.json";

    /// As a file of its own: that ends with its own `sha256`, so the one in it has the name `source_sha256`.
    #[must_use]
    pub fn of_file(&self) -> serde_json::Value {
        let mut value = serde_json::to_value(self).expect("it has a JSON form");
        let fields = value.as_object_mut().expect("it has fields");
        if let Some(hash) = fields.remove("sha256") {
            fields.insert("source_sha256".to_owned(), hash);
        }
        value
    }

    /// What has to be alike in drives that are compared, as text: a run's path and the processors need not be.
    #[must_use]
    pub fn identity(&self) -> String {
        let mut own = Self { cpus: Vec::new(), ..self.clone() };
        if let Source::Network { run, .. } = &mut own.who.source {
            *run = PathBuf::new();
        }
        serde_json::to_string_pretty(&own).expect("it has a JSON form") + "\n"
    }
}

/// Why a WHO argument means nothing.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WhoError {
    #[error(
        "`{text}` names nobody: valid are `blind`, `truth`, a RUN, `JUDGE:RUN` with one of {judges}, or `exec:COMMAND`; \
             each may have a name before it, `NAME=..`, a RUN a score after it, `RUN@0.3`, or two, `RUN@0.5,0.3`"
    )]
    Unknown { text: String, judges: String },
    #[error("`{name}` is no name for a folder: letters, digits, `-`, `_` and `.` are, but for {}", RESERVED.join(", "))]
    BadName { name: String },
    #[error(
        "`{text}`: {score} is no score, and no file is called so; a number above 0, up to 1, is needed after the @, or two, the second \
             not above the first: from which on it brakes hard, and a little"
    )]
    BadScore { text: String, score: String },
}

const EXEC: &str = "exec:";

/// Files beside the drivers' folders.
const RESERVED: [&str; 3] = [DriveSummary::FILE, DriveSummary::CONFIG_FILE, "writer.partial"];

impl FromStr for Who {
    type Err = WhoError;

    /// `[NAME=]SOURCE`, where a name holds neither `:` nor `/`.
    fn from_str(text: &str) -> Result<Self, WhoError> {
        let named = text.split_once('=').filter(|(name, _)| !name.contains([':', '/']));
        let (name, rest) = named.map_or((None, text), |(name, rest)| (Some(name), rest));
        if let Some(score) = bad_score(rest) {
            return Err(WhoError::BadScore { text: text.to_owned(), score: score.to_owned() });
        }
        let source = parse_source(rest).ok_or_else(|| WhoError::Unknown {
            text: text.to_owned(),
            judges: Judge::ALL.map(Judge::name).join(", "),
        })?;
        let name = name.map_or_else(|| source.default_name(), str::to_owned);
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        let is_reserved = RESERVED.contains(&name.as_str());
        if is_reserved || name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) {
            return Err(WhoError::BadName { name });
        }
        Ok(Self { name, source })
    }
}

/// A number after a RUN that is no score, where nothing is called so.
fn bad_score(source: &str) -> Option<&str> {
    let run = source.split_once(':').map_or(source, |(judge, run)| if judge == "exec" { "" } else { run });
    let (_, at) = run.rsplit_once('@')?;
    let is_number = |text: &str| text.parse::<f64>().is_ok();
    let are_numbers = at.split(',').all(is_number);
    (are_numbers && scores_of(at).is_none() && !Path::new(run).exists()).then_some(at)
}

/// The score from which on it brakes hard, and the one from which on it brakes a little.
fn scores_of(at: &str) -> Option<(f64, Option<f64>)> {
    let score_of = |text: &str| text.parse().ok().filter(|&score| is_score(score));
    match at.split_once(',') {
        None => Some((score_of(at)?, None)),
        Some((score, warning)) => {
            let (score, warning) = (score_of(score)?, score_of(warning)?);
            (warning <= score).then_some((score, Some(warning)))
        }
    }
}

fn is_score(score: f64) -> bool {
    score > 0.0 && score <= 1.0
}

fn parse_source(text: &str) -> Option<Source> {
    match text {
        "" => None,
        "blind" => Some(Source::Blind),
        "truth" => Some(Source::Truth),
        _ => {
            if let Some(command) = text.strip_prefix(EXEC) {
                return (!command.trim().is_empty())
                    .then(|| Source::External { command: command.to_owned() });
            }
            let (judge, run) = match text.split_once(':') {
                Some((judge, run)) => (Judge::named(judge)?, run),
                None => (Judge::Network, text),
            };
            let at = run.rsplit_once('@').and_then(|(run, at)| Some((run, scores_of(at)?)));
            let (run, score, warning) =
                at.map_or((run, None, None), |(run, (score, warning))| (run, Some(score), warning));
            (!run.is_empty()).then(|| Source::Network { run: run.into(), judge, score, warning })
        }
    }
}

impl Source {
    /// The last part of a run's path, after the judge's name and before the score; what is no letter or digit becomes `-`.
    fn default_name(&self) -> String {
        match self {
            Self::Blind => "blind".to_owned(),
            Self::Truth => "truth".to_owned(),
            Self::External { .. } => "exec".to_owned(),
            Self::Network { run, judge, score, warning } => {
                let stem = Path::new(run).file_stem().map(|stem| stem.to_string_lossy().into_owned());
                let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
                let stem: String = stem.unwrap_or_default().chars().map(plain).collect();
                let judge =
                    if *judge == Judge::Network { String::new() } else { format!("{}-", judge.name()) };
                let scores = score.iter().chain(warning).map(|score| format!("-{score}"));
                format!("{judge}{stem}{}", scores.collect::<String>())
            }
        }
    }

    /// Whether it needs what the sensors measure.
    #[must_use]
    pub fn needs_sensors(&self) -> bool {
        matches!(self, Self::Network { .. } | Self::External { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_who_is_understood() {
        let parse = |text: &str| text.parse::<Who>().unwrap();
        assert_eq!(parse("blind").source, Source::Blind);
        assert_eq!(parse("truth").name, "truth");
        let network =
            |run: &str, judge| Source::Network { run: run.into(), judge, score: None, warning: None };
        assert_eq!(parse("small"), Who { name: "small".into(), source: network("small", Judge::Network) });
        assert_eq!(parse("zone:runs/a").name, "zone-a");
        assert_eq!(
            parse("lidar=runs/b/best.safetensors").source,
            network("runs/b/best.safetensors", Judge::Network)
        );
        assert_eq!(
            parse("mine=zone:small"),
            Who { name: "mine".into(), source: network("small", Judge::Zone) }
        );
        let at = parse("zone:runs/a@0.25");
        assert_eq!(at.name, "zone-a-0.25");
        assert_eq!(
            at.source,
            Source::Network { run: "runs/a".into(), judge: Judge::Zone, score: Some(0.25), warning: None }
        );
        let at = parse("zone:runs/a@0.5,0.25");
        assert_eq!(at.name, "zone-a-0.5-0.25");
        assert!(matches!(at.source, Source::Network { score: Some(0.5), warning: Some(0.25), .. }));
        // What is no score belongs to the path.
        assert_eq!(parse("runs/a@b").source, network("runs/a@b", Judge::Network));
        let command = "python3 mine.py --threshold=0.5".to_owned();
        assert_eq!(
            parse(&format!("exec:{command}")),
            Who { name: "exec".into(), source: Source::External { command } }
        );
    }

    #[test]
    fn what_names_nobody_is_told_who_could_be() {
        for text in ["", "zones:small", "exec:", "zone:", "a=", "@0.5"] {
            let error = text.parse::<Who>().unwrap_err().to_string();
            assert!(error.contains("zone-soft") && error.contains("exec:COMMAND"), "{error}");
        }
        for text in ["x y=blind", "drive.json=blind"] {
            assert!(matches!(text.parse::<Who>(), Err(WhoError::BadName { .. })), "{text}");
        }
        for text in ["small@2", "zone:small@0", "a=runs/b@-0.1", "small@nan", "small@0.3,0.5", "small@0.5,0"]
        {
            let error = text.parse::<Who>().unwrap_err().to_string();
            assert!(error.contains("up to 1") && error.contains(text), "{error}");
        }
        assert!("exec:python3 a.py --at b@2".parse::<Who>().is_ok());
    }

    #[test]
    fn a_run_by_another_path_is_the_same_and_other_weights_or_rules_are_not() {
        let origin = |who: &str, sha256: &str, driving: u32| Origin {
            who: who.parse().unwrap(),
            sha256: sha256.to_owned(),
            min_score: None,
            seen_from: None,
            generator_version: "1".to_owned(),
            driving,
            device: "cpu".to_owned(),
            cpus: vec![who.to_owned()],
        };
        let first = origin("a=runs/x", "5e", 1).identity();
        assert_eq!(first, origin("a=/home/b/runs/x", "5e", 1).identity());
        assert_ne!(first, origin("a=runs/x", "5f", 1).identity());
        assert_ne!(first, origin("a=runs/x", "5e", 2).identity());
        assert_ne!(first, origin("b=runs/x", "5e", 1).identity());
        let of_file = origin("a=runs/x", "5e", 1).of_file();
        assert!(of_file["source_sha256"] == "5e" && of_file.get("sha256").is_none());
        assert_eq!(serde_json::from_value::<Origin>(of_file).unwrap(), origin("a=runs/x", "5e", 1));
    }
}
