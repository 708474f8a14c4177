//! Worker processes: each serves tasks that the parent hands out, one after the other.
//!
//! Lines of JSON: the parent writes one job, then a task at a time; the worker answers each task with any number of ticks of
//! progress and then with what it made, or with the text of its failure. A closed pipe ends the worker.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::marker::PhantomData;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// How much of a dead worker's stderr is reported.
const STDERR_TAIL_LINES: usize = 15;

/// A worker's answer.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer<T> {
    Tick,
    Done(Box<T>),
    Failed(String),
}

/// The worker's side: serves tasks from `input` until it ends. `prepare` takes the job, once; the function that it
/// returns does each task, and calls what it is given for each tick of progress.
///
/// # Errors
/// A broken pipe, or the parent did not write a job; failures of tasks are answers.
pub fn serve<Job, Task, Made, Fault, Work>(
    input: impl BufRead,
    mut output: impl Write,
    prepare: impl FnOnce(Job) -> Work,
) -> io::Result<()>
where
    Job: DeserializeOwned,
    Task: DeserializeOwned,
    Made: Serialize,
    Fault: std::error::Error,
    Work: FnMut(Task, &mut dyn FnMut() -> io::Result<()>) -> Result<Made, Fault>,
{
    let mut lines = input.lines();
    let Some(first) = lines.next() else { return Ok(()) };
    let mut work = prepare(serde_json::from_str(&first?)?);
    let mut say = |answer: &Answer<Made>| -> io::Result<()> {
        writeln!(output, "{}", serde_json::to_string(answer)?)?;
        output.flush()
    };
    for line in lines {
        let task: Task = serde_json::from_str(&line?)?;
        let answer = match work(task, &mut || say(&Answer::Tick)) {
            Ok(made) => Answer::Done(Box::new(made)),
            Err(error) => Answer::Failed(with_causes(&error)),
        };
        say(&answer)?;
    }
    Ok(())
}

/// The error with its sources, unless its text contains them already.
#[must_use]
pub fn with_causes(error: &dyn std::error::Error) -> String {
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

/// Environment of a process that renders: glibc keeps freed memory of up to half a GiB. By default
/// it gives every big block back, and the system clears the pages anew for the next picture: up to 10 %
/// of the time, measured with `perf`. Other allocators ignore this.
pub const ALLOCATOR_ENVIRONMENT: [(&str, &str); 2] =
    [("MALLOC_MMAP_THRESHOLD_", "268435456"), ("MALLOC_TRIM_THRESHOLD_", "536870912")];

/// How often and how long to look whether a worker has ended by itself.
const N_LOOKS: u32 = 50;
const LOOK: Duration = Duration::from_millis(10);

/// What tells rayon how many threads to take.
const THREADS: &str = "RAYON_NUM_THREADS";

/// What starts this program once more, as a worker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    path: PathBuf,
    /// They come before the worker's command.
    args: Vec<OsString>,
}

/// What is started as worker where this code is no program of its own but a part of another.
static WORKER_PROGRAM: OnceLock<Program> = OnceLock::new();

impl Program {
    #[must_use]
    pub fn new(path: PathBuf, args: Vec<OsString>) -> Self {
        Self { path, args }
    }

    /// What this process starts as its workers: itself, or what [`Self::start_as_worker`] has named.
    ///
    /// # Errors
    /// The system does not tell which program this is.
    pub fn this() -> io::Result<Self> {
        match WORKER_PROGRAM.get() {
            Some(named) => Ok(named.clone()),
            None => std::env::current_exe().map(Self::from),
        }
    }

    /// Makes this what workers are, for code that runs inside another program; the first call counts.
    pub fn start_as_worker(self) {
        WORKER_PROGRAM.get_or_init(|| self);
    }
}

impl From<PathBuf> for Program {
    fn from(path: PathBuf) -> Self {
        Self::new(path, Vec::new())
    }
}

/// The parent's side of one worker, which makes `Made` of each task.
pub struct Worker<Made> {
    process: Child,
    /// `None` only while it ends.
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
    stderr: fs_err::File,
    made: PhantomData<fn() -> Made>,
}

impl<Made: DeserializeOwned> Worker<Made> {
    /// Starts `program command` and hands it its job. So many threads are the worker's share of the cores; `None`: all.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(
        program: &Program,
        command: &str,
        job: &impl Serialize,
        n_threads: Option<usize>,
    ) -> io::Result<Self> {
        let stderr = tempfile::tempfile()?;
        let told = |error| io::Error::other(format!("cannot start {}: {error}", program.path.display()));
        let mut process = Command::new(&program.path)
            .args(&program.args)
            .arg(command)
            .envs(ALLOCATOR_ENVIRONMENT)
            .envs(n_threads.map(|n| (THREADS, n.to_string())))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(stderr.try_clone()?)
            .spawn()
            .map_err(told)?;
        let mut to = process.stdin.take().expect("stdin is piped");
        let from = BufReader::new(process.stdout.take().expect("stdout is piped"));
        writeln!(to, "{}", serde_json::to_string(job)?)?;
        let stderr = fs_err::File::from_parts(stderr, "the worker's stderr");
        Ok(Self { process, to: Some(to), from, stderr, made: PhantomData })
    }

    /// Lets the worker do one task.
    ///
    /// # Errors
    /// The text to report: the worker's own, or how it died.
    pub fn make(&mut self, task: &impl Serialize, on_tick: &dyn Fn()) -> Result<Made, String> {
        let task = serde_json::to_string(task).expect("a task has a JSON form");
        let to = self.to.as_mut().expect("a worker that is not ending has its pipe");
        if writeln!(to, "{task}").is_err() {
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
                Ok(Answer::Tick) => on_tick(),
                Ok(Answer::Done(made)) => return Ok(*made),
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

impl<Made> Drop for Worker<Made> {
    fn drop(&mut self) {
        // A closed pipe ends it, with what it has started; an abandoned task leaves only a partial file.
        self.to = None;
        for _ in 0..N_LOOKS {
            if !matches!(self.process.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(LOOK);
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
