//! What is in memory of the samples that a run learns from: the windows that the step under way shows, and the next one, which
//! a thread reads meanwhile.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use super::config::TrainConfig;
use super::data_check::check_pictures;
use super::error::TrainError;
use super::plan::{Epoch, EpochWindows, Plan, Position};
use crate::dataset::{Dataset, LabelledSample, PartAhead, SampleSource};
use crate::object::Harm;

/// Some parts of the data in memory.
#[derive(Debug)]
struct Loaded<'a> {
    parts: Vec<usize>,
    data: Cow<'a, Dataset>,
    /// The number of each sample among all of the run.
    numbers: Vec<usize>,
    /// Samples with something harmful ahead.
    harmful: Vec<usize>,
}

/// A sample to be shown, with the window that it comes from.
#[derive(Debug, Clone)]
pub struct Shown<'a> {
    window: Arc<Loaded<'a>>,
    idx: usize,
}

impl Shown<'_> {
    #[must_use]
    pub fn sample(&self) -> &LabelledSample {
        &self.donors()[self.idx]
    }

    /// The samples whose objects may be pasted into it: all of its window.
    #[must_use]
    pub fn donors(&self) -> &[LabelledSample] {
        self.window.data.samples()
    }

    /// The sample's number among all of the run.
    #[must_use]
    pub fn number(&self) -> usize {
        self.window.numbers[self.idx]
    }
}

/// A window in memory with the order of its samples.
#[derive(Debug)]
struct Window<'a> {
    epoch: Epoch,
    /// Its place in the epoch.
    place: usize,
    loaded: Arc<Loaded<'a>>,
    order: Vec<usize>,
}

/// Gives the samples of any step; of steps in their order it reads each window once.
pub struct Windows<'a> {
    plan: &'a Plan,
    source: SampleSource<'a>,
    /// The epochs looked at last, at most two.
    epochs: VecDeque<Arc<EpochWindows>>,
    held: Vec<Window<'a>>,
    /// The parts of the window that a thread is reading.
    ahead: Option<(Vec<usize>, PartAhead)>,
    /// The run whose network must be able to take what is read; `None` if nobody asks.
    taken_by: Option<&'a TrainConfig>,
}

impl<'a> Windows<'a> {
    pub fn new(plan: &'a Plan, source: impl Into<SampleSource<'a>>) -> Self {
        Self {
            plan,
            source: source.into(),
            epochs: VecDeque::new(),
            held: Vec::new(),
            ahead: None,
            taken_by: None,
        }
    }

    /// The same, which refuses a window with pictures that the network of this run cannot take.
    #[must_use]
    pub fn taken_by(self, config: &'a TrainConfig) -> Self {
        Self { taken_by: Some(config), ..self }
    }

