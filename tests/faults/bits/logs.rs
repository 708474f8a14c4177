//! Logs of others, imported whole: one file of a small log is damaged.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use harmzone::episode::Split;
use harmzone::import::nuscenes::NuScenesLog;
use harmzone::import::{ImportConfig, ImportError, ImportOptions, Log, LogFormat, open_av2, run};
use harmzone::progress::Silent;
use harmzone::worker::with_causes;

use super::super::folder::hashes;
use super::super::made_data::{done, text};
use super::kinds::Kind;

#[allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::pedantic,
    dead_code,
    reason = "the library's own tests share it"
)]
#[path = "../../../src/import/av2/made.rs"]
mod made_av2;

/// Sweeps of the made log of Argoverse 2.
const N_SWEEPS: i64 = 2;

/// The bytes of all that an import writes.
fn import<L: Log>(
    format: LogFormat,
    open: impl FnOnce(&ImportConfig) -> Result<L, ImportError>,
) -> Result<String, String> {
    let config = ImportConfig::shipped(format);
    let log = open(&config).map_err(|error| with_causes(&error))?;
    let out = tempfile::tempdir().expect("a temporary folder");
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    run(&log, format, &config, out.path(), &options, &Silent).map_err(|error| with_causes(&error))?;
    Ok(as_text(&hashes(out.path())))
}

fn as_text(value: &impl Debug) -> String {
    format!("{value:?}")
}

/// Files of two logs below `home`: one of nuScenes, exported from a data set, and one of Argoverse 2. No format holds a hash.
pub fn kinds(data: &Path, home: &Path) -> Vec<Kind> {
    let nuscenes = home.join("nuscenes");
    let words = ["export", "nuscenes", text(data), text(&nuscenes), "--categories", "source", "--version"];
    done(&[words.as_slice(), &["v1.0-mini"]].concat());
    let av2 = home.join("av2");
    made_av2::log(&av2, N_SWEEPS, false);
    made_av2::cameras(&av2, N_SWEEPS, [1550, 2048]);
    let of_nuscenes = |name, file: &str| {
        let root = nuscenes.clone();
        let read = move |_: &Path| import(LogFormat::Nuscenes, |config| NuScenesLog::open(&root, config));
        of_log(name, &nuscenes, file, read)
    };
    let of_av2 = |name, file: &str| {
        let root = av2.clone();
        of_log(name, &av2, file, move |_: &Path| import(LogFormat::Av2, |config| open_av2(&root, config)))
    };
    vec![
        of_nuscenes("nuScenes, samples", "v1.0-mini/sample.json"),
        of_nuscenes("nuScenes, mounts", "v1.0-mini/calibrated_sensor.json"),
        of_av2("Argoverse, boxes", "annotations.feather"),
        of_av2("Argoverse, mounts", "calibration/egovehicle_SE3_sensor.feather"),
    ]
}

fn of_log(
    name: &'static str,
    root: &Path,
    file: &str,
    read: impl Fn(&Path) -> Result<String, String> + 'static,
) -> Kind {
    let path: PathBuf = root.join(file);
    Kind { company: Some(root.to_owned()), ..Kind::new(name, path, false, read) }
}
