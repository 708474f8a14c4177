//! Room on a disk: how much is free, and what a full one is told as.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use fs_err as fs;

/// Bytes that an ordinary user may still write where a path lies, or will lie.
///
/// # Errors
/// The system does not tell.
pub fn free_bytes(path: &Path) -> io::Result<u64> {
    let path = std::path::absolute(path)?;
    let there = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("/"));
    let of_disk = rustix::fs::statvfs(there)?;
    Ok(of_disk.f_bavail.saturating_mul(of_disk.f_frsize))
}

/// A number of bytes as people read it.
#[must_use]
pub fn bytes_in_words(n_bytes: u64) -> String {
    let n = n_bytes as f64;
    match n_bytes {
        0..1_000 => format!("{n_bytes} bytes"),
        1_000..1_000_000 => format!("{:.1} kB", n / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", n / 1e6),
        _ => format!("{:.1} GB", n / 1e9),
    }
}

/// An error of writing `wanted` bytes, which names file and room where it is that the disk is full.
#[must_use]
pub fn told_with_room(error: io::Error, path: &Path, wanted: u64) -> io::Error {
    if !matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) {
        return error;
    }
    let free = free_bytes(path).map_or_else(|_| "unknown".to_owned(), bytes_in_words);
    io::Error::new(
        io::ErrorKind::StorageFull,
        format!(
            "no space left on the disk: the file wants {} and {free} are free; make room, and the same command goes \
             on: {}",
            bytes_in_words(wanted),
            path.display()
        ),
    )
}

/// The bytes that `link_or_copy` will write where so many files, each with its new name, are put into a folder: those of another disk,
/// and not there yet. What cannot be looked at counts as nothing.
pub fn bytes_to_copy<'a>(folder: &Path, files: impl Iterator<Item = (&'a Path, &'a Path)>) -> u64 {
    let disk_of = |path: &Path| fs::metadata(path).ok().map(|of| of.dev());
    let Ok(folder) = std::path::absolute(folder) else { return 0 };
    let here = folder.ancestors().find(|folder| folder.exists()).and_then(disk_of);
    let wanted = |(from, to): (&Path, &Path)| {
        let of = fs::metadata(from).ok().filter(|of| Some(of.dev()) != here && !to.exists());
        of.map_or(0, |of| of.len())
    };
    files.map(wanted).sum()
}

/// Refuses work that cannot be finished: it will write about `wanted` bytes, which are not free.
///
/// # Errors
/// There is too little room (`StorageFull`).
pub fn check_room(folder: &Path, wanted: u64) -> io::Result<()> {
    // Where the system does not tell, the disk will.
    let Ok(free) = free_bytes(folder) else { return Ok(()) };
    if wanted <= free {
        return Ok(());
    }
    Err(io::Error::new(
        io::ErrorKind::StorageFull,
        format!(
            "this needs about {} of disk and {} are free; make room, or make less: {}",
            bytes_in_words(wanted),
            bytes_in_words(free),
            folder.display()
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_yet_has_the_room_of_its_disk() {
        let home = tempfile::tempdir().unwrap();
        assert!(free_bytes(&home.path().join("not/yet")).unwrap() > 0);
        let told = check_room(home.path(), u64::MAX).unwrap_err().to_string();
        assert!(told.contains("needs about") && told.contains("are free"), "{told}");
        check_room(home.path(), 1).unwrap();
    }

    #[test]
    fn only_what_lies_on_another_disk_and_is_not_there_yet_is_copied() {
        let home = tempfile::tempdir().unwrap();
        let [from, to] = ["from", "to"].map(|name| home.path().join(name));
        fs::write(&from, "12345").unwrap();
        let of = |out: &Path| bytes_to_copy(out, [(from.as_path(), to.as_path())].into_iter());
        assert_eq!(of(&home.path().join("out")), 0);
        // Another disk than any that can be written on.
        assert_eq!(of(Path::new("/proc/out")), 5);
        fs::write(&to, "").unwrap();
        assert_eq!(of(Path::new("/proc/out")), 0);
    }

    #[test]
    fn only_a_full_disk_is_told_as_one() {
        let path = Path::new("/tmp/episode.mcap");
        let full = told_with_room(io::ErrorKind::StorageFull.into(), path, 2_500_000).to_string();
        assert!(full.contains("2.5 MB") && full.contains("episode.mcap"), "{full}");
        let other = told_with_room(io::ErrorKind::PermissionDenied.into(), path, 1);
        assert_eq!(other.kind(), io::ErrorKind::PermissionDenied);
    }
}
