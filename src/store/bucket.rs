//! One URL's objects: listed, fetched, put on conditions, deleted. What the crate `object_store` does not do by itself is
//! here: objects carry their SHA-256, and a conditional put whose answer was lost is looked up before it is called failed.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path as FilePath;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fs_err as fs;
use futures_util::TryStreamExt;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::path::Path;
use object_store::{
    Attribute, Attributes, Error, GetOptions, GetResult, ObjectStore, ObjectStoreExt, PutMode,
    PutMultipartOptions, PutOptions, PutPayload, RetryConfig, UpdateVersion, WriteMultipart,
};
use sha2::{Digest, Sha256};
use tokio::runtime::{Builder, Runtime};

use super::error::{Answer, StoreError};
use super::location::{Provider, StoreUrl};
use super::process::OfProcess;
use crate::files::{PARTIAL_SUFFIX, hex, keep_as};

/// Files of this size and more go up in parts, whose put knows no condition; `HARMZONE_STORE_PARTS_FROM_MIB` has another.
const PARTS_FROM_MIB: u64 = 64;
/// The stores want at least 5 MiB, and at most 10,000 parts.
const PART_BYTES: usize = 16 << 20;
/// Parts of one file under way.
const PARTS_AT_ONCE: usize = 4;
/// How often a conditional put is sent whose answer is lost; the connection breaks so often in a row by no chance.
const SENDINGS: usize = 4;

/// A request that took longer was sent again by `object_store`, in vain.
const REPEATED_WITHIN: Duration = Duration::from_secs(30);

/// What an object's SHA-256 is called in its metadata.
const SHA256: &str = "sha256";

/// An object as it lies remotely.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Remote {
    pub e_tag: Option<String>,
    version: Option<String>,
    pub size: u64,
    /// `None`: not asked for yet, or another program put it.
    pub sha256: Option<String>,
}

/// What must lie under a name for a put to count.
#[derive(Debug, Clone)]
pub(super) enum Expected {
    Nothing,
    This(Remote),
}

/// What is put.
#[derive(Debug, Clone, Copy)]
pub(super) struct Content<'a> {
    pub file: &'a FilePath,
    pub size: u64,
    pub sha256: &'a str,
}

/// Runs what object storage does; the rest of the program knows no async.
pub(super) fn runtime() -> Arc<Runtime> {
    static RUNTIME: OfProcess<Runtime> = OfProcess::new(None);
    let made = RUNTIME.get(|| {
        let mut builder = Builder::new_multi_thread();
        builder.worker_threads(2).thread_name("store").enable_io().enable_time();
        builder.build().map(Arc::new)
    });
    made.expect("a process may start two threads")
}

/// The objects below a URL.
pub(super) struct Bucket {
    /// The runtime drives its connections.
    store: OfProcess<dyn ObjectStore>,
    url: StoreUrl,
    parts_from_bytes: u64,
}

/// A whole number of the environment.
fn number_of(name: &'static str, default: u64) -> Result<u64, StoreError> {
    match std::env::var(name) {
        Err(_) => Ok(default),
        Ok(text) => {
            text.parse().map_err(|_| StoreError::Environment { name, found: text, valid: "a whole number" })
        }
    }
}

/// Reads credentials and options from the environment, as `object_store` does; asks no server.
fn connect(url: &StoreUrl) -> Result<Arc<dyn ObjectStore>, StoreError> {
    // A second mirror finds it installed.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let retry = RetryConfig {
        max_retries: number_of("HARMZONE_STORE_RETRIES", 10)? as usize,
        retry_timeout: Duration::from_secs(number_of("HARMZONE_STORE_RETRY_S", 180)?),
        ..RetryConfig::default()
    };
    let bucket = &url.bucket;
    let built: Result<Arc<dyn ObjectStore>, Error> = match url.scheme {
        Provider::S3 => AmazonS3Builder::from_env()
            .with_bucket_name(bucket)
            .with_retry(retry)
            .build()
            .map(|store| Arc::new(store) as _),
        Provider::Google => GoogleCloudStorageBuilder::from_env()
            .with_bucket_name(bucket)
            .with_retry(retry)
            .build()
            .map(|store| Arc::new(store) as _),
        Provider::Azure => MicrosoftAzureBuilder::from_env()
            .with_container_name(bucket)
            .with_retry(retry)
            .build()
            .map(|store| Arc::new(store) as _),
    };
    built.map_err(|error| StoreError::Failed {
        doing: "open the store",
        reason: Answer::of(&error).reason_before_requests(url.scheme.variables()),
        url: url.to_string(),
    })
}

impl Bucket {
    /// Asks no server.
    pub(super) fn open(url: &StoreUrl) -> Result<Self, StoreError> {
        let parts_from_mib = number_of("HARMZONE_STORE_PARTS_FROM_MIB", PARTS_FROM_MIB)?;
        let (store, url) = (OfProcess::new(None), url.clone());
        let bucket = Self { store, url, parts_from_bytes: parts_from_mib.saturating_mul(1 << 20) };
        bucket.store().map(|_| bucket)
    }

