//! Everything that moves, one control step at a time: drivers, pedestrians and the ego's driver.
//!
//! Vehicles other than the ego are kinematic: they stay on their lanes' lines, and never enter what
//! is taken. Control rate 20 Hz.

use std::sync::Arc;

use rand::RngExt;

use super::driving::{self, Gap, Obstacle, Owner};
use super::ego::{EgoDriver, EgoPose};
use super::junctions::{self, Reservations};
use super::mjcf::EgoCommand;
use super::models::SOLID_M;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::{Motion, World};
use super::route::Route;
use super::surface::PAVEMENT_M;
use super::swerve::Swerve;
use super::town::Town;
use super::walking::Walker;
use crate::geometry::{Ego, Transform, World as WorldFrame};
use crate::random::{self, Rng};

/// Distance to the car ahead when standing.
const STANDSTILL_M: f64 = 0.9;
/// Standing this long before a junction gives its reservation back.
const GIVE_WAY_S: f64 = 3.0;
/// Standing this long before something still, a driver passes it at a walk, if it can.
const CREEP_S: f64 = 3.0;
const CREEP_MPS: f64 = 1.0;
/// Standing this long with no way on, a driver backs up.
const BACK_UP_S: f64 = 6.0;
/// Standing this long out of the ego's sight, a driver starts elsewhere.
const GIVE_UP_S: f64 = 20.0;
/// Beyond this distance nobody sees a car come or go, metres.
const SIGHT_M: f64 = 75.0;
/// Slower than this a loose thing counts as lying.
const MOVING_MPS: f64 = 0.3;
/// So far ahead people see where a flying or rolling thing goes.
const FORESIGHT_S: f64 = 0.5;
/// The ego among the holders of reservations.
const EGO: usize = usize::MAX;

/// The ego as the simulator has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoObservation {
    pub world_from_ego: Transform<WorldFrame, Ego>,
    pub speed_mps: f64,
}

/// Where a mocap body is to be put.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MocapPose {
    /// Number among the mocap bodies.
    pub index: usize,
    pub position_m: [f64; 3],
    pub yaw_rad: f64,
    /// Over ground, in the world frame.
    pub velocity_mps: [f64; 2],
}

/// What one step asks of the simulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands {
    pub ego: EgoCommand,
    pub mocap: Vec<MocapPose>,
}

#[derive(Debug, Clone)]
struct Driver {
    placement: usize,
    route: Route,
    /// Station of the footprint's centre.
    station_m: f64,
    /// Offset of the centre to the left of the route, and where it is going to be.
    left_m: f64,
    left_wanted_m: f64,
    /// Change of the offset for each metre of the way.
    slope: f64,
    speed_mps: f64,
    length_m: f64,
    width_m: f64,
    /// Share of the limit that this driver likes.
    eagerness: f64,
    waited_s: f64,
    /// Seconds that it still backs up.
    backing_s: f64,
}

impl Driver {
    fn front_m(&self) -> f64 {
        self.station_m + self.length_m / 2.0
    }

    fn rear_m(&self) -> f64 {
        self.station_m - self.length_m / 2.0
    }

    /// Heading of the chord between the axles.
    fn yaw_rad(&self) -> f64 {
        let half_m = 0.32 * self.length_m;
        let chord = self.route.path.at(self.station_m + half_m) - self.route.path.at(self.station_m - half_m);
        chord.y.atan2(chord.x) + self.slope.atan()
    }

    fn obstacle(&self) -> Obstacle {
        let yaw_rad = self.yaw_rad();
        Obstacle {
            owner: Owner::Placement(self.placement),
            footprint: Footprint {
                center: self.route.path.beside(self.station_m, self.left_m),
                yaw_rad,
                length_m: self.length_m,
                width_m: self.width_m,
            },
            velocity_mps: Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * self.speed_mps,
            is_still: false,
            is_vehicle: true,
        }
    }
}

/// The behaviour of a world.
#[derive(Debug, Clone)]
pub struct Traffic {
    town: Arc<Town>,
    ego: EgoDriver,
    drivers: Vec<Driver>,
    walkers: Vec<Walker>,
    still: Vec<Obstacle>,
    loose: Vec<Obstacle>,
    reservations: Reservations,
    mocap_of: Vec<Option<usize>>,
    rng: Rng,
}

