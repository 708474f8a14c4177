//! The car's sensors without the simulator: rig, LiDAR pattern and returns, silhouettes, weather.
//!
//! Pure: nothing here reads a file or a clock; noise comes from the stream that the caller passes.

pub mod camera;
pub mod lidar;
mod rig;
mod rig_config;
mod silhouette;
mod weather;

pub use rig::{Rig, RigCamera, RigLidar};
pub use rig_config::{LidarPreset, LidarSector, RigCameraConfig, RigConfig, RigLidarConfig};
pub use silhouette::silhouette_px;
pub use weather::{SUN_AZIMUTH_RAD, UnknownWeather, Weather, WeatherOverride, WeatherState};
