//! Boxes that stand upright in a frame, along a model's heading.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::geometry::{Box3, Frame, Point};

/// The smallest box, upright in a frame and along the model's heading, that holds its (perhaps tilted)
/// bounds.
pub(super) fn upright_box<F: Frame>(frame_from_model: &Isometry3<f64>, bounds: &[Point3<f64>; 2]) -> Box3<F> {
    let corner = |i: usize| {
        let pick = |axis: usize| bounds[i >> axis & 1][axis];
        Point3::new(pick(0), pick(1), pick(2))
    };
    upright_box_of(frame_from_model, (0..8).map(corner))
}

/// As [`upright_box`], for points in the model's frame.
pub(super) fn upright_box_of<F: Frame>(
    frame_from_model: &Isometry3<f64>,
    points: impl Iterator<Item = Point3<f64>>,
) -> Box3<F> {
    let forward = frame_from_model.rotation * Vector3::x();
    let left = frame_from_model.rotation * Vector3::y();
    // A model that stands on its nose has no heading along x; its y axis still gives one.
    let yaw_rad =
        if forward.xy().norm() > 0.1 { forward.y.atan2(forward.x) } else { (-left.x).atan2(left.y) };
    let (sin, cos) = yaw_rad.sin_cos();
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for point in points {
        let at = frame_from_model * point;
        let along_axes = Vector3::new(at.x * cos + at.y * sin, at.y * cos - at.x * sin, at.z);
        low = low.inf(&along_axes);
        high = high.sup(&along_axes);
    }
    let (middle, size) = ((low + high) / 2.0, high - low);
    Box3 {
        center: Point::new(middle.x * cos - middle.y * sin, middle.x * sin + middle.y * cos, middle.z),
        length_m: size.x,
        width_m: size.y,
        height_m: size.z,
        yaw_rad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Ego, World};
    use nalgebra::{Translation3, UnitQuaternion};

    const BOUNDS: [Point3<f64>; 2] = [Point3::new(-2.0, -1.0, 0.0), Point3::new(2.0, 1.0, 1.5)];

    fn at(x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::new(x, y, 0.0), UnitQuaternion::from_euler_angles(0.0, 0.0, yaw))
    }

    #[test]
    fn a_turned_car_keeps_its_own_sizes() {
        let found: Box3<World> = upright_box(&at(10.0, 5.0, 0.7), &BOUNDS);
        let wanted = [10.0, 5.0, 0.75, 4.0, 2.0, 1.5, 0.7];
        let center = found.center;
        let values = [
            center.x(),
            center.y(),
            center.z(),
            found.length_m,
            found.width_m,
            found.height_m,
            found.yaw_rad,
        ];
        assert!(values.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn a_car_on_its_side_is_as_wide_as_it_was_high() {
        let roll = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
        let found: Box3<World> = upright_box(&Isometry3::from_parts(Translation3::identity(), roll), &BOUNDS);
        assert!((found.width_m - 1.5).abs() < 1e-12 && (found.height_m - 2.0).abs() < 1e-12);
    }

    #[test]
    fn on_a_common_slope_a_car_keeps_its_sizes_and_stands_on_the_plane() {
        let slope = UnitQuaternion::from_euler_angles(0.0, -0.1, 0.4);
        let ego = Isometry3::from_parts(Translation3::new(5.0, 1.0, 3.0), slope);
        let ahead = ego * at(20.0, 0.0, 0.0);
        let found: Box3<Ego> = upright_box(&(ego.inverse() * ahead), &BOUNDS);
        assert!((found.center.x() - 20.0).abs() < 1e-9 && (found.center.z() - 0.75).abs() < 1e-9);
        assert!((found.length_m - 4.0).abs() < 1e-9 && (found.height_m - 1.5).abs() < 1e-9);
    }

    #[test]
    fn a_cone_on_its_side_is_not_boxed_below_the_ground() {
        // Base radius 0.5, tip 2 m high; laid down so that tip and rim touch the ground.
        let rim = (0..16).map(|i| std::f64::consts::TAU * f64::from(i) / 16.0);
        let mut points: Vec<Point3<f64>> =
            rim.map(|a| Point3::new(0.5 * a.cos(), 0.5 * a.sin(), 0.0)).collect();
        points.push(Point3::new(0.0, 0.0, 2.0));
        let slant = 2.0_f64.hypot(0.5);
        let turn = UnitQuaternion::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2 + 0.25_f64.atan(), 0.0);
        let lying = Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0 / slant), turn);
        let found: Box3<World> = upright_box_of(&lying, points.iter().copied());
        assert!((found.bottom_m()).abs() < 1e-9, "{found:?}");
        let bounds = [Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 2.0)];
        let loose: Box3<World> = upright_box(&lying, &bounds);
        assert!(loose.bottom_m() < -0.4, "{loose:?}");
    }
}
