//! What is compared: each quantity's name, unit, bins, and what it is a property of.

use serde::Serialize;

use crate::object::Kind;

/// Width of the bins of range in which points on objects are counted.
pub const RANGE_BIN_M: f64 = 10.0;
/// How many such bins are compared.
pub(super) const N_RANGE_BINS: u8 = 5;

/// One property of a data set whose spread is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    PointsPerSample,
    PointRange,
    PointElevation,
    PointRing,
    PointHeight,
    GroundShare,
    ClutterShare,
    IrregularShare,
    /// Distance of a point to the nearest one, in a bin of range.
    PointSpacing(u8),
    Intensity,
    ZeroIntensityShare,
    SaturatedShare,
    RingsReturning,
    AzimuthStep,
    ElevationStep,
    LidarHeight,
    /// Points on an object of a kind, in a bin of range.
    PointsOnObject(Kind, u8),
    Brightness,
    ChannelMean(Channel),
    ChannelDeviation(Channel),
    Contrast,
    Saturation,
    Sharpness,
    PictureWidth,
    PictureHeight,
    HorizontalView,
    VerticalView,
    CameraHeight,
    CameraPitch,
    Speed,
    Steering,
    ObjectsPerSample(Kind),
    ObjectRange(Kind),
    Length(Kind),
    Width(Kind),
    Height(Kind),
}

/// A colour of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channel {
    Red,
    Green,
    Blue,
}

impl Channel {
    pub(super) const ALL: [Self; 3] = [Self::Red, Self::Green, Self::Blue];

    fn name(self) -> &'static str {
        match self {
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
        }
    }
}

/// The unit of a quantity's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Unit {
    #[serde(rename = "1")]
    Count,
    #[serde(rename = "share")]
    Share,
    #[serde(rename = "m")]
    Metre,
    #[serde(rename = "m/s")]
    MetrePerSecond,
    #[serde(rename = "deg")]
    Degree,
    #[serde(rename = "px")]
    Pixel,
    /// Of 0 to 255.
    #[serde(rename = "of 255")]
    Level,
    #[serde(rename = "of 255, squared")]
    LevelSquared,
}

impl Unit {
    /// As it stands in tables; empty for counts.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Count => "",
            Self::Share => "share",
            Self::Metre => "m",
            Self::MetrePerSecond => "m/s",
            Self::Degree => "deg",
            Self::Pixel => "px",
            Self::Level => "of 255",
            Self::LevelSquared => "of 255²",
        }
    }
}

