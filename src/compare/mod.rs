//! The domain gap in figures: two data sets side by side, in what their sensors, their car and their objects show.
//!
//! Each [`Quantity`] is a histogram of each set, [`distance`] says how far the two lie apart, and [`spread`] how far parts
//! of the first set lie apart from each other, which is the yardstick. One sample is in memory for each thread.

mod cloud;
mod distance;
mod energy;
mod lidar;
mod measure;
mod objects;
mod picture;
mod quantity;
mod spread;
mod structure;
mod tally;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

pub use self::cloud::{N_POINTS, PROPERTIES};
pub use self::distance::Distance;
use self::energy::compare_clouds;
pub use self::energy::{CloudGap, EnergyDistance};
pub use self::measure::CompareError;
use self::measure::{MeasuredSet, measure};
pub use self::quantity::{Quantity, RANGE_BIN_M, Unit};
pub use self::spread::{LEVEL, N_RESAMPLES};
use self::spread::{resample, within};
use self::tally::{Tallies, Tally};
use crate::dataset::statistics::Histogram;
use crate::episode::Split;
use crate::progress::Progress;

pub use self::lidar::{CLUTTER_RANGE_M, GROUND_M, OBSTACLE_TOP_M};
pub use self::objects::BOX_MARGIN_M;
pub use self::picture::COMPARED_WIDTH_PX;
pub use self::structure::FLAT_M;

/// Two data sets side by side.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DomainGap {
    pub a: SetFacts,
    pub b: SetFacts,
    /// What was measured in both: what is farther apart than parts of A first, the largest divergence first.
    pub rows: Vec<GapRow>,
    /// How far the clouds lie apart as a whole; `None` where a set has no point.
    pub cloud: Option<CloudGap>,
    /// What was measured in one of them only, and why.
    pub notes: Vec<String>,
}

/// One of the two data sets.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SetFacts {
    pub dataset: PathBuf,
    /// `None` for all splits.
    pub split: Option<Split>,
    pub n_episodes: usize,
    pub n_samples: usize,
    /// Samples that say which objects there are.
    pub n_samples_with_truth: usize,
    pub n_objects: u64,
    /// Parts that intervals and the yardstick are drawn from: episodes, or stretches of the only one.
    pub n_parts: usize,
}

/// One quantity in both sets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapRow {
    /// What it is, in words; the name of the row.
    pub name: String,
    #[serde(skip)]
    pub quantity: Quantity,
    pub unit: Unit,
    pub a: Side,
    pub b: Side,
    pub distance: Distance,
    /// Where the distance lies when episodes are drawn anew; `None` where a set has a single sample.
    pub interval: Option<Interval>,
    /// The distance that parts of A have from each other, which is exceeded in one draw of twenty; `None` where A has one
    /// sample.
    pub within_a: Option<Distance>,
    /// Whether the sets are farther apart than parts of A, in divergence or in the unit.
    pub is_apart: Option<bool>,
}

/// A quantity in one set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Side {
    pub n_values: u64,
    pub mean: f64,
    pub histogram: Histogram,
}

/// The middle [`LEVEL`] of resampled distances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    pub jensen_shannon: [f64; 2],
    pub wasserstein: [f64; 2],
}

/// Compares two data sets, all of each or one split.
///
/// # Errors
/// [`CompareError`]: no data set, no sample of the split, or a file that cannot be read.
pub fn compare(
    a: &Path,
    b: &Path,
    split: Option<Split>,
    progress: &dyn Progress,
) -> Result<DomainGap, CompareError> {
    let [a, b] = [measure(a, split, "measure A", progress)?, measure(b, split, "measure B", progress)?];
    let (all_a, all_b) = (a.whole(), b.whole());
    let quantities = Quantity::all();
    progress.start("resample", quantities.len() as u64);
    let row = |quantity: &Quantity| {
        progress.advance(1);
        compare_one(*quantity, &a, &b, (&all_a, &all_b))
    };
    let mut rows: Vec<GapRow> = quantities.par_iter().filter_map(row).collect();
    progress.finish();
    // Apart, not judged, as A; in each the largest divergence first.
    rows.sort_by(|one, other| {
        let order = |row: &GapRow| {
            (row.is_apart.map_or(1, |is_apart| if is_apart { 0 } else { 2 }), -row.distance.jensen_shannon)
        };
        let (one, other) = (order(one), order(other));
        one.0.cmp(&other.0).then(one.1.total_cmp(&other.1))
    });
    let notes = notes(&a, &b, &all_a, &all_b);
    let cloud = compare_clouds(&a, &b);
    Ok(DomainGap { a: a.facts, b: b.facts, rows, cloud, notes })
}

/// A row, if both sets have values.
fn compare_one(
    quantity: Quantity,
    a: &MeasuredSet,
    b: &MeasuredSet,
    (all_a, all_b): (&Tallies, &Tallies),
) -> Option<GapRow> {
    let (whole_a, whole_b) = (all_a.get(quantity)?, all_b.get(quantity)?);
    let distance = Distance::between(&whole_a.histogram, &whole_b.histogram)?;
    let within_a = within(quantity, a, b.facts.n_samples);
    Some(GapRow {
        name: quantity.name(),
        quantity,
        unit: quantity.unit(),
        a: Side::from(whole_a),
        b: Side::from(whole_b),
        interval: resample(quantity, a, b),
        is_apart: within_a.map(|within| distance.exceeds(&within)),
        distance,
        within_a,
    })
}

impl From<&Tally> for Side {
    fn from(tally: &Tally) -> Self {
        Self { n_values: tally.n(), mean: tally.mean(), histogram: tally.histogram.clone() }
    }
}

/// What a reader must know of the rows that are missing and of the yardstick.
fn notes(a: &MeasuredSet, b: &MeasuredSet, all_a: &Tallies, all_b: &Tallies) -> Vec<String> {
    let mut notes = Vec::new();
    for (name, set) in [("A", a), ("B", b)] {
        let facts = &set.facts;
        if facts.n_samples_with_truth == 0 {
            notes.push(format!(
                "{name} says of no sample which objects there are: rows about objects and clutter are absent"
            ));
        } else if facts.n_samples_with_truth < facts.n_samples {
            notes.push(format!(
                "{name} says of {} of {} samples which objects there are; rows about objects and clutter are of these",
                facts.n_samples_with_truth, facts.n_samples
            ));
        }
        if facts.n_parts < 2 {
            notes.push(format!(
                "{name} has a single sample: no interval{}",
                if name == "A" { ", no yardstick" } else { "" }
            ));
        } else if facts.n_episodes == 1 {
            notes.push(format!(
                "{name} has one episode, so its {} stretches stand for episodes: its spread is told too small",
                facts.n_parts
            ));
        }
        notes.extend(set.labelled.iter().map(|labelled| format!("{name} {labelled}")));
        notes.extend(
            set.odd.iter().map(|(what, n)| format!("{name}: {what} in {n} of {} samples", facts.n_samples)),
        );
    }
    for (has, has_name, lacks, lacks_name) in [(all_a, "A", all_b, "B"), (all_b, "B", all_a, "A")] {
        let only = Quantity::all().into_iter().filter(|&of| has.get(of).is_some() && lacks.get(of).is_none());
        let only: Vec<String> = only.map(Quantity::name).collect();
        if !only.is_empty() {
            notes.push(format!("in {has_name} and not in {lacks_name}: {}", only.join("; ")));
        }
    }
    notes
}
