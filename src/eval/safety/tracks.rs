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

/// An object by time; where it was filtered out or not annotated, places are missing.
#[derive(Debug, Clone)]
pub struct Track {
    pub sights: Vec<Sight>,
}

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
                for (i, object) in samples[sample_idx].objects.iter().enumerate() {
                    let Some(id) = &object.truth.id else { continue };
                    let track = *known.entry(id).or_insert_with(|| {
                        tracks.push(Track { sights: Vec::new() });
                        tracks.len() - 1
                    });
                    let number = first_object[sample_idx] + i;
                    of_object[number] = Some((track, tracks[track].sights.len()));
                    tracks[track].sights.push(Sight { sample_idx, place, number, harm: object.harm });
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

    /// Events: the longest runs of samples in a row in which an object is harmful.
    pub fn events(&self) -> Vec<&[Sight]> {
        let is_same_run = |a: &Sight, b: &Sight| a.harm == b.harm && b.place == a.place + 1;
        let runs = self.objects.iter().flat_map(|track| track.sights.chunk_by(is_same_run));
        runs.filter(|run| run[0].harm == Harm::Harmful).collect()
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

    #[test]
    fn events_are_runs_in_a_row_and_gaps_and_episodes_part_them() {
        let mut samples = episode("a", "nhh.hn");
        samples.extend(episode("b", "hh"));
        // The file is not in the order of time.
        samples.swap(1, 2);
        let protocol = Protocol::default();
        let tracks_of = |samples: &[EvalSample]| {
            Tracks::of_samples(&Matching::new(samples, &protocol, Mode::Id).unwrap().samples)
        };
        let tracks = tracks_of(&samples).unwrap();
        let lengths: Vec<usize> = tracks.events().iter().map(|event| event.len()).collect();
        assert_eq!(lengths, [2, 1, 2]);
        assert_eq!(tracks.objects.len(), 2);
        assert_eq!(tracks.sights_from(0).unwrap().len(), 5);
        samples[0].facts.time_s = None;
        assert!(tracks_of(&samples).is_none());
    }
}
