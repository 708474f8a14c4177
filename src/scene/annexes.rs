//! Lower buildings against the back or the side of a house: walls without windows and one slope away from it.

use super::mesh::TriangleMesh;
use super::occupancy::Footprint;
use super::roofs;
use super::shapes::{Site, rectangle};

/// Height of the walls at their low side, and how much the roof rises to the house.
pub const WALL_M: f64 = 2.3;
const RISE_M: f64 = 1.1;
/// Width of a tile of blank wall.
const TILE_M: f64 = 3.0;

/// Adds an annex: its footprint's length runs along the wall that it leans on, its front away from it. `levels_m`: where
/// its walls end in the ground, and the level of the house.
pub fn add([roof, walls]: [&mut TriangleMesh; 2], annex: &Footprint, levels_m: [f64; 2]) {
    let site = Site { footprint: *annex, base_m: 0.0 };
    let (low_m, top_m) = (levels_m[0], levels_m[1] + WALL_M);
    let outline = rectangle([0.0; 2], [annex.length_m, annex.width_m]);
    for (i, from) in outline.iter().enumerate() {
        let to = outline[(i + 1) % 4];
        let u = (to[0] - from[0]).hypot(to[1] - from[1]) / TILE_M;
        walls.add_polygon(&[
            (site.at(from[0], from[1], low_m), [0.0, low_m / TILE_M]),
            (site.at(to[0], to[1], low_m), [u, low_m / TILE_M]),
            (site.at(to[0], to[1], top_m), [u, top_m / TILE_M]),
            (site.at(from[0], from[1], top_m), [0.0, top_m / TILE_M]),
        ]);
    }
    roofs::add([roof, walls], annex, [top_m, RISE_M], true);
}
