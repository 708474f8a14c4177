//! `gen`'s worker processes: each makes episodes of one config.

use std::io::{self, BufRead, Write};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::episode::{self, Made};
use super::{CheckedConfig, GenerateConfig, GenerateError, plan};
use crate::episode::folder::EPISODES;
use crate::worker;

/// The hidden command that serves tasks.
pub(super) const COMMAND: &str = "gen-worker";

/// Settings that all tasks of a worker share.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Job {
    pub config: GenerateConfig,
    pub folder: PathBuf,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Task {
    pub episode_idx: u32,
}

/// The worker's side: serves tasks from `input` until it ends.
///
/// # Errors
/// As [`worker::serve`].
pub fn serve(input: impl BufRead, output: impl Write) -> io::Result<()> {
    worker::serve(input, output, |job: Job| {
        move |task: Task, on_sample: &mut dyn FnMut() -> io::Result<()>| make(&job, task, on_sample)
    })
}

fn make(job: &Job, task: Task, on_sample: &mut dyn FnMut() -> io::Result<()>) -> Result<Made, GenerateError> {
    let config = CheckedConfig::try_from(&job.config)?;
    let plan = plan(&config, task.episode_idx + 1).pop().expect("the plan holds the episode");
    // A node of a cluster begins with an empty folder.
    fs_err::create_dir_all(job.folder.join(EPISODES))?;
    let (made, timings) = episode::record(&config, &plan, &job.folder, on_sample)?;
    tracing::info!(episode = plan.name, ?timings, "made");
    Ok(made)
}
