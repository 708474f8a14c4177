//! A labelled dataset in memory: each sample's measurements and its objects with their labels.

pub mod blind;
mod by_episode;
mod coverage;
mod facts;
pub mod health;
mod one_by_one;
mod opened;
mod recording;
mod seen;
mod source;
mod split;
pub mod statistics;
pub mod test_data;

use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest, Manifest, ManifestError, Split};
use crate::episode::{EpisodeError, EpisodeReader, SampleLabels, label_command, zone_in};
use crate::files;
use crate::object::{LabelledObject, Object};
use crate::sample::{EgoState, IgnoredRegion, Measured, Sample};
use crate::zone::{Zone, ZoneConfig, ZoneError};

pub use by_episode::LabelledEpisodes;
pub use coverage::{CameraFacts, PictureRectangle, count_points, keep_in_view};
use facts::Origin;
pub use facts::{SampleFacts, episode_of_id};
pub use one_by_one::{KnownObject, KnownSample, OneByOne};
use opened::OpenedEpisode;
pub use recording::MeasuredSplit;
pub use seen::{LearnedError, SeenEpisodes};
pub use source::SampleSource;
pub use split::{LabelledSplit, PartAhead};

/// Why a dataset could not be loaded.
#[derive(Debug, Error)]
pub enum DatasetError {
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error("cannot read the dataset: {0}")]
    Io(#[from] std::io::Error),
    /// `command`: `harmzone label` with the set's zone.
    #[error("the label set `{set}` belongs to another dataset; `{command} --force` makes it anew")]
    OtherLabels { set: String, command: String },
    #[error("episode `{episode}` has no labels in set `{set}`; `{command}` makes them")]
    NotLabelled { episode: String, set: String, command: String },
    #[error(
        "nobody annotated these episodes, so there is nothing to score or to learn from; `harmzone predict` and \
         `harmzone view` work without truth: {}",
        path.display()
    )]
    NoTruth { path: PathBuf },
    #[error(
        "nobody annotated episode `{episode}` of split {split:?}, from which a network would learn that nothing is there; \
         import only annotated drives into that split: {}",
        path.display()
    )]
    PartlyAnnotated { episode: String, split: Split, path: PathBuf },
    #[error("the zone of label set `{set}` is not valid: {message}: {}", path.display())]
    Zone { set: String, message: String, path: PathBuf },
    #[error("the config in the episode's metadata is not valid: {message}: {}", path.display())]
    Config { message: String, path: PathBuf },
    #[error("episode `{episode}`, sample {sample_idx}: its labels are not of its objects; label the dataset again: {}", path.display())]
    Mismatch { episode: String, sample_idx: usize, path: PathBuf },
    #[error("no episode of split {}; the data set has {}: {}", wanted.name(), found.join(", "), path.display())]
    EmptySplit { wanted: Split, found: Vec<&'static str>, path: PathBuf },
}

/// One labelled sample.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledSample {
    /// `<episode>/<sample index>`.
    pub id: String,
    pub measured: Measured,
    /// The ego's state by which its objects are labelled.
    pub true_state: EgoState,
    pub objects: Vec<LabelledObject>,
    pub facts: SampleFacts,
}

/// The data that a run was trained on, to recognise it again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    pub dataset_sha256: String,
    pub labels_sha256: String,
}

impl Fingerprint {
    /// Identifies a data set's folder and one of its label sets.
    ///
    /// # Errors
    /// One of the two is not there.
    pub fn of(path: &Path, set: &str) -> std::io::Result<Self> {
        let hash = |file: PathBuf| fs::read(file).map(|bytes| files::sha256_hex(&bytes));
        Ok(Self {
            dataset_sha256: hash(path.join(Manifest::FILE))?,
            labels_sha256: hash(LabelManifest::folder(path, set).join(LabelManifest::FILE))?,
        })
    }
}

/// One split of a dataset with one of its label sets.
#[derive(Debug, Clone)]
pub struct Dataset {
    path: PathBuf,
    samples: Vec<LabelledSample>,
    episodes: Vec<EpisodeEntry>,
    zone: Zone,
    fingerprint: Fingerprint,
}

impl Dataset {
    /// Loads the episodes of a split with their labels, in the manifest's order.
    ///
    /// # Errors
    /// [`DatasetError`]: no dataset, no truth, no such labels, labels of another dataset, a broken file, or no
    /// episode of the split.
    pub fn open(path: &Path, set: &str, split: Split) -> Result<Self, DatasetError> {
        LabelledSplit::open(path, set, split)?.read_all()
    }

