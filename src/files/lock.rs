//! One writer a folder: who writes says so in a file there, and holds it while it lives.

use std::ffi::OsStr;
use std::fmt;
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use fs_err as fs;
use fs_err::os::unix::fs::OpenOptionsExt as _;
use rustix::fs::{OFlags, fstat, lstat};
use rustix::io::Errno;

use super::{is_file, remove_if_there, told_with_room};

/// Name of the file, which counts as unfinished: it may be deleted where nobody holds it.
const FILE: &str = "writer.partial";

/// Whether a file is a lock by its name: `writer.partial`, and `writer-<index>-of-<number>.partial` of several that may write.
#[must_use]
pub fn is_lock(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let numbers = name.strip_prefix("writer-").and_then(|name| name.strip_suffix(".partial"));
    let is_number = |text: &str| text.parse::<u32>().is_ok();
    name == FILE
        || numbers.and_then(|all| all.split_once("-of-")).is_some_and(|(a, b)| is_number(a) && is_number(b))
}

/// The right to write in a folder, until it is dropped or the process ends, however it ends.
pub struct FolderLock {
    file: fs::File,
    path: PathBuf,
    /// Whether the folder was not there before, and goes again where nothing came into it.
    is_new: bool,
}

impl FolderLock {
    /// Takes the lock of a folder, which is made if it is not there, and goes with the lock if nothing came into it. What a process that
    /// was killed left is taken over.
    ///
    /// # Errors
    /// Another process holds it, who is named; the disk fails.
    pub fn take(folder: &Path) -> io::Result<Self> {
        Self::take_named(folder, FILE)
    }

    /// As [`Self::take`], for one of several that may write there at a time, each under its own name.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn take_named(folder: &Path, name: &str) -> io::Result<Self> {
        let folder = or_here(folder);
        Self::take_for(folder, OsStr::new(name), folder)
    }

    /// Takes the right to make a file or a folder that appears whole, by a lock beside it: `<name>.writer.partial`. As [`Self::take`]
    /// makes a folder, this makes the one that it lies in.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn take_beside(path: &Path) -> io::Result<Self> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{FILE}"));
        Self::take_for(or_here(path.parent().unwrap_or(Path::new(""))), &name, path)
    }

    /// Takes a lock of this name in a folder; what it is for is told where another process holds it.
    fn take_for(folder: &Path, name: &OsStr, what: &Path) -> io::Result<Self> {
        let path = folder.join(name);
        let (mut is_new, mut n_retries) = (false, 3);
        loop {
            is_new |= !folder.exists();
            let mut file = match fs::create_dir_all(folder).and_then(|()| open_own(&path)) {
                // The one before may have made the folder, and have taken it along between two calls of ours.
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::AlreadyExists)
                        && n_retries > 0 =>
                {
                    n_retries -= 1;
                    continue;
                }
                opened => opened?,
            };
            match file.try_lock().map_err(io::Error::from) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    let mut holder = String::new();
                    file.read_to_string(&mut holder)?;
                    let other = if what == folder { "folder" } else { "name" };
                    return Err(io::Error::new(
                        io::ErrorKind::ResourceBusy,
                        format!(
                            "another process writes here ({}); wait for it, or give another {other}: {}",
                            holder.trim_end(),
                            what.display()
                        ),
                    ));
                }
                // Some network file systems have no locks.
                Err(error) if error.kind() == io::ErrorKind::Unsupported => {
                    tracing::warn!("no lock, the file system has none: {}", folder.display());
                }
                Err(error) => return Err(error),
            }
            // The one before may have deleted the file between our opening and its unlocking.
            if !is_still_there(&file, &path) {
                continue;
            }
            // From here on the file is removed where anything fails.
            let mut lock = Self { file, path, is_new };
            let who = this_process();
            return match lock.write(&who) {
                Ok(()) => Ok(lock),
                Err(error) => Err(told_with_room(error, &lock.path, who.len() as u64)),
            };
        }
    }

    fn write(&mut self, who: &str) -> io::Result<()> {
        self.file.rewind()?;
        self.file.set_len(0)?;
        writeln!(self.file, "{who}")
    }

    /// Removes the file that a process left which could not, where there is one and nobody holds it.
    pub fn tidy(folder: &Path) {
        let _ = Self::refuse_other(folder);
    }

    /// An error where another process writes in a folder; the file of one that was killed is removed.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn refuse_other(folder: &Path) -> io::Result<()> {
        if is_file(&folder.join(FILE))? { Self::take(folder).map(drop) } else { Ok(()) }
    }

    /// An error where the folder was deleted, or replaced, since the lock was taken.
    ///
    /// # Errors
    /// It was.
    pub fn check(&self) -> io::Result<()> {
        if is_still_there(&self.file, &self.path) {
            return Ok(());
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Err(io::Error::new(
            io::ErrorKind::NotFound,
            format!(
                "the folder was deleted or replaced while this process wrote in it: {}",
                folder.display()
            ),
        ))
    }
}

/// A folder, or the one that the process works in.
fn or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Opens a file to write, or makes it, once no other process has it open so.
///
/// # Errors
/// Any IO error.
pub(super) fn open_alone(path: &Path) -> io::Result<fs::File> {
    loop {
        let file = open_own(path)?;
        match file.lock() {
            // Some network file systems have no locks.
            Err(error) if error.kind() != io::ErrorKind::Unsupported => return Err(error),
            _ => {}
        }
        // The one before has renamed it, or deleted it.
        if is_still_there(&file, path) {
            return Ok(file);
        }
    }
}

