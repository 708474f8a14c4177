//! `sensor_msgs/Image` and `CompressedImage` to pictures.
//!
//! JPEG and PNG stay as they are; unpacked pictures become RGB, row by row, whatever lies between a row's end and its step.

use image::RgbImage;

use super::cdr::{CdrError, Value};
use crate::import::RawImage;
use crate::sample::{EncodedImage, ImageFormat};

const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";
const PNG_MAGIC: &[u8] = b"\x89PNG";

const ENCODINGS: &str =
    "rgb8, bgr8, rgba8, bgra8, mono8, yuv422, yuv422_yuy2 and bayer_{rggb,bggr,gbrg,grbg}8";

/// The colours of a Bayer picture's first two rows: 0 red, 1 green, 2 blue.
type Mosaic = [[usize; 2]; 2];

/// How a pixel's bytes become red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Packing {
    /// Bytes a pixel, and which of them are red, green and blue.
    Plain {
        n_bytes: usize,
        rgb: [usize; 3],
    },
    /// Two bytes a pixel; of four, which are the two brightnesses, and the two colours that they share.
    Yuv422 {
        y: [usize; 2],
        u: usize,
        v: usize,
    },
    Bayer(Mosaic),
}

impl Packing {
    fn of(encoding: &str) -> Option<Self> {
        let plain = |n_bytes, rgb| Some(Self::Plain { n_bytes, rgb });
        match encoding {
            "rgb8" => plain(3, [0, 1, 2]),
            "bgr8" | "8UC3" => plain(3, [2, 1, 0]),
            "rgba8" => plain(4, [0, 1, 2]),
            "bgra8" | "8UC4" => plain(4, [2, 1, 0]),
            "mono8" | "8UC1" => plain(1, [0, 0, 0]),
            "yuv422" | "uyvy" | "UYVY" => Some(Self::Yuv422 { y: [1, 3], u: 0, v: 2 }),
            "yuv422_yuy2" | "yuyv" | "YUYV" => Some(Self::Yuv422 { y: [0, 2], u: 1, v: 3 }),
            "bayer_rggb8" => Some(Self::Bayer([[0, 1], [1, 2]])),
            "bayer_bggr8" => Some(Self::Bayer([[2, 1], [1, 0]])),
            "bayer_gbrg8" => Some(Self::Bayer([[1, 2], [0, 1]])),
            "bayer_grbg8" => Some(Self::Bayer([[1, 0], [2, 1]])),
            _ => None,
        }
    }

    fn n_bytes(self) -> usize {
        match self {
            Self::Plain { n_bytes, .. } => n_bytes,
            Self::Yuv422 { .. } => 2,
            Self::Bayer(_) => 1,
        }
    }
}

/// The picture of a `CompressedImage`.
///
/// # Errors
/// It is neither JPEG nor PNG.
pub fn compressed(message: &Value) -> Result<RawImage, String> {
    let tell = |error: CdrError| error.to_string();
    let bytes = message.numbers("data").map_err(tell)?.bytes.to_vec();
    let format = if bytes.starts_with(JPEG_MAGIC) {
        ImageFormat::Jpeg
    } else if bytes.starts_with(PNG_MAGIC) {
        ImageFormat::Png
    } else {
        let (found, n_bytes) = (message.text("format").map_err(tell)?, bytes.len());
        return Err(format!("the picture's {n_bytes} bytes, `{found}`, are neither JPEG nor PNG"));
    };
    Ok(RawImage::Encoded(EncodedImage { format, bytes }))
}

