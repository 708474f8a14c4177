//! nuScenes: any version's folder; LiDAR, front camera and others by choice, poses, CAN bus, annotations.

mod annotations;
mod can_bus;
mod scene;
mod tables;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fs_err as fs;

use super::{Drive, ImportConfig, ImportError, Log, Notes};
use crate::files;
use scene::Scene;
use tables::{LIDAR, Tables};

/// A version's folder of nuScenes with its scenes.
pub struct NuScenesLog {
    version: PathBuf,
    tables: Arc<Tables>,
    /// The cameras' channels, the front one first.
    channels: Vec<String>,
    drives: Vec<String>,
    config: ImportConfig,
}

impl NuScenesLog {
    /// Reads the tables: of `path` where it holds them, else of the one version's folder in it.
    ///
    /// # Errors
    /// There is no or more than one version's folder, a table is missing or not valid, or a camera is not known.
    pub fn open(path: &Path, config: &ImportConfig) -> Result<Self, ImportError> {
        let version = version_in(path)?;
        let mut channels = vec![scene::FRONT.to_owned()];
        for camera in config.cameras.iter().map(|camera| camera.to_ascii_uppercase()) {
            if !channels.contains(&camera) {
                channels.push(camera);
            }
        }
        let wanted: Vec<&str> = channels.iter().map(String::as_str).chain([LIDAR]).collect();
        let tables = Tables::read(&version, &wanted)?;
        let mut known: Vec<&str> = tables.channels().collect();
        known.sort_unstable();
        if let Some(unknown) = channels.iter().find(|channel| !known.contains(&channel.as_str())) {
            let message = format!("no camera `{unknown}`; the sensors are {}", known.join(", "));
            return Err(ImportError::at(&version, message));
        }
        let drives: Vec<String> = tables.scenes.iter().map(|scene| scene.name.clone()).collect();
        let is_fit = |name: &&String| {
            let is_safe = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
            !name.is_empty()
                && name.chars().all(is_safe)
                && drives.iter().filter(|other| other == name).count() == 1
        };
        if let Some(unfit) = drives.iter().find(|name| !is_fit(name)) {
            let message = format!("the scene's name `{unfit}` is there twice or unfit for a file name");
            return Err(ImportError::at(&version.join("scene.json"), message));
        }
        Ok(Self { version, tables: Arc::new(tables), channels, drives, config: config.clone() })
    }
}

impl Log for NuScenesLog {
    fn drives(&self) -> &[String] {
        &self.drives
    }

    fn open(&self, drive: &str, _notes: &mut Notes) -> Result<Box<dyn Drive>, ImportError> {
        let Some(row) = self.tables.scenes.iter().find(|scene| scene.name == drive) else {
            return Err(ImportError::NoDrive { found: drive.to_owned(), valid: self.drives.clone() });
        };
        let scene = Scene::open(Arc::clone(&self.tables), row, &self.channels, &self.config, &self.version)?;
        Ok(Box::new(scene))
    }
}

/// The folder of tables that a path names.
fn version_in(path: &Path) -> Result<PathBuf, ImportError> {
    let has_tables = |folder: &Path| -> std::io::Result<bool> {
        Ok(files::is_file(&folder.join("scene.json"))? || files::is_file(&folder.join("sample_data.json"))?)
    };
    if has_tables(path)? {
        return Ok(std::path::absolute(path)?);
    }
    let entries = fs::read_dir(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => {
            ImportError::at(path, format!("there is no folder ({}); give a folder of nuScenes", error.kind()))
        }
        _ => ImportError::Io(error),
    })?;
    let mut versions: Vec<PathBuf> = Vec::new();
    for entry in entries {
        let folder = entry?.path();
        if has_tables(&folder)? {
            versions.push(folder);
        }
    }
    versions.sort();
    match versions.as_slice() {
        [version] => Ok(std::path::absolute(version)?),
        [] => Err(ImportError::at(
            path,
            "no folder of tables here, such as v1.0-mini with scene.json and 12 others",
        )),
        several => {
            let names: Vec<String> = several.iter().map(|version| version.display().to_string()).collect();
            Err(ImportError::at(
                path,
                format!("several versions here; give one of them: {}", names.join(", ")),
            ))
        }
    }
}
