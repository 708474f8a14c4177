//! Tasks, and what those of one command share.

use std::path::{Path, PathBuf};

use super::Program;

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
