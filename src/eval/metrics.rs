//! From outcomes to figures: the four columns of Table III, AP per threshold, errors, counts.
//!
//! | column | true positives | false positives | positives |
//! |---|---|---|---|
//! | total | all | all | all |
//! | `id_matched` | on ID truths | misclassified on ID truths | ID truths |
//! | `ood_all` | on OOD truths | misclassified on OOD truths, unmatched | OOD truths |
//! | `ood_matched` | on OOD truths | misclassified on OOD truths | OOD truths |
//!
//! A detection that is neither a true nor a false positive of a column is left out of its ranking.

use serde::{Deserialize, Serialize};

use crate::object::{Distribution, Harm};

use super::curve::Curve;
use super::matching::{ClassMatching, Outcome, match_errors};
use super::protocol::{EvalConfig, Protocol};
use super::{EvalSample, EvalTruth, Mode, pretty_json};

/// A value for each class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PerClass<T> {
    pub harmful: T,
    pub harmless: T,
}

impl<T> PerClass<T> {
    /// Makes both values.
    pub fn from_fn(mut value: impl FnMut(Harm) -> T) -> Self {
        Self { harmful: value(Harm::Harmful), harmless: value(Harm::Harmless) }
    }

    /// The class's value.
    pub fn get(&self, class: Harm) -> &T {
        match class {
            Harm::Harmful => &self.harmful,
            Harm::Harmless => &self.harmless,
        }
    }
}

/// A column of Table III.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// Everything: the nuScenes mAP.
    Total,
    /// On ID truths, matched false positives only.
    IdMatched,
    /// On OOD truths, all false positives that are not on ID truths.
    OodAll,
    /// On OOD truths, matched false positives only.
    OodMatched,
}

impl Column {
    /// In the order of the table.
    pub const ALL: [Self; 4] = [Self::Total, Self::IdMatched, Self::OodAll, Self::OodMatched];

    /// Whether a truth of this distribution is a positive of the column.
    pub(super) fn has_positive(self, distribution: Option<Distribution>) -> bool {
        match self {
            Self::Total => true,
            Self::IdMatched => distribution == Some(Distribution::Id),
            Self::OodAll | Self::OodMatched => distribution == Some(Distribution::Ood),
        }
    }

    /// Whether an outcome is a true (`Some(true)`), a false (`Some(false)`) or no (`None`) positive here.
    pub(super) fn judge(self, outcome: Outcome<'_>) -> Option<bool> {
        match outcome {
            Outcome::Matched(truth, _) => self.has_positive(truth.truth.distribution).then_some(true),
            Outcome::Misclassified(truth) => self.has_positive(truth.truth.distribution).then_some(false),
            Outcome::Unmatched => matches!(self, Self::Total | Self::OodAll).then_some(false),
        }
    }
}

/// A value for each column; the last three are `None` (JSON null) where only the protocol was scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Columns<T> {
    pub total: T,
    pub id_matched: Option<T>,
    pub ood_all: Option<T>,
    pub ood_matched: Option<T>,
}

impl<T> Columns<T> {
    pub(super) fn from_fn(mode: Mode, mut value: impl FnMut(Column) -> T) -> Self {
        let mut if_ood = |column| (mode == Mode::Ood).then(|| value(column));
        let others = [if_ood(Column::IdMatched), if_ood(Column::OodAll), if_ood(Column::OodMatched)];
        let [id_matched, ood_all, ood_matched] = others;
        Self { total: value(Column::Total), id_matched, ood_all, ood_matched }
    }

    /// The column's value.
    pub fn get(&self, column: Column) -> Option<&T> {
        match column {
            Column::Total => Some(&self.total),
            Column::IdMatched => self.id_matched.as_ref(),
            Column::OodAll => self.ood_all.as_ref(),
            Column::OodMatched => self.ood_matched.as_ref(),
        }
    }
}

/// AP of each class, mean over the thresholds, and the mean of both classes (mAP); all 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClassScores {
    pub harmful: f64,
    pub harmless: f64,
    pub mean: f64,
}