impl Quantity {
    /// All of them, in the order of a data sheet.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![
            Self::PointsPerSample,
            Self::PointRange,
            Self::PointElevation,
            Self::PointRing,
            Self::PointHeight,
            Self::GroundShare,
            Self::ClutterShare,
            Self::IrregularShare,
            Self::Intensity,
            Self::ZeroIntensityShare,
            Self::SaturatedShare,
            Self::RingsReturning,
            Self::AzimuthStep,
            Self::ElevationStep,
            Self::LidarHeight,
        ];
        all.extend((0..N_RANGE_BINS).map(Self::PointSpacing));
        all.extend(
            Kind::ALL
                .into_iter()
                .flat_map(|kind| (0..N_RANGE_BINS).map(move |bin| Self::PointsOnObject(kind, bin))),
        );
        all.push(Self::Brightness);
        all.extend(Channel::ALL.map(Self::ChannelMean));
        all.extend(Channel::ALL.map(Self::ChannelDeviation));
        all.extend([
            Self::Contrast,
            Self::Saturation,
            Self::Sharpness,
            Self::PictureWidth,
            Self::PictureHeight,
            Self::HorizontalView,
            Self::VerticalView,
            Self::CameraHeight,
            Self::CameraPitch,
            Self::Speed,
            Self::Steering,
        ]);
        for of_kind in [Self::ObjectsPerSample, Self::ObjectRange, Self::Length, Self::Width, Self::Height] {
            all.extend(Kind::ALL.map(of_kind));
        }
        all
    }

    /// What a row of the table is called.
    #[must_use]
    pub fn name(self) -> String {
        let name = match self {
            Self::PointsPerSample => "points a sample",
            Self::PointRange => "range of points",
            Self::PointElevation => "elevation of points",
            Self::PointRing => "ring of points",
            Self::PointHeight => "height of points over ground",
            Self::GroundShare => "points on the ground",
            Self::ClutterShare => "clutter among points above ground",
            Self::IrregularShare => "points of no ground, object or flat wall",
            Self::Intensity => "intensity",
            Self::ZeroIntensityShare => "points of intensity 0",
            Self::SaturatedShare => "points of intensity 255",
            Self::RingsReturning => "rings that return",
            Self::AzimuthStep => "azimuth step in a ring",
            Self::ElevationStep => "elevation step between rings",
            Self::LidarHeight => "height of the LiDAR",
            Self::Brightness => "brightness of pixels",
            Self::Contrast => "contrast (deviation of brightness)",
            Self::Saturation => "saturation of colours",
            Self::Sharpness => "sharpness (variance of Laplacian)",
            Self::PictureWidth => "width of pictures",
            Self::PictureHeight => "height of pictures",
            Self::HorizontalView => "horizontal field of view",
            Self::VerticalView => "vertical field of view",
            Self::CameraHeight => "height of the camera",
            Self::CameraPitch => "pitch of the camera, down positive",
            Self::Speed => "speed",
            Self::Steering => "steering, left positive",
            Self::ChannelMean(channel) => return format!("mean of {}", channel.name()),
            Self::ChannelDeviation(channel) => return format!("deviation of {}", channel.name()),
            Self::PointSpacing(bin) => {
                let [near, far] = ends_m(bin);
                return format!("nearest neighbour of points at {near} to {far} m");
            }
            Self::PointsOnObject(kind, bin) => {
                let [near, far] = ends_m(bin);
                return format!("points on a {} at {near} to {far} m", thing(kind));
            }
            Self::ObjectsPerSample(kind) => return format!("{} a sample", things(kind)),
            Self::ObjectRange(kind) => return format!("range of {}", things(kind)),
            Self::Length(kind) => return format!("length of {}", things(kind)),
            Self::Width(kind) => return format!("width of {}", things(kind)),
            Self::Height(kind) => return format!("height of {}", things(kind)),
        };
        name.to_owned()
    }

    #[must_use]
    pub fn unit(self) -> Unit {
        match self {
            Self::PointsPerSample
            | Self::PointRing
            | Self::RingsReturning
            | Self::PointsOnObject(..)
            | Self::ObjectsPerSample(_) => Unit::Count,
            Self::PointRange
            | Self::PointHeight
            | Self::PointSpacing(_)
            | Self::LidarHeight
            | Self::CameraHeight
            | Self::ObjectRange(_)
            | Self::Length(_)
            | Self::Width(_)
            | Self::Height(_) => Unit::Metre,
            Self::GroundShare
            | Self::ClutterShare
            | Self::IrregularShare
            | Self::ZeroIntensityShare
            | Self::SaturatedShare
            | Self::Saturation => Unit::Share,
            Self::Intensity
            | Self::Brightness
            | Self::ChannelMean(_)
            | Self::ChannelDeviation(_)
            | Self::Contrast => Unit::Level,
            Self::Sharpness => Unit::LevelSquared,
            Self::PictureWidth | Self::PictureHeight => Unit::Pixel,
            Self::PointElevation
            | Self::AzimuthStep
            | Self::ElevationStep
            | Self::HorizontalView
            | Self::VerticalView
            | Self::CameraPitch
            | Self::Steering => Unit::Degree,
            Self::Speed => Unit::MetrePerSecond,
        }
    }

    /// Edges of the bins: fine where a sample has many values, coarse where it has one, so that chance fills them alike.
    #[must_use]
    pub fn edges(self) -> Vec<f64> {
        match self {
            Self::PointsPerSample => logarithmic(100.0, 409_600.0, 36),
            Self::PointRange => even(0.0, 100.0, 50),
            Self::PointElevation => even(-32.0, 22.0, 54),
            Self::PointRing => even(-0.5, 127.5, 128),
            Self::PointHeight => even(-2.0, 6.0, 64),
            Self::Intensity => even(0.0, 255.0, 51),
            Self::GroundShare
            | Self::ClutterShare
            | Self::IrregularShare
            | Self::ZeroIntensityShare
            | Self::SaturatedShare
            | Self::Saturation => even(0.0, 1.0, 40),
            Self::PointSpacing(bin) => even(0.0, 0.3 * f64::from(bin + 1), 60),
            Self::RingsReturning => even(-0.5, 128.5, 43),
            Self::AzimuthStep => even(0.0, 1.0, 50),
            Self::ElevationStep | Self::LidarHeight | Self::CameraHeight | Self::Width(_) => {
                even(0.0, 4.0, 40)
            }
            // Whole numbers lie in the middle of their bins, or between the edges of a group of them.
            Self::PointsOnObject(..) => vec![
                -0.5, 0.5, 1.5, 2.5, 5.5, 10.5, 20.5, 50.5, 100.5, 200.5, 500.5, 1000.5, 2000.5, 5000.5,
                10_000.5,
            ],
            Self::Brightness => even(-0.5, 255.5, 64),
            Self::ChannelMean(_) => even(0.0, 255.0, 34),
            Self::ChannelDeviation(_) | Self::Contrast => even(0.0, 128.0, 32),
            Self::Sharpness => logarithmic(1.0, 65_536.0, 32),
            Self::PictureWidth | Self::PictureHeight => even(0.0, 4000.0, 40),
            Self::HorizontalView | Self::VerticalView => even(0.0, 180.0, 60),
            Self::CameraPitch => even(-20.0, 20.0, 40),
            Self::Speed => even(-5.0, 40.0, 45),
            Self::Steering => even(-45.0, 45.0, 45),
            Self::ObjectsPerSample(_) => even(-0.5, 40.5, 41),
            Self::ObjectRange(_) => even(0.0, 100.0, 25),
            Self::Length(_) => even(0.0, 16.0, 64),
            Self::Height(_) => even(0.0, 5.0, 50),
        }
    }
}

