//! One split of a data set with one of its label sets, whose episodes are read when they are asked for: a data set need not fit
//! in memory.

use std::collections::HashMap;
use std::mem;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use rayon::prelude::*;

use super::recording::N_TOGETHER;
use super::{
    Dataset, DatasetError, Fingerprint, LabelledSample, episodes_of, labels_of, load_episode, zone_of,
};
use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest, Manifest, ManifestError, Split};
use crate::episode::{is_any_annotated, label_command, zone_in};
use crate::zone::Zone;

/// Episodes that are read together where all samples are handed over in order.
const N_EPISODES_TOGETHER: usize = 16;

/// What the manifests say of a split's episodes and labels; copies share it.
#[derive(Debug, Clone)]
pub struct LabelledSplit {
    facts: Arc<Facts>,
}

#[derive(Debug)]
struct Facts {
    path: PathBuf,
    set: String,
    episodes: Vec<EpisodeEntry>,
    /// Of each episode.
    labels: Vec<LabelEntry>,
    zone: Zone,
    fingerprint: Fingerprint,
}

impl LabelledSplit {
    /// Reads the manifests.
    ///
    /// # Errors
    /// [`DatasetError`]: no dataset, no truth, no such labels, labels of another dataset, an episode without labels, or no
    /// episode of the split.
    pub fn open(path: &Path, set: &str, split: Split) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(path)?;
        let labels = match labels_of(path, set, &manifest) {
            Err(DatasetError::Manifest(ManifestError::NoLabels { .. }))
                if !is_any_annotated(path, &manifest)? =>
            {
                return Err(DatasetError::NoTruth { path: path.to_owned() });
            }
            labels => labels?,
        };
        let zone = zone_of(&labels).map_err(|message| DatasetError::Zone {
            set: set.to_owned(),
            message,
            path: path.to_owned(),
        })?;
        let episodes = episodes_of(&manifest, split, path)?;
        let labels = labels_in_order(&labels, &episodes, path)?;
        let fingerprint = Fingerprint::of(path, set)?;
        let (path, set) = (path.to_owned(), set.to_owned());
        Ok(Self { facts: Arc::new(Facts { path, set, episodes, labels, zone, fingerprint }) })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.facts.path
    }

    /// The rule its labels were made by.
    #[must_use]
    pub fn zone(&self) -> &Zone {
        &self.facts.zone
    }

    #[must_use]
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.facts.fingerprint
    }

    /// The split's episodes, in the manifest's order.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        &self.facts.episodes
    }

    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.episodes().iter().map(|entry| entry.n_samples).sum()
    }

    /// Reads some episodes, given by their places in the split, and checks them against the manifests.
    ///
    /// # Errors
    /// [`DatasetError`]: an episode or its labels are broken, or not the manifest's.
    ///
    /// # Panics
    /// There is no such episode.
    pub fn read(&self, places: &[usize]) -> Result<Dataset, DatasetError> {
        let Facts { path, set, episodes, labels, zone, fingerprint } = &*self.facts;
        let read_one = |&i: &usize| load_episode(path, set, &episodes[i], &labels[i], zone);
        let of_episodes = places.par_iter().map(read_one).collect::<Result<Vec<_>, _>>()?;
        Ok(Dataset {
            path: path.clone(),
            samples: of_episodes.into_iter().flatten().collect(),
            episodes: places.iter().map(|&i| episodes[i].clone()).collect(),
            zone: zone.clone(),
            fingerprint: fingerprint.clone(),
        })
    }

    /// Reads the whole split.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_all(&self) -> Result<Dataset, DatasetError> {
        self.read(&(0..self.episodes().len()).collect::<Vec<_>>())
    }

    /// Begins to read some episodes, on a thread of its own.
    #[must_use]
    pub fn read_ahead(&self, places: Vec<usize>) -> PartAhead {
        let split = self.clone();
        PartAhead(thread::spawn(move || split.read(&places)))
    }

    /// Hands over all samples in order, a part at a time, while a thread reads the next one: at most two parts are in
    /// memory. A part but the last has a multiple of 32 samples, so that batches of a network are those of the whole.
    ///
    /// # Errors
    /// As [`Self::read`]; `take` fails.
    pub fn for_each_part<E: From<DatasetError>>(
        &self,
        mut take: impl FnMut(Vec<LabelledSample>) -> Result<(), E>,
    ) -> Result<(), E> {
        let places: Vec<usize> = (0..self.episodes().len()).collect();
        let mut parts = places.chunks(N_EPISODES_TOGETHER).map(<[usize]>::to_vec);
        let mut begin_next = || parts.next().map(|places| self.read_ahead(places));
        let mut ahead = begin_next();
        let mut waiting: Vec<LabelledSample> = Vec::new();
        while let Some(part) = ahead.take() {
            waiting.extend(part.wait()?.samples);
            ahead = begin_next();
            let rest = waiting.split_off(waiting.len() / N_TOGETHER * N_TOGETHER);
            let whole = mem::replace(&mut waiting, rest);
            if !whole.is_empty() {
                take(whole)?;
            }
        }
        if waiting.is_empty() { Ok(()) } else { take(waiting) }
    }
}

