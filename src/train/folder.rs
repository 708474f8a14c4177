//! The folder of a run: its files, and whether it may be used.

use std::path::Path;

use fs_err as fs;

use super::config::TrainConfig;
use super::error::TrainError;
use super::memory::MemoryBound;
use super::state;
use super::time::TIME_FILE;
use super::trained_on::MADE_WITH_FILE;
use crate::config::to_toml;
use crate::dataset::Fingerprint;
use crate::files;
use crate::history::{CURVE_FILES, SCORES_FILE, STEPS_FILE};
use crate::infer::Predictions;
use crate::model::checkpoint::CHECKPOINT;

/// Name of the resolved config in a run's folder.
pub const CONFIG_FILE: &str = "train.toml";
/// Name of the file that says which data a run saw.
pub const DATA_FILE: &str = "data.json";

/// How a run treats an earlier run in its folder, and what it does after each validation.
#[derive(Clone, Copy, Default)]
pub struct TrainOptions<'a> {
    /// Discard a run of another config.
    pub force: bool,
    /// There must be a run to resume.
    pub resume: bool,
    /// Keep below so much memory, or end with the state saved.
    pub bound: Option<MemoryBound>,
    /// Called with the run's folder after each validation, when its logs are up to date.
    pub after_validation: Option<&'a dyn Fn(&Path)>,
}

/// The hash of a run's config and data, by which its states are known as its own.
///
/// # Errors
/// A file cannot be read.
pub fn sha256(out: &Path) -> std::io::Result<String> {
    let [config, data] = [CONFIG_FILE, DATA_FILE].map(|file| files::sha256_of(&out.join(file)));
    Ok(files::sha256_hex(format!("{} {}", config?, data?).as_bytes()))
}

/// Makes the run's folder, or checks that the run in it is this one.
///
/// # Errors
/// The folder holds another run or something else, there is nothing to resume, or any IO error.
pub fn open(
    data: &Fingerprint,
    config: &TrainConfig,
    out: &Path,
    options: TrainOptions<'_>,
) -> Result<(), TrainError> {
    let config_text = to_toml(config);
    let data_text = serde_json::to_string_pretty(data).expect("a fingerprint has a JSON form");
    let config_path = out.join(CONFIG_FILE);
    let is_empty = !files::holds_anything(out)?;
    if is_empty {
        if options.resume {
            return Err(TrainError::NothingToResume { path: out.to_owned() });
        }
    } else if files::is_file(&config_path)? {
        let has_data = files::is_file(&out.join(DATA_FILE))?;
        let is_same = fs::read(&config_path)? == config_text.as_bytes()
            && has_data
            && fs::read(out.join(DATA_FILE))? == data_text.as_bytes();
        if is_same && !options.force {
            remove_unfinished(out)?;
            return Ok(());
        }
        if !options.force {
            return Err(TrainError::OtherRun { path: out.to_owned() });
        }
        // They would be taken for the new network's.
        Predictions::remove_of_run(out)?;
        state::clear(out)?;
        let own = [CHECKPOINT, STEPS_FILE, SCORES_FILE, TIME_FILE, MADE_WITH_FILE, CONFIG_FILE, DATA_FILE];
        for name in own.into_iter().chain(CURVE_FILES) {
            files::remove_if_there(&out.join(name))?;
        }
    } else if fs::read_dir(out)?.any(|entry| {
        // A run that was stopped at its very beginning leaves only these.
        entry.is_ok_and(|entry| {
            let name = entry.file_name();
            name != DATA_FILE && !name.to_string_lossy().ends_with(files::PARTIAL_SUFFIX)
        })
    }) {
        return Err(TrainError::NotARun { path: out.to_owned() });
    }
    fs::create_dir_all(out)?;
    remove_unfinished(out)?;
    files::write_atomic(&out.join(DATA_FILE), data_text.as_bytes())?;
    files::write_atomic(&config_path, config_text.as_bytes())?;
    Ok(())
}

/// Deletes what a killed run left unfinished: files, and half states.
fn remove_unfinished(out: &Path) -> std::io::Result<()> {
    files::remove_unfinished(out)?;
    files::remove_unfinished_folders(&state::folder(out))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(out: &Path, seed: u64, force: bool) -> Result<(), TrainError> {
        let data = Fingerprint { dataset_sha256: "data".into(), labels_sha256: "labels".into() };
        let config = TrainConfig { seed, ..TrainConfig::default() };
        open(&data, &config, out, TrainOptions { force, ..TrainOptions::default() })
    }

    #[test]
    fn half_states_go_where_a_run_goes_on_and_whole_ones_stay() {
        let home = tempfile::tempdir().unwrap();
        opened(home.path(), 0, false).unwrap();
        let [half, whole] = ["step-00000004.partial", "step-00000002"].map(|name| {
            let folder = state::folder(home.path()).join(name);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("model.safetensors"), "weights").unwrap();
            folder
        });
        opened(home.path(), 0, false).unwrap();
        assert!(!half.exists() && whole.join("model.safetensors").is_file());
    }

    #[test]
    fn by_force_the_curves_and_the_boxes_of_the_old_network_go_and_what_is_yours_stays() {
        let home = tempfile::tempdir().unwrap();
        opened(home.path(), 0, false).unwrap();
        let at = |name: &str| home.path().join(name);
        fs::create_dir_all(at("predictions/id")).unwrap();
        let old = ["curves.svg", "curves.png", "log.csv", "predictions/id/predictions.json"].map(at);
        let yours = ["notes.txt", "predictions/id/notes.mcap", "predictions/mine.json"].map(at);
        old.iter().chain(&yours).for_each(|file| fs::write(file, "text").unwrap());
        assert!(matches!(opened(home.path(), 1, false), Err(TrainError::OtherRun { .. })));
        assert!(old.iter().all(|file| file.exists()));
        opened(home.path(), 1, true).unwrap();
        assert!(old.iter().all(|file| !file.exists()) && yours.iter().all(|file| file.exists()));
    }
}
