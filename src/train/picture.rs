//! The loss that asks of each pixel whether it shows an object: the camera branch learns what things look like from
//! every pixel, where the heatmap tells it of a few cells.
//!
//! A pixel shows an object if it lies in the convex hull of a visible object's projected corners: binary cross entropy,
//! the mean over pixels. What is small in the picture weighs more by the pixel.

use burn::tensor::activation::log_sigmoid;
use burn::tensor::{Tensor, TensorData};
use nalgebra::Vector2;

use super::config::LossConfig;
use crate::geometry::{Box3, Ego, Point, Point2, convex_hull};
use crate::model::{CameraGeometry, PAINT_STRIDE, n_paint_pixels};
use crate::object::LabelledObject;

/// Corners nearer to the camera than this are moved there.
const NEAREST_M: f64 = 0.5;
/// Weight of a pixel that is asked nothing: above zero, so that it does not count as one that shows nothing.
const ASKED_NOTHING: f32 = 1e-20;
/// What stands on ignored ground lies between these heights; the ground may rise, and the car may be tilted.
const IGNORED_HEIGHTS_M: [f64; 2] = [-0.3, 1.5];

/// One sample's target `[y, x]`: where the picture shows an object, the pixel's weight, one or more; elsewhere zero.
///
/// # Arguments
/// - `objects`, `ignored`: mirrored if the view is; of what may stand on ignored ground the picture is asked nothing
#[must_use]
pub fn draw_objects(
    objects: &[LabelledObject],
    ignored: &[Vec<Point2>],
    view: &CameraGeometry,
    config: &LossConfig,
) -> Vec<f32> {
    let [n_x, n_y] =
        [view.intrinsics.width_px, view.intrinsics.height_px].map(|n_px| n_paint_pixels(n_px as usize));
    let mut target = vec![0f32; n_y * n_x];
    for corners in ignored {
        for cell in cells_in(&convex_hull(prism_px(corners, IGNORED_HEIGHTS_M, view)), [n_y, n_x]) {
            target[cell] = ASKED_NOTHING;
        }
    }
    for object in objects {
        if object.truth.visible_px.is_some_and(|px| px < config.min_visible_px) {
            continue;
        }
        let cells = cells_in(&convex_hull(corners_px(&object.truth.box_in_ego, view)), [n_y, n_x]);
        let weight = (config.least_picture_cells / cells.len().max(1) as f64).max(1.0) as f32;
        for cell in cells {
            target[cell] = target[cell].max(weight);
        }
    }
    target
}

/// Columns and rows of a box's corners, in pixels of the map; empty if the box lies behind the camera.
fn corners_px(of: &Box3<Ego>, view: &CameraGeometry) -> Vec<Vector2<f64>> {
    let half_m = of.height_m / 2.0;
    prism_px(&of.footprint(), [of.center.z() - half_m, of.center.z() + half_m], view)
}

/// The same of the corners of a prism over a polygon of the ground.
fn prism_px(base: &[Point2], heights_m: [f64; 2], view: &CameraGeometry) -> Vec<Vector2<f64>> {
    let camera_from_ego = view.ego_from_camera.inverse();
    let corners = base.iter().map(|corner| {
        heights_m.map(|height_m| camera_from_ego * Point::new(corner.x_m, corner.y_m, height_m))
    });
    let corners: Vec<[Point<_>; 2]> = corners.collect();
    if corners.iter().flatten().all(|corner| corner.z() < NEAREST_M) {
        return Vec::new();
    }
    let of = &view.intrinsics;
    let pixel = |p: &Point<_>| {
        let depth_m = p.z().max(NEAREST_M);
        let at = [of.fx_px * p.x() / depth_m + of.cx_px, of.fy_px * p.y() / depth_m + of.cy_px];
        Vector2::from(at) / PAINT_STRIDE as f64
    };
    corners.iter().flatten().map(pixel).collect()
}