/// Ends of a bin of range.
fn ends_m(bin: u8) -> [u32; 2] {
    [bin, bin + 1].map(|edge| u32::from(edge) * RANGE_BIN_M as u32)
}

fn thing(kind: Kind) -> &'static str {
    match kind {
        Kind::Vehicle => "vehicle",
        Kind::Pedestrian => "pedestrian",
        Kind::Static => "static object",
    }
}

fn things(kind: Kind) -> &'static str {
    match kind {
        Kind::Vehicle => "vehicles",
        Kind::Pedestrian => "pedestrians",
        Kind::Static => "static objects",
    }
}

fn even(first: f64, last: f64, n_bins: u32) -> Vec<f64> {
    let edge = |i: u32| (first * f64::from(n_bins - i) + last * f64::from(i)) / f64::from(n_bins);
    (0..=n_bins).map(edge).collect()
}

fn logarithmic(first: f64, last: f64, n_bins: u32) -> Vec<f64> {
    even(first.ln(), last.ln(), n_bins).into_iter().map(f64::exp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quantity_has_a_name_of_its_own_and_rising_edges() {
        let all = Quantity::all();
        let mut names: Vec<String> = all.iter().map(|quantity| quantity.name()).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all.len());
        for quantity in all {
            let edges = quantity.edges();
            assert!(edges.windows(2).all(|pair| pair[0] < pair[1]), "{quantity:?}");
        }
    }

    #[test]
    fn a_quarter_of_the_levels_of_a_picture_fill_a_quarter_of_the_bins() {
        let edges = Quantity::Brightness.edges();
        assert_eq!((edges[0], edges[16], edges[64]), (-0.5, 63.5, 255.5));
    }
}
