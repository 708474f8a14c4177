//! The data sets of the folder: each with a label set and with the boxes of one detector, if there are any.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use fs_err as fs;
use serde::Serialize;

use super::ServeError;
use super::facts::EpisodeFacts;
use super::folder::{Findings, ServedFolder};
use super::source::{SetBoxes, SetSource};
use crate::dataset::LabelledEpisodes;
use crate::episode::manifest::{EpisodeEntry, LabelManifest, Manifest, label_sets};
use crate::episode::{DetectionReader, EpisodeReader, LabelReader};
use crate::eval::{EvalConfig, Protocol};
use crate::files::read_sealed;
use crate::infer::{CheckpointFile, Trained};
use crate::model::checkpoint::CHECKPOINT;
use crate::outcome::{Origin, Source};

/// The label set that is shown where none is named, if it is there.
const DEFAULT_SET: &str = "rect";

/// What of the data sets is shown.
#[derive(Debug, Clone, Default)]
pub struct SetOptions {
    /// `None`: `rect`, or the first where that is not there.
    pub labels: Option<String>,
    /// The score from which on boxes count; `None`: the network's or the driver's own, else that of `eval`.
    pub min_score: Option<f64>,
}

/// A data set with the boxes of a detector.
#[derive(Debug)]
pub struct EpisodeSet {
    /// What it is called on the page.
    pub name: String,
    pub entries: Vec<EpisodeEntry>,
    /// What is wrong with the whole of it.
    pub trouble: Option<String>,
    source: SetSource,
    by_name: HashMap<String, usize>,
    facts: Vec<OnceLock<Arc<EpisodeFacts>>>,
}

/// What the page needs to offer a set.
#[derive(Debug, Serialize)]
pub struct SetSummary<'a> {
    name: &'a str,
    n_episodes: usize,
    labels: Option<&'a str>,
    detector: Option<&'a str>,
    /// The score from which on boxes count.
    min_score: Option<f64>,
    trouble: Option<&'a str>,
}

/// The files of an episode, open to be asked for samples.
pub struct OpenEpisode {
    pub reader: EpisodeReader,
    pub labels: Option<LabelReader>,
    pub found: Option<DetectionReader>,
    pub facts: Arc<EpisodeFacts>,
    /// The score from which on boxes count.
    pub min_score: f64,
    /// Distance of centres on the ground below which a detection is on an object.
    pub match_m: f64,
}

/// Every data set that was found, once for each detector with boxes for it.
#[must_use]
pub fn find_sets(folder: &ServedFolder, found: &Findings, options: &SetOptions) -> Vec<EpisodeSet> {
    let mut sets = Vec::new();
    let predictions = found.predictions.iter().filter_map(|path| Predicted::read(folder, path));
    let logs = found.drive_logs.iter().filter_map(|path| Predicted::read_logs(folder, path));
    let predictions: Vec<Predicted> = predictions.chain(logs).collect();
    for path in &found.datasets {
        let bare = EpisodeSet::open(folder, path, None, options);
        let of_this = predictions.iter().filter(|of| of.is_for(path, &bare));
        let with_boxes: Vec<EpisodeSet> = of_this
            .map(|of| EpisodeSet::open(folder, path, Some(of.boxes(folder, options)), options))
            .collect();
        if with_boxes.is_empty() {
            sets.push(bare);
        } else {
            sets.extend(with_boxes);
        }
    }
    sets
}

/// A folder of predictions, by one of its files: the content of an episode tells the data set.
struct Predicted {
    folder: PathBuf,
    episode: String,
    episode_sha256: String,
    detector: String,
    /// The data set that a driver recorded, if these are its logs.
    driven: Option<PathBuf>,
}

