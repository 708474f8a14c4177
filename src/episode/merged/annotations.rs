//! What a merged file draws over the front camera's picture: the zone, boxes, names and scores.
//!
//! Sizes grow with the picture, so that they look alike whatever its resolution.

use foxglove::messages as fox;
use foxglove::messages::points_annotation::Type as PointsType;

use super::boxes::paint;
use super::dashes::dashes;
use super::{Drawn, MergedLook};
use crate::episode::drawing::{BOX_EDGES, NEAR_PLANE_M, Pixel, pair, project_edge, text};
use crate::episode::messages::fox_time;
use crate::geometry::{Box3, Camera, Ego, Point, Point2, Transform};
use crate::object::{Detection, Harm};
use crate::sample::Measured;

/// Of a picture this wide, pixels, are the sizes below.
const OF_WIDTH_PX: f64 = 800.0;
const TRUTH_LINE_PX: f64 = 2.0;
const DETECTION_LINE_PX: f64 = 3.0;
const ZONE_LINE_PX: f64 = 2.0;
const TEXT_PX: f64 = 13.0;
const DASH_PX: f64 = 7.0;
const GAP_PX: f64 = 5.0;
const ZONE_FILL: f64 = 0.22;
const TAG_FILL: f64 = 0.9;

/// The zone, true boxes, the names of what is harmful or out of distribution, and the state of the ego in words.
pub(super) fn truth(drawn: &Drawn<'_>, look: &MergedLook) -> fox::ImageAnnotations {
    let page = Page::of(&drawn.sample.measured);
    let mut points: Vec<_> =
        drawn.zone().and_then(|corners| page.ground(corners, look)).into_iter().collect();
    let mut texts = vec![page.state(drawn, look)];
    let objects = drawn.sample.objects();
    for i in far_to_near(objects.len(), |i| &objects[i].box_in_ego) {
        let (object, harm) = (&objects[i], drawn.harm(i));
        let color = look.of_truth(harm);
        let Some(edges) = page.edges(&object.box_in_ego, color, TRUTH_LINE_PX, object.is_ood()) else {
            continue;
        };
        points.push(fox::PointsAnnotation { metadata: vec![pair("id", text(object.id.as_ref()))], ..edges });
        // Scores stand there where there are predictions.
        let is_named = drawn.detections.is_none() && (object.is_ood() || harm == Some(Harm::Harmful));
        if let Some(name) = object.category.as_ref().filter(|_| is_named) {
            texts.extend(page.tag(&object.box_in_ego, &name.replace('_', " "), color, look));
        }
    }
    page.finish(points, texts)
}

/// Reported boxes with their scores.
pub(super) fn detections(drawn: &Drawn<'_>, found: &[Detection], look: &MergedLook) -> fox::ImageAnnotations {
    let page = Page::of(&drawn.sample.measured);
    let (mut points, mut texts) = (Vec::new(), Vec::new());
    for i in far_to_near(found.len(), |i| &found[i].box_in_ego) {
        let (placed, color) = (&found[i].box_in_ego, look.of_detection(found[i].harm));
        let score = format!("{:.2}", found[i].score);
        let Some(edges) = page.edges(placed, color, DETECTION_LINE_PX, false) else { continue };
        points.push(fox::PointsAnnotation { metadata: vec![pair("score", score.clone())], ..edges });
        texts.extend(page.tag(placed, &score, color, look));
    }
    page.finish(points, texts)
}

/// Indices from the farthest box to the nearest, so that near ones lie on top.
fn far_to_near<'a>(n: usize, box_at: impl Fn(usize) -> &'a Box3<Ego>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| box_at(b).center.x().total_cmp(&box_at(a).center.x()));
    order
}

/// The picture that is drawn over.
struct Page<'a> {
    measured: &'a Measured,
    camera_from_ego: Transform<Camera, Ego>,
    /// Of sizes.
    scale: f64,
}

