//! What is known about a sample beyond its boxes; scores are broken down by these facts.
//!
//! Every fact may be missing: a file of boxes may hold any of them, a data set of ours holds all. A score
//! that needs a fact leaves out what lacks it. Metres, m/s, radians, seconds; the zone in the ego frame.

use std::collections::HashSet;
use std::path::Path;

use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

use super::DatasetError;
use super::coverage::CameraFacts;
use crate::episode::{EpisodeMeta, Labelled, LogFacts};
use crate::geometry::{
    Box3, Ego, Frame, Lidar, Point, Point2, convex_signed_distance_m, distance_to_convex_m,
};
use crate::sample::{EgoState, IgnoredRegion, LidarPoint, Measured};
use crate::sensors::{RigConfig, Weather, WeatherOverride};
use crate::zone::{Zone, ZoneAt};

/// Facts of a sample.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SampleFacts {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode: Option<String>,
    /// From any start that the samples of an episode share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub town: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weather: Option<String>,
    /// Meteorological optical range of haze or fog.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mor_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rain_rate_mmph: Option<f64>,
    /// Beams of the LiDAR that are alive, where the episode tells its rig; else its rings with a point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_lidar_rings: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steering_angle_rad: Option<f64>,
    /// Where the ego is, in a frame that stands still: x, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_in_world_m: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub front_bumper_x_m: Option<f64>,
    /// Corners of the danger zone, convex: x, y. Datasets have it for the zone `rect` alone: the others bend,
    /// and what `ttc` and `rss` say about an object is not the distance to one edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zone_in_ego_m: Option<Vec<[f64; 2]>>,
    /// What is annotated; `None` where all kinds are, as in simulation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labelled: Option<Labelled>,
    /// Where nobody annotated anything.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignored: Vec<IgnoredRegion>,
    /// The front camera, where one of the two facts above needs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraFacts>,
    /// Whether nobody annotated the sample at all, so that there is nothing to score.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_unlabelled: bool,
}

impl SampleFacts {
    /// These facts without all but what the truth leaves out.
    #[must_use]
    pub fn coverage(&self) -> Self {
        let Self { labelled, ignored, camera, is_unlabelled, .. } = self.clone();
        Self { labelled, ignored, camera, is_unlabelled, ..Self::default() }
    }

    /// Whether a size may say that nobody annotated a thing, for which the points in a box must be known.
    #[must_use]
    pub fn needs_points(&self) -> bool {
        let tells = |labelled: &Labelled| labelled.kinds.iter().all(|kind| labelled.sizes.contains_key(kind));
        self.labelled.as_ref().is_some_and(tells)
    }

    /// Signed distance of a box's footprint to the zone's edge, metres: positive the gap, negative how deep it reaches
    /// in. `None` where the zone is not known.
    #[must_use]
    pub fn zone_distance_m(&self, of: &Box3<Ego>) -> Option<f64> {
        let corners = self.zone_in_ego_m.as_ref()?.iter();
        let zone: SmallVec<[Point2; 4]> = corners.map(|&[x_m, y_m]| Point2 { x_m, y_m }).collect();
        (zone.len() >= 3).then(|| convex_signed_distance_m(&zone, &of.footprint()))
    }

    /// Distance from the middle of the front bumper to a box's footprint, metres on the ground.
    #[must_use]
    pub fn gap_ahead_m(&self, of: &Box3<Ego>) -> Option<f64> {
        let bumper = Point2 { x_m: self.front_bumper_x_m?, y_m: 0.0 };
        Some(distance_to_convex_m(bumper, &of.footprint()))
    }
}

/// What all samples of an episode share.
#[derive(Debug)]
pub(super) struct Origin {
    facts: SampleFacts,
    start_ns: u64,
}

/// The part of an episode's config that changes the meaning of its weather's name.
#[derive(Default, Deserialize)]
#[serde(default)]
struct ChangedWeather {
    weather_override: WeatherOverride,
}

impl Origin {
    /// The facts of the episode with this metadata. The state of a weather whose name is not ours is unknown.
    ///
    /// # Errors
    /// The config in the episode's metadata is not valid.
    pub fn of_episode(
        meta: &EpisodeMeta,
        log: Option<&LogFacts>,
        path: &Path,
        start_ns: u64,
    ) -> Result<Self, DatasetError> {
        let fail = |message| DatasetError::Config { message, path: path.to_owned() };
        let changed: ChangedWeather =
            toml::from_str(&meta.config_toml).map_err(|error| fail(error.to_string()))?;
        let named = meta.weather.parse::<Weather>().ok();
        let state = named.map(|weather| weather.state().replace_by(&changed.weather_override)).transpose();
        let state = state.map_err(|error| fail(error.to_string()))?;
        let facts = SampleFacts {
            episode: Some(meta.name.clone()),
            town: Some(meta.town.clone()),
            weather: Some(meta.weather.clone()),
            mor_m: state.map(|state| state.mor_m),
            rain_rate_mmph: state.map(|state| state.rain_rate_mmph),
            n_lidar_rings: n_beams(&meta.rig_toml),
            // The cloud is cut to the front picture: what a log annotates beside it has no point, and is no truth to score by.
            labelled: log
                .and_then(|log| log.labelled.clone())
                .map(|labelled| Labelled { in_camera_view: true, ..labelled }),
            ..SampleFacts::default()
        };
        Ok(Self { facts, start_ns })
    }

