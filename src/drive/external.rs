//! A detector of another program: samples to its standard input, boxes from its standard output.
//!
//! A message is its length in bytes (32 bits, little-endian) and so many bytes. For each sample the program gets three: a JSON
//! header, the picture's bytes, and the points as rows of five little-endian 32-bit floats. It answers with one, JSON:
//! `{"detections": [{"center_m": [x, y, z], "size_m": [length, width, height], "yaw_rad": 0.0, "harm": "harmful", "score": 0.9}]}`
//! in the ego frame. What it says on standard error is told where it fails. It ends when its input ends.

use std::io::{self, Read, Write};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::episode::check_detection;
use crate::files::sha256_hex;
use crate::geometry::{Box3, Frame, Pinhole, Transform};
use crate::object::Detection;
use crate::sample::{EgoState, ImageFormat, Measured};
use crate::worker::{STDERR_TAIL_BYTES, last_lines_of};

/// Longest answer that is read.
const MAX_ANSWER_BYTES: u32 = 16 * 1024 * 1024;
/// Most boxes in an answer.
const MAX_BOXES: usize = 1_000;
/// No box is farther away or longer, metres.
const FARTHEST_M: f64 = 10_000.0;
/// Hexadecimal digits by which an episode is called.
const EPISODE_DIGITS: usize = 16;
/// How often and how long to look whether one whose output has ended has ended itself.
const N_LOOKS: u32 = 500;
const LOOK: Duration = Duration::from_millis(10);
/// .. for the rest of what it said.
const N_LOOKS_AFTER_END: u32 = 50;
/// The first answer may take so many times as long: programs load networks.
pub(super) const FIRST_FACTOR: u32 = 10;

/// Why an external detector gave no boxes.
#[derive(Debug, Error)]
pub enum ExternalError {
    #[error("cannot start the detector `{command}`")]
    Start { command: String, source: io::Error },
    #[error("the detector ended ({how}) in place of an answer: {command}")]
    Ended { how: String, command: String },
    #[error("the detector gave no answer within {waited_s} s (reply_s): {command}")]
    Late { waited_s: f64, command: String },
    #[error("the detector's answer is not usable: {what}: {command}")]
    Garbage { what: String, command: String },
}

/// What is told of a sample beside picture and points.
#[derive(Debug, Serialize)]
struct Header {
    /// Made from its name, which may tell what is there.
    episode: String,
    sample_idx: u64,
    time_ns: u64,
    #[serde(flatten)]
    ego_state: EgoState,
    camera: CameraHeader,
    ego_from_lidar: [[f64; 4]; 4],
    image: ImageHeader,
    points: PointsHeader,
}

#[derive(Debug, Serialize)]
struct CameraHeader {
    width_px: u32,
    height_px: u32,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    ego_from_camera: [[f64; 4]; 4],
}

#[derive(Debug, Serialize)]
struct ImageHeader {
    format: &'static str,
}

#[derive(Debug, Serialize)]
struct PointsHeader {
    n: usize,
    fields: [&'static str; 5],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    detections: Vec<Detection>,
    /// Of which sample it speaks; one that is late, or one too many, is told by it.
    sample_idx: Option<u64>,
}

/// A running program.
#[derive(Debug)]
pub struct External {
    command: String,
    process: Child,
    /// Ends the program, however this process ends: a shell that waits for the end of its input.
    guard: Child,
    stderr: Tail,
    /// What it is told: a thread writes, so that a program that does not read holds up nobody.
    to: Sender<Vec<u8>>,
    /// What it said, message by message; closed where it ended.
    from: Receiver<io::Result<Vec<u8>>>,
    reply: Duration,
    is_first: bool,
}

impl External {
    /// Starts a command in the shell.
    ///
    /// # Errors
    /// [`ExternalError::Start`].
    pub fn start(command: &str, reply_s: f64) -> Result<Self, ExternalError> {
        let fail = |source| ExternalError::Start { command: command.to_owned(), source };
        let mut process = Command::new("sh")
            .args(["-c", command])
            // A group of its own, so that the program ends with the shell that it was started by.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(fail)?;
        let guard = guard_of(&process).map_err(|error| {
            end(&mut process);
            fail(error)
        })?;
        let stderr = Tail::of(process.stderr.take().expect("stderr is piped"));
        let mut stdin = process.stdin.take().expect("stdin is piped");
        let (to, told) = channel::<Vec<u8>>();
        std::thread::spawn(move || {
            // Where it no longer reads, its end is told by what it does not answer.
            while let Ok(bytes) = told.recv() {
                if stdin.write_all(&bytes).and_then(|()| stdin.flush()).is_err() {
                    break;
                }
            }
        });
        let mut stdout = process.stdout.take().expect("stdout is piped");
        let (send, from) = sync_channel(1);
        std::thread::spawn(move || {
            loop {
                let message = read_message(&mut stdout);
                let is_last = !matches!(message, Ok(Some(_)));
                let gone = match message.transpose() {
                    Some(message) => send.send(message).is_err(),
                    None => true,
                };
                if is_last || gone {
                    break;
                }
            }
        });
        let reply = Duration::from_secs_f64(reply_s);
        Ok(Self { command: command.to_owned(), process, guard, stderr, to, from, reply, is_first: true })
    }

