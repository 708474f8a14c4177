//! Names of files that a table, a manifest or a model holds: they stay inside the folder that they are names in.
//!
//! Only the name is looked at. A symbolic link inside the folder is the user's own, and may lead anywhere.

use std::path::{Component, Path, PathBuf};

use thiserror::Error;

/// A name that leads out of its folder, or nowhere.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the name `{name}` leads out of its folder; a relative path without `..` is valid")]
pub struct OutsideName {
    name: String,
}

/// Whether a name is that of a file in a folder or in one below it: relative, not empty, and without `.` at its beginning and `..`
/// anywhere.
#[must_use]
pub fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

/// Whether a text is the name of a file in a folder, and no way to another one.
#[must_use]
pub fn is_file_name(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    let first = parts.next();
    parts.next().is_none() && first == Some(Component::Normal(name.as_ref()))
}

/// Where a file lies that is named in a folder; `./` before the name is left out.
///
/// # Errors
/// The name leads out of the folder: it is absolute, has `..` in it or is empty.
pub fn inside(folder: &Path, name: &str) -> Result<PathBuf, OutsideName> {
    let short = name.trim_start_matches("./");
    if is_inside(short) { Ok(folder.join(short)) } else { Err(OutsideName { name: name.to_owned() }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_inside_a_folder_are_taken_and_others_are_refused() {
        let folder = Path::new("/data/set");
        for (name, wanted) in
            [("a.mcap", "a.mcap"), ("samples/CAM/..a.jpg", "samples/CAM/..a.jpg"), ("./a/./b", "a/./b")]
        {
            assert_eq!(inside(folder, name).unwrap(), folder.join(wanted));
        }
        for name in ["", ".", "./", "..", "../a", "a/../../b", "a/..", "/etc/passwd", ".//etc/passwd"] {
            let told = inside(folder, name).unwrap_err().to_string();
            assert!(told.contains(&format!("`{name}`")) && told.contains("without `..`"), "{told}");
        }
        assert!(!is_inside("./a") && is_inside("a/b"));
    }
}
