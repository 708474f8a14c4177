//! Buildings along the outer edges of pavements: boxes with facades of whole bays and floors.

use rand::RngExt;

use super::ground::Ground;
use super::mesh::TriangleMesh;
use super::occupancy::{Footprint, Occupied, StripGrid};
use super::path::{Path, Vec2};
use super::surface::{Strip, StripKind, Surface};
use super::town::TownConfig;
use crate::random::{self, Rng};

/// One tile of a facade texture: a bay's width and a floor's height.
const BAY_M: f64 = 3.0;
const FLOOR_M: f64 = 3.2;
const GROUND_FLOOR_M: f64 = 4.0;

/// A building.
#[derive(Debug, Clone)]
pub struct Building {
    /// Yaw along the street; the front is on the side of `-width`.
    pub footprint: Footprint,
    pub n_floors: u32,
    /// Index of the facade look.
    pub facade: usize,
    pub roof: usize,
}

impl Building {
    #[must_use]
    pub fn height_m(&self) -> f64 {
        GROUND_FLOOR_M + FLOOR_M * f64::from(self.n_floors)
    }
}

/// Number of facade looks and of roof colours.
pub const N_FACADES: usize = 6;
pub const N_ROOFS: usize = 3;

/// Rows of buildings, the same for the same town and seed.
#[must_use]
pub fn grow(surface: &Surface, config: &TownConfig, seed: u64) -> Vec<Building> {
    let mut rng = random::stream(seed, "buildings", 0);
    let mut occupied = Occupied::default();
    let mut buildings = Vec::new();
    let has_pavements = surface.strips.iter().any(|strip| strip.kind == StripKind::Pavement);
    let wanted = if has_pavements { StripKind::Pavement } else { StripKind::Road };
    for strip in surface.strips.iter().filter(|strip| strip.kind == wanted) {
        for side in [-1.0, 1.0] {
            grow_row(strip, side, surface, config, &mut rng, &mut occupied, &mut buildings);
        }
    }
    buildings
}

fn draw(rng: &mut Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

fn grow_row(
    strip: &Strip,
    side: f64,
    surface: &Surface,
    config: &TownConfig,
    rng: &mut Rng,
    occupied: &mut Occupied,
    buildings: &mut Vec<Building>,
) {
    let path: &Path = &strip.center;
    let length_m = path.length_m();
    let mut station_m = 0.0;
    while station_m + 4.0 < length_m {
        let n_bays = (draw(rng, config.building_width_m) / BAY_M).round().max(2.0);
        let mut width_m = n_bays * BAY_M;
        let depth_m = draw(rng, config.building_depth_m);
        let setback_m = draw(rng, config.building_setback_m);
        let n_floors =
            ((draw(rng, config.building_height_m) - GROUND_FLOOR_M) / FLOOR_M).round().max(0.0) as u32;
        let (facade, roof) = (rng.random_range(0..N_FACADES), rng.random_range(0..N_ROOFS));
        let is_wanted = rng.random::<f64>() < config.building_share;
        let gap_m = 0.05 + draw(rng, config.building_gap_m);
        if !is_wanted {
            station_m += width_m;
            continue;
        }
        let mut is_built = false;
        // A narrower house may fit where a wide one does not.
        while width_m >= 2.0 * BAY_M {
            let middle_m = station_m + width_m / 2.0;
            let offset_m = side * (strip.width_m / 2.0 + setback_m + depth_m / 2.0);
            // The yaw puts the street on the building's right, so that its front is at -y.
            let along = path.direction(middle_m) * side;
            let footprint = Footprint {
                center: path.beside(middle_m, offset_m),
                yaw_rad: along.y.atan2(along.x),
                length_m: width_m,
                width_m: depth_m,
            };
            if is_off_the_pavement(&footprint, &surface.paved_grid) && occupied.claim(footprint, 0.02) {
                buildings.push(Building { footprint, n_floors, facade, roof });
                is_built = true;
                break;
            }
            width_m -= BAY_M;
        }
        station_m += if is_built { width_m + gap_m } else { BAY_M };
    }
}

fn is_off_the_pavement(footprint: &Footprint, paved: &StripGrid) -> bool {
    let (sin, cos) = footprint.yaw_rad.sin_cos();
    let n_along = (footprint.length_m / 1.5).ceil() as usize;
    let n_across = (footprint.width_m / 1.5).ceil() as usize;
    (0..=n_along).all(|i| {
        (0..=n_across).all(|j| {
            let x = footprint.length_m * (i as f64 / n_along as f64 - 0.5);
            let y = footprint.width_m * (j as f64 / n_across as f64 - 0.5);
            paved.clearance_m(footprint.center + Vec2::new(x * cos - y * sin, x * sin + y * cos)) > 0.1
        })
    })
}

/// Meshes of all buildings near something: one for each facade, its ground floor, and each roof.
#[derive(Debug, Clone)]
pub struct BuildingMeshes {
    pub facades: Vec<TriangleMesh>,
    pub ground_floors: Vec<TriangleMesh>,
    pub roofs: Vec<TriangleMesh>,
}

/// Builds the meshes of the buildings that `is_near` keeps.
#[must_use]
pub fn meshes(buildings: &[Building], ground: &Ground, is_near: impl Fn(Vec2) -> bool) -> BuildingMeshes {
    let empty = |n: usize| vec![TriangleMesh::default(); n];
    let mut meshes =
        BuildingMeshes { facades: empty(N_FACADES), ground_floors: empty(N_FACADES), roofs: empty(N_ROOFS) };
    for building in buildings.iter().filter(|building| is_near(building.footprint.center)) {
        let corners = building.footprint.corners().map(|corner| [corner.x_m, corner.y_m]);
        let foot = |[x, y]: [f64; 2]| ground.height_m(Vec2::new(x, y));
        let (foot_m, high_m) = corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), corner| {
            (low.min(foot(*corner)), high.max(foot(*corner)))
        });
        // The floors begin at the highest corner; the walls reach down to the lowest.
        let (low_m, top_m) = (high_m + GROUND_FLOOR_M, high_m + building.height_m());
        for i in 0..4 {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            let n_bays = ((to[0] - from[0]).hypot(to[1] - from[1]) / BAY_M).round().max(1.0);
            let wall = |bottom_m: f64, top_m: f64, n_floors: f64| {
                [
                    ([from[0], from[1], bottom_m], [0.0, 0.0]),
                    ([to[0], to[1], bottom_m], [n_bays, 0.0]),
                    ([to[0], to[1], top_m], [n_bays, n_floors]),
                    ([from[0], from[1], top_m], [0.0, n_floors]),
                ]
            };
            meshes.ground_floors[building.facade].add_polygon(&wall(foot_m - 0.1, low_m, 1.0));
            if building.n_floors > 0 {
                let n_floors = f64::from(building.n_floors);
                meshes.facades[building.facade].add_polygon(&wall(low_m, top_m, n_floors));
            }
        }
        meshes.roofs[building.roof].add_flat(&corners, top_m, 4.0);
    }
    meshes
}
