//! The global frame of an export and its map masks: the devkit draws pixels of 0.1 m, none left of or below the origin.
//!
//! So an episode's world is shifted by whole metres until its drawing lies right of and above the origin. What else is in the data
//! set has no part in it: results on one export fit every data set that has the episode. A log of nuScenes keeps its own global
//! frame, and an episode without a drawing is not shifted.

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

/// Of each episode, by its name, the shift from its world to the global frame, and the size of its mask.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GlobalFrames {
    episodes: BTreeMap<String, Bounds>,
}

/// What an episode's drawing covers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bounds {
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
                frames.take(&entry.name, &reader.map()?);
            }
        }
        Ok(frames)
    }

    fn take(&mut self, episode: &str, map: &MapDrawing) {
        let mut bounds: Option<Bounds> = None;
        for point in map.drivable_area.iter().flatten().chain(map.lane_lines.iter().flatten()) {
            let at_m = [point.x(), point.y()];
            let bounds = bounds.get_or_insert(Bounds { low_m: at_m, high_m: at_m });
            for (axis, value) in at_m.into_iter().enumerate() {
                bounds.low_m[axis] = bounds.low_m[axis].min(value);
                bounds.high_m[axis] = bounds.high_m[axis].max(value);
            }
        }
        self.episodes.extend(bounds.map(|bounds| (episode.to_owned(), bounds)));
    }

    /// What is added to an episode's world coordinates; none to heights.
    #[must_use]
    pub fn shift_m(&self, episode: &str) -> Vector3<f64> {
        let Some(bounds) = self.episodes.get(episode) else { return Vector3::zeros() };
        let [x, y] = bounds.low_m.map(|low_m| (MARGIN_M - low_m).ceil());
        Vector3::new(x, y, 0.0)
    }

    /// The transform that shifts an episode's world into the global frame.
    #[must_use]
    pub fn global_from_world(&self, episode: &str) -> Transform<World, World> {
        Transform::new(self.shift_m(episode), nalgebra::UnitQuaternion::identity())
    }

    /// An episode's mask: white where its drawing has drivable area.
    pub(super) fn mask(&self, episode: &str, map: &MapDrawing) -> GrayImage {
        let shift_m = self.shift_m(episode);
        let mut mask = match self.episodes.get(episode) {
            None => GrayImage::new(EMPTY_SIDE_PX, EMPTY_SIDE_PX),
            Some(bounds) => {
                let side = |axis: usize| {
                    let high_m = bounds.high_m[axis] + shift_m[axis] + MARGIN_M;
                    (high_m * PX_PER_M).ceil().min(MAX_SIDE_PX) as u32
                };
                GrayImage::new(side(0), side(1))
            }
        };
        let height_px = mask.height();
        for triangle in &map.drivable_area {
            fill(&mut mask, &triangle.map(|corner| to_pixel(&corner, shift_m, height_px)));
        }
        mask
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
        frames.take("a", &map);
        let alone = frames.shift_m("a");
        assert_eq!(alone, Vector3::new(80.0, 71.0, 0.0));
        let mask = frames.mask("a", &map);
        assert_eq!(mask.dimensions(), (1200, 1210));
        // As in the devkit's `to_pixel_coords`: column x / 0.1, row height - y / 0.1.
        let at = |x: f64, y: f64| mask.get_pixel((x * 10.0) as u32, 1210 - (y * 10.0) as u32 - 1).0[0];
        assert_eq!([at(69.0, 55.0), at(52.0, 68.0), at(100.0, 55.0)], [255, 0, 0]);
        let empty = MapDrawing { lane_lines: Vec::new(), drivable_area: Vec::new() };
        frames.take("b", &empty);
        assert_eq!(
            (frames.shift_m("b"), frames.mask("b", &empty).dimensions()),
            (Vector3::zeros(), (100, 100))
        );
        // Another episode of the town, farther left, moves nothing.
        frames.take("c", &MapDrawing { drivable_area: vec![[corner(-90.0, 0.0); 3]], ..empty });
        assert_eq!((frames.shift_m("a"), frames.shift_m("c").x), (alone, 140.0));
    }
}
