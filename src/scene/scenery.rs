//! Fixed scenery that is not an object: buildings, boundaries of plots, barriers on medians.

use super::builder::Builder;
use super::buildings;
use super::fences::Course;
use super::foliage::{Foliage, HedgeShape};
use super::ground::GRASS_M;
use super::looks::{BoundaryLook, GroundLook, MedianLook};
use super::mesh::TriangleMesh;
use super::path::{Path, Vec2};
use super::surface::{Strip, StripKind, Surface};
use super::textures::{self, Facade};
use super::windows::Floor;
use super::world::World;
use crate::random;
use rand::RngExt;

/// Points of a boundary are at most this far apart.
const STEP_M: f64 = 3.0;
/// Paved stands lie a little over the ground beside streets.
const PAD_M: f64 = GRASS_M + 0.03;
/// Half of a jersey barrier's section as width and height: the F shape, 0.81 m high.
const BARRIER_M: [(f64, f64); 4] = [(0.30, 0.0), (0.30, 0.075), (0.17, 0.255), (0.12, 0.81)];

/// Windows lie back in walls that are no farther than this from the route.
const WINDOWS_M: f64 = 30.0;

impl World {
    /// Adds buildings, boundaries and barriers near the ego's route.
    pub(super) fn add_scenery(&self, builder: &mut Builder) {
        self.add_buildings(builder);
        self.add_pads(builder);
        self.add_boundaries(builder);
        self.add_town_scenery(builder);
        self.add_trimmings(builder);
        self.add_lawns(builder);
    }

