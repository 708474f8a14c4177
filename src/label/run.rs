//! Labels a whole data set: one file per episode under `labels/<set>/`, and `labels.json` last.
//!
//! `labels.json` is written when every episode is done, so a set without it is unfinished and is made anew.

use std::path::{Path, PathBuf};

use fs_err as fs;
use rayon::prelude::*;
use thiserror::Error;

use super::apply::{SampleError, label_sample};
use super::counts::LabelSummary;
use crate::config;
use crate::episode::manifest::{
    EpisodeEntry, LabelCounts, LabelEntry, LabelManifest, Manifest, ManifestError,
};
use crate::episode::{EpisodeError, EpisodeReader, LabelWriter, SourceMeta, is_any_annotated};
use crate::files::sha256_hex;
use crate::progress::Progress;
use crate::zone::{Zone, ZoneConfig, ZoneError};

/// Why a data set could not be labelled.
#[derive(Debug, Error)]
pub enum LabelError {
    #[error(transparent)]
    Zone(#[from] ZoneError),
    #[error(transparent)]
    Sample(#[from] SampleError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the label set's name is `{found}`; letters, digits, `-` and `_` are needed")]
    SetName { found: String },
    #[error("the data set holds no episode: {}", path.display())]
    NoEpisodes { path: PathBuf },
    #[error("label set `{set}` was made with {what}; --force makes it anew, --labels NAME makes another: {}", path.display())]
    Other { set: String, what: &'static str, path: PathBuf },
    #[error(
        "nobody annotated these episodes, so there is nothing to label or score; `harmzone predict` and `harmzone view` \
         work without: {}",
        path.display()
    )]
    NoTruth { path: PathBuf },
}

/// Labels every annotated object of a data set.
///
/// A set that is complete and of the same zone is left as it is and its counts are returned.
///
/// # Errors
/// [`LabelError`]; a set of another zone or of other episodes is kept unless `force`.
pub fn run(
    dataset: &Path,
    zone_config: &ZoneConfig,
    set: &str,
    force: bool,
    progress: &dyn Progress,
) -> Result<LabelSummary, LabelError> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if set.is_empty() || !set.chars().all(is_word) {
        return Err(LabelError::SetName { found: set.to_owned() });
    }
    let zone = Zone::try_from(zone_config.clone())?;
    let zone_toml = config::to_toml(zone_config);
    let manifest = Manifest::read(dataset)?;
    if manifest.episodes.is_empty() {
        return Err(LabelError::NoEpisodes { path: dataset.to_owned() });
    }
    let folder = LabelManifest::folder(dataset, set);
    if !force
        && folder.join(LabelManifest::FILE).is_file()
        && let Some(done) = finished(LabelManifest::read(dataset, set)?, &manifest, zone_config, &folder)?
    {
        return Ok(summary(&done, true));
    }
    // Episodes without truth beside others get the zone and no labels.
    if !is_any_annotated(dataset, &manifest)? {
        return Err(LabelError::NoTruth { path: dataset.to_owned() });
    }
    fs::create_dir_all(&folder)?;
    // Until the new files are complete, the set must not look finished.
    match fs::remove_file(folder.join(LabelManifest::FILE)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
        _ => {}
    }
    let mut labels = LabelManifest::new(set, zone_toml, &manifest);
    progress.start("label", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
    let label_one = |entry| label_episode(dataset, &folder, entry, &zone, &labels, progress);
    // All are tried, so that of several broken episodes the first one is told.
    let labelled: Vec<_> = manifest.episodes.par_iter().map(label_one).collect();
    for of_episode in labelled {
        let (entry, counts) = of_episode?;
        labels.episodes.push(entry);
        labels.counts.add_all(&counts);
    }
    labels.write(dataset)?;
    progress.finish();
    Ok(summary(&labels, false))
}

/// The set as it is if there is nothing to do; `None` if episodes are missing from it.
fn finished(
    labels: LabelManifest,
    manifest: &Manifest,
    zone_config: &ZoneConfig,
    folder: &Path,
) -> Result<Option<LabelManifest>, LabelError> {
    let other = |what| LabelError::Other { set: labels.set.clone(), what, path: folder.to_owned() };
    // Parsed, not compared as text: a set made before a key existed was made with its default.
    if toml::from_str::<ZoneConfig>(&labels.zone_toml).ok().as_ref() != Some(zone_config) {
        return Err(other("another zone"));
    }
    let is_known = |entry: &LabelEntry| {
        manifest.episodes.iter().any(|e| e.name == entry.name && e.sha256 == entry.episode_sha256)
    };
    if !labels.episodes.iter().all(is_known) {
        return Err(other("other episodes"));
    }
    let are_files_there = labels.episodes.iter().all(|entry| folder.join(&entry.file).is_file());
    let is_complete = are_files_there && labels.episodes.len() == manifest.episodes.len();
    Ok(is_complete.then_some(labels))
}

fn label_episode(
    dataset: &Path,
    folder: &Path,
    entry: &EpisodeEntry,
    zone: &Zone,
    labels: &LabelManifest,
    progress: &dyn Progress,
) -> Result<(LabelEntry, LabelCounts), LabelError> {
    progress.note(&entry.name);
    let mut counts = LabelCounts::default();
    let reader = EpisodeReader::open_entry(dataset, entry)?;
    let meta = SourceMeta {
        episode: entry.name.clone(),
        episode_sha256: entry.sha256.clone(),
        set: labels.set.clone(),
        config_toml: labels.zone_toml.clone(),
        generator_version: labels.generator_version.clone(),
    };
    let file = format!("{}.mcap", entry.name);
    let mut writer = LabelWriter::create(&folder.join(&file), &meta)?;
    for (sample_idx, sample) in reader.samples().enumerate() {
        let sample = sample?;
        let found = label_sample(zone, &entry.name, sample_idx, &sample)?;
        for (object, label) in sample.objects().iter().zip(&found.labels) {
            count(&mut counts, object, label.harm);
        }
        writer.write(&found, &sample)?;
        progress.advance(1);
    }
    let path = writer.finish()?;
    let entry = LabelEntry {
        name: entry.name.clone(),
        file,
        episode_sha256: entry.sha256.clone(),
        sha256: sha256_hex(&fs::read(path)?),
        n_samples: entry.n_samples,
    };
    Ok((entry, counts))
}

fn count(counts: &mut LabelCounts, object: &crate::object::Object, harm: crate::object::Harm) {
    if let Some(count) = counts.of_mut(object) {
        count.add(harm);
    }
}

fn summary(labels: &LabelManifest, was_complete: bool) -> LabelSummary {
    LabelSummary {
        set: labels.set.clone(),
        was_complete,
        n_episodes: labels.episodes.len(),
        n_samples: labels.episodes.iter().map(|entry| entry.n_samples).sum(),
        counts: labels.counts,
    }
}
