//! A clip as an animated GIF: one palette for all pictures, and of each picture only what changed.
//!
//! A palette for each picture would make still grounds flicker. What a colour may differ from its pixel in the picture before without
//! being drawn anew is small, but keeps the noise of cameras out of the file, which would be most of it.

use std::path::Path;

use color_quant::NeuQuant;
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use image::{Rgb, RgbImage};

use super::{ClipError, encode_error};
use crate::object::Harm;
use crate::report::palette as tones;

/// A GIF's greatest side.
const MOST_PX: u32 = 65_535;
/// Pictures that the palette is made of.
const MOST_CHOSEN: usize = 8;
/// The palette's last entry: what stays.
const STAYS: u8 = 255;
/// Parts of a colour that the palette is looked up by: 5 bits each.
const LEVEL_BITS: u32 = 5;
/// A pixel stays while no part of its colour is further from what is shown than this, of 255.
const STILL: u8 = 9;
/// The training of the palette: 1 is best and slowest, 30 fastest.
const SAMPLING: i32 = 3;

/// The pictures to make the palette of, evenly over all.
pub(super) fn chosen(n: usize) -> Vec<usize> {
    let n_chosen = n.min(MOST_CHOSEN);
    (0..n_chosen).map(|i| (2 * i + 1) * n / (2 * n_chosen)).collect()
}

pub(super) struct GifFile {
    palette: Vec<[u8; 3]>,
    /// The entry for each colour of a few bits, by [`level`].
    nearest: Vec<u8>,
    /// What is shown: entries of the palette; empty before the first picture.
    shown: Vec<u8>,
    encoder: Option<Encoder<Vec<u8>>>,
    /// Time that hundredths of a second could not tell yet.
    rest_ms: u32,
}

impl GifFile {
    /// Starts a file with the palette of some of its pictures.
    pub(super) fn of(some: &[RgbImage]) -> Self {
        // Thin lines are too few pixels for a trained palette to keep their tones.
        let mut palette: Vec<[u8; 3]> = [
            tones::PAGE,
            tones::PANEL,
            tones::TEXT,
            tones::ZONE,
            tones::UNLABELLED,
            tones::truth(Harm::Harmful),
            tones::truth(Harm::Harmless),
            tones::predicted(Harm::Harmful),
            tones::predicted(Harm::Harmless),
        ]
        .map(|color| color.rgb)
        .to_vec();
        let pixels: Vec<u8> =
            some.iter().flat_map(RgbImage::pixels).flat_map(|Rgb([r, g, b])| [*r, *g, *b, 255]).collect();
        let n_trained = usize::from(STAYS) - palette.len();
        let trained = NeuQuant::new(SAMPLING, n_trained, &pixels).color_map_rgb();
        palette.extend_from_slice(trained.as_chunks::<3>().0);
        let levels = 1u32 << LEVEL_BITS;
        let middle = |level: u32| ((level << (8 - LEVEL_BITS)) + (1 << (7 - LEVEL_BITS))) as u8;
        let nearest = (0..levels.pow(3)).map(|at| {
            let parts = [at >> (2 * LEVEL_BITS), (at >> LEVEL_BITS) & (levels - 1), at & (levels - 1)];
            nearest_of(&palette, parts.map(middle))
        });
        let nearest = nearest.collect();
        Self { palette, nearest, shown: Vec::new(), encoder: None, rest_ms: 0 }
    }

    pub(super) fn add(&mut self, picture: &RgbImage, duration_ms: u32, path: &Path) -> Result<(), ClipError> {
        let fail = encode_error(path);
        let (width_px, height_px) = picture.dimensions();
        let side = |px: u32| {
            let wrong = ClipError::Size { width_px, height_px, most_px: MOST_PX, path: path.to_owned() };
            u16::try_from(px).map_err(|_| wrong)
        };
        let (width, height) = (side(width_px)?, side(height_px)?);
        let is_first = self.encoder.is_none();
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            none => {
                let mut flat: Vec<u8> = self.palette.iter().flatten().copied().collect();
                flat.resize(3 * 256, 0);
                let mut encoder =
                    Encoder::new(Vec::new(), width, height, &flat).map_err(|e| fail(e.to_string()))?;
                encoder.set_repeat(Repeat::Infinite).map_err(|e| fail(e.to_string()))?;
                none.insert(encoder)
            }
        };
        self.shown.resize((width_px * height_px) as usize, 0);
        let mut drawn = Vec::with_capacity(self.shown.len());
        for (Rgb(wanted), shown) in picture.pixels().zip(&mut self.shown) {
            let is_still = |now: [u8; 3]| now.iter().zip(wanted).all(|(a, b)| a.abs_diff(*b) <= STILL);
            if !is_first && is_still(self.palette[usize::from(*shown)]) {
                drawn.push(STAYS);
            } else {
                let entry = self.nearest[level(*wanted)];
                drawn.push(if !is_first && entry == *shown { STAYS } else { entry });
                *shown = entry;
            }
        }
        let all_ms = self.rest_ms + duration_ms;
        self.rest_ms = all_ms % 10;
        let frame = Frame {
            delay: u16::try_from(all_ms / 10).unwrap_or(u16::MAX),
            dispose: DisposalMethod::Keep,
            transparent: (!is_first).then_some(STAYS),
            width,
            height,
            buffer: drawn.into(),
            ..Frame::default()
        };
        encoder.write_frame(&frame).map_err(|error| fail(error.to_string()))
    }

    pub(super) fn finish(self, path: &Path) -> Result<Vec<u8>, ClipError> {
        let encoder = self.encoder.ok_or_else(|| ClipError::Empty { path: path.to_owned() })?;
        encoder.into_inner().map_err(|error| encode_error(path)(error.to_string()))
    }
}

/// A colour's place among those of a few bits.
fn level(color: [u8; 3]) -> usize {
    color.iter().fold(0, |at, part| (at << LEVEL_BITS) | usize::from(part >> (8 - LEVEL_BITS)))
}

/// The palette's entry that is nearest to a colour; the first of several.
fn nearest_of(palette: &[[u8; 3]], color: [u8; 3]) -> u8 {
    let distance = |entry: &[u8; 3]| -> u32 {
        entry.iter().zip(color).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum()
    };
    let nearest = palette.iter().enumerate().min_by_key(|(_, entry)| distance(entry));
    nearest.map_or(0, |(i, _)| u8::try_from(i).expect("a palette has fewer than 256 entries"))
}
