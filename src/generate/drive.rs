//! The closed loop of one episode: behaviour decides, physics moves; only this module knows both.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use super::GenerateError;
use super::config::CONTROL_PERIOD_S;
use super::upright::upright_box;
use crate::geometry::{Box3, Ego, Transform, World};
use crate::sample::EgoState;
use crate::scene::{
    self, Aspect, Commands, EgoObservation, EgoOrders, Footprint, Lighting, Loose, Traffic, Vec2, car,
};
use crate::sim::{CameraMount, Simulator, Touch};

const EGO_BODY: &str = "ego";
/// The geom on which wheels roll and things lie.
const GROUND_GEOM: &str = "ground";
const STEERING_JOINTS: [&str; 2] = ["steer_fl", "steer_fr"];

/// A thing that an event sets free.
struct LooseThing {
    placement: usize,
    body: usize,
    bounds: [Point3<f64>; 2],
    plan: Loose,
    is_held: bool,
}

/// The ego's controls, and poses by mocap number.
type StepInputs = ([f64; car::N_ACTUATORS], Vec<(usize, Isometry3<f64>)>);

/// A world in motion with its traffic.
pub(super) struct Drive {
    pub simulator: Simulator,
    traffic: Traffic,
    /// The town's lights that stand in the world, and the states of all the town's lights.
    lights: Vec<usize>,
    shown: Vec<Aspect>,
    pub ego_body: usize,
    /// Body of each of the scene's objects, in its order.
    pub object_bodies: Vec<usize>,
    /// Which look each object has.
    pub shapes: Vec<usize>,
    loose: Vec<LooseThing>,
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
    pub(super) fn new(
        world: &scene::World,
        lighting: &Lighting,
        mount: &CameraMount,
        seed: u64,
    ) -> Result<Self, GenerateError> {
        let mjcf = world.mjcf(lighting);
        let simulator = Simulator::new(&mjcf.xml, &mjcf.assets, mount)?;
        let missing = |what, name: &str| GenerateError::Missing { what, name: name.to_owned() };
        let body = |name: &str| simulator.body(name).ok_or_else(|| missing("body", name));
        let ego_body = body(EGO_BODY)?;
        let object_bodies: Vec<usize> =
            world.objects().iter().map(|object| body(&object.body_name)).collect::<Result<_, _>>()?;

        let loose = world
            .loose()
            .map(|(placement, plan)| {
                let (body, bounds) = (object_bodies[placement], world.objects()[placement].bounds);
                LooseThing { placement, body, bounds, plan: plan.clone(), is_held: true }
            })
            .collect();
        let steering_joints = STEERING_JOINTS
            .iter()
            .map(|name| simulator.joint(name).ok_or_else(|| missing("joint", name)))
            .collect::<Result<_, _>>()?;
        let poses = simulator.body_poses()?;
        let mut drive = Self {
            traffic: Traffic::new(world, seed),
            lights: world.lamp_posts.iter().map(|&(_, light)| light).collect(),
            shown: Vec::new(),
            ego_body,
            shapes: vec![0; object_bodies.len()],
            object_bodies,
            loose,
            steering_joints,
            physics_steps: (CONTROL_PERIOD_S / simulator.timestep_s()).round().max(1.0) as usize,
            poses_before: poses.clone(),
            poses,
            speed_mps: 0.0,
            speed_before_mps: 0.0,
            yaw_rate_rps: 0.0,
            simulator,
        };
        drive.show(drive.traffic.aspects())?;
        Ok(drive)
    }

    /// Switches the lamps that have changed.
    fn show(&mut self, aspects: Vec<Aspect>) -> Result<(), GenerateError> {
        let is_new = |light: &usize| self.shown.get(*light) != aspects.get(*light);
        let changed: Vec<_> = self
            .lights
            .iter()
            .filter(|light| is_new(light))
            .flat_map(|&i| scene::lamps_of(i, aspects[i]))
            .collect();
        if !changed.is_empty() {
            self.simulator.set_materials(&changed)?;
        }
        self.shown = aspects;
        Ok(())
    }

    /// One control step.
    pub(super) fn step(&mut self) -> Result<(), GenerateError> {
        let (ctrl, movers) = self.decide()?;
        self.simulator.step(&ctrl, &movers, self.physics_steps)?;
        self.look_around()
    }

    /// One control step by the driver under test; tells what the ego came to touch.
    pub(super) fn step_ordered(&mut self, orders: EgoOrders) -> Result<Vec<Touch>, GenerateError> {
        self.traffic.order(orders);
        let (ctrl, movers) = self.decide()?;
        let (n_steps, ego) = (self.physics_steps, self.ego_body);
        let touches = self.simulator.step_touching(&ctrl, &movers, n_steps, ego, GROUND_GEOM)?;
        self.look_around()?;
        Ok(touches)
    }

    /// How far the ego would have come after each control step with nothing in its way.
    pub(super) fn free_way_m(&self, n_steps: usize) -> Vec<f64> {
        self.traffic.free_way_m(n_steps, CONTROL_PERIOD_S)
    }