    /// The facts of one of the episode's samples; `state` is the ego's true one, `ignored` is `None` where nobody annotated it.
    pub fn facts_of(
        &self,
        measured: &Measured,
        state: &EgoState,
        ignored: Option<Vec<IgnoredRegion>>,
        zone: &Zone,
    ) -> SampleFacts {
        let origin = measured.world_from_ego * Point::new(0.0, 0.0, 0.0);
        let zone = zone.at(state).ok();
        let edge = zone.as_ref().and_then(ZoneAt::edge);
        let is_unlabelled = ignored.is_none();
        let ignored = ignored.unwrap_or_default();
        let is_of_picture = |region: &IgnoredRegion| matches!(region, IgnoredRegion::Image { .. });
        let needs_camera = self.facts.labelled.is_some() || ignored.iter().any(is_of_picture);
        SampleFacts {
            camera: needs_camera.then(|| CameraFacts::of(measured)),
            ignored,
            is_unlabelled,
            time_s: Some(measured.time_ns.saturating_sub(self.start_ns) as f64 * 1e-9),
            n_lidar_rings: self.facts.n_lidar_rings.or_else(|| n_rings(&measured.points)),
            speed_mps: Some(state.speed_mps),
            steering_angle_rad: Some(state.steering_angle_rad),
            position_in_world_m: Some([origin.x(), origin.y()]),
            front_bumper_x_m: Some(state.front_bumper_x_m),
            zone_in_ego_m: edge.map(|corners| corners.iter().map(|p| [p.x_m, p.y_m]).collect()),
            ..self.facts.clone()
        }
    }
}

/// Beams of the LiDAR on the roof that are alive; none where the rig is not told.
fn n_beams(rig_toml: &str) -> Option<u32> {
    let rig: RigConfig = (!rig_toml.trim().is_empty()).then(|| toml::from_str(rig_toml).ok())??;
    let top = rig.lidars.get(Lidar::NAME)?;
    Some(top.n_beams().checked_sub(top.lost_beams.len())? as u32)
}

/// Rings with a point; none of an empty cloud, of which nobody knows what made it.
fn n_rings(points: &[LidarPoint]) -> Option<u32> {
    let rings: HashSet<u16> = points.iter().map(|point| point.ring).collect();
    (!rings.is_empty()).then_some(rings.len() as u32)
}

