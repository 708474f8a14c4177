//! The two data sets of an experiment: made and labelled, or those that were given.

use std::path::{Path, PathBuf};

use anyhow::ensure;

use super::request::Request;
use harmzone::config::to_toml;
use harmzone::dataset::Fingerprint;
use harmzone::episode::Split;
use harmzone::episode::manifest::{LabelManifest, Manifest};
use harmzone::files::sha256_hex;
use harmzone::generate::{self, CheckedConfig, GenerateConfig, Preset, RunOptions, preset};
use harmzone::label;
use harmzone::progress::Progress;
use harmzone::report::results::SetRecord;
use harmzone::scene::SceneSplit;
use harmzone::worker::{Engine, SILENCE};
use harmzone::zone::ZoneConfig;

/// The label set that is made and used.
pub const LABELS: &str = "rect";

/// Makes what is missing of a data set; one that was given is only labelled, and only where it is not.
///
/// # Errors
/// The set cannot be made, read or labelled.
pub fn prepare(
    request: &Request<'_>,
    is_ood: bool,
    progress: &dyn Progress,
) -> anyhow::Result<(PathBuf, SetRecord)> {
    let preset = Preset::named(&request.config.preset).expect("the config was checked");
    let (config, n_episodes) = preset::load(Some(preset), None, is_ood, None, &[])?;
    let given = if is_ood { request.ood.as_ref() } else { request.data.as_ref() };
    let path = given.cloned().unwrap_or_else(|| request.out.join(if is_ood { "ood" } else { "id" }));
    if given.is_none() {
        let options = RunOptions {
            program: request.program.clone().into(),
            engine: Engine::Local { jobs: request.jobs },
            force: false,
            silence: SILENCE,
            own_models: None,
        };
        make(&config, n_episodes, &path, &options, progress)?;
    }
    let manifest = Manifest::read(&path)?;
    ensure!(
        manifest.ood == is_ood,
        "the data set was made {} unfamiliar objects; --data needs one without and --ood one with: {}",
        if manifest.ood { "with" } else { "without" },
        path.display()
    );
    let has_labels = LabelManifest::folder(&path, LABELS).join(LabelManifest::FILE).is_file();
    if given.is_none() || !has_labels {
        label::run(&path, &ZoneConfig::default(), LABELS, false, progress)?;
    }
    let checked = CheckedConfig::try_from(&config)?;
    let record = describe(&path, &manifest, &sha256_hex(to_toml(&checked.raw).as_bytes()), n_episodes)?;
    Ok((path, record))
}

/// Makes a data set to report on, in the towns of split test or in maps by path, and labels it.
///
/// # Errors
/// The set cannot be made or labelled.
pub fn prepare_to_report(
    request: &Request<'_>,
    is_ood: bool,
    maps: Option<&[PathBuf]>,
    path: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let preset = Preset::named(&request.config.preset).expect("the config was checked");
    let (mut config, n_episodes) = preset::load(Some(preset), Some(SceneSplit::Test), is_ood, None, &[])?;
    config.seed = request.config.test_seed.unwrap_or(config.seed);
    if let Some(maps) = maps {
        config.towns = maps.iter().map(|map| map.display().to_string()).collect();
    }
    let options = RunOptions {
        program: request.program.clone().into(),
        engine: Engine::Local { jobs: request.jobs },
        force: false,
        silence: SILENCE,
        own_models: None,
    };
    make(&config, n_episodes, path, &options, progress)?;
    label::run(path, &ZoneConfig::default(), LABELS, false, progress)?;
    Ok(())
}

/// Makes all episodes of a data set: figures on fewer would be those of another set.
fn make(
    config: &GenerateConfig,
    n_episodes: u32,
    path: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let lost = generate::run(config, n_episodes, path, options, progress)?.lost;
    ensure!(
        lost.is_empty(),
        "{} of the {n_episodes} episodes could not be made, and figures are of all or none; the same command tries these \
         again: {}: {}",
        lost.len(),
        lost.join("; "),
        path.display()
    );
    Ok(())
}

fn describe(
    path: &Path,
    manifest: &Manifest,
    preset_sha256: &str,
    n_episodes: u32,
) -> anyhow::Result<SetRecord> {
    let count = |split| manifest.of_split(split).map(|entry| entry.n_samples).sum();
    Ok(SetRecord {
        n_samples: [Split::Train, Split::Val, Split::Dev].map(count),
        fingerprint: Fingerprint::of(path, LABELS)?,
        is_of_preset: manifest.config_sha256 == preset_sha256
            && manifest.episodes.len() == n_episodes as usize,
    })
}