impl Traffic {
    /// The world's movers at their starts.
    #[must_use]
    pub fn new(world: &World, seed: u64) -> Self {
        let mut rng = random::stream(seed, "drivers", 0);
        let (mut drivers, mut walkers, mut still) = (Vec::new(), Vec::new(), Vec::new());
        for (i, placement) in world.placements.iter().enumerate() {
            let footprint = world.footprint(placement);
            match &placement.motion {
                Motion::Still => still.push(Obstacle {
                    owner: Owner::Placement(i),
                    footprint,
                    velocity_mps: Vec2::zeros(),
                    is_still: true,
                    is_vehicle: false,
                }),
                Motion::Drives { route, station_m } => drivers.push(Driver {
                    placement: i,
                    route: route.clone(),
                    station_m: *station_m,
                    left_m: 0.0,
                    left_wanted_m: 0.0,
                    slope: 0.0,
                    speed_mps: 3.0,
                    length_m: footprint.length_m,
                    width_m: footprint.width_m,
                    eagerness: 0.75 + 0.3 * rng.random::<f64>(),
                    waited_s: 0.0,
                    backing_s: 0.0,
                }),
                // Seen as soon as the simulator tells where it is.
                Motion::Loose(_) => {}
                Motion::Walks(walk) => {
                    walkers.push(Walker::new(i, walk.clone(), placement.position, placement.yaw_rad));
                }
            }
        }
        let ego_rng = random::stream(seed, "ego-driver", 0);
        Self {
            town: Arc::clone(&world.town),
            ego: EgoDriver::new(world.ego_route.clone(), world.ego_start_m, ego_rng),
            drivers,
            walkers,
            still,
            loose: Vec::new(),
            reservations: Reservations::default(),
            mocap_of: world.placements.iter().map(|placement| placement.mocap).collect(),
            rng,
        }
    }

    /// Tells where the loose things are now: placement, box on the ground, bottom's height, velocity.
    pub fn see_loose(&mut self, seen: impl Iterator<Item = (usize, Footprint, f64, Vec2)>) {
        // What stands high above the heads, held on its balcony, takes no ground.
        let takes_ground = |bottom_m: f64, speed_mps: f64| bottom_m < SOLID_M || speed_mps > MOVING_MPS;
        self.loose = seen
            .filter(|(_, _, bottom_m, velocity)| takes_ground(*bottom_m, velocity.norm()))
            .map(|(placement, body, _, velocity_mps)| {
                let speed_mps = velocity_mps.norm();
                let is_still = speed_mps < MOVING_MPS;
                // The ground that it comes over next is taken too.
                let ahead_m = speed_mps * FORESIGHT_S;
                let footprint = if is_still {
                    body
                } else {
                    Footprint {
                        center: body.center + velocity_mps * (FORESIGHT_S / 2.0),
                        yaw_rad: velocity_mps.y.atan2(velocity_mps.x),
                        length_m: body.length_m.max(body.width_m) + ahead_m,
                        width_m: body.length_m.max(body.width_m),
                    }
                };
                let owner = Owner::Placement(placement);
                Obstacle { owner, footprint, velocity_mps, is_still, is_vehicle: false }
            })
            .collect();
    }

    /// Ground taken by everything but the ego.
    #[must_use]
    pub fn footprints(&self) -> Vec<Footprint> {
        let drivers = self.drivers.iter().map(|driver| driver.obstacle().footprint);
        let side_m = 0.5;
        let walkers = self.walkers.iter().map(|walker| Footprint {
            center: walker.position,
            yaw_rad: walker.yaw_rad,
            length_m: side_m,
            width_m: side_m,
        });
        let others = self.still.iter().chain(&self.loose).map(|other| other.footprint);
        drivers.chain(walkers).chain(others).collect()
    }

    /// Footprints of the moving vehicles.
    #[must_use]
    pub fn vehicle_footprints(&self) -> Vec<Footprint> {
        self.drivers.iter().map(|driver| driver.obstacle().footprint).collect()
    }

