//! KITTI's three layouts: single frames of the object set, sequences of the tracking set, raw recordings.

mod calib;
mod exported;
mod label;
#[cfg(test)]
mod made;
mod object;
mod oxts;
mod raw;
mod rig;
mod scan;
mod sequence;
#[cfg(test)]
mod tests;
mod tracking;
mod tracklets;

use std::path::{Path, PathBuf};

use self::object::ObjectDrive;
use self::rig::Rig;
use self::sequence::SequenceDrive;
use super::{Drive, ImportConfig, ImportError, Log, Notes};
use crate::files;

/// The method of an imported episode that ends in the rows of `camera_from_rect`: where the rectified camera of labels and results is.
pub const RECTIFIED_CAMERA: &str = "rectified_camera";

/// A KITTI folder.
pub struct KittiLog {
    rig: Rig,
    names: Vec<String>,
    places: Vec<Place>,
}

/// Where a drive lies.
enum Place {
    Object { folder: PathBuf, stem: String },
    Tracking { folder: PathBuf, sequence: String },
    Raw { drive: PathBuf },
}

/// Finds the drives of a KITTI folder, whichever layout it has: what holds `training` and `testing`, one of these, a date, a recording.
///
/// # Errors
/// None of the layouts, or a further camera that KITTI does not have.
pub fn open_kitti(source: &Path, config: &ImportConfig) -> Result<KittiLog, ImportError> {
    let rig = Rig::new(config, source)?;
    let is_set = |folder: &Path| -> std::io::Result<bool> {
        Ok(files::is_dir(&folder.join("velodyne"))? && files::is_dir(&folder.join("calib"))?)
    };
    let mut sets: Vec<PathBuf> = ["training", "testing"].map(|set| source.join(set)).into();
    if is_set(source)? {
        sets = vec![source.to_owned()];
    }
    // An export without a test split has a link there, to the frames for training.
    sets.dedup_by_key(|folder| folder.canonicalize().unwrap_or_else(|_| folder.clone()));
    let (mut names, mut places) = (Vec::new(), Vec::new());
    for folder in sets {
        if !is_set(&folder)? {
            continue;
        }
        let prefix = if folder.ends_with("testing") { "kitti-testing" } else { "kitti" };
        let is_tracking = tracking::is_tracking(&folder)?;
        for stem in stems_of(&folder, is_tracking)? {
            if is_tracking {
                names.push(format!("{prefix}-tracking-{stem}"));
                places.push(Place::Tracking { folder: folder.clone(), sequence: stem });
            } else {
                names.push(format!("{prefix}-{stem}"));
                places.push(Place::Object { folder: folder.clone(), stem });
            }
        }
    }
    if places.is_empty() {
        for drive in raw::find_drives(source)? {
            names.push(format!("kitti-{}", drive.file_name().unwrap_or_default().to_string_lossy()));
            places.push(Place::Raw { drive });
        }
    }
    if places.is_empty() {
        let message = "no KITTI layout is here: neither training/{velodyne,image_2,calib,label_2} (object), nor \
                       training/{velodyne,image_02,calib,oxts}/NNNN (tracking), nor <date>/<date>_drive_NNNN_sync (raw)";
        return Err(ImportError::at(source, message));
    }
    Ok(KittiLog { rig, names, places })
}

/// The frames or sequences of a set: what any of its folders knows, so that a missing file is told and not passed over.
fn stems_of(folder: &Path, is_tracking: bool) -> Result<Vec<String>, ImportError> {
    let parts: &[(&str, &str)] = if is_tracking {
        &[("calib", "txt"), ("oxts", "txt"), ("label_02", "txt")]
    } else {
        &[("velodyne", "bin"), ("calib", "txt"), ("label_2", "txt"), ("image_2", "png"), ("image_2", "jpg")]
    };
    let mut stems = Vec::new();
    for (part, suffix) in parts {
        if files::is_dir(&folder.join(part))? {
            stems.extend(entries(&folder.join(part), suffix)?);
        }
    }
    stems.sort();
    stems.dedup();
    Ok(stems)
}

/// The stems of a folder's files with a suffix, sorted.
fn entries(folder: &Path, suffix: &str) -> Result<Vec<String>, ImportError> {
    let mut stems = Vec::new();
    for entry in fs_err::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|found| found == suffix) {
            stems.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    stems.sort();
    Ok(stems)
}

impl Log for KittiLog {
    fn drives(&self) -> &[String] {
        &self.names
    }

    fn open(&self, drive: &str, _notes: &mut Notes) -> Result<Box<dyn Drive>, ImportError> {
        let place = self.names.iter().position(|name| name == drive).and_then(|i| self.places.get(i));
        let missing = || ImportError::NoDrive { found: drive.to_owned(), valid: self.names.clone() };
        Ok(match place.ok_or_else(missing)? {
            Place::Object { folder, stem } => Box::new(ObjectDrive::open(folder, stem, &self.rig)?),
            Place::Tracking { folder, sequence } => {
                Box::new(SequenceDrive::new(tracking::read_sequence(folder, sequence, &self.rig)?, &self.rig))
            }
            Place::Raw { drive } => {
                let rig = self.rig.along_velodyne();
                Box::new(SequenceDrive::new(raw::read_drive(drive, &rig)?, &rig))
            }
        })
    }
}
