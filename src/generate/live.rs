//! A world in motion around the ego with its sensors: what happens, and what is measured, moment by moment.

mod ordered;
mod side_of_entry;

use std::path::Path;
use std::time::Instant;

use nalgebra::Vector3;
use rand::RngExt;

use self::side_of_entry::side_of_entry;
use super::annotate::{Observation, annotate, describe, ignore};
use super::aov::AovWriter;
use super::appearance::Appearance;
use super::config::{CONTROL_PERIOD_S, RendererName};
use super::drive::Drive;
use super::folder::OWN_MODELS;
use super::leaves::Leaves;
use super::lighting::lighting;
use super::sensing::{Cloud, Picture, Sensors};
use super::timings::{Timings, time};
use super::towns::town_of;
use super::{CheckedConfig, EpisodePlan, GenerateError, map};
use crate::config::to_toml;
use crate::episode::{EpisodeMeta, EpisodeWriter, MapDrawing, OtherSensors};
use crate::geometry::{Ego, Transform, World};
use crate::object::{Distribution, Kind, Object};
use crate::random;
use crate::sample::{CameraView, EgoState, LidarView, Measured, Sample, Sweep, Truth};
use crate::scene::{self, EgoOrders, Motion, SceneObject, populate_in};
use crate::sensors::lidar::Turn;
use crate::sensors::{Rig, WeatherState, odometry};
use crate::sim::{CameraMount, Renderer, Simulator, Touch};

/// Lanes farther than this from the route are not drawn.
const MAP_REACH_M: f64 = 100.0;

/// An episode that runs.
pub struct LiveEpisode<'a> {
    config: &'a CheckedConfig,
    plan: &'a EpisodePlan,
    world: scene::World,
    drive: Drive,
    sensors: Sensors,
    meta: EpisodeMeta,
    map: MapDrawing,
}

/// What the ego has run into.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Number among the world's objects; `None`: scenery that is no object.
    pub object_idx: Option<usize>,
    /// Number of the simulator's body.
    pub body: usize,
    /// Of the ego where it touches, its turning included, along the world's axes, just before.
    pub ego_mps: Vector3<f64>,
    pub other_mps: Vector3<f64>,
    /// Out of the ego's body where it touches: of the side through which it came in. MuJoCo's own points the shortest way out, which is
    /// up or aside for what is low or lies before a corner.
    pub normal: Vector3<f64>,
    /// Infinite for what is built into the street.
    pub mass_kg: f64,
}

impl<'a> LiveEpisode<'a> {
    /// Fills the town and sets the simulator up; everything is where it starts.
    ///
    /// # Errors
    /// [`GenerateError`]: unknown town, no simulator, a broken mesh of the user's own.
    pub fn start(
        config: &'a CheckedConfig,
        plan: &'a EpisodePlan,
        folder: &Path,
    ) -> Result<Self, GenerateError> {
        let raw = &config.raw;
        let rig_config = raw.rig_variation.draw(&raw.rig, plan.seed);
        let rig = Rig::try_from(&rig_config)?;
        let town = town_of(plan, &raw.scene)?;
        let state = plan.weather.state().replace_by(&raw.weather_override)?;
        let own_models = if raw.scene.own_models.is_empty() {
            Vec::new()
        } else {
            scene::load_own_models(&folder.join(OWN_MODELS))?
        };
        let world = populate_in(&town, own_models, &raw.scene, state.rain_rate_mmph > 0.0, plan.seed)?;
        let mount = CameraMount {
            body: "ego".into(),
            cameras: rig.cameras.iter().map(|camera| (camera.ego_from_camera, camera.intrinsics)).collect(),
            n_samples: raw.render.samples_per_pixel,
            shadow_size_px: raw.render.shadow_size_px,
            renderer: choose_renderer(raw.render.renderer, &state),
        };
        let drive = Drive::new(&world, &lighting(&state), &mount, plan.seed)?;
        let meta = EpisodeMeta {
            name: plan.name.clone(),
            seed: plan.seed,
            town: town.name.clone(),
            weather: plan.weather.name().to_owned(),
            ood: raw.scene.ood,
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
            config_toml: to_toml(raw),
            rig_toml: to_toml(&rig_config),
            n_samples: raw.samples as usize,
            background: String::new(),
        };
        let route: Vec<[f64; 2]> =
            world.ego_route.path.points_every(20.0).iter().map(|at| [at.x, at.y]).collect();
        let map = map::drawing(&town.graph, &town.surface.ground, &route, MAP_REACH_M);
        let appearance = Appearance::new(&world, &drive)?;
        let meta = EpisodeMeta { background: appearance.background.join(","), ..meta };
        let aov = || AovWriter::create(folder, &plan.name, &rig, world.objects(), &appearance.background);
        let aov = raw.render.aov.then(aov).transpose()?;
        let sensors =
            Sensors::new(config, plan, &state, rig, (appearance, Leaves::new(&world)), &drive, aov)?;
        Ok(Self { config, plan, world, drive, sensors, meta, map })
    }

