//! What a merged file draws in space: the ego's car, boxes, the zone.
//!
//! Entities have no lifetime: each message takes away by name those of the message before that are gone, so that nothing
//! flickers whatever the rate of the samples.

use std::collections::BTreeSet;

use foxglove::messages as fox;
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::scene_entity_deletion::Type as DeletionType;

use super::dashes::dashes;
use super::{Drawn, MergedLook};
use crate::episode::drawing::{BOX_EDGES, entity, fill_indices, pair, text};
use crate::episode::messages::{fox_cube, fox_identity, fox_point, fox_time, fox_vector};
use crate::geometry::{Box3, Ego, Frame, Point, Point2};
use crate::object::{Detection, Distribution, Harm, Object};
use crate::scene::car::EGO_LENGTH_M;

/// Inside of boxes: truth, and predictions, which are drawn over it.
const TRUTH_FILL: f64 = 0.22;
const DETECTION_FILL: f64 = 0.06;
const ZONE_FILL: f64 = 0.2;
/// Lines in pixels of the screen.
const TRUTH_LINE_PX: f64 = 1.5;
const DETECTION_LINE_PX: f64 = 3.0;
const ZONE_LINE_PX: f64 = 2.5;
const TEXT_PX: f64 = 13.0;
/// Dashes of boxes out of distribution, metres.
const DASH_M: f64 = 0.18;
const GAP_M: f64 = 0.12;
/// The zone lies a little above the road, so that the two do not flicker through each other, metres.
const ZONE_Z_M: f64 = 0.05;
/// What moves slower has no arrow, m/s; an arrow is as long as the way of a second.
const STANDING_MPS: f64 = 0.5;

/// A colour as messages hold it.
pub(super) fn paint([red, green, blue]: [u8; 3], alpha: f64) -> fox::Color {
    let share = |part: u8| f64::from(part) / 255.0;
    fox::Color { r: share(red), g: share(green), b: share(blue), a: alpha }
}

/// The names that were drawn last, of each topic.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    truth: BTreeSet<String>,
    detections: BTreeSet<String>,
}

impl Boxes {
    /// True boxes by harm; dashed, with their names, where they are out of distribution.
    pub(super) fn truth(&mut self, drawn: &Drawn<'_>, look: &MergedLook) -> fox::SceneUpdate {
        let time_ns = drawn.sample.measured.time_ns;
        let entities = drawn.sample.objects().iter().enumerate().map(|(i, object)| {
            let harm = drawn.harm(i);
            let color = look.of_truth(harm);
            let metadata = vec![
                pair("category", text(object.category.as_ref())),
                pair("harm", harm.map_or("", Harm::name)),
                pair("distribution", object.distribution.map_or("", Distribution::name)),
            ];
            let is_named = object.is_ood() || harm == Some(Harm::Harmful);
            let name = object.category.as_ref().filter(|_| is_named).map(|name| name.replace('_', " "));
            fox::SceneEntity {
                metadata,
                cubes: vec![fox_cube(&object.box_in_ego, paint(color, TRUTH_FILL))],
                lines: vec![edges(&object.box_in_ego, paint(color, 1.0), TRUTH_LINE_PX, object.is_ood())],
                texts: name
                    .map(|name| words(&object.box_in_ego, name, paint(color, 1.0)))
                    .into_iter()
                    .collect(),
                arrows: arrow(object, paint(color, 0.9)).into_iter().collect(),
                ..entity(time_ns, Ego::NAME, text(object.id.as_ref()), 0)
            }
        });
        update(time_ns, entities.collect(), &mut self.truth)
    }

    /// Reported boxes, thick, with their scores.
    pub(super) fn detections(
        &mut self,
        drawn: &Drawn<'_>,
        found: &[Detection],
        look: &MergedLook,
    ) -> fox::SceneUpdate {
        let time_ns = drawn.sample.measured.time_ns;
        let entities = found.iter().enumerate().map(|(i, detection)| {
            let (placed, color) = (&detection.box_in_ego, look.of_detection(detection.harm));
            let score = format!("{:.2}", detection.score);
            fox::SceneEntity {
                metadata: vec![pair("harm", detection.harm.name()), pair("score", score.clone())],
                cubes: vec![fox_cube(placed, paint(color, DETECTION_FILL))],
                lines: vec![edges(placed, paint(color, 1.0), DETECTION_LINE_PX, false)],
                texts: vec![words(placed, score, paint(color, 1.0))],
                ..entity(time_ns, Ego::NAME, format!("detection:{i}"), 0)
            }
        });
        update(time_ns, entities.collect(), &mut self.detections)
    }
}

