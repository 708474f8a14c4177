//! `predict`'s and `eval`'s worker processes: each runs a network over episodes of one data set.

use std::io::{self, BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::predict::{BATCH, predict};
use super::recorded::RecordedError;
use super::{Trained, TrainedError};
use crate::dataset::MeasuredSplit;
use crate::dataset::blind::Sensor;
use crate::device::DeviceName;
use crate::episode::EpisodeEntry;
use crate::model::Detector;
use crate::object::Detection;
use crate::progress::{Progress, Silent};
use crate::sample::Measured;
use crate::store;
use crate::worker::{self, Call, Engine, Errand, Program, TaskError};

/// The hidden command that serves tasks.
const COMMAND: &str = "predict-worker";

/// What a checkpoint is called in the folder of a node.
const CHECKPOINT: &str = "network.safetensors";

/// What all tasks of a worker share.
#[derive(Debug, Serialize, Deserialize)]
struct PredictJob {
    /// The data set.
    folder: PathBuf,
    /// A network inside the program, or a checkpoint's path, from the folder if it is no full one.
    network: PathBuf,
    /// Of its checkpoint.
    sha256: String,
    device: String,
    blind: Option<Sensor>,
}

/// The boxes of one episode's samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundInEpisode {
    pub times_ns: Vec<u64>,
    /// Best first.
    pub found: Vec<Vec<Detection>>,
}

/// Why workers could not predict.
#[derive(Debug, Error)]
pub enum FarError {
    #[error("episode `{episode}`: {message}")]
    Worker { episode: String, message: String },
    #[error(
        "the workers of episode `{episode}` were lost, {message}; boxes are of all episodes or of none, so none of this call are kept, and \
         the same command begins anew (more --task-cpus or --task-gpus a task let fewer share a node's memory, a longer --worker-timeout \
         waits for slow ones): {}",
        path.display()
    )]
    Lost { episode: String, message: String, path: PathBuf },
    #[error(transparent)]
    Trained(#[from] TrainedError),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The worker's side: serves tasks from `input` until it ends.
///
/// # Errors
/// As [`worker::serve`].
pub fn serve(input: impl BufRead, output: impl Write) -> io::Result<()> {
    worker::serve(input, output, |job: PredictJob| {
        let mut network = None;
        move |entry: EpisodeEntry, on_sample: &mut dyn FnMut() -> io::Result<()>| {
            let (detector, device) = match &mut network {
                Some(network) => network,
                none => none.insert(load(&job)?),
            };
            boxes_of(&job, entry, detector, device, on_sample)
        }
    })
}

fn load(job: &PredictJob) -> Result<(Detector, Device), RecordedError> {
    let name: DeviceName = job.device.parse().map_err(io::Error::other)?;
    let device = name.open().map_err(io::Error::other)?;
    let path = match Trained::find(&job.network) {
        Ok(Trained::Shipped(_)) => job.network.clone(),
        _ => job.folder.join(&job.network),
    };
    let load = || -> Result<Detector, TrainedError> {
        let trained = Trained::find(&path)?;
        trained.check_sha256(&job.sha256)?;
        trained.load(&device)
    };
    let detector = load().map_err(io::Error::other)?;
    Ok((detector, device))
}

fn boxes_of(
    job: &PredictJob,
    entry: EpisodeEntry,
    detector: &Detector,
    device: &Device,
    on_sample: &mut dyn FnMut() -> io::Result<()>,
) -> Result<FoundInEpisode, RecordedError> {
    let with_camera = detector.config().use_camera;
    let mut made = FoundInEpisode { times_ns: Vec::new(), found: Vec::new() };
    MeasuredSplit::of(&job.folder, vec![entry]).for_each_part(|part| -> Result<(), RecordedError> {
        let mut part = part.to_vec();
        for (_, measured) in &mut part {
            if let Some(sensor) = job.blind {
                sensor.blind(measured);
            }
        }
        let named: Vec<(&str, &Measured)> =
            part.iter().map(|(id, measured)| (id.as_str(), measured)).collect();
        // A tick comes as soon as every thread has had a batch: a large network takes its time for a part.
        for together in named.chunks(BATCH * rayon::current_num_threads()) {
            made.found.extend(predict(detector, together, with_camera, device, &Silent)?);
            for _ in together {
                on_sample()?;
            }
        }
        made.times_ns.extend(part.iter().map(|(_, measured)| measured.time_ns));
        Ok(())
    })?;
    Ok(made)
}

/// The parent's side: workers that run one network.
#[derive(Debug)]
pub struct NetworkWorkers<'a> {
    pub engine: &'a Engine,
    /// The `harmzone` program, started as worker.
    pub program: &'a Program,
    pub trained: &'a Trained,
    /// Of each worker.
    pub device: DeviceName,
    /// A sensor that sees nothing.
    pub blind: Option<Sensor>,
    /// How long a worker may say nothing before it is ended and its episode tried again.
    pub silence: Duration,
}

