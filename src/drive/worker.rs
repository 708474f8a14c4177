//! `drive`'s worker processes: each drives episodes for the drivers that it is told.

use std::io::{self, BufRead, Write};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::episode::{Files, drive};
use super::perception::Perception;
use super::scenario::{Scenario, course};
use super::{DriveConfig, DriveError};
use crate::device::DeviceName;
use crate::outcome::{DriveOutcome, Who};
use crate::worker;

/// The hidden command that serves tasks.
pub(super) const COMMAND: &str = "drive-worker";

/// Settings that all tasks of a worker share.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct DriveJob {
    pub(super) config: DriveConfig,
    /// Who drives, with the hash of what each drives by.
    pub(super) drivers: Vec<(Who, String)>,
    /// Driven in place of the config's worlds, if there are any.
    pub(super) scenarios: Vec<Scenario>,
    /// Of all drivers' folders.
    pub(super) folder: PathBuf,
    pub(super) records: bool,
    pub(super) device: String,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Task {
    pub who_idx: usize,
    pub course_idx: u32,
}

/// The worker's side: serves tasks from `input` until it ends.
///
/// # Errors
/// As [`worker::serve`].
pub fn serve(input: impl BufRead, output: impl Write) -> io::Result<()> {
    worker::serve(input, output, |job: DriveJob| {
        // The last driver's perception is kept: tasks come driver by driver.
        let mut opened: Option<(usize, Perception)> = None;
        move |task: Task, on_sample: &mut dyn FnMut() -> io::Result<()>| {
            make(&job, task, &mut opened, on_sample)
        }
    })
}

fn make(
    job: &DriveJob,
    task: Task,
    opened: &mut Option<(usize, Perception)>,
    on_sample: &mut dyn FnMut() -> io::Result<()>,
) -> Result<DriveOutcome, DriveError> {
    let course = course(&job.config, &job.scenarios, task.course_idx)?;
    let (who, sha256) = &job.drivers[task.who_idx];
    let perception = match opened {
        Some((idx, perception)) if *idx == task.who_idx => perception,
        _ => {
            let device: DeviceName = job.device.parse()?;
            let perception = Perception::open(
                &who.source,
                sha256,
                &job.config.reflex,
                job.config.reply_s,
                &device.open()?,
            )?;
            &mut opened.insert((task.who_idx, perception)).1
        }
    };
    let folder = job.folder.join(&who.name);
    let files = Files { folder: &folder, who: &who.name, records: job.records };
    drive(&course, perception, who.source.needs_sensors(), &files, on_sample)
}
