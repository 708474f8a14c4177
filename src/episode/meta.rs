//! The metadata records: where an episode comes from, and which episode labels or predictions belong to.

use std::collections::BTreeMap;
use std::path::Path;

use super::error::EpisodeError;

/// Where an episode comes from: the metadata record `episode`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodeMeta {
    /// `<town>-<weather>-<seed>`, the file's stem.
    pub name: String,
    pub seed: u64,
    pub town: String,
    pub weather: String,
    /// Whether objects that no training set holds were placed.
    pub ood: bool,
    pub generator_version: String,
    /// The resolved config of the run.
    pub config_toml: String,
    /// The sensor rig.
    pub rig_toml: String,
    /// The planned number for a writer, the counted one from a reader.
    pub n_samples: usize,
    /// Categories of what stands in the world and is never annotated, separated by commas; empty where this is not known.
    pub background: String,
}

/// The version of the format that this code writes and reads.
pub const FORMAT_VERSION: u32 = 1;

type Record = BTreeMap<String, String>;

/// Refuses a record of another format version, or of none.
pub(super) fn check_version(record: &Record, name: &'static str, path: &Path) -> Result<(), EpisodeError> {
    match record.get("format_version") {
        Some(found) if *found == FORMAT_VERSION.to_string() => Ok(()),
        Some(found) => Err(EpisodeError::Version {
            record: name,
            found: found.clone(),
            wanted: FORMAT_VERSION,
            path: path.to_owned(),
        }),
        None => Err(EpisodeError::Metadata { record: name, key: "format_version", path: path.to_owned() }),
    }
}

/// Reads and writes a struct as a metadata record: each field under its name, as text.
macro_rules! record_of {
    ($name:ident { $($field:ident),* }) => {
        impl $name {
            pub(super) fn to_record(&self) -> Record {
                let version = ("format_version".to_owned(), FORMAT_VERSION.to_string());
                [version, $((stringify!($field).to_owned(), self.$field.to_string())),*].into()
            }

            pub(super) fn from_record(
                record: &Record,
                name: &'static str,
                path: &Path,
            ) -> Result<Self, EpisodeError> {
                // Older episodes do not say what is background.
                let is_absent = |key: &str| key == "background" && !record.contains_key(key);
                let fail = |key| EpisodeError::Metadata { record: name, key, path: path.to_owned() };
                check_version(record, name, path)?;
                $(
                    let text = record.get(stringify!($field)).map(String::as_str);
                    let text = text.or(is_absent(stringify!($field)).then_some(""));
                    let $field = text.and_then(|text| text.parse().ok());
                    let $field = $field.ok_or_else(|| fail(stringify!($field)))?;
                )*
                Ok(Self { $($field),* })
            }
        }
    };
}
record_of!(EpisodeMeta {
    name,
    seed,
    town,
    weather,
    ood,
    generator_version,
    config_toml,
    rig_toml,
    n_samples,
    background
});
record_of!(SourceMeta { episode, episode_sha256, set, config_toml, generator_version });

impl EpisodeMeta {
    pub(super) const RECORD: &'static str = "episode";
}

/// The source of labels or predictions, and how they were made: the metadata record `labels` or `detections`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceMeta {
    /// The episode's name.
    pub episode: String,
    /// Content hash of the episode's file.
    pub episode_sha256: String,
    /// Name of the label set or of the run.
    pub set: String,
    /// Resolved config that the file was made with.
    pub config_toml: String,
    pub generator_version: String,
}

impl SourceMeta {
    /// Refuses a file that was made from another episode.
    pub(super) fn check_episode(&self, wanted: &str, path: &Path) -> Result<(), EpisodeError> {
        if self.episode_sha256 == wanted {
            return Ok(());
        }
        let (found, wanted) = (self.episode_sha256.clone(), wanted.to_owned());
        Err(EpisodeError::OtherEpisode { found, wanted, path: path.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_a_newer_version_is_told_with_the_version_that_is_read() {
        let source = SourceMeta {
            episode: "town-ClearNoon-1".to_owned(),
            episode_sha256: "0".repeat(64),
            set: "rect".to_owned(),
            config_toml: String::new(),
            generator_version: "0.1.0".to_owned(),
        };
        let path = Path::new("labels/rect/town.mcap");
        let mut record = source.to_record();
        assert_eq!(SourceMeta::from_record(&record, "labels", path).unwrap(), source);
        record.insert("format_version".to_owned(), "2".to_owned());
        let told = SourceMeta::from_record(&record, "labels", path).unwrap_err().to_string();
        assert!(told.contains("`labels` is of format version `2`; this version reads 1"), "{told}");
        assert!(told.ends_with("town.mcap"), "{told}");
        record.remove("format_version");
        let told = SourceMeta::from_record(&record, "labels", path).unwrap_err().to_string();
        assert!(told.contains("lacks `format_version`"), "{told}");
    }
}
