//! What the files of a mirror were when they lay remotely, kept beside them: a line of JSON for each fetched or put file.
//!
//! Lines are only added, by one write each, so that processes that read the same URL do not disturb each other; the last line
//! of a file counts.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::time::UNIX_EPOCH;

use fs_err as fs;
use serde::{Deserialize, Serialize};

/// A file that is here as it lies remotely.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Known {
    /// Below the mirror's root.
    pub file: String,
    pub e_tag: Option<String>,
    pub size: u64,
    pub sha256: String,
    /// The local file's, since 1970: a file that was changed here has another.
    pub modified_ns: u64,
}

/// All that is known; broken lines, of a machine that died, count as not there.
pub(super) fn read(path: &Path) -> io::Result<BTreeMap<String, Known>> {
    match fs::read_to_string(path) {
        Ok(text) => {
            let lines = text.lines().filter_map(|line| serde_json::from_str::<Known>(line).ok());
            Ok(lines.map(|known| (known.file.clone(), known)).collect())
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(error) => Err(error),
    }
}

/// Adds a line.
pub(super) fn add(path: &Path, known: &Known) -> io::Result<()> {
    let line = serde_json::to_string(known).expect("it has a JSON form") + "\n";
    fs::OpenOptions::new().create(true).append(true).open(path)?.write_all(line.as_bytes())
}

/// A file as it lies in a mirror.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Found {
    pub size: u64,
    pub modified_ns: u64,
}

impl Found {
    pub(super) fn at(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        let since =
            metadata.modified()?.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        Ok(Self { size: metadata.len(), modified_ns: since })
    }

    pub(super) fn is(&self, known: &Known) -> bool {
        (self.size, self.modified_ns) == (known.size, known.modified_ns)
    }
}

/// All files below a folder by their paths in it, with `/` between the parts; none where the folder is not there.
pub(super) fn walk(root: &Path) -> io::Result<BTreeMap<String, Found>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        let entries = match fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            entries => entries?,
        };
        for entry in entries {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let inside = path.strip_prefix(root).expect("it is below").to_string_lossy().into_owned();
            match Found::at(&path) {
                // Another reader may evict it just now.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                file => {
                    found.insert(inside, file?);
                }
            }
        }
    }
    Ok(found)
}
