//! Plots along the outer edges of pavements: buildings, and the things before and beside them.

mod houses;

use rand::RngExt;

use super::bend_rails;
use super::buildings::{BAY_M, Building};
use super::dry_walls::{self, DryWall};
use super::landmarks::{self, Landmark};
use super::looks::{BoundaryLook, BuildingStyle};
use super::occupancy::{Footprint, Occupied};
use super::path::{Path, Vec2, direction_of};
use super::surface::{StripKind, Surface};
use super::town_config::{SquareConfig, TownConfig};
use super::water;
use crate::random::{self, Rng};

/// A front garden needs this much room.
const GARDEN_M: f64 = 2.5;
/// A driveway: its width, and where on it the car stands.
const DRIVEWAY_M: f64 = 3.0;
const CAR_M: f64 = 5.2;
/// Loading bays: the room a truck takes before a wall, and their spacing.
const BAY_DEPTH_M: f64 = 9.5;
const BAY_SPACING_M: f64 = 4.5;
/// Least size of a stack of containers.
const LEAST_STACK_M: [f64; 2] = [13.0, 5.5];
/// Gate of a yard.
const GATE_M: f64 = 6.0;

/// A place for a parked vehicle off the street; the yaw is the vehicle's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    pub footprint: Footprint,
}

/// A prop that belongs to a place: a tree in a garden, a bench on a square.
#[derive(Debug, Clone, PartialEq)]
pub struct Furnishing {
    /// Name of the model.
    pub model: String,
    pub position: Vec2,
    pub yaw_rad: f64,
}

/// A hedge, fence or wall along a line.
#[derive(Debug, Clone)]
pub struct Boundary {
    pub look: BoundaryLook,
    pub line: Path,
}

/// All that stands on plots and squares.
#[derive(Debug, Clone, Default)]
pub struct Plots {
    pub buildings: Vec<Building>,
    pub stands: Vec<Stand>,
    pub furnishings: Vec<Furnishing>,
    pub boundaries: Vec<Boundary>,
    pub landmarks: Vec<Landmark>,
    /// Plots that are stacked with containers.
    pub stacks: Vec<Footprint>,
    pub walls: Vec<DryWall>,
}

/// Fills the plots of a town; the same town and seed give the same plots. `terraces`: lines of the walls of terraces.
pub fn grow(surface: &Surface, config: &TownConfig, terraces: &[Path], seed: u64) -> Plots {
    let mut grower = Grower {
        surface,
        config,
        rng: random::stream(seed, "buildings", 0),
        occupied: Occupied::default(),
        plots: Plots::default(),
    };
    for square in &config.squares {
        grower.keep_free(square);
    }
    for landmark in landmarks::place(&config.landmarks) {
        grower.occupied.take(landmark.footprint.grow(1.0));
        grower.plots.landmarks.push(landmark);
    }
    for basin in &config.basins {
        grower.occupied.take(water::footprint(basin).grow(config.apron_m));
    }
    let has_pavements = surface.strips.iter().any(|strip| strip.kind == StripKind::Pavement);
    let wanted = if has_pavements { StripKind::Pavement } else { StripKind::Road };
    for strip in surface.strips.iter().filter(|strip| strip.kind == wanted) {
        for side in [-1.0, 1.0] {
            grower.grow_row(&Frontage { path: &strip.center, side, edge_m: strip.width_m / 2.0 });
        }
    }
    if has_pavements && config.builds_on_bare_roads {
        for strip in surface.strips.iter().filter(|strip| strip.kind == StripKind::Road) {
            for side in [-1.0, 1.0].into_iter().filter(|&side| surface.is_bare(strip, side)) {
                grower.grow_row(&Frontage { path: &strip.center, side, edge_m: strip.width_m / 2.0 });
            }
        }
    }
    let mut squares = Occupied::default();
    for square in &config.squares {
        grower.furnish_square(square, &mut squares);
    }
    let Grower { mut occupied, mut plots, .. } = grower;
    plots.walls = dry_walls::along_roads(surface, config.retaining_wall_m, &mut occupied);
    let fences: Vec<&Path> = plots.boundaries.iter().map(|boundary| &boundary.line).collect();
    let rails = bend_rails::along_bends(surface, config.bend_rail_share, &fences, &mut occupied);
    plots.boundaries.extend(rails.into_iter().map(|line| Boundary { look: BoundaryLook::GuardRail, line }));
    plots.walls.extend(dry_walls::on_terraces(
        terraces,
        config.terrace_m,
        &mut occupied,
        &surface.paved_grid,
    ));
    plots
}