/// Mean errors of the true positives at the TP threshold; 1 where recall does not pass the minimum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TpErrors {
    /// Distance of centres on the ground, metres.
    pub ate: f64,
    /// 1 - IoU of the aligned boxes, 0 to 1.
    pub ase: f64,
    /// Smallest yaw difference, radians, 0 to pi.
    pub aoe: f64,
}

/// How many truths of a class were scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct TruthCounts {
    pub all: usize,
    /// Known to be in distribution.
    pub id: usize,
    /// Known to be out of distribution.
    pub ood: usize,
}

/// What became of a class's detections at one threshold; `_id` and `_ood` stay 0 where unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct OutcomeCounts {
    pub matched: usize,
    pub matched_id: usize,
    pub matched_ood: usize,
    pub misclassified: usize,
    pub misclassified_id: usize,
    pub misclassified_ood: usize,
    pub unmatched: usize,
}

impl OutcomeCounts {
    fn of(outcomes: &[Outcome<'_>]) -> Self {
        let mut counts = Self::default();
        outcomes.iter().for_each(|&outcome| counts.add(outcome));
        counts
    }

    fn add(&mut self, outcome: Outcome<'_>) {
        let (all, id, ood, truth) = match outcome {
            Outcome::Matched(truth, _) => {
                (&mut self.matched, &mut self.matched_id, &mut self.matched_ood, truth)
            }
            Outcome::Misclassified(truth) => {
                (&mut self.misclassified, &mut self.misclassified_id, &mut self.misclassified_ood, truth)
            }
            Outcome::Unmatched => {
                self.unmatched += 1;
                return;
            }
        };
        *all += 1;
        match truth.truth.distribution {
            Some(Distribution::Id) => *id += 1,
            Some(Distribution::Ood) => *ood += 1,
            None => {}
        }
    }
}

/// What was scored, after the filters.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    pub n_samples: usize,
    pub truths: PerClass<TruthCounts>,
    pub detections: PerClass<usize>,
    /// One for each threshold, in the config's order.
    pub outcomes: PerClass<Vec<OutcomeCounts>>,
}

/// The filters and what they dropped; range first, then points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Filters {
    /// Infinite ranges are JSON null.
    #[serde(deserialize_with = "null_is_infinite")]
    pub max_range_m: f64,
    pub drop_truths_without_points: bool,
    pub truths_out_of_range: usize,
    pub truths_without_points: usize,
    pub detections_out_of_range: usize,
}

fn null_is_infinite<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

/// All figures of a scoring: `metrics.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    pub mode: Mode,
    #[serde(flatten)]
    pub columns: Columns<ClassScores>,
    /// AP at each threshold, in the config's order.
    pub per_threshold: Columns<PerClass<Vec<f64>>>,
    /// Precision over recall at each threshold, in the config's order.
    pub curves: Columns<PerClass<Vec<Curve>>>,
    /// Of all true positives, ID and OOD.
    pub tp_errors: PerClass<TpErrors>,
    pub counts: Counts,
    pub filters: Filters,
    pub config: EvalConfig,
}

impl Metrics {
    /// The file's text; the same metrics give the same bytes.
    #[must_use]
    pub fn to_json(&self) -> String {
        pretty_json::to_string(self)
    }
}

/// The detections of both classes matched at each of the config's thresholds.
pub(super) type Matching<'a> = PerClass<ClassMatching<'a>>;

/// Matches what the filters kept.
pub(super) fn matched<'a>(kept: &'a [EvalSample], config: &EvalConfig) -> Matching<'a> {
    PerClass::from_fn(|class| ClassMatching::new(kept, class, &config.dist_thresholds_m))
}