    /// Loads a split; if none is named, the first of `val`, `dev` and `test` that the data set has.
    ///
    /// # Errors
    /// As [`Dataset::open`].
    pub fn open_to_score(path: &Path, set: &str, split: Option<Split>) -> Result<Self, DatasetError> {
        let split = match split {
            Some(split) => split,
            None => Split::to_score(&Manifest::read(path)?),
        };
        Self::open(path, set, split)
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The rule its labels were made by.
    #[must_use]
    pub fn zone(&self) -> &Zone {
        &self.zone
    }

    #[must_use]
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// The split's episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        &self.episodes
    }

    /// The dataset with only its first `n` samples and no episodes; for measurements.
    #[must_use]
    pub fn first(&self, n: usize) -> Self {
        Self {
            path: self.path.clone(),
            samples: self.samples[..n.min(self.samples.len())].to_vec(),
            episodes: Vec::new(),
            zone: self.zone.clone(),
            fingerprint: self.fingerprint.clone(),
        }
    }

    /// The same, if every sample is annotated: what nobody annotated cannot be learnt from.
    ///
    /// # Errors
    /// [`DatasetError::PartlyAnnotated`].
    pub fn to_learn_from(self) -> Result<Self, DatasetError> {
        match self.samples.iter().find(|sample| sample.facts.is_unlabelled) {
            Some(sample) => Err(DatasetError::PartlyAnnotated {
                episode: episode_of_id(&sample.id).to_owned(),
                split: self.episodes.first().map_or(Split::Train, |entry| entry.split),
                path: self.path.clone(),
            }),
            None => Ok(self),
        }
    }

    #[must_use]
    pub fn samples(&self) -> &[LabelledSample] {
        &self.samples
    }

    /// Each sample's id and measurements, which is all that a detector may see.
    #[must_use]
    pub fn named(&self) -> Vec<(&str, &Measured)> {
        named(&self.samples)
    }

    /// The samples of the first `n` episodes; of all with 0.
    #[must_use]
    pub fn first_episodes(&self, n: usize) -> &[LabelledSample] {
        if n == 0 {
            return &self.samples;
        }
        let n_samples = self.episodes.iter().take(n).map(|entry| entry.n_samples).sum();
        &self.samples[..n_samples]
    }
}

/// As [`Dataset::named`], of some samples.
#[must_use]
pub fn named(samples: &[LabelledSample]) -> Vec<(&str, &Measured)> {
    samples.iter().map(|sample| (sample.id.as_str(), &sample.measured)).collect()
}

/// The episodes of a split, of which there is at least one.
fn episodes_of(manifest: &Manifest, split: Split, path: &Path) -> Result<Vec<EpisodeEntry>, DatasetError> {
    let episodes: Vec<EpisodeEntry> = manifest.of_split(split).cloned().collect();
    if episodes.is_empty() {
        let has = |split: &Split| manifest.of_split(*split).next().is_some();
        let found = Split::ALL.into_iter().filter(has).map(Split::name).collect();
        return Err(DatasetError::EmptySplit { wanted: split, found, path: path.to_owned() });
    }
    Ok(episodes)
}

/// A label set, if it is of this data set.
fn labels_of(path: &Path, set: &str, manifest: &Manifest) -> Result<LabelManifest, DatasetError> {
    let labels = LabelManifest::read(path, set)?;
    if labels.dataset_config_sha256 != manifest.config_sha256 {
        let command = label_command(path, set, zone_in(&labels.zone_toml).as_ref());
        return Err(DatasetError::OtherLabels { set: set.to_owned(), command });
    }
    Ok(labels)
}

fn zone_of(labels: &LabelManifest) -> Result<Zone, String> {
    let config: ZoneConfig = toml::from_str(&labels.zone_toml).map_err(|error| error.to_string())?;
    Zone::try_from(config).map_err(|error: ZoneError| error.to_string())
}

fn load_episode(
    path: &Path,
    set: &str,
    entry: &EpisodeEntry,
    labels: &LabelEntry,
    zone: &Zone,
) -> Result<Vec<LabelledSample>, DatasetError> {
    map_episode(path, (set, entry, labels), zone, |_, sample| sample)
}

