//! Scenery that only some towns have: landmarks, stacks of containers, dry-stone walls, basins and tracks.

use super::builder::Builder;
use super::dry_walls;
use super::ground::{GRASS_M, PAVEMENT_M};
use super::landmarks::{CONTAINER_COLORS, Cladding, LandmarkMeshes};
use super::mesh::TriangleMesh;
use super::path::{Path, Vec2};
use super::shapes::Site;
use super::textures;
use super::water;
use super::world::World;
use crate::random;

/// Room of a container with its gaps: length and width; length of a short one; how many stand on each other at most.
const CONTAINER_M: [f64; 2] = [12.3, 2.56];
const SHORT_CONTAINER_M: f64 = 6.2;
const HIGHEST_STACK: usize = 3;
/// A rail's head, and how far it stands out of the ground.
const RAIL_M: f64 = 0.075;
const RAIL_OVER_M: f64 = 0.02;
/// Pieces of rails.
const PIECE_M: f64 = 6.0;
/// Rows of stones in a tile of dry walls and of masonry, and its side.
const STONES: u32 = 16;
const STONES_TILE_M: f64 = 3.0;

impl World {
    pub(super) fn add_town_scenery(&self, builder: &mut Builder) {
        self.add_landmarks(builder);
        let is_in_sight = self.is_in_sight();
        let walls = dry_walls::mesh(&self.town.walls, &self.town.surface.ground, is_in_sight);
        if !walls.is_empty() {
            builder.texture("scene_dry_walls", textures::rubble("dry stone", [142, 136, 124], STONES));
            builder.mesh("scene_dry_walls", "scene_dry_walls", &walls.with_tiles(STONES_TILE_M));
        }
        self.add_tracks(builder);
    }

    fn add_landmarks(&self, builder: &mut Builder) {
        let is_in_sight = self.is_in_sight();
        let mut meshes = LandmarkMeshes::default();
        let water_m = self.town.config.water_level_m;
        for landmark in self.town.landmarks.iter().filter(|it| is_in_sight(it.footprint.center)) {
            let corners = landmark.footprint.corners().map(|at| Vec2::new(at.x_m, at.y_m));
            let heights = corners.map(|at| self.town.surface.ground_m(at));
            meshes.add(landmark, heights.into_iter().fold(f64::MIN, f64::max) + GRASS_M, water_m);
        }
        for (i, stack) in self.town.stacks.iter().enumerate().filter(|(_, it)| is_in_sight(it.center)) {
            let mut rng = random::stream(i as u64, "container-stack", 0);
            let base_m = self.town.surface.ground_m(stack.center) + GRASS_M;
            let is_long = i % 3 != 0;
            let length_m = if is_long { CONTAINER_M[0] } else { SHORT_CONTAINER_M };
            let count = |room_m: f64, each_m: f64| ((room_m / each_m) as usize).max(1);
            // Room to walk round the stack.
            let n_across = count(stack.width_m - 1.0, CONTAINER_M[1]);
            let n = [count(stack.length_m, length_m), n_across, HIGHEST_STACK];
            meshes.add_stack(&Site { footprint: *stack, base_m }, n, is_long, &mut rng);
        }
        for cladding in Cladding::all().filter(|&cladding| !meshes.of(cladding).is_empty()) {
            let name = format!("scene_landmark_{cladding:?}").replace(['(', ')'], "").to_lowercase();
            match cladding {
                Cladding::Container(color) => {
                    builder.texture(&name, textures::corrugated(&name, CONTAINER_COLORS[color]));
                }
                Cladding::CraneSteel => builder.plain(&name, [0.13, 0.3, 0.44]),
                Cladding::DarkSteel => builder.plain(&name, [0.2, 0.2, 0.21]),
                Cladding::Hull => builder.plain(&name, [0.26, 0.1, 0.09]),
                Cladding::White => builder.plain(&name, [0.78, 0.78, 0.75]),
                Cladding::Concrete => {
                    builder.texture(&name, textures::grain("silo", [158, 154, 146], 0.1, 0.05));
                }
                Cladding::Masonry => builder.texture(&name, textures::rubble(&name, [156, 148, 132], STONES)),
                Cladding::Slate => builder.texture(&name, textures::tiles([74, 76, 82])),
                Cladding::Dark => builder.plain(&name, [0.1, 0.11, 0.13]),
            }
            let tile_m = if cladding == Cladding::Masonry { STONES_TILE_M } else { 1.0 };
            builder.mesh(&name, &name, &meshes.of(cladding).with_tiles(tile_m));
        }
    }

    /// Land with basins in place of the plane. Returns whether the town has any.
    pub(super) fn add_basins(&self, builder: &mut Builder) -> bool {
        let (config, basins) = (&self.town.config, self.town.basins());
        if basins.is_empty() {
            return false;
        }
        let meshes = water::meshes(basins, [GRASS_M, config.water_level_m], self.is_in_sight());
        builder.asset.push_str(
            "<material name=\"scene_land\" texture=\"scene_grass\" specular=\"0\" shininess=\"0\"/>\n",
        );
        builder.ground("scene_grass_land", "scene_land", &meshes.land);
        builder.texture("scene_water", textures::water());
        builder.mesh("scene_water", "scene_water", &meshes.water);
        builder.texture("scene_quay", textures::grain("quay", [128, 124, 114], 0.2, 0.08));
        builder.mesh("scene_quay", "scene_quay", &meshes.quay);
        builder.plain("scene_mooring", [0.16, 0.15, 0.14]);
        builder.mesh("scene_mooring", "scene_mooring", &meshes.bollards);
        builder.plain("scene_quay_railings", [0.55, 0.53, 0.2]);
        builder.mesh("scene_quay_railings", "scene_quay_railings", &meshes.railings);
        true
    }

    /// Rails, flush with what is paved.
    fn add_tracks(&self, builder: &mut Builder) {
        let is_in_sight = self.is_in_sight();
        let mut rails = TriangleMesh::default();
        for track in &self.town.config.tracks {
            let ends = [track.from_m, track.to_m].map(|[x, y]| Vec2::new(x, y));
            let Some(line) = Path::new(ends) else { continue };
            let n = (line.length_m() / PIECE_M).ceil();
            for left_m in [-0.5, 0.5].map(|side| side * track.gauge_m) {
                for k in 0..n as usize {
                    let s_m = [k as f64, k as f64 + 1.0].map(|k| line.length_m() * k / n);
                    if !is_in_sight(line.at(s_m[0])) {
                        continue;
                    }
                    let at = |s_m: f64, aside_m: f64| {
                        let at = line.beside(s_m, left_m + aside_m);
                        ([at.x, at.y, self.paved_m(at) + RAIL_OVER_M], [s_m, aside_m])
                    };
                    let half_m = RAIL_M / 2.0;
                    let corners =
                        [at(s_m[0], -half_m), at(s_m[1], -half_m), at(s_m[1], half_m), at(s_m[0], half_m)];
                    rails.add_polygon(&corners);
                }
            }
        }
        if !rails.is_empty() {
            builder.plain("scene_rails", [0.3, 0.28, 0.27]);
            builder.mesh("scene_rails", "scene_rails", &rails);
        }
    }

    /// Height of what lies at a place: road, pavement or open land.
    fn paved_m(&self, at: Vec2) -> f64 {
        let surface = &self.town.surface;
        let over_m = if surface.road_grid.clearance_m(at) < 0.0 {
            0.0
        } else if surface.paved_grid.clearance_m(at) < 0.0 {
            PAVEMENT_M
        } else {
            GRASS_M
        };
        surface.ground_m(at) + over_m
    }
}
