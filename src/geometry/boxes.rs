//! Upright 3D boxes: centre, size along their own axes, yaw about +z.

use super::frames::{Frame, Point, Transform};
use super::polygon::Point2;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// An upright box in frame `F`.
///
/// `center` is the middle of the box, `length_m` runs along the box's x axis, `width_m` along y,
/// `height_m` along z; `yaw_rad` turns +x about +z and is zero along the frame's +x.
/// In JSON it is `{"center_m": [x, y, z], "size_m": [length, width, height], "yaw_rad": ..}`.
///
/// ```
/// use harmzone::geometry::{Box3, Ego, Point};
///
/// let car = Box3::<Ego> {
///     center: Point::new(10.0, 2.0, 0.75),
///     length_m: 4.0,
///     width_m: 2.0,
///     height_m: 1.5,
///     yaw_rad: 0.0,
/// };
/// let front_left = car.footprint()[0];
/// assert_eq!((front_left.x_m, front_left.y_m), (12.0, 3.0));
/// assert!(car.contains(&Point::new(8.5, 2.9, 0.2), 0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "BoxInFile", into = "BoxInFile", bound = "")]
pub struct Box3<F: Frame> {
    pub center: Point<F>,
    pub length_m: f64,
    pub width_m: f64,
    pub height_m: f64,
    pub yaw_rad: f64,
}

#[derive(Serialize, Deserialize)]
struct BoxInFile {
    center_m: [f64; 3],
    size_m: [f64; 3],
    yaw_rad: f64,
}

impl<F: Frame> From<Box3<F>> for BoxInFile {
    fn from(of: Box3<F>) -> Self {
        let size_m = [of.length_m, of.width_m, of.height_m];
        Self { center_m: of.center.coords.coords.into(), size_m, yaw_rad: of.yaw_rad }
    }
}

impl<F: Frame> From<BoxInFile> for Box3<F> {
    fn from(BoxInFile { center_m: [x, y, z], size_m, yaw_rad }: BoxInFile) -> Self {
        let [length_m, width_m, height_m] = size_m;
        Self { center: Point::new(x, y, z), length_m, width_m, height_m, yaw_rad }
    }
}

