//! Pictures in a row to a file that plays: MP4 (H.264), GIF, or a folder of PNG files. The same pictures give the same bytes.

mod folder;
mod gif_file;
mod mp4_file;

use std::path::{Path, PathBuf};

use fs_err as fs;
use image::RgbImage;
use rayon::prelude::*;
use thiserror::Error;

use crate::files::{self, write_atomic};
use crate::interrupt;
use crate::progress::Progress;

/// Why a clip cannot be written.
#[derive(Debug, Error)]
pub enum ClipError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("a clip ends in `.mp4` or `.gif`, or is a folder of pictures, without an end; found `.{found}`: {}", path.display())]
    Format { found: String, path: PathBuf },
    #[error("there is something already; --force replaces it: {}", path.display())]
    Exists { path: PathBuf },
    #[error("a clip has at least one picture: {}", path.display())]
    Empty { path: PathBuf },
    #[error("a picture of {width_px} x {height_px} pixels; even numbers up to {most_px} are needed: {}", path.display())]
    Size { width_px: u32, height_px: u32, most_px: u32, path: PathBuf },
    #[error("the pictures have other sizes than the first, of {width_px} x {height_px} pixels: {}", path.display())]
    OtherSize { width_px: u32, height_px: u32, path: PathBuf },
    #[error("the encoder failed: {message}: {}", path.display())]
    Encode { message: String, path: PathBuf },
    #[error(transparent)]
    Folder(#[from] crate::files::FolderError),
}

/// What a clip becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipFormat {
    Mp4,
    Gif,
    /// A folder of PNG files and their times.
    Pictures,
}

impl ClipFormat {
    /// What the end of a path asks for.
    ///
    /// # Errors
    /// Another end.
    pub fn of(path: &Path) -> Result<Self, ClipError> {
        match path.extension().and_then(|end| end.to_str()).map(str::to_lowercase).as_deref() {
            Some("mp4") => Ok(Self::Mp4),
            Some("gif") => Ok(Self::Gif),
            None => Ok(Self::Pictures),
            Some(end) => Err(ClipError::Format { found: end.to_owned(), path: path.to_owned() }),
        }
    }
}

/// Pictures at once; each takes a few megabytes.
const AT_ONCE: usize = 16;

/// Draws the pictures, in parallel, and writes the clip; `durations_ms` holds one for each. MP4 needs even sides.
///
/// # Errors
/// There is a file already and no `force`; pictures of several sizes or too large; a signal asks to end; the disk or a picture fails.
pub fn write_clip<E: From<ClipError> + Send>(
    path: &Path,
    durations_ms: &[u32],
    force: bool,
    draw: &(dyn Fn(usize) -> Result<RgbImage, E> + Sync),
    progress: &dyn Progress,
) -> Result<(), E> {
    let format = ClipFormat::of(path)?;
    if durations_ms.is_empty() {
        return Err(ClipError::Empty { path: path.to_owned() }.into());
    }
    if format != ClipFormat::Pictures {
        if !force && files::is_there(path).map_err(ClipError::from)? {
            return Err(ClipError::Exists { path: path.to_owned() }.into());
        }
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(ClipError::from)?;
        }
    }
    let n = durations_ms.len();
    let mut writer = match format {
        ClipFormat::Mp4 => ClipWriter::Mp4(mp4_file::Mp4File::default()),
        ClipFormat::Gif => ClipWriter::Gif(gif_file::GifFile::of(&draw_all(&gif_file::chosen(n), draw)?)),
        ClipFormat::Pictures => ClipWriter::Pictures(folder::PictureFolder::create(path, force)?),
    };
    progress.start("film", n as u64);
    each_picture(path, n, draw, &mut |place, picture| {
        writer.add(picture, durations_ms[place], path)?;
        progress.advance(1);
        Ok(())
    })?;
    writer.finish(path)?;
    progress.finish();
    Ok(())
}

/// Draws the pictures, in parallel, and packs them as MP4 in memory; `about` is the file that errors name.
///
/// # Errors
/// No pictures, or of several sizes, too large or with odd sides; a picture fails.
pub fn mp4_bytes<E: From<ClipError> + Send>(
    about: &Path,
    durations_ms: &[u32],
    draw: &(dyn Fn(usize) -> Result<RgbImage, E> + Sync),
) -> Result<Vec<u8>, E> {
    if durations_ms.is_empty() {
        return Err(ClipError::Empty { path: about.to_owned() }.into());
    }
    let mut file = mp4_file::Mp4File::default();
    each_picture(about, durations_ms.len(), draw, &mut |place, picture| {
        file.add(picture, durations_ms[place], about)
    })?;
    Ok(file.finish(about)?)
}

/// Draws some pictures; an error once a signal has asked to end.
fn draw_all<E: From<ClipError> + Send>(
    places: &[usize],
    draw: &(dyn Fn(usize) -> Result<RgbImage, E> + Sync),
) -> Result<Vec<RgbImage>, E> {
    let draw = |&place: &usize| {
        interrupt::check().map_err(ClipError::from)?;
        draw(place)
    };
    places.par_iter().map(draw).collect()
}

/// Draws some pictures at once, and hands all of them on in their order.
fn each_picture<E: From<ClipError> + Send>(
    path: &Path,
    n: usize,
    draw: &(dyn Fn(usize) -> Result<RgbImage, E> + Sync),
    take: &mut dyn FnMut(usize, &RgbImage) -> Result<(), ClipError>,
) -> Result<(), E> {
    let mut size = None;
    for begin in (0..n).step_by(AT_ONCE) {
        let places: Vec<usize> = (begin..n.min(begin + AT_ONCE)).collect();
        for (place, picture) in places.iter().zip(draw_all(&places, draw)?) {
            let (width_px, height_px) = *size.get_or_insert(picture.dimensions());
            if picture.dimensions() != (width_px, height_px) {
                return Err(ClipError::OtherSize { width_px, height_px, path: path.to_owned() }.into());
            }
            take(*place, &picture)?;
        }
    }
    Ok(())
}

enum ClipWriter {
    Mp4(mp4_file::Mp4File),
    Gif(gif_file::GifFile),
    Pictures(folder::PictureFolder),
}

impl ClipWriter {
    fn add(&mut self, picture: &RgbImage, duration_ms: u32, path: &Path) -> Result<(), ClipError> {
        match self {
            Self::Mp4(file) => file.add(picture, duration_ms, path),
            Self::Gif(file) => file.add(picture, duration_ms, path),
            Self::Pictures(folder) => folder.add(picture, duration_ms),
        }
    }

    fn finish(self, path: &Path) -> Result<(), ClipError> {
        match self {
            Self::Mp4(file) => Ok(write_atomic(path, &file.finish(path)?)?),
            Self::Gif(file) => Ok(write_atomic(path, &file.finish(path)?)?),
            Self::Pictures(folder) => folder.finish(),
        }
    }
}

/// An encoder's error with the clip's path.
fn encode_error(path: &Path) -> impl Fn(String) -> ClipError {
    move |message| ClipError::Encode { message, path: path.to_owned() }
}

#[cfg(test)]
mod tests;
