//! A data set whose samples are read when they are asked for, in any order: what Python's loaders need.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::coverage::keep_in_view;
use super::opened::OpenedEpisode;
use super::split::labels_in_order;
use super::{DatasetError, episodes_of, labels_of, pair};
use crate::episode::manifest::{EpisodeEntry, LabelEntry, Manifest, Split};
use crate::object::{Harm, LabelledObject, Object};
use crate::sample::{EgoState, Measured};

/// Episodes of which the index and the labels are kept, some 50 KB each.
const MOST_OPENED: usize = 256;

/// One sample with what is known of it.
#[derive(Debug, Clone)]
pub struct KnownSample {
    /// `<episode>/<sample index>`.
    pub id: String,
    pub measured: Measured,
    /// The ego's state by which its objects are labelled.
    pub true_state: EgoState,
    /// `None` where nobody annotated.
    pub objects: Option<Vec<KnownObject>>,
    /// Whether the objects have labels.
    pub is_labelled: bool,
}

/// An object and, in a labelled data set, whether it harms.
#[derive(Debug, Clone)]
pub struct KnownObject {
    pub truth: Object,
    pub harm: Option<Harm>,
}

/// The episodes of a data set, of one split or of all, with one label set or none.
#[derive(Debug)]
pub struct OneByOne {
    path: PathBuf,
    episodes: Vec<EpisodeEntry>,
    labels: Option<OneByOneLabels>,
    /// Of each episode, the number of samples before it; then the number of all.
    begins: Vec<usize>,
    /// Of each episode, whether its file was found to be the manifest's.
    checked: Vec<AtomicBool>,
    /// Those that were opened last, by their places.
    opened: Mutex<VecDeque<(usize, Arc<OpenedEpisode>)>>,
}

/// A label set's name, and the entry of each episode.
#[derive(Debug)]
struct OneByOneLabels {
    set: String,
    entries: Vec<LabelEntry>,
}

impl OneByOne {
    /// Reads the manifests; episodes are opened when a sample of theirs is asked for.
    ///
    /// # Errors
    /// [`DatasetError`]: no data set, no such labels, labels of another data set, no episode of the split.
    pub fn open(path: &Path, split: Option<Split>, set: Option<&str>) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(path)?;
        let labels = set.map(|set| labels_of(path, set, &manifest)).transpose()?;
        let episodes = match split {
            Some(split) => episodes_of(&manifest, split, path)?,
            None => manifest.episodes,
        };
        let in_order = |labels| {
            let entries = labels_in_order(&labels, &episodes, path)?;
            Ok::<_, DatasetError>(OneByOneLabels { set: labels.set, entries })
        };
        let labels = labels.map(in_order).transpose()?;
        let mut begins = vec![0];
        begins.extend(episodes.iter().scan(0, |n, entry| {
            *n += entry.n_samples;
            Some(*n)
        }));
        let checked = episodes.iter().map(|_| AtomicBool::new(false)).collect();
        Ok(Self { path: path.to_owned(), episodes, labels, begins, checked, opened: Mutex::default() })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        &self.episodes
    }

    /// The label set's name; `None`: without labels.
    #[must_use]
    pub fn label_set(&self) -> Option<&str> {
        self.labels.as_ref().map(|labels| labels.set.as_str())
    }

    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.begins[self.episodes.len()]
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads one sample; the first of an episode opens it and checks that its file is the manifest's.
    ///
    /// # Errors
    /// A file is not there, is damaged or another than the manifest's.
    ///
    /// # Panics
    /// There is no such sample.
    pub fn sample(&self, idx: usize) -> Result<KnownSample, DatasetError> {
        assert!(idx < self.len(), "there are {} samples, and {idx} was asked for", self.len());
        let episode_idx = self.begins.partition_point(|&begin| begin <= idx) - 1;
        let (entry, sample_idx) = (&self.episodes[episode_idx], idx - self.begins[episode_idx]);
        let opened = self.opened(episode_idx)?;
        let sample = opened.reader.sample(sample_idx)?;
        let (id, true_state) = (format!("{}/{sample_idx}", entry.name), *sample.true_state());
        let objects = sample.truth.map(|truth| truth.objects);
        let mut objects = match (objects, &opened.labels) {
            (Some(objects), Some(labels)) => {
                let labelled = pair(objects, &labels.samples()[sample_idx]);
                let labelled = labelled.ok_or_else(|| opened.mismatch(sample_idx))?;
                Some(labelled.into_iter().map(KnownObject::from).collect())
            }
            (objects, _) => {
                let known = |truth| KnownObject { truth, harm: None };
                objects.map(|objects| objects.into_iter().map(known).collect::<Vec<_>>())
            }
        };
        if let Some(objects) = &mut objects {
            keep_in_view(opened.reader.log(), &sample.measured, objects, |object| &object.truth.box_in_ego);
        }
        let is_labelled = opened.labels.is_some();
        Ok(KnownSample { id, measured: sample.measured, true_state, objects, is_labelled })
    }

    /// An episode that was opened lately, or opens it. Its content is checked once: to hash a whole file again for one sample
    /// would take longer than the sample.
    fn opened(&self, episode_idx: usize) -> Result<Arc<OpenedEpisode>, DatasetError> {
        let lock = || self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, opened)) = lock().iter().find(|(idx, _)| *idx == episode_idx) {
            return Ok(opened.clone());
        }
        let labels = self.labels.as_ref().map(|labels| (labels.set.as_str(), &labels.entries[episode_idx]));
        let is_checked = self.checked[episode_idx].load(Ordering::Acquire);
        let opened = OpenedEpisode::open(&self.path, &self.episodes[episode_idx], labels, is_checked)?;
        self.checked[episode_idx].store(true, Ordering::Release);
        let opened = Arc::new(opened);
        let mut kept = lock();
        kept.push_front((episode_idx, opened.clone()));
        kept.truncate(MOST_OPENED);
        Ok(opened)
    }
}

