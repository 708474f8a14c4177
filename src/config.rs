//! Configs: TOML text to typed values, with overrides, and errors that say file, line and key.
//!
//! Each stage has one raw struct (`#[serde(deny_unknown_fields, default)]`), checked once by the
//! stage into what it works with. Values come from, later over earlier: the struct's `Default`,
//! the TOML file, `key=value` overrides (dotted keys, TOML values).

mod bounds;
mod define;
mod did_you_mean;
mod reference;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

pub(crate) use bounds::impl_checked;
pub use bounds::{
    Bounds, Check, Checked, ConfigPart, Docs, InvalidConfig, Keys, Lines, Order, Range, Rule, SHARE, above,
    below, from_to, part, parts, require,
};
pub(crate) use define::{define_config, doc_lines};
pub use did_you_mean::{nearest, with_suggestion};
pub use reference::{ConfigKey, commented_toml, entries};

/// Why a config could not be loaded.
#[derive(Debug, Error)]
pub enum ConfigError {
    #[error("cannot read the config: {0}")]
    Read(#[source] std::io::Error),
    #[error("{message}: {}", path.display())]
    Parse { message: String, path: PathBuf },
    #[error("{invalid}: {}", path.display())]
    Invalid { invalid: InvalidConfig, path: PathBuf },
    #[error("the override `{text}` is not `key=value` with a TOML value: {message}")]
    Override { text: String, message: String },
    #[error("the overrides {overrides:?} do not fit the config: {message}")]
    OverrideValue { overrides: Vec<String>, message: String },
}

/// Loads a config: defaults, then the file if one is given, then the overrides.
///
/// # Errors
/// [`ConfigError`]: unreadable file, unknown key, value of the wrong type (with line and column),
/// malformed override.
pub fn load<T>(path: Option<&Path>, overrides: &[String]) -> Result<T, ConfigError>
where
    T: DeserializeOwned + Serialize + Default,
{
    let Some(path) = path else { return with_overrides(&T::default(), overrides) };
    let text = fs::read_to_string(path).map_err(ConfigError::Read)?;
    let config: T = toml::from_str(&text).map_err(parse_error(path))?;
    // A value that the config has room for and TOML has not, such as a seed above 2^63, could not be written again.
    text.parse::<toml::Table>().map_err(parse_error(path))?;
    with_overrides(&config, overrides)
}

/// Loads a config over another: `base`, then what the file says if one is given, then the overrides.
///
/// # Errors
/// As [`load`].
pub fn load_over<T>(base: &T, path: Option<&Path>, overrides: &[String]) -> Result<T, ConfigError>
where
    T: DeserializeOwned + Serialize,
{
    let Some(path) = path else { return with_overrides(base, overrides) };
    let text = fs::read_to_string(path).map_err(ConfigError::Read)?;
    // The file alone must be right, so that an error tells its line.
    toml::from_str::<T>(&text).map_err(parse_error(path))?;
    with_overrides(&with_table(base, &text.parse().map_err(parse_error(path))?)?, overrides)
}

/// What is wrong in a file.
fn parse_error(path: &Path) -> impl Fn(toml::de::Error) -> ConfigError {
    move |error| {
        let mut message = error.to_string();
        if error.message().contains("value was too large") {
            message = format!("{}; a number in TOML is at most {}\n", message.trim_end(), i64::MAX);
        }
        ConfigError::Parse { message: with_suggestion(message), path: path.to_owned() }
    }
}

/// The config with the keys of a table laid over it, table by table.
///
/// # Errors
/// An unknown key, or a value of the wrong type.
pub fn with_table<T>(config: &T, over: &toml::Table) -> Result<T, ConfigError>
where
    T: DeserializeOwned + Serialize,
{
    fn lay(under: &mut toml::Table, over: &toml::Table) {
        for (key, value) in over {
            match (under.get_mut(key), value) {
                (Some(toml::Value::Table(under)), toml::Value::Table(over)) => lay(under, over),
                _ => {
                    under.insert(key.clone(), value.clone());
                }
            }
        }
    }
    let mut table = toml::Table::try_from(config).expect("a config always has a TOML form");
    lay(&mut table, over);
    table.try_into().map_err(|error: toml::de::Error| ConfigError::OverrideValue {
        overrides: vec![over.to_string()],
        message: value_error(&error),
    })
}

/// What serde expects, and what of that a user may give.
const EXPECTED: [(&str, &str); 8] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    ("u64", "a whole number from 0 on"),
    ("usize", "a whole number from 0 on"),
    ("f32", "a number"),
    ("f64", "a number"),
    ("a boolean", "true or false"),
];