impl<'a> Page<'a> {
    fn of(measured: &'a Measured) -> Self {
        Self {
            measured,
            camera_from_ego: measured.ego_from_camera.inverse(),
            scale: f64::from(measured.intrinsics.width_px) / OF_WIDTH_PX,
        }
    }

    fn size_px(&self) -> Pixel {
        let camera = &self.measured.intrinsics;
        (f64::from(camera.width_px), f64::from(camera.height_px))
    }

    fn annotation(
        &self,
        kind: PointsType,
        points: Vec<Pixel>,
        line: (fox::Color, f64),
    ) -> fox::PointsAnnotation {
        fox::PointsAnnotation {
            timestamp: Some(fox_time(self.measured.time_ns)),
            r#type: kind.into(),
            points: points.into_iter().map(|(x, y)| fox::Point2 { x, y }).collect(),
            outline_color: Some(line.0),
            thickness: line.1 * self.scale,
            ..fox::PointsAnnotation::default()
        }
    }

    /// The edges of a box that are in the picture; `None` where none is.
    fn edges(
        &self,
        placed: &Box3<Ego>,
        color: [u8; 3],
        width_px: f64,
        is_dashed: bool,
    ) -> Option<fox::PointsAnnotation> {
        let corners = placed.corners().map(|corner| self.camera_from_ego * corner);
        let mut points = Vec::new();
        for (from, to) in BOX_EDGES {
            let seen = project_edge(&self.measured.intrinsics, corners[from], corners[to]);
            let Some((from, to)) = seen else { continue };
            let way = (to.0 - from.0, to.1 - from.1);
            let length = way.0.hypot(way.1) / self.scale;
            let parts = if is_dashed { dashes(length, DASH_PX, GAP_PX) } else { vec![(0.0, 1.0)] };
            let at = |share: f64| (from.0 + share * way.0, from.1 + share * way.1);
            points.extend(parts.into_iter().flat_map(|(begin, end)| [at(begin), at(end)]));
        }
        let line = (paint(color, 1.0), width_px);
        (!points.is_empty()).then(|| self.annotation(PointsType::LineList, points, line))
    }

    /// The zone's part in the picture; `None` where it is out of it.
    fn ground(&self, corners: &[Point2], look: &MergedLook) -> Option<fox::PointsAnnotation> {
        let ground = corners
            .iter()
            .map(|corner| self.camera_from_ego * Point::<Ego>::new(corner.x_m, corner.y_m, 0.0));
        let before = cut(
            &ground.collect::<Vec<_>>(),
            |corner| corner.z() - NEAR_PLANE_M,
            |a, b, t| Point::from_coords(a.coords + (b.coords - a.coords) * t),
        );
        let camera = &self.measured.intrinsics;
        let (width, height) = self.size_px();
        let mut seen: Vec<Pixel> = before.iter().filter_map(|corner| camera.project(corner)).collect();
        let sides: [&dyn Fn(&Pixel) -> f64; 4] =
            [&|at| at.0, &|at| width - at.0, &|at| at.1, &|at| height - at.1];
        for inside in sides {
            seen = cut(&seen, inside, |a, b, t| (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t));
        }
        (seen.len() > 2).then(|| fox::PointsAnnotation {
            fill_color: Some(paint(look.zone, ZONE_FILL)),
            metadata: vec![pair("zone", "danger_zone")],
            ..self.annotation(PointsType::LineLoop, seen, (paint(look.zone, 0.9), ZONE_LINE_PX))
        })
    }