    /// The program's boxes for a sample.
    ///
    /// # Errors
    /// [`ExternalError`]; the program is of no more use then.
    pub fn detect(
        &mut self,
        episode: &str,
        sample_idx: u64,
        measured: &Measured,
    ) -> Result<Vec<Detection>, ExternalError> {
        let header = serde_json::to_vec(&header(episode, sample_idx, measured)).expect("plain numbers");
        let points: Vec<u8> = measured
            .points
            .iter()
            .flat_map(|point| [point.x_m, point.y_m, point.z_m, point.intensity, f32::from(point.ring)])
            .flat_map(f32::to_le_bytes)
            .collect();
        let mut message = Vec::with_capacity(header.len() + measured.image.bytes.len() + points.len() + 12);
        for part in [&header, &measured.image.bytes, &points] {
            let length = u32::try_from(part.len()).expect("a picture or a cloud is smaller than 4 GiB");
            message.extend(length.to_le_bytes());
            message.extend(part);
        }
        if let Ok(early) = self.from.try_recv() {
            let what = early.map_or_else(|error| error.to_string(), |_| "an answer to no sample".to_owned());
            return Err(ExternalError::Garbage { what, command: self.describe() });
        }
        // An error here means that the program has closed its input; it is told below.
        let _ = self.to.send(message);
        let wait = if std::mem::take(&mut self.is_first) { self.reply * FIRST_FACTOR } else { self.reply };
        let bytes = match self.from.recv_timeout(wait) {
            Ok(Ok(bytes)) => bytes,
            Ok(Err(error)) => {
                let command = self.describe();
                return Err(ExternalError::Garbage { what: error.to_string(), command });
            }
            Err(RecvTimeoutError::Timeout) => {
                let waited_s = wait.as_secs_f64();
                return Err(ExternalError::Late { waited_s, command: self.describe() });
            }
            Err(RecvTimeoutError::Disconnected) => {
                let how = self.last_words();
                return Err(ExternalError::Ended { how, command: self.describe() });
            }
        };
        parse_answer(&bytes, sample_idx)
            .map_err(|what| ExternalError::Garbage { what, command: self.describe() })
    }

    /// The command, and the end of what it said on standard error.
    fn describe(&self) -> String {
        let tail = self.stderr.last_lines();
        if tail.is_empty() {
            format!("`{}`", self.command)
        } else {
            format!("`{}`; it said:\n    {tail}", self.command)
        }
    }

    /// How it ended, which it does just after its standard output.
    fn last_words(&mut self) -> String {
        for _ in 0..N_LOOKS {
            match self.process.try_wait() {
                Ok(Some(status)) => {
                    self.stderr.wait_for_end();
                    return status.to_string();
                }
                Ok(None) => std::thread::sleep(LOOK),
                Err(error) => return error.to_string(),
            }
        }
        "it closed its standard output and runs on".to_owned()
    }
}

/// The end of what a program says on standard error, however much that is.
#[derive(Debug)]
struct Tail {
    bytes: Arc<Mutex<Vec<u8>>>,
    reader: JoinHandle<()>,
}

impl Tail {
    fn of(mut from: impl Read + Send + 'static) -> Self {
        let bytes = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&bytes);
        let reader = std::thread::spawn(move || {
            let mut part = [0; 8 * 1024];
            while let Ok(n @ 1..) = from.read(&mut part) {
                let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                kept.extend_from_slice(&part[..n]);
                let n_surplus = kept.len().saturating_sub(STDERR_TAIL_BYTES as usize);
                kept.drain(..n_surplus);
            }
        });
        Self { bytes, reader }
    }