impl NetworkWorkers<'_> {
    /// The boxes of each of these episodes of a data set, in their order.
    ///
    /// # Errors
    /// The first episode that failed, or whose workers were lost, again and again; the engine cannot be started, or dies; the network cannot be found.
    pub fn predict(
        &self,
        data: &Path,
        episodes: &[EpisodeEntry],
        progress: &dyn Progress,
    ) -> Result<Vec<FoundInEpisode>, FarError> {
        let folder = fs_err::canonicalize(data)?;
        let (network, shared) = match (self.trained, self.engine) {
            (Trained::Shipped(shipped), _) => (PathBuf::from(shipped.name), Vec::new()),
            (Trained::File(file), Engine::Local { .. }) => (fs_err::canonicalize(file.path())?, Vec::new()),
            (Trained::File(file), Engine::Ray(_)) => {
                let path = fs_err::canonicalize(file.path())?;
                (PathBuf::from(CHECKPOINT), vec![(PathBuf::from(CHECKPOINT), path)])
            }
        };
        let job = PredictJob {
            folder: folder.clone(),
            network,
            sha256: self.trained.sha256()?,
            device: self.device.to_string(),
            blind: self.blind,
        };
        let call = Call {
            program: self.program,
            command: COMMAND,
            job: &job,
            folder: &folder,
            shared,
            n_threads: None,
            silence: self.silence,
            befalls_all: None,
        };
        let errands: Vec<Errand<&EpisodeEntry>> =
            episodes.iter().map(|task| Errand { task, reads: vec![PathBuf::from(&task.file)] }).collect();
        for entry in episodes {
            // The cluster's nodes get files from here.
            store::open_file(&folder.join(&entry.file))?;
        }
        let all_found = Mutex::new(vec![None; episodes.len()]);
        let on_made = |place: usize, answer: Result<FoundInEpisode, TaskError>| {
            let entry = &episodes[place];
            progress.note(&entry.name);
            let told = |message| FarError::Worker { episode: entry.name.clone(), message };
            let made = answer.map_err(|error| match error {
                TaskError::Failed(message) => told(message),
                TaskError::Lost(message) => {
                    FarError::Lost { episode: entry.name.clone(), message, path: folder.join(&entry.file) }
                }
            })?;
            if made.found.len() != entry.n_samples || made.times_ns.len() != entry.n_samples {
                return Err(told(format!(
                    "boxes of {} samples came back, wanted {}",
                    made.found.len(),
                    entry.n_samples
                )));
            }
            all_found.lock().unwrap_or_else(PoisonError::into_inner)[place] = Some(made);
            Ok(())
        };
        progress.start("predict", episodes.iter().map(|entry| entry.n_samples as u64).sum());
        worker::do_all(self.engine, &call, &errands, &|| progress.advance(1), &on_made)?;
        progress.finish();
        let all_found = all_found.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(all_found.into_iter().map(|of_episode| of_episode.expect("all are done")).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::episode::Manifest;

    #[test]
    fn an_episode_whose_workers_are_lost_is_told_with_what_to_do() {
        let home = tempfile::tempdir().unwrap();
        test_data::write(home.path(), &[1]);
        let dies = "import sys; sys.exit('no memory for the network')";
        let program = Program::new("python3".into(), vec!["-c".into(), dies.into()]);
        let trained = Trained::find(Path::new("small")).unwrap();
        let workers = NetworkWorkers {
            engine: &Engine::Local { jobs: 1 },
            program: &program,
            trained: &trained,
            device: "cpu".parse().unwrap(),
            blind: None,
            silence: Duration::from_mins(1),
        };
        let episodes = Manifest::read(home.path()).unwrap().episodes;
        let error = workers.predict(home.path(), &episodes, &Silent).unwrap_err();
        let told = error.to_string();
        assert!(matches!(error, FarError::Lost { .. }), "{told}");
        for words in ["`made-0`", "3 tries", "no memory for the network", "same command", "made-0.mcap"] {
            assert!(told.contains(words), "{told}");
        }
    }
}
