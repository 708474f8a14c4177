//! What an episode is made of and with: `gen.toml`.

use serde::{Deserialize, Serialize};

use super::GenerateError;
use crate::scene::{PopulateConfig, town_names};
use crate::sensors::{Rig, RigConfig, Weather, WeatherOverride};

/// Behaviour and steering act this often; physics in between.
pub(super) const CONTROL_PERIOD_S: f64 = 0.05;

/// Stands for every town that comes with harmzone, and for every weather.
pub const ALL: &str = "all";

/// The config of `harmzone gen`. How many episodes there are is no part of it, so that a data set can grow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GenerateConfig {
    /// Towns that come with harmzone, or paths of OpenDRIVE files; [`ALL`] stands for all of the former.
    pub towns: Vec<String>,
    /// By CARLA's names; [`ALL`] stands for all. The episodes take each pair of town and weather equally often.
    pub weathers: Vec<String>,
    /// Every episode's seed is drawn from this one.
    pub seed: u64,
    /// Samples an episode.
    pub samples: u32,
    /// Simulated time between two samples, a multiple of 0.05 s.
    pub sample_period_s: f64,
    /// Simulated before the first sample, so that cars move and suspensions rest: least and most; each
    /// episode draws its own.
    pub warm_up_s: [f64; 2],
    /// Every this many episodes one is for validation (0: none), the others for training. Need not be
    /// whole: 4.5 takes two of nine.
    pub val_every: f64,
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
            towns: vec!["downtown".into()],
            weathers: vec!["ClearNoon".into()],
            seed: 0,
            samples: 40,
            sample_period_s: 0.3,
            warm_up_s: [1.0, 20.0],
            val_every: 6.0,
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
        Self { min_lidar_points: 1, min_visible_px: 20, max_range_m: 70.0 }
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

impl RendererName {
    pub const ALL: [Self; 2] = [Self::Classic, Self::Filament];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Classic => "classic",
            Self::Filament => "filament",
        }
    }
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
            jpeg_quality: 85,
        }
    }
}

/// The checked config.
#[derive(Debug, Clone)]
pub struct CheckedConfig {
    /// With the names that [`ALL`] stood for.
    pub raw: GenerateConfig,
    pub weathers: Vec<Weather>,
    pub rig: Rig,
    pub(super) control_steps_per_sample: u32,
}

impl TryFrom<&GenerateConfig> for CheckedConfig {
    type Error = GenerateError;

    fn try_from(raw: &GenerateConfig) -> Result<Self, GenerateError> {
        let require = |holds: bool, field, found: String, wanted| {
            if holds { Ok(()) } else { Err(GenerateError::Config { field, found, wanted }) }
        };
        let towns = expanded("towns", &raw.towns, town_names)?;
        let weathers = expanded("weathers", &raw.weathers, weather_names)?;
        let every = raw.val_every;
        require(
            every == 0.0 || (1.0..=1e6).contains(&every),
            "val_every",
            every.to_string(),
            "0, or 1 or more",
        )?;
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
        for weather in &weathers {
            weather.parse::<Weather>()?.state().replaced(&raw.weather_override)?;
        }
        Ok(Self {
            weathers: weathers.iter().map(|name| name.parse()).collect::<Result<_, _>>()?,
            raw: GenerateConfig { towns, weathers, ..raw.clone() },
            rig: Rig::try_from(&raw.rig)?,
            control_steps_per_sample: steps.round() as u32,
        })
    }
}

/// The weathers that are simulated.
fn weather_names() -> Vec<String> {
    Weather::ALL.iter().map(|weather| weather.name().to_owned()).collect()
}

/// The names, with all that exist in place of [`ALL`]; none may be there twice.
fn expanded(
    field: &'static str,
    names: &[String],
    all: impl Fn() -> Vec<String>,
) -> Result<Vec<String>, GenerateError> {
    let fail = |found: String| GenerateError::Config { field, found, wanted: "a list of different names" };
    if names == [ALL] {
        return Ok(all());
    }
    if names.is_empty() {
        return Err(fail("empty".into()));
    }
    for (i, name) in names.iter().enumerate() {
        if name.is_empty() || name == ALL || names[..i].contains(name) {
            return Err(fail(format!("{names:?}")));
        }
    }
    Ok(names.to_vec())
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
    fn all_stands_for_every_town_and_weather_that_there_is() {
        let all = vec![ALL.to_owned()];
        let config = GenerateConfig { towns: all.clone(), weathers: all, ..GenerateConfig::default() };
        let checked = CheckedConfig::try_from(&config).unwrap();
        assert_eq!(checked.raw.towns, town_names());
        assert_eq!(checked.weathers, Weather::ALL);
        assert_eq!(CheckedConfig::try_from(&checked.raw).unwrap().raw, checked.raw);
    }

    #[test]
    fn no_name_and_a_name_given_twice_are_refused() {
        for towns in [vec![], vec!["downtown"; 2], vec!["all", "downtown"]] {
            let towns: Vec<String> = towns.into_iter().map(str::to_owned).collect();
            let config = GenerateConfig { towns, ..GenerateConfig::default() };
            let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
            assert!(error.contains("`towns`"), "{error}");
        }
    }

    #[test]
    fn a_period_between_control_steps_is_refused() {
        let config = GenerateConfig { sample_period_s: 0.32, ..GenerateConfig::default() };
        let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
        assert!(error.contains("sample_period_s") && error.contains("0.32"), "{error}");
    }
}
