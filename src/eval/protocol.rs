//! The protocol's numbers: thresholds, clipping and filters, checked once.
//!
//! Defaults are nuScenes' `detection_cvpr_2019`, with 50 m for both classes.

use serde::{Deserialize, Serialize};

use crate::config::{Check, InvalidConfig, Rule, above, below, define_config, from_to, part, require};

define_config! {
    /// How detections are scored; `configs/eval.toml` equals the default.
    pub struct EvalConfig {
        /// Centre distances on the ground below which a detection matches, metres, ascending.
        /// Default 0.5, 1, 2, 4.
        dist_thresholds_m: Vec<f64> = vec![0.5, 1.0, 2.0, 4.0], in above(0.0, 1000.0).rising(1, 100);
        /// The one of these distances at which ATE, ASE and AOE are measured, metres. Default 2.
        tp_threshold_m: f64 = 2.0, in above(0.0, 1000.0);
        /// AP and errors use only recall above this, 0 to below 1. Default 0.1.
        min_recall: f64 = 0.1, in below(0.0, 1.0);
        /// AP counts only precision above this, 0 to below 1. Default 0.1.
        min_precision: f64 = 0.1, in below(0.0, 1.0);
        /// Truths and detections at this distance or more from the ego's origin are dropped, metres on the
        /// ground; `inf` keeps all. Default 50.
        max_range_m: f64 = 50.0, in above(0.0, f64::INFINITY);
        /// Whether truths that no LiDAR point hit are dropped; those with an unknown count are kept.
        /// Default true.
        drop_truths_without_points: bool = true;
        /// Most detections that a sample may have; more is an error, as in nuScenes. Default 500.
        max_boxes: usize = 500, in from_to(1.0, 1e6);
        /// What becomes of a class without a truth: `absent` from every mean, or AP `zero` as in nuScenes. Default
        /// absent.
        missing_class: MissingClass = MissingClass::Absent;
        /// Lowest score of a detection that counts where found, missed and false ones are counted. Default:
        /// the network's own (`harmzone calibrate`), else 0.2.
        operating_score: f64 = 0.2, in from_to(-1e6, 1e6);
        /// Resamples of the episodes for confidence intervals; 0 for none. Default 1000.
        n_resamples: usize = 1000, in from_to(0.0, 100_000.0);
        /// Seed of the resamples. Default 0.
        bootstrap_seed: u64 = 0, in Rule::Any;
        /// Edges of the bands of the breakdowns.
        breakdown: BreakdownConfig = BreakdownConfig::default(), in part::<BreakdownConfig>();
        /// Numbers of the safety metrics.
        safety: SafetyConfig = SafetyConfig::default(), in part::<SafetyConfig>();
    }
}

/// What becomes of a class without a truth, in the whole or in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MissingClass {
    /// It has no AP and no errors, and no part in a mean: there was nothing to find.
    Absent,
    /// Its AP is 0 and its errors are 1, and both count in the means, as in nuscenes-devkit.
    Zero,
}

impl Check for EvalConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let (threshold, all) = (self.tp_threshold_m, &self.dist_thresholds_m);
        let wanted = format!("one of dist_thresholds_m, {all:?}, is needed");
        require(all.contains(&threshold), "tp_threshold_m", threshold, wanted)?;
        let (recall, wanted) = (self.min_recall, "a number from 0 to 0.99 is needed");
        require(first_step(recall) <= 100, "min_recall", recall, wanted)?;
        self.safety.check_relations().map_err(|error| error.within("safety"))
    }
}

define_config! {
    /// Edges of the bands; a band begins at its edge and ends before the next.
    pub struct BreakdownConfig {
        /// From the ego's origin to the box's centre on the ground, metres. Default 10, 20, 30, 40.
        range_m: Vec<f64> = vec![10.0, 20.0, 30.0, 40.0], in EDGES;
        /// Visible pixels over those of the whole silhouette, 0 to 1. Default 0.1, 0.25, 0.5, 0.75, 0.9.
        visible_fraction: Vec<f64> = vec![0.1, 0.25, 0.5, 0.75, 0.9], in EDGES;
        /// LiDAR points on the object. Default 3, 6, 11, 21, 51, 101.
        n_lidar_points: Vec<f64> = vec![3.0, 6.0, 11.0, 21.0, 51.0, 101.0], in EDGES;
        /// Beams of the LiDAR that are alive, by the episode's rig, else its rings with a point: up to 16, 32, 64 and more.
        /// Default 17, 33, 65.
        n_lidar_rings: Vec<f64> = vec![17.0, 33.0, 65.0], in EDGES;
        /// The ego's speed, m/s. Default 0.5, 3, 6, 9, 12.
        speed_mps: Vec<f64> = vec![0.5, 3.0, 6.0, 9.0, 12.0], in EDGES;
        /// The steering angle without its sign, degrees. Default 1, 3, 6, 10, 20.
        steering_deg: Vec<f64> = vec![1.0, 3.0, 6.0, 10.0, 20.0], in EDGES;
        /// Signed distance of the footprint to the zone's edge, metres, negative inside.
        /// Default -1, -0.5, -0.25, 0, 0.25, 0.5, 1, 2, 4.
        zone_distance_m: Vec<f64> = vec![-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0], in EDGES;
    }
}

