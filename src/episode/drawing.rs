//! Drawings for viewers: boxes as cubes, the map, the danger zone, and boxes projected into the image.

use foxglove::messages as fox;
use foxglove::messages::line_primitive::Type as LineType;
use foxglove::messages::points_annotation::Type as PointsType;
use foxglove::messages::scene_entity_deletion::Type as DeletionType;

use super::convert::FINITE;
use super::error::MessageFault;
use super::messages::{fox_cube, fox_identity, fox_point, fox_span, fox_time};
use crate::geometry::{Box3, Camera, Ego, Frame, Pinhole, Point, Point2, World};
use crate::object::{Detection, Distribution, Harm, Kind, Object};
use crate::sample::Measured;

/// The parts of the town that viewers draw, once per episode.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapDrawing {
    /// Polylines along the lane borders.
    pub lane_lines: Vec<Vec<Point<World>>>,
    /// Triangles, counter-clockwise seen from above.
    pub drivable_area: Vec<[Point<World>; 3]>,
}

/// How long a true or labelled box and a zone stay, whatever the period of the samples: 0.3 s, its default.
const LIFETIME_NS: u32 = 300_000_000;

/// Reported boxes below this score are not drawn: a network tells dozens a sample, nearly all of them noise.
const LEAST_DRAWN_SCORE: f64 = 0.05;

/// Below this depth edges are cut, so that nothing behind the camera is drawn.
pub(super) const NEAR_PLANE_M: f64 = 0.1;

pub(super) const fn color(r: f64, g: f64, b: f64, a: f64) -> fox::Color {
    fox::Color { r, g, b, a }
}

const RED: fox::Color = color(0.9, 0.1, 0.1, 0.6);
const BLUE: fox::Color = color(0.1, 0.35, 0.95, 0.5);
const GREEN: fox::Color = color(0.1, 0.8, 0.2, 1.0);
const GREEN_FILL: fox::Color = color(0.1, 0.8, 0.2, 0.25);
/// Reported boxes have the tones of `report`'s pictures, where a test compares them.
const AMBER: fox::Color = color(1.0, 185.0 / 255.0, 56.0 / 255.0, 0.7);
const LILAC: fox::Color = color(203.0 / 255.0, 178.0 / 255.0, 1.0, 0.7);

fn harm_color(harm: Harm) -> fox::Color {
    match harm {
        Harm::Harmful => RED,
        Harm::Harmless => BLUE,
    }
}

fn truth_color(object: &Object) -> fox::Color {
    match object.kind {
        _ if object.is_ood() => color(0.9, 0.1, 0.8, 0.6),
        Some(Kind::Vehicle) => color(1.0, 0.6, 0.1, 0.5),
        Some(Kind::Pedestrian) => color(0.1, 0.7, 0.9, 0.5),
        Some(Kind::Static) | None => color(0.6, 0.6, 0.6, 0.5),
    }
}

pub(super) fn entity(time_ns: u64, frame_id: &str, id: String, lifetime_ns: u32) -> fox::SceneEntity {
    fox::SceneEntity {
        timestamp: Some(fox_time(time_ns)),
        frame_id: frame_id.to_owned(),
        id,
        lifetime: Some(fox_span(lifetime_ns)),
        ..fox::SceneEntity::default()
    }
}

pub(super) fn pair(key: &str, value: impl Into<String>) -> fox::KeyValuePair {
    fox::KeyValuePair { key: key.to_owned(), value: value.into() }
}

/// A fact as text; empty if it is unknown.
pub(super) fn text(fact: Option<&String>) -> String {
    fact.cloned().unwrap_or_default()
}

fn cube(time_ns: u64, id: String, box_in_ego: &Box3<Ego>, color: fox::Color) -> fox::SceneEntity {
    fox::SceneEntity {
        cubes: vec![fox_cube(box_in_ego, color)],
        ..entity(time_ns, Ego::NAME, id, LIFETIME_NS)
    }
}

pub(super) fn update(entities: Vec<fox::SceneEntity>) -> fox::SceneUpdate {
    fox::SceneUpdate { deletions: Vec::new(), entities }
}

/// True boxes, coloured by kind, magenta when out of distribution.
pub(super) fn truth_markers(time_ns: u64, objects: &[Object]) -> fox::SceneUpdate {
    let entities = objects.iter().map(|object| fox::SceneEntity {
        metadata: vec![
            pair("category", text(object.category.as_ref())),
            pair("kind", object.kind.map_or("", Kind::name)),
            pair("distribution", object.distribution.map_or("", Distribution::name)),
        ],
        ..cube(time_ns, text(object.id.as_ref()), &object.box_in_ego, truth_color(object))
    });
    update(entities.collect())
}

