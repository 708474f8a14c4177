//! The health of a data set: whether each file is the one in the manifest, and whether its values can be what they say.
//!
//! A fault is what no stage can use; a warning is what every stage takes, although it is seldom meant. Each is one sentence:
//! what was found, and what would be right. Metres, seconds; the whole cloud is examined, not the part in view.

mod motion;
mod sample;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::DatasetError;
use crate::episode::manifest::{EpisodeEntry, LabelManifest, Manifest, label_sets};
use crate::episode::{EpisodeReader, LabelReader};
use crate::progress::Progress;
use motion::Motion;

/// How much a symptom matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// No stage can use it.
    Fault,
    /// Every stage takes it, although it is seldom meant.
    Warning,
}

/// One thing that is wrong or odd, wherever it occurs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Symptom {
    pub severity: Severity,
    /// Where it occurs first: an episode, and the sample if it is of one.
    pub first_at: String,
    /// In how many places (samples, or episodes where it is of a whole one).
    pub n_places: usize,
    /// What was found and what would be right, in the first place.
    pub text: String,
}

/// The result of examining a data set.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Health {
    pub n_episodes: usize,
    pub n_samples: usize,
    /// Faults first, then as they were found.
    pub symptoms: Vec<Symptom>,
}

impl Health {
    /// How many symptoms are of a severity.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        self.symptoms.iter().filter(|symptom| symptom.severity == severity).count()
    }
}

/// What was found in one place, and the check that found it, by which places are counted together.
#[derive(Debug, Clone, PartialEq)]
struct Remark {
    severity: Severity,
    check: &'static str,
    text: String,
}

impl Remark {
    fn warning(check: &'static str, text: String) -> Self {
        Self { severity: Severity::Warning, check, text }
    }

    fn fault(check: &'static str, text: String) -> Self {
        Self { severity: Severity::Fault, check, text }
    }
}

/// Examines every episode and label set of a data set, a sample at a time.
///
/// # Errors
/// The folder holds no readable manifest; everything else is a symptom.
pub fn examine(path: &Path, progress: &dyn Progress) -> Result<Health, DatasetError> {
    let manifest = Manifest::read(path)?;
    progress.start("examine", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
    let mut found = Found::default();
    for entry in &manifest.episodes {
        progress.note(&entry.name);
        examine_episode(path, entry, &mut found, progress);
    }
    examine_labels(path, &manifest, &mut found);
    progress.finish();
    let mut symptoms = found.symptoms;
    symptoms.sort_by_key(|symptom| symptom.severity);
    let n_samples = manifest.episodes.iter().map(|entry| entry.n_samples).sum();
    Ok(Health { n_episodes: manifest.episodes.len(), n_samples, symptoms })
}

/// Symptoms, each check's places counted together.
#[derive(Default)]
struct Found {
    symptoms: Vec<Symptom>,
    by_check: BTreeMap<&'static str, usize>,
}

impl Found {
    fn add(&mut self, at: &str, remark: Remark) {
        let Remark { severity, check, text } = remark;
        if let Some(&idx) = self.by_check.get(check) {
            self.symptoms[idx].n_places += 1;
            return;
        }
        self.by_check.insert(check, self.symptoms.len());
        self.symptoms.push(Symptom { severity, first_at: at.to_owned(), n_places: 1, text });
    }
}

fn examine_episode(path: &Path, entry: &EpisodeEntry, found: &mut Found, progress: &dyn Progress) {
    let reader = match EpisodeReader::open_entry(path, entry) {
        Ok(reader) => reader,
        Err(error) => {
            progress.advance(entry.n_samples as u64);
            return found.add(&entry.name, Remark::fault("episode", error.to_string()));
        }
    };
    let mut motion = Motion::default();
    for sample_idx in 0..reader.len() {
        let at = format!("{}/{sample_idx}", entry.name);
        match reader.whole_sample(sample_idx) {
            Ok(sample) => {
                sample::examine(&sample).into_iter().for_each(|remark| found.add(&at, remark));
                motion.add(&sample.measured);
            }
            Err(error) => found.add(&at, Remark::fault("sample", error.to_string())),
        }
        progress.advance(1);
    }
    if reader.scales_intensity() {
        let text =
            "intensities are from 0 to 1; they are read times 255, since 0 to 255 is needed".to_owned();
        found.add(&entry.name, Remark::warning("intensity scale", text));
    }
    motion.judge().into_iter().for_each(|remark| found.add(&entry.name, remark));
}

fn examine_labels(path: &Path, manifest: &Manifest, found: &mut Found) {
    for set in label_sets(path) {
        let labels = match LabelManifest::read(path, &set) {
            Ok(labels) => labels,
            Err(error) => {
                found.add(&set, Remark::fault("label set", error.to_string()));
                continue;
            }
        };
        for entry in &manifest.episodes {
            let Some(label) = labels.episodes.iter().find(|label| label.name == entry.name) else {
                let text = format!("label set `{set}` lacks the episode; `harmzone label` makes it anew");
                found.add(&entry.name, Remark::fault("labels of an episode", text));
                continue;
            };
            let file = LabelManifest::folder(path, &set).join(&label.file);
            let checked = LabelReader::open(&file).and_then(|reader| reader.check_episode(&entry.sha256));
            if let Err(error) = checked {
                found.add(&entry.name, Remark::fault("label file", error.to_string()));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    #[test]
    fn places_of_one_check_are_one_symptom() {
        let mut found = Found::default();
        for i in 0..3 {
            found.add(&format!("e/{i}"), Remark::warning("empty cloud", format!("text {i}")));
        }
        found.add("e/9", Remark::fault("sample", "broken".into()));
        assert_eq!(found.symptoms.len(), 2);
        assert_eq!((found.symptoms[0].n_places, found.symptoms[0].text.as_str()), (3, "text 0"));
    }

    #[test]
    fn a_folder_without_a_manifest_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(examine(folder.path(), &Silent), Err(DatasetError::Manifest(_))));
    }
}
