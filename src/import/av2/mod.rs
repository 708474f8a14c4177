//! Argoverse 2 sensor logs: sweeps, cuboids and poses as feather files, pictures, the vector map.

mod calibration;
mod drive;
mod feather;
mod lidar;
#[cfg(test)]
mod made;
mod map;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use self::drive::SensorLog;
use super::error::listed;
use super::{Drive, ImportConfig, ImportError, Log, Notes};
use crate::files;

/// A log's folder, or a folder of logs.
pub struct Av2Log {
    names: Vec<String>,
    folders: Vec<PathBuf>,
    config: ImportConfig,
}

/// Finds the logs of a folder: itself, those in it, or those in its splits (`train`, `val`, `test`).
///
/// # Errors
/// There is none.
pub fn open_av2(source: &Path, config: &ImportConfig) -> Result<Av2Log, ImportError> {
    let mut places = vec![source.to_owned()];
    places.extend(listed(source)?);
    for split in ["train", "val", "test"] {
        places.extend(listed(&source.join(split))?);
    }
    let mut folders = Vec::new();
    for place in places {
        if files::is_dir(&place.join("sensors/lidar"))? {
            folders.push(place);
        }
    }
    if folders.is_empty() {
        let message = "no Argoverse 2 log is here: neither this folder nor one in it holds sensors/lidar";
        return Err(ImportError::at(source, message));
    }
    let name = |folder: &PathBuf| {
        let whole = fs_err::canonicalize(folder).unwrap_or_else(|_| folder.clone());
        whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
    };
    Ok(Av2Log { names: folders.iter().map(name).collect(), folders, config: config.clone() })
}

impl Log for Av2Log {
    fn drives(&self) -> &[String] {
        &self.names
    }

    fn open(&self, drive: &str, notes: &mut Notes) -> Result<Box<dyn Drive>, ImportError> {
        let place = self.names.iter().position(|name| name == drive).and_then(|i| self.folders.get(i));
        let missing = || ImportError::NoDrive { found: drive.to_owned(), valid: self.names.clone() };
        Ok(Box::new(SensorLog::open(place.ok_or_else(missing)?, &self.config, notes)?))
    }
}