/// The zone on the ground: an outline, and a translucent inside.
pub(super) fn zone(drawn: &Drawn<'_>, corners: &[Point2], look: &MergedLook) -> fox::SceneUpdate {
    let on_ground = |corner: &Point2| fox::Point3 { x: corner.x_m, y: corner.y_m, z: ZONE_Z_M };
    let points: Vec<fox::Point3> = corners.iter().map(on_ground).collect();
    let outline = fox::LinePrimitive {
        r#type: LineType::LineLoop.into(),
        pose: Some(fox_identity()),
        thickness: ZONE_LINE_PX,
        scale_invariant: true,
        points: points.clone(),
        color: Some(paint(look.zone, 1.0)),
        ..fox::LinePrimitive::default()
    };
    let fill = fox::TriangleListPrimitive {
        pose: Some(fox_identity()),
        indices: fill_indices(corners.len()),
        points,
        color: Some(paint(look.zone, ZONE_FILL)),
        ..fox::TriangleListPrimitive::default()
    };
    let zone = fox::SceneEntity {
        lines: vec![outline],
        triangles: vec![fill],
        ..entity(drawn.sample.measured.time_ns, Ego::NAME, "danger_zone".to_owned(), 0)
    };
    fox::SceneUpdate { deletions: Vec::new(), entities: vec![zone] }
}

/// The ego's car, drawn once; it goes where the frame `ego` goes.
pub(super) fn ego(drawn: &Drawn<'_>, glb: Vec<u8>) -> fox::SceneUpdate {
    let measured = &drawn.sample.measured;
    let mut pose = fox_identity();
    pose.position = Some(fox_vector(measured.ego_state.front_bumper_x_m - EGO_LENGTH_M / 2.0, 0.0, 0.0));
    let model = fox::ModelPrimitive {
        pose: Some(pose),
        scale: Some(fox_vector(1.0, 1.0, 1.0)),
        media_type: "model/gltf-binary".to_owned(),
        data: glb.into(),
        ..fox::ModelPrimitive::default()
    };
    let car = fox::SceneEntity {
        frame_locked: true,
        models: vec![model],
        ..entity(measured.time_ns, Ego::NAME, "ego".to_owned(), 0)
    };
    fox::SceneUpdate { deletions: Vec::new(), entities: vec![car] }
}

/// The entities, and the end of those that were drawn before and are gone; `before` becomes the names of these.
fn update(time_ns: u64, entities: Vec<fox::SceneEntity>, before: &mut BTreeSet<String>) -> fox::SceneUpdate {
    let now: BTreeSet<String> = entities.iter().map(|entity| entity.id.clone()).collect();
    let gone = before.difference(&now).map(|id| fox::SceneEntityDeletion {
        timestamp: Some(fox_time(time_ns)),
        r#type: DeletionType::MatchingId.into(),
        id: id.clone(),
    });
    let deletions = gone.collect();
    *before = now;
    fox::SceneUpdate { deletions, entities }
}

/// The twelve edges of a box.
fn edges(placed: &Box3<Ego>, color: fox::Color, thickness_px: f64, is_dashed: bool) -> fox::LinePrimitive {
    let corners = placed.corners();
    let mut points = Vec::new();
    for (from, to) in BOX_EDGES.map(|(from, to)| (corners[from], corners[to])) {
        let way = to.coords - from.coords;
        let parts = if is_dashed { dashes(way.norm(), DASH_M, GAP_M) } else { vec![(0.0, 1.0)] };
        for (begin, end) in parts {
            points.extend(
                [begin, end].map(|share| fox_point(&Point::<Ego>::from_coords(from.coords + way * share))),
            );
        }
    }
    fox::LinePrimitive {
        r#type: LineType::LineList.into(),
        pose: Some(fox_identity()),
        thickness: thickness_px,
        scale_invariant: true,
        points,
        color: Some(color),
        ..fox::LinePrimitive::default()
    }
}

/// Words over a box, upright to the viewer.
fn words(placed: &Box3<Ego>, text: String, color: fox::Color) -> fox::TextPrimitive {
    let mut pose = fox_identity();
    let center = placed.center;
    pose.position = Some(fox_vector(center.x(), center.y(), center.z() + placed.height_m / 2.0 + 0.35));
    fox::TextPrimitive {
        pose: Some(pose),
        billboard: true,
        font_size: TEXT_PX,
        scale_invariant: true,
        color: Some(color),
        text,
    }
}

/// The way of the next second.
fn arrow(object: &Object, color: fox::Color) -> Option<fox::ArrowPrimitive> {
    let [vx, vy] = object.velocity_in_ego_mps;
    let speed_mps = vx.hypot(vy);
    if !(speed_mps > STANDING_MPS) {
        return None;
    }
    let (sin, cos) = (vy.atan2(vx) / 2.0).sin_cos();
    let center = object.box_in_ego.center;
    let head_m = (0.3 * speed_mps).min(0.6);
    Some(fox::ArrowPrimitive {
        pose: Some(fox::Pose {
            position: Some(fox_vector(center.x(), center.y(), center.z())),
            orientation: Some(fox::Quaternion { x: 0.0, y: 0.0, z: sin, w: cos }),
        }),
        shaft_length: speed_mps - head_m,
        shaft_diameter: 0.12,
        head_length: head_m,
        head_diameter: 0.35,
        color: Some(color),
    })
}
