//! The folder of drives: what it holds, what of an earlier run is whole, and data sets of what was recorded.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::{DriveConfig, DriveError};
use crate::episode::Manifest;
use crate::episode::folder::{first_difference, is_whole};
use crate::files::{self, holds_anything, read_sealed, sha256_hex, write_atomic, write_sealed};
use crate::generate::EpisodePlan;
use crate::label;
use crate::outcome::{DriveOutcome, DriveSummary, Origin};

const OUTCOMES: &str = "outcomes";
const PREDICTIONS: &str = "predictions";

/// Prepares the folder, or refuses one that holds something else. Gives the drivers back, with all processors that drove.
///
/// # Errors
/// It holds drives of another config, of other weights, or by other rules.
pub(super) fn open(out: &Path, config_toml: &str, origins: &[Origin]) -> Result<Vec<Origin>, DriveError> {
    // The resolved config is written before anything else.
    let config_path = out.join(DriveSummary::CONFIG_FILE);
    let other =
        |found: String, wanted: String| Err(DriveError::OtherConfig { found, wanted, path: out.to_owned() });
    if files::is_file(&config_path)? {
        let found = fs::read_to_string(&config_path)?;
        if let Some((found, wanted)) =
            first_difference(&without_patience(&found), &without_patience(config_toml))
        {
            return other(found, wanted);
        }
    } else if holds_anything(out)? {
        return Err(DriveError::ForeignFolder { path: out.to_owned() });
    }
    let mut origins = origins.to_vec();
    for origin in &mut origins {
        let path = out.join(&origin.who.name).join(Origin::FILE);
        if !files::is_file(&path)? {
            continue;
        }
        let found: Origin = serde_json::from_str(&read_sealed(&path)?)
            .map_err(|error| DriveError::BadOutcome { message: error.to_string(), path })?;
        if let Some((found, wanted)) = first_difference(&found.identity(), &origin.identity()) {
            return other(found.trim().to_owned(), wanted.trim().to_owned());
        }
        let others: Vec<&str> =
            found.cpus.iter().filter(|cpu| !origin.cpus.contains(cpu)).map(String::as_str).collect();
        if !others.is_empty() {
            tracing::warn!(
                "{}: drives of another processor are kept ({}); in their last bits, and by chance in their outcomes, they may differ \
                 from this one's: {}",
                origin.who.name,
                others.join(", "),
                out.display()
            );
        }
        origin.cpus.extend(found.cpus);
        origin.cpus.sort_unstable();
        origin.cpus.dedup();
    }
    fs::create_dir_all(out)?;
    write_atomic(&config_path, config_toml.as_bytes())?;
    for origin in &origins {
        let folder = out.join(&origin.who.name);
        fs::create_dir_all(folder.join(OUTCOMES))?;
        write_sealed(&folder.join(Origin::FILE), &origin.of_file())?;
    }
    Ok(origins)
}

/// The hash of a config, whose drives are alike where it is.
pub(super) fn identity(config_toml: &str) -> String {
    sha256_hex(without_patience(config_toml).as_bytes())
}

/// A config without the time that a detector is waited for: more patience is no other drive.
fn without_patience(config_toml: &str) -> String {
    config_toml.lines().filter(|line| !line.starts_with("reply_s = ")).flat_map(|line| [line, "\n"]).collect()
}

/// The outcome of an earlier run, with its episode if that is wanted. A failed drive is made again; an episode that is gone or
/// damaged is forgotten.
pub(super) fn find_whole(
    folder: &Path,
    plan: &EpisodePlan,
    records: bool,
) -> Result<Option<DriveOutcome>, DriveError> {
    let path = outcome_path(folder, plan);
    if !files::is_file(&path)? {
        return Ok(None);
    }
    let bad = |message: String| DriveError::BadOutcome { message, path: path.clone() };
    let mut outcome: DriveOutcome =
        serde_json::from_str(&read_sealed(&path)?).map_err(|error| bad(error.to_string()))?;
    let names = std::iter::once(&outcome.episode).chain(outcome.entry.as_ref().map(|entry| &entry.name));
    if let Some(other) = { names }.find(|name| **name != plan.name) {
        return Err(bad(format!("it is of the drive `{other}`")));
    }
    let is_there =
        outcome.entry.as_ref().is_some_and(|entry| is_whole(folder, entry).is_ok_and(|is_whole| is_whole));
    if !is_there {
        outcome.entry = None;
    }
    Ok((!outcome.is_failed() && (!records || is_there)).then_some(outcome))
}

/// Keeps a drive's outcome.
pub(super) fn write_outcome(
    folder: &Path,
    plan: &EpisodePlan,
    outcome: &DriveOutcome,
) -> Result<(), DriveError> {
    Ok(write_sealed(&outcome_path(folder, plan), outcome)?)
}

/// Takes away what was recorded of a drive that does not count.
pub(super) fn remove_recorded(folder: &Path, plan: &EpisodePlan) -> io::Result<()> {
    for file in [folder.join(plan.file()), predictions_file(folder, plan)] {
        files::remove_if_there(&file)?;
    }
    Ok(())
}

/// What the driver's detector told in a recorded drive.
pub(super) fn predictions_file(folder: &Path, plan: &EpisodePlan) -> PathBuf {
    folder.join(PREDICTIONS).join(format!("{}.mcap", plan.name))
}

fn outcome_path(folder: &Path, plan: &EpisodePlan) -> PathBuf {
    folder.join(OUTCOMES).join(format!("{}.json", plan.name))
}

/// Makes the driver's folder a labelled data set of what was recorded, if anything was.
pub(super) fn finish_dataset(
    folder: &Path,
    config: &DriveConfig,
    config_toml: &str,
    outcomes: &[DriveOutcome],
) -> Result<(), DriveError> {
    let mut manifest = Manifest::new(identity(config_toml), config.world.seed, config.world.scene.ood);
    manifest.episodes = outcomes.iter().filter_map(|outcome| outcome.entry.clone()).collect();
    if manifest.episodes.is_empty() {
        // What an earlier run listed is gone.
        files::remove_if_there(&folder.join(Manifest::FILE))?;
        return Ok(());
    }
    manifest.write(folder)?;
    let set = config.zone.kind.name();
    label::run(folder, &config.zone, set, true, &crate::progress::Silent)?;
    Ok(())
}
