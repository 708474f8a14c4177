//! The mirrors of this process, and what the rest of the program asks by a path: it works on folders, and need not know which
//! of them mirror a URL. For any other path each function here does what the file system does, but opens files alone.
//!
//! This is the one place with process-wide knowledge of URLs. Worker processes have none: they write into the mirror's
//! folder, and their parent puts.

use std::collections::BTreeSet;
use std::fmt;
use std::io;
use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, RwLock};

use fs_err as fs;

use super::bucket::Bucket;
use super::cache;
use super::error::StoreError;
use super::known;
use super::location::{Location, StoreUrl};
use super::mirror::{Access, Mirror, is_lazy, is_partial};
use crate::files;

static MIRRORS: RwLock<Vec<Arc<Mirror>>> = RwLock::new(Vec::new());

/// How often a file is fetched that is evicted before it is opened: another thread's fetch may do that once.
const ATTEMPTS: usize = 4;

/// An opened location: a folder to work on.
#[derive(Clone)]
pub struct OpenedLocation {
    path: PathBuf,
    mirror: Option<Arc<Mirror>>,
}

impl OpenedLocation {
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts what was made here, where this is a URL; a local folder has it already.
    ///
    /// # Errors
    /// Another writer was there, or the store fails.
    pub fn push(&self) -> Result<(), StoreError> {
        self.mirror.as_ref().map_or(Ok(()), |mirror| mirror.push())
    }
}

impl fmt::Debug for OpenedLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OpenedLocation").field(&self.path).finish()
    }
}

impl Location {
    /// Opens it; a URL's small files are fetched, and its mirror stays for the process.
    ///
    /// # Errors
    /// Nothing is there to read, another command of this machine writes there, or the store fails.
    pub fn open(&self, access: Access) -> Result<OpenedLocation, StoreError> {
        match self {
            Self::Local(path) => Ok(OpenedLocation { path: path.clone(), mirror: None }),
            Self::Remote(url) => open_url(url, access),
        }
    }
}

fn open_url(url: &StoreUrl, access: Access) -> Result<OpenedLocation, StoreError> {
    let told = url.to_string();
    let opened = mirrors().into_iter().find(|mirror| mirror.url == told);
    let mirror = match opened {
        Some(mirror) if mirror.access == Access::Write || access == Access::Read => mirror,
        Some(_) => return Err(StoreError::InUse { url: told }),
        None => {
            let cache = cache::folder()?;
            let bound_bytes = cache::bound_bytes()?;
            let mirror = Arc::new(Mirror::open(url, Bucket::open(url)?, &cache, bound_bytes, access)?);
            cache::make_room(&cache, bound_bytes)?;
            MIRRORS.write().expect("no thread panics with it").push(Arc::clone(&mirror));
            mirror
        }
    };
    Ok(OpenedLocation { path: mirror.root.clone(), mirror: Some(mirror) })
}

fn mirrors() -> Vec<Arc<Mirror>> {
    MIRRORS.read().expect("no thread panics with it").clone()
}

/// The mirror that a path lies in, and the path's name in it.
fn of(path: &Path) -> Option<(Arc<Mirror>, String)> {
    let mirrors = MIRRORS.read().expect("no thread panics with it");
    mirrors.iter().find_map(|mirror| {
        let name = path.strip_prefix(&mirror.root).ok()?.to_str()?;
        Some((Arc::clone(mirror), name.to_owned()))
    })
}

/// Opens a file to read; fetches it first, where it lies remotely alone.
///
/// # Errors
/// As `File::open`; it is no file; the store fails.
pub fn open_file(path: &Path) -> io::Result<fs::File> {
    let Some((mirror, name)) = of(path) else { return open_here(path) };
    for _ in 1..ATTEMPTS {
        match open_here(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                if mirror.bring(&name)?.is_none() {
                    return Err(error);
                }
            }
            opened => {
                mirror.note_use(&name);
                return opened;
            }
        }
    }
    open_here(path)
}

/// Opens a file of this machine. For a pipe in its place whoever reads would wait without end.
fn open_here(path: &Path) -> io::Result<fs::File> {
    let kind = match fs::metadata(path) {
        Ok(found) if !found.is_file() => found.file_type(),
        // What cannot be looked at cannot be opened either, and that error says so.
        _ => return fs::File::open(path),
    };
    let found = if kind.is_fifo() {
        "a pipe"
    } else if kind.is_dir() {
        "a folder"
    } else {
        "a device or a socket"
    };
    let text = format!("this is no file: {found}; a file is needed: {}", path.display());
    Err(io::Error::new(io::ErrorKind::InvalidInput, text))
}