    #[cfg(test)]
    pub(super) fn of(store: Arc<dyn ObjectStore>, url: &StoreUrl) -> Self {
        let store = OfProcess::new(Some((std::process::id(), store)));
        Self { store, url: url.clone(), parts_from_bytes: PARTS_FROM_MIB << 20 }
    }

    fn store(&self) -> Result<Arc<dyn ObjectStore>, StoreError> {
        self.store.get(|| connect(&self.url))
    }

    pub(super) fn url_of(&self, name: &str) -> String {
        format!("{}/{name}", self.url)
    }

    fn path(&self, name: &str) -> Path {
        Path::from(format!("{}/{name}", self.url.path))
    }

    fn failed(url: &StoreUrl, doing: &'static str, error: &Error, name: Option<&str>) -> StoreError {
        let reason = Answer::of(error).reason(url.scheme.variables());
        let url = name.map_or_else(|| url.to_string(), |name| format!("{url}/{name}"));
        StoreError::Failed { doing, reason, url }
    }

    fn fail(&self, doing: &'static str, error: &Error, name: &str) -> StoreError {
        Self::failed(&self.url, doing, error, Some(name))
    }

    /// All objects by their names below the URL.
    pub(super) async fn list(&self) -> Result<BTreeMap<String, Remote>, StoreError> {
        let prefix = Path::from(self.url.path.as_str());
        let inside = format!("{prefix}/");
        let store = self.store()?;
        let listed = repeat(async || store.list(Some(&prefix)).try_collect::<Vec<_>>().await);
        let metas =
            listed.await.map_err(|error| Self::failed(&self.url, "list the objects", &error, None))?;
        let named = metas.into_iter().filter_map(|meta| {
            let name = meta.location.as_ref().strip_prefix(&inside)?.to_owned();
            // Programs that show folders put empty objects for them.
            (!name.is_empty() && !name.ends_with('/')).then_some((
                name,
                Remote { e_tag: meta.e_tag, version: meta.version, size: meta.size, sha256: None },
            ))
        });
        Ok(named.collect())
    }

