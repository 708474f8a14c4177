//! Everything that moves, one control step at a time: drivers, pedestrians and the ego's driver.
//!
//! Control rate 20 Hz.

mod ordered;

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use super::car::EgoCommand;
use super::dashing::Dasher;
use super::driver::Driver;
use super::driving::{Gap, Obstacle, Owner};
use super::ego::{EgoDriver, EgoOrders};
use super::ego_pose::EgoPose;
use super::following::{Follower, Stride, party_of};
use super::junctions::{Answer, Approach, Asker, Reservations, View};
use super::lights::{Aspect, Clock};
use super::models::SOLID_M;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::route::Route;
use super::town::Town;
use super::walking::Walker;
use super::world::{Motion, World};
use crate::geometry::{Ego, Transform, World as WorldFrame};
use crate::random::{self, Rng};

/// A driver who stands this long out of the ego's sight starts elsewhere.
const GIVE_UP_S: f64 = 20.0;
/// Beyond this distance nobody sees a car appear or vanish, metres.
const SIGHT_M: f64 = 75.0;
/// How far ahead a driver's route is planned.
const LOOK_AHEAD_M: f64 = 400.0;
/// A loose thing slower than this counts as lying.
const MOVING_MPS: f64 = 0.3;
/// People see this far ahead where a flying or rolling thing goes.
const FORESIGHT_S: f64 = 0.5;
/// The ego among the holders of reservations.
const EGO: usize = usize::MAX;

/// The ego's state in the simulator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoObservation {
    pub world_from_ego: Transform<WorldFrame, Ego>,
    pub speed_mps: f64,
}

/// The new pose of a mocap body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MocapPose {
    /// Number among the mocap bodies.
    pub index: usize,
    pub placement: usize,
    /// Which of its looks it has, if it changes its shape.
    pub shape: Option<usize>,
    pub position_m: [f64; 3],
    /// Rotation from the body's axes (x forward, z up) to the world's.
    pub turn: UnitQuaternion<f64>,
    /// Velocity over ground, in the world frame.
    pub velocity_mps: [f64; 2],
}

/// The orders of one step to the simulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands {
    pub ego: EgoCommand,
    pub mocap: Vec<MocapPose>,
    /// What each light of the town shows, in the town's order.
    pub lights: Vec<Aspect>,
}

/// The behaviour of a world.
#[derive(Debug, Clone)]
pub struct Traffic {
    town: Arc<Town>,
    ego: EgoDriver,
    /// `None` while the scripted driver drives.
    orders: Option<EgoOrders>,
    drivers: Vec<Driver>,
    walkers: Vec<Walker>,
    followers: Vec<Follower>,
    dashers: Vec<Dasher>,
    still: Vec<Obstacle>,
    loose: Vec<Obstacle>,
    reservations: Reservations,
    clock: Clock,
    mocap_of: Vec<Option<usize>>,
    rng: Rng,
}

impl Traffic {
    /// The world's movers at their starts.
    pub fn new(world: &World, seed: u64) -> Self {
        let mut rng = random::stream(seed, "drivers", 0);
        let (mut drivers, mut walkers, mut still) = (Vec::new(), Vec::new(), Vec::new());
        let (mut followers, mut dashers) = (Vec::new(), Vec::new());
        for (i, placement) in world.placements.iter().enumerate() {
            let footprint = world.footprint(placement);
            match &placement.motion {
                Motion::Still => still.push(Obstacle {
                    owner: Owner::Placement(i),
                    footprint,
                    velocity_mps: Vec2::zeros(),
                    is_still: true,
                    is_vehicle: false,
                    backs_up: false,
                }),
                Motion::Drives { route, station_m } => {
                    let eagerness = 0.75 + 0.3 * rng.random::<f64>();
                    drivers.push(Driver::new(i, route.clone(), *station_m, &footprint, eagerness));
                }
                // Taken into account once the simulator reports where it is.
                Motion::Loose(_) => {}
                Motion::Dashes(dash) => {
                    let dash = dash.as_ref().clone();
                    let at = (placement.position, placement.yaw_rad);
                    dashers.push(Dasher::new(i, dash, &world.models[placement.model], at));
                }
                Motion::Walks(walk) => {
                    let stride = Stride::new(i, &world.models[placement.model]);
                    let mut walker =
                        Walker::new(i, walk.clone(), placement.position, placement.yaw_rad, stride);
                    walker.party = party_of(world, i);
                    walkers.push(walker);
                }
                Motion::Follows(beside) => {
                    let stride = Stride::new(i, &world.models[placement.model]);
                    followers.push(Follower::new(i, *beside, placement.position, placement.yaw_rad, stride));
                }
            }
        }
        let ego_rng = random::stream(seed, "ego-driver", 0);
        let unnoticed = world.late_notices.iter().copied().collect();
        Self {
            town: Arc::clone(&world.town),
            ego: EgoDriver::new(world.ego_route.clone(), world.ego_start_m, unnoticed, ego_rng),
            orders: None,
            drivers,
            walkers,
            followers,
            dashers,
            still,
            loose: Vec::new(),
            reservations: Reservations::default(),
            clock: Clock::new(&world.town.lights, seed),
            mocap_of: world.placements.iter().map(|placement| placement.mocap).collect(),
            rng,
        }
    }