    /// Moves everything by one control step and tells what the ego is to do.
    pub fn step(&mut self, dt_s: f64, observation: &EgoObservation) -> Commands {
        let origin = observation.world_from_ego.isometry.translation;
        let pose = EgoPose {
            position: Vec2::new(origin.x, origin.y),
            yaw_rad: observation.world_from_ego.yaw_rad(),
            speed_mps: observation.speed_mps,
        };
        self.ego.locate(&pose);
        let mut obstacles: Vec<Obstacle> = vec![pose.obstacle()];
        obstacles.extend(self.drivers.iter().map(Driver::obstacle));
        obstacles.extend(self.walkers.iter().map(Walker::obstacle));
        let n_moving = obstacles.len();
        obstacles.extend(self.still.iter().copied());
        obstacles.extend(self.loose.iter().copied());
        let (ego_line, lines) = self.ask_junctions(&pose, &obstacles[..n_moving]);
        let scene = (&self.town.graph, &self.town.surface);
        let ego = self.ego.step(dt_s, &pose, ego_line, scene, &obstacles);
        for (i, line) in lines.into_iter().enumerate() {
            self.step_driver(i, dt_s, line, &obstacles);
            if self.drivers[i].waited_s > GIVE_UP_S {
                self.start_elsewhere(i, &pose, &obstacles);
            }
            // Those who come later see where this one is now.
            obstacles[1 + i] = self.drivers[i].obstacle();
        }
        let first_walker = 1 + self.drivers.len();
        for (i, walker) in self.walkers.iter_mut().enumerate() {
            walker.step(dt_s, &obstacles);
            obstacles[first_walker + i] = walker.obstacle();
        }
        Commands { ego, mocap: self.mocap_poses() }
    }

    /// Stop lines for the ego and each driver who may not enter the next junction yet.
    fn ask_junctions(&mut self, pose: &EgoPose, moving: &[Obstacle]) -> (Option<Gap>, Vec<Option<Gap>>) {
        let mut order: Vec<usize> = (0..self.drivers.len()).collect();
        order.sort_by(|&a, &b| self.drivers[b].waited_s.total_cmp(&self.drivers[a].waited_s).then(a.cmp(&b)));
        let mut lines = vec![None; self.drivers.len()];
        let graph = &self.town.graph;
        let asker = Asker {
            driver: EGO,
            owner: Owner::Ego,
            route: &self.ego.route,
            rear_m: self.ego.rear_m(),
            front_m: self.ego.front_m(),
            speed_mps: pose.speed_mps,
            length_m: self.ego.front_m() - self.ego.rear_m(),
            waited_s: self.ego.waited_s(),
        };
        let ego_line = asker.ask(graph, &mut self.reservations, moving);
        for i in order {
            let driver = &self.drivers[i];
            let asker = Asker {
                driver: i,
                owner: Owner::Placement(driver.placement),
                route: &driver.route,
                rear_m: driver.rear_m(),
                front_m: driver.front_m(),
                speed_mps: driver.speed_mps,
                length_m: driver.length_m,
                waited_s: driver.waited_s,
            };
            lines[i] = asker.ask(graph, &mut self.reservations, moving);
        }
        (ego_line, lines)
    }

