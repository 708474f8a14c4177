//! The paper's figures (Tables II and III), and the names of the columns that stand beside them.

use crate::eval::{ClassScores, Column, Confidence, Evaluation, Intervals, Mode};
use crate::report::table::{Cell, ap};

/// The classes and their mean, in the order of all figures here.
pub const PARTS: [&str; 3] = ["harmful", "harmless", "mean"];
/// The caveat beside the paper's figures.
pub const YARDSTICK: &str =
    "The paper's figures come from another simulator: a yardstick, not the same work.";

/// What the strict figures are.
pub const STRICT: &str = "Strict: with neutral detections as false positives.";

/// One AP by class, beside the paper's.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    pub name: &'static str,
    /// For charts.
    pub short: &'static str,
    /// `None` where there is no truth.
    pub ours: [Option<f64>; 3],
    /// Bounds of the confidence intervals.
    pub intervals: [Option<[f64; 2]>; 3],
    pub paper: [f64; 3],
    /// Ours with every neutral detection as a false positive, where there may be such.
    pub strict: [Option<f64>; 3],
}

impl Line {
    /// AP in distribution, or in a column out of distribution.
    #[must_use]
    pub fn new(column: Option<Column>, scores: &ClassScores, confidence: Option<&Confidence>) -> Self {
        let (name, short, paper) = match column {
            None => ("ID: mAP", "ID", [0.7947, 0.8289, 0.8118]),
            Some(Column::Total) => ("OOD: mAP (total)", "total", [0.715, 0.723, 0.719]),
            Some(Column::IdMatched) => {
                ("OOD: mAP_ID (matched FPs only)", "ID, matched FPs", [0.74, 0.88, 0.81])
            }
            Some(Column::OodAll) => ("OOD: mAP_OOD (all FPs)", "OOD, all FPs", [0.652, 0.345, 0.499]),
            Some(Column::OodMatched) => {
                ("OOD: mAP_OOD (matched FPs only)", "OOD, matched FPs", [0.714, 0.725, 0.72])
            }
        };
        let intervals = confidence.and_then(|of| of.columns.get(column.unwrap_or(Column::Total)).copied());
        let intervals =
            intervals.map_or([None; 3], |Intervals { harmful, harmless, mean }| [harmful, harmless, mean]);
        Self { name, short, ours: parts(scores), intervals, paper, strict: [None; 3] }
    }

    /// With the AP that counts every neutral detection as false, where that is known.
    #[must_use]
    pub fn with_strict(self, strict: Option<&ClassScores>) -> Self {
        Self { strict: strict.map_or([None; 3], parts), ..self }
    }

    /// Ours, in a cell: what lies below it is the interval, if that is asked for, the strict figure and the paper's.
    #[must_use]
    pub fn cells(&self) -> Vec<Cell> {
        let cell = |i: usize| {
            let interval = self.intervals[i].map(|[low, high]| format!("{low:.3}–{high:.3}"));
            let strict = self.strict[i].map(|strict| format!("strict {}", ap(strict)));
            let paper = format!("paper {}", ap(self.paper[i]));
            Cell {
                text: ap(self.ours[i]),
                below: interval.into_iter().chain(strict).chain([paper]).collect(),
            }
        };
        std::iter::once(self.name.into()).chain((0..PARTS.len()).map(cell)).collect()
    }

    /// The lines of a scoring: one in distribution, four out of it.
    #[must_use]
    pub fn of_evaluation(evaluation: &Evaluation) -> Vec<Self> {
        let (metrics, confidence) = (&evaluation.metrics, evaluation.confidence.as_ref());
        let columns: &[Option<Column>] = match metrics.mode {
            Mode::Id => &[None],
            Mode::Ood => &Column::ALL.map(Some),
        };
        let line = |column: &Option<Column>| {
            let scores = metrics.columns.get(column.unwrap_or(Column::Total))?;
            let strict = metrics.strict.as_ref().and_then(|of| of.get(column.unwrap_or(Column::Total)));
            Some(Self::new(*column, scores, confidence).with_strict(strict))
        };
        columns.iter().filter_map(line).collect()
    }
}

fn parts(scores: &ClassScores) -> [Option<f64>; 3] {
    [scores.harmful, scores.harmless, scores.mean]
}