    fn height_m(&self) -> impl Fn(Vec2) -> f64 + '_ {
        |at| self.town.surface.ground.height_m(at)
    }

    fn add_buildings(&self, builder: &mut Builder) {
        let config = &self.town.config;
        let meshes = buildings::meshes(
            &self.town.buildings,
            config,
            self.height_m(),
            self.is_in_sight(),
            self.is_within(WINDOWS_M),
        );
        let floors = meshes.facades.iter().zip(&meshes.ground_floors).zip(&meshes.blank);
        for (i, ((facade, ground_floor), blank)) in floors.enumerate() {
            let look = Facade {
                look: config.facades[i % config.facades.len()],
                wall: config.wall_colors[i].0,
                trim: config.trim_colors[i % config.trim_colors.len()].0,
            };
            for (part, floor, mesh) in [
                ("facade", Floor::Upper, facade),
                ("shop", Floor::Ground, ground_floor),
                ("gable", Floor::Blank, blank),
            ] {
                if !mesh.is_empty() {
                    let name = format!("scene_{part}_{i}");
                    builder.texture(&name, textures::facade(&name, look, floor));
                    builder.mesh(&name, &name, mesh);
                }
            }
        }
        for (i, roof) in meshes.roofs.iter().enumerate() {
            let name = format!("scene_roof_{i}");
            builder.texture(&name, textures::tiles(config.roof_colors[i].0));
            builder.mesh(&name, &name, roof);
        }
        builder.plain("scene_stone", [0.66, 0.63, 0.58]);
        builder.mesh("scene_stone", "scene_stone", &meshes.stone);
        builder.plain("scene_doors", [0.2, 0.26, 0.24]);
        builder.mesh("scene_doors", "scene_doors", &meshes.doors);
        if !meshes.railings.is_empty() {
            builder.texture("scene_railings", textures::bars([52, 50, 50], config.wall_colors[0].0));
            builder.mesh("scene_railings", "scene_railings", &meshes.railings);
        }
    }

    /// Paved ground under the places where vehicles stand.
    fn add_pads(&self, builder: &mut Builder) {
        let (is_in_sight, height_m) = (self.is_in_sight(), self.height_m());
        let mut mesh = TriangleMesh::default();
        for stand in self.town.stands.iter().filter(|stand| is_in_sight(stand.footprint.center)) {
            let footprint = &stand.footprint;
            let (half_m, side_m) = (footprint.length_m / 2.0 + 0.5, footprint.width_m / 2.0 + 0.35);
            let at = |x: f64, y: f64| {
                let at = footprint.at(x, y);
                ([at.x, at.y, height_m(at) + PAD_M], [at.x / 4.0, at.y / 4.0])
            };
            let n = (footprint.length_m / STEP_M).ceil() as usize;
            let x = |i: usize| half_m * (2.0 * i as f64 / n as f64 - 1.0);
            for i in 0..n {
                mesh.add_polygon(&[
                    at(x(i), -side_m),
                    at(x(i + 1), -side_m),
                    at(x(i + 1), side_m),
                    at(x(i), side_m),
                ]);
            }
        }
        if !mesh.is_empty() {
            builder.texture("scene_pads", textures::ground(GroundLook::Concrete));
            builder.mesh("scene_pads", "scene_pads", &mesh);
        }
    }

    fn add_boundaries(&self, builder: &mut Builder) {
        let (is_in_sight, height_m) = (self.is_in_sight(), self.height_m());
        let is_near = |line: &Path| is_in_sight(line.at(line.length_m() / 2.0));
        let is_close = self.is_close();
        let mut foliage = Foliage::default();
        let mut steel = TriangleMesh::default();
        let mut bars: [TriangleMesh; 2] = Default::default();
        let mut meshes: [TriangleMesh; 6] = Default::default();
        let [hedge, fence, wall, railings, concrete, dry_stone] = &mut meshes;
        for (i, boundary) in self.town.boundaries.iter().enumerate().filter(|(_, of)| is_near(&of.line)) {
            let line = &boundary.line;
            let course = Course { line, height_m: &height_m };
            let mut rng = random::stream(0, "boundary", i as u64);
            let is_close = is_close(line.at(0.0)) || is_close(line.at(line.length_m()));
            match (boundary.look, is_close) {
                // Far away a chain-link fence is as good as clear.
                (BoundaryLook::Open, _) | (BoundaryLook::ChainLink, false) => {}
                (BoundaryLook::Hedge, true) => {
                    let height_m = 0.9 + 0.7 * rng.random::<f64>();
                    let shape = HedgeShape { width_m: 0.6, height_m, is_wild: false };
                    foliage.add_hedge(line, shape, course.height_m, &mut rng);
                }
                (BoundaryLook::WildHedge, true) => {
                    let (height_m, width_m) =
                        (1.0 + 1.4 * rng.random::<f64>(), 0.6 + 0.4 * rng.random::<f64>());
                    let shape = HedgeShape { width_m, height_m, is_wild: true };
                    foliage.add_hedge(line, shape, course.height_m, &mut rng);
                }
                (BoundaryLook::Fence, true) => course.add_bars(&mut bars[0], 0.15, 0.09, 1.0, &mut rng),
                (BoundaryLook::Railings, true) => course.add_bars(&mut bars[1], 0.13, 0.025, 2.0, &mut rng),
                (BoundaryLook::Hedge | BoundaryLook::WildHedge, false) => {
                    add_wall(hedge, line, 0.6, 1.3, &height_m);
                }
                (BoundaryLook::Fence, false) => add_wall(fence, line, 0.06, 1.0, &height_m),
                (BoundaryLook::Railings, false) => add_wall(railings, line, 0.06, 2.0, &height_m),
                (BoundaryLook::ChainLink, true) => course.add_chain_link(&mut steel),
                (BoundaryLook::DryStone, _) => add_wall(dry_stone, line, 0.45, 0.9, &height_m),
                (BoundaryLook::GuardRail, true) => course.add_guard_rail(&mut steel),
                (BoundaryLook::GuardRail, false) => course.add_far_rail(&mut steel),
                (BoundaryLook::Wall, is_close) => {
                    add_wall(wall, line, 0.25, 1.1, &height_m);
                    if is_close {
                        course.add_relief(wall, 0.25, 1.1, &mut rng);
                    }
                }
            }
        }
        let median = self.town.config.median;
        if median != MedianLook::Open {
            for line in median_lines(&self.town.surface).iter().filter(|line| is_near(line)) {
                match median {
                    MedianLook::Barrier => add_barrier(concrete, line, &height_m),
                    MedianLook::GuardRail => {
                        Course { line, height_m: &height_m }.add_guard_rail(&mut steel);
                        let back = line.reversed();
                        Course { line: &back, height_m: &height_m }.add_guard_rail(&mut steel);
                    }
                    _ => add_wall(hedge, line, 0.8, 1.0, &height_m),
                }
            }
        }
        let looks = [
            ("scene_hedge", textures::leaves([62, 92, 44])),
            ("scene_fence", textures::bars([150, 120, 88], [96, 84, 66])),
            ("scene_wall", textures::grain("wall", [178, 166, 148], 0.16, 0.05)),
            ("scene_yard", textures::bars([126, 130, 134], [92, 96, 98])),
            ("scene_barrier", textures::grain("concrete", [168, 166, 160], 0.12, 0.04)),
            ("scene_dry_stone", textures::rubble("garden wall", [148, 142, 130], 6)),
        ];
        for ((name, png), mesh) in looks.into_iter().zip(&meshes) {
            if !mesh.is_empty() {
                builder.texture(name, png);
                builder.mesh(name, name, mesh);
            }
        }
        for (name, rgb, mesh) in [
            ("scene_hedge_0", [0.09, 0.17, 0.07], &foliage.core),
            ("scene_hedge_1", [0.16, 0.30, 0.11], &foliage.dark),
            ("scene_hedge_2", [0.27, 0.42, 0.17], &foliage.light),
            ("scene_fence_0", [0.55, 0.44, 0.32], &bars[0]),
            ("scene_yard_0", [0.30, 0.31, 0.32], &bars[1]),
            ("scene_steel", [0.60, 0.62, 0.63], &steel),
        ] {
            if !mesh.is_empty() {
                builder.plain(name, rgb);
                builder.mesh(name, name, mesh);
            }
        }
    }
}