/// What is wrong with a value, after its key: what was found, what is valid.
fn value_error(error: &toml::de::Error) -> String {
    let (message, whole) = (error.message(), error.to_string());
    // Where there is no text, the crate tells the key in a line after the message.
    let key = whole.trim_end().rsplit_once("\nin `").and_then(|(_, key)| key.strip_suffix('`'));
    let valid = |expected: &str| EXPECTED.iter().find(|(name, _)| *name == expected).map(|(_, valid)| *valid);
    let in_words = message
        .rsplit_once("expected ")
        .and_then(|(found, expected)| Some(format!("{found}expected {}", valid(expected)?)));
    let told = with_suggestion(in_words.unwrap_or_else(|| message.to_owned()));
    match key {
        Some(key) => format!("`{key}`: {told}"),
        None => told,
    }
}

/// The config with dotted `key=value` overrides laid over it.
///
/// # Errors
/// As [`load`], for the overrides.
pub fn with_overrides<T>(config: &T, overrides: &[String]) -> Result<T, ConfigError>
where
    T: DeserializeOwned + Serialize,
{
    let mut table = toml::Table::try_from(config).expect("a config always has a TOML form");
    for text in overrides {
        let fail = |message: String| ConfigError::Override { text: text.clone(), message };
        let (key, value) = text.split_once('=').ok_or_else(|| fail("no `=`".into()))?;
        // A bare word that is no TOML value is taken as a string, so that `town=downtown` works.
        let value = format!("v = {value}")
            .parse::<toml::Table>()
            .ok()
            .and_then(|mut parsed| parsed.remove("v"))
            .unwrap_or_else(|| toml::Value::String(value.trim().to_owned()));
        let mut here = &mut table;
        let mut parts: Vec<&str> = key.trim().split('.').collect();
        let last = parts.pop().filter(|part| !part.is_empty()).ok_or_else(|| fail("no key".into()))?;
        for part in parts {
            here = here
                .entry(part)
                .or_insert_with(|| toml::Value::Table(toml::Table::new()))
                .as_table_mut()
                .ok_or_else(|| fail(format!("`{part}` is a value, not a table")))?;
        }
        here.insert(last.to_owned(), value);
    }
    table.try_into().map_err(|error: toml::de::Error| ConfigError::OverrideValue {
        overrides: overrides.to_vec(),
        message: value_error(&error),
    })
}

/// The `key=value` overrides that make `other` of `base`, in the order of their keys. A key that only `base` has is
/// left out: no override can take a key away.
#[must_use]
pub fn differences<T: Serialize>(base: &T, other: &T) -> Vec<String> {
    fn flatten(table: &toml::Table, prefix: &str, into: &mut BTreeMap<String, toml::Value>) {
        for (key, value) in table {
            match value {
                toml::Value::Table(inner) => flatten(inner, &format!("{prefix}{key}."), into),
                _ => {
                    into.insert(format!("{prefix}{key}"), value.clone());
                }
            }
        }
    }
    let [base, other] = [base, other].map(|config| {
        let mut keys = BTreeMap::new();
        let table = toml::Table::try_from(config).expect("a config always has a TOML form");
        flatten(&table, "", &mut keys);
        keys
    });
    let differs = |(key, value): &(String, toml::Value)| base.get(key) != Some(value);
    other.into_iter().filter(differs).map(|(key, value)| format!("{key}={}", word(&value))).collect()
}

/// A value as an override takes it: a string without quotes where it is a plain word.
fn word(value: &toml::Value) -> String {
    let is_plain = |text: &str| {
        text.starts_with(|c: char| c.is_ascii_alphabetic())
            && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !["true", "false", "inf", "nan"].contains(&text)
    };
    match value {
        toml::Value::String(text) if is_plain(text) => text.clone(),
        other => other.to_string(),
    }
}

/// The config as TOML text, to be saved beside what a run makes.
#[must_use]
pub fn to_toml<T: Serialize>(config: &T) -> String {
    toml::to_string_pretty(config).expect("a config always has a TOML form")
}

