//! Manifests and configs: JSON and TOML.

use std::path::Path;

use harmzone::config::{Check, Checked, load, load_over, to_toml, with_overrides};
use harmzone::drive::{DriveConfig, load_scenarios};
use harmzone::episode::{LabelManifest, Manifest, Split};
use harmzone::eval::sweep::SweepConfig;
use harmzone::eval::{EvalConfig, Protocol};
use harmzone::generate::{CheckedConfig, GenerateConfig, plan, preset};
use harmzone::import::ros2::MappingConfig;
use harmzone::import::{ImportConfig, LogFormat};
use harmzone::meshes::SettingsFile;
use harmzone::model::ModelConfig;
use harmzone::sensors::{Rig, RigConfig};
use harmzone::train::TrainConfig;
use harmzone::zone::{Zone, ZoneConfig};
use serde::{Serialize, de::DeserializeOwned};

use super::scratch;

/// `dataset.json` (first byte even) or `labels.json`.
pub fn manifest(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    if kind % 2 == 0 {
        let path = scratch::write("manifest/dataset.json", rest);
        let folder = path.parent().expect("it lies in a folder");
        if let Ok(manifest) = Manifest::read(folder) {
            let _ = (manifest.n_by_split(), Split::to_score(&manifest), manifest.write(folder));
        }
    } else {
        let dataset = scratch::place("manifest");
        scratch::write("manifest/labels/harm/labels.json", rest);
        if let Ok(manifest) = LabelManifest::read(&dataset, "harm") {
            let _ = toml::from_str::<ZoneConfig>(&manifest.zone_toml).map(Zone::try_from);
        }
    }
}

/// Loads a file over the default, checks it, and writes it out.
fn checked<T: Check + Serialize + DeserializeOwned + Default + Clone>(path: &Path) -> Option<T> {
    let config: T = load(Some(path), &[]).ok()?;
    let _ = load_over(&T::default(), Some(path), &[]);
    let checked = Checked::new(config).ok()?;
    let text = to_toml(&*checked);
    assert!(toml::from_str::<T>(&text).is_ok(), "a config that was written cannot be read:\n{text}");
    Some((*checked).clone())
}

/// The files that `config` takes, by the first byte.
pub const CONFIGS: [&str; 13] = [
    "gen",
    "train",
    "zone",
    "rig",
    "eval",
    "sweep",
    "drive",
    "model",
    "import",
    "ros2_mapping",
    "models",
    "scenario",
    "overrides",
];

/// A config of one of [`CONFIGS`], or lines of `--set`.
pub fn config(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let name = CONFIGS[kind % CONFIGS.len()];
    let path = scratch::write(&format!("config/{name}.toml"), rest);
    match name {
        "gen" => {
            let _ = checked::<GenerateConfig>(&path);
            if let Ok((config, n)) = preset::load(None, None, false, Some(&path), &[])
                && let Ok(checked) = CheckedConfig::try_from(&config)
            {
                let _ = plan(&checked, n.min(100));
            }
        }
        "train" => _ = checked::<TrainConfig>(&path),
        "zone" => {
            if let Some(config) = checked::<ZoneConfig>(&path) {
                let _ = Zone::try_from(config).map(|zone| zone.describe(10.0));
            }
        }
        "rig" => {
            if let Some(config) = checked::<RigConfig>(&path) {
                let _ = Rig::try_from(&config);
            }
        }
        "eval" => {
            if let Some(config) = checked::<EvalConfig>(&path) {
                let _ = Protocol::try_from(config);
            }
        }
        "sweep" => _ = checked::<SweepConfig>(&path),
        "drive" => _ = checked::<DriveConfig>(&path),
        "model" => _ = checked::<ModelConfig>(&path),
        "import" => {
            for format in LogFormat::ALL {
                let _ = ImportConfig::load(format, Some(&path), &[]).map(Checked::new);
            }
        }
        "ros2_mapping" => _ = checked::<MappingConfig>(&path),
        "models" => {
            let _ = SettingsFile::read(path.parent().expect("it lies in a folder"));
        }
        "scenario" => _ = load_scenarios(&path),
        _ => {
            let overrides: Vec<String> = String::from_utf8_lossy(rest).lines().map(str::to_owned).collect();
            let _ = with_overrides(&GenerateConfig::default(), &overrides).map(|config| to_toml(&config));
            let _ = with_overrides(&TrainConfig::default(), &overrides).map(Checked::new);
        }
    }
}
