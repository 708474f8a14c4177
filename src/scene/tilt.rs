//! Things that lie on a side: how a model rests after it was tipped over.
//!
//! The body falls slowly over the edge or the point nearest to its weight, until what touches the ground has the weight
//! above it. Its weight is taken to be spread over its surface, as of hollow things.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::models::{Bounds, Model};
use super::path::{Vec2, direction_of};
use crate::geometry::convex_hull;
use crate::random::Rng;

/// Points this close to the ground touch it, metres.
const TOUCH_M: f64 = 0.002;
/// More falls than this and the body rolls for ever.
const MOST_FALLS: usize = 200;
/// Cosine of the tilt below which a body no longer stands.
const STANDS: f64 = 0.8;
/// Tangent of the push that a rest must bear, 6 degrees: physics has the weight elsewhere, and round things roll on.
const PUSH: f64 = 0.105;

/// A resting turn of a model, before its yaw.
#[derive(Debug, Clone, PartialEq)]
pub struct Tilt {
    pub turn: UnitQuaternion<f64>,
    /// Of the turned model, about the model's origin.
    pub bounds: Bounds,
}

impl Tilt {
    /// Tips a model over to a drawn side; `None` where it stands up again.
    pub(super) fn draw(model: &Model, rng: &mut Rng) -> Option<Self> {
        let points = corners_of(model);
        let center = weight_of(model)?;
        (0..6).find_map(|_| {
            let about = direction_of(std::f64::consts::TAU * rng.random::<f64>()).push(0.0);
            let axis = nalgebra::Unit::new_normalize(about);
            let tipped = UnitQuaternion::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2);
            let turn = settle(&points, &center, tipped)?;
            let is_over = (turn * Vector3::z()).z < STANDS;
            is_over.then(|| Self { turn, bounds: bounds_of(&points, &turn) })
        })
    }

    /// How far the model's origin lies above the ground that the body lies on.
    pub fn lift_m(&self) -> f64 {
        -self.bounds[0].z
    }
}

/// The model's corners, each once.
fn corners_of(model: &Model) -> Vec<Vector3<f64>> {
    let mut corners: Vec<[f32; 3]> =
        model.triangles.iter().flatten().map(|point| point.coords.into()).collect();
    corners.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    corners.dedup();
    corners.into_iter().map(|[x, y, z]| Vector3::new(x, y, z).cast()).collect()
}

/// The middle of the model's surface; `None` without any.
fn weight_of(model: &Model) -> Option<Vector3<f64>> {
    let (mut sum, mut area) = (Vector3::zeros(), 0.0);
    for triangle in model.triangles.iter() {
        let [a, b, c] = triangle.map(|point| point.coords.cast::<f64>());
        let share = (b - a).cross(&(c - a)).norm();
        sum += (a + b + c) * (share / 3.0);
        area += share;
    }
    (area > 0.0).then(|| sum / area)
}

fn bounds_of(points: &[Vector3<f64>], turn: &UnitQuaternion<f64>) -> Bounds {
    let turned = points.iter().map(|point| Point3::from(turn * point));
    let none =
        [Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY))];
    turned.fold(none, |[low, high], point| [low.inf(&point), high.sup(&point)])
}

/// Lets a body fall from edge to edge until it rests.
fn settle(
    points: &[Vector3<f64>],
    center: &Vector3<f64>,
    start: UnitQuaternion<f64>,
) -> Option<UnitQuaternion<f64>> {
    let mut turn = start;
    for _ in 0..MOST_FALLS {
        // The weight is the origin.
        let turned: Vec<Vector3<f64>> = points.iter().map(|point| turn * (point - center)).collect();
        let low_m = turned.iter().map(|point| point.z).fold(f64::INFINITY, f64::min);
        let touches = |point: &&Vector3<f64>| point.z < low_m + TOUCH_M;
        let contact: Vec<Vec2> = turned.iter().filter(touches).map(Vector3::xy).collect();
        let Some((pivot, towards)) = pivot_of(contact, PUSH * -low_m) else { return Some(turn) };
        let angle_of = |point: &Vector3<f64>| (point.z - low_m).atan2((point.xy() - pivot).dot(&towards));
        let fall_rad =
            turned.iter().filter(|point| !touches(point)).map(angle_of).fold(f64::INFINITY, f64::min);
        if !fall_rad.is_finite() {
            return None;
        }
        let axis = nalgebra::Unit::new_normalize(Vector3::z().cross(&towards.push(0.0)));
        turn = UnitQuaternion::from_axis_angle(&axis, fall_rad) * turn;
    }
    None
}

