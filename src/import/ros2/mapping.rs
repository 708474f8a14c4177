//! The mapping of an import: which topics and frames of a bag are the LiDAR, the camera, the car and its motion.
//!
//! `configs/import/ros2_mapping.toml` documents every key; `harmzone import ros2 BAG --list` proposes the values.

use serde::{Deserialize, Serialize};

use crate::config::{Check, InvalidConfig, define_config, from_to, impl_checked, part, require};

/// Which time a message has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StampSource {
    /// `header.stamp`: when it was measured.
    Header,
    /// When the recorder got it.
    Log,
}

/// Axes of a camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraAxes {
    /// By where they point.
    Auto,
    /// x right, y down, z forward: REP 103's frames that end in `_optical`.
    Optical,
    /// x forward, y left, z up.
    Body,
}

/// Whether a topic's pictures are rectified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rectified {
    /// Where the topic's name holds the word `rect` or `rectified`.
    Auto,
    Yes,
    No,
}

/// Unit of the times of points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeUnit {
    /// The one that makes a turn last 5 ms to 1 s.
    Auto,
    S,
    Ms,
    Us,
    Ns,
}

define_config! {
    /// Where an import finds what in a bag, unchecked.
    pub struct MappingConfig {
        /// `header` or `log`; default `header`.
        stamps: StampSource = StampSource::Header;
        lidar: LidarMapping = LidarMapping::default(), in part::<LidarMapping>();
        camera: CameraMapping = CameraMapping::default(), in part::<CameraMapping>();
        frames: FrameMapping = FrameMapping::default(), in part::<FrameMapping>();
        poses: PoseMapping = PoseMapping::default();
        speed: FieldMapping = FieldMapping::default(), in part::<FieldMapping>();
        steering: FieldMapping = FieldMapping::default(), in part::<FieldMapping>();
        yaw_rate: FieldMapping = FieldMapping::default(), in part::<FieldMapping>();
        objects: ObjectMapping = ObjectMapping::default();
        vehicle: VehicleMapping = VehicleMapping::default(), in part::<VehicleMapping>();
    }
}

define_config! {
    /// The point cloud, whose messages are the samples.
    pub struct LidarMapping {
        /// A topic of `sensor_msgs/PointCloud2`.
        topic: String = String::new();
        /// The frame of the points; empty: the one that messages name.
        frame: String = String::new();
        /// `auto`, a field's name, or empty for none; default `auto`.
        intensity_field: String = "auto".into();
        /// As above.
        ring_field: String = "auto".into();
        /// As above; when each point was measured.
        time_field: String = "auto".into();
        /// `auto`, `s`, `ms`, `us` or `ns`; default `auto`.
        time_unit: TimeUnit = TimeUnit::Auto;
        /// Whether the driver has compensated the ego's motion already; default false.
        compensated: bool = false;
    }
}

define_config! {
    /// The front camera.
    pub struct CameraMapping {
        /// A topic of `sensor_msgs/Image` or `CompressedImage`; empty: no camera.
        topic: String = String::new();
        /// A topic of `sensor_msgs/CameraInfo`; empty: `k` and the next keys hold.
        info_topic: String = String::new();
        /// The camera's frame; empty: the one that pictures name.
        frame: String = String::new();
        /// `auto`, `optical` or `body`; default `auto`.
        axes: CameraAxes = CameraAxes::Auto;
        /// `auto`, `yes` or `no`; default `auto`.
        rectified: Rectified = Rectified::Auto;
        /// Added to the pictures' stamps, seconds; default 0.
        time_offset_s: f64 = 0.0, in from_to(-10.0, 10.0);
        /// Row by row, 9 numbers, where there is no `info_topic`.
        k: Vec<f64> = Vec::new(), in from_to(-1e6, 1e6).list(0, 9);
        /// Coefficients of the distortion.
        d: Vec<f64> = Vec::new(), in from_to(-1e6, 1e6).list(0, 14);
        /// `plumb_bob`, `rational_polynomial` or `equidistant`.
        distortion_model: String = String::new();
    }
}

