//! Small scenery near the ego's route: ivy, awnings, pipes and boxes on facades, tufts of grass, litter, wires.
//!
//! It is the same in every episode of a town, but for the wires, which hang between an episode's poles.

use nalgebra::Vector3;
use rand::RngExt;

use super::builder::Builder;
use super::buildings::{BAY_M, Building};
use super::fences::{add_sheet, add_strip};
use super::foliage::Foliage;
use super::ground::{GRASS_M, PAVEMENT_M};
use super::looks::{FacadeLook, GroundLook};
use super::mesh::TriangleMesh;
use super::path::Vec2;
use super::surface::StripKind;
use super::world::World;
use crate::random;

/// Details stand no farther than this from the route: beyond, beams and pixels miss them.
const DETAIL_M: f64 = 18.0;
/// Grass reaches this far from a pavement or a road.
const VERGE_M: f64 = 4.5;
/// Longest wire between two poles, and how far it sags.
const SPAN_M: f64 = 62.0;
const SAG_M: f64 = 0.6;
/// Lower edge of awnings: people walk below.
const AWNING_M: f64 = 2.45;

#[derive(Default)]
struct Trimmings {
    ivy: Foliage,
    grass: Foliage,
    boxes: TriangleMesh,
    pipes: TriangleMesh,
    awnings: [TriangleMesh; 3],
    litter: TriangleMesh,
    wires: TriangleMesh,
}

impl World {
    /// Whether a point is so near to the route that details count.
    pub(super) fn is_close(&self) -> impl Fn(Vec2) -> bool + use<> {
        self.is_within(DETAIL_M)
    }

    /// Whether a point is this near to the route.
    pub(super) fn is_within(&self, reach_m: f64) -> impl Fn(Vec2) -> bool + use<> {
        let near = self.ego_route.path.points_every(8.0);
        move |point: Vec2| near.iter().any(|other| (point - other).norm() < reach_m)
    }

    pub(super) fn add_trimmings(&self, builder: &mut Builder) {
        let mut made = Trimmings::default();
        let is_close = self.is_close();
        for (i, building) in self.town.buildings.iter().enumerate() {
            if is_close(building.before(0.0, 0.0)) {
                self.trim(building, i as u64, &mut made);
            }
        }
        self.add_ground_cover(&is_close, &mut made);
        self.add_wires(&mut made.wires);
        for (name, rgb, mesh) in [
            ("scene_ivy_0", [0.14, 0.28, 0.10], &made.ivy.dark),
            ("scene_ivy_1", [0.26, 0.40, 0.16], &made.ivy.light),
            ("scene_grass_tufts_0", [0.22, 0.33, 0.13], &made.grass.dark),
            ("scene_grass_tufts_1", [0.45, 0.47, 0.24], &made.grass.light),
            ("scene_fittings", [0.52, 0.51, 0.49], &made.boxes),
            ("scene_pipes", [0.35, 0.34, 0.33], &made.pipes),
            ("scene_awning_0", [0.62, 0.16, 0.14], &made.awnings[0]),
            ("scene_awning_1", [0.16, 0.30, 0.24], &made.awnings[1]),
            ("scene_awning_2", [0.82, 0.76, 0.62], &made.awnings[2]),
            ("scene_litter", [0.70, 0.66, 0.58], &made.litter),
            ("scene_wires", [0.08, 0.08, 0.08], &made.wires),
        ] {
            if !mesh.is_empty() {
                builder.plain(name, rgb);
                builder.mesh(name, name, mesh);
            }
        }
    }

    /// What hangs on the front of a building.
    fn trim(&self, building: &Building, index: u64, made: &mut Trimmings) {
        let mut rng = random::stream(0, "trimmings", index);
        let config = &self.town.config;
        let base_m = building.base_m(&|at| self.town.surface.ground.height_m(at));
        let look = config.facades[building.facade % config.facades.len()];
        let half_m = building.footprint.length_m / 2.0;
        let yaw_rad = building.footprint.yaw_rad;
        if rng.random::<f64>() < 0.2 && !matches!(look, FacadeLook::Glass | FacadeLook::Metal) {
            made.ivy.add_ivy(building, base_m, &mut rng);
        }
        let place = |along_m: f64, out_m: f64, up_m: f64| {
            let at = building.before(along_m, out_m);
            Vector3::new(at.x, at.y, base_m + up_m)
        };
        let height_m = building.height_m();
        for end in [-1.0, 1.0] {
            if rng.random::<f64>() < 0.6 {
                let at = place(end * (half_m - 0.25), 0.07, height_m / 2.0);
                made.pipes.add_box(at.into(), yaw_rad, [0.1, 0.1, height_m]);
            }
        }
        // A plinth, interrupted by the door.
        for end in [-1.0, 1.0] {
            let length_m = half_m - 0.8;
            let at = place(end * (0.8 + length_m / 2.0), 0.02, 0.05);
            made.boxes.add_box(at.into(), yaw_rad, [length_m, 0.08, 0.6]);
        }
        let has_shops = matches!(look, FacadeLook::Brick | FacadeLook::Plaster | FacadeLook::Shutters)
            && config.building_setback_m[1] < 3.5;
        let awning = rng.random_range(0..3);
        for bay in 0..(building.footprint.length_m / BAY_M).round() as u32 {
            let along_m = (f64::from(bay) + 0.5) * BAY_M - half_m;
            if has_shops && rng.random::<f64>() < 0.3 {
                let (left, right) = (along_m - 1.25, along_m + 1.25);
                let depth_m = 0.9 + 0.5 * rng.random::<f64>();
                let slope = [
                    place(left, 0.02, AWNING_M + 0.65),
                    place(right, 0.02, AWNING_M + 0.65),
                    place(right, depth_m, AWNING_M + 0.2),
                    place(left, depth_m, AWNING_M + 0.2),
                ];
                let flap =
                    [slope[3], slope[2], place(right, depth_m, AWNING_M), place(left, depth_m, AWNING_M)];
                add_sheet(&mut made.awnings[awning], slope);
                add_sheet(&mut made.awnings[awning], flap);
            } else if has_shops && rng.random::<f64>() < 0.15 {
                let at = place(along_m + 1.4, 0.45, 2.9);
                made.boxes.add_box(at.into(), yaw_rad, [0.07, 0.75, 0.55]);
            }
            for floor in 0..building.n_floors {
                let up_m = 4.0 + 3.2 * f64::from(floor);
                let draw = rng.random::<f64>();
                if draw < 0.06 {
                    let at = place(along_m + 1.1, 0.2, up_m + 0.6);
                    made.boxes.add_box(at.into(), yaw_rad, [0.8, 0.36, 0.58]);
                } else if draw < 0.3 && look != FacadeLook::Glass {
                    let at = place(along_m, 0.1, up_m + 0.75);
                    made.boxes.add_box(at.into(), yaw_rad, [1.4, 0.22, 0.09]);
                }
            }
        }
    }