/// One side of a strip, by distance along it and outwards from its edge.
struct Frontage<'a> {
    path: &'a Path,
    side: f64,
    edge_m: f64,
}

impl Frontage<'_> {
    fn at(&self, along_m: f64, out_m: f64) -> Vec2 {
        self.path.beside(along_m, self.side * (self.edge_m + out_m))
    }

    /// Yaw along the street that puts the street on the right.
    fn yaw_rad(&self, along_m: f64) -> f64 {
        let along = self.path.direction(along_m) * self.side;
        along.y.atan2(along.x)
    }

    /// A rectangle `out_m` to `out_m + depth_m` from the edge.
    fn rectangle(&self, along_m: f64, out_m: f64, length_m: f64, depth_m: f64) -> Footprint {
        Footprint {
            center: self.at(along_m, out_m + depth_m / 2.0),
            yaw_rad: self.yaw_rad(along_m),
            length_m,
            width_m: depth_m,
        }
    }
}

/// The random draws for one plot.
#[allow(clippy::struct_field_names, reason = "all are lengths, and names carry their unit")]
struct Plot {
    from_m: f64,
    width_m: f64,
    gap_m: f64,
    setback_m: f64,
    depth_m: f64,
}

struct Grower<'a> {
    surface: &'a Surface,
    config: &'a TownConfig,
    rng: Rng,
    occupied: Occupied,
    plots: Plots,
}

