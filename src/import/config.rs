//! The config of an import: what a format's files do not say of the car, and how its annotations are to be read.
//!
//! Each format ships its own, `configs/import/<format>.toml`; a user's file and `--set` go over it.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::config::{
    self, Check, Checked, ConfigError, InvalidConfig, above, define_config, from_to, impl_checked, part,
    require,
};
use crate::episode::{Labelled, SizeRange};
use crate::object::{Distribution, Kind};

/// The formats that can be imported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    Nuscenes,
    Kitti,
    Av2,
    Ros2,
}

impl LogFormat {
    pub const ALL: [Self; 4] = [Self::Nuscenes, Self::Kitti, Self::Av2, Self::Ros2];

    /// The name in commands and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nuscenes => "nuscenes",
            Self::Kitti => "kitti",
            Self::Av2 => "av2",
            Self::Ros2 => "ros2",
        }
    }

    /// The config that comes with harmzone.
    fn shipped_toml(self) -> &'static str {
        match self {
            Self::Nuscenes => include_str!("../../configs/import/nuscenes.toml"),
            Self::Kitti => include_str!("../../configs/import/kitti.toml"),
            Self::Av2 => include_str!("../../configs/import/av2.toml"),
            Self::Ros2 => include_str!("../../configs/import/ros2.toml"),
        }
    }
}

/// The scale of a log's intensities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntensityScale {
    /// 0 to 1 where the first frame of a drive has nothing above 1, else 0 to 255.
    Auto,
    /// 0 to 1.
    Unit,
    /// 0 to 255.
    Byte,
}

/// Where the ground's height in the ego frame comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundSource {
    /// What the log or this config says; fitted only where neither does.
    Calibration,
    /// A plane through the road's points near the car.
    Fit,
}

/// What becomes of the objects of one of the log's categories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "valid is \"ignore\" or { kind = \"vehicle | pedestrian | static\", distribution = \"id | ood\" }"
)]
pub enum CategoryRule {
    Ignore(IgnoreWord),
    Object(ObjectRule),
}

/// `"ignore"`: nobody says whether a detection there is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IgnoreWord {
    Ignore,
}

/// The kind of a category's objects, and whether detectors were trained on such.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectRule {
    pub kind: Kind,
    pub distribution: Distribution,
}

define_config! {
    /// How a log is imported, unchecked.
    pub struct ImportConfig {
        /// Of each drive, every so many samples; default 1.
        every: u32 = 1, in from_to(1.0, 1e6);
        /// The car, where the log does not describe it.
        vehicle: VehicleConfig = VehicleConfig::default(), in part::<VehicleConfig>();
        /// The state where neither odometry nor poses tell it.
        assumed: AssumedConfig = AssumedConfig::default(), in part::<AssumedConfig>();
        /// Where the LiDAR sits in the ego frame if the log does not say it, metres; default [1.0, 0.0, 1.8].
        lidar_mount_m: [f64; 3] = [1.0, 0.0, 1.8], in from_to(-100.0, 100.0).list(3, 3);
        /// How far the stamps of one sample may lie apart, and poses may end before it, seconds; default 0.05.
        stamp_tolerance_s: f64 = 0.05, in above(0.0, 10.0);
        /// Poses within this time of a sample make its speed and steering, seconds; default 0.5.
        smoothing_s: f64 = 0.5, in above(0.0, 10.0);
        /// Whether points with stamps are moved to where the ego was at the sample's time; default true.
        compensate_motion: bool = true;
        /// `auto`, `unit` (0 to 1) or `byte` (0 to 255); default `auto`.
        intensity: IntensityScale = IntensityScale::Auto;
        /// `calibration` or `fit`; default `calibration`.
        ground: GroundSource = GroundSource::Calibration;
        /// Rings, where the log has none.
        rings: RingConfig = RingConfig::default(), in part::<RingConfig>();
        /// The log's names of further cameras that become topics beside the front one; default none.
        cameras: Vec<String> = Vec::new();
        /// Of pictures that are rectified or that the log holds unpacked, 1 to 100; default 95.
        jpeg_quality: u8 = 95, in from_to(1.0, 100.0);
        /// The log's categories, each `"ignore"` or `{ kind = .., distribution = .. }`.
        categories: BTreeMap<String, CategoryRule> = BTreeMap::new();
        /// What the log annotates.
        labelled: LabelledConfig = LabelledConfig::default(), in part::<LabelledConfig>();
    }
}

define_config! {
    /// The car.
    #[derive(Copy)]
    pub struct VehicleConfig {
        /// Metres; default 2.7.
        wheelbase_m: f64 = 2.7, in above(0.0, 100.0);
        /// From the rear axle to the front bumper, metres; default 3.6.
        front_bumper_x_m: f64 = 3.6, in above(0.0, 100.0);
        /// The steering wheel's angle over the road wheels', where a log tells the wheel's; default 15.2, a usual car's.
        steering_ratio: f64 = 15.2, in above(0.0, 100.0);
    }
}

define_config! {
    /// The ego's state where nothing is known of it.
    #[derive(Copy)]
    pub struct AssumedConfig {
        /// Metres per second; default 8.
        speed_mps: f64 = 8.0, in from_to(-100.0, 100.0);
        /// Road-wheel angle, degrees, positive to the left; default 0.
        steering_angle_deg: f64 = 0.0, in from_to(-80.0, 80.0);
    }
}

