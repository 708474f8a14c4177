//! A folder that appears whole or not at all: filled under a partial name beside its place, then renamed.
//!
//! What lies beside it meanwhile has the same names in every process, `<folder>.new.partial` and (where both cannot be exchanged)
//! `<folder>.old.partial`, so that the next one deletes what a killed one left; `<folder>.writer.partial` is the lock.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use fs_err as fs;
use rustix::fs::{CWD, RenameFlags, renameat_with, syncfs};
use thiserror::Error;

use super::name::force_name;
use super::{FolderContent, FolderLock, PARTIAL_SUFFIX, holds_anything, is_file, told_with_room};

/// What a folder without files takes on a disk: a block.
const FOLDER_BYTES: u64 = 4096;

/// Why a folder cannot be made.
#[derive(Debug, Error)]
pub enum FolderError {
    #[error("there is something already; give --force to replace it: {}", path.display())]
    Exists { path: PathBuf },
    #[error("--force replaces a folder with `{marker}` in it, which this command wrote; there is none: {}", path.display())]
    Foreign { marker: &'static str, path: PathBuf },
    #[error("`{}` is none of the files that this command writes there, and would be lost; move it elsewhere, or give another folder: {}", file.display(), path.display())]
    NotOurs { file: PathBuf, path: PathBuf },
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A folder being filled; dropped unfinished, it leaves nothing.
#[derive(Debug)]
pub struct NewFolder {
    target: PathBuf,
    partial: PathBuf,
    content: FolderContent,
    force: bool,
    /// Bytes of the files so far.
    n_bytes: AtomicU64,
    /// Held until the folder has its name; it goes after all else.
    lock: FolderLock,
}

impl NewFolder {
    /// Starts a folder. One that is not empty is refused; with `force` it is replaced at the end, if it holds the file by which this
    /// program knows its own, and no file but those of `content`. What a process that was killed left beside it is deleted.
    ///
    /// # Errors
    /// Something is there that may not be replaced, another process makes the same folder or writes in it, or the disk fails.
    pub fn create(target: &Path, content: FolderContent, force: bool) -> Result<Self, FolderError> {
        refuse_to_lose(target, content, force)?;
        // Without the slash at its end, after which `beside` would be inside.
        let target: PathBuf = std::path::absolute(target)?.components().collect();
        let lock = FolderLock::take_beside(&target)?;
        let partial = beside(&target, "new");
        remove(&partial)?;
        fs::create_dir(&partial).map_err(|error| told_with_room(error, &target, FOLDER_BYTES))?;
        Ok(Self { target, partial, content, force, n_bytes: AtomicU64::new(0), lock })
    }

    /// Where files lie until the folder is whole.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Where a file inside will lie.
    #[must_use]
    pub fn final_path(&self, inside: &str) -> PathBuf {
        self.target.join(inside)
    }

    /// Makes a folder inside, if it is not there.
    ///
    /// # Errors
    /// The disk fails.
    pub fn make(&self, inside: &str) -> io::Result<PathBuf> {
        let path = self.partial.join(inside);
        fs::create_dir_all(&path)
            .map_err(|error| told_with_room(error, &self.final_path(inside), FOLDER_BYTES))?;
        Ok(path)
    }

    /// Writes a file inside, one of the folder's content, into a folder that is there.
    ///
    /// # Errors
    /// The disk fails; of a full one the file and the room are told.
    pub fn write(&self, inside: &str, bytes: &[u8]) -> io::Result<()> {
        debug_assert!(self.content.holds(inside), "`{inside}` is missing in the list of the folder's files");
        let n_bytes = bytes.len() as u64;
        self.n_bytes.fetch_add(n_bytes, Ordering::Relaxed);
        fs::write(self.partial.join(inside), bytes)
            .map_err(|error| told_with_room(error, &self.final_path(inside), n_bytes))
    }

    /// Gives the folder its name, once its files are on the disk; what was there is gone then.
    ///
    /// # Errors
    /// Something came there meanwhile that may not be replaced, or the disk fails.
    pub fn finish(self) -> Result<(), FolderError> {
        // One call for all files, which many small ones would make slow.
        fs::File::open(&self.partial)
            .and_then(|folder| syncfs(folder).map_err(io::Error::from))
            .map_err(|error| told_with_room(error, &self.target, self.n_bytes.load(Ordering::Relaxed)))?;
        self.lock.check()?;
        refuse_to_lose(&self.target, self.content, self.force)?;
        let is_replaced = self.target.exists();
        // Both names at once, so that there is a whole folder at any time.
        if is_replaced && renameat_with(CWD, &self.partial, CWD, &self.target, RenameFlags::EXCHANGE).is_ok()
        {
            force_name(&self.target)?;
            return Ok(remove(&self.partial)?);
        }
        // Some file systems cannot do that.
        let old = beside(&self.target, "old");
        remove(&old)?;
        if is_replaced {
            fs::rename(&self.target, &old)?;
        }
        if let Err(error) = fs::rename(&self.partial, &self.target) {
            if is_replaced {
                fs::rename(&old, &self.target)?;
            }
            return Err(error.into());
        }
        let forced = force_name(&self.target);
        remove(&old)?;
        Ok(forced?)
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        // Nobody could be told; a leftover is named so that it may be deleted at any time.
        let _ = remove(&self.partial);
    }
}

/// An error where something lies in a folder's place that may not be replaced.
fn refuse_to_lose(target: &Path, content: FolderContent, force: bool) -> Result<(), FolderError> {
    let (marker, path) = (content.marker, || target.to_owned());
    let is_filled = holds_anything(target)?;
    if is_filled && !force {
        return Err(FolderError::Exists { path: path() });
    }
    if is_filled && !is_file(&target.join(marker))? {
        return Err(FolderError::Foreign { marker, path: path() });
    }
    FolderLock::refuse_other(target)?;
    // Also where it counts as empty: there may be unfinished files of somebody else.
    match content.first_foreign(target)? {
        Some(file) => Err(FolderError::NotOurs { file, path: path() }),
        None => Ok(()),
    }
}

/// A name beside a folder.
fn beside(target: &Path, what: &str) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(format!(".{what}.{PARTIAL_SUFFIX}"));
    name.into()
}

fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENT: FolderContent = FolderContent { marker: "mark", files: &["inside/##.png"] };
    const OTHER: FolderContent = FolderContent { marker: "other", ..CONTENT };

