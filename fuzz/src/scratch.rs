//! Files for readers that take a path: in a folder of this thread, in memory if `TMPDIR` is.

use std::path::{Path, PathBuf};

use fs_err as fs;
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = tempfile::tempdir().expect("a temporary folder");
}

/// A path in the thread's folder; its parent is there.
pub fn place(name: &str) -> PathBuf {
    let path = FOLDER.with(|folder| folder.path().join(name));
    fs::create_dir_all(path.parent().expect("it lies in the folder")).expect("a folder can be made");
    path
}

/// Writes a file of the thread's folder.
pub fn write(name: &str, bytes: &[u8]) -> PathBuf {
    let path = place(name);
    fs::write(&path, bytes).expect("the scratch folder has room");
    path
}

/// An empty folder.
pub fn empty_folder(name: &str) -> PathBuf {
    let path = place(name);
    if path.exists() {
        fs::remove_dir_all(&path).expect("a folder of ours can be deleted");
    }
    fs::create_dir_all(&path).expect("a folder can be made");
    path
}

/// The files under a folder, sorted, without links.
pub fn files_under(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut left = vec![folder.to_owned()];
    while let Some(folder) = left.pop() {
        for entry in fs::read_dir(folder).expect("a folder of ours can be read") {
            let path = entry.expect("a folder of ours can be read").path();
            if path.is_symlink() {
                continue;
            }
            if path.is_dir() { left.push(path) } else { found.push(path) }
        }
    }
    found.sort();
    found
}

/// The first byte and the others.
pub fn split(bytes: &[u8]) -> Option<(usize, &[u8])> {
    bytes.split_first().map(|(first, rest)| (usize::from(*first), rest))
}

/// Prints an error where `HARMZONE_FUZZ_TELL` is set, to see how far inputs come.
pub fn tell(error: &dyn std::fmt::Display) {
    if std::env::var_os("HARMZONE_FUZZ_TELL").is_some() {
        eprintln!("{error}");
    }
}
