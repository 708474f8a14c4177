//! A URL's working folder on this machine: small files come when it is opened, episodes and labels when they are read, and
//! what was made here goes back by a push.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use fs_err as fs;
use futures_util::{StreamExt, TryStreamExt, stream};

use super::bucket::{Bucket, Remote, runtime};
use super::error::StoreError;
use super::known::{self, Found, Known};
use super::location::StoreUrl;
use crate::files::{PARTIAL_SUFFIX, is_inside, remove_if_there, sha256_hex, sha256_of};

/// Requests under way at once.
pub(super) const AT_ONCE: usize = 8;

/// What a command does with what a URL names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// It reads. Several processes may, side by side.
    Read,
    /// It writes, and there may be nothing yet. One process of a machine may.
    Write,
}

/// A URL and its folder here.
pub(super) struct Mirror {
    pub url: String,
    /// The files, in a folder of the URL's last name.
    pub root: PathBuf,
    pub bucket: Bucket,
    pub access: Access,
    /// What lies remotely, as far as this process heard.
    pub remote: Mutex<BTreeMap<String, Remote>>,
    /// Those of them that lay there when this was opened, and were not put since.
    pub listed: Mutex<BTreeSet<String>>,
    pub known: Mutex<BTreeMap<String, Known>>,
    known_path: PathBuf,
    /// When files were last opened, in the order of all openings.
    used: Mutex<BTreeMap<String, u64>>,
    /// Of fetched files that stay until they are evicted.
    held_bytes: AtomicU64,
    bound_bytes: u64,
    /// Objects that are deleted once what replaces them is put.
    pub doomed: Mutex<BTreeSet<String>>,
    pub is_pushing: Mutex<()>,
    /// Locked as long as this lives.
    _lock: fs::File,
}

/// Whether a file comes only when it is read.
pub(super) fn is_lazy(name: &str) -> bool {
    matches!(Path::new(name).extension().and_then(|suffix| suffix.to_str()), Some("mcap" | "exr"))
}

/// Whether a reader has a use for it: states of a training are for who goes on with it.
fn is_wanted(name: &str, access: Access) -> bool {
    access == Access::Write || !name.starts_with("state/")
}

pub(super) fn is_partial(name: &str) -> bool {
    name.split('/').any(|part| part.ends_with(&format!(".{PARTIAL_SUFFIX}")))
}

impl Mirror {
    /// Makes the folder what lies remotely, bar what comes when it is read: remote is the truth, and what a killed command left here
    /// without putting it is deleted.
    pub(super) fn open(
        url: &StoreUrl,
        bucket: Bucket,
        cache: &Path,
        bound_bytes: u64,
        access: Access,
    ) -> Result<Self, StoreError> {
        let told = url.to_string();
        let home = cache.join(&sha256_hex(told.as_bytes())[..24]);
        let root = home.join(url.path.rsplit('/').next().expect("a path has a last part"));
        fs::create_dir_all(&root)?;
        let root = fs::canonicalize(root)?;
        let lock = fs::OpenOptions::new().create(true).append(true).open(home.join("lock"))?;
        let locked = match access {
            Access::Read => lock.try_lock_shared(),
            Access::Write => lock.try_lock(),
        };
        locked.map_err(io::Error::from).map_err(|error| match error.kind() {
            io::ErrorKind::WouldBlock => StoreError::InUse { url: told.clone() },
            _ => error.into(),
        })?;
        fs::write(home.join("url.txt"), &told)?;
        let remote = runtime().block_on(bucket.list())?;
        if remote.is_empty() && access == Access::Read {
            return Err(StoreError::Nothing { url: told });
        }
        let known_path = home.join("known.jsonl");
        let remote: BTreeMap<String, Remote> =
            remote.into_iter().filter(|(name, _)| is_inside(name)).collect();
        let mirror = Self {
            url: told,
            root,
            bucket,
            access,
            known: Mutex::new(known::read(&known_path)?),
            known_path,
            listed: Mutex::new(remote.keys().cloned().collect()),
            remote: Mutex::new(remote),
            used: Mutex::default(),
            held_bytes: AtomicU64::new(0),
            bound_bytes,
            doomed: Mutex::default(),
            is_pushing: Mutex::default(),
            _lock: lock,
        };
        mirror.keep_what_is_current()?;
        mirror.fetch_small_files()?;
        Ok(mirror)
    }

    /// Deletes what is not as it lies remotely.
    fn keep_what_is_current(&self) -> Result<(), StoreError> {
        for (name, found) in known::walk(&self.root)? {
            // Another reader may be fetching it.
            if is_partial(&name) && self.access == Access::Read {
                continue;
            }
            if !self.is_current(&name, &found) {
                remove_if_there(&self.root.join(&name))?;
            } else if is_lazy(&name) {
                self.held_bytes.fetch_add(found.size, Ordering::Relaxed);
            }
        }
        // What is known of files that are here saves a question of the store.
        let known = self.known.lock().expect("no thread panics with it");
        for (name, remote) in self.remote.lock().expect("no thread panics with it").iter_mut() {
            if let Some(known) =
                known.get(name).filter(|known| known.e_tag == remote.e_tag && known.e_tag.is_some())
            {
                remote.sha256 = Some(known.sha256.clone());
            }
        }
        Ok(())
    }

