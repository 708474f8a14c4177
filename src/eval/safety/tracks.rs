//! One object through the samples of an episode.

use std::collections::BTreeMap;

use crate::eval::filter::KeptSample;
use crate::object::Harm;

/// An object at one sample.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// Index of the sample among all.
    pub sample_idx: usize,
    /// Place of the sample in its episode, by time.
    pub place: usize,
    /// Number of the object among those of all samples.
    pub number: usize,
    pub harm: Harm,
}

/// An object at a sample at which the filters drop it.
#[derive(Debug, Clone, Copy)]
pub struct Unseen {
    pub sample_idx: usize,
    pub place: usize,
    /// Its index among the sample's objects that the LiDAR did not hit; `None` if it is out of the range.
    pub unhit_idx: Option<usize>,
    harm: Harm,
}

/// An object by time; where it was filtered out or not annotated, places are missing among the sights.
#[derive(Debug, Clone, Default)]
pub struct Track {
    pub sights: Vec<Sight>,
    /// Where the filters drop it, by time.
    unseen: Vec<Unseen>,
}

/// A stretch of time in which an object is harmful.
#[derive(Debug)]
pub struct HarmRun<'a> {
    /// At least one; where places are missing among them, it is harmful all the same, or nobody says that it is not.
    pub sights: &'a [Sight],
    /// Where the filters drop it, between the first sight and the last.
    pub unseen: Vec<Unseen>,
}

/// An object that is harmful before and after it was out of the truth for so long is still the same event, seconds: what
/// passes before it hides it.
const BRIDGED_S: f64 = 1.0;

/// All objects whose ids are known.
#[derive(Debug)]
pub struct Tracks {
    pub objects: Vec<Track>,
    /// Time of each sample, seconds.
    pub times_s: Vec<f64>,
    /// Samples of each episode, by time.
    pub episodes: Vec<Vec<usize>>,
    /// Track and place in it of each object, by number.
    of_object: Vec<Option<(usize, usize)>>,
}

impl Tracks {
    /// Follows the objects. `None` unless every sample has an episode and a time, and some truth has an id.
    pub fn of_samples(samples: &[KeptSample<'_>]) -> Option<Self> {
        let times_s = samples.iter().map(|sample| sample.facts.time_s).collect::<Option<Vec<f64>>>()?;
        let episodes = episodes(samples)?;
        let mut first_object = Vec::with_capacity(samples.len());
        let mut n_objects = 0;
        for sample in samples {
            first_object.push(n_objects);
            n_objects += sample.objects.len();
        }
        let mut tracks: Vec<Track> = Vec::new();
        let mut of_object = vec![None; n_objects];
        for episode in &episodes {
            let mut known: BTreeMap<&str, usize> = BTreeMap::new();
            for (place, &sample_idx) in episode.iter().enumerate() {
                let sample = &samples[sample_idx];
                for (i, object) in sample.objects.iter().enumerate() {
                    let Some(id) = &object.truth.id else { continue };
                    let track = *known.entry(id).or_insert_with(|| {
                        tracks.push(Track::default());
                        tracks.len() - 1
                    });
                    let number = first_object[sample_idx] + i;
                    of_object[number] = Some((track, tracks[track].sights.len()));
                    tracks[track].sights.push(Sight { sample_idx, place, number, harm: object.harm });
                }
                // Of use only between sights: a track begins with one.
                let unhit = sample.unhit.iter().enumerate().map(|(i, object)| (Some(i), object));
                for (unhit_idx, object) in unhit.chain(sample.far.iter().map(|object| (None, object))) {
                    if let Some(&track) = object.truth.id.as_deref().and_then(|id| known.get(id)) {
                        tracks[track].unseen.push(Unseen { sample_idx, place, unhit_idx, harm: object.harm });
                    }
                }
            }
        }
        (!tracks.is_empty()).then_some(Self { objects: tracks, times_s, episodes, of_object })
    }

    /// The sight of a numbered object and those after it.
    pub fn sights_from(&self, number: usize) -> Option<&[Sight]> {
        let (track, at) = self.of_object[number]?;
        Some(&self.objects[track].sights[at..])
    }

    /// Events: the longest runs of samples in which an object is harmful. A sample at which the filters drop it is no end,
    /// if it is harmful there; nor is one at which it is not annotated, for [`BRIDGED_S`].
    pub fn events(&self) -> Vec<HarmRun<'_>> {
        self.objects.iter().flat_map(|track| self.events_of(track)).collect()
    }

    fn events_of<'a>(&'a self, track: &'a Track) -> impl Iterator<Item = HarmRun<'a>> {
        let between =
            |a: usize, b: usize| track.unseen.iter().filter(move |of| (a + 1..b).contains(&of.place));
        let is_same_run = move |a: &Sight, b: &Sight| {
            let n_unseen = between(a.place, b.place).count();
            let is_annotated = a.place + 1 + n_unseen == b.place;
            let absent_s = self.times_s[b.sample_idx] - self.times_s[a.sample_idx];
            a.harm == b.harm
                && between(a.place, b.place).all(|of| of.harm == a.harm)
                && (is_annotated || absent_s <= BRIDGED_S + 1e-6)
        };
        let runs = track.sights.chunk_by(is_same_run).filter(|run| run[0].harm == Harm::Harmful);
        runs.map(move |sights| HarmRun {
            sights,
            unseen: between(sights[0].place, sights[sights.len() - 1].place).copied().collect(),
        })
    }
}