/// Lane lines and drivable area, drawn once.
pub(super) fn map_update(time_ns: u64, map: &MapDrawing) -> fox::SceneUpdate {
    let lines = map.lane_lines.iter().map(|line| fox::LinePrimitive {
        r#type: LineType::LineStrip.into(),
        pose: Some(fox_identity()),
        thickness: 0.12,
        points: line.iter().map(fox_point).collect(),
        color: Some(color(1.0, 1.0, 1.0, 0.9)),
        ..fox::LinePrimitive::default()
    });
    let lines = fox::SceneEntity {
        lines: lines.collect(),
        ..entity(time_ns, World::NAME, "lane_lines".to_owned(), 0)
    };
    let triangles = fox::TriangleListPrimitive {
        pose: Some(fox_identity()),
        points: map.drivable_area.iter().flatten().map(fox_point).collect(),
        color: Some(color(0.3, 0.3, 0.32, 1.0)),
        ..fox::TriangleListPrimitive::default()
    };
    let area = fox::SceneEntity {
        triangles: vec![triangles],
        ..entity(time_ns, World::NAME, "drivable_area".to_owned(), 0)
    };
    update(vec![area, lines])
}

/// Boxes with their labels: harmful red, harmless blue.
pub(super) fn harm_boxes<'a>(
    time_ns: u64,
    boxes: impl Iterator<Item = (&'a Object, Harm)>,
) -> fox::SceneUpdate {
    let entities = boxes.map(|(object, harm)| fox::SceneEntity {
        metadata: vec![pair("category", text(object.category.as_ref())), pair("harm", harm.name())],
        ..cube(time_ns, text(object.id.as_ref()), &object.box_in_ego, harm_color(harm))
    });
    update(entities.collect())
}

/// Reported boxes from [`LEAST_DRAWN_SCORE`] on, the fainter the lower the score. They stay until the next message, which takes
/// all before it away.
pub(super) fn detection_boxes(time_ns: u64, detections: &[Detection]) -> fox::SceneUpdate {
    let drawn = detections.iter().enumerate().filter(|(_, found)| found.score >= LEAST_DRAWN_SCORE);
    let entities = drawn.map(|(i, detection)| {
        let tone = match detection.harm {
            Harm::Harmful => AMBER,
            Harm::Harmless => LILAC,
        };
        let paint = fox::Color { a: tone.a * detection.score, ..tone };
        // Printed with the digits of the message, which is a float.
        let score = (detection.score as f32).to_string();
        fox::SceneEntity {
            metadata: vec![pair("harm", detection.harm.name()), pair("score", score)],
            cubes: vec![fox_cube(&detection.box_in_ego, paint)],
            ..entity(time_ns, Ego::NAME, format!("detection:{i}"), 0)
        }
    });
    let all_before = fox::SceneEntityDeletion {
        timestamp: Some(fox_time(time_ns)),
        r#type: DeletionType::All.into(),
        id: String::new(),
    };
    fox::SceneUpdate { deletions: vec![all_before], entities: entities.collect() }
}

/// The map that [`map_update`] drew.
pub(super) fn map_of(update: &fox::SceneUpdate) -> Result<MapDrawing, MessageFault> {
    let place = |point: &fox::Point3| Point::new(point.x, point.y, point.z);
    let mut map = MapDrawing::default();
    for entity in &update.entities {
        map.lane_lines.extend(entity.lines.iter().map(|line| line.points.iter().map(place).collect()));
        let triangles = entity.triangles.iter().flat_map(|list| list.points.as_chunks::<3>().0);
        map.drivable_area.extend(triangles.map(|corners| corners.each_ref().map(place)));
    }
    let mut points = map.drivable_area.iter().flatten().chain(map.lane_lines.iter().flatten());
    if let Some(point) = points.find(|point| !point.coords.iter().all(|at| at.is_finite())) {
        let found = format!("{:?}", [point.x(), point.y(), point.z()]);
        return Err(MessageFault::new("point of the map", found, FINITE));
    }
    Ok(map)
}

