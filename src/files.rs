//! Files and folders that are either whole or not there: written under a temporary name, then renamed.

mod content;
mod folder;
mod inside;
mod lock;
mod name;
mod seal;
mod space;

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use fs_err as fs;
use sha2::{Digest, Sha256};
use tempfile::TempPath;

pub use content::FolderContent;
pub use folder::{FolderError, NewFolder};
pub use inside::{OutsideName, inside, is_file_name, is_inside};
pub use lock::{FolderLock, is_lock};
pub(crate) use name::{give_final_name, keep_as};
pub use seal::{is_sealed, read_sealed, seal, seal_result, unseal, write_manifest, write_sealed};
pub use space::{bytes_in_words, bytes_to_copy, check_room, free_bytes, told_with_room};

/// Suffix of files that are still being written; a leftover may be deleted at any time.
pub const PARTIAL_SUFFIX: &str = "partial";
/// Suffixes of the files that are written so.
const OUR_SUFFIXES: [&str; 10] =
    ["mcap", "json", "toml", "csv", "safetensors", "bpk", "png", "svg", "html", "rrd"];

/// Writes a file whole or not at all: to `<path>.partial`, synced, then renamed over `path`, and the name synced, too. Of two
/// processes that write one file at a time the second waits.
///
/// # Errors
/// Any IO error, among them a full disk; the partial file is removed then.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut partial_name = path.as_os_str().to_owned();
    partial_name.push(".");
    partial_name.push(PARTIAL_SUFFIX);
    let partial = TempPath::try_from_path(partial_name)?;
    let write = || -> io::Result<()> {
        let mut file = lock::open_alone(&partial)?;
        file.set_len(0)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        keep_as(partial, path)
    };
    write().map_err(|error| told_with_room(error, path, bytes.len() as u64))
}

/// Makes a file that is still to get its name, or empties the one that is there; a link in its place is deleted.
///
/// # Errors
/// Any IO error.
pub(crate) fn create_partial(path: &Path) -> io::Result<fs::File> {
    let file = lock::open_own(path)?;
    file.set_len(0)?;
    Ok(file)
}

