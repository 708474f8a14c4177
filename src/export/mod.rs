//! Data sets in the formats of others: nuScenes and KITTI. An export appears whole or not at all.
//!
//! Every export reads its episodes through [`DataSource`], one sample at a time, and fills a [`crate::files::NewFolder`].

pub mod kitti;
pub mod nuscenes;
mod source;

pub use source::{DataSource, ExportError, LabelledEpisode, MARKER};