define_config! {
    /// The frames of the car and the world.
    pub struct FrameMapping {
        /// A frame fixed to the car: x forward, y left, z up.
        base: String = "base_link".into();
        /// A frame fixed to the world.
        fixed: String = "odom".into();
        /// The middle of the rear axle in the base frame, metres; its height does not count.
        rear_axle_in_base_m: [f64; 3] = [0.0; 3], in from_to(-100.0, 100.0).list(3, 3);
        /// Height of the base frame's origin over the ground, metres; without it tf or a fit tells.
        #[serde(skip_serializing_if = "Option::is_none")]
        base_height_m: Option<f64> = None, in from_to(-100.0, 100.0);
        /// Transforms that the bag's tf lacks; they replace those that it has.
        transforms: Vec<TransformMapping> = Vec::new(), in part::<TransformMapping>();
    }
}

define_config! {
    /// A transform that never changes.
    pub struct TransformMapping {
        parent: String = String::new();
        child: String = String::new();
        /// The child's origin in the parent, metres.
        translation_m: [f64; 3] = [0.0; 3], in from_to(-1e4, 1e4).list(3, 3);
        /// Roll, pitch and yaw, degrees: about the parent's x, then y, then z.
        rotation_rpy_deg: [f64; 3] = [0.0; 3], in from_to(-360.0, 360.0).list(3, 3);
    }
}

define_config! {
    /// Where the ego's poses come from.
    pub struct PoseMapping {
        /// `tf`, a topic of `nav_msgs/Odometry`, `geometry_msgs/PoseStamped` or `PoseWithCovarianceStamped`, or empty:
        /// then speed and yaw rate, or steering, are added up.
        topic: String = "tf".into();
    }
}

define_config! {
    /// A number in the messages of a topic of any type.
    pub struct FieldMapping {
        /// Empty: not measured.
        topic: String = String::new();
        /// `twist.twist.linear.x`, `data`, `axles[0].angle`.
        field: String = String::new();
        /// `m/s`, `km/h` or `mph`; `rad` or `deg`; `rad/s` or `deg/s`. Empty: the first of these.
        unit: String = String::new();
        /// The value is multiplied by this: 1/15 where a steering wheel's angle is known; default 1.
        scale: f64 = 1.0, in from_to(-1e9, 1e9);
        /// Added afterwards, in `unit`; default 0.
        offset: f64 = 0.0, in from_to(-1e9, 1e9);
    }
}

define_config! {
    /// Annotated boxes.
    pub struct ObjectMapping {
        /// A topic of `vision_msgs/Detection3DArray`; empty: nothing is annotated.
        topic: String = String::new();
    }
}

define_config! {
    /// The car; 0 where `[vehicle]` of the import config holds.
    #[derive(Copy)]
    pub struct VehicleMapping {
        /// Rear axle to front axle, metres; default 0.
        wheelbase_m: f64 = 0.0, in from_to(0.0, 100.0);
        /// Rear axle to front bumper, metres; default 0.
        front_bumper_x_m: f64 = 0.0, in from_to(0.0, 100.0);
    }
}

impl_checked!(MappingConfig);