    /// Whether an actor has been set off and has not come to the end of its way.
    pub fn is_under_way(&self, placement: usize) -> bool {
        self.dashers.iter().any(|dasher| dasher.placement == placement && dasher.is_under_way())
    }

    /// Placements of the actors that the ego has set off.
    pub fn set_off(&self) -> impl Iterator<Item = usize> {
        self.dashers.iter().filter(|dasher| dasher.is_off()).map(|dasher| dasher.placement)
    }

    /// Takes the present state of the loose things: placement, box on the ground, bottom's height, velocity.
    pub fn see_loose(&mut self, seen: impl Iterator<Item = (usize, Footprint, f64, Vec2)>) {
        // A thing held on its balcony, high above the heads, takes no ground.
        let surface = &self.town.surface;
        let takes_ground = |body: &Footprint, bottom_m: f64, speed_mps: f64| {
            bottom_m - surface.ground_m(body.center) < SOLID_M || speed_mps > MOVING_MPS
        };
        self.loose = seen
            .filter(|(_, body, bottom_m, velocity)| takes_ground(body, *bottom_m, velocity.norm()))
            .map(|(placement, body, _, velocity_mps)| {
                let speed_mps = velocity_mps.norm();
                let is_still = speed_mps < MOVING_MPS;
                // The ground that it is about to cross is taken too.
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
                Obstacle { owner, footprint, velocity_mps, is_still, is_vehicle: false, backs_up: false }
            })
            .collect();
    }

    /// Ground taken by everything but the ego.
    pub fn footprints(&self) -> Vec<Footprint> {
        let drivers = self.drivers.iter().map(|driver| driver.obstacle().footprint);
        let side_m = 0.5;
        let walkers = self.walkers.iter().map(|walker| Footprint {
            center: walker.position,
            yaw_rad: walker.yaw_rad,
            length_m: side_m,
            width_m: side_m,
        });
        let followers = self.followers.iter().map(|follower| Footprint {
            center: follower.position,
            yaw_rad: follower.yaw_rad,
            length_m: side_m,
            width_m: side_m,
        });
        let dashers = self.dashers.iter().map(|dasher| dasher.obstacle().footprint);
        let others = self.still.iter().chain(&self.loose).map(|other| other.footprint);
        drivers.chain(walkers).chain(followers).chain(dashers).chain(others).collect()
    }

    /// Footprints of the moving vehicles.
    pub fn vehicle_footprints(&self) -> Vec<Footprint> {
        self.drivers.iter().map(|driver| driver.obstacle().footprint).collect()
    }

    /// What each light of the town shows, in the town's order.
    pub fn aspects(&self) -> Vec<Aspect> {
        let lights = &self.town.lights;
        (0..lights.lights.len()).map(|light| self.clock.aspect(lights, light)).collect()
    }