/// The picture of an `Image`.
///
/// # Errors
/// Its encoding is none that is read, or its data is not as long as its size says.
pub fn unpacked(message: &Value) -> Result<RawImage, String> {
    let tell = |error: CdrError| error.to_string();
    let encoding = message.text("encoding").map_err(tell)?;
    let Some(packing) = Packing::of(encoding) else {
        return Err(format!("the picture's encoding is `{encoding}`; {ENCODINGS} are read"));
    };
    let [width, height, step] = message.numbers_at("", ["width", "height", "step"]).map_err(tell)?;
    let (width, height, step) = (width as usize, height as usize, step as usize);
    let bytes = message.numbers("data").map_err(tell)?.bytes;
    let row = width.saturating_mul(packing.n_bytes());
    let needed = height.saturating_sub(1).saturating_mul(step).saturating_add(row);
    if width == 0 || height == 0 || step < row || bytes.len() < needed {
        let found = bytes.len();
        return Err(format!(
            "the picture has {found} bytes; {width} x {height} pixels of `{encoding}` in rows of {step} bytes need {needed}"
        ));
    }
    let rows: Vec<&[u8]> = (0..height).map(|y| &bytes[y * step..y * step + row]).collect();
    let pixel = |x: u32, y: u32| image::Rgb(pixel(packing, &rows, x as usize, y as usize));
    Ok(RawImage::Pixels(RgbImage::from_fn(width as u32, height as u32, pixel)))
}

fn pixel(packing: Packing, rows: &[&[u8]], x: usize, y: usize) -> [u8; 3] {
    match packing {
        Packing::Plain { n_bytes, rgb } => rgb.map(|channel| rows[y][x * n_bytes + channel]),
        Packing::Yuv422 { y: brightness, u, v } => {
            let begin = (x / 2) * 4;
            let at = |offset: usize| rows[y].get(begin + offset).map_or(128.0, |&byte| f32::from(byte));
            from_yuv(at(brightness[x % 2]), at(u) - 128.0, at(v) - 128.0)
        }
        Packing::Bayer(mosaic) => from_mosaic(mosaic, rows, x, y),
    }
}

/// BT.601 with the full range, as OpenCV converts it.
fn from_yuv(y: f32, u: f32, v: f32) -> [u8; 3] {
    let limited = 1.164 * (y - 16.0);
    [limited + 1.596 * v, limited - 0.813 * v - 0.391 * u, limited + 2.018 * u]
        .map(|value| value.round() as u8)
}

/// Each colour is the mean of its own pixels among the nine around.
fn from_mosaic(mosaic: Mosaic, rows: &[&[u8]], x: usize, y: usize) -> [u8; 3] {
    let (mut sums, mut counts) = ([0_u32; 3], [0_u32; 3]);
    for near_y in y.saturating_sub(1)..=(y + 1).min(rows.len() - 1) {
        for near_x in x.saturating_sub(1)..=(x + 1).min(rows[0].len() - 1) {
            let colour = mosaic[near_y % 2][near_x % 2];
            // Its own colour is known exactly.
            if colour != mosaic[y % 2][x % 2] || (near_x, near_y) == (x, y) {
                sums[colour] += u32::from(rows[near_y][near_x]);
                counts[colour] += 1;
            }
        }
    }
    std::array::from_fn(|colour| ((sums[colour] + counts[colour] / 2) / counts[colour].max(1)) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bayer_picture_of_one_colour_is_that_colour_everywhere() {
        for encoding in ["bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"] {
            let Some(Packing::Bayer(mosaic)) = Packing::of(encoding) else { panic!("{encoding}") };
            let colour = [200, 100, 50];
            let rows: Vec<Vec<u8>> =
                (0..4).map(|y| (0..6).map(|x| colour[mosaic[y % 2][x % 2]]).collect()).collect();
            let rows: Vec<&[u8]> = rows.iter().map(Vec::as_slice).collect();
            for (x, y) in [(0, 0), (3, 2), (5, 3), (2, 1)] {
                assert_eq!(from_mosaic(mosaic, &rows, x, y), colour, "{encoding} at {x}, {y}");
            }
        }
    }

    #[test]
    fn grey_in_yuv_is_grey() {
        assert_eq!(from_yuv(126.0, 0.0, 0.0), [128; 3]);
        assert_eq!(from_yuv(255.0, 0.0, 0.0), [255; 3]);
    }
}
