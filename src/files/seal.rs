//! JSON files that end with a hash of themselves, so that no other content passes for what was written.
//!
//! The last key is `sha256`: the SHA-256 of the text without that key and the comma before it. Before it stands
//! `format_version`, but in manifests, which begin with one of their own.

use std::io;
use std::path::Path;

use fs_err as fs;
use serde::Serialize;

use super::{sha256_hex, write_atomic};

const BEGIN: &str = ",\n  \"sha256\": \"";
const END: &str = "\"\n}\n";
const N_DIGITS: usize = 64;
const VERSION_BEGIN: &str = ",\n  \"format_version\": ";

/// The format version of scores, boxes, drives and states; files of before there was one have none and are read, too.
pub const RESULT_VERSION: u32 = 1;

/// The text of a JSON object with its hash.
///
/// # Panics
/// The text is no JSON object.
#[must_use]
pub fn seal(json: &str) -> String {
    let body = json.trim_end().strip_suffix('}').expect("a JSON object").trim_end();
    format!("{body}{BEGIN}{}{END}", sha256_hex(plain(body).as_bytes()))
}

/// The text of a JSON object with its format version and its hash.
///
/// # Panics
/// The text is no JSON object.
#[must_use]
pub fn seal_result(json: &str) -> String {
    let body = json.trim_end().strip_suffix('}').expect("a JSON object").trim_end();
    seal(&plain(&format!("{body}{VERSION_BEGIN}{RESULT_VERSION}")))
}

fn plain(body: &str) -> String {
    format!("{body}\n}}\n")
}

/// The JSON object without its hash and the version before that, which are checked; a text without them stays as it is.
///
/// # Errors
/// The hash is another, or the version is none that is read: what is found, in words.
pub fn unseal(text: &str) -> Result<String, String> {
    let json = without_hash(text)?;
    match json.strip_suffix("\n}\n").and_then(|body| body.rsplit_once(VERSION_BEGIN)) {
        Some((body, found)) if found == RESULT_VERSION.to_string() => Ok(plain(body)),
        Some((_, found)) if found.bytes().all(|byte| byte.is_ascii_digit()) => Err(format!(
            "it is of format version {found}; this version reads {RESULT_VERSION}, and files without a version"
        )),
        _ => Ok(json),
    }
}

fn without_hash(text: &str) -> Result<String, String> {
    let Some(before) = text.strip_suffix(END) else { return Ok(text.to_owned()) };
    let Some(at) = before.len().checked_sub(N_DIGITS).filter(|&at| before.is_char_boundary(at)) else {
        return Ok(text.to_owned());
    };
    let (body, found) = before.split_at(at);
    let Some(body) = body.strip_suffix(BEGIN) else { return Ok(text.to_owned()) };
    let json = plain(body);
    let wanted = sha256_hex(json.as_bytes());
    if found == wanted {
        return Ok(json);
    }
    Err(format!("its content was changed: the hash of what it holds is {wanted}, and it says {found}"))
}

/// Whether a text ends with a hash.
#[must_use]
pub fn is_sealed(text: &str) -> bool {
    text.strip_suffix(END)
        .and_then(|before| before.get(..before.len().checked_sub(N_DIGITS)?))
        .is_some_and(|body| body.ends_with(BEGIN))
}

/// Writes a value that begins with a format version as a sealed file, whole or not at all.
///
/// # Errors
/// The value has no JSON form, or the disk fails.
pub fn write_manifest(path: &Path, value: &impl Serialize) -> io::Result<()> {
    write_atomic(path, seal(&serde_json::to_string_pretty(value)?).as_bytes())
}

/// Writes a value as a sealed file with its format version, whole or not at all.
///
/// # Errors
/// The value has no JSON form, or the disk fails.
pub fn write_sealed(path: &Path, value: &impl Serialize) -> io::Result<()> {
    write_atomic(path, seal_result(&serde_json::to_string_pretty(value)?).as_bytes())
}

/// Reads the JSON of a sealed file, or of one without a hash.
///
/// # Errors
/// It cannot be read, its hash is another, or its version is none that is read (`InvalidData`); errors name the path.
pub fn read_sealed(path: &Path) -> io::Result<String> {
    let text = fs::read_to_string(path)?;
    unseal(&text).map_err(|message| {
        io::Error::new(
            io::ErrorKind::InvalidData,
            format!("{message}; make the file again: {}", path.display()),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sealed_text_is_json_and_gives_back_what_was_sealed() {
        let json = serde_json::to_string_pretty(&serde_json::json!({ "name": "a\"b", "n": [1, 2] })).unwrap();
        let sealed = seal(&json);
        assert_eq!(unseal(&sealed).unwrap(), json.clone() + "\n");
        assert!(is_sealed(&sealed) && !is_sealed(&json));
        let value: serde_json::Value = serde_json::from_str(&sealed).unwrap();
        assert_eq!(value["sha256"].as_str().unwrap().len(), 64);
        assert_eq!(unseal("{}").unwrap(), "{}");
        assert_eq!(unseal(&seal("{\"n\":[1,2]}")).unwrap(), "{\"n\":[1,2]\n}\n");
    }

    #[test]
    fn a_result_tells_its_version_and_another_one_is_refused_with_what_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.json");
        let value = serde_json::json!({ "name": "town", "last": { "format_version": 7 } });
        write_sealed(&path, &value).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let whole: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(whole["format_version"], RESULT_VERSION);
        let read = || read_sealed(&path);
        assert_eq!(serde_json::from_str::<serde_json::Value>(&read().unwrap()).unwrap(), value);
        // Without a version, as files were before, and of a manifest, which begins with one.
        let plain = serde_json::to_string_pretty(&value).unwrap();
        fs::write(&path, seal(&plain)).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&read().unwrap()).unwrap(), value);
        let manifest = "{\n  \"format_version\": 3,\n  \"n\": 1\n}\n";
        assert_eq!(unseal(&seal(manifest)).unwrap(), manifest);
        // A newer one, with its hash and without.
        let newer = without_hash(&text).unwrap().replace("\"format_version\": 1", "\"format_version\": 2");
        for text in [seal(&newer), newer] {
            fs::write(&path, text).unwrap();
            let told = read().unwrap_err().to_string();
            assert!(told.contains("format version 2") && told.contains("reads 1"), "{told}");
            assert!(told.ends_with("drive.json"), "{told}");
        }
    }

    #[test]
    fn every_changed_bit_is_found_or_leaves_the_data_as_it_was() {
        let value = serde_json::json!({ "format_version": 3, "name": "town", "seeds": [12, 13] });
        let sealed = seal(&serde_json::to_string_pretty(&value).unwrap());
        for bit in 0..sealed.len() * 8 {
            let mut bytes = sealed.clone().into_bytes();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let Ok(text) = String::from_utf8(bytes) else { continue };
            let Ok(json) = unseal(&text) else { continue };
            let Ok(mut read) = serde_json::from_str::<serde_json::Value>(&json) else { continue };
            // The seal itself was hit: its key is another, which readers refuse or pass over.
            let unknown: Vec<String> = read.as_object().unwrap().keys().cloned().collect();
            unknown.iter().filter(|key| value.get(key).is_none()).for_each(|key| {
                read.as_object_mut().unwrap().remove(key);
            });
            assert_eq!(read, value, "bit {bit}");
        }
    }
}
