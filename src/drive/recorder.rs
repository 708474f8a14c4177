//! The files of a drive: the episode, and beside it what was found and ordered.

use std::path::Path;

use super::folder::predictions_file;
use super::{DriveConfig, DriveError};
use crate::config::to_toml;
use crate::episode::{
    DriveLogWriter, EpisodeEntry, EpisodeWriter, SampleCommand, SampleDetections, SourceMeta,
};
use crate::generate::{EpisodePlan, LiveEpisode};
use crate::object::Detection;
use crate::sample::{Around, CameraView, LidarView, Sample};
use crate::scene::{EgoOrders, town_name};

/// The files of a drive that is recorded.
pub(super) struct Recorder {
    writer: EpisodeWriter,
    detections: Vec<SampleDetections>,
    commands: Vec<SampleCommand>,
}

impl Recorder {
    /// Starts the episode's file.
    pub fn create(live: &LiveEpisode<'_>, path: &Path) -> Result<Self, DriveError> {
        if let Some(folder) = path.parent() {
            fs_err::create_dir_all(folder)?;
        }
        let writer = live.writer(path)?;
        Ok(Self { writer, detections: Vec::new(), commands: Vec::new() })
    }

    /// Writes a sample, and keeps what was found in it.
    pub fn record(
        &mut self,
        (sample, views, clouds): (Sample, Vec<CameraView>, Vec<LidarView>),
        detections: Vec<Detection>,
    ) -> Result<(), DriveError> {
        let around = Around { views: &views, clouds: &clouds, sweeps: &[] };
        self.writer.write_around(&sample, around)?;
        self.detections.push(SampleDetections { time_ns: sample.measured.time_ns, detections });
        Ok(())
    }

    /// Whether no sample was written.
    pub fn is_empty(&self) -> bool {
        self.detections.is_empty()
    }

    /// Notes a control step; the first after a sample is the sample's command.
    pub fn note(&mut self, orders: &EgoOrders, speed_mps: f64, is_harmful: bool) {
        if self.commands.len() < self.detections.len() {
            let time_ns = self.detections[self.commands.len()].time_ns;
            let braking_mps2 = orders.braking_mps2;
            self.commands.push(SampleCommand { time_ns, braking_mps2, speed_mps, is_harmful });
        }
    }

    /// Writes what was found and ordered beside the episode, and names the files.
    pub fn finish(
        self,
        folder: &Path,
        who: &str,
        plan: &EpisodePlan,
        config: &DriveConfig,
    ) -> Result<EpisodeEntry, DriveError> {
        let finished = self.writer.finish()?;
        let meta = SourceMeta {
            episode: plan.name.clone(),
            episode_sha256: finished.sha256.clone(),
            set: who.to_owned(),
            config_toml: to_toml(&config.reflex),
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let path = predictions_file(folder, plan);
        if let Some(folder) = path.parent() {
            fs_err::create_dir_all(folder)?;
        }
        let mut log = DriveLogWriter::create(&path, &meta)?;
        for (i, found) in self.detections.iter().enumerate() {
            log.write(found, self.commands.get(i))?;
        }
        log.finish()?;
        Ok(EpisodeEntry {
            name: plan.name.clone(),
            file: plan.file(),
            split: plan.split,
            seed: plan.seed,
            town: town_name(&plan.town),
            weather: plan.weather.name().to_owned(),
            ood: config.world.scene.ood,
            n_samples: finished.n_samples,
            n_objects: finished.n_objects,
            sha256: finished.sha256,
        })
    }
}