/// The danger zone on the ground: green outline, translucent fill.
pub(super) fn zone_update(time_ns: u64, corners: &[Point2]) -> fox::SceneUpdate {
    // A little above the road, so that the two do not flicker through each other.
    let points: Vec<fox::Point3> =
        corners.iter().map(|corner| fox::Point3 { x: corner.x_m, y: corner.y_m, z: 0.05 }).collect();
    let outline = fox::LinePrimitive {
        r#type: LineType::LineLoop.into(),
        pose: Some(fox_identity()),
        thickness: 0.1,
        points: points.clone(),
        color: Some(GREEN),
        ..fox::LinePrimitive::default()
    };
    let fill = fox::TriangleListPrimitive {
        pose: Some(fox_identity()),
        indices: fill_indices(corners.len()),
        points,
        color: Some(GREEN_FILL),
        ..fox::TriangleListPrimitive::default()
    };
    update(vec![fox::SceneEntity {
        lines: vec![outline],
        triangles: vec![fill],
        ..entity(time_ns, Ego::NAME, "danger_zone".to_owned(), LIFETIME_NS)
    }])
}

/// Triangles between opposite sides of an outline: right for a rectangle and for a bent corridor
/// whose corners run out along one side and back along the other.
pub(super) fn fill_indices(n_corners: usize) -> Vec<u32> {
    let index = |i: usize| u32::try_from(i).expect("an outline has few corners");
    let mut indices = Vec::new();
    let (mut low, mut high) = (0, n_corners.saturating_sub(1));
    while low + 1 < high {
        indices.extend([low, low + 1, high].map(index));
        if low + 1 < high - 1 {
            indices.extend([low + 1, high - 1, high].map(index));
        }
        low += 1;
        high -= 1;
    }
    indices
}

/// Edges of a box as pairs of its corners: bottom, top, upright.
pub(super) const BOX_EDGES: [(usize, usize); 12] =
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)];

/// The zone's outline and the labelled boxes, drawn into the camera image.
pub(super) fn image_annotations<'a>(
    measured: &Measured,
    zone: &[Point2],
    boxes: impl Iterator<Item = (&'a Object, Harm)>,
) -> fox::ImageAnnotations {
    let camera_from_ego = measured.ego_from_camera.inverse();
    let camera = &measured.intrinsics;
    let on_ground: Vec<Point<Camera>> =
        zone.iter().map(|corner| camera_from_ego * Point::<Ego>::new(corner.x_m, corner.y_m, 0.0)).collect();
    let outline = (0..on_ground.len()).map(|i| (on_ground[i], on_ground[(i + 1) % on_ground.len()]));
    let mut drawn = vec![line_list(measured.time_ns, camera, outline, GREEN, pair("zone", "danger_zone"))];
    for (object, harm) in boxes {
        let corners = object.box_in_ego.corners().map(|corner| camera_from_ego * corner);
        let edges = BOX_EDGES.into_iter().map(|(from, to)| (corners[from], corners[to]));
        let paint = fox::Color { a: 1.0, ..harm_color(harm) };
        drawn.push(line_list(measured.time_ns, camera, edges, paint, pair("id", text(object.id.as_ref()))));
    }
    drawn.retain(|list| !list.points.is_empty());
    fox::ImageAnnotations {
        timestamp: Some(fox_time(measured.time_ns)),
        points: drawn,
        ..fox::ImageAnnotations::default()
    }
}

fn line_list(
    time_ns: u64,
    camera: &Pinhole,
    edges: impl Iterator<Item = (Point<Camera>, Point<Camera>)>,
    paint: fox::Color,
    tag: fox::KeyValuePair,
) -> fox::PointsAnnotation {
    let pixel = |(x, y): (f64, f64)| fox::Point2 { x, y };
    let ends = edges.filter_map(|(from, to)| project_edge(camera, from, to));
    fox::PointsAnnotation {
        timestamp: Some(fox_time(time_ns)),
        r#type: PointsType::LineList.into(),
        points: ends.flat_map(|(from, to)| [pixel(from), pixel(to)]).collect(),
        outline_color: Some(paint),
        thickness: 2.0,
        metadata: vec![tag],
        ..fox::PointsAnnotation::default()
    }
}

pub(super) type Pixel = (f64, f64);