/// Whether a folder holds anything but unfinished files; one that is not there does not.
///
/// # Errors
/// It cannot be read.
pub fn holds_anything(folder: &Path) -> io::Result<bool> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        entries => entries?,
    };
    for entry in entries {
        if Path::new(&entry?.file_name()).extension().is_none_or(|suffix| suffix != PARTIAL_SUFFIX) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether a file is there. Unlike `Path::is_file`, a disk that does not answer is an error, and no file that is absent.
///
/// # Errors
/// It cannot be told.
pub fn is_file(path: &Path) -> io::Result<bool> {
    match fs::metadata(path) {
        Ok(found) => Ok(found.is_file()),
        Err(error) if is_absence(&error) => Ok(false),
        Err(error) => Err(error),
    }
}

/// Whether a folder is there, links followed; as [`is_file`].
///
/// # Errors
/// It cannot be told.
pub fn is_dir(path: &Path) -> io::Result<bool> {
    match fs::metadata(path) {
        Ok(found) => Ok(found.is_dir()),
        Err(error) if is_absence(&error) => Ok(false),
        Err(error) => Err(error),
    }
}

/// Whether anything is there, links followed; as [`is_file`].
///
/// # Errors
/// It cannot be told.
pub fn is_there(path: &Path) -> io::Result<bool> {
    match fs::metadata(path) {
        Ok(_) => Ok(true),
        Err(error) if is_absence(&error) => Ok(false),
        Err(error) => Err(error),
    }
}

fn is_absence(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// The first of some paths at which anything is.
///
/// # Errors
/// As of [`is_there`].
pub fn first_there(paths: impl IntoIterator<Item = PathBuf>) -> io::Result<Option<PathBuf>> {
    for path in paths {
        if is_there(&path)? {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// Whether an error comes of the system and not of what a file holds: the disk does not answer, there is no memory, a file may not be
/// opened. What is not there is no such error.
#[must_use]
pub fn is_of_system(error: &(dyn std::error::Error + 'static)) -> bool {
    let of_system = |error: &(dyn std::error::Error + 'static)| {
        let error = error.downcast_ref::<io::Error>()?;
        // Of one that tells the path, too, `fs_err` keeps the number in its words alone.
        let has_number = error.raw_os_error().is_some() || error.to_string().contains("(os error ");
        has_number.then(|| !is_absence(error))
    };
    std::iter::successors(Some(error), |error| error.source()).find_map(of_system).unwrap_or(false)
}

/// Whether a file is one that a run left unfinished, or is still writing, by its name: that of one of our files, a number of the
/// writer where several may write, and the suffix. Others have files of this suffix, too.
#[must_use]
pub fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut parts = name.rsplit('.').peekable();
    let has_suffix = parts.next() == Some(PARTIAL_SUFFIX);
    let is_number = |part: &&str| part.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-');
    parts.next_if(is_number);
    let is_ours = parts.next().is_some_and(|suffix| OUR_SUFFIXES.contains(&suffix));
    has_suffix && is_ours && parts.next().is_some_and(|stem| !stem.is_empty())
}

/// Deletes files that a killed process left unfinished in a folder, whose lock is held, but not those in other folders.
///
/// # Errors
/// One cannot be deleted.
pub fn remove_unfinished(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if !is_unfinished(&path) || is_folder(&path) {
            continue;
        }
        // A worker of a killed run may end now and delete its own files.
        remove_if_there(&path)?;
    }
    Ok(())
}

/// Whether a folder lies there, and no link to one.
fn is_folder(path: &Path) -> bool {
    path.is_dir() && !path.is_symlink()
}

/// Deletes the folders under partial names that a killed process left in a folder of ours; nothing where that is a link.
///
/// # Errors
/// One cannot be deleted.
pub fn remove_unfinished_folders(folder: &Path) -> io::Result<()> {
    if !is_folder(folder) {
        return Ok(());
    }
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|suffix| suffix == PARTIAL_SUFFIX) && is_folder(&path) {
            match fs::remove_dir_all(&path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                other => other?,
            }
        }
    }
    Ok(())
}

/// Puts a file under another name too: a second name where both are on one disk, else a copy; what lies there already is
/// replaced. Of a symbolic link it is what the link leads to.
///
/// # Errors
/// Any IO error.
pub fn link_or_copy(from: &Path, to: &Path) -> io::Result<()> {
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder)?;
    }
    let mut partial = to.as_os_str().to_owned();
    partial.push(format!(".{PARTIAL_SUFFIX}"));
    let partial = PathBuf::from(partial);
    remove_if_there(&partial)?;
    if fs::canonicalize(from).and_then(|from| fs::hard_link(from, &partial)).is_err() {
        fs::copy(from, &partial)?;
        fs::File::open(&partial)?.sync_all()?;
    }
    give_final_name(&partial, to)?;
    // Renaming one link of a file over another does nothing, and leaves the first.
    remove_if_there(&partial)
}

