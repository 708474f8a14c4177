//! What a config's keys are, as its doc comments say: for `harmzone config` and for the docs.

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::bounds::join;
use super::{Bounds, ConfigPart, Lines, Rule, with_overrides};

/// One key of a config.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConfigKey {
    /// With dots between tables, as `--set` takes it.
    pub key: String,
    /// What the key is.
    pub doc: String,
    /// The default; none where the key is not set.
    pub default: Option<Value>,
    /// What is valid, in words.
    pub valid: String,
    /// Whether it holds further keys.
    pub is_table: bool,
}

/// All keys of a config, tables before what they hold.
#[must_use]
pub fn entries<T: Bounds + Default + DeserializeOwned>() -> Vec<ConfigKey> {
    let default = T::default();
    let table = Table::try_from(&default).expect("a config always has a TOML form");
    let mut found = Vec::new();
    collect(T::PART, &table, "", &mut found);
    for entry in found.iter_mut().filter(|entry| entry.default.is_none() && !entry.is_table) {
        entry.default = left_out(&default, &table, &entry.key);
    }
    for entry in found.iter_mut().filter(|entry| entry.valid.is_empty()) {
        entry.valid = match &entry.default {
            Some(Value::Boolean(_)) => "true or false".to_owned(),
            Some(Value::String(_)) => names_of(&default, &entry.key).unwrap_or_else(|| "text".to_owned()),
            Some(Value::Array(_)) => "a list".to_owned(),
            Some(Value::Table(_)) => "a table".to_owned(),
            None => names_of(&default, &entry.key).unwrap_or_else(|| "nothing, or a value".to_owned()),
            Some(_) => "a value".to_owned(),
        };
    }
    found
}

/// The default of a key that a config leaves out where it is off: the value that changes nothing when it is given. None where each
/// does, since the key is not set.
fn left_out<T: DeserializeOwned + Serialize>(config: &T, table: &Table, key: &str) -> Option<Value> {
    let off = [Value::Float(0.0), Value::Integer(0), Value::Boolean(false), Value::Array(Vec::new())];
    off.into_iter().find(|value| {
        let given = with_overrides(config, &[format!("{key}={value}")]);
        given.is_ok_and(|given| Table::try_from(&given).is_ok_and(|given| given == *table))
    })
}

/// The names that a key takes, as the error says that a name that nobody gives brings.
fn names_of<T: DeserializeOwned + Serialize>(config: &T, key: &str) -> Option<String> {
    let error = with_overrides(config, &[format!("{key}=\"no such name\"")]).err()?.to_string();
    let (_, expected) = error.split_once("expected ")?;
    expected.contains('`').then(|| expected.trim_start_matches("one of ").to_owned())
}

fn collect(part: ConfigPart, table: &Table, path: &str, into: &mut Vec<ConfigKey>) {
    let of_docs = part.docs.iter().map(|(name, _)| *name);
    let undocumented = table.keys().map(String::as_str).filter(|name| part.doc(name).is_none());
    let names: Vec<&str> = of_docs.chain(undocumented).collect();
    let rule_of = |name: &str| part.keys.iter().find(|(known, _)| *known == name).map(|(_, rule)| *rule);
    // Others, of names that are free, are written on one line.
    let is_table = |name: &str| match rule_of(name) {
        // One that is left out where it is off has its keys nevertheless.
        Some(Rule::Part(_)) => table.get(name).is_none_or(Value::is_table),
        Some(Rule::Parts(_)) => table.get(name).is_some_and(Value::is_table),
        _ => false,
    };
    // As in a file, where a table ends what is above it.
    let (inner, own): (Vec<&str>, Vec<&str>) = names.into_iter().partition(|name| is_table(name));
    for name in own.into_iter().chain(inner) {
        let rule = rule_of(name);
        let (key, value) = (join(path, name), table.get(name));
        let of_key = part.doc(name).map(text).unwrap_or_default();
        let doc = match rule {
            Some(Rule::Part(inner)) if of_key.is_empty() => text(inner.about),
            _ => of_key,
        };
        let valid = rule.map(Rule::valid).unwrap_or_default();
        into.push(ConfigKey {
            key: key.clone(),
            doc,
            default: value.cloned(),
            valid,
            is_table: is_table(name),
        });
        match (rule, value) {
            (Some(Rule::Part(inner)), Some(Value::Table(table))) => collect(inner, table, &key, into),
            (Some(Rule::Part(inner)), None) => collect(inner, &Table::new(), &key, into),
            (Some(Rule::Parts(inner)), Some(Value::Table(tables))) => {
                for (name, value) in tables {
                    let key = join(&key, name);
                    let Value::Table(table) = value else { continue };
                    let (doc, valid, default) =
                        (text(inner.about), "a table".to_owned(), Some(value.clone()));
                    into.push(ConfigKey { key: key.clone(), doc, default, valid, is_table: true });
                    collect(inner, table, &key, into);
                }
            }
            _ => {}
        }
    }
}