/// Units of a measured number, each with what turns it into SI.
pub const SPEED_UNITS: [(&str, f64); 3] = [("m/s", 1.0), ("km/h", 1.0 / 3.6), ("mph", 0.447_04)];
pub const ANGLE_UNITS: [(&str, f64); 2] = [("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)];
pub const RATE_UNITS: [(&str, f64); 2] = [("rad/s", 1.0), ("deg/s", std::f64::consts::PI / 180.0)];

impl Check for MappingConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let topic = &self.lidar.topic;
        let wanted = "a topic of sensor_msgs/PointCloud2 is needed; `--list` tells which there are";
        require(!topic.is_empty(), "lidar.topic", format!("`{topic}`"), wanted)?;
        let camera = &self.camera;
        let (n_k, wanted) = (camera.k.len(), "9 numbers are needed, row by row, or none");
        require(n_k == 0 || n_k == 9, "camera.k", format!("{n_k} numbers"), wanted)?;
        let has_calibration = camera.topic.is_empty() || !camera.info_topic.is_empty() || n_k == 9;
        let wanted = "a topic of sensor_msgs/CameraInfo is needed, or camera.k";
        require(has_calibration, "camera.info_topic", "empty", wanted)?;
        let fields = [
            ("speed", &self.speed, &SPEED_UNITS[..]),
            ("steering", &self.steering, &ANGLE_UNITS[..]),
            ("yaw_rate", &self.yaw_rate, &RATE_UNITS[..]),
        ];
        for (key, mapping, units) in fields {
            let is_whole = mapping.topic.is_empty() || !mapping.field.is_empty();
            require(
                is_whole,
                &format!("{key}.field"),
                "empty",
                "the path of a number is needed, such as `data`",
            )?;
            let names: Vec<&str> = units.iter().map(|(name, _)| *name).collect();
            let is_unit = mapping.unit.is_empty() || names.contains(&mapping.unit.as_str());
            let wanted = format!("one of {} is needed", names.join(", "));
            require(is_unit, &format!("{key}.unit"), format!("`{}`", mapping.unit), wanted)?;
        }
        Ok(())
    }
}

impl FieldMapping {
    /// A measured number in SI units.
    #[must_use]
    pub fn to_si(&self, value: f64, units: &[(&str, f64)]) -> f64 {
        let factor = units.iter().find(|(name, _)| *name == self.unit).map_or(1.0, |(_, factor)| *factor);
        (value * self.scale + self.offset) * factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::assert_every_number_is_checked;

    #[test]
    fn every_number_is_checked() {
        let lidar = LidarMapping { topic: "/points".into(), ..LidarMapping::default() };
        assert_every_number_is_checked(&MappingConfig { lidar, ..MappingConfig::default() });
    }

    #[test]
    fn the_shipped_mapping_says_every_key_and_equals_the_default() {
        let text = include_str!("../../../configs/import/ros2_mapping.toml");
        assert_eq!(toml::from_str::<MappingConfig>(text).unwrap(), MappingConfig::default());
        let said: toml::Table = text.parse().unwrap();
        let whole = toml::Table::try_from(MappingConfig::default()).unwrap();
        for (key, value) in &whole {
            let said = said.get(key).unwrap_or_else(|| panic!("`{key}` is not said"));
            for key in value.as_table().into_iter().flat_map(toml::Table::keys) {
                assert!(said.get(key).is_some(), "`{key}` is not said");
            }
        }
    }

    #[test]
    fn what_cannot_be_is_refused_in_words() {
        let told = |text: &str| {
            let text = format!("lidar.topic = \"/points\"\n{text}");
            toml::from_str::<MappingConfig>(&text).unwrap().check().unwrap_err().to_string()
        };
        assert!(MappingConfig::default().check().unwrap_err().to_string().contains("--list"));
        assert!(told("camera.topic = \"/image\"").contains("CameraInfo"));
        assert!(told("speed = { topic = \"/v\" }").contains("speed.field is empty"));
        let unit = told("steering = { topic = \"/v\", field = \"data\", unit = \"grad\" }");
        assert_eq!(unit, "steering.unit is `grad`; one of rad, deg is needed");
    }

    #[test]
    fn a_steering_wheels_degrees_become_radians_of_the_wheels() {
        let wheel = FieldMapping { unit: "deg".into(), scale: 0.1, offset: 5.0, ..FieldMapping::default() };
        assert!((wheel.to_si(400.0, &ANGLE_UNITS) - 45f64.to_radians()).abs() < 1e-12);
    }
}
