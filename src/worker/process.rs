//! A process that is spoken to in lines of JSON.

use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::marker::PhantomData;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{ALLOCATOR_ENVIRONMENT, Answer, Program};

/// How much of a dead process's stderr is reported.
const STDERR_TAIL_LINES: usize = 15;

/// How often to look whether a process has ended by itself.
const LOOK: Duration = Duration::from_millis(10);

/// What tells rayon how many threads to take.
pub(super) const THREADS: &str = "RAYON_NUM_THREADS";

/// Hears lines of JSON, answers in lines, and ends when its input is closed.
pub(super) struct Process {
    child: Child,
    /// `None` only while it ends.
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
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
        let stderr = tempfile::tempfile()?;
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
        let from = BufReader::new(child.stdout.take().expect("stdout is piped"));
        let stderr = fs_err::File::from_parts(stderr, "a process's stderr");
        Ok(Self { child, to, from, stderr, name, patience })
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

    /// Reads the next line that is such an answer; other lines, such as a driver's message, are passed over.
    ///
    /// # Errors
    /// It has died: how, and its last words.
    pub(super) fn hear<T: DeserializeOwned>(&mut self) -> Result<T, String> {
        let mut line = String::new();
        loop {
            line.clear();
            match self.from.read_line(&mut line) {
                Ok(0) | Err(_) => return Err(self.last_words()),
                Ok(_) => {}
            }
            if let Ok(answer) = serde_json::from_str(&line) {
                return Ok(answer);
            }
            tracing::debug!(line, "a line that is no answer");
        }
    }

    /// How it died, with the end of its stderr.
    fn last_words(&mut self) -> String {
        let how = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        let mut bytes = Vec::new();
        let read = self.stderr.rewind().and_then(|()| self.stderr.read_to_end(&mut bytes));
        let text = String::from_utf8_lossy(&bytes);
        let lines: Vec<&str> = text.lines().collect();
        let tail = lines[lines.len().saturating_sub(STDERR_TAIL_LINES)..].join("\n    ");
        let name = self.name;
        match (read, tail.is_empty()) {
            (Ok(_), false) => format!("the {name} died ({how}); it said:\n    {tail}"),
            _ => format!("the {name} died ({how}) without a word"),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // A closed pipe ends it, with what it has started; an abandoned task leaves only a partial file.
        self.to = None;
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
    made: PhantomData<fn() -> Made>,
}

impl<Made: DeserializeOwned> Worker<Made> {
    /// Starts `program command` and hands it its job. So many threads are the worker's share of the cores; `None`: all.
    ///
    /// # Errors
    /// The program cannot be started.
    pub(super) fn start(
        program: &Program,
        command: &str,
        job: &impl Serialize,
        n_threads: Option<usize>,
    ) -> io::Result<Self> {
        let allocator = ALLOCATOR_ENVIRONMENT.map(|(name, value)| (name, value.to_owned()));
        let threads = n_threads.map(|n| (THREADS, n.to_string()));
        let patience = Duration::from_millis(500);
        let mut process = Process::start(
            program,
            command,
            allocator.into_iter().chain(threads),
            "worker process",
            patience,
        )?;
        process.say(job).map_err(io::Error::other)?;
        Ok(Self { process, made: PhantomData })
    }

    /// Lets the worker do one task.
    ///
    /// # Errors
    /// The text to report: the worker's own, or how it died.
    pub(super) fn make(&mut self, task: &impl Serialize, on_tick: &dyn Fn()) -> Result<Made, String> {
        self.process.say(task)?;
        loop {
            match self.process.hear()? {
                Answer::Tick => on_tick(),
                Answer::Done(made) => return Ok(*made),
                Answer::Failed(message) => return Err(message),
            }
        }
    }
}