/// Episodes that a thread is reading.
#[derive(Debug)]
pub struct PartAhead(JoinHandle<Result<Dataset, DatasetError>>);

impl PartAhead {
    /// The episodes, when they are read.
    ///
    /// # Errors
    /// As [`LabelledSplit::read`].
    pub fn wait(self) -> Result<Dataset, DatasetError> {
        self.0.join().unwrap_or_else(|panic| resume_unwind(panic))
    }
}

/// The labels of each episode, in their order.
///
/// # Errors
/// An episode has none.
pub(super) fn labels_in_order(
    labels: &LabelManifest,
    episodes: &[EpisodeEntry],
    path: &Path,
) -> Result<Vec<LabelEntry>, DatasetError> {
    let of_name: HashMap<&str, &LabelEntry> =
        labels.episodes.iter().map(|entry| (entry.name.as_str(), entry)).collect();
    let find = |entry: &EpisodeEntry| {
        let found = of_name.get(entry.name.as_str()).map(|&label| label.clone());
        found.ok_or_else(|| DatasetError::NotLabelled {
            episode: entry.name.clone(),
            set: labels.set.clone(),
            command: label_command(path, &labels.set, zone_in(&labels.zone_toml).as_ref()),
        })
    };
    episodes.iter().map(find).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    fn opened(folder: &Path) -> LabelledSplit {
        LabelledSplit::open(folder, "rect", Split::Train).unwrap()
    }

    #[test]
    fn parts_are_the_whole_in_order_and_all_but_the_last_have_a_multiple_of_32_samples() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[3; 21]);
        let (split, whole) =
            (opened(folder.path()), Dataset::open(folder.path(), "rect", Split::Train).unwrap());
        let (mut sizes, mut samples) = (Vec::new(), Vec::new());
        let taken: Result<(), DatasetError> = split.for_each_part(|part| {
            sizes.push(part.len());
            samples.extend(part);
            Ok(())
        });
        taken.unwrap();
        assert_eq!(sizes, [32, 31], "16 episodes have 48 samples, 21 have 63");
        assert_eq!((samples.as_slice(), split.n_samples()), (whole.samples(), 63));
        let some = split.read(&[4, 1]).unwrap();
        let of = |episode: usize| whole.samples()[3 * episode..3 * (episode + 1)].to_vec();
        assert_eq!(some.samples(), [of(4), of(1)].concat());
        assert_eq!(some.episodes()[0], split.episodes()[4]);
    }

    #[test]
    fn a_changed_episode_is_refused_when_it_is_read_and_the_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1, 1, 1]);
        let split = opened(folder.path());
        let path = folder.path().join(&split.episodes()[1].file);
        fs_err::copy(folder.path().join(&split.episodes()[0].file), &path).unwrap();
        let told = split.read_ahead(vec![0, 1]).wait().unwrap_err().to_string();
        assert!(told.contains(&path.display().to_string()), "{told}");
        assert_eq!(split.read_ahead(vec![0, 2]).wait().unwrap().samples().len(), 2);
    }
}
