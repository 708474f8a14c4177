//! URLs among the flags: which take them, and that none holds a credential.

use std::any::TypeId;
use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};

use crate::store::{self, Location, StoreError};

/// What takes URLs.
const WHERE: &str = "URLs are taken as data set by gen --out, import --out, label, merge, info, view, doctor, train, predict and \
                     eval; as run by train --out, predict and eval; and as output by predict --out, eval --out and merge --out";

/// Refuses words that hold credentials, so that nobody quotes them.
pub fn refuse_credentials(words: &[OsString]) -> Result<(), StoreError> {
    words.iter().filter_map(|word| word.to_str()).try_for_each(|word| {
        let value = match word.split_once('=') {
            Some((flag, value)) if flag.starts_with("--") => value,
            _ => word,
        };
        store::refuse_credentials(value)
    })
}

/// Has flags that take a path and no URL say so, and take `file://`.
pub fn refuse_elsewhere(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| {
        if arg.get_value_parser().type_id() == TypeId::of::<PathBuf>() {
            arg.value_parser(PathBufValueParser::new().try_map(local))
        } else {
            arg
        }
    });
    command.mut_subcommands(refuse_elsewhere)
}

fn local(path: PathBuf) -> Result<PathBuf, String> {
    match path.to_str().filter(|text| store::is_url(text)) {
        None => Ok(path),
        Some(text) => match text.parse() {
            Ok(Location::Local(path)) => Ok(path),
            Ok(Location::Remote(_)) => Err(format!("a path of this machine is needed here; {WHERE}")),
            Err(error) => Err(error.to_string()),
        },
    }
}

/// Whether a library that speaks to servers writes these lines: they may hold signed addresses and headers.
pub fn logs_credentials(target: &str) -> bool {
    const OF: [&str; 10] = [
        "object_store",
        "reqwest",
        "hyper",
        "hyper_util",
        "hyper_rustls",
        "h2",
        "rustls",
        "tower",
        "tokio",
        "mio",
    ];
    let first = target.split("::").next().unwrap_or_default();
    OF.contains(&first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_of_paths_refuses_a_url_and_says_which_take_one() {
        let told = local("s3://bucket/data".into()).unwrap_err();
        assert!(told.contains("a path of this machine") && told.contains("train --out"), "{told}");
        assert_eq!(local("file:///data".into()), Ok("/data".into()));
        assert_eq!(local("data/x".into()), Ok("data/x".into()));
    }

    #[test]
    fn a_credential_in_any_word_is_refused() {
        for word in ["s3://id:hush@bucket/x", "--out=s3://id:hush@bucket/x"] {
            let told = refuse_credentials(&["eval".into(), word.into()]).unwrap_err().to_string();
            assert!(!told.contains("hush"), "{told}");
        }
    }
}
