//! `label`'s worker processes: each labels episodes of one data set.

use std::io::{self, BufRead, Write};
use std::path::PathBuf;
use std::sync::Mutex;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::LabelError;
use super::episode::{LabelledEpisode, label_episode};
use crate::episode::manifest::{EpisodeEntry, LabelManifest};
use crate::files::sha256_of;
use crate::progress::Progress;
use crate::store;
use crate::worker::{self, Call, Engine, Errand, Program, SILENCE, TaskError};
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

/// The parent's side: has all episodes labelled, in their order. All are tried, as [`super::run()`] does.
///
/// # Errors
/// The engine cannot be started, or dies.
pub(super) fn label_by(
    engine: &Engine,
    program: &Program,
    job: &LabelJob,
    episodes: &[&EpisodeEntry],
    progress: &dyn Progress,
) -> Result<Vec<Result<LabelledEpisode, LabelError>>, LabelError> {
    let folder = &job.folder;
    let call = Call {
        program,
        command: COMMAND,
        job,
        folder,
        shared: Vec::new(),
        n_threads: None,
        silence: SILENCE,
        befalls_all: None,
    };
    let errands: Vec<Errand<&EpisodeEntry>> =
        episodes.iter().map(|&task| Errand { task, reads: vec![PathBuf::from(&task.file)] }).collect();
    for entry in episodes {
        // The cluster's nodes get files from here.
        store::open_file(&folder.join(&entry.file))?;
    }
    let made = Mutex::new(episodes.iter().map(|_| None).collect::<Vec<_>>());
    let on_made = |place: usize, answer: Result<LabelledEpisode, TaskError>| -> Result<(), LabelError> {
        let episode = episodes[place].name.clone();
        progress.note(&episode);
        let checked = answer.map_err(|error| error.to_string()).and_then(|labelled| {
            let file = LabelManifest::folder(folder, &job.set).join(&labelled.0.file);
            match sha256_of(&file) {
                Ok(found) if found == labelled.0.sha256 => Ok(labelled),
                Ok(_) => Err(format!("another file came back than was made: {}", file.display())),
                Err(error) => Err(error.to_string()),
            }
        });
        let labelled = checked.map_err(|message| LabelError::Worker { episode, message });
        made.lock().expect("no worker thread panics")[place] = Some(labelled);
        Ok(())
    };
    worker::do_all(engine, &call, &errands, &|| progress.advance(1), &on_made)?;
    let made = made.into_inner().expect("no worker thread panics");
    Ok(made.into_iter().map(|of_episode| of_episode.expect("all are done")).collect())
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
