//! Worker processes: each makes episodes that the parent hands out, one after the other.
//!
//! Lines of JSON: the parent writes one `Job`, then a `Task` at a time; the worker answers with
//! `Answer`s, the last to each task being `Done` or `Failed`. A closed pipe ends the worker.

use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde::{Deserialize, Serialize};

use super::{CheckedConfig, GenerateConfig, GenerateError, episode, plan};
use crate::episode::EpisodeEntry;

/// How much of a dead worker's stderr is reported.
const STDERR_TAIL_LINES: usize = 15;

/// Settings that all tasks of a worker share.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Job {
    pub config: GenerateConfig,
    pub folder: PathBuf,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Task {
    episode_idx: u32,
}

/// A worker's answer.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    Sample,
    Done(Box<EpisodeEntry>),
    Failed(String),
}

/// The worker's side: serves tasks from `input` until it ends.
///
/// # Errors
/// A broken pipe, or the parent did not write a job; failures of episodes are answers.
pub fn serve(input: impl BufRead, mut output: impl Write) -> io::Result<()> {
    let mut lines = input.lines();
    let Some(first) = lines.next() else { return Ok(()) };
    let job: Job = serde_json::from_str(&first?)?;
    let mut say = |answer: &Answer| -> io::Result<()> {
        writeln!(output, "{}", serde_json::to_string(answer)?)?;
        output.flush()
    };
    for line in lines {
        let task: Task = serde_json::from_str(&line?)?;
        let answer = match make(&job, task, &mut || say(&Answer::Sample)) {
            Ok(entry) => Answer::Done(Box::new(entry)),
            Err(error) => Answer::Failed(with_causes(&error)),
        };
        say(&answer)?;
    }
    Ok(())
}

/// The error with its sources, unless its text contains them already.
fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

fn make(
    job: &Job,
    task: Task,
    on_sample: &mut dyn FnMut() -> io::Result<()>,
) -> Result<EpisodeEntry, GenerateError> {
    let config = CheckedConfig::try_from(&job.config)?;
    let plan = plan(&config, task.episode_idx + 1).pop().expect("the plan holds the episode");
    let (entry, timings) = episode::record(&config, &plan, &job.folder, on_sample)?;
    tracing::info!(episode = plan.name, ?timings, "made");
    Ok(entry)
}

/// Environment of a process that makes episodes: glibc keeps freed memory of up to half a GiB. By default
/// it gives every big block back, and the system clears the pages anew for the next picture: up to 10 %
/// of the time, measured with `perf`. Other allocators ignore this.
pub const ALLOCATOR_ENVIRONMENT: [(&str, &str); 2] =
    [("MALLOC_MMAP_THRESHOLD_", "268435456"), ("MALLOC_TRIM_THRESHOLD_", "536870912")];

/// The parent's side of one worker.
pub(super) struct Worker {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    stderr: fs_err::File,
}

impl Worker {
    /// Starts `program gen-worker`.
    pub(super) fn start(program: &Path, job: &Job) -> io::Result<Self> {
        let stderr = tempfile::tempfile()?;
        let told = |error| io::Error::other(format!("cannot start {}: {error}", program.display()));
        let mut process = Command::new(program)
            .arg("gen-worker")
            .envs(ALLOCATOR_ENVIRONMENT)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(stderr.try_clone()?)
            .spawn()
            .map_err(told)?;
        let mut to = process.stdin.take().expect("stdin is piped");
        let from = BufReader::new(process.stdout.take().expect("stdout is piped"));
        writeln!(to, "{}", serde_json::to_string(job)?)?;
        let stderr = fs_err::File::from_parts(stderr, "the worker's stderr");
        Ok(Self { process, to, from, stderr })
    }

    /// Lets the worker make one episode; an error is the text to report.
    pub(super) fn make(&mut self, episode_idx: u32, on_sample: &dyn Fn()) -> Result<EpisodeEntry, String> {
        let task = serde_json::to_string(&Task { episode_idx }).expect("a task has a JSON form");
        if writeln!(self.to, "{task}").is_err() {
            return Err(self.last_words());
        }
        let mut line = String::new();
        loop {
            line.clear();
            match self.from.read_line(&mut line) {
                Ok(0) | Err(_) => return Err(self.last_words()),
                Ok(_) => {}
            }
            match serde_json::from_str(&line) {
                Ok(Answer::Sample) => on_sample(),
                Ok(Answer::Done(entry)) => return Ok(*entry),
                Ok(Answer::Failed(message)) => return Err(message),
                // A driver's message on stdout.
                Err(_) => tracing::debug!(line, "a worker's line that is no answer"),
            }
        }
    }

    /// How the worker died, with the end of its stderr.
    fn last_words(&mut self) -> String {
        let how = self.process.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        let mut bytes = Vec::new();
        let read = self.stderr.rewind().and_then(|()| self.stderr.read_to_end(&mut bytes));
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().collect();
        let tail = lines[lines.len().saturating_sub(STDERR_TAIL_LINES)..].join("\n    ");
        match (read, tail.is_empty()) {
            (Ok(_), false) => format!("the worker process died ({how}); it said:\n    {tail}"),
            _ => format!("the worker process died ({how}) without a word"),
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // Between tasks there is nothing to lose, and an abandoned task leaves only a partial file.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