    /// The samples of a step. Windows that it does not show are dropped, unless somebody still holds a sample of theirs.
    ///
    /// # Errors
    /// An episode is broken, is not the manifest's, or nobody annotated it; its pictures do not fit the network.
    pub fn step(&mut self, position: Position) -> Result<Vec<Shown<'a>>, TrainError> {
        let windows = self.epoch(self.plan.epoch(position));
        let places = self.plan.places(position);
        let wanted = windows.holding(&places);
        self.hold(&windows, wanted.clone())?;
        let next = match windows.parts.get(wanted.end) {
            Some(parts) => Some(parts.clone()),
            None => self.plan.epoch_after(windows.epoch).map(|epoch| self.epoch(epoch).parts[0].clone()),
        };
        if let Some(parts) = next {
            self.read_ahead(parts);
        }
        let show = |place: usize| {
            let (window, place) = windows.locate(place);
            let Window { loaded, order, .. } = &self.held[window - wanted.start];
            Shown { window: loaded.clone(), idx: order[place] }
        };
        Ok(places.map(show).collect())
    }

    /// The windows of an epoch.
    fn epoch(&mut self, epoch: Epoch) -> Arc<EpochWindows> {
        if let Some(known) = self.epochs.iter().find(|known| known.epoch == epoch) {
            return known.clone();
        }
        let windows = Arc::new(self.plan.windows(epoch));
        self.epochs.push_front(windows.clone());
        self.epochs.truncate(2);
        windows
    }

    /// Holds these windows of an epoch, in their order, and no other.
    fn hold(&mut self, windows: &EpochWindows, wanted: Range<usize>) -> Result<(), TrainError> {
        let is_wanted = |loaded: &Loaded| windows.parts[wanted.clone()].contains(&loaded.parts);
        let mut old = std::mem::take(&mut self.held);
        old.retain(|window| is_wanted(&window.loaded));
        for place in wanted {
            let is_it = |window: &Window| window.epoch == windows.epoch && window.place == place;
            if let Some(at) = old.iter().position(is_it) {
                self.held.push(old.swap_remove(at));
                continue;
            }
            let parts = &windows.parts[place];
            let loaded = match old.iter().find(|window| window.loaded.parts == *parts) {
                Some(window) => window.loaded.clone(),
                None => Arc::new(self.load(parts)?),
            };
            let order = self.plan.order(windows, place, loaded.numbers.len(), &loaded.harmful);
            self.held.push(Window { epoch: windows.epoch, place, loaded, order });
        }
        Ok(())
    }

    fn load(&mut self, parts: &[usize]) -> Result<Loaded<'a>, TrainError> {
        let data = match self.source {
            SampleSource::InMemory(dataset) => Cow::Borrowed(dataset),
            SampleSource::OnDisk(split) => {
                let ahead = self.ahead.take().filter(|(of, _)| of == parts);
                let read = match ahead {
                    Some((_, ahead)) => ahead.wait()?,
                    None => split.read(parts)?,
                };
                let read = read.to_learn_from()?;
                if let Some(config) = self.taken_by {
                    check_pictures(read.samples(), config)?;
                }
                Cow::Owned(read)
            }
        };
        let is_harmful =
            |sample: &LabelledSample| sample.objects.iter().any(|object| object.harm == Harm::Harmful);
        let samples = data.samples();
        let harmful = (0..samples.len()).filter(|&i| is_harmful(&samples[i])).collect();
        let numbers = parts.iter().flat_map(|&part| self.plan.numbers(part)).collect();
        Ok(Loaded { parts: parts.to_vec(), data, numbers, harmful })
    }

    /// Begins to read a window, unless it is held, or one is being read already.
    fn read_ahead(&mut self, parts: Vec<usize>) {
        let SampleSource::OnDisk(split) = self.source else { return };
        if self.ahead.is_none() && self.held.iter().all(|window| window.loaded.parts != parts) {
            self.ahead = Some((parts.clone(), split.read_ahead(parts)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::{StageConfig, StreamConfig, TrainConfig};
    use super::*;
    use crate::dataset::{LabelledSplit, test_data};
    use crate::episode::Split;

    fn config(window_episodes: usize, batch_size: usize) -> TrainConfig {
        let stage = |epochs| StageConfig { epochs, ..TrainConfig::default().fused_stage };
        TrainConfig {
            batch_size,
            accumulate: 1,
            lidar_stage: stage(2),
            fused_stage: stage(1),
            stream: StreamConfig { window_episodes },
            ..TrainConfig::default()
        }
    }

    /// The numbers of the samples of all steps, by epoch; and the most windows in memory at a time, with the one being read.
    fn shown(config: &TrainConfig, source: SampleSource<'_>) -> (Vec<Vec<usize>>, usize) {
        let plan = Plan::new(config, source);
        let mut windows = Windows::new(&plan, source);
        let (mut epochs, mut most) = (Vec::new(), 0);
        for stage in [0, 1] {
            for step in 0..plan.n_steps[stage] {
                if step % plan.steps_per_epoch == 0 {
                    epochs.push(Vec::new());
                }
                let of_step = windows.step(Position { stage, step }).unwrap();
                epochs.last_mut().unwrap().extend(of_step.iter().map(Shown::number));
                most = most.max(windows.held.len() + usize::from(windows.ahead.is_some()));
            }
        }
        (epochs, most)
    }

    fn sorted(mut numbers: Vec<usize>) -> Vec<usize> {
        numbers.sort_unstable();
        numbers
    }

    #[test]
    fn an_epoch_shows_every_sample_once_whatever_the_window() {
        let folder = tempfile::tempdir().unwrap();
        let sizes = [2, 1, 3, 1, 2, 2, 1];
        test_data::write(folder.path(), &sizes);
        let split = LabelledSplit::open(folder.path(), "rect", Split::Train).unwrap();
        for (window_episodes, batch_size) in [(1, 2), (2, 2), (2, 3), (3, 2), (7, 5), (100, 4)] {
            let (epochs, most) = shown(&config(window_episodes, batch_size), (&split).into());
            assert_eq!(epochs.len(), 3);
            assert_ne!(epochs[0], epochs[1]);
            for epoch in epochs {
                assert_eq!(sorted(epoch), (0..12).collect::<Vec<_>>(), "windows of {window_episodes}");
            }
            // A batch of two may straddle two windows of one sample each; then one more is read.
            let wanted = if window_episodes < sizes.len() { 2..=3 } else { 1..=1 };
            assert!(wanted.contains(&most), "windows of {window_episodes}: {most} in memory");
        }
    }

    #[test]
    fn samples_of_a_window_are_shown_together_and_give_and_take_objects_and_places_among_themselves() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[2; 6]);
        let split = LabelledSplit::open(folder.path(), "rect", Split::Train).unwrap();
        let config = TrainConfig { harmful_share: 0.9, ..config(2, 4) };
        let plan = Plan::new(&config, &split);
        let mut windows = Windows::new(&plan, &split);
        for step in 0..plan.steps_per_epoch {
            let of_step = windows.step(Position { stage: 0, step }).unwrap();
            let own: Vec<&str> = of_step[0].donors().iter().map(|donor| donor.id.as_str()).collect();
            assert_eq!(own.len(), 4, "two episodes of two samples");
            assert!(of_step.iter().all(|shown| own.contains(&shown.sample().id.as_str())));
        }
    }

    #[test]
    fn a_window_of_all_episodes_shows_what_a_run_in_memory_shows() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[2, 3, 1, 4]);
        let split = LabelledSplit::open(folder.path(), "rect", Split::Train).unwrap();
        let whole = split.read_all().unwrap();
        let of = |window_episodes, source| {
            let config = TrainConfig { harmful_share: 0.5, ..config(window_episodes, 3) };
            shown(&config, source).0
        };
        let in_memory = of(0, (&whole).into());
        assert_eq!(of(0, (&split).into()), in_memory);
        assert_eq!(of(4, (&split).into()), in_memory);
        assert_eq!(of(1000, (&split).into()), in_memory);
        assert_ne!(of(2, (&split).into()), in_memory);
    }

    #[test]
    fn a_step_shows_the_same_whatever_was_shown_before() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1, 2, 1, 3, 2]);
        let split = LabelledSplit::open(folder.path(), "rect", Split::Train).unwrap();
        let config = config(2, 2);
        let plan = Plan::new(&config, &split);
        let numbers = |windows: &mut Windows, step| -> Vec<usize> {
            let position = Position { stage: 0, step };
            windows.step(position).unwrap().iter().map(Shown::number).collect()
        };
        let mut in_order = Windows::new(&plan, &split);
        let wanted: Vec<_> = (0..plan.n_steps[0]).map(|step| numbers(&mut in_order, step)).collect();
        let mut backwards = Windows::new(&plan, &split);
        for step in (0..plan.n_steps[0]).rev() {
            assert_eq!(numbers(&mut backwards, step), wanted[step]);
        }
    }

    #[test]
    fn with_a_share_of_one_only_samples_with_harmful_objects_are_shown() {
        let data = test_data::dataset(7);
        let is_harmful =
            |i: usize| data.samples()[i].objects.iter().any(|object| object.harm == Harm::Harmful);
        assert!((0..7).any(is_harmful), "the made data hold something harmful");
        let config = TrainConfig { harmful_share: 1.0, ..config(0, 2) };
        let epochs = shown(&config, (&data).into()).0;
        assert!(epochs[0].len() == 7 && epochs.concat().into_iter().all(is_harmful));
    }

    #[test]
    fn a_broken_episode_in_the_middle_names_itself() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1; 6]);
        let split = LabelledSplit::open(folder.path(), "rect", Split::Train).unwrap();
        let config = config(1, 1);
        let plan = Plan::new(&config, &split);
        let mut windows = Windows::new(&plan, &split);
        let third = plan.windows(Epoch { stage: 0, number: 0 }).parts[3][0];
        let path = folder.path().join(&split.episodes()[third].file);
        let whole = fs_err::read(&path).unwrap();
        fs_err::write(&path, &whole[..whole.len() / 2]).unwrap();
        let mut told = Vec::new();
        for step in 0..4 {
            told.push(windows.step(Position { stage: 0, step }).err().map(|error| error.to_string()));
        }
        assert_eq!(told[..3], [None, None, None]);
        assert!(told[3].as_ref().unwrap().contains(&path.display().to_string()), "{told:?}");
    }
}
