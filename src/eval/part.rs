//! Parts of the samples or of their objects that detectors are compared on: by air and light, beams, range, points and size.

use super::bootstrap::{Cell, Resamples};
use super::matching::{Matching, Outcome};
use super::metrics::Column;
use super::sample::Mode;
use crate::dataset::SampleFacts;
use crate::object::{Distribution, Harm, Object};

/// Air with a lower optical range is fog.
const FOG_MOR_M: f64 = 1000.0;
/// Clouds of up to so many rings are of few beams: those of the cheap LiDARs.
const FEW_RINGS: u32 = 16;
/// Where a car that drives in a town must see all that is low, and about what it needs to stop from 18 m/s.
const NEAR_M: f64 = 10.0;
const FAR_M: f64 = 30.0;
/// Fewer tell next to nothing of a shape.
const FEW_POINTS: u32 = 10;
/// What is nowhere longer is small: bags, cones, boxes.
const SMALL_M: f64 = 1.0;

/// What of the samples or of their objects is scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// A column of Table III; [`Column::Total`] is everything.
    Column(Column),
    Fog,
    Rain,
    Night,
    FewRings,
    ManyRings,
    Near,
    Middle,
    Far,
    FewPoints,
    Small,
}

impl Part {
    const OF_SAMPLES: [Self; 5] = [Self::Fog, Self::Rain, Self::Night, Self::FewRings, Self::ManyRings];
    const OF_OBJECTS: [Self; 5] = [Self::Near, Self::Middle, Self::Far, Self::FewPoints, Self::Small];

    pub fn all(mode: Mode) -> Vec<Self> {
        let columns = Column::ALL.into_iter().filter(|&of| mode == Mode::Ood || of == Column::Total);
        columns.map(Self::Column).chain(Self::OF_SAMPLES).chain(Self::OF_OBJECTS).collect()
    }

    pub fn name(self) -> String {
        match self {
            Self::Column(Column::Total) => "total".to_owned(),
            Self::Column(Column::IdMatched) => "in distribution, matched FPs".to_owned(),
            Self::Column(Column::OodAll) => "out of distribution, all FPs".to_owned(),
            Self::Column(Column::OodMatched) => "out of distribution, matched FPs".to_owned(),
            Self::Fog => "samples in fog".to_owned(),
            Self::Rain => "samples in rain".to_owned(),
            Self::Night => "samples at night".to_owned(),
            Self::FewRings => format!("samples of {FEW_RINGS} rings or fewer"),
            Self::ManyRings => format!("samples of more than {FEW_RINGS} rings"),
            Self::Near => format!("objects nearer than {NEAR_M} m"),
            Self::Middle => format!("objects from {NEAR_M} to {FAR_M} m"),
            Self::Far => format!("objects at {FAR_M} m or more"),
            Self::FewPoints => format!("objects of fewer than {FEW_POINTS} points"),
            Self::Small => format!("objects below {SMALL_M} m in all sizes"),
        }
    }

    fn has_sample(self, facts: &SampleFacts) -> bool {
        match self {
            Self::Fog => facts.mor_m.is_some_and(|mor_m| mor_m < FOG_MOR_M),
            Self::Rain => facts.rain_rate_mmph.is_some_and(|rate| rate > 0.0),
            Self::Night => facts.weather.as_deref().is_some_and(|name| name.ends_with("Night")),
            Self::FewRings => facts.n_lidar_rings.is_some_and(|n| n <= FEW_RINGS),
            Self::ManyRings => facts.n_lidar_rings.is_some_and(|n| n > FEW_RINGS),
            _ => true,
        }
    }

    fn has_object(self, object: &Object) -> bool {
        let (of, center) = (&object.box_in_ego, &object.box_in_ego.center);
        let range_m = center.x().hypot(center.y());
        match self {
            Self::Column(Column::IdMatched) => object.distribution == Some(Distribution::Id),
            Self::Column(Column::OodAll | Column::OodMatched) => {
                object.distribution == Some(Distribution::Ood)
            }
            Self::Near => range_m < NEAR_M,
            Self::Middle => (NEAR_M..FAR_M).contains(&range_m),
            Self::Far => range_m >= FAR_M,
            Self::FewPoints => object.n_lidar_points.is_some_and(|n| n < FEW_POINTS),
            Self::Small => of.length_m.max(of.width_m).max(of.height_m) < SMALL_M,
            Self::Column(Column::Total)
            | Self::Fog
            | Self::Rain
            | Self::Night
            | Self::FewRings
            | Self::ManyRings => true,
        }
    }

    /// Whether detections on nothing are false positives here.
    fn has_unmatched(self) -> bool {
        matches!(self, Self::Column(Column::Total | Column::OodAll)) || Self::OF_SAMPLES.contains(&self)
    }

    /// What counts of a class in this part.
    pub fn cell(self, matching: &Matching<'_>, class: Harm, resamples: &Resamples) -> Cell {
        let has = |number: usize| {
            let of = &matching.objects[number];
            self.has_sample(matching.facts_of(of)) && self.has_object(&of.object.truth)
        };
        let judge = |sample_idx: usize, outcome: Outcome| match outcome {
            Outcome::Matched(of) => has(of as usize).then_some(true),
            Outcome::Misclassified(of) => has(of as usize).then_some(false),
            Outcome::Unmatched => {
                let counts = self.has_unmatched() && self.has_sample(matching.samples[sample_idx].facts);
                counts.then_some(false)
            }
            Outcome::Neutral(_) => None,
        };
        Cell::new(matching, class, &resamples.episode_of, resamples.n_episodes, has, judge)
    }
}
