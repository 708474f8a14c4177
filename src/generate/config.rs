//! The config of generation: `gen.toml`.

use serde::{Deserialize, Serialize};

use super::GenerateError;
use crate::config::{Check, InvalidConfig, Rule, define_config, from_to, part, require};
use crate::scene::{PopulateConfig, SceneSplit, town_names_of, town_split};
use crate::sensors::{Rig, RigConfig, RigVariationConfig, Weather, WeatherOverride};

/// Behaviour and steering act this often; physics in between.
pub const CONTROL_PERIOD_S: f64 = 0.05;

/// Simulated time begins on 2025-01-01, whatever the wall clock says.
const EPOCH_NS: u64 = 1_735_689_600_000_000_000;

/// Stands for every town of the split that comes with harmzone, and for every weather.
pub const ALL: &str = "all";

define_config! {
    /// The config of `harmzone gen`. The number of episodes is not part of it, so that a data set can grow.
    pub struct GenerateConfig {
        /// Towns that come with harmzone, or paths of OpenDRIVE files; `"all"` stands for all of the former that are
        /// for the split.
        towns: Vec<String> = vec!["downtown".into()];
        /// CARLA's names; `"all"` stands for all. The episodes take each pair of town and weather equally
        /// often.
        weathers: Vec<String> = vec!["ClearNoon".into()];
        /// Every episode's seed is drawn from this one.
        seed: u64 = 0, in Rule::Any;
        /// Samples per episode.
        samples: u32 = 40, in from_to(1.0, 100_000.0);
        /// Simulated time between two samples, a multiple of 0.05 s.
        sample_period_s: f64 = 0.3, in from_to(CONTROL_PERIOD_S, 50.0);
        /// Turns of each LiDAR between two samples, evenly spaced, a multiple of 0.05 s apart; nuScenes has 9 in 0.5 s.
        sweeps: u32 = 0, in from_to(0.0, 1000.0);
        /// Simulated before the first sample, so that cars move and suspensions rest: least and most; each
        /// episode draws its own.
        warm_up_s: [f64; 2] = [1.0, 20.0], in from_to(0.1, 60.0).pair();
        /// One of this many episodes is for validation (0: none), the others are for training. It need not be
        /// whole: 4.5 takes two of nine.
        val_every: f64 = 6.0, in from_to(0.0, 1e6);
        /// What casts the LiDAR's rays.
        lidar_engine: LidarEngine = LidarEngine::Bvh;
        /// What stands and moves in the town, and what the episodes are for.
        scene: PopulateConfig = PopulateConfig::default(), in part::<PopulateConfig>();
        /// Values that replace those of the named weather.
        weather_override: WeatherOverride = WeatherOverride::default(), in part::<WeatherOverride>();
        annotation: AnnotationConfig = AnnotationConfig::default(), in part::<AnnotationConfig>();
        render: RenderConfig = RenderConfig::default(), in part::<RenderConfig>();
        rig: RigConfig = RigConfig::default(), in part::<RigConfig>();
        /// Gives each episode a rig of its own, drawn around `rig`.
        rig_variation: RigVariationConfig = RigVariationConfig::default(), in part::<RigVariationConfig>();
    }
}

define_config! {
    /// Which objects are annotated: those in the camera's view that pass either threshold.
    pub struct AnnotationConfig {
        /// LiDAR returns on the object.
        min_lidar_points: u32 = 1, in from_to(0.0, 1e6);
        /// Pixels of the object that can be seen.
        min_visible_px: u32 = 20, in from_to(0.0, 1e8);
        /// From the ego's origin to the box's centre, on the ground.
        max_range_m: f64 = 70.0, in from_to(1.0, 500.0);
    }
}

/// Renderer of the camera image.
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

/// What casts the LiDAR's rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarEngine {
    /// Trees of our own over the world's triangles ([`crate::rays`]).
    #[default]
    Bvh,
    /// `mj_multiRay`: knows every kind of geom, some thirty times as slow.
    Mujoco,
}

impl LidarEngine {
    pub const ALL: [Self; 2] = [Self::Bvh, Self::Mujoco];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bvh => "bvh",
            Self::Mujoco => "mujoco",
        }
    }
}

