//! A process that is spoken to in lines of JSON.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::call::Call;
use super::{ALLOCATOR_ENVIRONMENT, Answer, Program};
use crate::interrupt;

/// How much of what a process said on stderr is reported: lines, and bytes in which they are looked for.
const STDERR_TAIL_LINES: usize = 15;
/// So much of what a process says on standard error is read.
pub const STDERR_TAIL_BYTES: u64 = 64 * 1024;

/// How often to look whether a process has ended by itself.
const LOOK: Duration = Duration::from_millis(10);

/// How often to look, while nothing is heard, whether the wait is to end.
const WAIT: Duration = Duration::from_millis(100);

/// Number of the signal that the kernel sends where memory is short.
const SIGKILL: i32 = 9;

/// What tells rayon how many threads to take.
pub(super) const THREADS: &str = "RAYON_NUM_THREADS";

/// Hears lines of JSON, answers in lines, and ends when its input is closed.
pub(super) struct Process {
    child: Child,
    /// `None` only while it ends.
    to: Option<ChildStdin>,
    /// Its lines, until it closes its output.
    lines: Receiver<String>,
    stderr: fs_err::File,
    /// What it is called in errors.
    name: &'static str,
    /// How long it may take to end by itself, before it is killed.
    patience: Duration,
}

impl Process {
    /// Starts `program command`.
    ///
    /// # Errors
    /// The program cannot be started.
    pub(super) fn start(
        program: &Program,
        command: &str,
        environment: impl IntoIterator<Item = (&'static str, String)>,
        name: &'static str,
        patience: Duration,
    ) -> io::Result<Self> {
        let stderr = tempfile::tempfile().map_err(|error| {
            let folder = std::env::temp_dir();
            let text = format!(
                "cannot make a temporary file ({error}); TMPDIR names another folder: {}",
                folder.display()
            );
            io::Error::new(error.kind(), text)
        })?;
        let told = |error| io::Error::other(format!("cannot start {}: {error}", program.path.display()));
        let mut child = Command::new(&program.path)
            .args(&program.args)
            .arg(command)
            .envs(environment)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(stderr.try_clone()?)
            .spawn()
            .map_err(told)?;
        let to = child.stdin.take();
        let lines = lines_of(child.stdout.take().expect("stdout is piped"));
        let stderr = fs_err::File::from_parts(stderr, "a process's stderr");
        Ok(Self { child, to, lines, stderr, name, patience })
    }

    /// Writes a line.
    ///
    /// # Errors
    /// It has died: how, and its last words.
    pub(super) fn say(&mut self, what: &impl Serialize) -> Result<(), String> {
        let line = serde_json::to_string(what).expect("what is said has a JSON form");
        let to = self.to.as_mut().expect("a process that is not ending has its pipe");
        if writeln!(to, "{line}").is_err() {
            return Err(self.last_words());
        }
        Ok(())
    }

    /// Waits for the next line that is such an answer; other lines, such as a driver's message, are passed over.
    ///
    /// # Errors
    /// It has died: how, and its last words; it has said nothing for so long, and is killed; the user wants to stop.
    pub(super) fn hear<T: DeserializeOwned>(&mut self, silence: Duration) -> Result<T, Unheard> {
        let begin = Instant::now();
        loop {
            match self.lines.recv_timeout(WAIT) {
                Ok(line) => {
                    if let Ok(answer) = serde_json::from_str(&line) {
                        return Ok(answer);
                    }
                    tracing::debug!(line, "a line that is no answer");
                }
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(if interrupt::is_asked() {
                        Unheard::Interrupted
                    } else {
                        Unheard::Lost(self.last_words())
                    });
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
            if interrupt::is_asked() {
                return Err(Unheard::Interrupted);
            }
            if begin.elapsed() >= silence {
                let _ = self.child.kill();
                let (name, text) = (self.name, self.last_words());
                return Err(Unheard::Lost(format!(
                    "the {name} said nothing for {} s and was ended: {text}",
                    silence.as_secs()
                )));
            }
        }
    }

    /// How it died, with the end of its stderr.
    fn last_words(&mut self) -> String {
        let how = self.child.wait().map_or_else(|error| error.to_string(), told);
        let name = self.name;
        match last_lines(&mut self.stderr) {
            Ok(tail) if !tail.is_empty() => format!("the {name} died ({how}); it said:\n    {tail}"),
            _ => format!("the {name} died ({how}) without a word"),
        }
    }
}

/// The end of what a process wrote into a file, its lines after the first indented.
///
/// # Errors
/// The file cannot be read.
fn last_lines(file: &mut fs_err::File) -> io::Result<String> {
    let n_bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(n_bytes.saturating_sub(STDERR_TAIL_BYTES)))?;
    let mut bytes = Vec::new();
    file.take(STDERR_TAIL_BYTES).read_to_end(&mut bytes)?;
    Ok(last_lines_of(&bytes))
}

/// The last lines of a text, for a message.
#[must_use]
pub fn last_lines_of(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    let lines: Vec<&str> = text.lines().collect();
    lines[lines.len().saturating_sub(STDERR_TAIL_LINES)..].join("\n    ")
}

/// Why nothing was heard.
pub(super) enum Unheard {
    /// The process is gone, and how.
    Lost(String),
    /// The user wants to stop.
    Interrupted,
}

/// How a process ended.
fn told(status: ExitStatus) -> String {
    match status.signal() {
        Some(SIGKILL) => format!("{status}; the system does this where memory runs out"),
        _ => status.to_string(),
    }
}

/// The lines that are read from a pipe, by a thread that ends with it.
fn lines_of(pipe: ChildStdout) -> Receiver<String> {
    let (say, lines) = channel();
    std::thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        loop {
            let mut line = String::new();
            match pipe.read_line(&mut line) {
                Ok(0) | Err(_) => return,
                Ok(_) if say.send(line).is_err() => return,
                Ok(_) => {}
            }
        }
    });
    lines
}

