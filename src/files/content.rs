//! What a command writes into a folder of its own, by the names of the files: files of the user's are told from them.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::is_unfinished;

/// The files of a folder that a command makes whole.
#[derive(Debug, Clone, Copy)]
pub struct FolderContent {
    /// The file without which a folder is none of the command's.
    pub marker: &'static str,
    /// Paths of the other files in the folder: `*` stands for any part of a name, `#` for a digit, `%` for a hexadecimal one.
    pub files: &'static [&'static str],
}

impl FolderContent {
    /// Whether a file is one of the command's, by its path in the folder.
    #[must_use]
    pub fn holds(&self, file: &str) -> bool {
        file == self.marker || self.files.iter().any(|pattern| is_like(file, pattern))
    }

    /// The first file in a folder, by name, that is none of the command's, nor one that a run left unfinished; links count as files.
    /// `None` also where there is no folder.
    ///
    /// # Errors
    /// A folder cannot be read.
    pub(super) fn first_foreign(&self, folder: &Path) -> io::Result<Option<PathBuf>> {
        match self.first_foreign_below(folder, "") {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            found => found,
        }
    }

    /// As [`Self::first_foreign`], in a part of the folder, whose path is empty or ends with a slash.
    fn first_foreign_below(&self, folder: &Path, part: &str) -> io::Result<Option<PathBuf>> {
        let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
        entries.sort_by_cached_key(fs::DirEntry::file_name);
        for entry in entries {
            let file = format!("{part}{}", entry.file_name().to_string_lossy());
            let found = if entry.file_type()?.is_dir() {
                self.first_foreign_below(&entry.path(), &format!("{file}/"))?
            } else {
                let is_ours = self.holds(&file) || is_unfinished(Path::new(&file));
                (!is_ours).then(|| PathBuf::from(file))
            };
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }
}

/// Whether a path is like a pattern of [`FolderContent::files`].
fn is_like(path: &str, pattern: &str) -> bool {
    let Some(wanted) = pattern.chars().next() else { return path.is_empty() };
    let after = &pattern[wanted.len_utf8()..];
    if wanted == '*' {
        let end = path.find('/').unwrap_or(path.len());
        return (0..=end).filter(|&at| path.is_char_boundary(at)).any(|at| is_like(&path[at..], after));
    }
    let Some(found) = path.chars().next() else { return false };
    let is_so = match wanted {
        '#' => found.is_ascii_digit(),
        '%' => found.is_ascii_hexdigit(),
        _ => found == wanted,
    };
    is_so && is_like(&path[found.len_utf8()..], after)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENT: FolderContent =
        FolderContent { marker: "mark.json", files: &["##.png", "maps/%%.png", "samples/*/*__#*.jpg"] };

    #[test]
    fn files_are_known_by_their_whole_paths() {
        for ours in
            ["mark.json", "07.png", "maps/a0.png", "samples/CAM/one__two__17.jpg", "samples/CAM/__1.jpg"]
        {
            assert!(CONTENT.holds(ours), "{ours}");
        }
        for other in [
            "",
            "mark.json.bak",
            "7.png",
            "007.png",
            "me.png",
            "maps/07/a0.png",
            "maps/ag.png",
            "07.png/07.png",
            "samples/one__17.jpg",
            "samples/CAM/BACK/one__17.jpg",
            "samples/CAM/one__x.jpg",
            "samples/CAM/ü__x.jpg",
        ] {
            assert!(!CONTENT.holds(other), "{other}");
        }
    }

    #[test]
    fn the_first_file_of_anybody_elses_is_found_in_the_depth_too() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        assert_eq!(CONTENT.first_foreign(&at("absent")).unwrap(), None);
        fs::create_dir_all(at("maps/empty")).unwrap();
        for ours in ["mark.json", "07.png", "maps/a0.png", "x.mcap.7.partial"] {
            fs::write(at(ours), "").unwrap();
        }
        assert_eq!(CONTENT.first_foreign(home.path()).unwrap(), None);
        fs::write(at("maps/empty/notes.txt"), "").unwrap();
        assert_eq!(CONTENT.first_foreign(home.path()).unwrap(), Some("maps/empty/notes.txt".into()));
        // A link is not followed.
        std::os::unix::fs::symlink("maps", at("link")).unwrap();
        assert_eq!(CONTENT.first_foreign(home.path()).unwrap(), Some("link".into()));
    }
}
