//! A labelled dataset in memory: each sample's measurements and its objects with their labels.

#[cfg(test)]
pub mod test_data;

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::label::zone::Zone;
use crate::object::LabelledObject;
use crate::sample::Measured;

/// One labelled sample.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledSample {
    /// `<episode>/<sample index>`.
    pub id: String,
    pub measured: Measured,
    pub objects: Vec<LabelledObject>,
}

/// What a run was trained on, to recognise it again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fingerprint {
    pub dataset_sha256: String,
    pub labels_sha256: String,
}

/// A dataset with one of its label sets.
#[derive(Debug, Clone)]
pub struct Dataset {
    path: PathBuf,
    train: Vec<LabelledSample>,
    zone: Zone,
    fingerprint: Fingerprint,
}

impl Dataset {
    pub fn path(&self) -> &Path { &self.path }
    pub fn zone(&self) -> &Zone { &self.zone }
    pub fn fingerprint(&self) -> &Fingerprint { &self.fingerprint }
    pub fn train_samples(&self) -> Vec<&LabelledSample> { self.train.iter().collect() }
}

#[cfg(test)]
impl Dataset {
    /// A sample to spoil in a test.
    pub fn sample_mut(&mut self, idx: usize) -> &mut LabelledSample {
        &mut self.train[idx]
    }
}