/// The episode that a sample's id names, `<episode>/<index>`; the whole id if it has no `/`.
#[must_use]
pub fn episode_of_id(id: &str) -> &str {
    id.rsplit_once('/').map_or(id, |(episode, _)| episode)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::object::{Harm, Kind};
    use crate::zone::ZoneKind;
    use std::collections::BTreeMap;

    #[test]
    fn a_dataset_tells_time_speed_and_where_the_zone_ends() {
        let dataset = test_data::dataset(3);
        assert!((dataset.samples()[2].facts.time_s.unwrap() - 0.6).abs() < 1e-9);
        assert_eq!(dataset.samples()[1].facts.episode.as_deref(), Some("made"));
        let rings: HashSet<u16> =
            dataset.samples()[0].measured.points.iter().map(|point| point.ring).collect();
        assert_eq!(dataset.samples()[0].facts.n_lidar_rings, Some(rings.len() as u32));
        for sample in dataset.samples() {
            for object in &sample.objects {
                let distance_m = sample.facts.zone_distance_m(&object.truth.box_in_ego).unwrap();
                // Car-sized boxes are harmful from about 0.2 m of depth on.
                match object.harm {
                    Harm::Harmful => assert!(distance_m < 0.0),
                    Harm::Harmless => assert!(distance_m > -0.6, "{distance_m}"),
                }
            }
        }
    }

    #[test]
    fn only_the_rectangle_has_an_edge_to_measure_from() {
        for kind in ZoneKind::ALL {
            let facts = test_data::dataset_of(1, kind).samples()[0].facts.clone();
            assert_eq!(facts.zone_in_ego_m.is_some(), kind == ZoneKind::Rect, "{kind:?}");
        }
    }

    #[test]
    fn the_gap_ahead_is_from_the_bumper_to_the_nearest_point() {
        let facts = SampleFacts { front_bumper_x_m: Some(3.5), ..SampleFacts::default() };
        let ahead = Box3 {
            center: Point::new(10.0, 0.0, 1.0),
            length_m: 4.0,
            width_m: 2.0,
            height_m: 1.5,
            yaw_rad: 0.0,
        };
        assert!((facts.gap_ahead_m(&ahead).unwrap() - 4.5).abs() < 1e-12);
        assert_eq!(SampleFacts::default().gap_ahead_m(&ahead), None);
        assert_eq!((episode_of_id("a/b/3"), episode_of_id("s1")), ("a/b", "s1"));
    }

    #[test]
    fn of_a_log_that_annotates_all_round_the_picture_is_scored() {
        let labelled = Labelled {
            kinds: vec![Kind::Vehicle],
            categories: Vec::new(),
            max_range_m: Some(50.0),
            in_camera_view: false,
            sizes: BTreeMap::new(),
        };
        let log = LogFacts {
            format: "nuscenes".into(),
            drive: "scene-0001".into(),
            methods: BTreeMap::new(),
            sample_names: BTreeMap::new(),
            first_cloud_sha256: String::new(),
            labelled: Some(labelled.clone()),
        };
        let meta = test_data::episode_meta("unknown", "");
        let origin = Origin::of_episode(&meta, Some(&log), Path::new("e.mcap"), 0).unwrap();
        assert_eq!(origin.facts.labelled, Some(Labelled { in_camera_view: true, ..labelled }));
    }

    #[test]
    fn the_weather_is_that_of_the_episodes_own_config() {
        let of = |weather: &str, config_toml: &str| {
            let meta = test_data::episode_meta(weather, config_toml);
            Origin::of_episode(&meta, None, Path::new("e.mcap"), 0)
        };
        let fog = of("FogNoon", "seed = 3\n[weather_override]\nmor_m = 80.0\n").unwrap().facts;
        assert_eq!((fog.mor_m, fog.rain_rate_mmph), (Some(80.0), Some(0.0)));
        assert_eq!(of("a Tuesday", "").unwrap().facts.mor_m, None);
        for (config, told) in
            [("weather_override = 3", "invalid type"), ("[weather_override]\nmor_m = 1", "10 to 100000")]
        {
            let error = of("FogNoon", config).unwrap_err().to_string();
            assert!(error.contains(told) && error.contains("e.mcap"), "{error}");
        }
    }

    #[test]
    fn the_beams_are_those_of_the_rig_that_are_alive_whatever_they_met() {
        let sample = test_data::dataset(1).samples()[0].clone();
        let n_rings = |rig_toml: &str| {
            let meta = EpisodeMeta { rig_toml: rig_toml.into(), ..test_data::episode_meta("ClearNoon", "") };
            let origin = Origin::of_episode(&meta, None, Path::new("e.mcap"), 0).unwrap();
            let dataset = test_data::dataset(1);
            let mut measured = sample.measured.clone();
            measured.points.clear();
            let state = measured.ego_state;
            origin.facts_of(&measured, &state, Some(vec![]), dataset.zone()).n_lidar_rings
        };
        assert_eq!(n_rings("[lidars.lidar_top]\npreset = \"vlp16\"\nlost_beams = [3, 4]"), Some(14));
        assert_eq!(n_rings("[lidars.lidar_top]"), Some(32));
        assert_eq!(n_rings(""), None, "nobody knows, and the cloud is empty");
    }

    #[test]
    fn only_regions_of_the_picture_need_the_camera() {
        let sample = test_data::dataset(1).samples()[0].clone();
        let origin =
            Origin::of_episode(&test_data::episode_meta("ClearNoon", ""), None, Path::new("e.mcap"), 0);
        let origin = origin.unwrap();
        let corner = |x_m, y_m| Point2 { x_m, y_m };
        let ground = IgnoredRegion::Ground {
            corners_in_ego_m: vec![corner(1.0, 0.0), corner(2.0, 0.0), corner(2.0, 1.0)],
        };
        let image = IgnoredRegion::Image { left_px: 0.0, top_px: 0.0, right_px: 9.0, bottom_px: 9.0 };
        let zone = test_data::dataset(1).zone().clone();
        let camera = |ignored| {
            origin.facts_of(&sample.measured, &sample.measured.ego_state, Some(ignored), &zone).camera
        };
        assert!(camera(vec![]).is_none() && camera(vec![ground.clone()]).is_none());
        assert!(camera(vec![ground, image]).is_some());
    }
}
