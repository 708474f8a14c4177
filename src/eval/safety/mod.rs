//! What a score means for a car: harm missed at a bearable number of false alarms, warnings in time, steady labels,
//! honest probabilities, and where the harmful score fails. `docs/evaluation.md` has every formula with its source.
//!
//! Each figure is `None`, or has a count of zero, where the facts that it needs are not known. A metric is a file here with
//! its `measure` and one `show` a table, and a line in [`Safety`].

#![allow(clippy::ref_option, clippy::ptr_arg, reason = "a metric is shown as the registry holds it")]

mod alarm_facts;
mod alarms;
mod calibration;
mod early;
pub(super) mod harm_probability;
mod missed_groups;
mod near;
mod separation;
mod slope;
mod spreads;
mod steadiness;
mod table;
mod tracks;
mod zone_edge;

use serde::{Deserialize, Serialize};

pub use alarms::{Alarms, OperatingPoint, Warned};
pub(super) use alarms::{EventShares, event_shares};
pub use calibration::{Bin, Calibration};
pub use early::{Early, EarlyShare};
pub use missed_groups::{MissedGroup, MissedShare};
pub use near::{NearFound, NearGroup};
pub use separation::Separation;
pub use slope::{Slope, SlopePoint};
pub use spreads::SpreadCheck;
pub use steadiness::Steadiness;
pub use table::{MetricTable, MetricValue};
pub use zone_edge::EdgeBand;

use super::PerClass;
use super::matching::Matching;
use super::protocol::EvalConfig;
use crate::object::{Distribution, Harm};
use tracks::Tracks;
#[cfg(test)]
pub(super) use tracks::tests::episode;

/// What metrics are measured on.
struct Context<'a> {
    matching: &'a Matching<'a>,
    /// `None` where objects cannot be followed.
    tracks: Option<Tracks>,
    /// For each object, by number; `None` where no detection is known to lie on it.
    harm_probability: Vec<Option<f64>>,
}

impl Context<'_> {
    /// Probability of harm and harm of the objects that a detection lies on, those of one distribution if it is named.
    fn probabilities(&self, distribution: Option<Distribution>) -> Vec<(f64, bool)> {
        let objects = self.matching.objects.iter().map(|of| of.object);
        let located = objects.zip(&self.harm_probability);
        located
            .filter(|(object, _)| distribution.is_none() || object.truth.distribution == distribution)
            .filter_map(|(object, probability)| Some(((*probability)?, object.harm == Harm::Harmful)))
            .collect()
    }
}

/// A value for all objects, and for those in and out of distribution.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ByDistribution<T> {
    pub all: T,
    pub id: T,
    pub ood: T,
}

impl<T> ByDistribution<T> {
    fn from_fn(mut value: impl FnMut(Option<Distribution>) -> T) -> Self {
        Self { all: value(None), id: value(Some(Distribution::Id)), ood: value(Some(Distribution::Ood)) }
    }
}

impl<T> ByDistribution<T> {
    /// Each value with the name of its rows.
    pub(super) fn named(&self) -> [(&'static str, &T); 3] {
        [("all objects", &self.all), ("ID objects", &self.id), ("OOD objects", &self.ood)]
    }
}

/// Declares the metrics: name, type, what measures it, what shows it as tables.
macro_rules! metrics {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $measure:path, $($show:path),+;)*) => {
        /// All safety metrics.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        pub struct Safety { $($(#[$doc])* pub $name: $type,)* }

        /// Measures what the facts allow.
        pub(super) fn measure(matching: &Matching<'_>) -> Safety {
            let context = Context {
                matching,
                tracks: Tracks::of_samples(&matching.samples),
                harm_probability: harm_probability::measure(matching),
            };
            Safety { $($name: $measure(&context),)* }
        }

        impl Safety {
            /// A table for each metric that is known.
            #[must_use]
            pub fn tables(&self, config: &EvalConfig) -> Vec<MetricTable> {
                [$($($show(&self.$name, config)),+),*].into_iter().flatten().collect()
            }
        }
    };
}

metrics! {
    /// Missed harm at fixed false alarms; needs where the ego was.
    alarms: Option<Alarms> = alarms::measure, alarms::show, alarms::show_groups;
    /// Near objects that are found, by either class, at fixed false boxes a sample; needs points.
    #[serde(default)]
    near: Vec<NearFound> = near::measure, near::show;
    /// How often labels of tracked objects jump; needs ids and times.
    steadiness: Option<Steadiness> = steadiness::measure, steadiness::show;
    /// False-harmful boxes whose object turns harmful soon; needs ids and times.
    early: Option<Early> = early::measure, early::show;
    /// Score of a class's detections as the probability of being right; `None` if a score is not from 0 to 1.
    detection_calibration: Option<PerClass<Calibration>> = calibration::measure_detections, calibration::show_detections;
    /// Probability of harm of the located objects.
    harm_calibration: ByDistribution<Calibration> = calibration::measure_harm, calibration::show_harm;
    /// Spreads of boxes beside their errors; empty where none are told.
    #[serde(default)]
    spreads: Vec<SpreadCheck> = spreads::measure, spreads::show;
    /// Harmful against harmless by that probability.
    separation: ByDistribution<Option<Separation>> = separation::measure, separation::show;
    /// That probability over the signed distance to the zone's edge; empty where the zone is not known.
    zone_edge: Vec<EdgeBand> = zone_edge::measure, zone_edge::show;
    /// Recall at the operating score over fog, per 1/m of extinction, ln 20 / MOR.
    fog_slope: PerClass<Option<Slope>> = slope::measure_fog, slope::show_fog;
    /// Recall at the operating score over rain, per mm/h.
    rain_slope: PerClass<Option<Slope>> = slope::measure_rain, slope::show_rain;
}
