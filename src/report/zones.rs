//! The danger zones compared on one data set: counts, and one sample with all zones over each other.

mod picture;

use std::fmt;
use std::path::PathBuf;

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

use self::picture::{Overlay, OverlayError};
use super::view::ViewError;
use super::view::load::locate;
use crate::episode::manifest::{Manifest, ManifestError};
use crate::episode::{EpisodeError, EpisodeReader};
use crate::files::{self, write_atomic};
use crate::label::{LabelError, ZoneComparison, compare};
use crate::progress::Progress;
use crate::zone::{Zone, ZoneConfig, ZoneError, ZoneKind};

/// Why zones could not be compared.
#[derive(Debug, Error)]
pub enum ZonesError {
    #[error(transparent)]
    Zone(#[from] ZoneError),
    #[error(transparent)]
    Label(#[from] LabelError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    /// No such sample, or a picture that cannot be packed.
    #[error(transparent)]
    View(#[from] ViewError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("{source}: {}", path.display())]
    Overlay { source: OverlayError, path: PathBuf },
}

/// What to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct ZonesRequest {
    pub dataset: PathBuf,
    /// The config that the zones share; each zone replaces its `kind`.
    pub zone: ZoneConfig,
    /// Where to draw a sample.
    pub plot: Option<PathBuf>,
    /// Counted through all episodes in the manifest's order, from 0; `None` takes the most disputed one.
    pub sample: Option<usize>,
    pub force: bool,
}

/// The comparison, and the picture drawn.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ZonesSummary {
    #[serde(flatten)]
    pub comparison: ZoneComparison,
    pub plot: Option<Plot>,
}

/// A picture that was drawn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Plot {
    /// Counted through all episodes.
    pub sample: usize,
    pub episode: String,
    /// Counted in its episode.
    pub sample_idx: usize,
    pub path: PathBuf,
}

/// Labels a data set by every kind of zone, and draws one sample if asked to.
///
/// # Errors
/// [`ZonesError`]: no data set, no such sample, a picture that exists, a config or a state of the ego that is
/// not valid.
pub fn run(request: &ZonesRequest, progress: &dyn Progress) -> Result<ZonesSummary, ZonesError> {
    let ZonesRequest { dataset, zone, plot, sample, force } = request;
    if let Some(path) = plot.as_ref().filter(|_| !force)
        && files::is_there(path)?
    {
        return Err(ViewError::Exists { path: path.clone() }.into());
    }
    let of_kind = |kind| Zone::try_from(ZoneConfig { kind, ..zone.clone() });
    let zones = ZoneKind::ALL.into_iter().map(of_kind).collect::<Result<Vec<_>, _>>()?;
    let manifest = Manifest::read(dataset)?;
    // Before the long work, so that a wrong number is reported at once.
    if let Some(sample) = sample {
        locate(&manifest, *sample, dataset)?;
    }
    let comparison = compare(dataset, &zones, progress)?;
    let Some(path) = plot else { return Ok(ZonesSummary { comparison, plot: None }) };
    let number = sample.or(comparison.most_disputed_sample).unwrap_or(0);
    let (entry, sample_idx) = locate(&manifest, number, dataset)?;
    let file = dataset.join(&entry.file);
    let read = EpisodeReader::open_entry(dataset, entry)?.sample(sample_idx)?;
    let overlay = Overlay {
        episode: &entry.name,
        sample_idx,
        sample: &read,
        zones: &zones,
        shares: &comparison.zones.iter().map(|zone| zone.harmful_share).collect::<Vec<_>>(),
    };
    let drawn = overlay.draw().map_err(|source| ZonesError::Overlay { source, path: file })?;
    let mut png = Vec::new();
    drawn
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .map_err(|source| ViewError::Image { source, path: path.clone() })?;
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    write_atomic(path, &png)?;
    let plot = Plot { sample: number, episode: entry.name.clone(), sample_idx, path: path.clone() };
    Ok(ZonesSummary { comparison, plot: Some(plot) })
}

impl fmt::Display for ZonesSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.comparison)?;
        if let Some(Plot { sample, episode, sample_idx, path }) = &self.plot {
            write!(f, "\n{}: sample {sample}, which is {sample_idx} of {episode}", path.display())?;
        }
        Ok(())
    }
}
