//! The global frame of an export and its map masks: the devkit draws pixels of 0.1 m, none left of or below the origin.
//!
//! So the drawings of a town are shifted by whole metres until they lie right of and above the origin. A log of nuScenes keeps its
//! own global frame, and a town without a drawing is not shifted.

use std::collections::BTreeMap;

use image::{GrayImage, Luma};
use nalgebra::Vector3;

use crate::episode::{EpisodeReader, MapDrawing};
use crate::export::{DataSource, ExportError};
use crate::geometry::{Point, Transform, World};
use crate::interrupt;

/// The devkit's resolution of masks.
const PX_PER_M: f64 = 10.0;
/// Free ground around a drawing, metres: what the devkit draws round an ego.
const MARGIN_M: f64 = 50.0;
/// A mask's largest side, pixels: 2 km, more than nuScenes' towns.
const MAX_SIDE_PX: f64 = 20_000.0;
/// The side of a mask without a drawing, pixels.
const EMPTY_SIDE_PX: u32 = 100;

/// Of each town, the shift from our world to the global frame, and the size of its mask.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GlobalFrames {
    towns: BTreeMap<String, TownFrame>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct TownFrame {
    low_m: [f64; 2],
    high_m: [f64; 2],
}

impl GlobalFrames {
    /// Looks through the drawings of all episodes.
    ///
    /// # Errors
    /// A damaged file, or a signal asks to end.
    pub fn of(source: &DataSource) -> Result<Self, ExportError> {
        let mut frames = Self::default();
        for entry in &source.manifest().episodes {
            interrupt::check()?;
            let reader = EpisodeReader::open_known(source.path(), entry)?;
            if reader.log().is_none_or(|log| log.format != "nuscenes") {
                frames.take(&entry.town, &reader.map()?);
            }
        }
        Ok(frames)
    }

    fn take(&mut self, town: &str, map: &MapDrawing) {
        let points = || map.drivable_area.iter().flatten().chain(map.lane_lines.iter().flatten());
        if points().next().is_none() {
            return;
        }
        let nothing = TownFrame { low_m: [f64::INFINITY; 2], high_m: [f64::NEG_INFINITY; 2] };
        let frame = self.towns.entry(town.to_owned()).or_insert(nothing);
        for point in points() {
            for (axis, value) in [point.x(), point.y()].into_iter().enumerate() {
                frame.low_m[axis] = frame.low_m[axis].min(value);
                frame.high_m[axis] = frame.high_m[axis].max(value);
            }
        }
    }

    /// What is added to a town's world coordinates; none to heights.
    #[must_use]
    pub fn shift_m(&self, town: &str) -> Vector3<f64> {
        let Some(frame) = self.towns.get(town) else { return Vector3::zeros() };
        let [x, y] = frame.low_m.map(|low_m| (MARGIN_M - low_m).ceil());
        Vector3::new(x, y, 0.0)
    }

    /// The transform that shifts a town's world into the global frame.
    #[must_use]
    pub fn global_from_world(&self, town: &str) -> Transform<World, World> {
        Transform::new(self.shift_m(town), nalgebra::UnitQuaternion::identity())
    }

    /// An empty mask of a town.
    pub(super) fn blank_mask(&self, town: &str) -> GrayImage {
        let Some(frame) = self.towns.get(town) else { return GrayImage::new(EMPTY_SIDE_PX, EMPTY_SIDE_PX) };
        let shift_m = self.shift_m(town);
        let side = |axis: usize| {
            let high_m = frame.high_m[axis] + shift_m[axis] + MARGIN_M;
            (high_m * PX_PER_M).ceil().min(MAX_SIDE_PX) as u32
        };
        GrayImage::new(side(0), side(1))
    }
}

/// Fills the drivable area of a drawing; `shift_m` is its town's.
pub(super) fn draw(mask: &mut GrayImage, map: &MapDrawing, shift_m: Vector3<f64>) {
    for triangle in &map.drivable_area {
        fill(mask, &triangle.map(|corner| to_pixel(&corner, shift_m, mask.height())));
    }
}

/// A point of the world in pixels from the mask's upper left corner.
fn to_pixel(point: &Point<World>, shift_m: Vector3<f64>, height_px: u32) -> [f64; 2] {
    [(point.x() + shift_m.x) * PX_PER_M, f64::from(height_px) - (point.y() + shift_m.y) * PX_PER_M]
}

/// Fills a triangle: pixels whose centres lie in it or on its edge.
fn fill(mask: &mut GrayImage, corners: &[[f64; 2]; 3]) {
    let bounds = |axis: usize, n_px: u32| {
        let values = corners.map(|corner| corner[axis]);
        let low = values.into_iter().fold(f64::INFINITY, f64::min).floor().max(0.0);
        let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil().min(f64::from(n_px));
        low as u32..(high.max(0.0) as u32)
    };
    let side = |from: [f64; 2], to: [f64; 2], at: [f64; 2]| {
        (to[0] - from[0]) * (at[1] - from[1]) - (to[1] - from[1]) * (at[0] - from[0])
    };
    let [a, b, c] = *corners;
    for row in bounds(1, mask.height()) {
        for column in bounds(0, mask.width()) {
            let at = [f64::from(column) + 0.5, f64::from(row) + 0.5];
            let sides = [side(a, b, at), side(b, c, at), side(c, a, at)];
            if sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0) {
                mask.put_pixel(column, row, Luma([255]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_town_left_of_the_origin_is_shifted_and_drawn_where_the_devkit_looks() {
        let corner = |x, y| Point::<World>::new(x, y, 0.0);
        let map = MapDrawing {
            lane_lines: Vec::new(),
            drivable_area: vec![[corner(-30.0, -20.5), corner(-10.0, -20.5), corner(-10.0, 0.0)]],
        };
        let mut frames = GlobalFrames::default();
        frames.take("oldtown", &map);
        let shift_m = frames.shift_m("oldtown");
        assert_eq!(shift_m, Vector3::new(80.0, 71.0, 0.0));
        let mut mask = frames.blank_mask("oldtown");
        assert_eq!(mask.dimensions(), (1200, 1210));
        draw(&mut mask, &map, shift_m);
        // As in the devkit's `to_pixel_coords`: column x / 0.1, row height - y / 0.1.
        let at = |x: f64, y: f64| mask.get_pixel((x * 10.0) as u32, 1210 - (y * 10.0) as u32 - 1).0[0];
        assert_eq!([at(69.0, 55.0), at(52.0, 68.0), at(100.0, 55.0)], [255, 0, 0]);
        assert_eq!(frames.shift_m("nowhere"), Vector3::zeros());
        assert_eq!(frames.blank_mask("nowhere").dimensions(), (100, 100));
    }
}
