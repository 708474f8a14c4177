//! The camera's exposure and the blur of its lens, on the finished 8-bit picture.
//!
//! A display value is the root of the light, so an exposure of e steps makes 2^(e / 2) of it, cut at white. Blur is a row and
//! a column pass of the kernel (a, 1 - 2 a, a), whose variance is 2 a, as often as a <= 1/4 needs; the border repeats.

use image::RgbImage;

use crate::sensors::rig_config::RigCameraConfig;

/// Variance that one pass may add: with a = 1/4 it is the binomial kernel.
const MOST_VARIANCE_PX2: f64 = 0.5;
/// Bits behind the point of a weight.
const BITS: u32 = 8;

/// What a camera does to its picture.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    exposed: Option<[u8; 256]>,
    /// Weight of each neighbour, of 256, and how many passes.
    blur: Option<(u16, usize)>,
}

impl Lens {
    pub(super) fn new(config: &RigCameraConfig) -> Self {
        let gain = (config.exposure_ev / 2.0).exp2();
        let expose = |value: usize| (value as f64 * gain).round().min(255.0) as u8;
        let variance = config.blur_px * config.blur_px;
        let n_passes = (variance / MOST_VARIANCE_PX2).ceil();
        let weight = (variance / n_passes.max(1.0) / 2.0 * f64::from(1 << BITS)).round() as u16;
        Self {
            exposed: (config.exposure_ev != 0.0).then(|| std::array::from_fn(expose)),
            blur: (weight > 0).then_some((weight, n_passes as usize)),
        }
    }

    pub(super) fn apply(&self, picture: &mut RgbImage) {
        if let Some(exposed) = &self.exposed {
            picture.iter_mut().for_each(|value| *value = exposed[usize::from(*value)]);
        }
        if let Some((weight, n_passes)) = self.blur {
            (0..n_passes).for_each(|_| blur(picture, weight));
        }
    }
}

/// One pass along the rows and one along the columns.
fn blur(picture: &mut RgbImage, weight: u16) {
    let row_bytes = 3 * picture.width() as usize;
    let mix = |before: u8, here: u8, after: u8| {
        let sides = (u16::from(before) + u16::from(after)) * weight;
        ((sides + u16::from(here) * ((1 << BITS) - 2 * weight) + (1 << (BITS - 1))) >> BITS) as u8
    };
    let bytes: &mut [u8] = picture;
    let mut before = vec![0; row_bytes];
    for row in bytes.chunks_exact_mut(row_bytes) {
        before.copy_from_slice(row);
        for at in 3..row_bytes.saturating_sub(3) {
            row[at] = mix(before[at - 3], before[at], before[at + 3]);
        }
    }
    let rows = bytes.len() / row_bytes.max(1);
    before.copy_from_slice(&bytes[..row_bytes]);
    let mut own = vec![0; row_bytes];
    for row in 1..rows.saturating_sub(1) {
        let (head, tail) = bytes.split_at_mut((row + 1) * row_bytes);
        let here = &mut head[row * row_bytes..];
        own.copy_from_slice(here);
        for at in 0..row_bytes {
            here[at] = mix(before[at], own[at], tail[at]);
        }
        std::mem::swap(&mut before, &mut own);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(exposure_ev: f64, blur_px: f64) -> Lens {
        Lens::new(&RigCameraConfig { exposure_ev, blur_px, ..RigCameraConfig::default() })
    }

    #[test]
    fn two_steps_double_the_display_value_and_white_is_the_end() {
        let mut picture = RgbImage::from_pixel(2, 2, image::Rgb([10, 100, 200]));
        lens(2.0, 0.0).apply(&mut picture);
        assert_eq!(picture.get_pixel(1, 1).0, [20, 200, 255]);
        lens(-2.0, 0.0).apply(&mut picture);
        assert_eq!(picture.get_pixel(0, 0).0, [10, 100, 128]);
    }

    #[test]
    fn a_point_spreads_by_the_variance_that_is_asked_for() {
        for blur_px in [0.4, 0.7, 1.2] {
            let mut picture = RgbImage::from_pixel(31, 31, image::Rgb([0; 3]));
            (0..31).for_each(|v| picture.put_pixel(15, v, image::Rgb([255; 3])));
            lens(0.0, blur_px).apply(&mut picture);
            let row: Vec<f64> = (0..31).map(|u| f64::from(picture.get_pixel(u, 15).0[1])).collect();
            let sum: f64 = row.iter().sum();
            let variance: f64 = (0..31).map(|u| row[u] * (u as f64 - 15.0).powi(2)).sum::<f64>() / sum;
            assert!((sum - 255.0).abs() < 6.0, "{blur_px}: {sum}");
            assert!((variance.sqrt() - blur_px).abs() < 0.06, "{blur_px}: {}", variance.sqrt());
        }
    }

    #[test]
    fn at_the_defaults_nothing_changes() {
        let of = |u: u32, v: u32| image::Rgb([(7 * u + 31 * v) as u8, (u * v) as u8, u as u8]);
        let mut picture = RgbImage::from_fn(9, 7, of);
        lens(0.0, 0.0).apply(&mut picture);
        assert_eq!(picture, RgbImage::from_fn(9, 7, of));
    }
}