impl Drop for Process {
    fn drop(&mut self) {
        // A closed pipe ends it, with what it has started; an abandoned task leaves only a partial file.
        self.to = None;
        if interrupt::is_asked() {
            let _ = self.child.kill();
        }
        for _ in 0..self.patience.as_millis() / LOOK.as_millis() {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(LOOK);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The parent's side of one worker process of this machine, which makes `Made` of each task.
pub(super) struct Worker<Made> {
    process: Process,
    silence: Duration,
    made: PhantomData<fn() -> Made>,
}

/// Why a task was not done.
pub(super) enum NotMade {
    /// The worker says why it cannot be.
    Failed(String),
    Unheard(Unheard),
}

impl<Made: DeserializeOwned> Worker<Made> {
    /// Starts the call's worker and hands it its job, or tells how it was lost at once.
    ///
    /// # Errors
    /// The program cannot be started.
    pub(super) fn start<Job: Serialize>(call: &Call<'_, Job>) -> io::Result<Result<Self, String>> {
        let allocator = ALLOCATOR_ENVIRONMENT.map(|(name, value)| (name, value.to_owned()));
        let threads = call.n_threads.map(|n| (THREADS, n.to_string()));
        let patience = Duration::from_millis(500);
        let environment = allocator.into_iter().chain(threads);
        let mut process =
            Process::start(call.program, call.command, environment, "worker process", patience)?;
        let said = process.say(call.job);
        Ok(said.map(|()| Self { process, silence: call.silence, made: PhantomData }))
    }

    /// Lets the worker do one task.
    ///
    /// # Errors
    /// The text to report: the worker's own, or how it was lost.
    pub(super) fn make(&mut self, task: &impl Serialize, on_tick: &dyn Fn()) -> Result<Made, NotMade> {
        self.process.say(task).map_err(|text| NotMade::Unheard(Unheard::Lost(text)))?;
        loop {
            match self.process.hear(self.silence).map_err(NotMade::Unheard)? {
                Answer::Tick => on_tick(),
                Answer::Done(made) => return Ok(*made),
                Answer::Failed(message) => return Err(NotMade::Failed(message)),
            }
        }
    }
}