    /// What a program that has ended said last is still on its way; one that it started may hold its standard error open.
    fn wait_for_end(&self) {
        for _ in 0..N_LOOKS_AFTER_END {
            if self.reader.is_finished() {
                break;
            }
            std::thread::sleep(LOOK);
        }
    }

    fn last_lines(&self) -> String {
        last_lines_of(&self.bytes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Kills the group of a process when its own input ends, as it does with whoever holds the other end: one that hangs reads nothing,
/// so the end of its own input does not end it.
fn guard_of(process: &Child) -> io::Result<Child> {
    Command::new("sh")
        .args(["-c", "read -r _; kill -KILL \"-$0\"", &process.id().to_string()])
        // A signal to the group of this process must not end it first.
        .process_group(0)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
}

fn parse_answer(bytes: &[u8], sample_idx: u64) -> Result<Vec<Detection>, String> {
    let Answer { detections, sample_idx: answered } =
        serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    if let Some(other) = answered.filter(|&answered| answered != sample_idx) {
        return Err(format!("it is of sample {other}; sample {sample_idx} was asked for"));
    }
    if detections.len() > MAX_BOXES {
        return Err(format!("{} boxes; at most {MAX_BOXES} are taken", detections.len()));
    }
    for (i, found) in detections.iter().enumerate() {
        found.box_in_ego.check().map_err(|error| format!("box {i}: {error}"))?;
        let Box3 { center, length_m, width_m, height_m, .. } = found.box_in_ego;
        let [x_m, y_m, z_m] = center.coords.into();
        let lengths_m = [x_m, y_m, z_m, length_m, width_m, height_m];
        if let Some(far_m) = lengths_m.into_iter().find(|length_m| length_m.abs() > FARTHEST_M) {
            return Err(format!("box {i}: {far_m:e} m; at most {FARTHEST_M} m are taken"));
        }
        check_detection(found)
            .map_err(|fault| format!("box {i}: {} is {}; {}", fault.field, fault.found, fault.wanted))?;
    }
    Ok(detections)
}

/// The next message; `None` where there is no more.
fn read_message(from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    let mut n_read = 0;
    while n_read < length.len() {
        match from.read(&mut length[n_read..])? {
            0 if n_read == 0 => return Ok(None),
            0 => return Err(io::Error::other("it ended within a message's length")),
            n => n_read += n,
        }
    }
    let length = u32::from_le_bytes(length);
    if length > MAX_ANSWER_BYTES {
        return Err(io::Error::other(format!(
            "a message of {length} bytes was announced; at most {MAX_ANSWER_BYTES} are read (is a print in the way?)"
        )));
    }
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes).map_err(|_| io::Error::other("it ended within a message"))?;
    Ok(Some(bytes))
}

fn header(episode: &str, sample_idx: u64, measured: &Measured) -> Header {
    let Pinhole { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = measured.intrinsics;
    let ego_from_camera = rows(&measured.ego_from_camera);
    let episode = sha256_hex(episode.as_bytes())[..EPISODE_DIGITS].to_owned();
    Header {
        episode,
        sample_idx,
        time_ns: measured.time_ns,
        ego_state: measured.ego_state,
        camera: CameraHeader { width_px, height_px, fx_px, fy_px, cx_px, cy_px, ego_from_camera },
        ego_from_lidar: rows(&measured.ego_from_lidar),
        image: ImageHeader {
            format: match measured.image.format {
                ImageFormat::Jpeg => "jpeg",
                ImageFormat::Png => "png",
            },
        },
        points: PointsHeader { n: measured.points.len(), fields: ["x_m", "y_m", "z_m", "intensity", "ring"] },
    }
}

/// A transform as the rows of its matrix.
fn rows<To: Frame, From: Frame>(transform: &Transform<To, From>) -> [[f64; 4]; 4] {
    let matrix = transform.isometry.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

impl Drop for External {
    fn drop(&mut self) {
        // First, lest it kill another group that has the same number by then.
        let _ = self.guard.kill();
        let _ = self.guard.wait();
        end(&mut self.process);
    }
}

/// Ends a process and its group. It has nothing to save: the drive is over, or it has failed.
fn end(process: &mut Child) {
    let _ = kill_process_group(Pid::from_child(process), Signal::KILL);
    let _ = process.kill();
    let _ = process.wait();
}

#[cfg(test)]
mod tests;
