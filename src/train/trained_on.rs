//! What a run was trained on, so far as it may change the last bits of its weights: `made_with.json` in its folder.

use std::collections::BTreeSet;
use std::path::Path;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use super::error::StateError;
use crate::device::what_computes;
use crate::episode::cpu;
use crate::files::{is_file, read_sealed, write_sealed};

/// Name of the file.
pub const MADE_WITH_FILE: &str = "made_with.json";

/// The processors and devices that took part, each once.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedOn {
    /// Architecture, then the extensions that numbers may depend on.
    pub cpus: BTreeSet<String>,
    /// What the steps were computed on: `cpu`, or a GPU's name.
    pub devices: BTreeSet<String>,
}

impl TrainedOn {
    /// Reads a run's folder; `None` where there is no such file, as in runs of before there was one.
    ///
    /// # Errors
    /// The file cannot be read, or is not as it was written.
    pub fn read(run: &Path) -> Result<Option<Self>, StateError> {
        let path = run.join(MADE_WITH_FILE);
        if !is_file(&path)? {
            return Ok(None);
        }
        let broken =
            |error: serde_json::Error| StateError::Broken { message: error.to_string(), path: path.clone() };
        serde_json::from_str(&read_sealed(&path)?).map(Some).map_err(broken)
    }

    /// Adds this machine to a run's file; returns the run's others, on which the same steps may end in other last bits.
    ///
    /// # Errors
    /// As [`Self::read`]; the file cannot be written.
    pub fn note(run: &Path, devices: &[Device]) -> Result<Vec<String>, StateError> {
        let here = Self { cpus: [cpu()].into(), devices: devices.iter().map(what_computes).collect() };
        let found = Self::read(run)?.unwrap_or_default();
        let others = found.cpus.difference(&here.cpus).chain(found.devices.difference(&here.devices));
        let others = others.cloned().collect();
        let all = Self { cpus: &found.cpus | &here.cpus, devices: &found.devices | &here.devices };
        if all != found {
            write_sealed(&run.join(MADE_WITH_FILE), &all)?;
        }
        Ok(others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_processor_is_noted_once_and_another_one_is_told() {
        let run = tempfile::tempdir().unwrap();
        assert_eq!(TrainedOn::read(run.path()).unwrap(), None);
        let note = || TrainedOn::note(run.path(), &[Device::flex()]).unwrap();
        assert!(note().is_empty() && note().is_empty());
        let mut found = TrainedOn::read(run.path()).unwrap().unwrap();
        assert_eq!(found.devices, ["cpu".to_owned()].into());
        found.cpus = ["another one".to_owned()].into();
        write_sealed(&run.path().join(MADE_WITH_FILE), &found).unwrap();
        assert_eq!(note(), ["another one"]);
        let both = TrainedOn::read(run.path()).unwrap().unwrap();
        assert_eq!(both.cpus, ["another one".to_owned(), cpu()].into());
        let path = run.path().join(MADE_WITH_FILE);
        fs_err::write(&path, fs_err::read_to_string(&path).unwrap().replace("another", "changed")).unwrap();
        assert!(TrainedOn::read(run.path()).unwrap_err().to_string().contains("was changed"));
    }
}