    /// The ego's route over ground, from its bumper on.
    pub(super) fn route_ahead(&self, length_m: f64, step_m: f64) -> Vec<Vec2> {
        self.traffic.route_ahead(length_m, step_m)
    }

    /// Whether the ego stands at a line that it may not cross yet.
    pub(super) fn ego_waits_at_line(&self) -> bool {
        self.traffic.ego_waits_at_line()
    }

    /// Whether an actor of a scenario is on its way.
    pub(super) fn is_under_way(&self, placement: usize) -> bool {
        self.traffic.is_under_way(placement)
    }

    /// Objects that the ego's coming has set off, by number.
    pub(super) fn set_off(&self) -> impl Iterator<Item = usize> {
        let free = self.loose.iter().filter(|thing| !thing.is_held).map(|thing| thing.placement);
        free.chain(self.traffic.set_off())
    }

    /// Mass of the ego, kilograms.
    pub(super) fn ego_mass_kg(&self) -> Result<f64, GenerateError> {
        Ok(self.simulator.body_masses()?[self.ego_body])
    }

    /// The ego's controls and the poses of all that is moved by hand, for one control step.
    fn decide(&mut self) -> Result<StepInputs, GenerateError> {
        let observation = EgoObservation { world_from_ego: self.world_from_ego(), speed_mps: self.speed_mps };
        self.release_loose()?;
        self.traffic.see_loose(self.loose.iter().map(|thing| {
            let (now, before) = (self.poses[thing.body], self.poses_before[thing.body]);
            let found: Box3<World> = upright_box(&now, &thing.bounds);
            let middle = nalgebra::center(&thing.bounds[0], &thing.bounds[1]);
            let body = Footprint {
                center: Vec2::new(found.center.x(), found.center.y()),
                yaw_rad: found.yaw_rad,
                length_m: found.length_m,
                width_m: found.width_m,
            };
            let velocity = (now * middle - before * middle) / CONTROL_PERIOD_S;
            (thing.placement, body, found.bottom_m(), velocity.xy())
        }));
        let Commands { ego, mocap, lights } = self.traffic.step(CONTROL_PERIOD_S, &observation);
        let mut movers: Vec<(usize, Isometry3<f64>)> = Vec::with_capacity(mocap.len());
        for mover in &mocap {
            let pose = Isometry3::from_parts(Translation3::from(mover.position_m), mover.turn);
            movers.push((mover.index, pose));
            // The bodies of its looks come after its own.
            if let Some(shape) = mover.shape {
                let before = std::mem::replace(&mut self.shapes[mover.placement], shape);
                if before != shape {
                    let away = Isometry3::translation(0.0, 0.0, scene::AWAY_Z_M);
                    movers.push((mover.index + 1 + before, away));
                }
                movers.push((mover.index + 1 + shape, pose));
            }
        }
        self.show(lights)?;
        Ok((ego.ctrl(), movers))
    }

    /// Takes note of where everything is after a step.
    fn look_around(&mut self) -> Result<(), GenerateError> {
        self.poses_before = std::mem::replace(&mut self.poses, self.simulator.body_poses()?);
        let (angular, linear): (Vector3<f64>, Vector3<f64>) = self.simulator.body_velocity(self.ego_body)?;
        self.speed_before_mps = std::mem::replace(&mut self.speed_mps, linear.x);
        self.yaw_rate_rps = angular.z;
        Ok(())
    }

    /// Lets go the things that wait for the ego to come this near.
    fn release_loose(&mut self) -> Result<(), GenerateError> {
        let pose = self.poses[self.ego_body];
        for thing in self.loose.iter_mut().filter(|thing| thing.is_held) {
            let to_aim = thing.plan.aim - pose.translation.vector.xy();
            let is_ahead = (pose.rotation * Vector3::x()).xy().dot(&to_aim) > 0.0;
            if is_ahead && to_aim.norm() < thing.plan.release_m {
                self.simulator.release(thing.body, &thing.plan.linear_mps, &thing.plan.angular_rps)?;
                thing.is_held = false;
            }
        }
        Ok(())
    }

    pub(super) fn world_from_ego(&self) -> Transform<World, Ego> {
        Transform::from_isometry(self.poses[self.ego_body])
    }

    /// The ego's true state.
    pub(super) fn ego_state(&self) -> Result<EgoState, GenerateError> {
        let joints = self.simulator.joint_positions()?;
        let sum_rad: f64 = self.steering_joints.iter().map(|&joint| joints[joint]).sum();
        Ok(EgoState {
            speed_mps: self.speed_mps,
            steering_angle_rad: sum_rad / self.steering_joints.len() as f64,
            yaw_rate_rps: self.yaw_rate_rps,
            acceleration_mps2: (self.speed_mps - self.speed_before_mps) / CONTROL_PERIOD_S,
            wheelbase_m: car::WHEELBASE_M,
            front_bumper_x_m: car::FRONT_BUMPER_X_M,
        })
    }
}

#[cfg(test)]
pub(super) mod tests;
