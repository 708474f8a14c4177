//! One episode: drive, and every 0.3 s of simulated time write down what is measured and what is true.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::annotate::{Observation, Shape, annotate};
use super::aov::AovWriter;
use super::appearance::Appearance;
use super::config::{CONTROL_PERIOD_S, RendererName};
use super::drive::Drive;
use super::{CheckedConfig, EpisodePlan, GenerateError, map};
use crate::config::to_toml;
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter};
use crate::geometry::Point;
use crate::random;
use crate::sample::{EncodedImage, ImageFormat, Measured, Sample, Truth};
use crate::scene::{Lighting, SceneObject, Sun, Town, populate};
use crate::sensors::WeatherState;
use crate::sensors::camera::{Material, Rendered, Scope, Shot};
use crate::sensors::lidar::{self, Hit, Receiver, Source};
use crate::sim::{CameraMount, Renderer, Simulator};

/// Simulated time begins on 2025-01-01, never at the wall clock.
const EPOCH_NS: u64 = 1_735_689_600_000_000_000;

/// Lanes farther than this from the route are not drawn.
const MAP_REACH_M: f64 = 100.0;

/// Where the time of an episode went.
#[derive(Debug, Clone, Copy, Default)]
pub struct Timings {
    pub set_up: Duration,
    pub warm_up: Duration,
    pub motion: Duration,
    pub picture: Duration,
    pub segmentation: Duration,
    /// Weather and daytime in the camera's picture.
    pub weather: Duration,
    pub rays: Duration,
    pub packing: Duration,
    pub truth: Duration,
    pub writing: Duration,
    pub finishing: Duration,
}

/// When a watcher of an episode is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Before the first sample.
    WarmedUp,
    /// After the last sample.
    Sampled,
}

/// Called at each [`Moment`] of an episode.
pub type Watch<'a> = dyn FnMut(Moment, &mut Simulator) -> Result<(), GenerateError> + 'a;

/// Makes one episode in the data set's folder; `on_sample` hears of each written sample.
///
/// # Errors
/// [`GenerateError`]: unknown town, no simulator, unstable physics, the disk. Nothing is left then.
pub fn record(
    config: &CheckedConfig,
    plan: &EpisodePlan,
    folder: &Path,
    on_sample: &mut dyn FnMut() -> std::io::Result<()>,
) -> Result<(EpisodeEntry, Timings), GenerateError> {
    record_watched(config, plan, folder, on_sample, &mut |_, _| Ok(()))
}

