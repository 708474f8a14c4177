//! What is known of a sample or a true object beyond its boxes: by this scores are broken down.
//!
//! Every fact may be missing: a file of boxes tells what it tells, a dataset of ours tells all. A score that needs a
//! fact leaves out what lacks it. Metres, m/s, radians, seconds; the zone in the ego frame.

use fs_err as fs;
use serde::{Deserialize, Serialize};

use crate::dataset::{Dataset, LabelledSample};
use crate::episode::EpisodeEntry;
use crate::generate::GenerateConfig;
use crate::geometry::{Box3, Ego, Point, Point2, convex_signed_distance_m, distance_to_convex_m};
use crate::object::{Event, Kind, ObjectTruth};
use crate::sensors::{Weather, WeatherOverride, WeatherState};
use crate::zone::ZoneAt;

/// Facts of a true object.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct TruthFacts {
    /// The same in all samples of an episode, and no other object's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// The model's family: `car`, `hay_bale`, ...
    #[serde(skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<Kind>,
    /// Visible pixels over those of the whole silhouette, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visible_fraction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub event: Option<Event>,
}

impl From<&ObjectTruth> for TruthFacts {
    fn from(object: &ObjectTruth) -> Self {
        Self {
            id: Some(object.id.clone()),
            category: Some(object.category.clone()),
            kind: Some(object.kind),
            visible_fraction: Some(f64::from(object.visible_fraction)),
            event: Some(object.event),
        }
    }
}

/// Facts of a sample.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
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
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steering_angle_rad: Option<f64>,
    /// Where the ego is, in a frame that stands still: x, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_in_world_m: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub front_bumper_x_m: Option<f64>,
    /// Corners of the danger zone, convex: x, y. Datasets tell it where their zone is `rect`: the others bend, and what
    /// `ttc` and `rss` say of an object is not the distance to one edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zone_in_ego_m: Option<Vec<[f64; 2]>>,
}

impl SampleFacts {
    /// Signed distance of a box's footprint to the zone's edge, metres: positive the gap, negative how deep it reaches
    /// in. `None` where the zone is not known.
    #[must_use]
    pub fn zone_distance_m(&self, of: &Box3<Ego>) -> Option<f64> {
        let zone: Vec<Point2> =
            self.zone_in_ego_m.as_ref()?.iter().map(|&[x_m, y_m]| Point2 { x_m, y_m }).collect();
        (zone.len() >= 3).then(|| convex_signed_distance_m(&zone, &of.footprint()))
    }

    /// Distance from the middle of the front bumper to a box's footprint, metres on the ground.
    #[must_use]
    pub fn gap_ahead_m(&self, of: &Box3<Ego>) -> Option<f64> {
        let bumper = Point2 { x_m: self.front_bumper_x_m?, y_m: 0.0 };
        Some(distance_to_convex_m(bumper, &of.footprint()))
    }
}

/// The facts of each sample of a dataset, in its order.
#[must_use]
pub fn of_dataset(dataset: &Dataset) -> Vec<SampleFacts> {
    // A dataset without its config leaves the weather's state unknown, since an override may have changed it.
    let config = fs::read_to_string(dataset.path().join("gen.toml")).ok();
    let changed: Option<WeatherOverride> = config
        .and_then(|text| toml::from_str::<GenerateConfig>(&text).ok())
        .map(|config| config.weather_override);
    let mut first: Option<(String, u64)> = None;
    dataset
        .samples()
        .iter()
        .map(|sample| {
            let episode = episode_of_id(&sample.id).to_owned();
            let entry = dataset.episodes().iter().find(|entry| entry.name == episode);
            if first.as_ref().is_none_or(|(name, _)| *name != episode) {
                first = Some((episode.clone(), sample.measured.time_ns));
            }
            let start_ns = first.as_ref().map_or(0, |&(_, time_ns)| time_ns);
            let weather = entry.and_then(|entry| state_of(entry, changed.as_ref()?));
            SampleFacts {
                episode: Some(episode),
                time_s: Some(sample.measured.time_ns.saturating_sub(start_ns) as f64 * 1e-9),
                town: entry.map(|entry| entry.town.clone()),
                weather: entry.map(|entry| entry.weather.clone()),
                mor_m: weather.map(|state| state.mor_m),
                rain_rate_mmph: weather.map(|state| state.rain_rate_mmph),
                ..of_ego(dataset, sample)
            }
        })
        .collect()
}

/// What the ego's state tells.
fn of_ego(dataset: &Dataset, sample: &LabelledSample) -> SampleFacts {
    let state = &sample.measured.ego_state;
    let origin = sample.measured.world_from_ego * Point::new(0.0, 0.0, 0.0);
    let zone = dataset.zone().at(state).ok();
    let edge = zone.as_ref().and_then(ZoneAt::edge);
    SampleFacts {
        speed_mps: Some(state.speed_mps),
        steering_angle_rad: Some(state.steering_angle_rad),
        position_in_world_m: Some([origin.x(), origin.y()]),
        front_bumper_x_m: Some(state.front_bumper_x_m),
        zone_in_ego_m: edge.map(|corners| corners.iter().map(|p| [p.x_m, p.y_m]).collect()),
        ..SampleFacts::default()
    }
}

fn state_of(entry: &EpisodeEntry, changed: &WeatherOverride) -> Option<WeatherState> {
    let named: Weather = entry.weather.parse().ok()?;
    named.state().replace_by(changed).ok()
}

/// The episode that a sample's id names, `<episode>/<index>`; the whole id where there is no `/`.
#[must_use]
pub fn episode_of_id(id: &str) -> &str {
    id.rsplit_once('/').map_or(id, |(episode, _)| episode)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::zone::ZoneKind;

    #[test]
    fn a_dataset_tells_time_speed_and_where_the_zone_ends() {
        let dataset = test_data::dataset(3);
        let facts = of_dataset(&dataset);
        assert!((facts[2].time_s.unwrap() - 0.6).abs() < 1e-9);
        assert_eq!(facts[1].episode.as_deref(), Some("made"));
        for (sample, facts) in dataset.samples().iter().zip(&facts) {
            for object in &sample.objects {
                let distance_m = facts.zone_distance_m(&object.truth.box_in_ego).unwrap();
                // Car-sized boxes are harmful from about 0.2 m of depth on.
                match object.harm {
                    crate::object::Harm::Harmful => assert!(distance_m < 0.0),
                    crate::object::Harm::Harmless => assert!(distance_m > -0.6, "{distance_m}"),
                }
            }
        }
    }

    #[test]
    fn only_the_rectangle_has_an_edge_to_measure_from() {
        for kind in ZoneKind::ALL {
            let facts = of_dataset(&test_data::dataset_of(1, kind));
            assert_eq!(facts[0].zone_in_ego_m.is_some(), kind == ZoneKind::Rect, "{kind:?}");
        }
    }

    #[test]
    fn the_gap_ahead_is_from_the_bumper_to_the_nearest_point() {
        let facts = SampleFacts { front_bumper_x_m: Some(3.5), ..SampleFacts::default() };
        let ahead = super::super::matching::tests::a_box(10.0, 0.0);
        assert!((facts.gap_ahead_m(&ahead).unwrap() - 4.5).abs() < 1e-12);
        assert_eq!(SampleFacts::default().gap_ahead_m(&ahead), None);
        assert_eq!((episode_of_id("a/b/3"), episode_of_id("s1")), ("a/b", "s1"));
    }
}
