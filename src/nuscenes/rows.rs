//! Rows of the 13 tables, with the keys of nuScenes' schema. Keys that are not needed are ignored on reading.

use serde::{Deserialize, Serialize};

use super::token::Token;

/// The tables of a version's folder.
pub const TABLES: [&str; 13] = [
    "category",
    "attribute",
    "visibility",
    "instance",
    "sensor",
    "calibrated_sensor",
    "ego_pose",
    "log",
    "scene",
    "sample",
    "sample_data",
    "sample_annotation",
    "map",
];

/// A row of one of the tables.
pub trait TableRow {
    const TABLE: &'static str;

    fn token(&self) -> &Token;
}

macro_rules! table_row {
    ($($(#[$doc:meta])* $name:ident of $table:literal { $($(#[$of:meta])* $field:ident: $type:ty),* $(,)? })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        pub struct $name {
            pub token: Token,
            $($(#[$of])* pub $field: $type),*
        }

        impl TableRow for $name {
            const TABLE: &'static str = $table;

            fn token(&self) -> &Token {
                &self.token
            }
        }
    )*};
}

table_row! {
    /// A class of objects: `vehicle.car`.
    CategoryRow of "category" { name: String, #[serde(default)] description: String }
    /// What an object does: `vehicle.parked`.
    AttributeRow of "attribute" { name: String, #[serde(default)] description: String }
    /// A share of an object that all cameras together see.
    VisibilityRow of "visibility" { level: String, #[serde(default)] description: String }
    /// An object through a scene.
    InstanceRow of "instance" {
        category_token: Token,
        nbr_annotations: usize,
        first_annotation_token: Token,
        last_annotation_token: Token,
    }
    SensorRow of "sensor" { channel: String, modality: String }
    /// A sensor's pose in the ego frame, and a camera's matrix; empty for others.
    CalibratedSensorRow of "calibrated_sensor" {
        sensor_token: Token,
        translation: [f64; 3],
        rotation: [f64; 4],
        camera_intrinsic: Vec<[f64; 3]>,
    }
    EgoPoseRow of "ego_pose" { timestamp: u64, rotation: [f64; 4], translation: [f64; 3] }
    LogRow of "log" {
        #[serde(default)] logfile: String,
        #[serde(default)] vehicle: String,
        #[serde(default)] date_captured: String,
        #[serde(default)] location: String,
        /// Rear axle to front axle: in our exports alone, as the next one. Readers of nuScenes ignore keys that they do not know.
        #[serde(default, skip_serializing_if = "Option::is_none")] wheelbase_m: Option<f64>,
        /// From the rear axle to the front bumper.
        #[serde(default, skip_serializing_if = "Option::is_none")] front_bumper_x_m: Option<f64>,
    }
    SceneRow of "scene" {
        log_token: Token,
        nbr_samples: usize,
        first_sample_token: Token,
        last_sample_token: Token,
        name: String,
        #[serde(default)] description: String,
    }
    SampleRow of "sample" { timestamp: u64, prev: Token, next: Token, scene_token: Token }
    /// A file of a sensor. Sizes are 0 for what is no picture.
    SampleDataRow of "sample_data" {
        sample_token: Token,
        ego_pose_token: Token,
        calibrated_sensor_token: Token,
        timestamp: u64,
        fileformat: String,
        is_key_frame: bool,
        height: u32,
        width: u32,
        filename: String,
        prev: Token,
        next: Token,
    }
    /// An object's box in a sample, in the global frame.
    SampleAnnotationRow of "sample_annotation" {
        sample_token: Token,
        instance_token: Token,
        visibility_token: Token,
        attribute_tokens: Vec<Token>,
        translation: [f64; 3],
        size: [f64; 3],
        rotation: [f64; 4],
        prev: Token,
        next: Token,
        num_lidar_pts: i64,
        num_radar_pts: i64,
    }
    MapRow of "map" { log_tokens: Vec<Token>, category: String, filename: String }
}