/// What is wrong with a box.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum BoxError {
    #[error("{field} is {found}; a finite number is needed")]
    NotFinite { field: &'static str, found: f64 },
    #[error("{field} is {found}; a size above zero is needed")]
    NotPositive { field: &'static str, found: f64 },
}

impl<F: Frame> Box3<F> {
    /// Checks that all numbers are finite and the sizes above zero.
    ///
    /// # Errors
    /// [`BoxError`] names the first field that is not.
    pub fn check(&self) -> Result<(), BoxError> {
        let Self { center, length_m, width_m, height_m, yaw_rad } = self;
        // Nought times a number is NaN where the number is not finite.
        let of_all = (center.x() + center.y() + center.z() + yaw_rad) * 0.0;
        let is_sized = |size_m: f64| size_m > 0.0 && size_m < f64::INFINITY;
        if of_all == 0.0 && is_sized(*length_m) && is_sized(*width_m) && is_sized(*height_m) {
            return Ok(());
        }
        let fields = [
            ("x_m", self.center.x()),
            ("y_m", self.center.y()),
            ("z_m", self.center.z()),
            ("yaw_rad", self.yaw_rad),
        ];
        let sizes = [("length_m", self.length_m), ("width_m", self.width_m), ("height_m", self.height_m)];
        for (field, found) in fields.into_iter().chain(sizes) {
            if !found.is_finite() {
                return Err(BoxError::NotFinite { field, found });
            }
        }
        for (field, found) in sizes {
            if found <= 0.0 {
                return Err(BoxError::NotPositive { field, found });
            }
        }
        Ok(())
    }

    /// Height of its lowest points.
    #[must_use]
    pub fn bottom_m(&self) -> f64 {
        self.center.z() - self.height_m / 2.0
    }

    /// Height of its highest points.
    #[must_use]
    pub fn top_m(&self) -> f64 {
        self.center.z() + self.height_m / 2.0
    }

    /// Base rectangle, counter-clockwise from the front left corner.
    #[must_use]
    pub fn footprint(&self) -> [Point2; 4] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let (half_length, half_width) = (self.length_m / 2.0, self.width_m / 2.0);
        let signs = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        signs.map(|(along, across)| {
            let (x, y) = (along * half_length, across * half_width);
            Point2 { x_m: self.center.x() + x * cos - y * sin, y_m: self.center.y() + x * sin + y * cos }
        })
    }

    /// The eight corners: the footprint at the bottom, then the footprint at the top.
    #[must_use]
    pub fn corners(&self) -> [Point<F>; 8] {
        let footprint = self.footprint();
        let (low_m, high_m) = (self.bottom_m(), self.top_m());
        std::array::from_fn(|i| {
            let base = footprint[i % 4];
            Point::new(base.x_m, base.y_m, if i < 4 { low_m } else { high_m })
        })
    }

    /// The same box in another frame with a parallel z axis; only the yaw of the transform turns it.
    #[must_use]
    pub fn in_frame<To: Frame>(&self, to_from_f: &Transform<To, F>) -> Box3<To> {
        Box3 {
            center: *to_from_f * self.center,
            length_m: self.length_m,
            width_m: self.width_m,
            height_m: self.height_m,
            yaw_rad: wrap_angle(self.yaw_rad + to_from_f.yaw_rad()),
        }
    }

    /// Whether a point lies inside, with `margin_m` added on every side.
    #[must_use]
    pub fn contains(&self, point: &Point<F>, margin_m: f64) -> bool {
        let offset = point.coords - self.center.coords;
        let (sin, cos) = self.yaw_rad.sin_cos();
        let along = offset.x * cos + offset.y * sin;
        let across = -offset.x * sin + offset.y * cos;
        along.abs() <= self.length_m / 2.0 + margin_m
            && across.abs() <= self.width_m / 2.0 + margin_m
            && offset.z.abs() <= self.height_m / 2.0 + margin_m
    }

    /// How many of the points lie inside.
    #[must_use]
    pub fn count_inside(&self, points: &[Point<F>]) -> u32 {
        // A little more than the footprint's circle, so that rounding loses none.
        let reach_m = self.length_m.hypot(self.width_m) / 2.0 + 1e-6;
        let (x, y) = (self.center.x(), self.center.y());
        let is_near =
            |point: &&Point<F>| (point.x() - x).abs() <= reach_m && (point.y() - y).abs() <= reach_m;
        let n_inside = points.iter().filter(is_near).filter(|point| self.contains(point, 0.0)).count();
        u32::try_from(n_inside).unwrap_or(u32::MAX)
    }
}

/// The same angle in (-pi, pi].
fn wrap_angle(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle_rad.rem_euclid(turn);
    if wrapped > std::f64::consts::PI { wrapped - turn } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Ego, World, polygon_area};
    use proptest::prelude::*;

    fn car(yaw_rad: f64) -> Box3<Ego> {
        Box3 { center: Point::new(10.0, 2.0, 0.75), length_m: 4.0, width_m: 2.0, height_m: 1.5, yaw_rad }
    }

    #[test]
    fn a_quarter_turn_swaps_length_and_width_on_the_ground() {
        let xs = car(std::f64::consts::FRAC_PI_2).footprint().map(|corner| corner.x_m);
        assert!((xs.iter().copied().fold(f64::MIN, f64::max) - 11.0).abs() < 1e-12);
    }

    #[test]
    fn a_nan_size_is_named() {
        let mut broken = car(0.0);
        broken.width_m = f64::NAN;
        assert!(matches!(broken.check(), Err(BoxError::NotFinite { field: "width_m", .. })));
        broken.width_m = 0.0;
        assert!(matches!(broken.check(), Err(BoxError::NotPositive { field: "width_m", .. })));
    }

    proptest! {
        #[test]
        fn a_rigid_motion_keeps_the_footprint_area(x in -50.0..50.0, yaw in -3.0..3.0, turn in -3.0..3.0) {
            let moved = car(yaw).in_frame(&Transform::<World, Ego>::from_xyz_yaw(x, 1.0, 0.0, turn));
            prop_assert!((polygon_area(&moved.footprint()) - 8.0).abs() < 1e-9);
            prop_assert!(moved.yaw_rad > -std::f64::consts::PI - 1e-12 && moved.yaw_rad <= std::f64::consts::PI);
        }
    }
}