/// Lower-case hexadecimal SHA-256 of a file, which is fetched where it lies remotely alone.
///
/// # Errors
/// As [`open_file`].
pub fn sha256_of(path: &Path) -> io::Result<String> {
    files::sha256_of_reader(&mut open_file(path)?)
}

/// Size of a file in bytes, of one that lies remotely alone as the store tells it.
///
/// # Errors
/// There is no such file.
pub fn size_of(path: &Path) -> io::Result<u64> {
    match fs::metadata(path) {
        Ok(metadata) => Ok(metadata.len()),
        Err(error) => {
            let remote = of(path).and_then(|(mirror, name)| {
                mirror.remote.lock().expect("no thread panics with it").get(&name).map(|remote| remote.size)
            });
            remote.ok_or(error)
        }
    }
}

/// Whether there is such a file, here or remotely.
///
/// # Errors
/// The disk does not tell.
pub fn is_there(path: &Path) -> io::Result<bool> {
    let is_remote = |(mirror, name): (Arc<Mirror>, String)| {
        mirror.remote.lock().expect("no thread panics with it").contains_key(&name)
    };
    Ok(files::is_file(path)? || of(path).is_some_and(is_remote))
}

/// The files below a folder, here or remotely, by their paths from it, sorted; not those that are unfinished.
///
/// # Errors
/// The folder cannot be read.
pub fn files_below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut names: BTreeSet<String> =
        known::walk(folder)?.into_keys().filter(|name| !is_partial(name)).collect();
    if let Some((mirror, name)) = of(folder) {
        let below = format!("{name}/");
        let remote = mirror.remote.lock().expect("no thread panics with it");
        names.extend(remote.keys().filter_map(|object| object.strip_prefix(&below)).map(str::to_owned));
    }
    Ok(names.into_iter().map(PathBuf::from).collect())
}

/// Whether there is such a file and it has this content; what lies remotely tells its hash, and is not fetched.
///
/// # Errors
/// The file cannot be read; the store fails.
pub fn has(path: &Path, sha256: &str) -> io::Result<bool> {
    if let Some((mirror, name)) = of(path) {
        return Ok(mirror.has(&name, sha256)?);
    }
    match open_here(path).and_then(|mut file| files::sha256_of_reader(&mut file)) {
        Ok(found) => Ok(found == sha256),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Puts a file under another name too, as [`files::link_or_copy`]; fetches it first, where it lies remotely alone.
///
/// # Errors
/// Any IO error; the store fails.
pub fn link_or_copy(from: &Path, to: &Path) -> io::Result<()> {
    for _ in 1..ATTEMPTS {
        open_file(from)?;
        match files::link_or_copy(from, to) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            linked => return linked,
        }
    }
    files::link_or_copy(from, to)
}

/// Puts a file that was made in a mirror; of any other path nothing is to be done.
///
/// # Errors
/// Another writer was there, or the store fails.
pub fn push_file(path: &Path) -> io::Result<()> {
    of(path).map_or(Ok(()), |(mirror, name)| Ok(mirror.push_file(&name)?))
}

/// Puts all that was made in the mirror that a folder lies in; of any other path nothing is to be done.
///
/// # Errors
/// Another writer was there, or the store fails.
pub fn push(folder: &Path) -> io::Result<()> {
    of(folder).map_or(Ok(()), |(mirror, _)| Ok(mirror.push()?))
}

/// Deletes what lies remotely of a file, or in a folder whose files were deleted here, with the next push, after what is put by it.
pub fn discard(path: &Path) {
    let Some((mirror, name)) = of(path) else { return };
    let below = format!("{name}/");
    let remote = mirror.remote.lock().expect("no thread panics with it");
    let is_doomed = |object: &&String| (object.starts_with(&below) || **object == name) && is_lazy(object);
    let doomed = remote.keys().filter(is_doomed).cloned();
    mirror.doomed.lock().expect("no thread panics with it").extend(doomed);
}

/// What people call a path: a URL, where it lies in a mirror.
#[must_use]
pub fn name_of(path: &Path) -> PathBuf {
    match of(path) {
        Some((mirror, name)) if name.is_empty() => mirror.url.clone().into(),
        Some((mirror, name)) => format!("{}/{name}", mirror.url).into(),
        None => path.to_owned(),
    }
}

/// A text with URLs in place of the folders that mirror them.
#[must_use]
pub fn with_urls(text: &str) -> String {
    mirrors().iter().fold(text.to_owned(), |text, mirror| match mirror.root.to_str() {
        Some(root) => text.replace(root, &mirror.url),
        None => text,
    })
}