    fn step_driver(&mut self, i: usize, dt_s: f64, line: Option<Gap>, obstacles: &[Obstacle]) {
        let graph = &self.town.graph;
        let driver = &mut self.drivers[i];
        let before = driver.obstacle();
        let others: Vec<Obstacle> = obstacles
            .iter()
            .filter(|other| other.owner != before.owner)
            .filter(|other| (other.footprint.center - before.footprint.center).norm() < 60.0)
            .copied()
            .collect();
        let path = &driver.route.path;
        let front_m = driver.front_m();
        let limit_mps = graph.lanes[driver.route.span_at(front_m).lane].limit_mps * driver.eagerness;
        let mut desired_mps = driving::bend_speed_mps(path, driver.station_m, limit_mps);
        let swerve = Swerve {
            path,
            front_m,
            now_m: driver.left_m + driver.slope * driver.length_m / 2.0,
            half_width_m: driver.width_m / 2.0,
            length_m: driver.length_m,
            speed_mps: driver.speed_mps,
            is_bold: driver.waited_s > 6.0,
            is_near_junction: graph.lanes[driver.route.span_at(front_m + 4.0).lane].junction.is_some(),
        };
        let left_wanted_m = swerve.best_offset(driver.left_wanted_m, &self.town.surface.road_grid, &others);
        let gap = swerve.gap(left_wanted_m, 10.0 + 2.5 * driver.speed_mps, others.iter());
        if left_wanted_m.abs() > 0.7 || driver.left_m.abs() > 0.7 {
            desired_mps = desired_mps.min(5.0);
        }
        let to_end_m = path.length_m() - front_m;
        let end = (to_end_m < 25.0).then(|| Gap::line(to_end_m));
        let free = driving::acceleration_mps2(driver.speed_mps, desired_mps, None, STANDSTILL_M);
        let (mut acceleration, mut room_m) = (free, f64::INFINITY);
        for stop in [gap, line, end].into_iter().flatten() {
            // Room to drive round what stands.
            if stop.is_still && driver.waited_s > CREEP_S {
                // What is planned too close may still be passed at a walk; the last check guards it.
                acceleration = acceleration.min((CREEP_MPS - driver.speed_mps) / dt_s);
                continue;
            }
            let standstill_m = if stop.is_still { 4.5 } else { STANDSTILL_M };
            let asked = driving::acceleration_mps2(driver.speed_mps, desired_mps, Some(stop), standstill_m);
            acceleration = acceleration.min(asked);
            room_m = room_m.min(stop.distance_m - 0.1);
        }
        let moved_m = {
            let wanted_mps = (driver.speed_mps + acceleration * dt_s).max(0.0);
            driver.left_wanted_m = left_wanted_m;
            driver.speed_mps = wanted_mps.min((room_m / dt_s).max(0.0));
            driver.speed_mps * dt_s
        };
        let saved = (driver.station_m, driver.left_m, driver.slope);
        let aim = ((left_wanted_m - driver.left_m) * 0.35).clamp(-0.4, 0.4);
        let moved_m = if driver.backing_s > 0.0 { -CREEP_MPS * dt_s } else { moved_m };
        driver.backing_s -= dt_s;
        driver.slope += (aim - driver.slope).clamp(-0.12 * moved_m.abs(), 0.12 * moved_m.abs());
        driver.left_m += driver.slope * moved_m;
        driver.station_m += moved_m;
        // Whatever was planned: nobody moves into what is taken.
        let after = driver.obstacle().footprint.grown(0.03);
        let hits =
            |other: &Obstacle| after.meets(&other.footprint) && !before.footprint.meets(&other.footprint);
        if others.iter().any(hits) {
            (driver.station_m, driver.left_m, driver.slope) = saved;
            driver.speed_mps = 0.0;
            if driver.waited_s > BACK_UP_S && driver.backing_s < -BACK_UP_S {
                driver.backing_s = 2.5;
            }
        }
        let stands = driver.speed_mps < 0.3 || (driver.station_m - saved.0).abs() < 1e-9;
        driver.waited_s = if stands || driver.backing_s > 0.0 { driver.waited_s + dt_s } else { 0.0 };
    }

    /// A driver that is stuck and unseen begins another route, unseen too; one try a step.
    fn start_elsewhere(&mut self, i: usize, pose: &EgoPose, obstacles: &[Obstacle]) {
        let graph = &self.town.graph;
        let is_unseen = |point: Vec2| (point - pose.position).norm() > SIGHT_M;
        let lane = self.rng.random_range(0..graph.lanes.len());
        let path = &graph.lanes[lane].path;
        let station_m = path.length_m() / 2.0;
        let driver = &mut self.drivers[i];
        let before = driver.obstacle();
        let there = Footprint {
            center: path.at(station_m),
            yaw_rad: path.heading_rad(station_m),
            length_m: driver.length_m + 8.0,
            width_m: driver.width_m + 0.6,
        };
        let is_free = obstacles.iter().all(|other| !other.footprint.meets(&there));
        let is_open = graph.lanes[lane].junction.is_none() && path.length_m() > 2.0 * driver.length_m;
        if is_unseen(before.footprint.center) && is_unseen(there.center) && is_free && is_open {
            driver.route = Route::random(graph, lane, 1500.0, &mut self.rng);
            driver.station_m = station_m;
            (driver.left_m, driver.left_wanted_m, driver.slope) = (0.0, 0.0, 0.0);
            (driver.waited_s, driver.backing_s) = (0.0, 0.0);
            self.reservations.keep_only(i, &[]);
        }
    }