/// Bounds of the bands' edges.
const EDGES: Rule = from_to(-1e6, 1e6).rising(0, 1000);

define_config! {
    /// Numbers of the safety metrics.
    pub struct SafetyConfig {
        /// False alarms per kilometre at which missed harm is reported. Default 1, 10, 100.
        false_alarms_per_km: Vec<f64> = vec![1.0, 10.0, 100.0], in above(0.0, 1e6).list(0, 100);
        /// A warning is confirmed when a harmful object was found harmful in this many .. Default 2.
        confirm_n: usize = 2, in from_to(1.0, 1000.0);
        /// .. of this many samples in a row. Default 3.
        confirm_of: usize = 3, in from_to(1.0, 1000.0);
        /// Time from a warning to the brakes' full force, seconds. Default 1.
        reaction_time_s: f64 = 1.0, in from_to(0.0, 1000.0);
        /// Decelerations for which stopping distances are computed, m/s^2. Default 4, 8.
        decelerations_mps2: Vec<f64> = vec![4.0, 8.0], in above(0.0, 1000.0).list(0, 100);
        /// Number of equally wide bins in the reliability diagrams. Default 10.
        n_bins: usize = 10, in from_to(1.0, 10_000.0);
    }
}

impl Check for SafetyConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let wanted = format!("a count of at most confirm_of, {}, is needed", self.confirm_of);
        require(self.confirm_n <= self.confirm_of, "confirm_n", self.confirm_n, wanted)
    }
}

impl SafetyConfig {
    /// Distance driven while reacting and then braking; nothing where the ego rolls backwards.
    pub(super) fn stopping_distance_m(&self, speed_mps: f64, deceleration_mps2: f64) -> f64 {
        let speed_mps = speed_mps.max(0.0);
        speed_mps * self.reaction_time_s + speed_mps * speed_mps / (2.0 * deceleration_mps2)
    }
}

/// A checked [`EvalConfig`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Protocol {
    config: EvalConfig,
}

impl Protocol {
    /// The config that was checked.
    #[must_use]
    pub fn config(&self) -> &EvalConfig {
        &self.config
    }

    /// Index of the threshold at which errors are measured.
    #[must_use]
    pub(super) fn tp_threshold_idx(&self) -> usize {
        let thresholds = &self.config.dist_thresholds_m;
        let at = thresholds.iter().position(|&threshold| threshold == self.config.tp_threshold_m);
        at.expect("the TP threshold was checked to be one of the list")
    }

    /// First of the 101 recall steps that count: the one after `min_recall`.
    #[must_use]
    pub(super) fn first_step(&self) -> usize {
        first_step(self.config.min_recall)
    }
}

impl TryFrom<EvalConfig> for Protocol {
    type Error = InvalidConfig;

    fn try_from(config: EvalConfig) -> Result<Self, InvalidConfig> {
        config.check()?;
        Ok(Self { config })
    }
}

/// The devkit's `round(100 * min_recall) + 1`; Python rounds halves to even.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 101 by the check above
fn first_step(min_recall: f64) -> usize {
    (100.0 * min_recall).round_ties_even() as usize + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_config_is_the_default() {
        let shipped: EvalConfig = toml::from_str(include_str!("../../configs/eval.toml")).unwrap();
        assert_eq!(shipped, EvalConfig::default());
        crate::config::assert_every_number_is_checked(&shipped);
        let checked = Protocol::try_from(shipped).unwrap();
        assert_eq!((checked.first_step(), checked), (11, Protocol::default()));
    }

    #[test]
    fn an_invalid_config_is_refused() {
        let base = EvalConfig::default;
        let refused = [
            EvalConfig { dist_thresholds_m: vec![], ..base() },
            EvalConfig { dist_thresholds_m: vec![2.0, 1.0], ..base() },
            EvalConfig { dist_thresholds_m: vec![0.0, 2.0], ..base() },
            EvalConfig { tp_threshold_m: 3.0, ..base() },
            EvalConfig { min_recall: 0.999, ..base() },
            EvalConfig { min_recall: f64::NAN, ..base() },
            EvalConfig { min_precision: 1.0, ..base() },
            EvalConfig { max_range_m: f64::NAN, ..base() },
            EvalConfig { max_boxes: 0, ..base() },
            EvalConfig { operating_score: f64::NAN, ..base() },
            EvalConfig { safety: SafetyConfig { confirm_n: 4, ..SafetyConfig::default() }, ..base() },
            EvalConfig { safety: SafetyConfig { n_bins: 0, ..SafetyConfig::default() }, ..base() },
            EvalConfig {
                breakdown: BreakdownConfig { speed_mps: vec![3.0, 3.0], ..BreakdownConfig::default() },
                ..base()
            },
        ];
        for config in refused {
            assert!(Protocol::try_from(config.clone()).is_err(), "{config:?}");
        }
    }
}
