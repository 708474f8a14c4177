//! What an episode is made of and with: `gen.toml`.

use serde::{Deserialize, Serialize};

use super::GenerateError;
use crate::scene::PopulateConfig;
use crate::sensors::{Rig, RigConfig, Weather, WeatherOverride};

/// Behaviour and steering act this often; physics in between.
pub(super) const CONTROL_PERIOD_S: f64 = 0.05;

/// The config of `harmzone gen`. How many episodes there are is no part of it, so that a data set can grow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GenerateConfig {
    /// A town that comes with harmzone, or the path of an OpenDRIVE file.
    pub town: String,
    /// By CARLA's names.
    pub weather: String,
    /// Every episode's seed is drawn from this one.
    pub seed: u64,
    /// Samples an episode.
    pub samples: u32,
    /// Simulated time between two samples, a multiple of 0.05 s.
    pub sample_period_s: f64,
    /// Simulated before the first sample, so that cars move and suspensions rest: least and most; each
    /// episode draws its own.
    pub warm_up_s: [f64; 2],
    /// Every this many episodes one is for validation (0: none), the others for training.
    pub val_every: u32,
    /// What stands and moves in the town; with `ood`, all episodes are for testing.
    pub scene: PopulateConfig,
    /// Values that replace those of the named weather.
    pub weather_override: WeatherOverride,
    pub annotation: AnnotationConfig,
    pub render: RenderConfig,
    pub rig: RigConfig,
}

impl Default for GenerateConfig {
    fn default() -> Self {
        Self {
            town: "downtown".into(),
            weather: "ClearNoon".into(),
            seed: 0,
            samples: 40,
            sample_period_s: 0.3,
            warm_up_s: [1.0, 20.0],
            val_every: 6,
            scene: PopulateConfig::default(),
            weather_override: WeatherOverride::default(),
            annotation: AnnotationConfig::default(),
            render: RenderConfig::default(),
            rig: RigConfig::default(),
        }
    }
}

/// Which objects are annotated: those in the camera's view that pass either threshold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AnnotationConfig {
    /// LiDAR returns on the object.
    pub min_lidar_points: u32,
    /// Pixels of the object that can be seen.
    pub min_visible_px: u32,
    /// From the ego's origin to the box's centre, on the ground.
    pub max_range_m: f64,
}

impl Default for AnnotationConfig {
    fn default() -> Self {
        Self { min_lidar_points: 1, min_visible_px: 100, max_range_m: 70.0 }
    }
}

/// Who draws the camera's colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RendererName {
    /// OpenGL, on any machine.
    #[default]
    Classic,
    /// Physically based, by day; needs the wheel `mujoco-studio` and Vulkan, and several times as long.
    Filament,
}

/// How the camera draws.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderConfig {
    pub renderer: RendererName,
    /// Also write depth, instance and category of each pixel as EXR files under `aov/`.
    pub aov: bool,
    /// Against jagged edges; 4 smooths them and takes twice as long.
    pub samples_per_pixel: u32,
    /// Side of the shadow map.
    pub shadow_size_px: u32,
    /// 1 to 100.
    pub jpeg_quality: u8,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self {
            renderer: RendererName::Classic,
            aov: false,
            samples_per_pixel: 0,
            shadow_size_px: 2048,
            jpeg_quality: 90,
        }
    }
}

/// The checked config.
#[derive(Debug, Clone)]
pub struct CheckedConfig {
    pub raw: GenerateConfig,
    pub weather: Weather,
    pub rig: Rig,
    pub(super) control_steps_per_sample: u32,
}

impl TryFrom<&GenerateConfig> for CheckedConfig {
    type Error = GenerateError;

    fn try_from(raw: &GenerateConfig) -> Result<Self, GenerateError> {
        let require = |holds: bool, field, found: String, wanted| {
            if holds { Ok(()) } else { Err(GenerateError::Config { field, found, wanted }) }
        };
        require(!raw.town.is_empty(), "town", "empty".into(), "a name or a path")?;
        require(raw.samples > 0, "samples", raw.samples.to_string(), "at least 1")?;
        let steps = raw.sample_period_s / CONTROL_PERIOD_S;
        let is_whole = (1.0..=1000.0).contains(&steps.round()) && (steps - steps.round()).abs() < 1e-6;
        require(is_whole, "sample_period_s", raw.sample_period_s.to_string(), "a multiple of 0.05 up to 50")?;
        let [least_s, most_s] = raw.warm_up_s;
        require(
            (0.1..=60.0).contains(&least_s) && (least_s..=60.0).contains(&most_s),
            "warm_up_s",
            format!("{least_s} to {most_s}"),
            "two rising numbers in 0.1 to 60",
        )?;
        let quality = raw.render.jpeg_quality;
        require((1..=100).contains(&quality), "render.jpeg_quality", quality.to_string(), "1 to 100")?;
        let n = raw.render.samples_per_pixel;
        require(n <= 16, "render.samples_per_pixel", n.to_string(), "0 to 16")?;
        let share = raw.scene.event_share;
        require((0.0..=1.0).contains(&share), "scene.event_share", share.to_string(), "0 to 1")?;
        let side = raw.render.shadow_size_px;
        require((64..=16384).contains(&side), "render.shadow_size_px", side.to_string(), "64 to 16384")?;
        let range_m = raw.annotation.max_range_m;
        require((1.0..=500.0).contains(&range_m), "annotation.max_range_m", range_m.to_string(), "1 to 500")?;
        Ok(Self {
            raw: raw.clone(),
            weather: raw.weather.parse()?,
            rig: Rig::try_from(&raw.rig)?,
            control_steps_per_sample: steps.round() as u32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_file_equals_the_defaults() {
        let shipped: GenerateConfig = toml::from_str(include_str!("../../configs/gen.toml")).unwrap();
        assert_eq!(shipped, GenerateConfig::default());
        assert_eq!(CheckedConfig::try_from(&shipped).unwrap().control_steps_per_sample, 6);
    }

    #[test]
    fn a_period_between_control_steps_is_refused() {
        let config = GenerateConfig { sample_period_s: 0.32, ..GenerateConfig::default() };
        let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
        assert!(error.contains("sample_period_s") && error.contains("0.32"), "{error}");
    }
}
