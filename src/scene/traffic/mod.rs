//! How the world moves, 20 times a second: drivers on the lane graph, pedestrians, and the ego's driver.
//!
//! Kinematic: positions follow paths and speeds follow the intelligent driver model (Treiber et al.
//! 2000). Only the ego is physics; its driver steers by pure pursuit and asks for a speed. Agents act in
//! a fixed order and see the state before the step, so the outcome depends on world and seed alone.

mod driver;
mod junction;
mod pedestrian;

use self::driver::{Driver, Obstacle};
use self::junction::Junctions;
use self::pedestrian::Pedestrian;
use super::mjcf::{
    DRIVE_RESPONSE_S, EGO_LENGTH_M, EGO_WIDTH_M, EgoCommand, FRONT_BUMPER_X_M, MAX_STEERING_RAD, WHEELBASE_M,
};
use super::occupancy::Footprint;
use super::path::{Vec2, turn_between};
use super::populate::{Motion, World};
use crate::geometry::{Ego, Transform, World as WorldFrame};
use crate::random::{self, Rng};

/// From the rear axle to the middle of the ego.
const EGO_CENTER_X_M: f64 = FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0;
/// Pure pursuit looks this far ahead at standstill, and this much farther for each m/s.
const LOOK_AHEAD_M: f64 = 3.2;
const LOOK_AHEAD_S: f64 = 0.45;

/// What the ego's driver sees of its own car.
#[derive(Debug, Clone, Copy)]
pub struct EgoObservation {
    pub pose: Transform<WorldFrame, Ego>,
    pub speed_mps: f64,
}

/// What happens in the next step.
#[derive(Debug, Clone)]
pub struct Commands {
    pub ego: EgoCommand,
    /// For each moving body: its mocap number, position and heading.
    pub mocap: Vec<(usize, [f64; 3], f64)>,
}

/// All agents of a world.
#[derive(Debug)]
pub struct Traffic {
    world: World,
    /// Of each placement, in order.
    agents: Vec<Agent>,
    ego: Driver,
    junctions: Junctions,
    rng: Rng,
}

#[derive(Debug)]
enum Agent {
    Still(Footprint),
    Drives(Driver),
    Walks(Pedestrian),
}

impl Traffic {
    #[must_use]
    pub fn new(world: &World, seed: u64) -> Self {
        let agents = world
            .placements
            .iter()
            .map(|placement| {
                let footprint = world.footprint(placement);
                match &placement.motion {
                    Motion::Still => Agent::Still(footprint),
                    Motion::Drives { route, station_m } => Agent::Drives(Driver::new(
                        route.clone(),
                        *station_m,
                        footprint.length_m,
                        footprint.width_m,
                    )),
                    Motion::Walks(walk) => Agent::Walks(Pedestrian::new(walk, footprint)),
                }
            })
            .collect();
        let center_m = world.ego_start_m + EGO_CENTER_X_M;
        Self {
            ego: Driver::new(world.ego_route.clone(), center_m, EGO_LENGTH_M, EGO_WIDTH_M),
            world: world.clone(),
            agents,
            junctions: Junctions::default(),
            rng: random::stream(seed, "traffic-behaviour", 0),
        }
    }

    /// Advances everyone by `dt_s`.
    pub fn step(&mut self, dt_s: f64, ego: &EgoObservation) -> Commands {
        let origin = ego.pose.isometry.translation.vector.xy();
        let ego_yaw_rad = ego.pose.yaw_rad();
        let forward = Vec2::new(ego_yaw_rad.cos(), ego_yaw_rad.sin());
        let ego_center = origin + forward * EGO_CENTER_X_M;
        let obstacles = self.obstacles(ego_center, ego_yaw_rad, ego.speed_mps);
        let graph = &self.world.town.graph;

        self.ego.observe(ego_center, ego.speed_mps);
        let ego_obstacle = self.agents.len();
        let acceleration =
            self.ego.decide(ego_obstacle, &obstacles, graph, &mut self.junctions, dt_s, &mut self.rng);
        let command = self.ego_command(origin, ego_yaw_rad, ego.speed_mps, acceleration);
        self.ego.keep_going(graph, &mut self.rng);

        for idx in 0..self.agents.len() {
            match &mut self.agents[idx] {
                Agent::Still(_) => {}
                Agent::Drives(driver) => {
                    let acceleration =
                        driver.decide(idx, &obstacles, graph, &mut self.junctions, dt_s, &mut self.rng);
                    driver.advance(acceleration, dt_s);
                    driver.keep_going(graph, &mut self.rng);
                }
                Agent::Walks(pedestrian) => pedestrian.step(idx, &obstacles, dt_s),
            }
        }
        Commands { ego: command, mocap: self.mocap() }
    }

    /// Everyone's footprint and velocity; the ego's comes last.
    fn obstacles(&self, ego_center: Vec2, ego_yaw_rad: f64, ego_speed_mps: f64) -> Vec<Obstacle> {
        let mut obstacles: Vec<Obstacle> = self
            .agents
            .iter()
            .map(|agent| match agent {
                Agent::Still(footprint) => Obstacle::still(*footprint),
                Agent::Drives(driver) => Obstacle::moving(driver.footprint(), driver.speed_mps()),
                Agent::Walks(pedestrian) => pedestrian.obstacle(),
            })
            .collect();
        let footprint = Footprint {
            center: ego_center,
            yaw_rad: ego_yaw_rad,
            length_m: EGO_LENGTH_M,
            width_m: EGO_WIDTH_M,
        };
        obstacles.push(Obstacle::moving(footprint, ego_speed_mps));
        obstacles
    }

    fn ego_command(&self, origin: Vec2, yaw_rad: f64, speed_mps: f64, acceleration_mps2: f64) -> EgoCommand {
        let look_ahead_m = LOOK_AHEAD_M + LOOK_AHEAD_S * speed_mps.max(0.0);
        let target = self.ego.point_ahead(look_ahead_m - EGO_CENTER_X_M);
        let to_target = target - origin;
        let bearing_rad = turn_between(yaw_rad, to_target.y.atan2(to_target.x));
        let steering_angle_rad = (2.0 * WHEELBASE_M * bearing_rad.sin() / to_target.norm().max(1.0)).atan();
        let wanted_mps = (speed_mps + acceleration_mps2 * DRIVE_RESPONSE_S).max(0.0);
        EgoCommand {
            // Below a crawl the brake holds, so that the car does not creep.
            target_speed_mps: if wanted_mps < 0.05 && acceleration_mps2 <= 0.0 { 0.0 } else { wanted_mps },
            steering_angle_rad: steering_angle_rad.clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD),
        }
    }

    fn mocap(&self) -> Vec<(usize, [f64; 3], f64)> {
        self.world
            .placements
            .iter()
            .zip(&self.agents)
            .filter_map(|(placement, agent)| {
                let (position, yaw_rad) = match agent {
                    Agent::Still(_) => return None,
                    Agent::Drives(driver) => (driver.footprint().center, driver.footprint().yaw_rad),
                    Agent::Walks(pedestrian) => pedestrian.pose(),
                };
                let at = [position.x, position.y, placement.z_m];
                placement.mocap.map(|mocap| (mocap, at, yaw_rad))
            })
            .collect()
    }
}
