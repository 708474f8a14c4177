//! One episode: drives, and every 0.3 s of simulated time records measurements and truth.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use rand::RngExt;

use super::annotate::{Observation, annotate};
use super::aov::AovWriter;
use super::appearance::Appearance;
use super::config::{CONTROL_PERIOD_S, RendererName};
use super::drive::Drive;
use super::folder::OWN_MODELS;
use super::leaves::Leaves;
use super::lighting::lighting;
use super::sensing::{Cloud, Picture, Sensors};
use super::timings::{Timings, time};
use super::{CheckedConfig, EpisodePlan, GenerateError, map};
use crate::config::to_toml;
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, OtherSensors};
use crate::random;
use crate::sample::{Around, CameraView, LidarView, Measured, Sample, Sweep, Truth};
use crate::scene::{self, Town, populate_in};
use crate::sensors::lidar::Turn;
use crate::sensors::{Rig, WeatherState, odometry};
use crate::sim::{CameraMount, Renderer, Simulator};

/// Lanes farther than this from the route are not drawn.
const MAP_REACH_M: f64 = 100.0;

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
    sensors: Sensors,
    meta: EpisodeMeta,
    writer: EpisodeWriter,
    timings: Timings,
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
        let others = other_sensors(&rig, raw.sweeps);
        let mut recording = Self {
            config,
            plan,
            sensors: Sensors::new(config, plan, &state, rig, (appearance, Leaves::new(&world)), &drive, aov)?,
            writer: EpisodeWriter::create_rig(&folder.join(plan.file()), &meta, others, &map)?,
            timings: Timings { set_up: begin.elapsed(), ..Timings::default() },
            meta,
            drive,
            world,
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
        self.sensors.needs_depth()
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
            let sweeps = self.drive_on(sample_idx)?;
            let (sample, views, clouds) = self.sample(sample_idx)?;
            let around = Around { views: &views, clouds: &clouds, sweeps: &sweeps };
            time(&mut self.timings.writing, || self.writer.write_around(&sample, around))?;
            on_sample()?;
        }
        Ok(())
    }

    /// Gives the files their final names.
    ///
    /// # Errors
    /// [`GenerateError`]: the disk fails.
    pub fn finish(self) -> Result<(EpisodeEntry, Timings), GenerateError> {
        let Self { plan, meta, writer, sensors, mut timings, .. } = self;
        let finished = time(&mut timings.finishing, || {
            sensors.finish()?;
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

    /// Drives on to the next sample; on the way each LiDAR turns at each sweep's time.
    fn drive_on(&mut self, sample_idx: u64) -> Result<Vec<Sweep>, GenerateError> {
        let mut sweeps = Vec::new();
        let Some(before_idx) = sample_idx.checked_sub(1) else { return Ok(sweeps) };
        let Self { config, drive, sensors, timings, .. } = self;
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
    fn sample(
        &mut self,
        sample_idx: u64,
    ) -> Result<(Sample, Vec<CameraView>, Vec<LidarView>), GenerateError> {
        let Self { config, drive, sensors, timings, .. } = self;
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
        let (rig, world_from_ego) = (sensors.rig(), drive.world_from_ego());
        let truths = self.world.objects().iter().enumerate().filter_map(|(i, object)| {
            let body = drive.object_bodies[i];
            let seen = Observation {
                shape: drive.shapes[i],
                world_from_model: drive.poses[body],
                world_from_model_before: drive.poses_before[body],
                ground_m: self.world.town.surface.ground_m(drive.poses[body].translation.vector.xy()),
                n_lidar_points: clouds.iter().map(|cloud| cloud.n_points[i]).sum(),
                visible_px: pictures.iter().map(|picture| picture.visible_px[i]).collect(),
            };
            annotate(object, &seen, CONTROL_PERIOD_S, &world_from_ego, rig, &config.raw.annotation)
        });
        let told = odometry::measure(&ego_state, &rig.odometry, self.plan.seed, sample_idx);
        let truth =
            Truth { objects: truths.collect(), ego_state: told.map(|_| ego_state), ..Truth::default() };
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::episode::EpisodeReader;
    use crate::generate::{GenerateConfig, plan};

    /// Records the first episode of a config below a folder.
    pub(in crate::generate) fn record_first(config: &GenerateConfig, folder: &Path) -> EpisodeReader {
        let config = CheckedConfig::try_from(config).unwrap();
        let plan = plan(&config, 1).remove(0);
        let path = folder.join(plan.file());
        fs_err::create_dir_all(path.parent().unwrap()).unwrap();
        record(&config, &plan, folder, &mut || Ok(())).unwrap();
        EpisodeReader::open(&path).unwrap()
    }
}