/// Middles of medians: between the two median lanes of a road, or along the single one.
fn median_lines(surface: &Surface) -> Vec<Path> {
    let medians: Vec<&Strip> = surface.strips.iter().filter(|strip| strip.kind == StripKind::Grass).collect();
    let mut lines = Vec::new();
    for (i, strip) in medians.iter().enumerate() {
        let edge = |side: f64| {
            let points = strip.center.points_every(STEP_M);
            let n = points.len() - 1;
            let at = |k: usize| strip.center.length_m() * k as f64 / n as f64;
            Path::new((0..=n).map(|k| strip.center.beside(at(k), side * strip.width_m / 2.0)))
        };
        let is_shared = |line: &Path, other: &Strip| {
            let middle = line.at(line.length_m() / 2.0);
            (other.center.distance_m(middle) - other.width_m / 2.0).abs() < 0.1
        };
        let shared = [-1.0, 1.0].into_iter().filter_map(edge).find_map(|line| {
            let other = (0..medians.len()).find(|&j| j != i && is_shared(&line, medians[j]))?;
            Some((other, line))
        });
        match shared {
            // Both lanes find it; the first one adds it.
            Some((other, line)) if i < other => lines.push(line),
            Some(_) => {}
            None => lines.push(strip.center.clone()),
        }
    }
    lines
}

/// Offsets of a section to the right of a line at its points, with the ground's height.
fn ribs(line: &Path, height_m: &dyn Fn(Vec2) -> f64) -> Vec<(Vec2, Vec2, f64, f64)> {
    let n = (line.length_m() / STEP_M).ceil().max(1.0) as usize;
    (0..=n)
        .map(|i| {
            let s_m = line.length_m() * i as f64 / n as f64;
            let (at, along) = (line.at(s_m), line.direction(s_m));
            (at, Vec2::new(along.y, -along.x), s_m, height_m(at))
        })
        .collect()
}