/// Removes a file, which may be gone already.
///
/// # Errors
/// Any other IO error.
pub fn remove_if_there(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Lower-case hexadecimal SHA-256 of some bytes.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Lower-case hexadecimal SHA-256 of a file, which is read part by part.
///
/// # Errors
/// The file cannot be read.
pub fn sha256_of(path: &Path) -> io::Result<String> {
    sha256_of_reader(&mut fs::File::open(path)?)
}

/// Lower-case hexadecimal SHA-256 of what is left to read.
///
/// # Errors
/// It cannot be read.
pub fn sha256_of_reader(file: &mut impl Read) -> io::Result<String> {
    let mut hasher = Sha256::new();
    let mut part = vec![0; 1 << 20];
    loop {
        match file.read(&mut part)? {
            0 => return Ok(hex(&hasher.finalize())),
            n_read => hasher.update(&part[..n_read]),
        }
    }
}

/// Lower-case hexadecimal digits of a digest.
pub(crate) fn hex(digest: &[u8]) -> String {
    use std::fmt::Write as _;
    digest.iter().fold(String::with_capacity(64), |mut hex, byte| {
        write!(hex, "{byte:02x}").expect("writing to a string cannot fail");
        hex
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_the_system_are_told_from_those_of_what_a_file_holds() {
        let home = tempfile::tempdir().unwrap();
        let of_folder = fs::read(home.path()).unwrap_err();
        assert!(of_folder.raw_os_error().is_none() && is_of_system(&of_folder), "{of_folder}");
        assert!(is_of_system(&io::Error::from_raw_os_error(5)));
        assert!(!is_of_system(&fs::read(home.path().join("absent")).unwrap_err()));
        assert!(!is_of_system(&io::Error::new(io::ErrorKind::InvalidData, "a torn file")));
    }

    #[test]
    fn a_write_into_a_missing_folder_fails_and_names_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("absent/file.json");
        let error = write_atomic(&path, b"{}").unwrap_err();
        assert!(error.to_string().contains("absent"), "{error}");
    }

    #[test]
    fn a_write_replaces_the_file_and_leaves_no_partial() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.json");
        write_atomic(&path, b"old").unwrap();
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn links_are_not_written_through_and_what_they_lead_to_gets_the_second_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("precious"), "mine").unwrap();
        std::os::unix::fs::symlink("precious", at("file.json.partial")).unwrap();
        write_atomic(&at("file.json"), b"new").unwrap();
        assert_eq!(
            (fs::read(at("file.json")).unwrap(), fs::read(at("precious")).unwrap()),
            (b"new".to_vec(), b"mine".to_vec())
        );
        std::os::unix::fs::symlink("precious", at("made.partial")).unwrap();
        drop(create_partial(&at("made.partial")).unwrap());
        assert_eq!(fs::read(at("precious")).unwrap(), b"mine");
        std::os::unix::fs::symlink("precious", at("link")).unwrap();
        link_or_copy(&at("link"), &at("below/second")).unwrap();
        assert!(!at("below/second").is_symlink());
        assert_eq!(fs::read(at("below/second")).unwrap(), b"mine");
    }

    #[test]
    fn of_unfinished_files_ours_are_deleted_and_those_of_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let ours = ["dataset.json.partial", "a.b.mcap.812.partial", "x.mcap.8-2.partial"].map(at);
        let others = ["film.partial", "a.7.partial", ".json.partial", "notes.json", "writer.partial"].map(at);
        ours.iter().chain(&others).for_each(|file| fs::write(file, "").unwrap());
        fs::create_dir(at("folder.json.partial")).unwrap();
        remove_unfinished(folder.path()).unwrap();
        assert!(ours.iter().all(|file| !file.exists()));
        assert!(others.iter().all(|file| file.exists()) && at("folder.json.partial").exists());
        remove_unfinished_folders(folder.path()).unwrap();
        assert!(others.iter().all(|file| file.exists()) && !at("folder.json.partial").exists());
    }

    #[test]
    fn of_two_writers_each_writes_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file.json");
        let texts = [vec![1; 300_000], vec![2; 200_000]];
        std::thread::scope(|scope| {
            for text in &texts {
                let path = &path;
                scope.spawn(move || (0..20).for_each(|_| write_atomic(path, text).unwrap()));
            }
            for _ in 0..200 {
                let found = fs::read(&path).unwrap_or_else(|_| texts[0].clone());
                assert!(texts.contains(&found), "{} bytes", found.len());
            }
        });
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn the_hash_of_nothing_is_the_published_one() {
        assert_eq!(sha256_hex(b"")[..16], *"e3b0c44298fc1c14");
        let folder = tempfile::tempdir().unwrap();
        let (path, bytes) = (folder.path().join("file"), vec![7; (1 << 20) + 5]);
        write_atomic(&path, &bytes).unwrap();
        assert_eq!(sha256_of(&path).unwrap(), sha256_hex(&bytes));
    }
}
