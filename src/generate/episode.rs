//! One episode: drives, and every 0.3 s of simulated time records measurements and truth.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use nalgebra::Vector3;
use rand::RngExt;

use super::annotate::{Observation, annotate};
use super::aov::AovWriter;
use super::appearance::Appearance;
use super::config::{CONTROL_PERIOD_S, RendererName};
use super::drive::Drive;
use super::lighting::lighting;
use super::rays::Caster;
use super::surfaces::Surface;
use super::{CheckedConfig, EpisodePlan, GenerateError, map};
use crate::config::to_toml;
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter};
use crate::random;
use crate::sample::{EncodedImage, ImageFormat, Measured, Sample, Truth};
use crate::scene::{self, Town, populate_in};
use crate::sensors::camera::{Material, Rendered, Scope, Shot};
use crate::sensors::lidar::{Hit, Receiver, Reflector, is_in_view};
use crate::sensors::{Rig, WeatherState, odometry};
use crate::sim::{CameraMount, DrawnView, Renderer, Simulator};

/// Simulated time begins on 2025-01-01, whatever the wall clock says.
const EPOCH_NS: u64 = 1_735_689_600_000_000_000;

/// Lanes farther than this from the route are not drawn.
const MAP_REACH_M: f64 = 100.0;

/// Time spent in each part of an episode.
#[derive(Debug, Clone, Copy, Default)]
pub struct Timings {
    pub set_up: Duration,
    pub warm_up: Duration,
    pub motion: Duration,
    /// With the geom of each pixel, and its depth where it is needed.
    pub picture: Duration,
    /// Weather and daytime in the camera's picture.
    pub weather: Duration,
    pub rays: Duration,
    pub packing: Duration,
    pub truth: Duration,
    pub writing: Duration,
    pub finishing: Duration,
}

/// Makes one episode in the data set's folder; it calls `on_sample` for each written sample.
///
/// # Errors
/// [`GenerateError`]: unknown town, no simulator, unstable physics, a full or broken disk. No file is left then.
pub fn record(
    config: &CheckedConfig,
    plan: &EpisodePlan,
    folder: &Path,
    on_sample: &mut dyn FnMut() -> std::io::Result<()>,
) -> Result<(EpisodeEntry, Timings), GenerateError> {
    let mut recording = Recording::start(config, plan, folder)?;
    recording.record_samples(on_sample)?;
    recording.finish()
}

/// An episode while it is recorded.
pub struct Recording<'a> {
    config: &'a CheckedConfig,
    plan: &'a EpisodePlan,
    world: scene::World,
    drive: Drive,
    /// As drawn for this episode.
    rig: Rig,
    appearance: Appearance,
    caster: Caster,
    receiver: Receiver,
    scope: Scope,
    meta: EpisodeMeta,
    writer: EpisodeWriter,
    aov: Option<AovWriter>,
    timings: Timings,
}

/// Adds the time that a call takes.
fn time<T>(spent: &mut Duration, call: impl FnOnce() -> T) -> T {
    let begin = Instant::now();
    let result = call();
    *spent += begin.elapsed();
    result
}

