//! The nuScenes format: rows of its tables, tokens, axes, point files, CAN messages, official names.
//!
//! What importing and exporting share. Nothing here reads or writes a file. Sizes are `[width, length, height]`, rotations
//! `[w, x, y, z]`, times microseconds; `global` is our world, `ego` our ego. The LiDAR's x points right and its y forward.

mod can_bus;
mod classes;
mod cloud;
mod pose;
mod rows;
mod scene_names;
mod token;

pub use can_bus::{CanPose, STEERING_RATIO, SteeringWheel, VehicleMonitor};
pub use classes::{ATTRIBUTES, CAR_TRUCK, default_attribute, detection_class, official_category};
pub use cloud::{CloudFault, POINT_BYTES, read_cloud, write_cloud};
pub use pose::{PoseFault, isometry_of, quarter_turn, rotation_of, translation_of};
pub use rows::{
    AttributeRow, CalibratedSensorRow, CategoryRow, EgoPoseRow, InstanceRow, LogRow, MapRow,
    SampleAnnotationRow, SampleDataRow, SampleRow, SceneRow, SensorRow, TABLES, TableRow, VisibilityRow,
};
pub use scene_names::{SceneSection, scene_names};
pub use token::Token;
