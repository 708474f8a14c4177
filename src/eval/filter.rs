//! The part of the samples that is scored: boxes within the range, and true objects that the LiDAR hit.

use serde::{Deserialize, Serialize};

use super::protocol::EvalConfig;
use super::sample::EvalSample;
use crate::dataset::SampleFacts;
use crate::geometry::{Box3, Ego};
use crate::object::{Detection, LabelledObject};

/// What the filters keep of a sample, in its order.
#[derive(Debug, Clone)]
pub struct KeptSample<'a> {
    pub id: &'a str,
    pub facts: &'a SampleFacts,
    pub objects: Vec<&'a LabelledObject>,
    pub detections: Vec<&'a Detection>,
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

/// The samples without what the filters drop, in the same order.
pub(super) fn filter<'a>(samples: &'a [EvalSample], config: &EvalConfig) -> (Vec<KeptSample<'a>>, Filters) {
    let mut filters = Filters {
        max_range_m: config.max_range_m,
        drop_truths_without_points: config.drop_truths_without_points,
        truths_out_of_range: 0,
        truths_without_points: 0,
        detections_out_of_range: 0,
    };
    let is_near = |of: &Box3<Ego>| {
        let (x_m, y_m) = (of.center.x(), of.center.y());
        (x_m * x_m + y_m * y_m).sqrt() < config.max_range_m
    };
    let mut keep_object = |object: &&LabelledObject| {
        let is_in_range = is_near(&object.truth.box_in_ego);
        let has_points = !config.drop_truths_without_points || object.truth.is_hit();
        filters.truths_out_of_range += usize::from(!is_in_range);
        filters.truths_without_points += usize::from(is_in_range && !has_points);
        is_in_range && has_points
    };
    let mut keep_detection = |detection: &&Detection| {
        let is_in_range = is_near(&detection.box_in_ego);
        filters.detections_out_of_range += usize::from(!is_in_range);
        is_in_range
    };
    let kept = samples
        .iter()
        .map(|sample| KeptSample {
            id: &sample.id,
            facts: &sample.facts,
            objects: sample.objects.iter().filter(&mut keep_object).collect(),
            detections: sample.detections.iter().filter(&mut keep_detection).collect(),
        })
        .collect();
    (kept, filters)
}
