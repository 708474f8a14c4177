//! One episode: drives, and every 0.3 s of simulated time records measurements and truth.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::live::LiveEpisode;
use super::timings::{Timings, time};
use super::{CheckedConfig, EpisodePlan, GenerateError};
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, MadeWith};
use crate::sample::Around;
use crate::sim::Simulator;

/// An episode that is made, and with what.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Made {
    pub entry: EpisodeEntry,
    pub made_with: MadeWith,
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
) -> Result<(Made, Timings), GenerateError> {
    let mut recording = Recording::start(config, plan, folder)?;
    recording.record_samples(on_sample)?;
    recording.finish()
}

/// An episode while it is recorded.
pub struct Recording<'a> {
    config: &'a CheckedConfig,
    plan: &'a EpisodePlan,
    live: LiveEpisode<'a>,
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
        let live = LiveEpisode::start(config, plan, folder)?;
        let writer = live.writer(&folder.join(plan.file()))?;
        let timings = Timings { set_up: begin.elapsed(), ..Timings::default() };
        let meta = live.meta().clone();
        let mut recording = Self { config, plan, live, meta, writer, timings };
        recording.live.warm_up(&mut recording.timings)?;
        Ok(recording)
    }

    /// The simulated world.
    pub fn simulator(&mut self) -> &mut Simulator {
        self.live.simulator()
    }

    /// Whether its pictures are made with depths.
    pub fn needs_depth(&self) -> bool {
        self.live.needs_depth()
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
            let sweeps = self.live.drive_on(sample_idx, &mut self.timings)?;
            let (sample, views, clouds) = self.live.measure(sample_idx, &mut self.timings)?;
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
    pub fn finish(self) -> Result<(Made, Timings), GenerateError> {
        let Self { plan, meta, writer, mut live, mut timings, .. } = self;
        let made_with = made_with(live.simulator())?;
        let finished = time(&mut timings.finishing, || {
            live.finish()?;
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
        Ok((Made { entry, made_with }, timings))
    }
}

/// What a simulator's measurements are made with.
fn made_with(simulator: &mut Simulator) -> Result<MadeWith, GenerateError> {
    let [_, renderer, version] = simulator.gl_info()?;
    let [mujoco, libc] = simulator.library_versions()?;
    Ok(MadeWith::here(mujoco, format!("{renderer}, {version}"), libc))
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