/// The samples of each episode by time, in the order of the episodes' first samples; `None` if the episode of
/// a sample is unknown.
pub fn episodes(samples: &[KeptSample<'_>]) -> Option<Vec<Vec<usize>>> {
    let mut numbers: BTreeMap<&str, usize> = BTreeMap::new();
    let mut episodes: Vec<Vec<usize>> = Vec::new();
    for (sample_idx, sample) in samples.iter().enumerate() {
        let name = sample.facts.episode.as_deref()?;
        let number = *numbers.entry(name).or_insert_with(|| {
            episodes.push(Vec::new());
            episodes.len() - 1
        });
        episodes[number].push(sample_idx);
    }
    for episode in &mut episodes {
        // Stable: without times the samples keep their order.
        let time_s = |&i: &usize| samples[i].facts.time_s.unwrap_or(0.0);
        episode.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)));
    }
    Some(episodes)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::eval::matching::Matching;
    use crate::eval::matching::tests::truth;
    use crate::eval::{EvalSample, Mode, Protocol};
    use crate::object::Distribution;

    /// An episode at 2 Hz and 10 m/s with one object, 20 m ahead at first; `h` harmful, `n` harmless, `.` not there.
    pub fn episode(name: &str, harms: &str) -> Vec<EvalSample> {
        harms
            .chars()
            .enumerate()
            .map(|(i, harm)| {
                let harm = match harm {
                    'h' => Some(Harm::Harmful),
                    'n' => Some(Harm::Harmless),
                    _ => None,
                };
                let mut object = harm.map(|harm| truth(20.0 - 5.0 * i as f64, harm, Distribution::Id));
                object.iter_mut().for_each(|object| object.truth.id = Some("one".into()));
                EvalSample {
                    id: format!("{name}/{i}"),
                    facts: SampleFacts {
                        episode: Some(name.into()),
                        time_s: Some(0.5 * i as f64),
                        speed_mps: Some(10.0),
                        front_bumper_x_m: Some(3.0),
                        position_in_world_m: Some([5.0 * i as f64, 0.0]),
                        ..SampleFacts::default()
                    },
                    objects: object.into_iter().collect(),
                    detections: vec![],
                    n_points: vec![],
                }
            })
            .collect()
    }

    /// Samples of each event, from the first to the last.
    fn lengths(tracks: &Tracks) -> Vec<usize> {
        let length =
            |event: &HarmRun<'_>| event.sights[event.sights.len() - 1].place - event.sights[0].place + 1;
        tracks.events().iter().map(length).collect()
    }

    fn tracks_of(samples: &[EvalSample]) -> Option<Tracks> {
        let protocol = Protocol::default();
        Tracks::of_samples(&Matching::new(samples, &protocol, Mode::Id).unwrap().samples)
    }

    #[test]
    fn a_sample_at_which_the_filters_drop_a_harmful_object_ends_no_event() {
        // Dropped at the third, fourth and fifth sample, for longer than an object may be out of the truth.
        let mut samples = episode("a", "hhhhhhh");
        (2..5).for_each(|i| samples[i].objects[0].truth.n_lidar_points = Some(0));
        let tracks = tracks_of(&samples).unwrap();
        assert_eq!(lengths(&tracks), [7]);
        let places: Vec<_> = tracks.events()[0].unseen.iter().map(|of| (of.place, of.unhit_idx)).collect();
        assert_eq!(places, [(2, Some(0)), (3, Some(0)), (4, Some(0))]);
        // Harmless there: two events.
        samples[3].objects[0].harm = Harm::Harmless;
        assert_eq!(lengths(&tracks_of(&samples).unwrap()), [2, 2]);
        // Not annotated there: too long for one event.
        samples[3].objects.clear();
        assert_eq!(lengths(&tracks_of(&samples).unwrap()), [2, 2]);
    }

    #[test]
    fn events_are_runs_of_samples_and_long_gaps_harmless_samples_and_episodes_part_them() {
        // At 2 Hz one missing sample is bridged, two are not.
        let mut samples = episode("a", "nhh.h..hnh");
        samples.extend(episode("b", "hh"));
        // The file is not in the order of time.
        samples.swap(1, 2);
        let tracks = tracks_of(&samples).unwrap();
        assert_eq!(lengths(&tracks), [4, 1, 1, 2]);
        assert_eq!(tracks.objects.len(), 2);
        assert_eq!(tracks.sights_from(0).unwrap().len(), 7);
        samples[0].facts.time_s = None;
        assert!(tracks_of(&samples).is_none());
    }
}
