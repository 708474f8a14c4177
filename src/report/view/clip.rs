//! Films a part of an episode into a clip on disk.

use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;

use super::episode_view::EpisodeView;
use super::film::Film;
use super::load::ViewError;
use super::moment::{Moment, seconds_after, span};
use crate::files;
use crate::progress::Progress;
use crate::report::clips::{ClipFormat, write_clip};

/// Widths where none is asked for: a GIF grows fast.
const WIDTH_PX: u32 = 1280;
const GIF_WIDTH_PX: u32 = 800;

/// What to film, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipRequest {
    /// `.mp4`, `.gif`, or a folder.
    pub out: PathBuf,
    /// The first sample; `None`: that of the episode.
    pub from: Option<Moment>,
    /// Up to here, without it; `None`: to the episode's end.
    pub to: Option<Moment>,
    /// Pixels; `None`: as is usual for the format.
    pub width_px: Option<u32>,
    pub force: bool,
}

/// The result of filming.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClipSummary {
    pub episode: String,
    pub n_pictures: usize,
    pub seconds: f64,
    pub size_px: (u32, u32),
    pub out: PathBuf,
}

/// Films a part of an episode, at its true rate.
///
/// # Errors
/// No sample lies there, a file is there already and no `force`, or a broken file.
pub fn write_episode_clip(
    view: &EpisodeView,
    request: &ClipRequest,
    progress: &dyn Progress,
) -> Result<ClipSummary, ViewError> {
    let format = ClipFormat::of(&request.out)?;
    let times_ns = view.times_ns();
    let samples = span(times_ns, request.from, request.to);
    if samples.is_empty() {
        let last = times_ns.len().saturating_sub(1);
        return Err(ViewError::NoSpan {
            episode: view.name().to_owned(),
            from: request.from.unwrap_or(Moment::Sample(0)),
            to: request.to.unwrap_or(Moment::Sample(times_ns.len())),
            last,
            seconds: times_ns.last().map_or(0.0, |&time_ns| seconds_after(times_ns, time_ns)),
        });
    }
    let usual_px = if format == ClipFormat::Gif { GIF_WIDTH_PX } else { WIDTH_PX };
    let film = Film::of(view, samples, request.width_px.unwrap_or(usual_px));
    let durations_ms = film.durations_ms();
    write_clip(&request.out, &durations_ms, request.force, &|place| film.picture(place), progress)?;
    Ok(ClipSummary {
        episode: view.name().to_owned(),
        n_pictures: film.len(),
        seconds: durations_ms.iter().map(|&duration_ms| f64::from(duration_ms)).sum::<f64>() / 1000.0,
        size_px: film.size_px(),
        out: request.out.clone(),
    })
}

/// Makes the folder of a file that is to be written.
///
/// # Errors
/// The file is there already and no `force`, or any IO error.
pub(super) fn make_room(path: &Path, force: bool) -> Result<(), ViewError> {
    if !force && files::is_there(path)? {
        return Err(ViewError::Exists { path: path.to_owned() });
    }
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    Ok(())
}
