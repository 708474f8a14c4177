//! What the episodes of a data set say of their truth: of imported ones sources, methods and what is annotated, of
//! simulated ones what is never annotated.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use crate::episode::manifest::Manifest;
use crate::episode::{EpisodeError, EpisodeReader, Labelled, LogFacts};
use crate::object::Kind;

/// Episodes whose logs say the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogGroup {
    pub n_episodes: usize,
    /// Of the first episode: the others differ in `drive` alone.
    #[serde(flatten)]
    pub facts: LogFacts,
}

/// The logs of a data set's episodes, none where all are simulated; and the categories that are never annotated.
pub(super) fn read(
    dataset: &Path,
    manifest: &Manifest,
) -> Result<(Vec<LogGroup>, BTreeSet<String>), EpisodeError> {
    let mut groups: Vec<LogGroup> = Vec::new();
    let mut background = BTreeSet::new();
    for entry in &manifest.episodes {
        let reader = EpisodeReader::open(&dataset.join(&entry.file))?;
        let categories = reader.meta().background.split(',').filter(|category| !category.is_empty());
        background.extend(categories.map(str::to_owned));
        let Some(facts) = reader.log() else { continue };
        let facts = shared(facts);
        let of_drive = |drive: &str| LogFacts { drive: drive.to_owned(), ..facts.clone() };
        match groups.iter_mut().find(|group| group.facts == of_drive(&group.facts.drive)) {
            Some(group) => group.n_episodes += 1,
            None => groups.push(LogGroup { n_episodes: 1, facts }),
        }
    }
    Ok((groups, background))
}

/// The facts without those of a single drive.
fn shared(facts: &LogFacts) -> LogFacts {
    let mut shared = facts.clone();
    shared.sample_names.clear();
    shared.first_cloud_sha256.clear();
    for of_drive in ["description", "notes", LogFacts::LEFT_OUT] {
        shared.methods.remove(of_drive);
    }
    shared
}

/// A group as lines, each with its line break.
pub(super) fn text(group: &LogGroup) -> String {
    let LogGroup { n_episodes, facts } = group;
    let mut text = format!(
        "from a log in the format `{}`, {n_episodes} episodes, such as {}\n",
        facts.format, facts.drive
    );
    let labelled = facts.labelled.as_ref().map_or_else(|| "nothing".to_owned(), describe);
    let mut line = |name: &str, value: &str| {
        writeln!(text, "  {name:<12} {value}").expect("writing to a string cannot fail");
    };
    line("annotated", &labelled);
    facts.methods.iter().for_each(|(name, value)| line(name, value));
    text
}

fn describe(labelled: &Labelled) -> String {
    let kinds: Vec<&str> = labelled.kinds.iter().copied().map(Kind::name).collect();
    let range = labelled.max_range_m.map(|range_m| format!(", to {range_m} m")).unwrap_or_default();
    let view = if labelled.in_camera_view { ", in the front camera's picture alone" } else { "" };
    format!("{}{range}{view}", kinds.join(", "))
}