    fn names_in(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_folder_appears_when_it_is_finished_and_leaves_nothing_otherwise() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("deep/out");
        let started = NewFolder::create(&target, CONTENT, false).unwrap();
        started.make("inside").unwrap();
        started.write("inside/07.png", b"").unwrap();
        assert!(!target.exists());
        drop(started);
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
        let started = NewFolder::create(&target.join(""), CONTENT, false).unwrap();
        started.write("mark", b"1").unwrap();
        started.finish().unwrap();
        assert_eq!(names_in(&home.path().join("deep")), ["out"]);
        assert_eq!(names_in(&target), ["mark"]);
    }

    #[test]
    fn a_filled_folder_is_replaced_by_force_alone_and_a_strangers_never() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("out");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("mark"), b"old").unwrap();
        assert!(matches!(NewFolder::create(&target, CONTENT, false), Err(FolderError::Exists { .. })));
        assert!(matches!(NewFolder::create(&target, OTHER, true), Err(FolderError::Foreign { .. })));
        let started = NewFolder::create(&target, CONTENT, true).unwrap();
        assert_eq!(fs::read(target.join("mark")).unwrap(), b"old");
        started.write("mark", b"new").unwrap();
        started.finish().unwrap();
        assert_eq!(fs::read(target.join("mark")).unwrap(), b"new");
        assert_eq!(names_in(home.path()), ["out"]);
    }

    #[test]
    fn what_a_user_put_into_a_folder_of_ours_is_named_and_stays() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("out");
        let notes = target.join("inside/notes.txt");
        let refused = |made: Result<(), FolderError>| {
            let told = made.unwrap_err().to_string();
            assert!(told.contains("`inside/notes.txt`") && told.contains("out"), "{told}");
            assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
            assert_eq!(names_in(home.path()), ["out"]);
        };
        fs::create_dir_all(target.join("inside")).unwrap();
        for file in [target.join("mark"), target.join("inside/07.png"), notes.clone()] {
            fs::write(file, "mine").unwrap();
        }
        refused(NewFolder::create(&target, CONTENT, true).map(drop));
        // It may also come while the folder is made.
        fs::remove_file(&notes).unwrap();
        let started = NewFolder::create(&target, CONTENT, true).unwrap();
        started.write("mark", b"new").unwrap();
        fs::write(&notes, "mine").unwrap();
        refused(started.finish());
        assert_eq!(fs::read_to_string(target.join("mark")).unwrap(), "mine");
        // Unfinished files count as nothing only where they are ours.
        let film = home.path().join("films/film.partial");
        fs::create_dir(home.path().join("films")).unwrap();
        fs::write(&film, "").unwrap();
        let told = NewFolder::create(film.parent().unwrap(), CONTENT, false).unwrap_err().to_string();
        assert!(told.contains("`film.partial`") && film.exists(), "{told}");
    }

    #[test]
    fn what_a_killed_process_left_is_deleted_and_who_is_at_work_is_named() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("out");
        fs::create_dir(home.path().join("out.new.partial")).unwrap();
        fs::write(home.path().join("out.new.partial/half"), "").unwrap();
        fs::write(home.path().join("out.writer.partial"), "process 1 on a host that lost its power").unwrap();
        let first = NewFolder::create(&target, CONTENT, false).unwrap();
        assert_eq!(names_in(first.path()), Vec::<String>::new());
        first.write("mark", b"1").unwrap();
        let who = format!("process {}", std::process::id());
        let told = NewFolder::create(&target, CONTENT, true).unwrap_err().to_string();
        assert!(told.contains(&who) && told.ends_with("out"), "{told}");
        first.finish().unwrap();
        assert_eq!(names_in(home.path()), ["out"]);
        // So is one that writes in the folder itself.
        let _held = FolderLock::take(&target).unwrap();
        let told = NewFolder::create(&target, CONTENT, true).unwrap_err().to_string();
        assert!(told.contains(&who), "{told}");
        assert_eq!(names_in(home.path()), ["out"]);
    }
}