    /// What lies under a name, with its SHA-256.
    pub(super) async fn look_up(&self, name: &str) -> Result<Option<Remote>, StoreError> {
        let options = GetOptions { head: true, ..GetOptions::default() };
        match self.store()?.get_opts(&self.path(name), options).await {
            Ok(found) => Ok(Some(remote(&found))),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.fail("look an object up", &error, name)),
        }
    }

    /// Fetches an object to a file, whole or not at all; tells what came.
    pub(super) async fn fetch(&self, name: &str, to: &FilePath) -> Result<Remote, StoreError> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let fail = |error: Error| self.fail("fetch an object", &error, name);
        let found = self.store()?.get(&self.path(name)).await.map_err(fail)?;
        let mut remote = remote(&found);
        if let Some(folder) = to.parent() {
            fs::create_dir_all(folder)?;
        }
        // Other threads and processes may fetch the same.
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut partial = to.as_os_str().to_owned();
        partial.push(format!(".{}-{number}.{PARTIAL_SUFFIX}", std::process::id()));
        let partial = tempfile::TempPath::try_from_path(partial)?;
        let mut file = fs::File::create(&partial)?;
        let (mut hasher, mut size) = (Sha256::new(), 0);
        let mut stream = found.into_stream();
        while let Some(part) = stream.try_next().await.map_err(fail)? {
            hasher.update(&part);
            size += part.len() as u64;
            file.write_all(&part)?;
        }
        let sha256 = hex(&hasher.finalize());
        let torn = |found: String, wanted: String| StoreError::Torn { found, wanted, url: self.url_of(name) };
        if size != remote.size {
            return Err(torn(format!("{size} bytes"), format!("{} bytes", remote.size)));
        }
        if let Some(wanted) = remote.sha256.filter(|wanted| *wanted != sha256) {
            return Err(torn(format!("a file of hash {sha256}"), format!("one of {wanted}")));
        }
        file.sync_all()?;
        keep_as(partial, to)?;
        remote.sha256 = Some(sha256);
        Ok(remote)
    }

    /// Puts a file under a name, if what is expected lies there. The very same content counts as put.
    ///
    /// A put whose answer is lost may have counted: the object's hash tells. `object_store` sends one again only without
    /// a condition.
    pub(super) async fn put(
        &self,
        name: &str,
        content: Content<'_>,
        expected: &Expected,
    ) -> Result<Remote, StoreError> {
        let goes_in_parts = content.size >= self.parts_from_bytes;
        let mut is_unsent = goes_in_parts;
        for sending in 1.. {
            let error = if is_unsent {
                None
            } else if goes_in_parts {
                match self.put_in_parts(name, content).await? {
                    Ok(remote) => return Ok(remote),
                    Err(error) => Some(error),
                }
            } else {
                match self.put_at_once(name, content, expected).await? {
                    Ok(remote) => return Ok(remote),
                    Err(error) => Some(error),
                }
            };
            is_unsent = false;
            let is_taken = matches!(
                error,
                Some(Error::AlreadyExists { .. } | Error::Precondition { .. } | Error::NotModified { .. })
            );
            let is_open = error.as_ref().is_none_or(|error| is_taken || Answer::of(error).is_lost());
            if let Some(error) = error.as_ref().filter(|_| !is_open) {
                return Err(self.fail("put an object", error, name));
            }
            let found = self.look_up(name).await?;
            if let Some(found) = &found
                && found.size == content.size
                && found.sha256.as_deref() == Some(content.sha256)
            {
                return Ok(found.clone());
            }
            let is_as_expected = match (expected, &found) {
                (Expected::Nothing, None) => true,
                (Expected::This(wanted), Some(found)) => wanted.e_tag == found.e_tag,
                _ => false,
            };
            match (error, expected) {
                (Some(error), _) if is_as_expected && sending >= SENDINGS => {
                    return Err(self.fail("put an object", &error, name));
                }
                _ if is_as_expected => {}
                (_, Expected::Nothing) => return Err(StoreError::Taken { url: self.url_of(name) }),
                (_, Expected::This(_)) => return Err(StoreError::Changed { url: self.url_of(name) }),
            }
        }
        unreachable!("the loop ends by a return")
    }

    async fn put_at_once(
        &self,
        name: &str,
        content: Content<'_>,
        expected: &Expected,
    ) -> Result<Result<Remote, Error>, StoreError> {
        let mode = match expected {
            Expected::Nothing => PutMode::Create,
            Expected::This(remote) => {
                let mut remote = remote.clone();
                // Google's condition is by a number that its lists do not tell.
                if self.url.scheme == Provider::Google && remote.version.is_none() {
                    match self.look_up(name).await? {
                        Some(found) if found.e_tag == remote.e_tag => remote = found,
                        _ => return Err(StoreError::Changed { url: self.url_of(name) }),
                    }
                }
                PutMode::Update(UpdateVersion { e_tag: remote.e_tag, version: remote.version })
            }
        };
        let bytes = fs::read(content.file)?;
        let options = PutOptions { mode, attributes: attributes(content.sha256), ..PutOptions::default() };
        let put = self.store()?.put_opts(&self.path(name), PutPayload::from(bytes), options).await;
        Ok(put.map(|put| Remote {
            e_tag: put.e_tag,
            version: put.version,
            size: content.size,
            sha256: Some(content.sha256.to_owned()),
        }))
    }

    async fn put_in_parts(
        &self,
        name: &str,
        content: Content<'_>,
    ) -> Result<Result<Remote, Error>, StoreError> {
        let options =
            PutMultipartOptions { attributes: attributes(content.sha256), ..PutMultipartOptions::default() };
        let upload = match self.store()?.put_multipart_opts(&self.path(name), options).await {
            Ok(upload) => upload,
            Err(error) => return Ok(Err(error)),
        };
        let mut upload = WriteMultipart::new_with_chunk_size(upload, PART_BYTES);
        let mut file = fs::File::open(content.file)?;
        let mut part = vec![0; PART_BYTES];
        loop {
            let n_read = match file.read(&mut part) {
                Ok(n_read) => n_read,
                Err(error) => {
                    // The parts would stay and cost; the reading's error is the one to tell.
                    let _ = upload.abort().await;
                    return Err(error.into());
                }
            };
            if n_read == 0 {
                break;
            }
            if let Err(error) = upload.wait_for_capacity(PARTS_AT_ONCE).await {
                let _ = upload.abort().await;
                return Ok(Err(error));
            }
            upload.write(&part[..n_read]);
        }
        // Aborts by itself where it fails.
        Ok(upload.finish().await.map(|put| Remote {
            e_tag: put.e_tag,
            version: put.version,
            size: content.size,
            sha256: Some(content.sha256.to_owned()),
        }))
    }

    /// Deletes an object; one that is gone already is fine.
    pub(super) async fn delete(&self, name: &str) -> Result<(), StoreError> {
        let (store, path) = (self.store()?, self.path(name));
        match repeat(async || store.delete(&path).await).await {
            Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.fail("delete an object", &error, name)),
        }
    }
}

/// Sends a request again whose answer broke off, where that does no harm: `object_store` does so for requests, not for the
/// bodies of lists nor for deletions.
async fn repeat<T>(request: impl AsyncFn() -> Result<T, Error>) -> Result<T, Error> {
    let begin = Instant::now();
    for _ in 1..SENDINGS {
        match request().await {
            Err(error) if Answer::of(&error).is_lost() && begin.elapsed() < REPEATED_WITHIN => {}
            done => return done,
        }
    }
    request().await
}

fn attributes(sha256: &str) -> Attributes {
    Attributes::from_iter([(Attribute::Metadata(SHA256.into()), sha256.to_owned())])
}

fn remote(found: &GetResult) -> Remote {
    let sha256 =
        found.attributes.get(&Attribute::Metadata(SHA256.into())).map(|value| value.as_ref().to_owned());
    let meta = &found.meta;
    Remote { e_tag: meta.e_tag.clone(), version: meta.version.clone(), size: meta.size, sha256 }
}
