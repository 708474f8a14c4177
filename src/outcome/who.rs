//! Who drives: what a WHO argument means.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

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

/// Who drove, as its folder says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    pub who: Who,
    /// Of the network's checkpoint, or of the files that a command names; empty for others.
    pub sha256: String,
    /// Score from which on it brakes hard for its boxes; `None`: for all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_score: Option<f64>,
    /// Score from which on it brakes a little for them, where that is a lower one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen_from: Option<f64>,
    pub generator_version: String,
    pub device: String,
}

/// Why a WHO argument means nothing.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WhoError {
    #[error(
        "`{text}` names nobody: valid are `blind`, `truth`, a RUN, `JUDGE:RUN` with one of {judges}, or `exec:COMMAND`; \
             each may have a name before it, `NAME=..`, a RUN a score after it, `RUN@0.3`"
    )]
    Unknown { text: String, judges: String },
    #[error("`{name}` is no name for a folder: letters, digits, `-`, `_` and `.` are")]
    BadName { name: String },
}

const EXEC: &str = "exec:";

impl FromStr for Who {
    type Err = WhoError;

    /// `[NAME=]SOURCE`, where a name holds neither `:` nor `/`.
    fn from_str(text: &str) -> Result<Self, WhoError> {
        let named = text.split_once('=').filter(|(name, _)| !name.contains([':', '/']));
        let (name, rest) = named.map_or((None, text), |(name, rest)| (Some(name), rest));
        let source = parse_source(rest).ok_or_else(|| WhoError::Unknown {
            text: text.to_owned(),
            judges: Judge::ALL.map(Judge::name).join(", "),
        })?;
        let name = name.map_or_else(|| source.default_name(), str::to_owned);
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) {
            return Err(WhoError::BadName { name });
        }
        Ok(Self { name, source })
    }
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
            let is_score = |score: &f64| *score > 0.0 && *score <= 1.0;
            let at =
                run.rsplit_once('@').and_then(|(run, at)| Some((run, at.parse().ok().filter(is_score)?)));
            let (run, score) = at.map_or((run, None), |(run, score)| (run, Some(score)));
            (!run.is_empty()).then(|| Source::Network { run: run.into(), judge, score })
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
            Self::Network { run, judge, score } => {
                let stem = Path::new(run).file_stem().map(|stem| stem.to_string_lossy().into_owned());
                let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
                let stem: String = stem.unwrap_or_default().chars().map(plain).collect();
                let judge =
                    if *judge == Judge::Network { String::new() } else { format!("{}-", judge.name()) };
                let score = score.map(|score| format!("-{score}")).unwrap_or_default();
                format!("{judge}{stem}{score}")
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
        let network = |run: &str, judge| Source::Network { run: run.into(), judge, score: None };
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
            Source::Network { run: "runs/a".into(), judge: Judge::Zone, score: Some(0.25) }
        );
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
        assert!(matches!("x y=blind".parse::<Who>(), Err(WhoError::BadName { .. })));
    }
}
