//! The closed loop of one episode: behaviour decides, physics moves; the only place that knows both.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::GenerateError;
use super::config::CONTROL_PERIOD_S;
use crate::geometry::{Ego, Transform, World};
use crate::sample::EgoState;
use crate::scene::{self, EgoObservation, Traffic, mjcf};
use crate::sim::{CameraMount, Simulator};

const EGO_BODY: &str = "ego";
const STEERING_JOINTS: [&str; 2] = ["steer_fl", "steer_fr"];

/// A world in motion with its traffic.
pub(super) struct Drive {
    pub simulator: Simulator,
    traffic: Traffic,
    ego_body: usize,
    /// Body of each of the scene's objects, in its order.
    pub object_bodies: Vec<usize>,
    steering_joints: Vec<usize>,
    physics_steps: usize,
    /// Pose of every body now and one control step ago.
    pub poses: Vec<Isometry3<f64>>,
    pub poses_before: Vec<Isometry3<f64>>,
    speed_mps: f64,
    speed_before_mps: f64,
    yaw_rate_rps: f64,
}

impl Drive {
    pub(super) fn new(world: &scene::World, mount: &CameraMount, seed: u64) -> Result<Self, GenerateError> {
        let mjcf = world.mjcf();
        let simulator = Simulator::new(&mjcf.xml, &mjcf.assets, mount)?;
        let missing = |what, name: &str| GenerateError::Missing { what, name: name.to_owned() };
        let body = |name: &str| simulator.body(name).ok_or_else(|| missing("body", name));
        let ego_body = body(EGO_BODY)?;
        let object_bodies =
            world.objects().iter().map(|object| body(&object.body_name)).collect::<Result<_, _>>()?;
        let steering_joints = STEERING_JOINTS
            .iter()
            .map(|name| simulator.joint(name).ok_or_else(|| missing("joint", name)))
            .collect::<Result<_, _>>()?;
        let poses = simulator.body_poses()?;
        Ok(Self {
            traffic: Traffic::new(world, seed),
            ego_body,
            object_bodies,
            steering_joints,
            physics_steps: (CONTROL_PERIOD_S / simulator.timestep_s()).round().max(1.0) as usize,
            poses_before: poses.clone(),
            poses,
            speed_mps: 0.0,
            speed_before_mps: 0.0,
            yaw_rate_rps: 0.0,
            simulator,
        })
    }

    /// One control step.
    pub(super) fn step(&mut self) -> Result<(), GenerateError> {
        let observation = EgoObservation { world_from_ego: self.world_from_ego(), speed_mps: self.speed_mps };
        let commands = self.traffic.step(CONTROL_PERIOD_S, &observation);
        let movers: Vec<(usize, Isometry3<f64>)> = commands
            .mocap
            .iter()
            .map(|mover| {
                (mover.index, Isometry3::from_parts(Translation3::from(mover.position_m), mover.turn))
            })
            .collect();
        self.simulator.step(&commands.ego.ctrl(), &movers, self.physics_steps)?;
        self.poses_before = std::mem::replace(&mut self.poses, self.simulator.body_poses()?);
        let (angular, linear): (Vector3<f64>, Vector3<f64>) = self.simulator.body_velocity(self.ego_body)?;
        self.speed_before_mps = std::mem::replace(&mut self.speed_mps, linear.x);
        self.yaw_rate_rps = angular.z;
        Ok(())
    }

    pub(super) fn world_from_ego(&self) -> Transform<World, Ego> {
        Transform::from_isometry(self.poses[self.ego_body])
    }

    /// What the odometry says.
    pub(super) fn ego_state(&self) -> Result<EgoState, GenerateError> {
        let joints = self.simulator.joint_positions()?;
        let sum_rad: f64 = self.steering_joints.iter().map(|&joint| joints[joint]).sum();
        Ok(EgoState {
            speed_mps: self.speed_mps,
            steering_angle_rad: sum_rad / self.steering_joints.len() as f64,
            yaw_rate_rps: self.yaw_rate_rps,
            acceleration_mps2: (self.speed_mps - self.speed_before_mps) / CONTROL_PERIOD_S,
            wheelbase_m: mjcf::WHEELBASE_M,
            front_bumper_x_m: mjcf::FRONT_BUMPER_X_M,
        })
    }
}