/// As [`record`], with a watcher.
///
/// # Errors
/// As [`record`], and what the watcher says.
pub fn record_watched(
    config: &CheckedConfig,
    plan: &EpisodePlan,
    folder: &Path,
    on_sample: &mut dyn FnMut() -> std::io::Result<()>,
    watch: &mut Watch<'_>,
) -> Result<(EpisodeEntry, Timings), GenerateError> {
    let mut timings = Timings::default();
    let begin = Instant::now();
    let town = Arc::new(Town::load(&plan.town)?);
    let world = populate(&town, &config.raw.scene, plan.seed)?;
    let state = plan.weather.state().replaced(&config.raw.weather_override)?;
    let mount = CameraMount {
        body: "ego".into(),
        ego_from_camera: config.rig.ego_from_camera,
        intrinsics: config.rig.intrinsics,
        n_samples: config.raw.render.samples_per_pixel,
        shadow_size_px: config.raw.render.shadow_size_px,
        renderer: renderer(config.raw.render.renderer, &state),
    };
    let mut drive = Drive::new(&world, &lighting(&state), &mount, plan.seed)?;
    let sensing = Sensing {
        config,
        objects: world.objects(),
        appearance: Appearance::new(&world, &drive)?,
        receiver: Receiver::new(&config.rig.noise, config.rig.n_rings, &state, plan.seed),
        scope: Scope::new(plan.weather, &state, &config.rig, plan.seed),
    };
    let meta = EpisodeMeta {
        name: plan.name.clone(),
        seed: plan.seed,
        town: town.name.clone(),
        weather: plan.weather.name().to_owned(),
        ood: config.raw.scene.ood,
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        config_toml: to_toml(&config.raw),
        rig_toml: to_toml(&config.raw.rig),
        n_samples: config.raw.samples as usize,
    };
    let route: Vec<[f64; 2]> = world.ego_route.path.sampled(20.0).iter().map(|at| [at.x, at.y]).collect();
    let map = map::drawing(&town.graph, &town.surface.ground, &route, MAP_REACH_M);
    let mut writer = EpisodeWriter::create(&folder.join(plan.file()), &meta, &map)?;
    let size_px = (config.raw.rig.camera.width_px as usize, config.raw.rig.camera.height_px as usize);
    let aov = config
        .raw
        .render
        .aov
        .then(|| AovWriter::create(folder, &plan.name, size_px, world.objects()))
        .transpose()?;
    timings.set_up = begin.elapsed();

    let begin = Instant::now();
    let [least_s, most_s] = config.raw.warm_up_s;
    let draw: f64 = random::stream(plan.seed, "warm-up", 0).random();
    let n_warm_up_steps = ((least_s + (most_s - least_s) * draw) / CONTROL_PERIOD_S).round() as u32;
    for _ in 0..n_warm_up_steps {
        drive.step()?;
    }
    timings.warm_up = begin.elapsed();
    watch(Moment::WarmedUp, &mut drive.simulator)?;
    for sample_idx in 0..u64::from(config.raw.samples) {
        let begin = Instant::now();
        let n_steps = if sample_idx == 0 { 0 } else { config.control_steps_per_sample };
        for _ in 0..n_steps {
            drive.step()?;
        }
        timings.motion += begin.elapsed();
        let sample = sensing.sample(&mut drive, sample_idx, aov.as_ref(), &mut timings)?;
        let begin = Instant::now();
        writer.write(&sample)?;
        timings.writing += begin.elapsed();
        on_sample()?;
    }
    watch(Moment::Sampled, &mut drive.simulator)?;
    let begin = Instant::now();
    if let Some(aov) = aov {
        aov.finish()?;
    }
    let finished = writer.finish()?;
    timings.finishing = begin.elapsed();
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

/// The renderer's light by the weather's.
fn lighting(state: &WeatherState) -> Lighting {
    let light = state.light();
    let sun = light.sun.map(|sun| Sun {
        direction: sun.direction,
        colour: sun.colour,
        casts_shadow: sun.casts_shadow,
    });
    Lighting { ambient: light.ambient, sun }
}

/// At night things are drawn in their own colours, which only the classic renderer does.
fn renderer(name: RendererName, state: &WeatherState) -> Renderer {
    match name {
        RendererName::Filament if !state.is_night() => Renderer::Filament,
        _ => Renderer::Classic,
    }
}

/// What turns the state of the world into samples.
struct Sensing<'a> {
    config: &'a CheckedConfig,
    objects: &'a [SceneObject],
    appearance: Appearance,
    receiver: Receiver,
    scope: Scope,
}

