//! The land beside roads and pavements: its triangles, and the height of what is seen at a place.

use super::ground::{GRASS_M, Grid, PAVEMENT_M};
use super::mesh::TriangleMesh;
use super::path::Vec2;
use super::surface::Surface;

/// Cells of the terrain that is drawn.
const TERRAIN_CELL_M: f64 = 4.0;

/// Under paving, the terrain lies this much deeper, so that none comes through.
const UNDER_PAVING_M: f64 = 0.15;

impl Surface {
    /// Height of the surface that is seen at a place: road, pavement, or the land beside them.
    pub fn level_m(&self, point: Vec2) -> f64 {
        if self.road_grid.clearance_m(point) < 0.0 {
            self.ground_m(point)
        } else if self.paved_grid.clearance_m(point) < 0.0 {
            self.ground_m(point) + PAVEMENT_M
        } else {
            self.land_m(point)
        }
    }

    /// Height of the land's triangles, as [`Self::meshes`] draws them.
    fn land_m(&self, point: Vec2) -> f64 {
        let Some(grid) = self.ground.grid() else { return GRASS_M };
        let stride = terrain_stride(grid);
        let cells = (point - grid.origin) / (grid.cell_m * stride as f64);
        let (x, y) = (cells.x.floor(), cells.y.floor());
        let (i, j) = (x.max(0.0) as usize * stride, y.max(0.0) as usize * stride);
        if x < 0.0 || y < 0.0 || i + stride >= grid.n_x || j + stride >= grid.n_y {
            return GRASS_M;
        }
        let z = |di: usize, dj: usize| self.terrain_node_m(grid, i + di * stride, j + dj * stride);
        let (u, v) = (cells.x - x, cells.y - y);
        let far = z(1, 1);
        // Each cell is cut from its least to its greatest corner.
        if u > v {
            z(0, 0) + u * (z(1, 0) - z(0, 0)) + v * (far - z(1, 0))
        } else {
            z(0, 0) + v * (z(0, 1) - z(0, 0)) + u * (far - z(0, 1))
        }
    }

    /// Height at which the land is drawn at a node.
    fn terrain_node_m(&self, grid: &Grid, i: usize, j: usize) -> f64 {
        let under_m = if self.paved_grid.clearance_m(grid.node(i, j)) < 0.0 { UNDER_PAVING_M } else { 0.0 };
        grid.z_at(i, j) + GRASS_M - under_m
    }

    /// The land between the roads, where it is not flat.
    pub(super) fn add_terrain(&self, terrain: &mut TriangleMesh, is_near: impl Fn(Vec2) -> bool) {
        let Some(grid) = self.ground.grid() else { return };
        let stride = terrain_stride(grid);
        let corner = |i: usize, j: usize| {
            let at = grid.node(i, j);
            let tile_m = 4.0;
            ([at.x, at.y, self.terrain_node_m(grid, i, j)], [at.x / tile_m, at.y / tile_m])
        };
        for j in (0..grid.n_y.saturating_sub(stride)).step_by(stride) {
            for i in (0..grid.n_x.saturating_sub(stride)).step_by(stride) {
                if is_near(grid.node(i, j)) {
                    let ends = [(i, j), (i + stride, j), (i + stride, j + stride), (i, j + stride)];
                    terrain.add_polygon(&ends.map(|(i, j)| corner(i, j)));
                }
            }
        }
    }
}

/// Nodes of the grid from one corner of the land's triangles to the next.
fn terrain_stride(grid: &Grid) -> usize {
    (TERRAIN_CELL_M / grid.cell_m).round().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use super::super::town::Town;
    use super::*;

    #[test]
    fn things_stand_on_the_land_as_it_is_drawn() {
        let surface = Town::load("hillside").unwrap().surface;
        let mut terrain = TriangleMesh::default();
        surface.add_terrain(&mut terrain, |_| true);
        let mut n = 0;
        for [a, b, c] in terrain.corners().into_iter().step_by(37) {
            let middle = (a.coords + b.coords + c.coords) / 3.0;
            let at = Vec2::new(f64::from(middle.x), f64::from(middle.y));
            if surface.paved_grid.clearance_m(at) > 0.0 && surface.road_grid.clearance_m(at) > 0.0 {
                assert!((surface.level_m(at) - f64::from(middle.z)).abs() < 2e-3, "{at}");
                n += 1;
            }
        }
        assert!(n > 100, "{n} triangles");
        assert!(
            (Town::load("downtown").unwrap().surface.level_m(Vec2::new(900.0, 900.0)) - GRASS_M).abs()
                < 1e-12
        );
    }
}
