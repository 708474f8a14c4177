//! What a picture shows: brightness, contrast, colour, sharpness, size, and how the camera is mounted.
//!
//! All but the size is measured on the picture scaled to one width, so that a pixel means the same in both sets. Brightness
//! is luma, `0.299 R + 0.587 G + 0.114 B` (ITU-R BT.601); saturation that of HSV, `(max - min) / max`; sharpness the variance
//! of the 4-neighbour Laplacian of the brightness (Pech-Pacheco et al. 2000, "Diatom autofocusing in brightfield microscopy").

use image::RgbImage;
use image::imageops::{self, FilterType};

use super::quantity::Channel;
use super::{Quantity, Tallies};
use crate::sample::Measured;

/// Width to which pictures are scaled before they are compared.
pub const COMPARED_WIDTH_PX: u32 = 640;

/// Counts a sample's picture, which was unpacked from `measured`.
pub(super) fn add_picture(tallies: &mut Tallies, measured: &Measured, picture: &RgbImage) {
    let camera = &measured.intrinsics;
    tallies.add(Quantity::PictureWidth, f64::from(picture.width()));
    tallies.add(Quantity::PictureHeight, f64::from(picture.height()));
    tallies.add(Quantity::HorizontalView, camera.horizontal_fov_rad().to_degrees());
    tallies.add(Quantity::VerticalView, camera.vertical_fov_rad().to_degrees());
    tallies.add(Quantity::CameraHeight, measured.ego_from_camera.isometry.translation.z);
    let forward = measured.ego_from_camera.rotate(&nalgebra::Vector3::z());
    tallies.add(Quantity::CameraPitch, -forward.z.clamp(-1.0, 1.0).asin().to_degrees());
    let scaled = scale(picture);
    let picture = scaled.as_ref().unwrap_or(picture);
    add_colours(tallies, picture);
    add_brightness(tallies, picture);
}

/// The picture at the width of comparison; `None` if it has it.
fn scale(picture: &RgbImage) -> Option<RgbImage> {
    let (width, height) = picture.dimensions();
    if width == COMPARED_WIDTH_PX || width == 0 {
        return None;
    }
    let scaled_height =
        (f64::from(height) * f64::from(COMPARED_WIDTH_PX) / f64::from(width)).round().max(1.0);
    Some(imageops::resize(picture, COMPARED_WIDTH_PX, scaled_height as u32, FilterType::Triangle))
}

fn add_colours(tallies: &mut Tallies, picture: &RgbImage) {
    for (i, channel) in Channel::ALL.into_iter().enumerate() {
        let (mean, variance) = moments(picture.pixels().map(|pixel| f64::from(pixel.0[i])));
        tallies.add(Quantity::ChannelMean(channel), mean);
        tallies.add(Quantity::ChannelDeviation(channel), variance.sqrt());
    }
    let saturation = picture.pixels().map(|pixel| {
        let [most, least] =
            [pixel.0.into_iter().max(), pixel.0.into_iter().min()].map(|of| f64::from(of.unwrap_or(0)));
        if most > 0.0 { (most - least) / most } else { 0.0 }
    });
    tallies.add(Quantity::Saturation, moments(saturation).0);
}

fn add_brightness(tallies: &mut Tallies, picture: &RgbImage) {
    let luma = |pixel: &image::Rgb<u8>| {
        let [r, g, b] = pixel.0.map(f64::from);
        0.299 * r + 0.587 * g + 0.114 * b
    };
    let brightness: Vec<f64> = picture.pixels().map(luma).collect();
    let mut n_of_level = [0_u64; 256];
    brightness.iter().for_each(|&level| n_of_level[level.round() as usize] += 1);
    for (level, &n) in n_of_level.iter().enumerate() {
        tallies.add_times(Quantity::Brightness, level as f64, n);
    }
    tallies.add(Quantity::Contrast, moments(brightness.iter().copied()).1.sqrt());
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    if width < 3 || height < 3 {
        return;
    }
    let laplacian = (1..height - 1).flat_map(|y| {
        let at = |x: usize, y: usize| brightness[y * width + x];
        (1..width - 1)
            .map(move |x| at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y))
    });
    tallies.add(Quantity::Sharpness, moments(laplacian).1);
}

/// Mean and variance; NaN of nothing.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / n)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::dataset::test_data;

    fn tallies(picture: &RgbImage) -> Tallies {
        let mut tallies = Tallies::default();
        add_picture(&mut tallies, &test_data::dataset(1).samples()[0].measured, picture);
        tallies
    }

    fn mean(tallies: &Tallies, quantity: Quantity) -> f64 {
        tallies.get(quantity).expect("it was measured").mean()
    }

    #[test]
    fn a_picture_of_one_colour_has_its_brightness_and_neither_contrast_nor_edges() {
        let found = tallies(&RgbImage::from_pixel(640, 360, Rgb([200, 100, 50])));
        assert_eq!(mean(&found, Quantity::ChannelMean(Channel::Red)), 200.0);
        assert_eq!(mean(&found, Quantity::Saturation), 0.75);
        // 0.299 * 200 + 0.587 * 100 + 0.114 * 50 = 124.2, the level 124.
        assert_eq!(mean(&found, Quantity::Brightness), 124.0);
        assert!(mean(&found, Quantity::Contrast) < 1e-9 && mean(&found, Quantity::PictureWidth) == 640.0);
        assert!((mean(&found, Quantity::HorizontalView) - 70.0).abs() < 1e-9);
        assert_eq!((mean(&found, Quantity::CameraHeight), mean(&found, Quantity::CameraPitch)), (1.5, 0.0));
    }

    #[test]
    fn stripes_have_the_deviation_and_the_laplacian_of_the_formula() {
        let stripes = RgbImage::from_fn(640, 4, |x, _| Rgb([if x % 2 == 0 { 0 } else { 100 }; 3]));
        let found = tallies(&stripes);
        assert!((mean(&found, Quantity::Contrast) - 50.0).abs() < 1e-9);
        // The Laplacian is +200 on dark columns and -200 on bright ones.
        assert!((mean(&found, Quantity::Sharpness) - 40_000.0).abs() < 1e-6);
    }

    #[test]
    fn a_picture_twice_as_large_is_as_sharp_as_its_content() {
        let disc = |size: u32| {
            RgbImage::from_fn(size, size / 2, |x, y| {
                let [u, v] = [x, y].map(|at| f64::from(at) / f64::from(size));
                Rgb([(128.0 + 100.0 * (u * 60.0).sin() * (v * 60.0).cos()) as u8; 3])
            })
        };
        let [small, large] = [640, 1280].map(|size| mean(&tallies(&disc(size)), Quantity::Sharpness));
        assert!((small / large - 1.0).abs() < 0.1, "{small} {large}");
    }
}
