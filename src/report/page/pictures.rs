//! Pictures and clips as they stand in the page: JPEG and MP4 in base64.

use std::io::Cursor;
use std::ops::Range;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fs_err as fs;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use image::{ImageError, RgbImage};

use super::ReportError;
use crate::report::clips::mp4_bytes;
use crate::report::document::{Clip, Picture};
use crate::report::view::{EpisodeView, Film, ViewError};

/// 1 to 100: lines stay clean from about here.
const JPEG_QUALITY: u8 = 74;
/// Wider files are made smaller, pixels.
const MOST_WIDTH_PX: u32 = 1120;
/// Wide enough to read its words, small enough for a dozen in a page.
const CLIP_WIDTH_PX: u32 = 800;

/// A picture as JPEG in base64.
///
/// # Errors
/// It cannot be packed.
pub fn jpeg(picture: &RgbImage) -> Result<String, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(picture)?;
    Ok(STANDARD.encode(bytes.into_inner()))
}

/// Some samples of an episode as a clip, with camera, view from above, labels and boxes.
///
/// # Errors
/// A sample is not there, or a broken file.
pub fn clip_of(view: &EpisodeView, samples: Range<usize>) -> Result<Clip, ViewError> {
    let film = Film::of(view, samples, CLIP_WIDTH_PX);
    let bytes = mp4_bytes(view.path(), &film.durations_ms(), &|place| film.picture(place))?;
    let (width_px, height_px) = film.size_px();
    Ok(Clip { data: STANDARD.encode(bytes), width_px, height_px })
}

/// The picture in a file; `None` if there is no such file.
///
/// # Errors
/// The file is not a picture.
pub fn of_file(path: &Path, title: &str) -> Result<Option<Picture>, ReportError> {
    if !path.is_file() {
        return Ok(None);
    }
    let broken = |source: ImageError| ReportError::File { source, path: path.to_owned() };
    let mut picture = image::load_from_memory(&fs::read(path)?).map_err(broken)?.into_rgb8();
    if picture.width() > MOST_WIDTH_PX {
        let share = f64::from(MOST_WIDTH_PX) / f64::from(picture.width());
        let height_px = (f64::from(picture.height()) * share).round() as u32;
        picture = image::imageops::resize(&picture, MOST_WIDTH_PX, height_px.max(1), FilterType::CatmullRom);
    }
    let (width_px, height_px) = picture.dimensions();
    let data = jpeg(&picture).map_err(broken)?;
    Ok(Some(Picture { title: title.to_owned(), data, width_px, height_px, clip: None }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_becomes_a_jpeg_of_its_shape_and_none_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wide.png");
        assert_eq!(of_file(&path, "none").unwrap(), None);
        RgbImage::from_pixel(2 * MOST_WIDTH_PX, 200, image::Rgb([200, 30, 40])).save(&path).unwrap();
        let picture = of_file(&path, "wide").unwrap().unwrap();
        assert_eq!((picture.width_px, picture.height_px), (MOST_WIDTH_PX, 100));
        let again = image::load_from_memory(&STANDARD.decode(&picture.data).unwrap()).unwrap().into_rgb8();
        assert_eq!(again.dimensions(), (MOST_WIDTH_PX, 100));
        assert!(again.get_pixel(9, 9).0[0] > 180, "{:?}", again.get_pixel(9, 9));
        fs::write(&path, "words").unwrap();
        assert!(of_file(&path, "broken").unwrap_err().to_string().contains("wide.png"));
    }
}