impl Predicted {
    fn read(folder: &ServedFolder, path: &Path) -> Option<Self> {
        let files = fs::read_dir(path).ok()?.filter_map(Result::ok).map(|entry| entry.path());
        let first =
            files.filter(|file| file.extension().is_some_and(|extension| extension == "mcap")).min()?;
        let read = || -> Result<Self, ServeError> {
            let reader = DetectionReader::open(&folder.inside(&first)?)?;
            let (meta, folder) = (reader.meta().clone(), path.to_owned());
            let (episode, episode_sha256) = (meta.episode, meta.episode_sha256);
            Ok(Self { folder, episode, episode_sha256, detector: meta.set, driven: None })
        };
        read().inspect_err(|error| tracing::warn!("predictions are left out: {error}")).ok()
    }

    /// A driver's logs, which lie in the data set that it recorded.
    fn read_logs(folder: &ServedFolder, path: &Path) -> Option<Self> {
        Some(Self { driven: path.parent().map(Path::to_owned), ..Self::read(folder, path)? })
    }

    /// Whether the boxes are for this data set. A drive of two drivers may be the same, but the next one need not be: logs
    /// are for their own data set.
    fn is_for(&self, path: &Path, set: &EpisodeSet) -> bool {
        match &self.driven {
            Some(driven) => driven == path,
            None => set.is_of(&self.episode, &self.episode_sha256),
        }
    }

    fn boxes(&self, folder: &ServedFolder, options: &SetOptions) -> SetBoxes {
        let mut config = self.eval_config(folder).unwrap_or_default();
        if let Some(min_score) = options.min_score {
            config.operating_score = min_score;
        }
        let protocol = Protocol::try_from(config).unwrap_or_default();
        SetBoxes { folder: self.folder.clone(), detector: self.detector.clone(), protocol }
    }

    /// How the network that made them is scored: that inside the program, or of the run whose folder they lie in. A
    /// driver's name may be that of a network which it is not.
    fn eval_config(&self, folder: &ServedFolder) -> Option<EvalConfig> {
        if let Some(driven) = &self.driven {
            return config_of_driver(folder, driven);
        }
        let of_run = || {
            let runs = self.folder.ancestors().skip(1).take(2);
            let mut checkpoints = runs.map(|run| run.join(CHECKPOINT)).filter(|file| file.is_file());
            let path = checkpoints.find_map(|file| folder.inside(&file).ok())?;
            Some(Trained::File(CheckpointFile::at(path)))
        };
        let inside = Trained::find(Path::new(&self.detector))
            .ok()
            .filter(|found| matches!(found, Trained::Shipped(_)));
        let trained = inside.or_else(of_run)?;
        trained.eval_config().inspect_err(|error| tracing::warn!("{error}")).ok()
    }
}

/// How a driver's boxes are scored: from the score from which on it braked for them, even a little.
fn config_of_driver(folder: &ServedFolder, driven: &Path) -> Option<EvalConfig> {
    let read = || -> Result<Origin, ServeError> {
        let path = folder.inside(&driven.join(Origin::FILE))?;
        serde_json::from_str(&read_sealed(&path)?)
            .map_err(|error| ServeError::Trouble { message: format!("{error}: {}", path.display()) })
    };
    let warn = |error: &ServeError| tracing::warn!("the score of a driver's boxes is not known: {error}");
    let origin = read().inspect_err(warn).ok()?;
    let is_network = matches!(origin.who.source, Source::Network { .. });
    // All boxes of the others count; older files do not tell a network's score.
    let of_others = (!is_network).then_some(0.0);
    let mut config = EvalConfig::default();
    if let Some(score) = origin.seen_from.or(origin.min_score).or(of_others) {
        config.operating_score = score;
    }
    Some(config)
}

