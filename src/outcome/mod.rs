//! What closed-loop drives came to: who drove, how each drive ended, and the figures that compare drivers.
//!
//! `crate::drive` makes drives and writes `drive.json`; this room reads it, and needs neither network nor simulator.

mod drive_outcome;
mod figures;
mod groups;
mod measure;
mod table;
#[cfg(test)]
pub mod test_data;
mod who;
mod worst;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use drive_outcome::{Collision, DriveOutcome, End, HardStop, is_sudden};
pub use figures::{Figures, OverFirst, compare};
pub use groups::GroupFigures;
pub use measure::Measure;
pub use table::{drive_rows, impact_rows, share_lines};
pub use who::{DRIVING, Origin, Source, Who, WhoError};
pub use worst::{Case, Wrong, worst};

use crate::episode::Split;
use crate::files::{is_file_name, read_sealed};

/// The drives of one command: `drive.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveSummary {
    pub generator_version: String,
    /// Of the resolved config without `reply_s`.
    pub config_sha256: String,
    /// Whose worlds they are: `dev`, `test`, ..
    pub split: Split,
    pub ood: bool,
    pub seed: u64,
    /// Set of the labels that a recorded drive has.
    pub labels: String,
    /// Who drove, and by which weights; the figures and the outcomes are in this order.
    pub origins: Vec<Origin>,
    pub figures: Vec<Figures>,
    /// Of each driver, by episode.
    pub outcomes: Vec<Vec<DriveOutcome>>,
}

/// Why `drive.json` could not be read.
#[derive(Debug, Error)]
pub enum ReadDrivesError {
    #[error("no {} there; `harmzone drive WHO.. --out DIR` writes it: {}", DriveSummary::FILE, path.display())]
    Absent { path: PathBuf },
    #[error("not what a drive writes: {message}: {}", path.display())]
    Parse { message: String, path: PathBuf },
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl DriveSummary {
    pub const FILE: &'static str = "drive.json";
    /// The resolved config beside it.
    pub const CONFIG_FILE: &'static str = "drive.toml";

    /// Reads what `harmzone drive --out DIR` wrote.
    ///
    /// # Errors
    /// There is no such file, or it holds something else.
    pub fn read(folder: &Path) -> Result<Self, ReadDrivesError> {
        let path = folder.join(Self::FILE);
        if !path.is_file() {
            return Err(ReadDrivesError::Absent { path });
        }
        let summary: Self = serde_json::from_str(&read_sealed(&path)?)
            .map_err(|error| ReadDrivesError::Parse { message: error.to_string(), path: path.clone() })?;
        let n = summary.figures.len();
        if summary.outcomes.len() != n || summary.origins.len() != n {
            let message = format!(
                "figures of {n} drivers, outcomes of {}, origins of {}; as many of each are needed",
                summary.outcomes.len(),
                summary.origins.len()
            );
            return Err(ReadDrivesError::Parse { message, path });
        }
        if let Some(origin) = summary.origins.iter().find(|origin| !is_file_name(&origin.who.name)) {
            let message =
                format!("the driver's name `{}` is not that of a folder beside it", origin.who.name);
            return Err(ReadDrivesError::Parse { message, path });
        }
        let mut numbers = summary.outcomes.iter().map(Vec::len).zip(&summary.figures);
        let first = numbers.next();
        if let Some((n, of)) = first
            && let Some((found, other)) = numbers.find(|&(found, _)| found != n)
        {
            let message = format!(
                "{n} drives of {} and {found} of {}; all drive the same worlds",
                of.who.name, other.who.name
            );
            return Err(ReadDrivesError::Parse { message, path });
        }
        Ok(summary)
    }

    /// Episodes that failed, of all drivers.
    #[must_use]
    pub fn n_failed(&self) -> usize {
        self.figures.iter().map(|figures| figures.n_failed).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::test_data::{drives, summary};
    use fs_err as fs;

    use super::*;

    #[test]
    fn what_a_command_wrote_is_read_again_and_anything_else_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let read = || DriveSummary::read(folder.path());
        assert!(read().unwrap_err().to_string().contains("harmzone drive WHO.. --out DIR"));
        let written = summary(&[drives("blind", [Some(3.0); 4])], "");
        let path = folder.path().join(DriveSummary::FILE);
        fs::write(&path, serde_json::to_string(&written).unwrap()).unwrap();
        assert_eq!(read().unwrap(), written);
        fs::write(&path, serde_json::to_string(&DriveSummary { outcomes: vec![], ..written }).unwrap())
            .unwrap();
        let error = read().unwrap_err().to_string();
        assert!(error.contains("outcomes of 0") && error.contains("drive.json"), "{error}");
        let mut uneven = summary(&[drives("blind", [Some(3.0); 4]), drives("truth", [None; 4])], "");
        uneven.outcomes[1].clear();
        fs::write(&path, serde_json::to_string(&uneven).unwrap()).unwrap();
        let error = read().unwrap_err().to_string();
        assert!(error.contains("4 drives of blind and 0 of truth"), "{error}");
        let mut outside = summary(&[drives("blind", [Some(3.0); 4])], "");
        outside.origins[0].who.name = "../blind".into();
        fs::write(&path, serde_json::to_string(&outside).unwrap()).unwrap();
        let error = read().unwrap_err().to_string();
        assert!(error.contains("`../blind`") && error.contains("drive.json"), "{error}");
        fs::write(&path, "{}").unwrap();
        assert!(read().unwrap_err().to_string().contains("not what a drive writes"));
    }
}