impl<'a> Recording<'a> {
    /// Fills the town, sets the simulator up and drives until the first sample is due.
    ///
    /// # Errors
    /// As [`record`].
    pub fn start(
        config: &'a CheckedConfig,
        plan: &'a EpisodePlan,
        folder: &Path,
    ) -> Result<Self, GenerateError> {
        let begin = Instant::now();
        let raw = &config.raw;
        let rig_config = raw.rig_variation.draw(&raw.rig, plan.seed);
        let rig = Rig::try_from(&rig_config)?;
        let town = shared_town(&plan.town)?;
        let state = plan.weather.state().replace_by(&raw.weather_override)?;
        let world = populate_in(&town, &raw.scene, state.rain_rate_mmph > 0.0, plan.seed)?;
        let mount = CameraMount {
            body: "ego".into(),
            ego_from_camera: rig.front().ego_from_camera,
            intrinsics: rig.front().intrinsics,
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
        let size_px = (rig.front().intrinsics.width_px as usize, rig.front().intrinsics.height_px as usize);
        let appearance = Appearance::new(&world, &drive)?;
        let meta = EpisodeMeta { background: appearance.background.join(","), ..meta };
        let aov = || AovWriter::create(folder, &plan.name, size_px, world.objects(), &appearance.background);
        let aov = raw.render.aov.then(aov).transpose()?;
        let mut recording = Self {
            config,
            plan,
            appearance,
            caster: Caster::new(raw.lidar_engine, rig.top(), &drive.simulator)?,
            receiver: Receiver::new(&rig.top().config, rig.top().n_rings, &state, plan.seed),
            scope: Scope::new(plan.weather, &state, rig.front(), plan.seed),
            writer: EpisodeWriter::create(&folder.join(plan.file()), &meta, &map)?,
            aov,
            timings: Timings { set_up: begin.elapsed(), ..Timings::default() },
            meta,
            drive,
            world,
            rig,
        };
        recording.warm_up()?;
        Ok(recording)
    }

    fn warm_up(&mut self) -> Result<(), GenerateError> {
        let [least_s, most_s] = self.config.raw.warm_up_s;
        let draw: f64 = random::stream(self.plan.seed, "warm-up", 0).random();
        let n_steps = ((least_s + (most_s - least_s) * draw) / CONTROL_PERIOD_S).round() as u32;
        time(&mut self.timings.warm_up, || (0..n_steps).try_for_each(|_| self.drive.step()))
    }

    /// The simulated world.
    pub fn simulator(&mut self) -> &mut Simulator {
        &mut self.drive.simulator
    }

    /// Whether its pictures are made with depths.
    pub fn needs_depth(&self) -> bool {
        self.scope.needs_depth() || self.aov.is_some()
    }

    /// Drives on and writes the samples, one after the other.
    ///
    /// # Errors
    /// As [`record`], and what `on_sample` returns.
    pub fn record_samples(
        &mut self,
        on_sample: &mut dyn FnMut() -> std::io::Result<()>,
    ) -> Result<(), GenerateError> {
        for sample_idx in 0..u64::from(self.config.raw.samples) {
            let n_steps = if sample_idx == 0 { 0 } else { self.config.control_steps_per_sample };
            time(&mut self.timings.motion, || (0..n_steps).try_for_each(|_| self.drive.step()))?;
            let sample = self.sample(sample_idx)?;
            time(&mut self.timings.writing, || self.writer.write(&sample))?;
            on_sample()?;
        }
        Ok(())
    }

    /// Gives the files their final names.
    ///
    /// # Errors
    /// [`GenerateError`]: the disk fails.
    pub fn finish(self) -> Result<(EpisodeEntry, Timings), GenerateError> {
        let Self { plan, meta, writer, aov, mut timings, .. } = self;
        let finished = time(&mut timings.finishing, || {
            aov.map_or(Ok(()), AovWriter::finish)?;
            writer.finish().map_err(GenerateError::from)
        })?;
        let entry = EpisodeEntry {
            name: plan.name.clone(),
            file: plan.file(),
            split: plan.split,
            seed: plan.seed,
            town: meta.town,
            weather: meta.weather,
            ood: meta.ood,
            n_samples: finished.n_samples,
            n_objects: finished.n_objects,
            sha256: finished.sha256,
        };
        Ok((entry, timings))
    }

    /// The measurements and the truth now.
    fn sample(&mut self, sample_idx: u64) -> Result<Sample, GenerateError> {
        let needs_depth = self.needs_depth();
        let Self { config, drive, rig, appearance, timings, .. } = self;
        let (camera, lidar) = (rig.front(), rig.top());
        let world_from_ego = drive.world_from_ego();
        let simulator = &mut drive.simulator;
        let DrawnView { rgb, depth_m, geoms } = time(&mut timings.picture, || simulator.render(needs_depth))?;
        if let Some(aov) = &self.aov {
            let shown = geoms.iter().map(|&geom| (appearance.object(geom), appearance.background(geom)));
            time(&mut timings.writing, || aov.write(sample_idx, &depth_m, shown))?;
        }

        let ego_state = drive.ego_state()?;
        let picture = time(&mut timings.weather, || {
            let material: Vec<Material> = geoms.iter().map(|&geom| appearance.material(geom)).collect();
            let rendered = Rendered { rgb: &rgb, depth_m: &depth_m, material: &material };
            let (speed_mps, lamps) = (ego_state.speed_mps, &appearance.lamps);
            self.scope.see(&rendered, &Shot { world_from_ego, speed_mps, lamps, sample_idx })
        });
        let mut bytes = Vec::new();
        let quality = camera.config.jpeg_quality.unwrap_or(config.raw.render.jpeg_quality);
        time(&mut timings.packing, || {
            let mut encoder = Encoder::new(&mut bytes, quality);
            encoder.set_sampling_factor(SamplingFactor::F_1_1);
            encoder.set_optimized_huffman_tables(true);
            let [width, height] = [picture.width(), picture.height()].map(|px| px as u16);
            encoder.encode(picture.as_raw(), width, height, ColorType::Rgb)
        })?;

        let world_from_lidar = world_from_ego * lidar.ego_from_lidar;
        let hits = time(&mut timings.rays, || self.caster.cast(drive, lidar, &world_from_lidar))?;

        let begin = Instant::now();
        let mut seen: Vec<Observation> = drive
            .object_bodies
            .iter()
            .zip(&drive.shapes)
            .map(|(&body, &shape)| Observation {
                shape,
                world_from_model: drive.poses[body],
                world_from_model_before: drive.poses_before[body],
                n_lidar_points: 0,
                visible_px: 0,
                ground_m: self.world.town.surface.ground_m(drive.poses[body].translation.vector.xy()),
            })
            .collect();
        for object in geoms.iter().filter_map(|&geom| appearance.object(geom)) {
            seen[object].visible_px += 1;
        }
        let reflections: Vec<Hit> = (0..hits.geom.len())
            .map(|ray| {
                let (Surface { reflectivity, finish }, is_paved) = appearance.surface(hits.geom[ray]);
                let (range_m, cos_incidence) = (hits.range_m[ray], hits.cos_incidence[ray]);
                Hit { range_m, cos_incidence, reflectivity, is_paved, finish }
            })
            .collect();
        let camera_from_lidar = camera.ego_from_camera.inverse() * lidar.ego_from_lidar;
        let mut points = Vec::new();
        for found in self.receiver.returns(&lidar.pattern, &reflections, sample_idx) {
            let at = Vector3::new(found.point.x_m, found.point.y_m, found.point.z_m).cast::<f64>();
            if !is_in_view(&at, &camera.intrinsics, &camera_from_lidar) {
                continue;
            }
            let object = appearance.object(hits.geom[found.ray]);
            if let (Reflector::Target, Some(object)) = (found.reflector, object) {
                seen[object].n_lidar_points += 1;
            }
            points.push(found.point);
        }
        let truths = self.world.objects().iter().zip(&seen).filter_map(|(object, seen)| {
            annotate(object, seen, CONTROL_PERIOD_S, &world_from_ego, rig, &config.raw.annotation)
        });
        let told = odometry::measure(&ego_state, &rig.odometry, self.plan.seed, sample_idx);
        let truth =
            Truth { objects: truths.collect(), ego_state: told.map(|_| ego_state), ..Truth::default() };
        timings.truth += begin.elapsed();

        let period_ns = (config.raw.sample_period_s * 1e9).round() as u64;
        let measured = Measured {
            time_ns: EPOCH_NS + sample_idx * period_ns,
            ego_state: told.unwrap_or(ego_state),
            world_from_ego,
            ego_from_lidar: lidar.ego_from_lidar,
            ego_from_camera: camera.ego_from_camera,
            intrinsics: camera.intrinsics,
            image: EncodedImage { format: ImageFormat::Jpeg, bytes },
            points,
        };
        Ok(Sample { measured, truth: Some(truth) })
    }
}

/// Towns of a process's earlier episodes, the latest last.
static TOWNS: Mutex<Vec<(String, Arc<Town>)>> = Mutex::new(Vec::new());
/// As many towns are kept.
const MAX_TOWNS: usize = 8;

/// A town by name or path, which is read once for the episodes of a process.
fn shared_town(name: &str) -> Result<Arc<Town>, GenerateError> {
    let mut towns = TOWNS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, town)) = towns.iter().find(|(known, _)| known == name) {
        return Ok(Arc::clone(town));
    }
    let town = Arc::new(Town::load(name)?);
    if towns.len() == MAX_TOWNS {
        towns.remove(0);
    }
    towns.push((name.to_owned(), Arc::clone(&town)));
    Ok(town)
}

/// At night things are drawn in their own colours, which only the classic renderer does.
fn choose_renderer(name: RendererName, state: &WeatherState) -> Renderer {
    match name {
        RendererName::Filament if !state.is_night() => Renderer::Filament,
        _ => Renderer::Classic,
    }
}