impl Grower<'_> {
    fn draw(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.rng.random::<f64>()
    }

    fn chance(&mut self, share: f64) -> bool {
        self.rng.random::<f64>() < share
    }

    fn pick(&mut self, n: usize) -> usize {
        self.rng.random_range(0..n)
    }

    fn draw_weighted(&mut self, weights: &std::collections::BTreeMap<String, f64>) -> Option<String> {
        let at = random::pick_weighted(weights.values().copied(), &mut self.rng)?;
        weights.keys().nth(at).cloned()
    }

    fn grow_row(&mut self, front: &Frontage) {
        let config = self.config;
        let length_m = front.path.length_m();
        let mut station_m = 0.0;
        while station_m + 4.0 < length_m {
            let n_bays = (self.draw(config.building_width_m) / BAY_M).round().max(2.0);
            let mut plot = Plot {
                from_m: station_m,
                width_m: n_bays * BAY_M,
                gap_m: 0.05
                    + if config.building_style == BuildingStyle::Row {
                        0.0
                    } else {
                        self.draw(config.building_gap_m)
                    },
                setback_m: self.draw(config.building_setback_m),
                depth_m: self.draw(config.building_depth_m),
            };
            if !self.chance(config.building_share) {
                self.leave_open(front, &plot);
                station_m += plot.width_m;
                continue;
            }
            let most_rad = config.building_turn_deg.to_radians();
            let turn_rad = if most_rad > 0.0 { self.draw([-most_rad, most_rad]) } else { 0.0 };
            let mut is_built = false;
            // A narrower house may fit where a wide one does not.
            while plot.width_m >= 2.0 * BAY_M && !is_built {
                let middle_m = station_m + plot.width_m / 2.0;
                let mut footprint = front.rectangle(middle_m, plot.setback_m, plot.width_m, plot.depth_m);
                footprint.yaw_rad += turn_rad;
                is_built = self.is_off_the_pavement(&footprint, 0.1)
                    && self.is_off_the_road(&footprint)
                    && self.occupied.claim(footprint, 0.02);
                if is_built {
                    self.build(footprint);
                    self.furnish(front, &plot);
                } else {
                    plot.width_m -= BAY_M;
                }
            }
            station_m += if is_built { plot.width_m + plot.gap_m } else { BAY_M };
        }
    }

    /// Adds what stands on a plot beside its building.
    fn furnish(&mut self, front: &Frontage, plot: &Plot) {
        let config = self.config;
        let (from_m, end_m) = (plot.from_m, plot.from_m + plot.width_m + plot.gap_m);
        let is_bay_front = plot.setback_m >= BAY_DEPTH_M - 0.5 && self.chance(config.loading_bay_share);
        if is_bay_front {
            self.add_stands(front, (from_m + 2.0, from_m + plot.width_m - 1.0), plot.setback_m - 0.4, -1.0);
            return;
        }
        let mut open_from_m = end_m;
        if plot.gap_m >= DRIVEWAY_M && self.chance(config.driveway_share) {
            open_from_m = end_m - plot.gap_m;
            let turn = if self.chance(0.6) { 1.0 } else { -1.0 };
            let mut footprint = front.rectangle(end_m - plot.gap_m / 2.0, 0.5, CAR_M, CAR_M);
            footprint.yaw_rad += turn * std::f64::consts::FRAC_PI_2;
            footprint.width_m = 2.3;
            if self.is_off_the_pavement(&footprint, 0.0) && self.occupied.claim(footprint, 0.0) {
                self.plots.stands.push(Stand { footprint });
            }
        }
        if plot.setback_m < GARDEN_M {
            return;
        }
        let look = config.boundaries[self.pick(config.boundaries.len())];
        // A gap for the path to the door.
        let door_m = from_m + plot.width_m * 0.5;
        self.add_boundary(look, front, (from_m, 0.4), (door_m - 0.7, 0.4));
        self.add_boundary(look, front, (door_m + 0.7, 0.4), (open_from_m, 0.4));
        if open_from_m >= end_m {
            self.add_boundary(look, front, (end_m, 0.4), (end_m, plot.setback_m + 1.0));
        }
        let n = self.draw(config.garden_props).round() as u32;
        for _ in 0..n {
            let along_m = from_m + plot.width_m * self.rng.random::<f64>();
            let is_behind = self.chance(0.3);
            let out_m = if is_behind {
                plot.setback_m + plot.depth_m + 2.0 + 3.0 * self.rng.random::<f64>()
            } else {
                self.draw([1.6, (plot.setback_m - 1.0).max(1.7)])
            };
            let Some(model) = self.draw_weighted(&config.garden_weights) else { break };
            self.add_furnishing(model, front.at(along_m, out_m), front.yaw_rad(along_m));
        }
    }

    /// A plot without a building: a yard, or a gap that a wall closes.
    fn leave_open(&mut self, front: &Frontage, plot: &Plot) {
        let (from_m, end_m) = (plot.from_m, plot.from_m + plot.width_m);
        let depth_m = plot.setback_m + plot.depth_m;
        if self.config.container_share > 0.0 && self.chance(self.config.container_share) {
            let size_m = [plot.width_m, plot.depth_m];
            let middle_m = f64::midpoint(from_m, end_m);
            let ground = front.rectangle(middle_m, plot.setback_m.max(1.0), size_m[0], size_m[1]);
            let has_room = size_m[0] > LEAST_STACK_M[0] && size_m[1] > LEAST_STACK_M[1];
            if has_room && self.is_off_the_pavement(&ground, 0.5) && self.occupied.claim(ground, 0.5) {
                self.plots.stacks.push(ground);
            }
            return;
        }
        if self.chance(self.config.yard_share) {
            let ground = front.rectangle(f64::midpoint(from_m, end_m), 0.3, plot.width_m, depth_m);
            if !self.is_off_the_pavement(&ground, 0.0) || !self.occupied.claim(ground, 0.0) {
                return;
            }
            let gate_m = f64::midpoint(from_m, end_m);
            let looks = [BoundaryLook::Railings, BoundaryLook::ChainLink];
            let look = looks[self.plots.boundaries.len() % 2];
            self.add_boundary(look, front, (from_m, 0.5), (gate_m - GATE_M / 2.0, 0.5));
            self.add_boundary(look, front, (gate_m + GATE_M / 2.0, 0.5), (end_m, 0.5));
            self.fill_yard(front, (from_m + 1.5, end_m - 1.5), depth_m);
            return;
        }
        let look = self.config.boundaries[self.pick(self.config.boundaries.len())];
        if plot.setback_m < GARDEN_M && self.config.building_style == BuildingStyle::Row {
            self.add_boundary(look, front, (from_m, 0.4), (end_m, 0.4));
        }
    }

    /// Vehicles in a yard: a row along its back, turned to the gate.
    fn fill_yard(&mut self, front: &Frontage, range_m: (f64, f64), depth_m: f64) {
        let mut along_m = range_m.0 + 1.5;
        while along_m < range_m.1 - 1.0 {
            let turn = if self.chance(0.8) { -1.0 } else { 1.0 };
            let stand = stand_before(front, along_m, depth_m - 1.0, turn);
            self.plots.stands.push(Stand { footprint: stand });
            along_m += BAY_SPACING_M;
        }
    }

    /// Loading bays before a wall `wall_m` from the edge.
    fn add_stands(&mut self, front: &Frontage, range_m: (f64, f64), wall_m: f64, turn: f64) {
        let mut along_m = range_m.0;
        while along_m < range_m.1 {
            let footprint = stand_before(front, along_m, wall_m, turn);
            if self.is_off_the_pavement(&footprint, 0.0) && self.occupied.claim(footprint, 0.0) {
                self.plots.stands.push(Stand { footprint });
            }
            along_m += BAY_SPACING_M;
        }
    }

    fn add_boundary(&mut self, look: BoundaryLook, front: &Frontage, from: (f64, f64), to: (f64, f64)) {
        if look == BoundaryLook::Open {
            return;
        }
        let length_m = (to.0 - from.0).hypot(to.1 - from.1);
        let n = (length_m / 2.0).ceil().max(1.0) as usize;
        let at = |i: usize| {
            let share = i as f64 / n as f64;
            front.at(from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share)
        };
        let line: Vec<Vec2> = (0..=n).map(at).collect();
        let is_clear = |point: &Vec2| {
            let spot = Footprint::square(*point, 0.3);
            self.surface.paved_grid.clearance_m(*point) > 0.15 && self.occupied.is_free(&spot, 0.0)
        };
        if length_m > 0.8
            && line.iter().all(is_clear)
            && let Some(line) = Path::new(line)
        {
            self.plots.boundaries.push(Boundary { look, line });
        }
    }

    fn add_furnishing(&mut self, model: String, position: Vec2, yaw_rad: f64) {
        let spot = Footprint { center: position, yaw_rad, length_m: 1.2, width_m: 1.2 };
        if self.is_off_the_pavement(&spot, 0.3) && self.occupied.claim(spot, 0.2) {
            self.plots.furnishings.push(Furnishing { model, position, yaw_rad });
        }
    }

    fn keep_free(&mut self, square: &SquareConfig) {
        let [x, y] = square.center_m;
        let center = Vec2::new(x, y);
        // Two squares turned against each other make a disc, near enough.
        for yaw_rad in [0.0, std::f64::consts::FRAC_PI_4] {
            let side_m = 1.8 * square.radius_m;
            self.occupied.take(Footprint { center, yaw_rad, length_m: side_m, width_m: side_m });
        }
    }

    fn furnish_square(&mut self, square: &SquareConfig, taken: &mut Occupied) {
        let [x, y] = square.center_m;
        for _ in 0..square.n_props {
            let radius_m = square.radius_m * self.rng.random::<f64>().sqrt();
            let angle_rad = std::f64::consts::TAU * self.rng.random::<f64>();
            let position = Vec2::new(x, y) + direction_of(angle_rad) * radius_m;
            let yaw_rad = angle_rad + std::f64::consts::FRAC_PI_2;
            let Some(model) = self.draw_weighted(&square.prop_weights) else { return };
            let spot = Footprint { center: position, yaw_rad, length_m: 3.0, width_m: 3.0 };
            if self.is_off_the_pavement(&spot, 0.3) && taken.claim(spot, 0.5) {
                self.plots.furnishings.push(Furnishing { model, position, yaw_rad });
            }
        }
    }
}

/// Where a vehicle stands before a wall, turned away from it (-1) or to it (1).
fn stand_before(front: &Frontage, along_m: f64, wall_m: f64, turn: f64) -> Footprint {
    let length_m = BAY_DEPTH_M - 1.2;
    let mut footprint = front.rectangle(along_m, wall_m - length_m, length_m, length_m);
    footprint.yaw_rad += turn * std::f64::consts::FRAC_PI_2;
    footprint.width_m = 3.2;
    footprint
}
