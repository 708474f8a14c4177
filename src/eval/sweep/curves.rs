//! The result of a sweep: a curve for each change and judge, as `sweeps.json` and `sweeps.csv` hold it.

use serde::{Deserialize, Serialize};

use super::Change;
use crate::eval::judge::Judge;
use crate::eval::metrics::{ClassScores, Columns};
use crate::eval::pretty_json;
use crate::eval::safety::Early;

/// All curves over the same frames; the content of `sweeps.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sweeps {
    pub n_samples: usize,
    /// Curves by change, then by judge.
    pub curves: Vec<SweepCurve>,
    /// For the network at the recorded states; `None` where the objects' tracks are unknown.
    pub early: Option<Early>,
}

/// One judge over the values of one change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepCurve {
    pub change: Change,
    pub judge: Judge,
    /// Whether the zone of the changed state gives the truth; otherwise the labels stay.
    pub truth_moves: bool,
    pub points: Vec<SweepPoint>,
}

/// The frames at one value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepPoint {
    /// In the unit of the change's name.
    pub value: f64,
    /// AP; the columns of Table III where the frames hold objects out of distribution.
    pub scores: Columns<ClassScores>,
    /// Truths after the filters.
    pub n_truths: usize,
    /// Of these, the ones that a detection lies on.
    pub n_located: usize,
    /// Truths that are harmful, that are called harmful, and both. One that is not located is not called
    /// harmful.
    pub n_harmful: usize,
    pub n_called_harmful: usize,
    pub n_both: usize,
    /// Overlap of the two sets: both over either; `None` where neither has an object.
    pub set_iou: Option<f64>,
    /// Share of the located objects whose class is right.
    pub agreement: Option<f64>,
}

impl Sweeps {
    /// `sweeps.json`; the same figures give the same bytes.
    #[must_use]
    pub fn to_json(&self) -> String {
        pretty_json::to_string(self)
    }

    /// `sweeps.csv`: one line per point, AP in the column `total`; a cell is empty where there is no value.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = String::from(
            "change,judge,value,ap_harmful,ap_harmless,ap_mean,n_truths,n_located,n_harmful,n_called_harmful,\
             n_both,set_iou,agreement\n",
        );
        let share = |share: Option<f64>| share.map_or_else(String::new, |share| format!("{share:.4}"));
        for (curve, point) in self.curves.iter().flat_map(|of| of.points.iter().map(move |point| (of, point)))
        {
            let ap = &point.scores.total;
            text += &format!(
                "{},{},{},{},{},{},{},{},{},{},{},{},{}\n",
                curve.change.name(),
                curve.judge.name(),
                point.value,
                share(ap.harmful),
                share(ap.harmless),
                share(ap.mean),
                point.n_truths,
                point.n_located,
                point.n_harmful,
                point.n_called_harmful,
                point.n_both,
                share(point.set_iou),
                share(point.agreement),
            );
        }
        text
    }

    /// A judge's points for a change; empty if the change was not swept.
    #[must_use]
    pub fn points(&self, change: Change, judge: Judge) -> &[SweepPoint] {
        let curve = self.curves.iter().find(|curve| curve.change == change && curve.judge == judge);
        curve.map_or(&[], |curve| &curve.points)
    }
}
