//! The car's sensors without the simulator: rig, LiDAR pattern and returns, silhouettes, weather.
//!
//! Pure: nothing here reads a file or a clock; noise comes from the stream that the caller passes.

pub mod camera;
pub mod lidar;
pub mod odometry;
mod rig;
mod rig_config;
mod shipped_rigs;
mod silhouette;
mod variation;
mod weather;

pub use rig::{Rig, RigCamera, RigLidar};
pub use rig_config::{
    IntensityConfig, LidarPreset, LidarSector, OdometryConfig, RigCameraConfig, RigConfig, RigLidarConfig,
};
pub use shipped_rigs::ShippedRig;
pub use silhouette::silhouette_px;
pub use variation::{
    CameraVariationConfig, LidarModels, LidarVariationConfig, OdometryVariationConfig, RigVariationConfig,
};
pub use weather::{SUN_AZIMUTH_RAD, UnknownWeather, Weather, WeatherOverride, WeatherState};
