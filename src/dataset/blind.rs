//! A data set of which one sensor saw nothing: what a network does when a lens is covered or a LiDAR fails.
//!
//! Truth and labels stay as they are, counts of points too, so that the same objects are scored.

use std::io::Cursor;

use image::RgbImage;
use serde::{Deserialize, Serialize};

use super::Dataset;
use crate::geometry::Pinhole;
use crate::sample::{EncodedImage, ImageFormat, Measured};

/// A sensor to blind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sensor {
    Camera,
    Lidar,
}

impl Sensor {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Camera, Self::Lidar];

    /// The name in flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Lidar => "lidar",
        }
    }
}

impl Sensor {
    /// Makes a sample's picture black, or its cloud empty.
    pub fn blind(self, measured: &mut Measured) {
        match self {
            Self::Camera => measured.image = black(&measured.intrinsics),
            Self::Lidar => measured.points.clear(),
        }
    }
}

impl Dataset {
    /// Makes every picture black, or every cloud empty.
    #[must_use]
    pub fn blind(mut self, sensor: Sensor) -> Self {
        for sample in &mut self.samples {
            sensor.blind(&mut sample.measured);
        }
        self
    }
}

/// A black picture of a camera's size.
fn black(of: &Pinhole) -> EncodedImage {
    let mut bytes = Cursor::new(Vec::new());
    RgbImage::new(of.width_px, of.height_px)
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("memory takes a picture");
    EncodedImage { format: ImageFormat::Png, bytes: bytes.into_inner() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    #[test]
    fn one_sensor_sees_nothing_and_the_rest_stays() {
        let data = test_data::dataset(2);
        let [dark, empty] = Sensor::ALL.map(|sensor| data.clone().blind(sensor));
        for i in 0..2 {
            let [seen, dark, empty] = [&data, &dark, &empty].map(|of| &of.samples()[i]);
            let picture = dark.measured.image.decode().unwrap();
            let of = &seen.measured.intrinsics;
            assert_eq!(picture.dimensions(), (of.width_px, of.height_px));
            assert!(picture.iter().all(|&value| value == 0));
            assert_eq!((&dark.measured.points, &dark.objects), (&seen.measured.points, &seen.objects));
            assert!(empty.measured.points.is_empty() && empty.measured.image == seen.measured.image);
            assert_eq!(empty.objects, seen.objects);
        }
    }
}
