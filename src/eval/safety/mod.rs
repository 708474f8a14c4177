//! What a score means for a car: harm missed at a bearable number of false alarms, warnings in time, steady labels,
//! honest probabilities, and where the harmful score fails. `docs/evaluation.md` has every formula with its source.
//!
//! Each figure is `None`, or has a count of zero, where the facts that it needs are not known.

mod alarms;
mod calibration;
mod early;
pub(super) mod located;
mod separation;
mod slope;
mod steadiness;
mod tracks;
mod zone_edge;

use serde::{Deserialize, Serialize};

pub use alarms::{Alarms, OperatingPoint, Warned};
pub use calibration::{Bin, Calibration};
pub use early::{Early, EarlyShare};
pub use separation::Separation;
pub use slope::{Slope, SlopePoint};
pub use steadiness::Steadiness;
pub use zone_edge::EdgeBand;

use super::metrics::Matching;
use super::protocol::Protocol;
use super::{EvalSample, PerClass};
use crate::config::{Check, InvalidConfig, above, define_config, from_to, require};
use crate::object::{Distribution, Harm};
use located::Located;
use tracks::Tracks;

define_config! {
    /// Numbers of the safety metrics.
    pub struct SafetyConfig {
        /// False alarms a kilometre at which missed harm is told. Default 10, 30, 100.
        false_alarms_per_km: Vec<f64> = vec![10.0, 30.0, 100.0], in above(0.0, 1e6).list(0, 100);
        /// A warning is confirmed when a harmful object was found harmful in this many .. Default 2.
        confirm_n: usize = 2, in from_to(1.0, 1000.0);
        /// .. of this many samples in a row. Default 3.
        confirm_of: usize = 3, in from_to(1.0, 1000.0);
        /// Time from a warning to the brakes' full force, seconds. Default 1.
        reaction_time_s: f64 = 1.0, in from_to(0.0, 1000.0);
        /// Decelerations by which a stopping distance is taken, m/s^2. Default 4, 8.
        decelerations_mps2: Vec<f64> = vec![4.0, 8.0], in above(0.0, 1000.0).list(0, 100);
        /// Bins of equal width of the reliability diagrams. Default 10.
        n_bins: usize = 10, in from_to(1.0, 10_000.0);
    }
}

impl Check for SafetyConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let wanted = format!("a count of at most confirm_of, {}, is needed", self.confirm_of);
        require(self.confirm_n <= self.confirm_of, "confirm_n", self.confirm_n, wanted)
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

/// All safety metrics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Safety {
    /// Missed harm at fixed false alarms; needs where the ego was.
    pub alarms: Option<Alarms>,
    /// How often labels of tracked objects jump; needs ids and times.
    pub steadiness: Option<Steadiness>,
    /// False-harmful boxes whose object turns harmful soon; needs ids and times.
    pub early: Option<Early>,
    /// Score of a class's detections as the probability of being right; `None` if a score is not from 0 to 1.
    pub detection_calibration: Option<PerClass<Calibration>>,
    /// Harmful share of the located objects' scores as the probability of harm.
    pub harm_calibration: ByDistribution<Calibration>,
    /// Harmful against harmless by that share.
    pub separation: ByDistribution<Option<Separation>>,
    /// That share over the signed distance to the zone's edge; empty where the zone is not known.
    pub zone_edge: Vec<EdgeBand>,
    /// Recall at the operating score over fog: a 1/m of extinction, ln 20 / MOR.
    pub fog_slope: PerClass<Option<Slope>>,
    /// Recall at the operating score over rain: a mm/h.
    pub rain_slope: PerClass<Option<Slope>>,
}

/// Measures what the facts allow.
pub(super) fn measure(kept: &[EvalSample], matching: &Matching<'_>, protocol: &Protocol) -> Safety {
    let config = protocol.config();
    let located = Located::of_samples(kept, config.tp_threshold_m);
    let tracks = Tracks::of_samples(kept);
    let of = |distribution: Option<Distribution>| -> Vec<(f64, bool)> {
        let fits = |found: &&Located<'_>| distribution.is_none_or(|d| found.truth.distribution == Some(d));
        let chosen = located.iter().filter(fits);
        chosen
            .filter_map(|found| Some((found.harm_probability()?, found.truth.harm == Harm::Harmful)))
            .collect()
    };
    let recall_over = |value: fn(&super::SampleFacts) -> Option<f64>| {
        PerClass::from_fn(|class| slope::of_recall(kept, matching.get(class), class, protocol, value))
    };
    Safety {
        alarms: alarms::measure(kept, &matching.harmful, tracks.as_ref(), protocol),
        steadiness: tracks.as_ref().map(|tracks| steadiness::measure(tracks, &located)),
        early: tracks.as_ref().map(|tracks| early::measure(tracks, &matching.harmful, protocol)),
        detection_calibration: calibration::of_detections(matching, protocol),
        harm_calibration: ByDistribution::from_fn(|d| Calibration::new(&of(d), config.safety.n_bins)),
        separation: ByDistribution::from_fn(|d| Separation::new(&of(d))),
        zone_edge: zone_edge::measure(kept, &located, &config.breakdown.zone_distance_m),
        fog_slope: recall_over(|facts| Some(20f64.ln() / facts.mor_m.filter(|&mor_m| mor_m > 0.0)?)),
        rain_slope: recall_over(|facts| facts.rain_rate_mmph),
    }
}
