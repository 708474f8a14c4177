//! Where scores come from: the command, the network and the data, as `source.json` keeps them.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::standing::Standing;
use crate::dataset::Fingerprint;
use crate::episode::Split;

/// Where scores come from.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Provenance {
    /// Version of harmzone.
    pub version: String,
    /// As it was typed.
    pub command: String,
    /// The data set, as it was named.
    pub data: Option<PathBuf>,
    pub labels: Option<String>,
    /// The split that was scored, and the data set's version.
    pub split: Option<Split>,
    pub data_version: Option<u32>,
    /// Hash of the data set and its labels.
    pub fingerprint: Option<Fingerprint>,
    /// Hash of the network's file.
    pub checkpoint_sha256: Option<String>,
    /// The resolved config of the detector.
    pub model_toml: Option<String>,
    /// The resolved config of its training.
    pub train_toml: Option<String>,
}

impl Provenance {
    /// What the scores may be used for; `None` where they are of no data set.
    #[must_use]
    pub fn standing(&self) -> Option<Standing> {
        let of_data =
            |_: &PathBuf| Standing { split: self.split, data_version: self.data_version.unwrap_or(1) };
        self.data.as_ref().map(of_data)
    }
}

/// Words of a command, with quotes where a shell needs them.
#[must_use]
pub fn quote(words: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    // `shlex` also quotes `=`, `,` and `%`, which mean nothing inside a word: `key=value` reads better bare.
    let is_bare = |c: char| c.is_ascii_alphanumeric() || "_-./=:,+@%".contains(c);
    let quoted = words.into_iter().map(|word| match word.as_ref() {
        word if !word.is_empty() && word.chars().all(is_bare) => word.to_owned(),
        word => shlex::Quoter::new().allow_nul(true).quote(word).expect("NUL is allowed").into_owned(),
    });
    quoted.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_quoted_where_a_shell_needs_it() {
        let words = ["harmzone", "eval", "a b", "it's", "--set", "max_range_m=30", "dist_m=[1, 2]", ""];
        assert_eq!(quote(words), r#"harmzone eval 'a b' "it's" --set max_range_m=30 'dist_m=[1, 2]' ''"#);
    }
}
