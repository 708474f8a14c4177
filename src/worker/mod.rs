//! Tasks of one command, done by processes of this machine or on a cluster.
//!
//! A worker process serves tasks that the parent hands out, one after the other. Lines of JSON: the parent writes one job, then
//! a task at a time; the worker answers each task with any number of ticks of progress and then with what it made, or with the
//! text of its failure. A closed pipe ends the worker.

mod call;
mod engine;
mod process;
mod ray;
mod watchdog;

use std::ffi::OsString;
use std::io::{self, BufRead, Write};
use std::path::PathBuf;
use std::sync::OnceLock;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub use call::{Call, Errand, SILENCE, TaskError};
pub use engine::{Engine, do_all};
pub use process::{STDERR_TAIL_BYTES, last_lines_of};
pub use ray::RayCluster;

use watchdog::Watchdog;

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
/// A broken pipe, or the parent did not write a job; failures of tasks are answers. Only a lack of memory is none: it ends the
/// process, since another one may have enough. On a cluster, so does a task that stands still.
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
    let watchdog = Watchdog::of_environment();
    for line in lines {
        let task: Task = serde_json::from_str(&line?)?;
        watchdog.hear();
        let done = work(task, &mut || {
            watchdog.hear();
            say(&Answer::Tick)
        });
        watchdog.rest();
        let answer = match done {
            Ok(made) => Answer::Done(Box::new(made)),
            Err(error) => {
                let text = with_causes(&error);
                if lacks_memory(&text) {
                    let told = format!("memory was refused, by a limit or for lack of it: {text}");
                    return Err(io::Error::new(io::ErrorKind::OutOfMemory, told));
                }
                Answer::Failed(text)
            }
        };
        say(&answer)?;
    }
    Ok(())
}

/// So much memory is asked for, to learn whether any is left.
const PROBE_BYTES: usize = 64 << 20;

/// So much is asked for where no picture can be drawn: OpenGL's driver, which maps some 200 MiB of LLVM where Mesa draws without
/// a GPU, looks like one that is not there when it is refused. It is more than freed memory that the allocator keeps for itself
/// ([`ALLOCATOR_ENVIRONMENT`]).
const DRIVER_PROBE_BYTES: usize = 512 << 20;

/// What the simulator's error begins with where it has no OpenGL context.
pub const CANNOT_DRAW: &str = "cannot draw off screen";

/// Whether a worker had no OpenGL context: on a machine that cannot draw, that befalls every task. Where one was made, the machine
/// can, and it was that worker's bad luck, such as memory that was short for a moment.
#[must_use]
pub fn cannot_draw(failure: &str) -> bool {
    failure.contains(CANNOT_DRAW)
}

/// Whether memory was refused: the error says so, in the words of the system, of Python, of MuJoCo or of the dynamic linker, or
/// as native code that fails without words, as MuJoCo's compiler does then; or there is none now, where nothing can be drawn
/// none for a driver.
#[must_use]
pub fn lacks_memory(error: &str) -> bool {
    let text = error.to_lowercase();
    let tells = [
        "cannot allocate memory",
        "could not allocate",
        "out of memory",
        "memoryerror",
        "bad_alloc",
        "caught an unknown exception",
        "failed to map segment",
    ]
    .iter()
    .any(|words| text.contains(words));
    // Seen from outside, lest the compiler leave out what nothing uses.
    let mut probe = std::hint::black_box(Vec::<u8>::new());
    let wanted = if error.contains(CANNOT_DRAW) { DRIVER_PROBE_BYTES } else { PROBE_BYTES };
    tells || probe.try_reserve_exact(wanted).is_err() || std::hint::black_box(probe).capacity() == 0
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

    /// Whether this code runs in a Python interpreter, from the wheel.
    #[must_use]
    pub fn is_in_python() -> bool {
        WORKER_PROGRAM.get().is_some()
    }

    /// The interpreter around this code, where there is one.
    #[must_use]
    pub fn python() -> Option<PathBuf> {
        WORKER_PROGRAM.get().map(|program| program.path.clone())
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
