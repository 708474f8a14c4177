//! The protocol's numbers: thresholds, clipping and filters, checked once.
//!
//! Defaults are nuScenes' `detection_cvpr_2019`, with 50 m for both classes.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::breakdown::BreakdownConfig;
use super::safety::SafetyConfig;

/// How detections are scored; `configs/eval.toml` equals the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvalConfig {
    /// Centre distances on the ground below which a detection matches, metres, ascending.
    /// Default 0.5, 1, 2, 4.
    pub dist_thresholds_m: Vec<f64>,
    /// The one of them at which ATE, ASE and AOE are measured, metres. Default 2.
    pub tp_threshold_m: f64,
    /// AP and errors look only at recall above this, 0 to below 1. Default 0.1.
    pub min_recall: f64,
    /// AP counts only precision above this, 0 to below 1. Default 0.1.
    pub min_precision: f64,
    /// Truths and detections at this distance or more from the ego's origin are dropped, metres on the
    /// ground. Default 50.
    pub max_range_m: f64,
    /// Whether truths that no LiDAR point hit are dropped; those with an unknown count are kept.
    /// Default true.
    pub drop_truths_without_points: bool,
    /// Most detections a sample may have; more is an error, as in nuScenes. Default 500.
    pub max_boxes: usize,
    /// Score from which a detection counts where found, missed and false ones are told apart. Default 0.2.
    pub operating_score: f64,
    /// Resamples of the episodes for confidence intervals; 0 for none. Default 1000.
    pub n_resamples: usize,
    /// Seed of the resamples. Default 0.
    pub bootstrap_seed: u64,
    /// Edges of the bands of the breakdowns.
    pub breakdown: BreakdownConfig,
    /// Numbers of the safety metrics.
    pub safety: SafetyConfig,
}

impl Default for EvalConfig {
    fn default() -> Self {
        Self {
            dist_thresholds_m: vec![0.5, 1.0, 2.0, 4.0],
            tp_threshold_m: 2.0,
            min_recall: 0.1,
            min_precision: 0.1,
            max_range_m: 50.0,
            drop_truths_without_points: true,
            max_boxes: 500,
            operating_score: 0.2,
            n_resamples: 1000,
            bootstrap_seed: 0,
            breakdown: BreakdownConfig::default(),
            safety: SafetyConfig::default(),
        }
    }
}

/// What is wrong with an [`EvalConfig`].
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ProtocolError {
    #[error(
        "dist_thresholds_m is {found:?}; at least one, each above zero and above the one before, is needed"
    )]
    Thresholds { found: Vec<f64> },
    #[error("tp_threshold_m is {found}; it must be one of dist_thresholds_m, {valid:?}")]
    TpThreshold { found: f64, valid: Vec<f64> },
    #[error("{field} is {found}; {valid} is needed")]
    OutOfRange { field: &'static str, found: f64, valid: &'static str },
    #[error("{field} is {found:?}; finite numbers, each above the one before, are needed")]
    Bands { field: &'static str, found: Vec<f64> },
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

    /// Which of the thresholds is the one of the errors.
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
    type Error = ProtocolError;

    fn try_from(config: EvalConfig) -> Result<Self, ProtocolError> {
        let thresholds = &config.dist_thresholds_m;
        let is_ascending = thresholds.windows(2).all(|pair| pair[0] < pair[1]);
        let are_distances = thresholds.iter().all(|&threshold| threshold.is_finite() && threshold > 0.0);
        if thresholds.is_empty() || !is_ascending || !are_distances {
            return Err(ProtocolError::Thresholds { found: thresholds.clone() });
        }
        if !thresholds.contains(&config.tp_threshold_m) {
            return Err(ProtocolError::TpThreshold {
                found: config.tp_threshold_m,
                valid: thresholds.clone(),
            });
        }
        let out = |field, found, valid| Err(ProtocolError::OutOfRange { field, found, valid });
        if !(0.0..1.0).contains(&config.min_recall) || first_step(config.min_recall) > 100 {
            return out("min_recall", config.min_recall, "a number from 0 to 0.99");
        }
        if !(0.0..1.0).contains(&config.min_precision) {
            return out("min_precision", config.min_precision, "a number from 0 to below 1");
        }
        if config.max_range_m.is_nan() || config.max_range_m <= 0.0 {
            return out("max_range_m", config.max_range_m, "a distance above 0 (inf keeps all)");
        }
        if config.max_boxes == 0 {
            return out("max_boxes", 0.0, "a count of 1 or more");
        }
        if !config.operating_score.is_finite() {
            return out("operating_score", config.operating_score, "a finite number");
        }
        for (field, edges) in config.breakdown.bands() {
            if !edges.windows(2).all(|pair| pair[0] < pair[1]) || !edges.iter().all(|edge| edge.is_finite()) {
                return Err(ProtocolError::Bands { field, found: edges.to_vec() });
            }
        }
        check_safety(&config.safety)?;
        Ok(Self { config })
    }
}

fn check_safety(config: &SafetyConfig) -> Result<(), ProtocolError> {
    let out = |field, found, valid| Err(ProtocolError::OutOfRange { field, found, valid });
    let is_above_zero = |value: f64| value.is_finite() && value > 0.0;
    if let Some(&found) = config.false_alarms_per_km.iter().find(|&&value| !is_above_zero(value)) {
        return out("safety.false_alarms_per_km", found, "a list of finite numbers above 0");
    }
    if let Some(&found) = config.decelerations_mps2.iter().find(|&&value| !is_above_zero(value)) {
        return out("safety.decelerations_mps2", found, "a list of finite numbers above 0");
    }
    if !config.reaction_time_s.is_finite() || config.reaction_time_s < 0.0 {
        return out("safety.reaction_time_s", config.reaction_time_s, "a finite number of 0 or more");
    }
    if config.confirm_n == 0 || config.confirm_n > config.confirm_of {
        return out("safety.confirm_n", config.confirm_n as f64, "a count from 1 to safety.confirm_of");
    }
    if config.n_bins == 0 {
        return out("safety.n_bins", 0.0, "a count of 1 or more");
    }
    Ok(())
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
        let checked = Protocol::try_from(shipped).unwrap();
        assert_eq!((checked.first_step(), checked), (11, Protocol::default()));
    }

    #[test]
    fn a_config_that_cannot_be_scored_by_is_refused() {
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
