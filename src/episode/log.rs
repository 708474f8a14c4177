//! What an episode that was imported from a log says of its source and of its truth: the metadata record `log`.
//!
//! Simulated episodes have none. Metres; kinds and sizes serve scores, which must know what nobody annotated.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::EpisodeError;
use super::meta::{FORMAT_VERSION, check_version};
use crate::object::Kind;

/// Where an imported episode comes from, how each of its parts was obtained, and what is annotated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogFacts {
    /// `nuscenes`, `kitti`, `av2` or `ros2`.
    pub format: String,
    /// The drive's name in the log: a scene, a sequence, a bag.
    pub drive: String,
    /// How speed, steering, ground, rings and so on were obtained, one sentence each.
    #[serde(default)]
    pub methods: BTreeMap<String, String>,
    /// The log's own names of its samples (nuScenes' tokens, numbers of frames) by their times in nanoseconds, where it has any.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sample_names: BTreeMap<String, String>,
    /// SHA-256 of the first sample's points as the log has them, by which two logs are told apart whose stamps are made up; empty in
    /// episodes of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub first_cloud_sha256: String,
    /// What the log annotates; `None` if nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labelled: Option<Labelled>,
}

/// What a log annotates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Labelled {
    pub kinds: Vec<Kind>,
    /// The log's own names of what it annotates.
    #[serde(default)]
    pub categories: Vec<String>,
    /// Distance from the ego's origin, on the ground, to which objects are annotated; `None` without limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_range_m: Option<f64>,
    /// Whether only objects in the front camera's picture are annotated.
    #[serde(default)]
    pub in_camera_view: bool,
    /// Sizes that boxes of the annotated kinds can have.
    #[serde(default)]
    pub sizes: BTreeMap<Kind, SizeRange>,
}

/// Least and largest size of a kind's boxes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeRange {
    pub length_m: [f64; 2],
    pub width_m: [f64; 2],
    pub height_m: [f64; 2],
}

impl LogFacts {
    /// What was left out of a drive as unreadable is told under this name among the methods.
    pub const LEFT_OUT: &str = "left_out";

    /// The log's own name of the sample at a time.
    #[must_use]
    pub fn sample_name(&self, time_ns: u64) -> Option<&str> {
        self.sample_names.get(&time_ns.to_string()).map(String::as_str)
    }

    pub(super) const RECORD: &'static str = "log";

    /// The metadata record: the format's version and the facts as TOML.
    pub(super) fn to_record(&self) -> BTreeMap<String, String> {
        let facts = toml::to_string(self).expect("the facts of a log have a TOML form");
        [("format_version", FORMAT_VERSION.to_string()), ("facts_toml", facts)]
            .map(|(key, value)| (key.to_owned(), value))
            .into()
    }

    /// The facts in a metadata record; `None` if the episode has no such record.
    pub(super) fn from_record(
        record: &BTreeMap<String, String>,
        path: &Path,
    ) -> Result<Option<Self>, EpisodeError> {
        if record.is_empty() {
            return Ok(None);
        }
        let fail = |key| EpisodeError::Metadata { record: Self::RECORD, key, path: path.to_owned() };
        check_version(record, Self::RECORD, path)?;
        let facts = record.get("facts_toml").and_then(|text| toml::from_str(text).ok());
        facts.map(Some).ok_or_else(|| fail("facts_toml"))
    }
}
