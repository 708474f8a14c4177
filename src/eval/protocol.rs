//! The protocol's numbers: thresholds, clipping and filters, checked once.
//!
//! Defaults are nuScenes' `detection_cvpr_2019`, with 50 m for both classes.

use super::breakdown::BreakdownConfig;
use super::safety::SafetyConfig;
use crate::config::{Check, InvalidConfig, Rule, above, below, define_config, from_to, part, require};

define_config! {
    /// How detections are scored; `configs/eval.toml` equals the default.
    pub struct EvalConfig {
        /// Centre distances on the ground below which a detection matches, metres, ascending.
        /// Default 0.5, 1, 2, 4.
        dist_thresholds_m: Vec<f64> = vec![0.5, 1.0, 2.0, 4.0], in above(0.0, 1000.0).rising(1, 100);
        /// The one of them at which ATE, ASE and AOE are measured, metres. Default 2.
        tp_threshold_m: f64 = 2.0, in above(0.0, 1000.0);
        /// AP and errors look only at recall above this, 0 to below 1. Default 0.1.
        min_recall: f64 = 0.1, in below(0.0, 1.0);
        /// AP counts only precision above this, 0 to below 1. Default 0.1.
        min_precision: f64 = 0.1, in below(0.0, 1.0);
        /// Truths and detections at this distance or more from the ego's origin are dropped, metres on the
        /// ground; `inf` keeps all. Default 50.
        max_range_m: f64 = 50.0, in above(0.0, f64::INFINITY);
        /// Whether truths that no LiDAR point hit are dropped; those with an unknown count are kept.
        /// Default true.
        drop_truths_without_points: bool = true;
        /// Most detections a sample may have; more is an error, as in nuScenes. Default 500.
        max_boxes: usize = 500, in from_to(1.0, 1e6);
        /// Score from which a detection counts where found, missed and false ones are told apart. Default 0.2.
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