    /// Words over the top of a box; `None` where the box is out of the picture.
    fn tag(
        &self,
        placed: &Box3<Ego>,
        words: &str,
        color: [u8; 3],
        look: &MergedLook,
    ) -> Option<fox::TextAnnotation> {
        let corners = placed.corners().map(|corner| self.camera_from_ego * corner);
        let ends = BOX_EDGES
            .into_iter()
            .filter_map(|(from, to)| project_edge(&self.measured.intrinsics, corners[from], corners[to]));
        let seen: Vec<Pixel> = ends.flat_map(|(from, to)| [from, to]).collect();
        let left = seen.iter().map(|at| at.0).reduce(f64::min)?;
        let top = seen.iter().map(|at| at.1).reduce(f64::min)?;
        // The text's lower left corner; at the upper border it goes into the box.
        let text_px = TEXT_PX * self.scale;
        let at = (left, if top < 2.0 * text_px { top + 1.5 * text_px } else { top - 0.3 * text_px });
        let ground = paint(color, TAG_FILL);
        Some(self.words(words.to_owned(), at, paint(look.ink, 1.0), ground))
    }

    /// What the ego does, and what is harmful.
    fn state(&self, drawn: &Drawn<'_>, look: &MergedLook) -> fox::TextAnnotation {
        let ego = drawn.sample.true_state();
        // A sum with zero has no minus sign left: no "-0.0".
        let mut words = format!("{:.1} m/s", (10.0 * ego.speed_mps).round() / 10.0 + 0.0);
        words += &format!(
            "   {:+.1}° steering",
            (10.0 * ego.steering_angle_rad.to_degrees()).round() / 10.0 + 0.0
        );
        if let Some(harms) = &drawn.harms {
            let n = harms.iter().filter(|&&harm| harm == Harm::Harmful).count();
            words += &format!("   {n} harmful of {}", harms.len());
        }
        if let Some(found) = &drawn.detections {
            let n = found.iter().filter(|detection| detection.harm == Harm::Harmful).count();
            words += &format!("   {n} predicted harmful");
        }
        let text_px = TEXT_PX * self.scale;
        self.words(words, (0.6 * text_px, 1.7 * text_px), paint(look.text, 1.0), paint(look.ink, 0.7))
    }

    fn words(&self, text: String, at: Pixel, color: fox::Color, ground: fox::Color) -> fox::TextAnnotation {
        fox::TextAnnotation {
            timestamp: Some(fox_time(self.measured.time_ns)),
            position: Some(fox::Point2 { x: at.0, y: at.1 }),
            text,
            font_size: TEXT_PX * self.scale,
            text_color: Some(color),
            background_color: Some(ground),
            metadata: Vec::new(),
        }
    }

    fn finish(
        &self,
        points: Vec<fox::PointsAnnotation>,
        texts: Vec<fox::TextAnnotation>,
    ) -> fox::ImageAnnotations {
        let timestamp = Some(fox_time(self.measured.time_ns));
        fox::ImageAnnotations { timestamp, points, texts, ..fox::ImageAnnotations::default() }
    }
}

/// The part of a polygon on the side where `inside` is not negative (Sutherland and Hodgman, 1974); `between` is the point that
/// lies a share of the way from one corner to the next.
fn cut<P: Copy>(corners: &[P], inside: impl Fn(&P) -> f64, between: impl Fn(&P, &P, f64) -> P) -> Vec<P> {
    let mut kept = Vec::with_capacity(corners.len() + 2);
    for (i, corner) in corners.iter().enumerate() {
        let next = &corners[(i + 1) % corners.len()];
        let (here, there) = (inside(corner), inside(next));
        if here >= 0.0 {
            kept.push(*corner);
        }
        if (here >= 0.0) != (there >= 0.0) {
            kept.push(between(corner, next, here / (here - there)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_cut_at_a_side() {
        let square = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)];
        let between = |a: &Pixel, b: &Pixel, t: f64| (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t);
        let left = cut(&square, |at| 1.0 - at.0, between);
        assert_eq!(left, [(0.0, 0.0), (1.0, 0.0), (1.0, 4.0), (0.0, 4.0)]);
        assert_eq!(cut(&square, |at| at.0, between), square);
        assert!(cut(&square, |at| -1.0 - at.0, between).is_empty());
    }
}