#[cfg(test)]
pub(crate) use bounds::tests::assert_every_number_is_checked;

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Example {
        speed_mps: f64,
        town: String,
        inner: Inner,
    }

    #[derive(Debug, PartialEq, Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Inner {
        count: u64,
    }

    impl Default for Example {
        fn default() -> Self {
            Self { speed_mps: 2.0, town: "downtown".into(), inner: Inner::default() }
        }
    }

    #[test]
    fn overrides_reach_nested_keys_and_take_bare_words() {
        let overrides = ["inner.count=3".to_owned(), "town=market".to_owned()];
        let example: Example = load(None, &overrides).unwrap();
        assert_eq!((example.inner.count, example.town.as_str()), (3, "market"));
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zone.toml");
        fs::write(&path, "speed_mps = 1.0\nsped = 2\n").unwrap();
        let message = load::<Example>(Some(&path), &[]).unwrap_err().to_string();
        assert!(
            message.contains("line 2") && message.contains("sped") && message.contains("zone.toml"),
            "{message}"
        );
    }

    #[test]
    fn a_number_above_the_largest_of_toml_is_an_error_not_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("many.toml");
        fs::write(&path, "[inner]\ncount = 9223372036854775808\n").unwrap();
        let errors = [
            load::<Example>(Some(&path), &[]).unwrap_err(),
            load_over(&Example::default(), Some(&path), &[]).unwrap_err(),
        ];
        for message in errors.map(|error| error.to_string()) {
            let parts = ["line 2", "at most 9223372036854775807", "many.toml"];
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }

    #[test]
    fn a_file_over_a_base_changes_only_what_it_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("over.toml");
        fs::write(&path, "town = \"market\"\n").unwrap();
        let base = Example { speed_mps: 7.0, town: "suburb".into(), inner: Inner { count: 4 } };
        let overrides = ["inner.count=5".to_owned()];
        let over: Example = load_over(&base, Some(&path), &overrides).unwrap();
        assert_eq!((over.speed_mps, over.town.as_str(), over.inner.count), (7.0, "market", 5));
        fs::write(&path, "\n\ntwon = 1\n").unwrap();
        let message = load_over(&base, Some(&path), &[]).unwrap_err().to_string();
        assert!(message.contains("line 3") && message.contains("over.toml"), "{message}");
    }

    #[test]
    fn differences_are_the_overrides_that_make_the_other_config() {
        let base = Example::default();
        let other = Example { speed_mps: 2.5, town: "old town".into(), inner: Inner { count: 4 } };
        let overrides = differences(&base, &other);
        assert_eq!(overrides, ["inner.count=4", "speed_mps=2.5", "town=\"old town\""]);
        assert_eq!(with_overrides(&base, &overrides).unwrap(), other);
        let word = Example { town: "market".into(), ..Example::default() };
        assert_eq!(differences(&base, &word), ["town=market"]);
        assert!(differences(&base, &base).is_empty());
    }

    #[test]
    fn a_wrong_override_is_an_error() {
        assert!(load::<Example>(None, &["speed_mps=fast".to_owned()]).is_err());
        assert!(load::<Example>(None, &["inner.cuont=1".to_owned()]).is_err());
        assert!(load::<Example>(None, &["town".to_owned()]).is_err());
    }

    #[test]
    fn an_override_of_another_kind_is_told_with_its_key_and_what_is_valid() {
        let told = |text: &str| {
            load::<Example>(None, &["town=market".to_owned(), text.to_owned()]).unwrap_err().to_string()
        };
        for (text, wanted) in [
            (
                "inner.count=-1",
                "`inner.count`: invalid value: integer `-1`, expected a whole number from 0 on",
            ),
            ("speed_mps=fast", "`speed_mps`: invalid type: string \"fast\", expected a number"),
            ("inner.cuont=1", "`inner`: unknown field `cuont`, expected `count`; did you mean `count`?"),
            (
                "towns=old",
                "unknown field `towns`, expected one of `speed_mps`, `town`, `inner`; did you mean `town`?",
            ),
        ] {
            let message = told(text);
            assert!(message.ends_with(wanted) && message.contains(text), "{message}");
        }
    }

    #[test]
    fn toml_text_round_trips() {
        let example = Example { speed_mps: 0.1, ..Example::default() };
        assert_eq!(toml::from_str::<Example>(&to_toml(&example)).unwrap(), example);
    }
}