    /// Tufts of grass on unpaved ground beside pavements, weeds at walls, and litter.
    fn add_ground_cover(&self, is_close: &dyn Fn(Vec2) -> bool, made: &mut Trimmings) {
        let surface = &self.town.surface;
        let mut rng = random::stream(0, "ground-cover", 0);
        let per_m = match self.town.config.ground_texture {
            GroundLook::Grass => 0.9,
            GroundLook::Dirt | GroundLook::Gravel => 0.4,
            _ => 0.12,
        };
        let has_pavements = surface.strips.iter().any(|strip| strip.kind == StripKind::Pavement);
        let wanted = if has_pavements { StripKind::Pavement } else { StripKind::Road };
        for strip in surface.strips.iter().filter(|strip| strip.kind == wanted) {
            let length_m = strip.center.length_m();
            for side in [-1.0, 1.0] {
                for _ in 0..(length_m * per_m) as u32 {
                    let draws: [f64; 3] = [rng.random(), rng.random(), rng.random()];
                    let out_m = strip.width_m / 2.0 + 0.05 + VERGE_M * draws[1] * draws[2];
                    let at = strip.center.beside(draws[0] * length_m, side * out_m);
                    let is_free =
                        is_close(at) && surface.paved_grid.clearance_m(at) > 0.03 && !self.is_built_over(at);
                    if is_free {
                        made.grass.add_tuft(at, surface.ground_m(at) + GRASS_M, &mut rng);
                    }
                }
            }
            for _ in 0..(length_m * 0.15) as u32 {
                let (along, across) = (rng.random::<f64>(), rng.random::<f64>() - 0.5);
                let at = strip.center.beside(along * length_m, across * strip.width_m);
                if is_close(at) {
                    let half = Vector3::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5, 0.1) * 0.2;
                    let foot = Vector3::new(
                        at.x,
                        at.y,
                        surface.ground_m(at) + if has_pavements { PAVEMENT_M } else { 0.0 },
                    );
                    let other = Vector3::new(-half.y, half.x, 0.12 * rng.random::<f64>());
                    let middle = foot + Vector3::z() * 0.03;
                    add_strip(&mut made.litter, middle - other, middle + other, half);
                }
            }
        }
    }

    fn is_built_over(&self, at: Vec2) -> bool {
        self.town.buildings.iter().any(|building| building.footprint.contains(at))
    }

    /// Wires from each pole to the next ones, and to the nearest house.
    fn add_wires(&self, wires: &mut TriangleMesh) {
        let poles: Vec<_> = self
            .placements
            .iter()
            .filter(|placement| self.models[placement.model].name == "pole")
            .map(|placement| Vector3::new(placement.position.x, placement.position.y, placement.z_m + 6.5))
            .collect();
        for (i, &pole) in poles.iter().enumerate() {
            let span_m = |other: &Vector3<f64>| (other - pole).norm();
            let others = poles[i + 1..].iter().filter(|other| span_m(other) < SPAN_M);
            if let Some(&next) = others.min_by(|a, b| span_m(a).total_cmp(&span_m(b))) {
                let way = next - pole;
                let side = Vector3::new(-way.y, way.x, 0.0).normalize();
                for out_m in [-0.7, -0.3, 0.3, 0.7] {
                    hang(wires, pole + side * out_m, next + side * out_m);
                }
            }
            let fronts = self.town.buildings.iter().map(|building| {
                let at = building.before(0.0, 0.0);
                let ground_m = self.town.surface.ground.height_m(at);
                Vector3::new(at.x, at.y, ground_m + building.height_m().min(5.5) - 0.3)
            });
            if let Some(house) =
                fronts.min_by(|a, b| span_m(a).total_cmp(&span_m(b))).filter(|at| span_m(at) < 30.0)
            {
                hang(wires, pole, house);
            }
        }
    }
}

/// A wire that sags between two points.
fn hang(wires: &mut TriangleMesh, from: Vector3<f64>, to: Vector3<f64>) {
    const PIECES: i32 = 6;
    let at = |i: i32| {
        let share = f64::from(i) / f64::from(PIECES);
        from + (to - from) * share - Vector3::z() * (4.0 * SAG_M * share * (1.0 - share))
    };
    for i in 0..PIECES {
        add_strip(wires, at(i), at(i + 1), Vector3::z() * 0.014);
    }
}