    /// Whether a file here is the object as this process last heard of it.
    pub(super) fn is_current(&self, name: &str, found: &Found) -> bool {
        let known = self.known.lock().expect("no thread panics with it");
        let remote = self.remote.lock().expect("no thread panics with it");
        let Some((known, remote)) = known.get(name).zip(remote.get(name)) else { return false };
        found.is(known) && known.e_tag.is_some() && known.e_tag == remote.e_tag && known.size == remote.size
    }

    fn fetch_small_files(&self) -> Result<(), StoreError> {
        let names: Vec<String> = {
            let remote = self.remote.lock().expect("no thread panics with it");
            let is_missing = |name: &str| !self.root.join(name).is_file();
            let wanted = |name: &&String| !is_lazy(name) && is_wanted(name, self.access) && is_missing(name);
            remote.keys().filter(wanted).cloned().collect()
        };
        let fetches = stream::iter(&names).map(|name| self.fetch_one(name)).buffer_unordered(AT_ONCE);
        runtime().block_on(fetches.try_collect::<()>())
    }

    async fn fetch_one(&self, name: &str) -> Result<(), StoreError> {
        let path = self.root.join(name);
        let remote = self.bucket.fetch(name, &path).await?;
        self.note(name, &remote)?;
        Ok(())
    }

    /// Notes that a file here is this object.
    pub(super) fn note(&self, name: &str, remote: &Remote) -> Result<(), StoreError> {
        let Ok(found) = Found::at(&self.root.join(name)) else { return Ok(()) };
        if is_lazy(name) {
            self.held_bytes.fetch_add(found.size, Ordering::Relaxed);
        }
        let sha256 = remote.sha256.clone().unwrap_or_default();
        let known = Known {
            file: name.to_owned(),
            e_tag: remote.e_tag.clone(),
            size: remote.size,
            sha256,
            modified_ns: found.modified_ns,
        };
        known::add(&self.known_path, &known)?;
        self.known.lock().expect("no thread panics with it").insert(name.to_owned(), known);
        self.remote.lock().expect("no thread panics with it").insert(name.to_owned(), remote.clone());
        Ok(())
    }

    /// Fetches a file that is not here; `None` where it does not lie remotely either.
    pub(super) fn bring(&self, name: &str) -> Result<Option<()>, StoreError> {
        if !self.remote.lock().expect("no thread panics with it").contains_key(name) {
            return Ok(None);
        }
        runtime().block_on(self.fetch_one(name))?;
        if self.held_bytes.load(Ordering::Relaxed) > self.bound_bytes {
            self.evict(name)?;
        }
        Ok(Some(()))
    }

    /// Notes that a file is opened just now.
    pub(super) fn note_use(&self, name: &str) {
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        self.used.lock().expect("no thread panics with it").insert(name.to_owned(), number);
    }

    /// Deletes fetched files, the longest unused first, until the rest is within the bound; not `newest`, nor what was made here and
    /// not put yet. A file that is open stays readable for who opened it.
    fn evict(&self, newest: &str) -> Result<(), StoreError> {
        let used = self.used.lock().expect("no thread panics with it").clone();
        let mut held: Vec<(u64, u64, String, u64)> = known::walk(&self.root)?
            .into_iter()
            .filter(|(name, found)| is_lazy(name) && self.is_current(name, found))
            .map(|(name, found)| (used.get(&name).copied().unwrap_or(0), found.modified_ns, name, found.size))
            .collect();
        held.sort();
        let mut bytes: u64 = held.iter().map(|(.., size)| size).sum();
        for (_, _, name, size) in held.iter().filter(|(_, _, name, _)| name != newest) {
            if bytes <= self.bound_bytes {
                break;
            }
            remove_if_there(&self.root.join(name))?;
            bytes -= size;
        }
        self.held_bytes.store(bytes, Ordering::Relaxed);
        Ok(())
    }

    /// Whether the object, or the file here, has this content; an object that is not here is not fetched.
    pub(super) fn has(&self, name: &str, sha256: &str) -> Result<bool, StoreError> {
        let path = self.root.join(name);
        if let Ok(found) = Found::at(&path)
            && !self.is_current(name, &found)
        {
            return Ok(sha256_of(&path)? == sha256);
        }
        let Some(mut remote) = self.remote.lock().expect("no thread panics with it").get(name).cloned()
        else {
            return Ok(false);
        };
        if remote.sha256.is_none() {
            match runtime().block_on(self.bucket.look_up(name))? {
                Some(found) => remote = found,
                None => return Ok(false),
            }
            self.remote.lock().expect("no thread panics with it").insert(name.to_owned(), remote.clone());
        }
        if remote.sha256.is_some() {
            return Ok(remote.sha256.as_deref() == Some(sha256));
        }
        // Another program put it, without a hash.
        self.bring(name)?;
        Ok(sha256_of(&path)? == sha256)
    }
}