define_config! {
    /// How rings are computed from the elevation of points.
    pub struct RingConfig {
        /// Rings of equal height between the lowest and the highest beam, where `elevations_deg` is empty; default 32.
        n_rings: u16 = 32, in from_to(1.0, 4096.0);
        /// The beams' elevations, degrees, rising; a point belongs to the nearest; default none.
        elevations_deg: Vec<f64> = Vec::new(), in from_to(-90.0, 90.0).rising(0, 4096);
    }
}

define_config! {
    /// What a log annotates: the ground of a fair score.
    pub struct LabelledConfig {
        /// Kinds of things that the log annotates.
        kinds: Vec<Kind> = Kind::ALL.to_vec();
        /// Distance from the ego to which it annotates, metres; 0 for no limit; default 0.
        max_range_m: f64 = 0.0, in from_to(0.0, 1e4);
        /// Whether only what the front camera sees is annotated; default false.
        in_camera_view: bool = false;
        /// Sizes of annotated vehicles.
        vehicle: SizeConfig = SizeConfig { length_m: [1.0, 25.0], width_m: [0.3, 4.0], height_m: [0.7, 5.0] },
            in part::<SizeConfig>();
        /// Sizes of annotated pedestrians.
        pedestrian: SizeConfig = SizeConfig { length_m: [0.2, 1.8], width_m: [0.2, 1.5], height_m: [0.6, 2.3] },
            in part::<SizeConfig>();
        /// Sizes of annotated static things.
        static_object: SizeConfig = SizeConfig { length_m: [0.1, 5.0], width_m: [0.1, 5.0], height_m: [0.2, 5.0] },
            in part::<SizeConfig>();
    }
}

define_config! {
    /// Least and largest sizes of boxes.
    pub struct SizeConfig {
        /// Metres.
        length_m: [f64; 2] = [0.1, 30.0], in above(0.0, 100.0).pair();
        /// Metres.
        width_m: [f64; 2] = [0.1, 10.0], in above(0.0, 100.0).pair();
        /// Metres.
        height_m: [f64; 2] = [0.1, 10.0], in above(0.0, 100.0).pair();
    }
}

impl_checked!(ImportConfig);

impl Check for ImportConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        for (category, rule) in &self.categories {
            if let CategoryRule::Object(rule) = rule {
                let key = format!("categories.{category}");
                let wanted = "a kind of labelled.kinds is needed, or \"ignore\"";
                require(self.labelled.kinds.contains(&rule.kind), &key, rule.kind.name(), wanted)?;
            }
        }
        Ok(())
    }
}

impl ImportConfig {
    /// A format's config: the shipped one, then what the file says if one is given, then the overrides.
    ///
    /// # Errors
    /// As [`config::load`].
    pub fn load(format: LogFormat, path: Option<&Path>, overrides: &[String]) -> Result<Self, ConfigError> {
        config::load_over(&Self::shipped(format), path, overrides)
    }

    /// The config that comes with harmzone for a format.
    #[must_use]
    pub fn shipped(format: LogFormat) -> Self {
        toml::from_str(format.shipped_toml()).expect("a test reads every shipped config")
    }
}

impl LabelledConfig {
    /// The facts for the episode, with the categories that are no `"ignore"`.
    pub(super) fn facts(&self, categories: &BTreeMap<String, CategoryRule>) -> Labelled {
        let sizes = self.kinds.iter().map(|&kind| {
            let size = match kind {
                Kind::Vehicle => &self.vehicle,
                Kind::Pedestrian => &self.pedestrian,
                Kind::Static => &self.static_object,
            };
            (kind, size.range())
        });
        let is_object = |rule: &CategoryRule| matches!(rule, CategoryRule::Object(_));
        let categories = categories.iter().filter(|(_, rule)| is_object(rule));
        Labelled {
            kinds: self.kinds.clone(),
            categories: categories.map(|(category, _)| category.clone()).collect(),
            max_range_m: (self.max_range_m > 0.0).then_some(self.max_range_m),
            in_camera_view: self.in_camera_view,
            sizes: sizes.collect(),
        }
    }
}

impl SizeConfig {
    fn range(&self) -> SizeRange {
        SizeRange { length_m: self.length_m, width_m: self.width_m, height_m: self.height_m }
    }
}

/// What the pipeline works with.
pub(super) type CheckedImport = Checked<ImportConfig>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_config_holds_and_says_each_key() {
        for format in LogFormat::ALL {
            let shipped = ImportConfig::shipped(format);
            shipped.check().unwrap();
            let said: toml::Table = format.shipped_toml().parse().unwrap();
            let whole = toml::Table::try_from(&shipped).unwrap();
            let missing: Vec<&String> = whole.keys().filter(|key| !said.contains_key(*key)).collect();
            assert!(missing.is_empty(), "{}: {missing:?}", format.name());
        }
    }

    #[test]
    fn every_number_is_checked() {
        config::assert_every_number_is_checked(&ImportConfig::default());
    }

    #[test]
    fn one_category_can_be_changed() {
        let config =
            ImportConfig::load(LogFormat::Kitti, None, &["categories.Misc=ignore".to_owned()]).unwrap();
        assert_eq!(config.categories["Misc"], CategoryRule::Ignore(IgnoreWord::Ignore));
        assert!(matches!(config.categories["Car"], CategoryRule::Object(_)));
        let wrong = ImportConfig::load(LogFormat::Kitti, None, &["categories.Misc=nothing".to_owned()]);
        assert!(wrong.unwrap_err().to_string().contains("valid is \"ignore\""));
    }
}
