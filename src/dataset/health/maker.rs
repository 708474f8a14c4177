//! Who made a data set, by its config: `gen.toml` of `gen`, `import.toml` of `import`; and what its episodes must be then.

use std::collections::BTreeMap;
use std::io::{self, Read as _};
use std::path::Path;

use super::check::{Aspect, Found, Remark};
use crate::episode::{EpisodeMeta, Manifest, Split};
use crate::files::sha256_hex;
use crate::generate::{CheckedConfig, GenerateConfig, plan};
use crate::scene::map_hashes;
use crate::store;

/// The configs that a data set's folder may hold, beside its manifest.
const GEN_FILE: &str = "gen.toml";
const IMPORT_FILE: &str = "import.toml";

/// A folder that the data sets of recorded drives have, whose config is the drives' and lies elsewhere.
const OF_DRIVES: &str = "outcomes";

/// Keys in which the config in an episode has the names that `all` stands for.
const EXPANDED_KEYS: [&str; 2] = ["towns", "weathers"];

/// The config of a data set's folder.
pub(super) struct ConfigFile {
    pub name: &'static str,
    pub toml: String,
    pub sha256: String,
}

impl ConfigFile {
    /// The one that is there; `None` in data sets by others.
    ///
    /// # Errors
    /// It cannot be read, or is no file.
    pub(super) fn find(path: &Path) -> io::Result<Option<Self>> {
        for name in [GEN_FILE, IMPORT_FILE] {
            match read(&path.join(name)) {
                Ok(bytes) => {
                    let (toml, sha256) = (String::from_utf8_lossy(&bytes).into_owned(), sha256_hex(&bytes));
                    return Ok(Some(Self { name, toml, sha256 }));
                }
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    /// The name that the config in an episode has in a data set's folder.
    pub(super) fn name_for(meta: &EpisodeMeta) -> &'static str {
        if toml::from_str::<GenerateConfig>(&meta.config_toml).is_ok() { GEN_FILE } else { IMPORT_FILE }
    }

    /// The text of the file with this hash, as far as an episode tells it: the config in its metadata, after which `gen` names the
    /// hashes of a user's maps. `None` where it is another, or where the maps are not what they were.
    pub(super) fn text_for(meta: &EpisodeMeta, sha256: &str) -> Option<String> {
        let toml = &meta.config_toml;
        let with_maps = || {
            let towns = toml::from_str::<GenerateConfig>(toml).ok()?.towns;
            Some(toml.clone() + &map_hashes(towns.iter()).ok()?)
        };
        let is_it = |text: &String| sha256_hex(text.as_bytes()) == sha256;
        Some(toml.clone()).filter(is_it).or_else(|| with_maps().filter(is_it))
    }
}

/// Whether the config in an episode is one of `gen`, which writes every key.
pub(super) fn is_of_gen(config_toml: &str) -> bool {
    let has_towns = config_toml.parse::<toml::Table>().is_ok_and(|table| table.contains_key("towns"));
    has_towns && toml::from_str::<GenerateConfig>(config_toml).is_ok()
}

fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    store::open_file(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Who made a data set, and how.
pub(super) enum Maker {
    Gen {
        config: Box<GenerateConfig>,
        /// The config without the keys that episodes have in another form.
        table: toml::Table,
    },
    Import {
        toml: String,
    },
    /// Somebody else, or its config is not the manifest's.
    Unknown,
}

impl Maker {
    /// By the config in the folder, if it is the one with this hash.
    pub(super) fn of(config: Option<&ConfigFile>, config_sha256: &str) -> Self {
        match config.filter(|config| config.sha256 == config_sha256) {
            None => Self::Unknown,
            Some(config) if config.name == IMPORT_FILE => Self::Import { toml: config.toml.clone() },
            // A config of another version may have keys that are gone.
            Some(config) => match (toml::from_str::<GenerateConfig>(&config.toml), table_of(&config.toml)) {
                (Ok(parsed), Some(table)) => Self::Gen { config: Box::new(parsed), table },
                _ => Self::Unknown,
            },
        }
    }

    /// The config of `gen`.
    pub(super) fn gen_config(&self) -> Option<&GenerateConfig> {
        match self {
            Self::Gen { config, .. } => Some(config),
            Self::Import { .. } | Self::Unknown => None,
        }
    }

    /// Whether its config is there, so that this program wrote the episodes.
    pub(super) fn is_known(&self) -> bool {
        !matches!(self, Self::Unknown)
    }

    /// Whether an episode was made by this config; who made others is not known.
    pub(super) fn has_made(&self, meta: &EpisodeMeta) -> bool {
        match self {
            Self::Gen { table, .. } => table_of(&meta.config_toml).as_ref() == Some(table),
            Self::Import { toml } => *toml == meta.config_toml,
            Self::Unknown => true,
        }
    }

    /// Place and split of `gen`'s first episodes by their names; empty where nobody planned any.
    pub(super) fn plans(&self, n_episodes: u32) -> Plans {
        let checked = self.gen_config().and_then(|config| CheckedConfig::try_from(config).ok());
        let planned = checked.map(|checked| plan(&checked, n_episodes)).unwrap_or_default();
        planned.into_iter().enumerate().map(|(place, plan)| (plan.name, (place, plan.split))).collect()
    }
}

/// The place and the split of each planned episode by its name.
pub(super) type Plans = BTreeMap<String, (usize, Split)>;

fn table_of(toml: &str) -> Option<toml::Table> {
    let mut table: toml::Table = toml.parse().ok()?;
    for key in EXPANDED_KEYS {
        table.remove(key);
    }
    Some(table)
}

/// Sets the folder's config beside the manifest. `in_episodes`: the hash of the config in each episode that could be opened;
/// `is_of_gen`: whether one of them is of `gen`.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn examine(
    path: &Path,
    manifest: &Manifest,
    config: Option<&ConfigFile>,
    (in_episodes, is_of_gen): (&[String], bool),
    found: &mut Found,
) -> io::Result<String> {
    let wanted = &manifest.config_sha256;
    // The manifest of a set of a user's maps has another hash than its episodes.
    let is_lost = config.is_none()
        && (in_episodes.contains(wanted)
            || is_of_gen && store::files_below(&path.join(OF_DRIVES))?.is_empty());
    Ok(match config {
        Some(config) if config.sha256 == *wanted => {
            format!("{} is the one that dataset.json names", config.name)
        }
        Some(config) => {
            let (name, sha256, path) = (config.name, &config.sha256, path.join(config.name));
            let text = format!(
                "its hash is {sha256}, and dataset.json says {wanted}; the config that the episodes were made by belongs \
                 here: {}",
                path.display()
            );
            found.add(name, Remark::fault(Aspect::Config, "config", text));
            format!("{name} is another than dataset.json names")
        }
        None if is_lost => {
            let text = format!(
                "there is no {GEN_FILE} or {IMPORT_FILE}, and the episodes were made by one; without it nothing can be added: {}",
                path.display()
            );
            found.add(GEN_FILE, Remark::fault(Aspect::Config, "missing config", text));
            "none".to_owned()
        }
        None => "none, as in data sets by others and in recorded drives".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use rustix::fs::{CWD, Mode, mkfifoat};

    use super::*;
    use crate::config::to_toml;

    #[test]
    fn a_pipe_in_place_of_the_config_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        mkfifoat(CWD, folder.path().join(GEN_FILE), Mode::RUSR | Mode::WUSR).unwrap();
        let told = ConfigFile::find(folder.path()).err().unwrap().to_string();
        assert!(told.contains("this is no file: a pipe") && told.ends_with(GEN_FILE), "{told}");
    }

    fn of(toml: &str) -> Maker {
        let (toml, sha256) = (toml.to_owned(), sha256_hex(toml.as_bytes()));
        let config = ConfigFile { name: GEN_FILE, sha256: sha256.clone(), toml };
        Maker::of(Some(&config), &sha256)
    }

    #[test]
    fn an_episode_of_all_towns_is_of_the_config_that_says_all_and_of_no_other() {
        let asked = GenerateConfig { towns: vec!["all".into()], ..GenerateConfig::default() };
        let maker = of(&to_toml(&asked));
        let mut meta = crate::dataset::test_data::episode_meta("ClearNoon", "");
        meta.config_toml = to_toml(&GenerateConfig { towns: vec!["downtown".into()], ..asked.clone() });
        assert!(maker.has_made(&meta));
        meta.config_toml = to_toml(&GenerateConfig { samples: 7, ..asked });
        assert!(!maker.has_made(&meta));
    }

    #[test]
    fn a_plan_knows_place_and_split_of_its_episodes() {
        let plans = of(&to_toml(&GenerateConfig::default())).plans(60);
        let n_val = plans.values().filter(|(_, split)| *split == Split::Val).count();
        assert_eq!((plans.len(), n_val), (60, 10));
        assert!(of("samples = [").plans(3).is_empty());
    }
}