    /// What is known of the episode.
    #[must_use]
    pub fn meta(&self) -> &EpisodeMeta {
        &self.meta
    }

    /// Starts the episode's file.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn writer(&self, path: &Path) -> Result<EpisodeWriter, GenerateError> {
        let others = other_sensors(self.sensors.rig(), self.config.raw.sweeps);
        Ok(EpisodeWriter::create_rig(path, &self.meta, others, &self.map)?)
    }

    pub(super) fn warm_up(&mut self, timings: &mut Timings) -> Result<(), GenerateError> {
        let [least_s, most_s] = self.config.raw.warm_up_s;
        let draw: f64 = random::stream(self.plan.seed, "warm-up", 0).random();
        let n_steps = ((least_s + (most_s - least_s) * draw) / CONTROL_PERIOD_S).round() as u32;
        time(&mut timings.warm_up, || (0..n_steps).try_for_each(|_| self.drive.step()))
    }

    /// The simulated world.
    pub fn simulator(&mut self) -> &mut Simulator {
        &mut self.drive.simulator
    }

    /// Whether its pictures are made with depths.
    #[must_use]
    pub fn needs_depth(&self) -> bool {
        self.sensors.needs_depth()
    }

    /// The world's objects, by number.
    #[must_use]
    pub fn objects(&self) -> &[SceneObject] {
        self.world.objects()
    }

    /// Mass of the ego, kilograms.
    ///
    /// # Errors
    /// [`GenerateError::Simulation`], only if MuJoCo itself fails.
    pub fn ego_mass_kg(&self) -> Result<f64, GenerateError> {
        self.drive.ego_mass_kg()
    }

    /// The ego's state as its sensors tell it at a sample; the errors depend on the episode's seed alone.
    ///
    /// # Errors
    /// As [`Self::ego_mass_kg`].
    pub fn measured_state(&self, sample_idx: u64) -> Result<EgoState, GenerateError> {
        let state = self.drive.ego_state()?;
        let told = odometry::measure(&state, &self.sensors.rig().odometry, self.plan.seed, sample_idx);
        Ok(told.unwrap_or(state))
    }

    #[must_use]
    pub fn world_from_ego(&self) -> Transform<World, Ego> {
        self.drive.world_from_ego()
    }

    /// The ego's true state.
    ///
    /// # Errors
    /// [`GenerateError::Simulation`], only if MuJoCo itself fails.
    pub fn ego_state(&self) -> Result<EgoState, GenerateError> {
        self.drive.ego_state()
    }

    /// One control step, 0.05 s, by the driver under test; tells what the ego has come to touch.
    ///
    /// # Errors
    /// [`GenerateError::Simulation`]: the physics became unstable.
    pub fn step_ordered(&mut self, orders: EgoOrders) -> Result<Vec<Contact>, GenerateError> {
        let touches = self.drive.step_ordered(orders)?;
        if touches.is_empty() {
            return Ok(Vec::new());
        }
        let masses_kg = self.drive.simulator.body_masses()?;
        Ok(touches.iter().map(|touch| self.contact(touch, &masses_kg)).collect())
    }

    fn contact(&self, touch: &Touch, masses_kg: &[f64]) -> Contact {
        let simulator = &self.drive.simulator;
        let is_of = |object: &SceneObject| {
            let looks = (0..object.shapes.len()).map(|shape| object.shape_body_name(shape));
            std::iter::once(object.body_name.clone())
                .chain(looks)
                .any(|name| simulator.body(&name) == Some(touch.body))
        };
        let object_idx = self.world.objects().iter().position(is_of);
        let motion = object_idx.map(|i| &self.world.placements[i].motion);
        let (now, before) = (self.drive.poses[touch.body], self.drive.poses_before[touch.body]);
        // What is moved by hand has no velocity of its own in the simulator.
        let moved_mps = (now.translation.vector - before.translation.vector) / CONTROL_PERIOD_S;
        let (other_mps, mass_kg) = match motion {
            Some(Motion::Loose(_)) => (touch.other_mps, masses_kg[touch.body]),
            Some(Motion::Drives { .. } | Motion::Walks(_) | Motion::Follows(_) | Motion::Dashes(_)) => {
                (moved_mps, masses_kg[touch.body])
            }
            Some(Motion::Still) => (Vector3::zeros(), self.still_mass_kg(object_idx)),
            None => (Vector3::zeros(), f64::INFINITY),
        };
        let (body, ego_mps) = (touch.body, touch.own_mps);
        let world_from_ego = self.drive.poses[self.drive.ego_body].rotation;
        let comes_mps = world_from_ego.inverse() * (other_mps - ego_mps);
        let side = side_of_entry(&touch.point_m, &comes_mps);
        let normal = side.map_or(touch.normal, |side| world_from_ego * side);
        Contact { object_idx, body, ego_mps, other_mps, normal, mass_kg }
    }

    /// The mass of what does not move: what lies, and who has parked, weighs what its model does; what is built into the street does not
    /// give way.
    fn still_mass_kg(&self, object_idx: Option<usize>) -> f64 {
        let Some(i) = object_idx else { return f64::INFINITY };
        let object = &self.world.objects()[i];
        let is_built_in =
            object.kind == Kind::Static && object.distribution == Distribution::Id && !object.is_background;
        if is_built_in { f64::INFINITY } else { self.world.models[self.world.placements[i].model].mass_kg }
    }

    /// All objects near the ego that are ever annotated, whether they are seen or not, each with its number.
    #[must_use]
    pub fn present(&self) -> Vec<(usize, Object)> {
        let world_from_ego = self.drive.world_from_ego();
        let ego = world_from_ego.isometry.translation.vector.xy();
        let max_range_m = self.config.raw.annotation.max_range_m;
        let near = |(i, object): (usize, &SceneObject)| {
            let pose = self.drive.poses[self.drive.object_bodies[i]];
            let is_near = (pose.translation.vector.xy() - ego).norm() < max_range_m;
            let seen = || self.observe(i, 0, Vec::new());
            (is_near && !object.is_background)
                .then(|| (i, describe(object, &seen(), CONTROL_PERIOD_S, &world_from_ego)))
        };
        self.world.objects().iter().enumerate().filter_map(near).collect()
    }

    /// An object as it is now, and how much of it the sensors saw.
    fn observe(&self, i: usize, n_lidar_points: u32, visible_px: Vec<u32>) -> Observation {
        let body = self.drive.object_bodies[i];
        Observation {
            shape: self.drive.shapes[i],
            world_from_model: self.drive.poses[body],
            world_from_model_before: self.drive.poses_before[body],
            ground_m: self.world.town.surface.ground_m(self.drive.poses[body].translation.vector.xy()),
            n_lidar_points,
            visible_px,
        }
    }

    /// Gives the files beside the episode their final names.
    ///
    /// # Errors
    /// The disk fails.
    pub fn finish(self) -> Result<(), GenerateError> {
        self.sensors.finish()
    }

    /// Lets the scripted driver drive on to the next sample; on the way each LiDAR turns at each sweep's time.
    pub(super) fn drive_on(
        &mut self,
        sample_idx: u64,
        timings: &mut Timings,
    ) -> Result<Vec<Sweep>, GenerateError> {
        let mut sweeps = Vec::new();
        let Some(before_idx) = sample_idx.checked_sub(1) else { return Ok(sweeps) };
        let Self { config, drive, sensors, .. } = self;
        let n_turns = config.raw.sweeps + 1;
        let n_steps = config.control_steps_per_sample / n_turns;
        for turn in 1..=n_turns {
            time(&mut timings.motion, || (0..n_steps).try_for_each(|_| drive.step()))?;
            if turn == n_turns {
                break;
            }
            let n_lidars = sensors.rig().lidars.len();
            for lidar_idx in 0..n_lidars {
                let sweep_idx = before_idx * u64::from(config.raw.sweeps) + u64::from(turn - 1);
                let cloud = sensors.turn_lidar(lidar_idx, drive, Turn::Sweep(sweep_idx), timings)?;
                sweeps.push(Sweep {
                    lidar: sensors.rig().lidars[lidar_idx].name.clone(),
                    time_ns: config.time_ns(before_idx)
                        + u64::from(turn) * config.period_ns() / u64::from(n_turns),
                    world_from_lidar: sensors.world_from_lidar(lidar_idx, drive),
                    points: cloud.points,
                });
            }
        }
        Ok(sweeps)
    }

    /// The measurements and the truth now, and what the other sensors measured.
    ///
    /// # Errors
    /// [`GenerateError`]: the renderer fails.
    pub fn measure(
        &mut self,
        sample_idx: u64,
        timings: &mut Timings,
    ) -> Result<(Sample, Vec<CameraView>, Vec<LidarView>), GenerateError> {
        let Self { drive, sensors, .. } = self;
        let ego_state = drive.ego_state()?;
        let n_cameras = sensors.rig().cameras.len();
        let pictures: Vec<Picture> = (0..n_cameras)
            .map(|i| sensors.take_picture(i, drive, ego_state.speed_mps, sample_idx, timings))
            .collect::<Result<_, _>>()?;
        let n_lidars = sensors.rig().lidars.len();
        let clouds: Vec<Cloud> = (0..n_lidars)
            .map(|i| sensors.turn_lidar(i, drive, Turn::Sample(sample_idx), timings))
            .collect::<Result<_, _>>()?;

        let begin = Instant::now();
        let (drive, sensors, config) = (&self.drive, &self.sensors, self.config);
        let (rig, world_from_ego) = (sensors.rig(), drive.world_from_ego());
        let told = odometry::measure(&ego_state, &rig.odometry, self.plan.seed, sample_idx);
        let mut truth = Truth { ego_state: told.map(|_| ego_state), ..Truth::default() };
        for (i, object) in self.world.objects().iter().enumerate() {
            let n_points = clouds.iter().map(|cloud| cloud.n_points[i]).sum();
            let visible_px = pictures.iter().map(|picture| picture.visible_px[i]).collect();
            let (seen, annotation) = (self.observe(i, n_points, visible_px), &config.raw.annotation);
            truth.objects.extend(annotate(object, &seen, CONTROL_PERIOD_S, &world_from_ego, rig, annotation));
            truth.ignored.extend(ignore(object, &seen, &world_from_ego, rig, annotation));
        }
        timings.truth += begin.elapsed();

        let mut pictures = rig.cameras.iter().zip(pictures).map(|(camera, picture)| CameraView {
            name: camera.name.clone(),
            ego_from_camera: camera.ego_from_camera,
            intrinsics: camera.intrinsics,
            image: picture.image,
        });
        let mut clouds = rig.lidars.iter().zip(clouds).map(|(lidar, cloud)| LidarView {
            name: lidar.name.clone(),
            ego_from_lidar: lidar.ego_from_lidar,
            points: cloud.points,
        });
        let front = pictures.next().expect("a rig has a front camera");
        let top = clouds.next().expect("a rig has a top LiDAR");
        let measured = Measured {
            time_ns: config.time_ns(sample_idx),
            ego_state: told.unwrap_or(ego_state),
            world_from_ego,
            ego_from_lidar: top.ego_from_lidar,
            ego_from_camera: front.ego_from_camera,
            intrinsics: front.intrinsics,
            image: front.image,
            points: top.points,
        };
        Ok((Sample { measured, truth: Some(truth) }, pictures.collect(), clouds.collect()))
    }
}

/// The sensors beside the front camera and the top LiDAR.
fn other_sensors(rig: &Rig, n_sweeps: u32) -> OtherSensors {
    let Rig { cameras, lidars, .. } = rig;
    let mut others = OtherSensors {
        cameras: cameras[1..].iter().map(|camera| camera.name.clone()).collect(),
        lidars: lidars[1..].iter().map(|lidar| lidar.name.clone()).collect(),
        sweeping: Vec::new(),
    };
    if n_sweeps > 0 {
        others.sweeping = lidars.iter().map(|lidar| lidar.name.clone()).collect();
    }
    others
}

/// At night things are drawn in their own colours, which only the classic renderer does.
fn choose_renderer(name: RendererName, state: &WeatherState) -> Renderer {
    match name {
        RendererName::Filament if !state.is_night() => Renderer::Filament,
        _ => Renderer::Classic,
    }
}
