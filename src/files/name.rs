//! The last step of every write: what is whole gets its final name, and the disk keeps the name through a power cut.

use std::io;
use std::path::Path;

use fs_err as fs;
use rustix::io::Errno;
use tempfile::TempPath;

/// Gives a file or a folder, whose content is on the disk, its final name, and forces the name there too; what lies under it is
/// replaced.
///
/// # Errors
/// Any IO error. Where it is one of forcing, what was renamed has its name and is whole.
pub(crate) fn give_final_name(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)?;
    force_name(to)
}

/// As [`give_final_name`], of a file that is removed where it does not get its name.
///
/// # Errors
/// As [`give_final_name`].
pub(crate) fn keep_as(mut partial: TempPath, to: &Path) -> io::Result<()> {
    fs::rename(&partial, to)?;
    // By now another process may be writing under the partial name.
    partial.disable_cleanup(true);
    force_name(to)
}

/// Forces the names in a path's folder to the disk: that of a file which was forced there itself can be lost without.
///
/// # Errors
/// The disk fails. A file system that forces no folders is no error, nor is a folder that may be written in and not read.
pub(super) fn force_name(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let opened = match fs::File::open(folder) {
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => return Ok(()),
        opened => opened?,
    };
    match opened.file().sync_all() {
        Err(error) if !is_refused(&error) => Err(io::Error::new(
            error.kind(),
            format!("cannot force the folder's names to the disk: {error}: {}", folder.display()),
        )),
        _ => Ok(()),
    }
}

/// Whether a file system says that it forces no folders.
fn is_refused(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::INVAL | Errno::NOTSUP))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_whole_gets_its_name_and_what_does_not_is_removed() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        let partial = || {
            fs::write(at("file.partial"), "new").unwrap();
            TempPath::try_from_path(at("file.partial")).unwrap()
        };
        fs::write(at("file"), "old").unwrap();
        keep_as(partial(), &at("file")).unwrap();
        assert_eq!(fs::read_to_string(at("file")).unwrap(), "new");
        assert!(keep_as(partial(), &at("absent/file")).is_err());
        assert!(!at("file.partial").exists());
        fs::create_dir(at("folder.partial")).unwrap();
        give_final_name(&at("folder.partial"), &at("folder")).unwrap();
        assert!(at("folder").is_dir());
    }

    #[test]
    fn a_disk_that_fails_is_an_error_and_one_that_forces_no_folders_is_none() {
        let of = io::Error::from_raw_os_error;
        assert!([Errno::INVAL, Errno::NOTSUP].iter().all(|errno| is_refused(&of(errno.raw_os_error()))));
        assert!([Errno::IO, Errno::NOSPC].iter().all(|errno| !is_refused(&of(errno.raw_os_error()))));
        // One that forces none.
        force_name(Path::new("/proc/self/status")).unwrap();
        let told = force_name(Path::new("/absent/file")).unwrap_err().to_string();
        assert!(told.contains("/absent"), "{told}");
    }
}
