//! Uneven lawns: humps of earth over the flat ground beside streets, where nothing is paved or built.
//!
//! height = swell (within 6 m) + lumps (from node to node), less near paving, 0.2 m at most. Things keep the flat ground's height,
//! so that lawns hide a hand's breadth of their feet, as grass does.

use rand::RngExt;

use super::builder::Builder;
use super::ground::GRASS_M;
use super::looks::GroundLook;
use super::mesh::TriangleMesh;
use super::path::Vec2;
use super::world::World;
use crate::random;

/// From node to node.
const CELL_M: f64 = 2.0;
/// Lawns are uneven this near to the ego's route.
const REACH_M: f64 = 16.0;
const SWELL_M: f64 = 0.13;
const LUMP_M: f64 = 0.07;
/// Nodes of a lump in a swell.
const SWELL_CELLS: f64 = 3.0;
/// Lawns rise over this width, from the edge of what is paved on.
const EDGE_M: f64 = 0.3;
const RISE_M: f64 = 2.2;
/// Where lawns have no height they lie below the ground.
const UNDER_M: f64 = 0.02;
/// Tiles of the ground's texture.
const TILE_M: f64 = 4.0;
/// Random heights repeat after this many nodes.
const PERIOD: usize = 64;

/// Shares of the height at nodes, 0 to 1.
struct Noise(Vec<f64>);

impl Noise {
    fn new() -> Self {
        let mut rng = random::stream(0, "lawns", 0);
        Self((0..PERIOD * PERIOD).map(|_| rng.random()).collect())
    }

    fn at(&self, i: i64, j: i64) -> f64 {
        let wrap = |k: i64| k.rem_euclid(PERIOD as i64) as usize;
        self.0[wrap(i) * PERIOD + wrap(j)]
    }

    /// Height of a lawn over flat ground at a node.
    fn height_m(&self, i: i64, j: i64) -> f64 {
        let (x, y) = (i as f64 / SWELL_CELLS, j as f64 / SWELL_CELLS);
        let (k, l) = (x.floor() as i64, y.floor() as i64);
        let smooth = |share: f64| share * share * (3.0 - 2.0 * share);
        let (u, v) = (smooth(x - x.floor()), smooth(y - y.floor()));
        let low = self.at(k, l) * (1.0 - u) + self.at(k + 1, l) * u;
        let high = self.at(k, l + 1) * (1.0 - u) + self.at(k + 1, l + 1) * u;
        SWELL_M * (low * (1.0 - v) + high * v) + LUMP_M * self.at(i + 17, j + 31)
    }
}

impl World {
    /// Lawns as a mesh over the ground, near the ego's route.
    pub(super) fn add_lawns(&self, builder: &mut Builder) {
        if self.town.config.ground_texture != GroundLook::Grass {
            return;
        }
        let mesh = self.lawns();
        if !mesh.is_empty() {
            builder.asset.push_str(
                "<material name=\"scene_lawn\" texture=\"scene_grass\" specular=\"0\" shininess=\"0\"/>\n",
            );
            builder.ground("scene_grass_lawn", "scene_lawn", &mesh);
        }
    }

    fn lawns(&self) -> TriangleMesh {
        let is_near = self.is_within(2.0 * REACH_M);
        let (surface, is_close, noise) = (&self.town.surface, self.is_within(REACH_M), Noise::new());
        let points = self.ego_route.path.points_every(8.0);
        let (low, high) = points
            .iter()
            .fold((points[0], points[0]), |(low, high), point| (low.inf(point), high.sup(point)));
        let node = |i: i64, j: i64| Vec2::new(i as f64, j as f64) * CELL_M;
        let first = (low / CELL_M).map(|at| at.floor() as i64 - 10);
        let last = (high / CELL_M).map(|at| at.ceil() as i64 + 10);
        let (n_x, n_y) = ((last.x - first.x + 1) as usize, (last.y - first.y + 1) as usize);
        let buildings: Vec<_> = self.town.buildings.iter().map(|it| it.footprint.grow(0.3)).collect();
        let stands: Vec<_> = self.town.stands.iter().map(|it| it.footprint.grow(1.5)).collect();
        let covers: Vec<_> =
            buildings.iter().chain(&stands).filter(|footprint| is_near(footprint.center)).collect();
        // Height of a lawn at each node near the route, nothing where there is none.
        let mut heights = vec![0.0; n_x * n_y];
        for (n, height_m) in heights.iter_mut().enumerate() {
            let (i, j) = (first.x + (n % n_x) as i64, first.y + (n / n_x) as i64);
            let at = node(i, j);
            if !is_close(at) {
                continue;
            }
            let share = ((surface.paved_grid.clearance_m(at) - EDGE_M) / RISE_M).clamp(0.0, 1.0);
            if share > 0.0 && !covers.iter().any(|footprint| footprint.contains(at)) {
                *height_m = share * noise.height_m(i, j);
            }
        }
        let mut mesh = TriangleMesh::default();
        for j in 0..n_y - 1 {
            for i in 0..n_x - 1 {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                if corners.iter().all(|&(i, j)| heights[j * n_x + i] <= UNDER_M) {
                    continue;
                }
                let polygon = corners.map(|(i, j)| {
                    let at = node(first.x + i as i64, first.y + j as i64);
                    let z_m = surface.ground_m(at) + GRASS_M + heights[j * n_x + i] - UNDER_M;
                    ([at.x, at.y, z_m], [at.x / TILE_M, at.y / TILE_M])
                });
                mesh.add_polygon(&polygon);
            }
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::scene::path::Vec2;
    use crate::scene::{PopulateConfig, Town, populate};

    #[test]
    fn lawns_rise_by_a_decimetre_or_two_and_never_over_what_is_paved() {
        let town = Arc::new(Town::load("suburb").unwrap());
        let world = populate(&town, &PopulateConfig::default(), 4).unwrap();
        let triangles = world.lawns().corners();
        assert!(triangles.len() > 500, "{}", triangles.len());
        let mut highest_m = f64::MIN;
        for corner in triangles.iter().flatten() {
            let at = Vec2::new(corner.x.into(), corner.y.into());
            let over_m = f64::from(corner.z) - town.surface.ground_m(at);
            highest_m = highest_m.max(over_m);
            if town.surface.paved_grid.clearance_m(at) < 0.0 {
                assert!(over_m < -0.06, "{over_m} at {at}");
            }
        }
        assert!((0.05..0.16).contains(&highest_m), "{highest_m}");
    }
}
