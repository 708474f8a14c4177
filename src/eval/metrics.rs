//! From outcomes to figures: the four columns of Table III, AP per threshold, errors, counts.
//!
//! | column | true positives | false positives | positives |
//! |---|---|---|---|
//! | total | all | all | all |
//! | `id_matched` | on ID truths | misclassified on ID truths | ID truths |
//! | `ood_all` | on OOD truths | misclassified on OOD truths, unmatched | OOD truths |
//! | `ood_matched` | on OOD truths | misclassified on OOD truths | OOD truths |
//!
//! A detection that is neither a true nor a false positive of a column is left out of its ranking, as are neutral ones
//! out of all.

use serde::{Deserialize, Serialize};

use crate::object::{Distribution, Harm, LabelledObject};

use super::curve::Curve;
use super::filter::{Filters, KeptSample};
use super::matching::{Matching, Outcome, PerClass, match_errors};
use super::neutral::NeutralCounts;
use super::pretty_json;
use super::protocol::{EvalConfig, MissingClass};
use super::sample::Mode;

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
    pub(super) fn judge(self, outcome: Outcome, matching: &Matching<'_>) -> Option<bool> {
        match outcome {
            Outcome::Matched(of) => self.has_positive(matching.distribution(of)).then_some(true),
            Outcome::Misclassified(of) => self.has_positive(matching.distribution(of)).then_some(false),
            Outcome::Unmatched => matches!(self, Self::Total | Self::OodAll).then_some(false),
            Outcome::Neutral(_) => None,
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

/// AP of each class, mean over the thresholds, and the mean over the classes that have one (mAP); all 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClassScores {
    /// `None` where there is no truth of the class.
    pub harmful: Option<f64>,
    pub harmless: Option<f64>,
    /// `None` where there is no truth at all.
    pub mean: Option<f64>,
}

impl ClassScores {
    /// The scores of both classes with their mean.
    #[must_use]
    pub fn new(harmful: Option<f64>, harmless: Option<f64>) -> Self {
        let present: Vec<f64> = [harmful, harmless].into_iter().flatten().collect();
        Self { harmful, harmless, mean: (!present.is_empty()).then(|| mean(&present)) }
    }

    /// The class's score.
    #[must_use]
    pub fn get(&self, class: Harm) -> Option<f64> {
        match class {
            Harm::Harmful => self.harmful,
            Harm::Harmless => self.harmless,
        }
    }
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
    /// Neither right nor wrong, since the log annotates nothing there.
    #[serde(default, skip_serializing_if = "NeutralCounts::is_zero")]
    pub neutral: NeutralCounts,
}

impl OutcomeCounts {
    fn of(outcomes: &[Outcome], matching: &Matching<'_>) -> Self {
        let mut counts = Self::default();
        outcomes.iter().for_each(|&outcome| counts.add(outcome, matching));
        counts
    }

    fn add(&mut self, outcome: Outcome, matching: &Matching<'_>) {
        let (all, id, ood, of) = match outcome {
            Outcome::Matched(of) => (&mut self.matched, &mut self.matched_id, &mut self.matched_ood, of),
            Outcome::Misclassified(of) => {
                (&mut self.misclassified, &mut self.misclassified_id, &mut self.misclassified_ood, of)
            }
            Outcome::Unmatched => {
                self.unmatched += 1;
                return;
            }
            Outcome::Neutral(reason) => {
                self.neutral.add(reason);
                return;
            }
        };
        *all += 1;
        match matching.distribution(of) {
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

/// All figures of a scoring: `metrics.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    pub mode: Mode,
    #[serde(flatten)]
    pub columns: Columns<ClassScores>,
    /// The same with every neutral detection as a false positive; `None` where the truth leaves out nothing, as in
    /// simulation where no heap is in view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strict: Option<Columns<ClassScores>>,
    /// AP at each threshold, in the config's order; `None` where there is no truth of the class.
    pub per_threshold: Columns<PerClass<Vec<Option<f64>>>>,
    /// Precision over recall at each threshold, in the config's order.
    pub curves: Columns<PerClass<Vec<Curve>>>,
    /// Errors of all true positives, ID and OOD; `None` where there is no truth of the class.
    pub tp_errors: PerClass<Option<TpErrors>>,
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

/// Scores what was matched.
pub(super) fn measure(matching: &Matching<'_>) -> Metrics {
    let (config, protocol, mode) = (matching.config(), matching.protocol, matching.mode);
    let scored = Scored::new(matching, |outcome| outcome);
    let has_gaps = matching.samples.iter().any(KeptSample::has_gaps);
    let strict = has_gaps.then(|| Scored::new(matching, Outcome::strictly).columns());
    let tp_errors = PerClass::from_fn(|class| {
        let curve = &scored.curves.total.get(class)[protocol.tp_threshold_idx()];
        is_scored(matching, class, Column::Total)
            .then(|| mean_errors(matching, class, curve, protocol.first_step()))
    });
    let n_positives = |class, column| count_positives(matching, class, column);
    Metrics {
        mode,
        columns: scored.columns(),
        strict,
        per_threshold: scored.per_threshold,
        curves: scored.curves,
        tp_errors,
        counts: Counts {
            n_samples: matching.samples.len(),
            truths: PerClass::from_fn(|class| TruthCounts {
                all: n_positives(class, Column::Total),
                id: n_positives(class, Column::IdMatched),
                ood: n_positives(class, Column::OodAll),
            }),
            detections: PerClass::from_fn(|class| matching.ranked.get(class).len()),
            outcomes: PerClass::from_fn(|class| {
                matching
                    .outcomes
                    .get(class)
                    .iter()
                    .map(|outcomes| OutcomeCounts::of(outcomes, matching))
                    .collect()
            }),
        },
        filters: matching.filters,
        config: config.clone(),
    }
}

/// Curves and AP of every column at every threshold.
struct Scored {
    mode: Mode,
    curves: Columns<PerClass<Vec<Curve>>>,
    per_threshold: Columns<PerClass<Vec<Option<f64>>>>,
}

impl Scored {
    /// Reads the outcomes through `view`.
    fn new(matching: &Matching<'_>, view: fn(Outcome) -> Outcome) -> Self {
        let (config, mode) = (matching.config(), matching.mode);
        let curves = Columns::from_fn(mode, |column| {
            PerClass::from_fn(|class| {
                let n_positives = count_positives(matching, class, column);
                let curve = |threshold_idx| {
                    let positives = matching.at(class, threshold_idx).filter_map(|(ranked, outcome)| {
                        Some((ranked.score, column.judge(view(outcome), matching)?))
                    });
                    Curve::new(positives, n_positives)
                };
                (0..config.dist_thresholds_m.len()).map(curve).collect::<Vec<_>>()
            })
        });
        let (first_step, min_precision) = (matching.protocol.first_step(), config.min_precision);
        let per_threshold = Columns::from_fn(mode, |column| {
            let curves = curves.get(column).expect("same mode");
            PerClass::from_fn(|class| {
                let is_scored = is_scored(matching, class, column);
                let ap =
                    |curve: &Curve| is_scored.then(|| curve.average_precision(first_step, min_precision));
                curves.get(class).iter().map(ap).collect()
            })
        });
        Self { mode, curves, per_threshold }
    }

    /// AP, mean over the thresholds.
    fn columns(&self) -> Columns<ClassScores> {
        let of_class = |aps: &[Option<f64>]| Some(mean(&aps.iter().copied().collect::<Option<Vec<f64>>>()?));
        Columns::from_fn(self.mode, |column| {
            let aps = self.per_threshold.get(column).expect("same mode");
            ClassScores::new(of_class(&aps.harmful), of_class(&aps.harmless))
        })
    }
}

fn count_positives(matching: &Matching<'_>, class: Harm, column: Column) -> usize {
    let is_positive = |of: &&LabelledObject| of.harm == class && column.has_positive(of.truth.distribution);
    matching.objects.iter().map(|of| of.object).filter(is_positive).count()
}

/// Whether the class has a score in the column: it has a truth, or its score is zero without one.
fn is_scored(matching: &Matching<'_>, class: Harm, column: Column) -> bool {
    matching.config().missing_class == MissingClass::Zero || count_positives(matching, class, column) > 0
}

fn mean_errors(matching: &Matching<'_>, class: Harm, curve: &Curve, first_step: usize) -> TpErrors {
    let matches: Vec<_> = matching
        .ranked_from(class, f64::NEG_INFINITY)
        .filter_map(|(ranked, outcome)| {
            let Outcome::Matched(of) = outcome else { return None };
            let truth = &matching.object(of).object.truth.box_in_ego;
            Some((ranked.score, match_errors(truth, &ranked.detection.box_in_ego)))
        })
        .collect();
    let [ate, ase, aoe] = curve.mean_errors(&matches, first_step);
    TpErrors { ate, ase, aoe }
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
