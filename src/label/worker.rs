//! `label`'s worker processes: each labels episodes of one data set.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Write};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::LabelError;
use super::episode::{LabelledEpisode, label_episode};
use crate::episode::manifest::{EpisodeEntry, LabelManifest};
use crate::files::sha256_of;
use crate::progress::Progress;
use crate::store;
use crate::worker::{self, Call, Engine, Errand, Program, TaskError};
use crate::zone::{Zone, ZoneConfig};

/// The hidden command that serves tasks.
const COMMAND: &str = "label-worker";

/// What all tasks of a worker share.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct LabelJob {
    /// The data set.
    pub folder: PathBuf,
    pub set: String,
    pub zone_toml: String,
}

/// The worker's side: serves tasks from `input` until it ends.
///
/// # Errors
/// As [`worker::serve`].
pub fn serve(input: impl BufRead, output: impl Write) -> io::Result<()> {
    worker::serve(input, output, |job: LabelJob| {
        move |entry: EpisodeEntry, on_sample: &mut dyn FnMut() -> io::Result<()>| {
            make(&job, &entry, on_sample)
        }
    })
}

fn make(
    job: &LabelJob,
    entry: &EpisodeEntry,
    on_sample: &mut dyn FnMut() -> io::Result<()>,
) -> Result<LabelledEpisode, LabelError> {
    let config: ZoneConfig = toml::from_str(&job.zone_toml).map_err(io::Error::other)?;
    let zone = Zone::try_from(config)?;
    fs::create_dir_all(LabelManifest::folder(&job.folder, &job.set))?;
    // A parent that hears nothing any more is noticed at the answer.
    let on_sample = Mutex::new(on_sample);
    let tick = || {
        let _ = on_sample.lock().expect("one thread labels")();
    };
    label_episode(&job.folder, entry, &zone, &job.set, &job.zone_toml, &tick)
}

/// The parent's side: workers that label.
#[derive(Debug, Clone, Copy)]
pub struct LabelWorkers<'a> {
    pub engine: &'a Engine,
    /// The `harmzone` program, started as worker.
    pub program: &'a Program,
    /// How long one may say nothing before it is ended and its episode tried again.
    pub silence: Duration,
}

/// Has all episodes labelled, hands each to `keep`, and returns what became of those whose workers were lost, again and again. All
/// are tried, as [`super::run()`] does.
///
/// # Errors
/// The first episode, in their order, that cannot be labelled; an error of `keep`; the engine cannot be started, or dies.
pub(super) fn label_by(
    workers: &LabelWorkers<'_>,
    job: &LabelJob,
    episodes: &[&EpisodeEntry],
    progress: &dyn Progress,
    keep: &(dyn Fn(LabelledEpisode) -> Result<(), LabelError> + Sync),
) -> Result<Vec<String>, LabelError> {
    let folder = &job.folder;
    let call = Call {
        program: workers.program,
        command: COMMAND,
        job,
        folder,
        shared: Vec::new(),
        n_threads: None,
        silence: workers.silence,
        befalls_all: None,
    };
    let errands: Vec<Errand<&EpisodeEntry>> =
        episodes.iter().map(|&task| Errand { task, reads: vec![PathBuf::from(&task.file)] }).collect();
    for entry in episodes {
        // The cluster's nodes get files from here.
        store::open_file(&folder.join(&entry.file))?;
    }
    let lost: Mutex<BTreeMap<usize, String>> = Mutex::default();
    let failed: Mutex<BTreeMap<usize, LabelError>> = Mutex::default();
    let on_made = |place: usize, answer: Result<LabelledEpisode, TaskError>| -> Result<(), LabelError> {
        let episode = &episodes[place].name;
        progress.note(episode);
        let message = match answer {
            Ok(labelled) => match check_file(job, &labelled) {
                Ok(()) => return keep(labelled),
                Err(message) => message,
            },
            Err(TaskError::Lost(message)) => {
                let sentence = format!("episode `{episode}` was not labelled: {message}");
                tracing::warn!("{sentence}");
                lost.lock().expect("no worker thread panics").insert(place, sentence);
                return Ok(());
            }
            Err(TaskError::Failed(message)) => message,
        };
        let error = LabelError::Worker { episode: episode.clone(), message };
        failed.lock().expect("no worker thread panics").insert(place, error);
        Ok(())
    };
    worker::do_all(workers.engine, &call, &errands, &|| progress.advance(1), &on_made)?;
    match failed.into_inner().expect("no worker thread panics").pop_first() {
        Some((_, error)) => Err(error),
        None => Ok(lost.into_inner().expect("no worker thread panics").into_values().collect()),
    }
}

/// Whether the file that a worker has made is there as it was made.
fn check_file(job: &LabelJob, (entry, _): &LabelledEpisode) -> Result<(), String> {
    let file = LabelManifest::folder(&job.folder, &job.set).join(&entry.file);
    match sha256_of(&file) {
        Ok(found) if found == entry.sha256 => Ok(()),
        Ok(_) => Err(format!("another file came back than was made: {}", file.display())),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::to_toml;
    use crate::dataset::test_data;

    /// A worker in this process.
    fn serve_in_memory(job: &LabelJob, tasks: &[&EpisodeEntry]) -> String {
        let lines: Vec<String> = tasks.iter().map(|task| serde_json::to_string(task).unwrap()).collect();
        let input = format!("{}\n{}\n", serde_json::to_string(job).unwrap(), lines.join("\n"));
        let mut output = Vec::new();
        serve(input.as_bytes(), &mut output).unwrap();
        String::from_utf8(output).unwrap()
    }

    #[test]
    fn a_worker_writes_the_files_that_one_process_writes() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[2, 3]);
        let manifest = crate::episode::Manifest::read(folder.path()).unwrap();
        let labels = LabelManifest::read(folder.path(), "rect").unwrap();
        let job = LabelJob {
            folder: folder.path().to_owned(),
            set: "again".to_owned(),
            zone_toml: to_toml(&ZoneConfig::default()),
        };
        let answers = serve_in_memory(&job, &manifest.episodes.iter().collect::<Vec<_>>());
        let n_samples: usize = manifest.episodes.iter().map(|entry| entry.n_samples).sum();
        assert_eq!(answers.lines().filter(|line| *line == "\"tick\"").count(), n_samples);
        for entry in &labels.episodes {
            // The name of the set is in the file, so the counts are compared, and that it can be read.
            assert!(LabelManifest::folder(folder.path(), "again").join(&entry.file).is_file());
            assert!(answers.contains(&format!("\"name\":\"{}\"", entry.name)), "{answers}");
        }
        let gone = EpisodeEntry { file: "episodes/gone.mcap".into(), ..manifest.episodes[0].clone() };
        let told = serve_in_memory(&job, &[&gone]);
        assert!(told.contains("failed") && told.contains("gone.mcap"), "{told}");
    }
}