/// The visible part of an edge in pixels: cut at the near plane, then at the image's border.
pub(super) fn project_edge(
    camera: &Pinhole,
    from: Point<Camera>,
    to: Point<Camera>,
) -> Option<(Pixel, Pixel)> {
    let cut = |point: Point<Camera>, other: Point<Camera>| {
        if point.z() >= NEAR_PLANE_M {
            return point;
        }
        let share = (NEAR_PLANE_M - point.z()) / (other.z() - point.z());
        let mut coords = point.coords + (other.coords - point.coords) * share;
        coords.z = NEAR_PLANE_M;
        Point::from_coords(coords)
    };
    if from.z().max(to.z()) < NEAR_PLANE_M {
        return None;
    }
    let (start, end) = (camera.project(&cut(from, to))?, camera.project(&cut(to, from))?);
    clip_to_image(start, end, f64::from(camera.width_px), f64::from(camera.height_px))
}

/// The part of a segment inside the image (Liang and Barsky, 1984).
fn clip_to_image(start: Pixel, end: Pixel, width_px: f64, height_px: f64) -> Option<(Pixel, Pixel)> {
    let (dx, dy) = (end.0 - start.0, end.1 - start.1);
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    let borders = [(-dx, start.0), (dx, width_px - start.0), (-dy, start.1), (dy, height_px - start.1)];
    for (outward, distance) in borders {
        if outward == 0.0 {
            if distance < 0.0 {
                return None;
            }
        } else if outward < 0.0 {
            enter = enter.max(distance / outward);
        } else {
            leave = leave.min(distance / outward);
        }
    }
    let at = |share: f64| (start.0 + share * dx, start.1 + share * dy);
    (enter < leave).then(|| (at(enter), at(leave)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Pinhole {
        Pinhole { width_px: 100, height_px: 50, fx_px: 50.0, fy_px: 50.0, cx_px: 50.0, cy_px: 25.0 }
    }

    #[test]
    fn an_edge_that_passes_behind_the_camera_is_cut_at_the_near_plane_and_the_image() {
        let (start, end) =
            project_edge(&camera(), Point::new(0.0, 1.0, 4.0), Point::new(0.0, 1.0, -4.0)).unwrap();
        // 50 * 1 / 4 below the middle, then down to the lower border.
        assert_eq!(start, (50.0, 37.5));
        assert!((end.0 - 50.0).abs() < 1e-9 && (end.1 - 50.0).abs() < 1e-9, "{end:?}");
    }

    #[test]
    fn edges_behind_the_camera_or_beside_the_image_are_not_drawn() {
        assert_eq!(project_edge(&camera(), Point::new(0.0, 0.0, -1.0), Point::new(0.0, 0.0, -2.0)), None);
        assert_eq!(project_edge(&camera(), Point::new(9.0, 0.0, 1.0), Point::new(9.0, 1.0, 1.0)), None);
    }

    #[test]
    fn reported_boxes_stay_until_the_next_sample_and_noise_is_not_drawn() {
        let center = Point::new(9.0, 0.0, 0.8);
        let box_in_ego = Box3 { center, length_m: 4.0, width_m: 2.0, height_m: 1.6, yaw_rad: 0.0 };
        let found = [(Harm::Harmful, 0.04), (Harm::Harmful, 0.05), (Harm::Harmless, 1.0)];
        let found = found.map(|(harm, score)| Detection {
            box_in_ego,
            velocity_in_ego_mps: [0.0; 2],
            harm,
            score,
            spread: None,
        });
        let update = detection_boxes(7, &found);
        let ids: Vec<&str> = update.entities.iter().map(|entity| entity.id.as_str()).collect();
        assert_eq!(ids, ["detection:1", "detection:2"], "numbered as they are reported");
        for (entity, paint) in update.entities.iter().zip([fox::Color { a: 0.05 * 0.7, ..AMBER }, LILAC]) {
            let color = entity.cubes[0].color.expect("cubes are coloured");
            assert!((color.a - paint.a).abs() < 1e-12, "{color:?}");
            assert_eq!((color.r, color.g, color.b), (paint.r, paint.g, paint.b));
            assert_eq!(entity.lifetime, Some(fox::Duration::new(0, 0)));
        }
        // Whatever the sample shows, the boxes before it go.
        for update in [update, detection_boxes(8, &[])] {
            let [gone] = update.deletions.as_slice() else { panic!("one deletion: {update:?}") };
            assert_eq!(gone.r#type, i32::from(DeletionType::All));
            assert!(gone.timestamp.is_some());
        }
    }

    #[test]
    fn a_rectangle_fills_with_two_triangles_and_a_line_with_none() {
        assert_eq!(fill_indices(4), [0, 1, 3, 1, 2, 3]);
        assert_eq!(fill_indices(6).len(), 12);
        assert!(fill_indices(2).is_empty() && fill_indices(0).is_empty());
    }
}