define_config! {
    /// How the camera image is rendered.
    pub struct RenderConfig {
        /// What draws the pictures.
        renderer: RendererName = RendererName::Classic;
        /// Also write depth, instance and category of each pixel as EXR files under `aov/`.
        aov: bool = false;
        /// Samples against jagged edges; 4 smooths them and takes twice as long.
        samples_per_pixel: u32 = 0, in from_to(0.0, 16.0);
        /// Side of the shadow map.
        shadow_size_px: u32 = 2048, in from_to(64.0, 16384.0);
        /// 1 to 100.
        jpeg_quality: u8 = 85, in from_to(1.0, 100.0);
    }
}

impl Check for GenerateConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let (every, steps) = (self.val_every, self.control_steps_per_sample());
        let is_valid = every == 0.0 || every >= 1.0;
        require(is_valid, "val_every", every, "0, or a number from 1 to 1000000 is needed")?;
        let of_scene = self.scene.ood_placement.check_shares().and(self.scene.people.check_shares());
        of_scene.map_err(|error| error.within("scene"))?;
        self.rig.check_relations().map_err(|error| error.within("rig"))?;
        self.rig_variation.check_relations().map_err(|error| error.within("rig_variation"))?;
        let (is_whole, wanted) =
            ((steps - steps.round()).abs() < 1e-6, "a multiple of 0.05 up to 50 is needed");
        require(is_whole, "sample_period_s", self.sample_period_s, wanted)?;
        let n_steps = steps.round() as u32;
        let fitting = (1..=n_steps).filter(|n_turns| n_steps.is_multiple_of(*n_turns));
        let fitting: Vec<String> = fitting.map(|n_turns| (n_turns - 1).to_string()).collect();
        let wanted = format!(
            "one of {} is needed, which split {} s into multiples of 0.05 s",
            fitting.join(", "),
            self.sample_period_s
        );
        require(n_steps.is_multiple_of(self.sweeps + 1), "sweeps", self.sweeps, wanted)
    }
}

impl GenerateConfig {
    fn control_steps_per_sample(&self) -> f64 {
        self.sample_period_s / CONTROL_PERIOD_S
    }
}

/// The checked config.
#[derive(Debug, Clone)]
pub struct CheckedConfig {
    /// The config, with the names that [`ALL`] stood for.
    pub raw: GenerateConfig,
    pub weathers: Vec<Weather>,
    pub rig: Rig,
    pub control_steps_per_sample: u32,
}

impl CheckedConfig {
    /// Time of a sample.
    pub(super) fn time_ns(&self, sample_idx: u64) -> u64 {
        EPOCH_NS + sample_idx * self.period_ns()
    }

    /// Time between two samples.
    pub(super) fn period_ns(&self) -> u64 {
        (self.raw.sample_period_s * 1e9).round() as u64
    }
}

impl TryFrom<&GenerateConfig> for CheckedConfig {
    type Error = GenerateError;

    fn try_from(raw: &GenerateConfig) -> Result<Self, GenerateError> {
        raw.check()?;
        let split = raw.scene.split;
        let towns = expand("towns", &raw.towns, || town_names_of(split))?;
        check_towns(&towns, split)?;
        let weathers = expand("weathers", &raw.weathers, weather_names)?;
        Ok(Self {
            weathers: weathers.iter().map(|name| name.parse()).collect::<Result<_, _>>()?,
            raw: GenerateConfig { towns, weathers, ..raw.clone() },
            rig: Rig::try_from(&raw.rig).map_err(|error| error.within("rig"))?,
            control_steps_per_sample: raw.control_steps_per_sample().round() as u32,
        })
    }
}

/// The weathers that are simulated.
fn weather_names() -> Vec<String> {
    Weather::ALL.iter().map(|weather| weather.name().to_owned()).collect()
}

/// Refuses a town that is kept for the other split.
fn check_towns(towns: &[String], split: SceneSplit) -> Result<(), InvalidConfig> {
    let is_other = |town: &&String| town_split(town).is_some_and(|of_town| of_town != split);
    match towns.iter().find(is_other) {
        None => Ok(()),
        Some(town) => Err(InvalidConfig::new(
            "towns",
            format!("{town:?}, which is not for split {}", split.name()),
            format!(
                "it takes {:?}, \"{ALL}\" for all of them, and paths of other maps",
                town_names_of(split)
            ),
        )),
    }
}

