//! `models.toml` beside the meshes: what the files do not say of themselves.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::config::{Check, Checked, InvalidConfig, SHARE, define_config, from_to, with_table};

/// The file's name.
pub(super) const FILE: &str = "models.toml";

/// The axis of a file that points upwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UpAxis {
    X,
    Y,
    Z,
}

/// A file's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthUnit {
    #[serde(rename = "m")]
    Metre,
    #[serde(rename = "cm")]
    Centimetre,
    #[serde(rename = "mm")]
    Millimetre,
    #[serde(rename = "in")]
    Inch,
}

impl LengthUnit {
    pub(super) const ALL: [Self; 4] = [Self::Metre, Self::Centimetre, Self::Millimetre, Self::Inch];

    pub(super) fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
            Self::Inch => 0.0254,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Inch => "in",
        }
    }
}

define_config! {
    /// What is said of one mesh; what is not said is guessed, and told.
    pub struct Settings {
        /// Its kind, as in `category` of the truth [the file's name].
        category: Option<String> = None;
        unit: Option<LengthUnit> = None;
        up: Option<UpAxis> = None;
        /// Turns it about the vertical, so that its front points along x, degrees.
        yaw_deg: f64 = 0.0, in from_to(-360.0, 360.0);
        /// Its longest side, metres, whatever the file's unit.
        longest_m: Option<f64> = None, in from_to(0.05, 12.0);
        mass_kg: Option<f64> = None, in from_to(0.01, 20_000.0);
        /// Share of LiDAR light sent back at right angles.
        reflectivity: f64 = 0.4, in SHARE;
        /// More triangles than these are reduced.
        max_triangles: u32 = 3000, in from_to(50.0, 50_000.0);
    }
}

impl Check for Settings {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
        match &self.category {
            Some(name) if name.is_empty() || !name.chars().all(is_word) => {
                let wanted = "letters, digits, `_` and `-` are needed";
                Err(InvalidConfig::new("category", format!("{name:?}"), wanted))
            }
            _ => Ok(()),
        }
    }
}

/// Why `models.toml` cannot be used.
#[derive(Debug, Error)]
#[error("{message}: {}", path.display())]
pub struct SettingsError {
    pub message: String,
    pub path: PathBuf,
}

/// The settings of a folder's meshes.
#[derive(Debug, Clone, Default)]
pub struct SettingsFile {
    defaults: Settings,
    of_model: BTreeMap<String, Settings>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct File {
    defaults: toml::Table,
    models: BTreeMap<String, toml::Table>,
}

impl SettingsFile {
    /// Reads the file of a folder, which may be missing.
    ///
    /// # Errors
    /// [`SettingsError`]: no TOML, an unknown key, or a value out of its range.
    pub fn read(folder: &Path) -> Result<Self, SettingsError> {
        let path = folder.join(FILE);
        if !path.is_file() {
            return Ok(Self::default());
        }
        let fail = |message: String| SettingsError { message, path: path.clone() };
        let text = fs::read_to_string(&path).map_err(|error| fail(error.to_string()))?;
        let file: File = toml::from_str(&text).map_err(|error| fail(error.to_string()))?;
        let checked = |base: &Settings, over: &toml::Table, part: &str| {
            let laid = with_table(base, over).map_err(|error| fail(format!("[{part}] {error}")))?;
            let checked = Checked::new(laid).map_err(|error| fail(format!("[{part}] {error}")))?;
            Ok((*checked).clone())
        };
        let defaults = checked(&Settings::default(), &file.defaults, "defaults")?;
        let of_model = file
            .models
            .iter()
            .map(|(stem, over)| Ok((stem.clone(), checked(&defaults, over, &format!("models.{stem}"))?)))
            .collect::<Result<_, _>>()?;
        Ok(Self { defaults, of_model })
    }

    /// What holds for a mesh, by its file's name without its end.
    #[must_use]
    pub fn of(&self, stem: &str) -> &Settings {
        self.of_model.get(stem).unwrap_or(&self.defaults)
    }

    /// The names that it says something of.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.of_model.keys().map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<SettingsFile, String> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(FILE), text).unwrap();
        SettingsFile::read(folder.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn what_is_said_of_a_mesh_lies_over_the_defaults() {
        let file = read("[defaults]\nunit = \"cm\"\n[models.chair]\nup = \"y\"\nmass_kg = 4\n").unwrap();
        assert_eq!(
            (file.of("chair").unit, file.of("table").unit),
            (Some(LengthUnit::Centimetre), Some(LengthUnit::Centimetre))
        );
        assert_eq!((file.of("chair").mass_kg, file.of("table").mass_kg), (Some(4.0), None));
        assert_eq!(file.names().collect::<Vec<_>>(), ["chair"]);
        crate::config::assert_every_number_is_checked(&Settings {
            longest_m: Some(1.0),
            mass_kg: Some(1.0),
            ..Settings::default()
        });
    }

    #[test]
    fn unknown_keys_and_values_out_of_range_are_told() {
        for (text, wanted) in [
            ("[models.chair]\nheight = 3\n", "unknown field `height`"),
            ("[default]\nunit = \"m\"\n", "unknown field `default`"),
            ("[models.chair]\nunit = \"ft\"\n", "unknown variant `ft`"),
            ("[models.chair]\nlongest_m = 40\n", "[models.chair] longest_m is 40"),
            (
                "[models.cat]\ncategory = \"Tom & Jerry\"\n",
                "[models.cat] category is \"Tom & Jerry\"; letters, digits",
            ),
            ("[defaults]\ncategory = \"\"\n", "[defaults] category is \"\"; letters, digits"),
        ] {
            let told = read(text).unwrap_err();
            assert!(told.contains(wanted) && told.contains("models.toml"), "{told}");
        }
    }
}
