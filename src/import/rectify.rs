//! Pictures without distortion: each pixel of the new picture looks up where the lens bent its ray to.
//!
//! The models are OpenCV's (`cv::undistort`, `cv::fisheye`); the intrinsics stay, so that what was in the middle stays there. Bilinear; rays
//! from beyond the old picture are black.

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::Distortion;

/// The picture that a pinhole with intrinsics `k` (row by row, pixel centres at whole numbers) would have taken.
pub(super) fn rectify(picture: &RgbImage, k: &[f64; 9], distortion: &Distortion) -> RgbImage {
    let [fx, _, cx, _, fy, cy, ..] = *k;
    let (width, height) = picture.dimensions();
    let mut rectified = RgbImage::new(width, height);
    rectified.par_chunks_mut(3 * width.max(1) as usize).enumerate().for_each(|(v, row)| {
        for (u, pixel) in row.chunks_exact_mut(3).enumerate() {
            let (x, y) = distort((u as f64 - cx) / fx, (v as f64 - cy) / fy, distortion);
            pixel.copy_from_slice(&look_up(picture, fx * x + cx, fy * y + cy).0);
        }
    });
    rectified
}

/// Where the lens sends the ray `(x, y, 1)`.
fn distort(x: f64, y: f64, distortion: &Distortion) -> (f64, f64) {
    let r2 = x * x + y * y;
    let bend = |radial: f64, p1: f64, p2: f64| {
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    };
    match *distortion {
        Distortion::None => (x, y),
        Distortion::PlumbBob([k1, k2, p1, p2, k3]) => bend(1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), p1, p2),
        Distortion::Rational([k1, k2, p1, p2, k3, k4, k5, k6]) => {
            let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
            bend(above / below, p1, p2)
        }
        Distortion::Fisheye([k1, k2, k3, k4]) => {
            let r = r2.sqrt();
            let theta = r.atan();
            let t2 = theta * theta;
            let bent = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
            let share = if r > 1e-9 { bent / r } else { 1.0 };
            (x * share, y * share)
        }
    }
}

/// The colour between four pixels; black outside.
fn look_up(picture: &RgbImage, u: f64, v: f64) -> Rgb<u8> {
    let (width, height) = (f64::from(picture.width()), f64::from(picture.height()));
    if !(u > -0.5 && v > -0.5 && u < width - 0.5 && v < height - 0.5) {
        return Rgb([0; 3]);
    }
    let (u, v) = (u.clamp(0.0, width - 1.0), v.clamp(0.0, height - 1.0));
    let (left, top) = (u.floor() as u32, v.floor() as u32);
    let (right, bottom) = ((left + 1).min(picture.width() - 1), (top + 1).min(picture.height() - 1));
    let (along, down) = (u - f64::from(left), v - f64::from(top));
    let corners =
        [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| picture.get_pixel(x, y).0);
    let mix = |from: f64, to: f64, share: f64| from + (to - from) * share;
    Rgb(std::array::from_fn(|channel| {
        let [a, b, c, d] = corners.map(|corner| f64::from(corner[channel]));
        mix(mix(a, b, along), mix(c, d, along), down).round() as u8
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: [f64; 9] = [100.0, 0.0, 49.5, 0.0, 100.0, 29.5, 0.0, 0.0, 1.0];

    /// Red rises to the right, green downwards.
    fn picture() -> RgbImage {
        RgbImage::from_fn(100, 60, |u, v| Rgb([2 * u as u8, 4 * v as u8, 7]))
    }

    #[test]
    fn no_distortion_changes_nothing() {
        let models = [Distortion::None, Distortion::PlumbBob([0.0; 5]), Distortion::Rational([0.0; 8])];
        for model in models {
            assert_eq!(rectify(&picture(), &K, &model), picture());
        }
    }

    #[test]
    fn a_barrel_pulls_its_edges_outwards_as_opencv_does() {
        let rectified = rectify(&picture(), &K, &Distortion::PlumbBob([-0.2, 0.0, 0.0, 0.0, 0.0]));
        // x = 0.405 at u = 90; r2 = 0.164025 + 0.000025; x * (1 - 0.2 r2) = 0.391715, at u = 88.67: red 177.
        assert_eq!(rectified.get_pixel(90, 30).0[0], 177);
        assert_eq!(rectified.get_pixel(49, 29), picture().get_pixel(49, 29));
    }

    #[test]
    fn a_fisheye_bends_by_the_angle_and_black_lies_beyond() {
        let rectified = rectify(&picture(), &K, &Distortion::Fisheye([0.0; 4]));
        // atan(0.405) = 0.38480, at u = 87.98: red 176.
        assert_eq!(rectified.get_pixel(90, 30).0[0], 176);
        let stretched = rectify(&picture(), &K, &Distortion::PlumbBob([2.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!(stretched.get_pixel(0, 0).0, [0; 3]);
    }
}