impl EpisodeSet {
    fn open(folder: &ServedFolder, path: &Path, boxes: Option<SetBoxes>, options: &SetOptions) -> Self {
        let mut name = folder.name_of(path);
        if let Some(boxes) = &boxes {
            name += &format!(", boxes of {}", folder.name_of(Path::new(&boxes.detector)));
        }
        let (mut trouble, mut entries, mut labels) = (None, Vec::new(), None);
        match read_manifest(folder, path) {
            Ok(manifest) => {
                labels = open_labels(folder, path, &manifest, options).unwrap_or_else(|error| {
                    trouble = Some(error.to_string());
                    None
                });
                entries = manifest.episodes;
            }
            Err(error) => trouble = Some(error.to_string()),
        }
        let by_name = entries.iter().enumerate().map(|(i, entry)| (entry.name.clone(), i)).collect();
        let facts = entries.iter().map(|_| OnceLock::new()).collect();
        let source = SetSource { path: path.to_owned(), labels, boxes };
        Self { name, entries, trouble, source, by_name, facts }
    }

    /// Whether an episode of this content is in it.
    fn is_of(&self, episode: &str, sha256: &str) -> bool {
        self.find(episode).is_some_and(|idx| self.entries[idx].sha256 == sha256)
    }

    /// An episode's place in the manifest, by its name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    #[must_use]
    pub fn summary(&self) -> SetSummary<'_> {
        let boxes = self.source.boxes.as_ref();
        SetSummary {
            name: &self.name,
            n_episodes: self.entries.len(),
            labels: self.source.labels.as_ref().map(LabelledEpisodes::set),
            detector: boxes.map(|boxes| boxes.detector.as_str()),
            min_score: boxes.map(|boxes| boxes.protocol.config().operating_score),
            trouble: self.trouble.as_deref(),
        }
    }

    /// What is known of an episode beyond the manifest, read the first time.
    pub fn facts(&self, folder: &ServedFolder, idx: usize) -> Arc<EpisodeFacts> {
        self.facts[idx]
            .get_or_init(|| Arc::new(EpisodeFacts::read(&self.source, folder, &self.entries[idx])))
            .clone()
    }

    /// The same, where it has been read already.
    #[must_use]
    pub fn known_facts(&self, idx: usize) -> Option<&EpisodeFacts> {
        self.facts[idx].get().map(AsRef::as_ref)
    }

    /// How many episodes have been read.
    #[must_use]
    pub fn n_read(&self) -> usize {
        self.facts.iter().filter(|facts| facts.get().is_some()).count()
    }

    /// Opens an episode's files. That they are the manifest's is checked when its facts are read.
    ///
    /// # Errors
    /// A file is not there, is damaged, leads out of the folder, or is of another episode.
    pub fn open_episode(&self, folder: &ServedFolder, idx: usize) -> Result<OpenEpisode, ServeError> {
        let (entry, facts) = (&self.entries[idx], self.facts(folder, idx));
        if let Some(message) = facts.trouble.clone() {
            return Err(ServeError::Trouble { message });
        }
        let config = self.source.boxes.as_ref().map(|boxes| boxes.protocol.config());
        Ok(OpenEpisode {
            reader: EpisodeReader::open(&self.source.file_of(folder, entry)?)?,
            labels: self.source.read_labels(folder, entry)?,
            found: self.source.read_boxes(folder, entry)?,
            facts,
            min_score: config.map_or(0.0, |config| config.operating_score),
            match_m: config.map_or(0.0, |config| config.tp_threshold_m),
        })
    }
}

fn read_manifest(folder: &ServedFolder, path: &Path) -> Result<Manifest, ServeError> {
    folder.check_files(path, &[Manifest::FILE])?;
    Ok(Manifest::read(path)?)
}

/// The label set to show; `None` where there is none and none is asked for.
fn open_labels(
    folder: &ServedFolder,
    path: &Path,
    manifest: &Manifest,
    options: &SetOptions,
) -> Result<Option<LabelledEpisodes>, ServeError> {
    let found = label_sets(path)?;
    let usual = found.iter().find(|set| *set == DEFAULT_SET).or(found.first());
    let Some(set) = options.labels.as_ref().or(usual).cloned() else { return Ok(None) };
    folder.check_files(&LabelManifest::folder(path, &set), &[LabelManifest::FILE])?;
    Ok(Some(LabelledEpisodes::open(path, &set, manifest)?))
}