    /// Moves everything by one control step and returns what the ego is to do.
    pub fn step(&mut self, dt_s: f64, observation: &EgoObservation) -> Commands {
        let origin = observation.world_from_ego.isometry.translation;
        let pose = EgoPose {
            position: Vec2::new(origin.x, origin.y),
            yaw_rad: observation.world_from_ego.yaw_rad(),
            speed_mps: observation.speed_mps,
            grade: observation.world_from_ego.rotate(&Vector3::x()).z,
        };
        self.ego.locate(&pose);
        let mut obstacles: Vec<Obstacle> =
            vec![Obstacle { backs_up: self.ego.backs_up(), ..pose.obstacle() }];
        obstacles.extend(self.drivers.iter().map(Driver::obstacle));
        obstacles.extend(self.walkers.iter().map(Walker::obstacle));
        obstacles.extend(self.followers.iter().map(Follower::obstacle));
        obstacles.extend(self.dashers.iter().map(Dasher::obstacle));
        let n_moving = obstacles.len();
        obstacles.extend(self.still.iter().copied());
        obstacles.extend(self.loose.iter().copied());
        self.clock.time_s += dt_s;
        let (ego_answer, lines) = self.ask_junctions(&pose, &obstacles[..n_moving]);
        let scene = (&self.town.graph, &self.town.surface);
        let ego = match &self.orders {
            None => self.ego.step(dt_s, &pose, &ego_answer, scene, &obstacles),
            Some(orders) => self.ego.step_ordered(dt_s, &pose, &ego_answer, scene.0, orders),
        };
        for (i, line) in lines.into_iter().enumerate() {
            let driver = &mut self.drivers[i];
            driver.step(dt_s, line, &self.town, &obstacles, &mut self.rng);
            driver.route.extend(&self.town.graph, driver.station_m + LOOK_AHEAD_M, &mut self.rng);
            if driver.waited_s > GIVE_UP_S || driver.has_arrived() {
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
        for follower in &mut self.followers {
            let leader = self.walkers.iter().find(|walker| walker.placement == follower.beside.leader);
            if let Some(leader) = leader {
                follower.step(dt_s, leader.position, leader.yaw_rad);
            }
        }
        for dasher in &mut self.dashers {
            dasher.step(dt_s, pose.position);
        }
        Commands { ego, mocap: self.mocap_poses(), lights: self.aspects() }
    }

    /// The answer of junctions and lights to the ego, and the line at which each driver has to stop.
    fn ask_junctions(&mut self, pose: &EgoPose, moving: &[Obstacle]) -> (Answer, Vec<Option<Gap>>) {
        let (graph, lights, clock) = (&self.town.graph, &self.town.lights, &self.clock);
        let ego = Asker {
            driver: EGO,
            owner: Owner::Ego,
            route: &self.ego.route,
            rear_m: self.ego.rear_m(),
            front_m: self.ego.front_m(),
            speed_mps: pose.speed_mps,
            length_m: self.ego.front_m() - self.ego.rear_m(),
            waited_s: self.ego.waited_s(),
            sees_vehicles: self.orders.is_none(),
        };
        let askers: Vec<Asker<'_>> = (self.drivers.iter().enumerate())
            .map(|(i, driver)| Asker {
                driver: i,
                owner: Owner::Placement(driver.placement),
                route: &driver.route,
                rear_m: driver.rear_m(),
                front_m: driver.front_m(),
                speed_mps: driver.speed_mps,
                length_m: driver.length_m,
                waited_s: driver.waited_s,
                sees_vehicles: true,
            })
            .collect();
        let approaches: Vec<Approach> = std::iter::once(&ego)
            .chain(&askers)
            .filter_map(|asker| asker.approach(graph, lights, clock))
            .collect();
        let view = View { graph, lights, clock, moving, approaches: &approaches };
        let ego_answer = ego.ask(&view, &mut self.reservations);
        // The driver who has waited longest asks first.
        let mut order: Vec<usize> = (0..askers.len()).collect();
        order.sort_by(|&a, &b| askers[b].waited_s.total_cmp(&askers[a].waited_s).then(a.cmp(&b)));
        let mut answers = vec![Answer::default(); askers.len()];
        for i in order {
            answers[i] = askers[i].ask(&view, &mut self.reservations);
        }
        for (driver, answer) in self.drivers.iter_mut().zip(&answers) {
            if answer.is_granted {
                driver.waited_s = 0.0;
            }
        }
        (ego_answer, answers.iter().map(|answer| answer.stop.map(|stop| stop.gap)).collect())
    }

    /// A driver who is stuck and unseen begins another route, unseen too; one try per step.
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
            driver.restart(Route::random(graph, lane, LOOK_AHEAD_M, &mut self.rng), station_m);
            self.reservations.keep_only(i, &[]);
        }
    }

    fn mocap_poses(&self) -> Vec<MocapPose> {
        let ground = &self.town.surface.ground;
        let mut poses = Vec::with_capacity(self.drivers.len() + self.walkers.len());
        for driver in &self.drivers {
            let Some(index) = self.mocap_of[driver.placement] else { continue };
            let seen = driver.obstacle();
            let Footprint { center, yaw_rad, .. } = seen.footprint;
            // The axles stand within the ends.
            let (z_m, turn) = ground.stance(center, yaw_rad, 0.64 * driver.length_m, 0.9 * driver.width_m);
            poses.push(MocapPose {
                index,
                placement: driver.placement,
                shape: None,
                position_m: [center.x, center.y, z_m],
                turn,
                velocity_mps: [seen.velocity_mps.x, seen.velocity_mps.y],
            });
        }
        let walkers =
            self.walkers.iter().map(|w| (w.placement, w.position, w.yaw_rad, w.velocity_mps, &w.stride));
        let followers =
            self.followers.iter().map(|f| (f.placement, f.position, f.yaw_rad, f.velocity_mps, &f.stride));
        let dashers =
            self.dashers.iter().map(|d| (d.placement, d.position, d.yaw_rad, d.velocity_mps, &d.stride));
        for (placement, position, yaw_rad, velocity_mps, stride) in walkers.chain(followers).chain(dashers) {
            let Some(index) = self.mocap_of[placement] else { continue };
            poses.push(MocapPose {
                index,
                placement,
                shape: stride.shape(),
                position_m: [position.x, position.y, self.town.surface.level_m(position)],
                turn: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad),
                velocity_mps: [velocity_mps.x, velocity_mps.y],
            });
        }
        poses.sort_by_key(|pose| pose.index);
        poses
    }
}