/// Opens a file that only this program writes, or makes it. A link in its place is deleted: a folder from elsewhere could lead to any
/// file of the user's by it.
///
/// # Errors
/// Any IO error.
pub(super) fn open_own(path: &Path) -> io::Result<fs::File> {
    loop {
        let mut options = fs::OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        options.custom_flags(OFlags::NOFOLLOW.bits().cast_signed());
        let error = match options.open(path) {
            Err(error) => error,
            opened => return opened,
        };
        if path.is_symlink() {
            remove_if_there(path)?;
        } else if error.kind() != io::Error::from(Errno::LOOP).kind() {
            return Err(error);
        }
        // Else another process has deleted the link since.
    }
}

/// Whether a name still leads to this file.
fn is_still_there(file: &fs::File, path: &Path) -> bool {
    match (fstat(file), lstat(path)) {
        (Ok(ours), Ok(there)) => (ours.st_dev, ours.st_ino) == (there.st_dev, there.st_ino),
        _ => false,
    }
}

/// This process in words.
fn this_process() -> String {
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let words: Vec<String> =
        std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    format!("process {} on {}: harmzone {}", std::process::id(), host.trim_end(), words.join(" "))
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // While it is held, so that nobody can have taken the same file.
        let is_removed = fs::remove_file(&self.path).is_ok();
        if let Some(folder) = self.path.parent().filter(|_| is_removed && self.is_new) {
            // Refused where anything is in it.
            let _ = fs::remove_dir(folder);
        }
        let _ = self.file.unlock();
    }
}

impl fmt::Debug for FolderLock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("FolderLock").field(&self.path).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_was_left_is_tidied_away_and_one_that_is_held_stays() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join(FILE), "process 1").unwrap();
        FolderLock::tidy(home.path());
        assert!(!home.path().join(FILE).exists());
        let _held = FolderLock::take(home.path()).unwrap();
        FolderLock::tidy(home.path());
        assert!(home.path().join(FILE).exists());
    }

    #[test]
    fn locks_are_known_by_their_whole_names() {
        for name in ["writer.partial", "writer-3-of-16.partial"] {
            assert!(is_lock(&Path::new("data").join(name)), "{name}");
        }
        for name in ["writer", "writer-of-novels.partial", "writer-3-of-.partial", "writer-3-of-16.mcap"] {
            assert!(!is_lock(&Path::new("data").join(name)), "{name}");
        }
    }

    #[test]
    fn a_link_in_place_of_a_lock_leads_nowhere() {
        let home = tempfile::tempdir().unwrap();
        let (precious, folder) = (home.path().join("precious"), home.path().join("data"));
        fs::write(&precious, "mine").unwrap();
        fs::create_dir(&folder).unwrap();
        std::os::unix::fs::symlink(&precious, folder.join(FILE)).unwrap();
        drop(FolderLock::take(&folder).unwrap());
        assert_eq!(fs::read_to_string(precious).unwrap(), "mine");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
    }

    #[test]
    fn the_second_is_told_who_the_first_is_and_a_stale_file_is_taken_over() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("data");
        let first = FolderLock::take(&folder).unwrap();
        let told = FolderLock::take(&folder).unwrap_err();
        assert_eq!(told.kind(), io::ErrorKind::ResourceBusy);
        assert!(told.to_string().contains(&format!("process {}", std::process::id())), "{told}");
        assert!(FolderLock::take_named(&folder, "other.partial").is_ok());
        first.check().unwrap();
        fs::rename(&folder, home.path().join("elsewhere")).unwrap();
        assert!(first.check().unwrap_err().to_string().contains("deleted or replaced"));
        fs::rename(home.path().join("elsewhere"), &folder).unwrap();
        fs::write(folder.join("data"), "").unwrap();
        drop(first);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        fs::write(folder.join(FILE), "process 1 on a host that lost its power").unwrap();
        drop(FolderLock::take(&folder).unwrap());
    }

    #[test]
    fn a_lock_beside_a_file_names_the_file_and_is_of_it_alone() {
        let home = tempfile::tempdir().unwrap();
        let file = home.path().join("new/film.mcap");
        let held = FolderLock::take_beside(&file).unwrap();
        assert!(home.path().join("new/film.mcap.writer.partial").exists());
        let told = FolderLock::take_beside(&file).unwrap_err().to_string();
        let who = format!("process {}", std::process::id());
        assert!(
            told.contains(&who) && told.contains("another name") && told.ends_with("film.mcap"),
            "{told}"
        );
        drop(FolderLock::take_beside(&home.path().join("new/other.mcap")).unwrap());
        drop(held);
        assert!(!home.path().join("new").exists());
    }

    #[test]
    fn a_folder_that_the_lock_made_goes_with_it_where_nothing_came_into_it() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("data");
        drop(FolderLock::take(&folder).unwrap());
        assert!(!folder.exists());
        fs::create_dir(&folder).unwrap();
        drop(FolderLock::take(&folder).unwrap());
        assert!(folder.exists());
        fs::remove_dir(&folder).unwrap();
        let lock = FolderLock::take(&folder).unwrap();
        fs::write(folder.join("file"), "").unwrap();
        drop(lock);
        assert!(folder.join("file").exists());
    }

    #[test]
    fn of_many_that_ask_at_a_time_one_has_it() {
        let home = tempfile::tempdir().unwrap();
        let (held, most) = (std::sync::atomic::AtomicUsize::new(0), std::sync::atomic::AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..100 {
                        // A folder that each makes and takes along.
                        if let Ok(_lock) = FolderLock::take(&home.path().join("data")) {
                            let n = held.fetch_add(1, std::sync::atomic::Ordering::SeqCst) + 1;
                            most.fetch_max(n, std::sync::atomic::Ordering::SeqCst);
                            held.fetch_sub(1, std::sync::atomic::Ordering::SeqCst);
                        }
                    }
                });
            }
        });
        assert_eq!(most.into_inner(), 1);
    }
}
