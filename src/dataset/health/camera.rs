//! The camera against the LiDAR: whether the points lie in the picture, and the boxes where their pixels were seen.
//!
//! A flipped or turned mounting of either leaves the picture empty, although every number is valid.

use super::check::{Aspect, Remark};
use crate::dataset::CameraFacts;
use crate::geometry::{Ego, Point};
use crate::object::Object;
use crate::sample::Measured;
use crate::sensors::Rig;

/// Fewer points than this say nothing of a mounting.
const MIN_POINTS: u64 = 1_000;
/// A LiDAR that reports the camera's sector has its points across the picture; few in fog, of which a few are drops.
const MIN_ACROSS_SECTOR: f64 = 0.95;
/// A LiDAR that turns around has there at least this part of what the camera's angle is of a turn.
const MIN_ACROSS_TURN: f64 = 0.25;
/// Of the points across the picture at least this share is in it: measured are 0.5 and more.
const MIN_INSIDE: f64 = 0.15;

/// An object of so many pixels should have its box there.
const MIN_PIXELS: u32 = 100;
/// Its pixels lie in its box's rectangle: measured are at most 1.02 times its area.
const MAX_FILLED: f64 = 1.3;
/// Of so many such objects this share may be beside their boxes.
const MIN_SEEN: u64 = 5;
const MAX_ASTRAY: f64 = 0.2;

/// The points and objects of an episode in its front picture.
pub(super) struct Sight {
    is_log: bool,
    /// Whether the LiDAR reports no more than the camera sees across.
    is_sector: bool,
    /// Whether the visible pixels are those of the front camera.
    is_only_camera: bool,
    angle_rad: f64,
    pub n_points: u64,
    pub n_across: u64,
    pub n_inside: u64,
    n_seen: u64,
    n_astray: u64,
}

impl Sight {
    pub(super) fn new(is_log: bool, rig: Option<&Rig>, is_only_camera: bool) -> Self {
        Self {
            is_log,
            is_sector: rig.is_some_and(|rig| !rig.top().is_full()),
            is_only_camera,
            angle_rad: 0.0,
            n_points: 0,
            n_across: 0,
            n_inside: 0,
            n_seen: 0,
            n_astray: 0,
        }
    }

    /// Adds a sample; `points` are those of the top LiDAR.
    pub(super) fn add(&mut self, measured: &Measured, points: &[Point<Ego>], objects: &[Object]) {
        let (camera, camera_from_ego) = (&measured.intrinsics, measured.ego_from_camera.inverse());
        self.angle_rad = camera.horizontal_fov_rad();
        for point in points {
            self.n_points += 1;
            let Some((u_px, v_px)) = camera.project(&(camera_from_ego * *point)) else { continue };
            self.n_across += u64::from((0.0..f64::from(camera.width_px)).contains(&u_px));
            self.n_inside += u64::from(camera.contains(u_px, v_px));
        }
        if self.is_log || !self.is_only_camera {
            return;
        }
        let facts = CameraFacts::of(measured);
        for object in objects {
            let n_px = object.visible_px.unwrap_or(0);
            if n_px < MIN_PIXELS {
                continue;
            }
            self.n_seen += 1;
            let area = facts.rectangle_of(&object.box_in_ego).map_or(0.0, |rectangle| rectangle.area());
            self.n_astray += u64::from(f64::from(n_px) > MAX_FILLED * area);
        }
    }

    /// Everything odd about the episode's camera.
    pub(super) fn judge(&self) -> Vec<Remark> {
        [self.judge_across(), self.judge_inside(), self.judge_objects()].into_iter().flatten().collect()
    }

    fn judge_across(&self) -> Option<Remark> {
        let across = self.n_across as f64 / self.n_points.max(1) as f64;
        let of_turn = self.angle_rad / std::f64::consts::TAU;
        let (least, of) = if self.is_sector {
            (MIN_ACROSS_SECTOR, "the LiDAR reports what the camera sees across")
        } else {
            (MIN_ACROSS_TURN * of_turn, "the LiDAR turns around")
        };
        (self.n_points >= MIN_POINTS && across < least).then(|| {
            let text = format!(
                "{:.1}% of the points lie between the picture's left and right edge; at least {:.1}% should, since {of}: the \
                 mounting of camera or LiDAR may be wrong",
                100.0 * across,
                100.0 * least
            );
            Remark::unless(self.is_log, Aspect::Camera, "points beside the picture", text)
        })
    }

    fn judge_inside(&self) -> Option<Remark> {
        let inside = self.n_inside as f64 / self.n_across.max(1) as f64;
        (self.n_across >= MIN_POINTS && inside < MIN_INSIDE).then(|| {
            let text = format!(
                "{:.1}% of the points across the picture lie in it; at least {:.0}% should: the mounting of camera or LiDAR \
                 may be wrong",
                100.0 * inside,
                100.0 * MIN_INSIDE
            );
            Remark::unless(self.is_log, Aspect::Camera, "points above or below the picture", text)
        })
    }

    fn judge_objects(&self) -> Option<Remark> {
        let astray = self.n_astray as f64 / self.n_seen.max(1) as f64;
        (self.n_seen >= MIN_SEEN && astray > MAX_ASTRAY).then(|| {
            let text = format!(
                "{} of {} boxes are not where the camera saw their objects' pixels; nearly all should be: the camera's \
                 mounting or the boxes' frame may be wrong",
                self.n_astray, self.n_seen
            );
            Remark::fault(Aspect::Camera, "boxes beside their pixels", text)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::geometry::Transform;
    use nalgebra::Vector3;

    /// The kinds of what is found where the camera looks so.
    fn kinds(is_sector: bool, yaw_rad: f64, pitch_rad: f64) -> Vec<&'static str> {
        let mut sample = test_data::dataset(1).samples()[0].clone();
        let near = |(i, truth): (u32, &Object)| {
            let mut object = truth.clone();
            object.box_in_ego.center = Point::new(8.0 + f64::from(i), f64::from(i) - 2.0, 0.75);
            (object.box_in_ego.yaw_rad, object.visible_px) = (0.0, Some(150));
            object
        };
        let objects: Vec<Object> =
            (0..).zip(sample.objects.iter().map(|object| &object.truth)).map(near).collect();
        let fan = |i: i32, j: i32| {
            let (angle, range_m) = (f64::from(i - 20) * 0.025, 5.0 + f64::from(j));
            Point::<Ego>::new(1.7 + range_m * angle.cos(), range_m * angle.sin(), 1.0)
        };
        let points: Vec<Point<Ego>> = (0..=40).flat_map(|i| (0..40).map(move |j| fan(i, j))).collect();
        sample.measured.ego_from_camera =
            Transform::looking_along(Vector3::new(1.7, 0.0, 1.5), yaw_rad, pitch_rad, 0.0);
        let mut sight = Sight { is_sector, ..Sight::new(false, None, true) };
        sight.add(&sample.measured, &points, &objects);
        sight.judge().iter().map(|remark| remark.kind).collect()
    }

    #[test]
    fn a_camera_that_looks_elsewhere_is_told_by_points_and_boxes() {
        assert_eq!(kinds(true, 0.0, 0.0), [""; 0]);
        assert!(kinds(true, 0.5, 0.0).contains(&"points beside the picture"));
        assert!(kinds(false, 3.0, 0.0).contains(&"points beside the picture"));
        assert!(kinds(false, 0.0, 0.9).contains(&"points above or below the picture"));
        assert!(kinds(false, 3.0, 0.0).contains(&"boxes beside their pixels"));
    }
}
