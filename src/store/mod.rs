//! Object storage: data sets, runs and scores at URLs (`s3://`, `gs://`, `az://`), by the crate `object_store`.
//!
//! The stages work on folders. A URL has a folder of this machine too, its mirror, below a cache. Opening it brings the small
//! files (manifests, configs, a run's files) and a list of what else lies there; episodes and labels come when they are
//! opened, are checked against the hash they were put with, and are evicted, the longest unused first, beyond a bound. What a
//! command makes in a mirror is put by a push: data first, manifests last, on the condition that nobody else was there.
//!
//! - No half object has a final name: an object appears when its put, or its last part, is complete. No half file either: it is fetched
//!   under a partial name, checked and renamed.
//! - A new object is put if there is none (`If-None-Match`), a changed one if it is still the one that was read
//!   (`If-Match`). A second writer is told. The very same content is no conflict: objects carry their SHA-256.
//! - Requests are sent again by `object_store`, with jitter; only a conditional put whose answer was lost is looked up here.
//! - Remote is the truth: a mirror is made equal to it when it is opened, and what a killed command did not put is made again.
//! - Credentials come from the environment and are in no URL, file, message or log.
//!
//! `file://` is a path.

mod bucket;
mod cache;
mod error;
mod known;
mod location;
mod mirror;
mod process;
mod push;
mod registry;
#[cfg(test)]
mod tests;

pub use error::StoreError;
pub use location::{Location, Provider, StoreUrl, is_url, refuse_credentials};
pub use mirror::Access;
pub use registry::{
    OpenedLocation, discard, files_below, has, is_there, link_or_copy, name_of, open_file, push, push_file,
    sha256_of, size_of, with_urls,
};
