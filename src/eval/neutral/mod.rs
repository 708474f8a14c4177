//! Detections that are neither right nor wrong: nothing is annotated where they are. The rule never looks at their class.
//!
//! A detection that no truth accounts for at a threshold ([`super::pairing::Outcome::Unmatched`]) is neutral if one of
//! these holds, in this order; all four follow from facts of the sample alone, never from what other detections say:
//!
//! - **region**: its centre lies in an ignored region on the ground (nuScenes' bicycle racks), or at least half of its
//!   rectangle in the picture lies in one ignored region of it (KITTI's `DontCare`, whose share is that of the detection);
//! - **range**: its centre is at the range to which the log is annotated, or beyond (nuScenes' class range);
//! - **view**: the log annotates only what its front camera sees, and the centre is left or right of the picture;
//! - **kind**: the box has a size that nothing annotated can have, at least one LiDAR point lies in it, and its centre lies
//!   on no true object. Something is there, and nobody said what. (A log that annotates some of the static things has
//!   no trees: what its kinds are does not tell, their sizes do. A kind without sizes can have any.)
//!
//! Truths in ignored regions stay, as in KITTI: what the log annotates is known wherever it lies, and who finds it is
//! right. (nuScenes drops bicycles in racks.) Truths at the annotated range or beyond are dropped, as in nuScenes.

use serde::{Deserialize, Serialize};

use crate::dataset::{CameraFacts, PictureRectangle, SampleFacts};
use crate::episode::{Labelled, SizeRange};
use crate::geometry::{Box3, Ego, Point2, distance_to_convex_m};
use crate::object::LabelledObject;
use crate::sample::IgnoredRegion;

/// Share of a detection's rectangle in the picture from which it counts as in a region.
const LEAST_SHARE: f64 = 0.5;

/// Why a detection counts neither way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NeutralReason {
    /// It lies in a region that nobody annotated.
    Region,
    /// It is beyond the annotated range.
    Range,
    /// It is beside the only picture that was annotated.
    View,
    /// Its size is that of nothing that is annotated.
    Kind,
}

/// How many detections were neutral, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NeutralCounts {
    pub region: usize,
    pub range: usize,
    pub view: usize,
    pub kind: usize,
}

impl NeutralCounts {
    pub(super) fn add(&mut self, reason: NeutralReason) {
        *match reason {
            NeutralReason::Region => &mut self.region,
            NeutralReason::Range => &mut self.range,
            NeutralReason::View => &mut self.view,
            NeutralReason::Kind => &mut self.kind,
        } += 1;
    }

    /// All of them.
    #[must_use]
    pub fn sum(&self) -> usize {
        self.region + self.range + self.view + self.kind
    }

    pub(super) fn is_zero(&self) -> bool {
        *self == Self::default()
    }
}

/// What the truth of a sample leaves out.
pub(super) struct Gaps<'a> {
    labelled: Option<&'a Labelled>,
    ignored: &'a [IgnoredRegion],
    camera: Option<&'a CameraFacts>,
    objects: &'a [LabelledObject],
}

impl<'a> Gaps<'a> {
    /// `None` where the truth leaves out nothing, as in simulation where no heap is in view.
    pub fn of(facts: &'a SampleFacts, objects: &'a [LabelledObject]) -> Option<Self> {
        let SampleFacts { labelled, ignored, camera, .. } = facts;
        let (labelled, camera) = (labelled.as_ref(), camera.as_ref());
        (labelled.is_some() || !ignored.is_empty()).then_some(Self { labelled, ignored, camera, objects })
    }

    /// Whether a box is at the annotated range or beyond.
    pub fn is_beyond_range(&self, of: &Box3<Ego>) -> bool {
        let max_range_m = self.labelled.and_then(|labelled| labelled.max_range_m);
        max_range_m.is_some_and(|max_range_m| of.center.x().hypot(of.center.y()) >= max_range_m)
    }

    /// Why a detection with this box would be neutral if no truth accounts for it; `n_points` LiDAR points lie in it, as
    /// far as that is known.
    pub fn find_reason(&self, found: &Box3<Ego>, n_points: Option<u32>) -> Option<NeutralReason> {
        if self.is_in_region(found) {
            return Some(NeutralReason::Region);
        }
        if self.is_beyond_range(found) {
            return Some(NeutralReason::Range);
        }
        let labelled = self.labelled?;
        if labelled.in_camera_view && self.camera.is_some_and(|camera| !camera.sees_across(found.center)) {
            return Some(NeutralReason::View);
        }
        let is_other_kind = !has_labelled_size(found, labelled)
            && n_points.is_some_and(|n| n > 0)
            && !self.objects.iter().any(|object| lies_on(found, &object.truth.box_in_ego));
        is_other_kind.then_some(NeutralReason::Kind)
    }

    fn is_in_region(&self, found: &Box3<Ego>) -> bool {
        let mut in_picture = None;
        let mut is_in = |region: &IgnoredRegion| match region {
            IgnoredRegion::Ground { corners_in_ego_m } => is_within(found, corners_in_ego_m),
            &IgnoredRegion::Image { left_px, top_px, right_px, bottom_px } => {
                let Some(camera) = self.camera else { return false };
                let seen = *in_picture.get_or_insert_with(|| camera.rectangle_of(found));
                let region = PictureRectangle { left_px, top_px, right_px, bottom_px };
                seen.is_some_and(|seen| seen.shared_with(&region).area() >= LEAST_SHARE * seen.area())
            }
        };
        self.ignored.iter().any(&mut is_in)
    }
}

fn is_within(found: &Box3<Ego>, corners: &[Point2]) -> bool {
    let center = Point2 { x_m: found.center.x(), y_m: found.center.y() };
    corners.len() >= 3 && distance_to_convex_m(center, corners) <= 0.0
}

fn lies_on(found: &Box3<Ego>, truth: &Box3<Ego>) -> bool {
    is_within(found, &truth.footprint())
}

/// Whether an annotated kind can have boxes of this size; length and width may be told the other way round. A kind whose
/// sizes are not known can have any.
fn has_labelled_size(found: &Box3<Ego>, labelled: &Labelled) -> bool {
    let is_in = |value_m: f64, [least_m, most_m]: [f64; 2]| (least_m..=most_m).contains(&value_m);
    let fits = |sizes: &SizeRange| {
        let lies_so = |length_m, width_m| is_in(length_m, sizes.length_m) && is_in(width_m, sizes.width_m);
        is_in(found.height_m, sizes.height_m)
            && (lies_so(found.length_m, found.width_m) || lies_so(found.width_m, found.length_m))
    };
    labelled.kinds.iter().any(|kind| labelled.sizes.get(kind).is_none_or(fits))
}

#[cfg(test)]
mod tests;
