//! The part of the samples that is scored: boxes within the range, and true objects that the LiDAR hit; and which truths it leaves out.

use serde::{Deserialize, Serialize};

use super::neutral::{Gaps, NeutralReason};
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
    /// Objects within the range that the LiDAR did not hit. No recall and no AP counts them, but who warns of one is not wrong.
    pub unhit: Vec<&'a LabelledObject>,
    /// Objects out of the range, or beyond the annotated one: no figure counts them, but their harm is known.
    pub far: Vec<&'a LabelledObject>,
    /// For each detection, why it is neither right nor wrong if no truth accounts for it; empty where the truth leaves out
    /// nothing.
    neutral: Vec<Option<NeutralReason>>,
}

impl KeptSample<'_> {
    /// Why a detection is neither right nor wrong if no truth accounts for it.
    pub fn neutral_at(&self, detection_idx: usize) -> Option<NeutralReason> {
        self.neutral.get(detection_idx).copied().flatten()
    }

    /// Whether the truth leaves out something.
    pub fn has_gaps(&self) -> bool {
        self.facts.labelled.is_some() || !self.facts.ignored.is_empty()
    }
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
    /// Truths at the range to which the log is annotated, or beyond.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub truths_beyond_labelled: usize,
    /// Samples that nobody annotated, with all that was detected in them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub samples_unlabelled: usize,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_zero(n: &usize) -> bool {
    *n == 0
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
        truths_beyond_labelled: 0,
        samples_unlabelled: samples.iter().filter(|sample| sample.facts.is_unlabelled).count(),
    };
    let is_near = |of: &Box3<Ego>| {
        let (x_m, y_m) = (of.center.x(), of.center.y());
        (x_m * x_m + y_m * y_m).sqrt() < config.max_range_m
    };
    let mut detections_out_of_range = 0;
    let mut keep_detection = |detection: &Detection| {
        let is_in_range = is_near(&detection.box_in_ego);
        detections_out_of_range += usize::from(!is_in_range);
        is_in_range
    };
    let kept = samples
        .iter()
        .filter(|sample| !sample.facts.is_unlabelled)
        .map(|sample| {
            let gaps = Gaps::of(&sample.facts, &sample.objects);
            let (mut objects, mut unhit, mut far) = (Vec::new(), Vec::new(), Vec::new());
            for object in &sample.objects {
                let of = &object.truth.box_in_ego;
                let is_beyond = gaps.as_ref().is_some_and(|gaps| gaps.is_beyond_range(of));
                if !is_near(of) {
                    filters.truths_out_of_range += 1;
                    far.push(object);
                } else if config.drop_truths_without_points && !object.truth.is_hit() {
                    filters.truths_without_points += 1;
                    if is_beyond { &mut far } else { &mut unhit }.push(object);
                } else if is_beyond {
                    filters.truths_beyond_labelled += 1;
                    far.push(object);
                } else {
                    objects.push(object);
                }
            }
            let mut detections = Vec::with_capacity(sample.detections.len());
            let mut neutral = Vec::new();
            for (i, found) in sample.detections.iter().enumerate().filter(|(_, found)| keep_detection(found))
            {
                detections.push(found);
                if let Some(gaps) = &gaps {
                    let n_points = sample.n_points.get(i).copied().flatten();
                    neutral.push(gaps.find_reason(&found.box_in_ego, n_points));
                }
            }
            KeptSample { id: &sample.id, facts: &sample.facts, objects, detections, unhit, far, neutral }
        })
        .collect();
    filters.detections_out_of_range = detections_out_of_range;
    (kept, filters)
}
