//! The first geom of each pixel of a camera.

use nalgebra::{Isometry3, Matrix3, Point3};

use super::packet::{Directions, First, PART};
use super::scene::{RayScene, Source};
use super::tree::Stack;
use crate::geometry::Pinhole;

/// Pixels of a tile, whose rays are one packet.
const WIDE: usize = 16;
const HIGH: usize = 8;
/// The rays of a tile's corners.
const CORNERS: [usize; 4] = [0, PART + WIDE / 2 - 1, 3 * PART - WIDE / 2, 4 * PART - 1];

/// Column and row of a tile's ray: quarter by quarter, each row by row.
#[inline(always)]
const fn place_of(ray: usize) -> (usize, usize) {
    let (quarter, at) = (ray / PART, ray % PART);
    (quarter % 2 * (WIDE / 2) + at % (WIDE / 2), quarter / 2 * (HIGH / 2) + at / (WIDE / 2))
}

/// A camera at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraView {
    /// The camera's axes: x right, y down, z forward.
    pub world_from_camera: Isometry3<f64>,
    pub intrinsics: Pinhole,
    /// Depths along the optical axis between which things are seen.
    pub depth_m: [f64; 2],
}

/// A part of a picture in pixels, from its upper left corner to its lower right one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelRegion {
    pub u_px: [f64; 2],
    pub v_px: [f64; 2],
}

impl RayScene {
    /// The parts of a picture in which bodies lie, hidden or not.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn regions_of_bodies(&self, view: &CameraView, bodies: &[usize]) -> Vec<PixelRegion> {
        let mut is_wanted = vec![false; self.world_from_body.len()];
        bodies.iter().for_each(|&body| is_wanted[body] = true);
        let geoms = (0..self.visible.geoms.len()).filter(|&geom| is_wanted[self.visible.geoms[geom].body]);
        geoms.filter_map(|geom| self.region(view, geom)).collect()
    }

    fn region(&self, view: &CameraView, geom: usize) -> Option<PixelRegion> {
        let [low, high] = self.extents[geom]?;
        let geom = &self.visible.geoms[geom];
        let pose = view.world_from_camera.inverse() * self.world_from_body[geom.body] * geom.body_from_geom;
        let corners: [Point3<f64>; 8] = std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            pose * Point3::new(side(0), side(1), side(2))
        });
        let near_m = view.depth_m[0].max(1e-3);
        let mut region: Option<PixelRegion> = None;
        let mut add = |at: Point3<f64>| {
            let Pinhole { fx_px, fy_px, cx_px, cy_px, .. } = view.intrinsics;
            let (u, v) = (cx_px + fx_px * at.x / at.z, cy_px + fy_px * at.y / at.z);
            let [u_px, v_px] = region.map_or([[u, u], [v, v]], |region| {
                [(region.u_px, u), (region.v_px, v)].map(|([low, high], at)| [low.min(at), high.max(at)])
            });
            region = Some(PixelRegion { u_px, v_px });
        };
        for (i, a) in corners.iter().enumerate() {
            if a.z >= near_m {
                add(*a);
            }
            for b in [1, 2, 4].map(|bit| &corners[i ^ bit]) {
                if (a.z < near_m) != (b.z < near_m) {
                    add(a + (b - a) * ((near_m - a.z) / (b.z - a.z)));
                }
            }
        }
        region
    }

    /// The id of the geom that each pixel's centre shows, row by row from the top; -1 where there is none. With
    /// `regions`, only the tiles that they touch are looked at, and all others show nothing.
    #[must_use]
    pub fn first_geoms(&self, view: &CameraView, regions: Option<&[PixelRegion]>) -> Vec<i32> {
        let (n_wide, n_high) = (
            (view.intrinsics.width_px as usize).div_ceil(WIDE),
            (view.intrinsics.height_px as usize).div_ceil(HIGH),
        );
        let mut is_wanted = vec![regions.is_none(); n_wide * n_high];
        for PixelRegion { u_px, v_px } in regions.unwrap_or_default() {
            // A pixel more on each side, against rounding.
            let range = |[low, high]: &[f64; 2], size: usize, n: usize| {
                let tile = |at: f64| (at / size as f64).floor();
                tile(low - 1.0).max(0.0) as usize..(tile(high + 1.0) + 1.0).clamp(0.0, n as f64) as usize
            };
            for row in range(v_px, HIGH, n_high) {
                range(u_px, WIDE, n_wide).for_each(|column| is_wanted[row * n_wide + column] = true);
            }
        }
        let source = self.source(&view.world_from_camera.translation.vector);
        pulp::Arch::new().dispatch(CastTiles {
            scene: self,
            source: &source,
            view,
            is_wanted: &is_wanted,
            n_wide,
        })
    }
}

/// The first geoms of the tiles that are wanted.
struct CastTiles<'a> {
    scene: &'a RayScene,
    source: &'a Source,
    view: &'a CameraView,
    is_wanted: &'a [bool],
    /// Tiles in a row.
    n_wide: usize,
}

impl pulp::WithSimd for CastTiles<'_> {
    type Output = Vec<i32>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Vec<i32> {
        let Pinhole { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = self.view.intrinsics;
        let (width, height) = (width_px as usize, height_px as usize);
        let turn: Matrix3<f32> = self.view.world_from_camera.rotation.to_rotation_matrix().matrix().cast();
        let mut geoms = vec![-1; width * height];
        let mut stacks = [Stack::new(), Stack::new()];
        let [near_m, far_m] = self.view.depth_m.map(|depth_m| depth_m as f32);
        for tile in (0..self.is_wanted.len()).filter(|&tile| self.is_wanted[tile]) {
            let (u, v) = (tile % self.n_wide * WIDE, tile / self.n_wide * HIGH);
            let x: [f32; WIDE] =
                std::array::from_fn(|i| ((u + i) as f64 + 0.5 - cx_px) as f32 / fx_px as f32);
            let y: [f32; HIGH] =
                std::array::from_fn(|i| ((v + i) as f64 + 0.5 - cy_px) as f32 / fy_px as f32);
            // At depth 1, so that parameters are depths.
            let mut rays: Directions<{ WIDE * HIGH }> = [[0.0; WIDE * HIGH]; 3];
            for axis in 0..3 {
                let (right, down, ahead) = (turn[(axis, 0)], turn[(axis, 1)], turn[(axis, 2)]);
                for ray in 0..WIDE * HIGH {
                    let (column, row) = place_of(ray);
                    rays[axis][ray] = right * x[column] + down * y[row] + ahead;
                }
            }
            let middle = [
                ((u + WIDE / 2) as f64 - cx_px) as f32 / fx_px as f32,
                ((v + HIGH / 2) as f64 - cy_px) as f32 / fy_px as f32,
            ];
            let middles = [0, 1].map(|column| {
                let normal = turn.column(column) - turn.column(2) * middle[column];
                [normal[0], normal[1], normal[2]]
            });
            let mut first = First::new(near_m, far_m);
            self.scene.cast_packet(self.source, &rays, &CORNERS, middles, &mut stacks, &mut first);
            let (mut last, mut geom) = (first.thing[0], self.scene.geom_id(first.thing[0]));
            for (ray, &thing) in first.thing.iter().enumerate() {
                let (column, row) = place_of(ray);
                if u + column >= width || v + row >= height {
                    continue;
                }
                if thing != last {
                    (last, geom) = (thing, self.scene.geom_id(thing));
                }
                geoms[(v + row) * width + u + column] = geom;
            }
        }
        geoms
    }
}