impl Sensing<'_> {
    fn sample(
        &self,
        drive: &mut Drive,
        sample_idx: u64,
        aov: Option<&AovWriter>,
        timings: &mut Timings,
    ) -> Result<Sample, GenerateError> {
        let rig = &self.config.rig;
        let world_from_ego = drive.world_from_ego();
        let mut seen: Vec<Observation> = drive
            .object_bodies
            .iter()
            .map(|&body| Observation {
                world_from_model: drive.poses[body],
                world_from_model_before: drive.poses_before[body],
                n_lidar_points: 0,
                visible_px: 0,
            })
            .collect();

        let begin = Instant::now();
        let (rgb, depth_m) = if self.scope.needs_depth() || aov.is_some() {
            let picture = drive.simulator.render_rgb_and_depth()?;
            (picture.rgb, picture.depth_m)
        } else {
            (drive.simulator.render_rgb()?, Vec::new())
        };
        timings.picture += begin.elapsed();

        let begin = Instant::now();
        let geoms = drive.simulator.render_segmentation()?.geom;
        timings.segmentation += begin.elapsed();
        if let Some(aov) = aov {
            let begin = Instant::now();
            let objects = geoms.iter().map(|&geom| self.appearance.object(geom));
            aov.write(sample_idx, &depth_m, objects)?;
            timings.writing += begin.elapsed();
        }

        let begin = Instant::now();
        let material: Vec<Material> = geoms.iter().map(|&geom| self.appearance.material(geom)).collect();
        let rendered = Rendered { rgb: &rgb, depth_m: &depth_m, material: &material };
        let ego_state = drive.ego_state()?;
        let shot = Shot {
            world_from_ego,
            speed_mps: ego_state.speed_mps,
            lamps: &self.appearance.lamps,
            sample_idx,
        };
        let picture = self.scope.see(&rendered, &shot);
        timings.weather += begin.elapsed();

        let begin = Instant::now();
        let mut bytes = Vec::new();
        let quality = self.config.raw.render.jpeg_quality;
        JpegEncoder::new_with_quality(&mut bytes, quality).encode_image(&picture)?;
        let image = EncodedImage { format: ImageFormat::Jpeg, bytes };
        timings.packing += begin.elapsed();

        let begin = Instant::now();
        for &geom in &geoms {
            if let Some(object) = self.appearance.object(geom) {
                seen[object].visible_px += 1;
            }
        }
        timings.truth += begin.elapsed();

        let begin = Instant::now();
        let world_from_lidar = world_from_ego * rig.ego_from_lidar;
        let directions: Vec<Vector3<f64>> =
            rig.pattern.directions.iter().map(|direction| world_from_lidar.rotate(direction)).collect();
        let origin = (world_from_lidar * Point::new(0.0, 0.0, 0.0)).coords;
        let hits = drive.simulator.cast_rays(&origin, &directions, rig.noise.max_range_m + 1.0)?;
        timings.rays += begin.elapsed();

        let begin = Instant::now();
        let reflections: Vec<Hit> = (0..directions.len())
            .map(|ray| {
                let (reflectivity, is_paved) = self.appearance.surface(hits.geom[ray]);
                Hit {
                    range_m: hits.range_m[ray],
                    cos_incidence: hits.cos_incidence[ray],
                    reflectivity,
                    is_paved,
                }
            })
            .collect();
        let camera_from_lidar = rig.ego_from_camera.inverse() * rig.ego_from_lidar;
        let mut points = Vec::new();
        for found in self.receiver.returns(&rig.pattern, &reflections, sample_idx) {
            let at = Vector3::new(found.point.x_m, found.point.y_m, found.point.z_m).cast::<f64>();
            if !lidar::is_in_view(&at, &rig.intrinsics, &camera_from_lidar) {
                continue;
            }
            if let (Source::Target, Some(object)) =
                (found.source, self.appearance.object(hits.geom[found.ray]))
            {
                seen[object].n_lidar_points += 1;
            }
            points.push(found.point);
        }
        let annotation = &self.config.raw.annotation;
        let truths = self.objects.iter().zip(&seen).filter_map(|(object, seen)| {
            let shape = Shape {
                id: &object.id,
                category: &object.category,
                kind: object.kind,
                distribution: object.distribution,
                event: object.event,
                bounds: [Point3::from(object.bounds.0), Point3::from(object.bounds.1)],
                triangles: &object.triangles,
            };
            annotate(&shape, seen, CONTROL_PERIOD_S, &world_from_ego, rig, annotation)
        });
        let truth = Truth { objects: truths.collect() };
        timings.truth += begin.elapsed();

        let period_ns = (self.config.raw.sample_period_s * 1e9).round() as u64;
        let measured = Measured {
            time_ns: EPOCH_NS + sample_idx * period_ns,
            ego_state,
            world_from_ego,
            ego_from_lidar: rig.ego_from_lidar,
            ego_from_camera: rig.ego_from_camera,
            intrinsics: rig.intrinsics,
            image,
            points,
        };
        Ok(Sample { measured, truth })
    }
}