/// A wall of a constant section along a line: two faces, a top, two ends. A tile is a metre.
fn add_wall(mesh: &mut TriangleMesh, line: &Path, width_m: f64, wall_m: f64, height_m: &dyn Fn(Vec2) -> f64) {
    let section = [(width_m / 2.0, 0.0), (width_m / 2.0, wall_m)];
    add_section(mesh, line, &section, height_m);
}

fn add_barrier(mesh: &mut TriangleMesh, line: &Path, height_m: &dyn Fn(Vec2) -> f64) {
    add_section(mesh, line, &BARRIER_M, height_m);
}

/// Extrudes a section, mirrored to both sides: half widths and heights from the foot to the top.
fn add_section(mesh: &mut TriangleMesh, line: &Path, half: &[(f64, f64)], height_m: &dyn Fn(Vec2) -> f64) {
    let ribs = ribs(line, height_m);
    // From the right foot over the top to the left foot.
    let mut section: Vec<(f64, f64)> = half.to_vec();
    section.extend(half.iter().rev().map(|&(right, up)| (-right, up)));
    section[0].1 -= 0.3;
    let last = section.len() - 1;
    section[last].1 -= 0.3;
    let mut around_m = vec![0.0];
    for pair in section.windows(2) {
        let step_m = (pair[1].0 - pair[0].0).hypot(pair[1].1 - pair[0].1);
        around_m.push(around_m[around_m.len() - 1] + step_m);
    }
    let at = |rib: &(Vec2, Vec2, f64, f64), k: usize| {
        let at = rib.0 + rib.1 * section[k].0;
        [at.x, at.y, rib.3 + section[k].1]
    };
    for pair in ribs.windows(2) {
        for k in 0..last {
            mesh.add_polygon(&[
                (at(&pair[0], k), [pair[0].2, around_m[k]]),
                (at(&pair[1], k), [pair[1].2, around_m[k]]),
                (at(&pair[1], k + 1), [pair[1].2, around_m[k + 1]]),
                (at(&pair[0], k + 1), [pair[0].2, around_m[k + 1]]),
            ]);
        }
    }
    let end = |rib: &(Vec2, Vec2, f64, f64)| -> Vec<_> {
        (0..=last).map(|k| (at(rib, k), [section[k].0, section[k].1])).collect()
    };
    let first: Vec<_> = end(&ribs[0]);
    let mut final_end = end(&ribs[ribs.len() - 1]);
    final_end.reverse();
    // Seen from before the line's start, the right foot lies on the right.
    mesh.add_polygon(&first);
    mesh.add_polygon(&final_end);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_faces_outwards_and_follows_the_ground() {
        let line = Path::new([Vec2::zeros(), Vec2::new(6.0, 0.0)]).unwrap();
        let mut mesh = TriangleMesh::default();
        add_wall(&mut mesh, &line, 0.4, 1.0, &|at| 0.5 * at.x);
        let triangles = mesh.corners();
        let mut top_m = f32::MIN;
        for [a, b, c] in &triangles {
            let middle = (a.coords + b.coords + c.coords) / 3.0;
            let normal = (b - a).cross(&(c - a));
            let foot = nalgebra::Vector3::new(3.0, 0.0, 1.5);
            let out = middle - foot;
            assert!(normal.x * out.x + normal.y * out.y > 0.0 || normal.z.abs() > 0.1, "{a} {b} {c}");
            top_m = top_m.max(a.z).max(b.z).max(c.z);
        }
        assert!((top_m - 4.0).abs() < 1e-5, "{top_m}");
    }

    #[test]
    fn the_barrier_of_a_road_with_a_median_stands_in_its_middle_once() {
        let town = super::super::Town::load("arterial").unwrap();
        let lines = median_lines(&town.surface);
        assert_eq!(lines.len(), 3, "one for each stretch of the boulevard");
        for line in &lines {
            for point in line.points_every(5.0) {
                assert!(town.surface.road_grid.clearance_m(point) > 0.8);
            }
        }
    }
}