/// What a body that does not rest falls over: the place of the contact's outline that is nearest to the weight, and the
/// direction of the fall. It rests where the weight is above the contact, `least_m` from its outline.
fn pivot_of(contact: Vec<Vec2>, least_m: f64) -> Option<(Vec2, Vec2)> {
    let hull = convex_hull(contact);
    let edges = || (0..hull.len()).map(|i| (hull[i], hull[(i + 1) % hull.len()]));
    let is_inside = hull.len() > 2 && edges().all(|(a, b)| (b - a).perp(&-a) >= 0.0);
    let nearest = edges().map(|(a, b)| {
        let along = b - a;
        let length2 = along.norm_squared();
        if length2 > 0.0 { a + along * (-a.dot(&along) / length2).clamp(0.0, 1.0) } else { a }
    });
    let pivot = nearest.min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let away_m = pivot.norm();
    // Balanced on a point, as a ball is.
    if away_m < 1e-6 || is_inside && away_m >= least_m {
        return None;
    }
    Some((pivot, if is_inside { pivot } else { -pivot } / away_m))
}

#[cfg(test)]
mod tests {
    use super::super::models;
    use super::*;
    use crate::object::Distribution;
    use crate::random::stream;

    fn block(length: f64, width: f64, height: f64) -> Vec<Vector3<f64>> {
        (0..8)
            .map(|i| {
                let pick = |bit: usize, size: f64| if i >> bit & 1 == 1 { size / 2.0 } else { -size / 2.0 };
                Vector3::new(pick(0, length), pick(1, width), pick(2, height))
            })
            .collect()
    }

    #[test]
    fn a_tall_block_falls_on_its_side_and_a_slight_tilt_falls_back() {
        let (points, center) = (block(0.4, 0.6, 2.0), Vector3::zeros());
        let about_y = |angle| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        let height_m = |turn| {
            let [low, high] = bounds_of(&points, &turn);
            high.z - low.z
        };
        // Its weight is above the edge at atan(0.4 / 2) = 0.197 rad.
        assert!((height_m(settle(&points, &center, about_y(0.19)).unwrap()) - 2.0).abs() < 1e-9);
        assert!((height_m(settle(&points, &center, about_y(0.21)).unwrap()) - 0.4).abs() < 1e-9);
        // On a corner of its side it comes down on the wide side.
        let askew = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.9) * about_y(1.4);
        let lies_m = height_m(settle(&points, &center, askew).unwrap());
        assert!((lies_m - 0.4).abs() < 1e-9 || (lies_m - 0.6).abs() < 1e-9, "{lies_m}");
    }

    #[test]
    fn what_a_push_would_tip_falls_on() {
        // A foot of 2 cm on either side of the weight, 1 m below it: 1.1 degrees.
        let mut points = block(0.04, 0.04, 2.0);
        points.extend(block(1.0, 0.8, 0.2));
        let turn = settle(&points, &Vector3::zeros(), UnitQuaternion::identity()).unwrap();
        assert!((turn * Vector3::z()).z < 0.5, "{turn}");
    }

    #[test]
    fn a_cone_lies_on_its_flank() {
        let rim = (0..24).map(|i| direction_of(std::f64::consts::TAU * f64::from(i) / 24.0));
        let mut points: Vec<Vector3<f64>> = rim.map(|at| (at * 0.5).push(0.0)).collect();
        points.push(Vector3::new(0.0, 0.0, 1.0));
        let center = Vector3::new(0.0, 0.0, 0.25);
        let tipped = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.2);
        let turn = settle(&points, &center, tipped).unwrap();
        // The half angle at the tip is atan(0.5), so the tip on the ground is that much below the middle of the base: sin = 0.447.
        let rise = (turn * Vector3::z()).z;
        assert!((rise + 0.447).abs() < 0.01, "{rise}");
    }

    #[test]
    fn unfamiliar_models_that_lie_are_lower_than_they_stood_or_wider() {
        let mut n_tipped = 0;
        for model in models::load().unwrap().iter().filter(|m| m.facts.distribution == Distribution::Ood) {
            let mut rng = stream(3, "tilt-test", 0);
            let Some(tilt) = Tilt::draw(model, &mut rng) else { continue };
            n_tipped += 1;
            let size = tilt.bounds[1] - tilt.bounds[0];
            let upright_m = model.height_m();
            let is_tall = upright_m > 1.2 * model.length_m().max(model.width_m());
            assert!(!is_tall || size.z < 0.95 * upright_m, "{}: {} of {upright_m}", model.name, size.z);
        }
        assert!(n_tipped > 20, "{n_tipped}");
    }
}