    fn mocap_poses(&self) -> Vec<MocapPose> {
        let mut poses = Vec::with_capacity(self.drivers.len() + self.walkers.len());
        for driver in &self.drivers {
            let Some(index) = self.mocap_of[driver.placement] else { continue };
            let seen = driver.obstacle();
            let center = seen.footprint.center;
            poses.push(MocapPose {
                index,
                position_m: [center.x, center.y, 0.0],
                yaw_rad: seen.footprint.yaw_rad,
                velocity_mps: [seen.velocity_mps.x, seen.velocity_mps.y],
            });
        }
        for walker in &self.walkers {
            let Some(index) = self.mocap_of[walker.placement] else { continue };
            let is_on_road = self.town.surface.road_grid.clearance_m(walker.position) < 0.0;
            poses.push(MocapPose {
                index,
                position_m: [walker.position.x, walker.position.y, if is_on_road { 0.0 } else { PAVEMENT_M }],
                yaw_rad: walker.yaw_rad,
                velocity_mps: [walker.velocity_mps.x, walker.velocity_mps.y],
            });
        }
        poses.sort_by_key(|pose| pose.index);
        poses
    }
}

/// One who comes to a junction.
struct Asker<'a> {
    driver: usize,
    owner: Owner,
    route: &'a Route,
    rear_m: f64,
    front_m: f64,
    speed_mps: f64,
    length_m: f64,
    waited_s: f64,
}

impl Asker<'_> {
    /// The line to stop at, if the next junction cannot be entered now.
    fn ask(
        &self,
        graph: &super::network::LaneGraph,
        reservations: &mut Reservations,
        moving: &[Obstacle],
    ) -> Option<Gap> {
        let Some(crossing) = junctions::next_crossing(graph, self.route, self.rear_m) else {
            reservations.keep_only(self.driver, &[]);
            return None;
        };
        reservations.keep_only(self.driver, &crossing.lanes);
        let to_entry_m = crossing.entry_m - self.front_m;
        if to_entry_m < -0.5 {
            reservations.take(self.driver, &crossing.lanes);
        }
        // One who stands before the junction gives way to others, or all might wait for each other.
        let gives_way = to_entry_m > 0.0 && self.waited_s > GIVE_WAY_S;
        if reservations.holds(self.driver, &crossing.lanes) {
            if !gives_way {
                return None;
            }
            reservations.keep_only(self.driver, &[]);
            return Some(Gap::line((to_entry_m - 0.3).max(0.05)));
        }
        let braking_m = self.speed_mps * self.speed_mps / 5.0 + 10.0;
        if to_entry_m > braking_m {
            return None;
        }
        // Only the first in the lane asks: one behind could not make use of it.
        let ahead = moving.iter().filter(|other| other.owner != self.owner && other.is_vehicle);
        let way = (self.front_m, to_entry_m.max(0.0));
        let is_first = driving::gap_ahead(&self.route.path, way, 0.8, |_| 0.0, ahead).is_none();
        // Whoever cannot leave a junction must not enter it.
        let standing = moving
            .iter()
            .filter(|other| other.owner != self.owner && other.is_vehicle && other.velocity_mps.norm() < 1.0);
        let room = (crossing.exit_m, self.length_m + 2.0);
        let exit = driving::gap_ahead(&self.route.path, room, 0.8, |_| 0.0, standing);
        if is_first && exit.is_none() && reservations.try_take(graph, self.driver, &crossing.lanes) {
            return None;
        }
        Some(Gap::line((to_entry_m - 0.3).max(0.05)))
    }
}