impl ConfigPart {
    /// The doc comment of a key.
    fn doc(&self, name: &str) -> Option<Lines> {
        self.docs.iter().find(|(known, _)| *known == name).map(|(_, lines)| *lines)
    }
}

/// A doc comment as running text, without the brackets of its links.
fn text(lines: Lines) -> String {
    let joined = lines.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ");
    joined.replace("[`", "`").replace("`]", "`")
}

/// The config as TOML, each key under what its doc comment says.
#[must_use]
pub fn commented_toml<T: Bounds + Default + DeserializeOwned>(config: &T) -> String {
    let table = Table::try_from(config).expect("a config always has a TOML form");
    let mut found = Vec::new();
    collect(T::PART, &table, "", &mut found);
    let mut out = String::new();
    for ConfigKey { key, doc, default: value, is_table, .. } in found {
        let Some(value) = value else { continue };
        if is_table {
            // A table of tables alone has no line of its own.
            let holds_values = value
                .as_table()
                .is_some_and(|table| table.is_empty() || table.values().any(|value| !value.is_table()));
            if !holds_values {
                continue;
            }
            out += "\n";
        }
        out += &comment(&doc);
        let name = key.rsplit('.').next().unwrap_or(&key);
        out += &if is_table { format!("[{key}]\n") } else { format!("{name} = {value}\n") };
    }
    out.trim_start().to_owned()
}

/// Text as comment lines of at most 100 characters.
fn comment(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("there is always a line");
        if !line.is_empty() && line.chars().count() + word.chars().count() > 97 {
            lines.push(word.to_owned());
        } else {
            line.push_str(if line.is_empty() { "" } else { " " });
            line.push_str(word);
        }
    }
    lines.iter().filter(|line| !line.is_empty()).fold(String::new(), |all, line| all + "# " + line + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{define_config, from_to, part};

    define_config! {
        /// Inner things.
        pub struct Inner {
            /// How many, see [`Inner`].
            count: u32 = 2, in from_to(0.0, 9.0);
        }
    }

    define_config! {
        /// All of it.
        pub struct Outer {
            inner: Inner = Inner::default(), in part::<Inner>();
            /// A word
            /// on two lines.
            word: String = "a".into();
            #[serde(skip_serializing_if = "is_off")]
            hidden: Inner = Inner { count: 0 }, in part::<Inner>();
            #[serde(skip_serializing_if = "Option::is_none")]
            asked: Option<u32> = None, in from_to(0.0, 9.0);
        }
    }

    fn is_off(inner: &Inner) -> bool {
        inner.count == 0
    }

    #[test]
    fn keys_come_with_their_doc_comments_defaults_and_bounds() {
        let found = entries::<Outer>();
        let told: Vec<_> = found.iter().map(|entry| (&*entry.key, &*entry.doc, &*entry.valid)).collect();
        let expected = [
            ("word", "A word on two lines.", "text"),
            ("asked", "", "a number from 0 to 9"),
            ("inner", "Inner things.", "a table"),
            ("inner.count", "How many, see `Inner`.", "a number from 0 to 9"),
            ("hidden", "Inner things.", "a table"),
            ("hidden.count", "How many, see `Inner`.", "a number from 0 to 9"),
        ];
        assert_eq!(told, expected);
        // Left out where it is 0; and what is not set.
        let defaults = [3, 5, 1].map(|i: usize| found[i].default.clone());
        assert_eq!(defaults, [Some(Value::Integer(2)), Some(Value::Integer(0)), None]);
    }

    #[test]
    fn the_commented_file_is_the_config() {
        let config =
            Outer { word: "b".into(), inner: Inner { count: 5 }, hidden: Inner { count: 0 }, asked: None };
        let text = commented_toml(&config);
        assert_eq!(toml::from_str::<Outer>(&text).unwrap(), config);
        assert_eq!(
            text,
            "# A word on two lines.\nword = \"b\"\n\n# Inner things.\n[inner]\n# How many, see `Inner`.\ncount = 5\n"
        );
    }
}