/// Scores what the filters kept.
pub(super) fn measure(
    kept: &[EvalSample],
    matching: &Matching<'_>,
    filters: Filters,
    protocol: &Protocol,
    mode: Mode,
) -> Metrics {
    let config = protocol.config();
    let truths = PerClass::from_fn(|class| -> Vec<&EvalTruth> {
        kept.iter().flat_map(|sample| &sample.truths).filter(|truth| truth.harm == class).collect()
    });
    let n_positives = |class: Harm, column: Column| {
        truths.get(class).iter().filter(|truth| column.has_positive(truth.distribution)).count()
    };
    let curves = Columns::from_fn(mode, |column| {
        PerClass::from_fn(|class| {
            let matching = matching.get(class);
            let curve = |threshold_idx| {
                let judged = matching
                    .at(threshold_idx)
                    .filter_map(|(ranked, outcome)| Some((ranked.detection.score, column.judge(outcome)?)));
                Curve::new(judged, n_positives(class, column))
            };
            (0..config.dist_thresholds_m.len()).map(curve).collect::<Vec<_>>()
        })
    });
    let (first_step, min_precision) = (protocol.first_step(), config.min_precision);
    let per_threshold = Columns::from_fn(mode, |column| {
        let curves = curves.get(column).expect("same mode");
        PerClass::from_fn(|class| {
            curves.get(class).iter().map(|c| c.average_precision(first_step, min_precision)).collect()
        })
    });
    let columns = Columns::from_fn(mode, |column| {
        let aps: &PerClass<Vec<f64>> = per_threshold.get(column).expect("same mode");
        let (harmful, harmless) = (mean(&aps.harmful), mean(&aps.harmless));
        ClassScores { harmful, harmless, mean: mean(&[harmful, harmless]) }
    });
    let count_detections = |class| matching.get(class).ranking.ranked().len();
    let tp_errors = PerClass::from_fn(|class| {
        let at = protocol.tp_threshold_idx();
        mean_errors(matching.get(class), at, &curves.total.get(class)[at], first_step)
    });
    Metrics {
        mode,
        columns,
        per_threshold,
        curves,
        tp_errors,
        counts: Counts {
            n_samples: kept.len(),
            truths: PerClass::from_fn(|class| TruthCounts {
                all: truths.get(class).len(),
                id: n_positives(class, Column::IdMatched),
                ood: n_positives(class, Column::OodAll),
            }),
            detections: PerClass::from_fn(count_detections),
            outcomes: PerClass::from_fn(|class| {
                matching.get(class).outcomes.iter().map(|outcomes| OutcomeCounts::of(outcomes)).collect()
            }),
        },
        filters,
        config: config.clone(),
    }
}

fn mean_errors(
    matching: &ClassMatching<'_>,
    threshold_idx: usize,
    curve: &Curve,
    first_step: usize,
) -> TpErrors {
    let matches: Vec<_> = matching
        .at(threshold_idx)
        .filter_map(|(ranked, outcome)| {
            let Outcome::Matched(truth, distance_m) = outcome else { return None };
            let found = &ranked.detection.box_in_ego;
            Some((ranked.detection.score, match_errors(&truth.truth.box_in_ego, found, distance_m)))
        })
        .collect();
    let [ate, ase, aoe] = curve.mean_errors(&matches, first_step);
    TpErrors { ate, ase, aoe }
}

/// The samples without what the filters drop, in the same order.
pub(super) fn filtered(samples: &[EvalSample], config: &EvalConfig) -> (Vec<EvalSample>, Filters) {
    let mut filters = Filters {
        max_range_m: config.max_range_m,
        drop_truths_without_points: config.drop_truths_without_points,
        truths_out_of_range: 0,
        truths_without_points: 0,
        detections_out_of_range: 0,
    };
    let is_near = |x_m: f64, y_m: f64| (x_m * x_m + y_m * y_m).sqrt() < config.max_range_m;
    let mut kept = samples.to_vec();
    for sample in &mut kept {
        sample.truths.retain(|truth| {
            let center = truth.box_in_ego.center;
            let is_in_range = is_near(center.x(), center.y());
            let has_points = !config.drop_truths_without_points || truth.n_lidar_points != Some(0);
            filters.truths_out_of_range += usize::from(!is_in_range);
            filters.truths_without_points += usize::from(is_in_range && !has_points);
            is_in_range && has_points
        });
        sample.detections.retain(|detection| {
            let center = detection.box_in_ego.center;
            let is_in_range = is_near(center.x(), center.y());
            filters.detections_out_of_range += usize::from(!is_in_range);
            is_in_range
        });
    }
    (kept, filters)
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
