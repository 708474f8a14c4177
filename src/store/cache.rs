//! Where mirrors lie, and how much room they may take.

use std::path::{Path, PathBuf};

use fs_err as fs;

use super::error::StoreError;
use super::known;

/// Of fetched episodes and labels: a data set of some ten thousand samples.
const DEFAULT_GIB: f64 = 20.0;

/// `HARMZONE_CACHE`, else the user's cache.
pub(super) fn folder() -> Result<PathBuf, StoreError> {
    let named = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let own = named("HARMZONE_CACHE");
    let of_user = || named("XDG_CACHE_HOME").or_else(|| Some(named("HOME")?.join(".cache")));
    let folder = own.or_else(|| Some(of_user()?.join("harmzone/store")));
    folder.ok_or(StoreError::NoCache)
}

/// `HARMZONE_CACHE_GIB`.
pub(super) fn bound_bytes() -> Result<u64, StoreError> {
    const NAME: &str = "HARMZONE_CACHE_GIB";
    let gib = match std::env::var(NAME) {
        Err(_) => DEFAULT_GIB,
        Ok(text) => match text.parse::<f64>() {
            Ok(gib) if gib > 0.0 && gib.is_finite() => gib,
            _ => return Err(StoreError::Environment { name: NAME, found: text, valid: "a number above 0" }),
        },
    };
    Ok((gib * f64::from(1 << 30)) as u64)
}

/// Deletes mirrors that no process has open, the longest unused first, until all together are within the bound.
pub(super) fn make_room(cache: &Path, bound_bytes: u64) -> Result<(), StoreError> {
    let mut homes = Vec::new();
    for entry in fs::read_dir(cache)? {
        let home = entry?.path();
        let lock = home.join("lock");
        // Whatever else lies there is not ours.
        let Ok(used) = fs::metadata(home.join("url.txt")).and_then(|of| of.modified()) else { continue };
        let bytes: u64 = known::walk(&home)?.values().map(|found| found.size).sum();
        homes.push((used, home, lock, bytes));
    }
    homes.sort();
    let mut bytes: u64 = homes.iter().map(|(.., bytes)| bytes).sum();
    for (_, home, lock, of_home) in homes {
        if bytes <= bound_bytes {
            break;
        }
        let lock = fs::OpenOptions::new().append(true).open(lock)?;
        // Nobody has it open: what it holds lies remotely, or was never put and is made again.
        if lock.try_lock().is_ok() {
            fs::remove_dir_all(&home)?;
            bytes -= of_home;
        }
    }
    Ok(())
}
