//! The car's sensors without the simulator: rig, LiDAR pattern and returns, silhouettes, weather.
//!
//! Pure: nothing here reads a file or a clock; noise comes from the stream that the caller passes.

pub mod camera;
pub mod lidar;
mod rig;
mod silhouette;
mod weather;

pub use rig::{CameraConfig, LidarConfig, LidarPreset, Rig, RigConfig, RigError};
pub use silhouette::silhouette_px;
pub use weather::{
    Daytime, Sky, UnknownWeather, Weather, WeatherOverride, WeatherOverrideError, WeatherState,
};
