//! Tasks, and what those of one command share.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::Program;

/// How long a worker may be silent before it is taken for hung, unless a command says otherwise. Samples come with a tick, or a
/// few of them with one; a world is compiled, or a network loaded, without.
pub const SILENCE: Duration = Duration::from_mins(10);

/// Why a task was not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TaskError {
    /// The worker's own words: another try would end the same way.
    Failed(String),
    /// All processes that tried it died or hung; how the last one did.
    Lost(String),
}

impl fmt::Display for TaskError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed(text) | Self::Lost(text) => f.write_str(text),
        }
    }
}

/// What all tasks share.
#[derive(Debug)]
pub struct Call<'a, Job> {
    pub program: &'a Program,
    /// The hidden command that serves the tasks.
    pub command: &'static str,
    /// The workers' job; its JSON form has a key `folder`, which is `folder` here.
    pub job: &'a Job,
    /// Where the tasks read and write; a cluster's nodes have an own one of the same content.
    pub folder: &'a Path,
    /// Files that every task reads, beside what its errand names: each one's path below the folder, and where it lies.
    pub shared: Vec<(PathBuf, PathBuf)>,
    /// Threads of each local process; `None`: as many as there are cores.
    pub n_threads: Option<usize>,
    /// How long a worker may say nothing, not even a tick, before it is ended and its task tried again.
    pub silence: Duration,
    /// Whether a failure, told by a worker of this machine, would befall every task: where one has ticked or was done before, it
    /// counts as the loss of that worker, and the task is tried again. `None`: failures are the tasks' own.
    pub befalls_all: Option<fn(&str) -> bool>,
}

/// One task, and the files that it reads, below the call's folder.
#[derive(Debug, Clone)]
pub struct Errand<Task> {
    pub task: Task,
    pub reads: Vec<PathBuf>,
}

impl<Task> From<Task> for Errand<Task> {
    fn from(task: Task) -> Self {
        Self { task, reads: Vec::new() }
    }
}