/// The cells whose middle lies in a convex polygon, and at least the one at its middle.
fn cells_in(polygon: &[Vector2<f64>], [n_y, n_x]: [usize; 2]) -> Vec<usize> {
    let mut cells = Vec::new();
    if polygon.is_empty() {
        return cells;
    }
    let n = polygon.len();
    let bound = |axis: usize, most: usize| {
        let values = polygon.iter().map(|point| point[axis]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let cell = |v: f64| v.clamp(0.0, most as f64) as usize;
        cell(low.ceil())..cell(high.floor() + 1.0)
    };
    for y in bound(1, n_y) {
        for x in bound(0, n_x) {
            let is_inside = (0..n).all(|i| {
                let (a, b) = (polygon[i], polygon[(i + 1) % n]);
                (b[0] - a[0]) * (y as f64 - a[1]) - (b[1] - a[1]) * (x as f64 - a[0]) >= 0.0
            });
            if is_inside {
                cells.push(y * n_x + x);
            }
        }
    }
    let middle: [f64; 2] =
        std::array::from_fn(|axis| polygon.iter().map(|point| point[axis]).sum::<f64>() / n as f64);
    let [x, y] = middle.map(f64::round);
    if (0.0..n_x as f64).contains(&x) && (0.0..n_y as f64).contains(&y) {
        let cell = y as usize * n_x + x as usize;
        if !cells.contains(&cell) {
            cells.push(cell);
        }
    }
    cells
}

/// The loss of a batch's logits `[batch, 1, y, x]`; `targets` is `[batch][y * x]`.
#[must_use]
pub fn picture_loss(logits: Tensor<4>, targets: &[Vec<f32>]) -> Tensor<1> {
    let weight = Tensor::<4>::from_data(TensorData::new(targets.concat(), logits.dims()), &logits.device());
    let not_shown = weight.clone().equal_elem(0.0).float();
    (log_sigmoid(logits.clone()) * weight + log_sigmoid(logits.neg()) * not_shown).mean().neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Pinhole, Transform};
    use crate::object::Harm;
    use crate::train::targets::car;
    use burn::tensor::Device;
    use nalgebra::Vector3;

    fn view() -> CameraGeometry {
        CameraGeometry {
            intrinsics: Pinhole::from_horizontal_fov(400, 224, 70f64.to_radians()),
            ego_from_camera: Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0),
        }
    }

    #[test]
    fn a_car_ahead_covers_its_share_of_the_picture_below_the_horizon() {
        let target = draw_objects(&[car(21.7, 0.0, Harm::Harmful)], &[], &view(), &LossConfig::default());
        let cells: Vec<[usize; 2]> =
            (0..target.len()).filter(|&i| target[i] == 1.0).map(|i| [i % 100, i / 100]).collect();
        // 1.8 m wide and 1.5 m high at 18 m: 286 px of focal length over 4.
        let n_wanted = (1.8 * 1.5) * (285.6 / 18.0 / 4.0f64).powi(2);
        assert!((cells.len() as f64 - n_wanted).abs() < 0.35 * n_wanted, "{} of {n_wanted}", cells.len());
        assert!(cells.iter().all(|[x, y]| (44..57).contains(x) && (27..36).contains(y)), "{cells:?}");
    }

    #[test]
    fn what_lies_behind_or_is_hidden_covers_nothing_and_what_begins_beside_the_car_is_cut() {
        let mut hidden = car(21.7, 0.0, Harm::Harmful);
        hidden.truth.visible_px = Some(5);
        let behind = car(-10.0, 0.0, Harm::Harmless);
        let config = LossConfig::default();
        assert_eq!(draw_objects(&[hidden, behind], &[], &view(), &config).iter().sum::<f32>(), 0.0);
        let beside = draw_objects(&[car(3.0, 2.0, Harm::Harmless)], &[], &view(), &config);
        assert!(beside.iter().sum::<f32>() > 50.0 && beside[20 * 100 + 90] == 0.0);
    }

    #[test]
    fn what_is_small_in_the_picture_weighs_as_much_as_what_covers_twelve_cells() {
        let mut bag = car(41.7, 0.0, Harm::Harmful);
        let of = &mut bag.truth.box_in_ego;
        (of.length_m, of.width_m, of.height_m) = (0.4, 0.4, 0.5);
        let target = draw_objects(&[bag], &[], &view(), &LossConfig::default());
        let n_cells = target.iter().filter(|&&weight| weight > 0.0).count();
        assert!((1..6).contains(&n_cells), "{n_cells}");
        assert!((target.iter().sum::<f32>() - 12.0).abs() < 1e-4);
    }

    #[test]
    fn an_undecided_pixel_costs_ln_2() {
        let device = Device::flex();
        let loss = picture_loss(Tensor::zeros([1, 1, 1, 2], &device), &[vec![1.0, 0.0]]);
        assert!((loss.into_scalar::<f32>() - 2f32.ln()).abs() < 1e-6);
    }
    #[test]
    fn of_what_stands_on_ignored_ground_the_picture_is_asked_nothing() {
        let corners = [[20.0, -1.0], [22.0, -1.0], [22.0, 1.0], [20.0, 1.0]];
        let ground = vec![corners.map(|[x_m, y_m]| Point2 { x_m, y_m }).to_vec()];
        let config = LossConfig::default();
        let target = draw_objects(&[], &ground, &view(), &config);
        let n_asked_nothing = target.iter().filter(|&&weight| weight == ASKED_NOTHING).count();
        assert!(
            n_asked_nothing > 30 && target.iter().all(|&weight| weight == 0.0 || weight == ASKED_NOTHING)
        );
        let with_car = draw_objects(&[car(12.0, 0.0, Harm::Harmful)], &ground, &view(), &config);
        let alone = draw_objects(&[car(12.0, 0.0, Harm::Harmful)], &[], &view(), &config);
        assert!(with_car.iter().zip(&alone).all(|(&with, &alone)| alone == 0.0 || with == alone));
        let device = Device::flex();
        let logits = Tensor::<4>::zeros([1, 1, 1, 1], &device);
        let loss: f32 = picture_loss(logits, &[vec![ASKED_NOTHING]]).into_scalar();
        assert!(loss.abs() < 1e-9, "{loss}");
    }
}