/// The names, with all that exist in place of [`ALL`]; refuses a name that occurs twice.
fn expand(
    key: &'static str,
    names: &[String],
    all: impl Fn() -> Vec<String>,
) -> Result<Vec<String>, InvalidConfig> {
    let fail = |found: String| InvalidConfig::new(key, found, "a list of different names is needed");
    let all_of = |name: &String| if name == ALL { all() } else { vec![name.clone()] };
    let expanded: Vec<String> = names.iter().flat_map(all_of).collect();
    if expanded.is_empty() {
        return Err(fail("empty".into()));
    }
    for (i, name) in expanded.iter().enumerate() {
        if name.is_empty() || expanded[..i].contains(name) {
            return Err(fail(format!("{names:?}")));
        }
    }
    Ok(expanded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_file_equals_the_defaults() {
        let shipped: GenerateConfig = toml::from_str(include_str!("../../configs/gen.toml")).unwrap();
        assert_eq!(shipped, GenerateConfig::default());
        crate::config::assert_every_number_is_checked(&shipped);
        assert_eq!(CheckedConfig::try_from(&shipped).unwrap().control_steps_per_sample, 6);
    }

    #[test]
    fn all_stands_for_every_town_and_weather_that_there_is() {
        let all = vec![ALL.to_owned()];
        let config = GenerateConfig { towns: all.clone(), weathers: all, ..GenerateConfig::default() };
        let checked = CheckedConfig::try_from(&config).unwrap();
        assert_eq!(checked.raw.towns, town_names_of(SceneSplit::Dev));
        assert_eq!(checked.weathers, Weather::ALL);
        assert_eq!(CheckedConfig::try_from(&checked.raw).unwrap().raw, checked.raw);
    }

    #[test]
    fn a_town_is_only_for_its_own_split_and_a_users_map_for_both() {
        for split in SceneSplit::ALL {
            let of_towns = |towns: &[&str]| {
                let towns = towns.iter().map(|&town| town.to_owned()).collect();
                let scene = PopulateConfig { split, ..PopulateConfig::default() };
                CheckedConfig::try_from(&GenerateConfig { towns, scene, ..GenerateConfig::default() })
            };
            assert!(of_towns(&["maps/Town01.xodr", "maps/Town02.xodr"]).is_ok());
            let checked = of_towns(&[ALL, "maps/Town01.xodr"]);
            let n_shipped = town_names_of(split).len();
            assert_eq!(checked.unwrap().raw.towns.len(), n_shipped + 1);
            let other = SceneSplit::ALL.into_iter().find(|other| *other != split).unwrap();
            for town in town_names_of(other) {
                let message = of_towns(&[&town]).unwrap_err().to_string();
                let valid = format!("{:?}", town_names_of(split));
                assert!(message.contains(&town) && message.contains(&valid), "{message}");
            }
        }
    }

    #[test]
    fn relations_of_the_parts_are_told_with_the_part() {
        for (change, wanted) in [
            (
                "scene.people.standing_share=0.9",
                "scene.people is [0.9, 0.06, 0.03, 0.05, 0.02, 0.06] as shares",
            ),
            ("scene.ood_placement.lane_share=0.9", "scene.ood_placement is [0.9, "),
            (
                "rig.lidars.lidar_top.lost_beams=[32]",
                "rig.lidars.lidar_top.lost_beams is [32]; numbers of its 32",
            ),
            ("rig.cameras={}", "rig.cameras is []; one named cam_front is needed"),
        ] {
            let config = crate::config::with_overrides(&GenerateConfig::default(), &[change.into()]).unwrap();
            let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
            assert!(error.starts_with(wanted), "{change}: {error}");
        }
    }

    #[test]
    fn no_name_and_a_name_given_twice_are_refused() {
        for towns in [vec![], vec!["downtown"; 2], vec!["all", "downtown"]] {
            let towns: Vec<String> = towns.into_iter().map(str::to_owned).collect();
            let config = GenerateConfig { towns, ..GenerateConfig::default() };
            let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
            assert!(error.starts_with("towns is "), "{error}");
        }
    }

    #[test]
    fn sweeps_that_do_not_fall_on_control_steps_are_refused() {
        let config = GenerateConfig { sweeps: 9, ..GenerateConfig::default() };
        let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
        assert!(error.contains("sweeps is 9; one of 0, 1, 2, 5 is needed"), "{error}");
        let config = GenerateConfig { sweeps: 9, sample_period_s: 0.5, ..GenerateConfig::default() };
        assert!(CheckedConfig::try_from(&config).is_ok());
    }

    #[test]
    fn a_period_between_control_steps_is_refused() {
        let config = GenerateConfig { sample_period_s: 0.32, ..GenerateConfig::default() };
        let error = CheckedConfig::try_from(&config).unwrap_err().to_string();
        assert!(error.contains("sample_period_s") && error.contains("0.32"), "{error}");
    }
}
