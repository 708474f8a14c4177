//! `harmzone import ros2`: bags of ROS 2 in MCAP, with topics and frames by a mapping.
//!
//! A bag is gone through once for stamps, tf and measured numbers, and once more, by its index, for the frame of each
//! sample. Messages are decoded by the types that the bag itself describes (`schema`, `cdr`).

mod bag;
mod calibration;
mod cdr;
mod choice;
mod clouds;
mod container;
mod drive;
mod images;
mod listing;
mod mapping;
mod measured;
mod message;
mod objects;
mod poses;
mod propose;
mod schema;
mod tf;
mod timeline;
mod words;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bag::Bag;
use drive::Ros2Drive;
use propose::{Proposal, tf_tree};

pub use listing::list;
pub use mapping::{
    CameraAxes, CameraMapping, FieldMapping, FrameMapping, LidarMapping, MappingConfig, ObjectMapping,
    PoseMapping, Rectified, StampSource, TimeUnit, TransformMapping, VehicleMapping,
};

use super::{Drive, ImportConfig, ImportError, Log, Notes};
use crate::config::{self, Checked};

/// A bag, or a folder of bags, each of which is a drive.
pub struct Ros2Log {
    bags: BTreeMap<String, PathBuf>,
    drives: Vec<String>,
    /// `None`: each bag's own proposal.
    mapping: Option<Checked<MappingConfig>>,
    config: ImportConfig,
}

impl Ros2Log {
    /// Finds the bags under a path; of a folder of files without `metadata.yaml` the indexes tell whether they are one.
    ///
    /// # Errors
    /// The mapping is not valid, or the folder cannot be read.
    pub fn open(
        path: &Path,
        mapping: Option<MappingConfig>,
        config: &ImportConfig,
    ) -> Result<Self, ImportError> {
        let mapping = mapping.map(Checked::new).transpose()?;
        let mut bags: BTreeMap<String, PathBuf> = BTreeMap::new();
        for bag in container::bags_under(path)? {
            let name = drive_name(&bag);
            if let Some(other) = bags.get(&name) {
                return Err(ImportError::at(
                    path,
                    format!(
                        "two bags would be drives of the name `{name}`: {} and {}; name them apart, or import one at a time",
                        other.display(),
                        bag.display()
                    ),
                ));
            }
            bags.insert(name, bag);
        }
        let drives = bags.keys().cloned().collect();
        Ok(Self { bags, drives, mapping, config: config.clone() })
    }
}

/// The bag's name as a file name may hold it.
fn drive_name(path: &Path) -> String {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let stem = if path.is_dir() { path.file_name() } else { path.file_stem() };
    let name = stem.unwrap_or_default().to_string_lossy();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    name.chars().map(|c| if is_plain(c) { c } else { '_' }).collect()
}

impl Log for Ros2Log {
    fn drives(&self) -> &[String] {
        &self.drives
    }

    fn settings_toml(&self) -> String {
        let Some(mapping) = &self.mapping else { return "\n[mapping]\nproposed = true\n".into() };
        let mut tables = toml::Table::new();
        let mapping = toml::Value::try_from(&**mapping).expect("a config always has a TOML form");
        tables.insert("mapping".into(), mapping);
        format!("\n{}", config::to_toml(&tables))
    }

    fn open(&self, drive: &str, notes: &mut Notes) -> Result<Box<dyn Drive>, ImportError> {
        let Some(path) = self.bags.get(drive) else {
            return Err(ImportError::NoDrive { found: drive.to_owned(), valid: self.drives.clone() });
        };
        let bag = Bag::open(path)?;
        let mapping = if let Some(mapping) = &self.mapping {
            mapping.clone()
        } else {
            let proposal = Proposal::of(&bag, &tf_tree(&bag)?)?;
            notes.tell(
                "there is no --mapping, so that topics and frames are guessed; `--list` tells them and why",
            );
            for (table, reason) in proposal.reasons.iter().filter(|(_, reason)| reason.contains("MISSING")) {
                notes.tell(format!("mapping [{table}]: {reason}"));
            }
            proposal.notes.into_iter().for_each(|sentence| notes.tell(sentence));
            Checked::new(proposal.mapping)?
        };
        let is_guessed = self.mapping.is_none();
        Ok(Box::new(Ros2Drive::open(bag, mapping, is_guessed, &self.config, notes)?))
    }
}
