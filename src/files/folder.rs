//! A folder that appears whole or not at all: filled under a partial name beside its place, then renamed.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use rustix::fs::{CWD, RenameFlags, renameat_with, syncfs};
use thiserror::Error;

use super::name::force_name;
use super::{PARTIAL_SUFFIX, holds_anything};

/// Why a folder cannot be made.
#[derive(Debug, Error)]
pub enum FolderError {
    #[error("there is something already; give --force to replace it: {}", path.display())]
    Exists { path: PathBuf },
    #[error("--force replaces a folder with `{marker}` in it, which this command wrote; there is none: {}", path.display())]
    Foreign { marker: &'static str, path: PathBuf },
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A folder being filled; dropped unfinished, it leaves nothing.
#[derive(Debug)]
pub struct NewFolder {
    target: PathBuf,
    partial: PathBuf,
    force: bool,
}

impl NewFolder {
    /// Starts a folder. One that is not empty is refused; with `force` it is replaced at the end, if it holds the file
    /// `marker` by which this program knows its own.
    ///
    /// # Errors
    /// Something is there that may not be replaced, or the disk fails.
    pub fn create(target: &Path, marker: &'static str, force: bool) -> Result<Self, FolderError> {
        let is_filled = holds_anything(target)?;
        if is_filled && !force {
            return Err(FolderError::Exists { path: target.to_owned() });
        }
        if is_filled && !target.join(marker).is_file() {
            return Err(FolderError::Foreign { marker, path: target.to_owned() });
        }
        // Without the slash at its end, after which `beside` would be inside.
        let target: PathBuf = std::path::absolute(target)?.components().collect();
        let partial = beside(&target, "new");
        if let Some(parent) = target.parent() {
            fs::create_dir_all(parent)?;
        }
        remove(&partial)?;
        fs::create_dir(&partial)?;
        Ok(Self { target, partial, force })
    }

    /// Where files are written until the folder is whole.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// Makes a folder inside, if it is not there.
    ///
    /// # Errors
    /// The disk fails.
    pub fn make(&self, inside: &str) -> io::Result<PathBuf> {
        let path = self.partial.join(inside);
        fs::create_dir_all(&path)?;
        Ok(path)
    }

    /// Gives the folder its name, once its files are on the disk; what was there is gone then.
    ///
    /// # Errors
    /// The disk fails.
    pub fn finish(self) -> io::Result<()> {
        // One call for all files, which many small ones would make slow.
        syncfs(fs::File::open(&self.partial)?)?;
        if !self.force && holds_anything(&self.target)? {
            return Err(io::Error::new(
                io::ErrorKind::AlreadyExists,
                format!("another process made the folder meanwhile: {}", self.target.display()),
            ));
        }
        let is_replaced = self.target.exists();
        // Both names at once, so that there is a whole folder at any time.
        if is_replaced && renameat_with(CWD, &self.partial, CWD, &self.target, RenameFlags::EXCHANGE).is_ok()
        {
            force_name(&self.target)?;
            return remove(&self.partial);
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
            return Err(error);
        }
        let forced = force_name(&self.target);
        remove(&old)?;
        forced
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        // Nobody could be told; a leftover is named so that it may be deleted at any time.
        let _ = remove(&self.partial);
    }
}

/// A name beside a folder, of this process alone.
fn beside(target: &Path, what: &str) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(format!(".{}.{what}.{PARTIAL_SUFFIX}", std::process::id()));
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

    #[test]
    fn a_folder_appears_when_it_is_finished_and_leaves_nothing_otherwise() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("deep/out");
        let started = NewFolder::create(&target, "mark", false).unwrap();
        fs::write(started.make("inside").unwrap().join("mark"), b"").unwrap();
        assert!(!target.exists());
        drop(started);
        assert_eq!(fs::read_dir(home.path().join("deep")).unwrap().count(), 0);
        let started = NewFolder::create(&target.join(""), "mark", false).unwrap();
        fs::write(started.path().join("mark"), b"1").unwrap();
        started.finish().unwrap();
        assert_eq!(fs::read_dir(home.path().join("deep")).unwrap().count(), 1);
    }

    #[test]
    fn a_filled_folder_is_replaced_by_force_alone_and_a_strangers_never() {
        let home = tempfile::tempdir().unwrap();
        let target = home.path().join("out");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("mark"), b"old").unwrap();
        assert!(matches!(NewFolder::create(&target, "mark", false), Err(FolderError::Exists { .. })));
        assert!(matches!(NewFolder::create(&target, "other", true), Err(FolderError::Foreign { .. })));
        let started = NewFolder::create(&target, "mark", true).unwrap();
        assert_eq!(fs::read(target.join("mark")).unwrap(), b"old");
        fs::write(started.path().join("mark"), b"new").unwrap();
        started.finish().unwrap();
        assert_eq!(fs::read(target.join("mark")).unwrap(), b"new");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
    }
}