/// What is made of each sample of an episode and its number, of which one at a time is in memory.
fn map_episode<T>(
    path: &Path,
    (set, entry, labels): (&str, &EpisodeEntry, &LabelEntry),
    zone: &Zone,
    make: impl Fn(usize, LabelledSample) -> T,
) -> Result<Vec<T>, DatasetError> {
    let (mut made, mut origin) = (Vec::new(), None);
    each_labelled(path, set, entry, labels, |reader, (measured, true_state, objects, ignored)| {
        let origin = match &origin {
            Some(origin) => origin,
            None => origin.insert(Origin::of_episode(
                reader.meta(),
                reader.log(),
                &path.join(&entry.file),
                measured.time_ns,
            )?),
        };
        let sample_idx = made.len();
        let sample = LabelledSample {
            id: format!("{}/{sample_idx}", entry.name),
            facts: origin.facts_of(&measured, &true_state, ignored, zone),
            measured,
            true_state,
            objects,
        };
        made.push(make(sample_idx, sample));
        Ok(())
    })?;
    Ok(made)
}

/// A sample's measurements, the ego's true state, the objects, and where nobody annotated; `None` where nobody annotated it
/// at all.
type Read = (Measured, EgoState, Vec<LabelledObject>, Option<Vec<IgnoredRegion>>);

/// Takes the samples of an episode with their labels, one after the other.
fn each_labelled(
    path: &Path,
    set: &str,
    entry: &EpisodeEntry,
    labels: &LabelEntry,
    mut take: impl FnMut(&EpisodeReader, Read) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let opened = OpenedEpisode::open(path, entry, Some((set, labels)), false)?;
    let label_reader = opened.labels.as_ref().expect("it was opened with labels");
    let reader = &opened.reader;
    for (sample_idx, (sample, labels)) in reader.samples().zip(label_reader.samples()).enumerate() {
        let sample = sample?;
        let true_state = *sample.true_state();
        let Sample { measured, truth } = sample;
        let (objects, ignored) = truth.map(|truth| (truth.objects, truth.ignored)).unzip();
        let mut objects =
            pair(objects.unwrap_or_default(), labels).ok_or_else(|| opened.mismatch(sample_idx))?;
        coverage::keep_in_view(reader.log(), &measured, &mut objects, |object| &object.truth.box_in_ego);
        take(reader, (measured, true_state, objects, ignored))?;
    }
    Ok(())
}

/// Each object with its label, if both lists are of the same objects in the same order.
fn pair(objects: Vec<Object>, labels: &SampleLabels) -> Option<Vec<LabelledObject>> {
    if objects.len() != labels.labels.len() {
        return None;
    }
    objects
        .into_iter()
        .zip(&labels.labels)
        .map(|(truth, label)| {
            (truth.id.as_ref() == Some(&label.id)).then_some(LabelledObject { truth, harm: label.harm })
        })
        .collect()
}

#[cfg(test)]
impl Dataset {
    /// A sample to spoil in a test.
    pub fn sample_mut(&mut self, idx: usize) -> &mut LabelledSample {
        &mut self.samples[idx]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::{EpisodeWriter, LogFacts, MapDrawing};
    use crate::sample::Truth;

    #[test]
    fn episodes_that_nobody_annotated_are_told_from_those_that_wait_for_labels() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("episodes")).unwrap();
        let bare = toml::from_str::<LogFacts>("format = \"ros2\"\ndrive = \"bag\"").unwrap();
        let labelled: crate::episode::Labelled = toml::from_str("kinds = [\"vehicle\"]").unwrap();
        let (meta, mut manifest) =
            (test_data::episode_meta("unknown", ""), Manifest::new("0".repeat(64), 0, false));
        let measured = test_data::dataset(1).samples()[0].measured.clone();
        for (name, truth) in [("bare", None), ("annotated", Some(Truth::default()))] {
            let file = format!("episodes/{name}.mcap");
            let log = LogFacts { labelled: truth.as_ref().map(|_| labelled.clone()), ..bare.clone() };
            let path = folder.path().join(&file);
            let map = MapDrawing::default();
            let mut writer = EpisodeWriter::create_log(&path, &meta, &log, &[], &map).unwrap();
            writer.write(&Sample { measured: measured.clone(), truth }).unwrap();
            let done = writer.finish().unwrap();
            manifest.episodes.push(EpisodeEntry {
                name: name.into(),
                file,
                split: Split::Test,
                seed: 0,
                town: meta.town.clone(),
                weather: meta.weather.clone(),
                ood: false,
                n_samples: done.n_samples,
                n_objects: done.n_objects,
                sha256: done.sha256,
            });
            manifest.write(folder.path()).unwrap();
            let told = Dataset::open(folder.path(), "rect", Split::Test).unwrap_err();
            match name {
                "bare" => assert!(matches!(told, DatasetError::NoTruth { .. }), "{told}"),
                _ => assert!(told.to_string().contains("harmzone label"), "{told}"),
            }
        }
    }
}