impl From<LabelledObject> for KnownObject {
    fn from(LabelledObject { truth, harm }: LabelledObject) -> Self {
        Self { truth, harm: Some(harm) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, test_data};

    #[test]
    fn each_sample_is_that_of_the_whole_data_set_in_any_order() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[3, 2]);
        let whole = Dataset::open(folder.path(), "rect", Split::Train).unwrap();
        let one_by_one = OneByOne::open(folder.path(), Some(Split::Train), Some("rect")).unwrap();
        assert_eq!((one_by_one.len(), one_by_one.label_set()), (5, Some("rect")));
        for idx in [4, 0, 3, 2, 1] {
            let (one, of_whole) = (one_by_one.sample(idx).unwrap(), &whole.samples()[idx]);
            assert_eq!((&one.id, &one.measured), (&of_whole.id, &of_whole.measured));
            assert_eq!(one.true_state, of_whole.true_state);
            let harms = one.objects.unwrap().into_iter().map(|object| object.harm.unwrap());
            assert!(harms.eq(of_whole.objects.iter().map(|object| object.harm)), "{idx}");
        }
        let bare = OneByOne::open(folder.path(), None, None).unwrap();
        assert!(bare.sample(1).unwrap().objects.unwrap().iter().all(|object| object.harm.is_none()));
    }

    #[test]
    fn a_file_that_was_changed_is_refused_and_the_others_are_read() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1, 1]);
        let data = OneByOne::open(folder.path(), None, None).unwrap();
        let path = folder.path().join(&data.episodes()[0].file);
        fs_err::copy(folder.path().join(&data.episodes()[1].file), &path).unwrap();
        let told = data.sample(0).unwrap_err().to_string();
        assert!(told.contains(&path.display().to_string()), "{told}");
        assert!(data.sample(1).is_ok());
    }

    #[test]
    fn many_episodes_are_read_with_few_kept_open() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1; 3]);
        let mut data = OneByOne::open(folder.path(), None, Some("rect")).unwrap();
        // Each of the three stands for many.
        data.episodes = (0..MOST_OPENED + 40).map(|i| data.episodes[i % 3].clone()).collect();
        let entries = &mut data.labels.as_mut().unwrap().entries;
        *entries = (0..MOST_OPENED + 40).map(|i| entries[i % 3].clone()).collect();
        data.begins = (0..=MOST_OPENED + 40).collect();
        data.checked = data.episodes.iter().map(|_| AtomicBool::new(false)).collect();
        let first = data.sample(0).unwrap();
        for idx in 0..data.len() {
            assert_eq!(data.sample(idx).unwrap().id, format!("made-{}/0", idx % 3));
        }
        assert_eq!(data.opened.lock().unwrap().len(), MOST_OPENED);
        let again = data.sample(0).unwrap();
        assert_eq!((again.id, again.measured), (first.id, first.measured), "opened anew");
    }
}
