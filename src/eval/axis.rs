//! The axes along which scores are broken down, and the group that a sample or an object falls into.

use serde::{Deserialize, Serialize};

use super::protocol::BreakdownConfig;
use crate::dataset::SampleFacts;
use crate::object::{Distribution, Object};

/// The fact by which truths are sorted into groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    Distribution,
    Kind,
    /// Families of objects in distribution.
    IdCategory,
    /// Families of objects out of distribution.
    OodCategory,
    RangeM,
    VisibleFraction,
    NLidarPoints,
    Event,
    ZoneDistanceM,
    Town,
    Weather,
    NLidarRings,
    SpeedMps,
    SteeringDeg,
}

impl Axis {
    pub const ALL: [Self; 14] = [
        Self::Distribution,
        Self::Kind,
        Self::IdCategory,
        Self::OodCategory,
        Self::RangeM,
        Self::VisibleFraction,
        Self::NLidarPoints,
        Self::Event,
        Self::ZoneDistanceM,
        Self::Town,
        Self::Weather,
        Self::NLidarRings,
        Self::SpeedMps,
        Self::SteeringDeg,
    ];

    /// Whether a group is a set of samples, not of objects.
    #[must_use]
    pub fn is_of_samples(self) -> bool {
        matches!(self, Self::Town | Self::Weather | Self::NLidarRings | Self::SpeedMps | Self::SteeringDeg)
    }

    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Distribution => "distribution",
            Self::Kind => "kind",
            Self::IdCategory => "id_category",
            Self::OodCategory => "ood_category",
            Self::RangeM => "range_m",
            Self::VisibleFraction => "visible_fraction",
            Self::NLidarPoints => "n_lidar_points",
            Self::Event => "event",
            Self::ZoneDistanceM => "zone_distance_m",
            Self::Town => "town",
            Self::Weather => "weather",
            Self::NLidarRings => "n_lidar_rings",
            Self::SpeedMps => "speed_mps",
            Self::SteeringDeg => "steering_deg",
        }
    }

    /// The edges of the bands that are the groups; `None` where names are.
    fn edges(self, config: &BreakdownConfig) -> Option<&[f64]> {
        match self {
            Self::RangeM => Some(&config.range_m),
            Self::VisibleFraction => Some(&config.visible_fraction),
            Self::NLidarPoints => Some(&config.n_lidar_points),
            Self::ZoneDistanceM => Some(&config.zone_distance_m),
            Self::NLidarRings => Some(&config.n_lidar_rings),
            Self::SpeedMps => Some(&config.speed_mps),
            Self::SteeringDeg => Some(&config.steering_deg),
            _ => None,
        }
    }

    /// The group of a sample on an axis of samples.
    pub(super) fn label_sample<'a>(
        self,
        facts: &'a SampleFacts,
        config: &BreakdownConfig,
    ) -> Option<Label<'a>> {
        match self {
            Self::Town => facts.town.as_deref().map(Label::Name),
            Self::Weather => facts.weather.as_deref().map(Label::Name),
            Self::NLidarRings => self.band(f64::from(facts.n_lidar_rings?), config),
            Self::SpeedMps => self.band(facts.speed_mps?, config),
            Self::SteeringDeg => self.band(facts.steering_angle_rad?.abs().to_degrees(), config),
            _ => None,
        }
    }

    /// The group of an object on an axis of objects, whose distance to the zone is a fact of its sample.
    pub(super) fn label_object<'a>(
        self,
        object: &'a Object,
        zone_distance_m: impl FnOnce() -> Option<f64>,
        config: &BreakdownConfig,
    ) -> Option<Label<'a>> {
        let category_if = |distribution| {
            let fits = object.distribution == Some(distribution);
            object.category.as_deref().filter(|_| fits).map(Label::Name)
        };
        match self {
            Self::Distribution => object.distribution.map(|distribution| Label::Name(distribution.name())),
            Self::Kind => object.kind.map(|kind| Label::Name(kind.name())),
            Self::IdCategory => category_if(Distribution::Id),
            Self::OodCategory => category_if(Distribution::Ood),
            Self::RangeM => {
                let center = object.box_in_ego.center;
                self.band(center.x().hypot(center.y()), config)
            }
            Self::VisibleFraction => self.band(object.visible_fraction?, config),
            Self::NLidarPoints => self.band(f64::from(object.n_lidar_points?), config),
            Self::Event => object.event.map(|event| Label::Name(event.name())),
            Self::ZoneDistanceM => self.band(zone_distance_m()?, config),
            _ => None,
        }
    }

    fn band(self, value: f64, config: &BreakdownConfig) -> Option<Label<'static>> {
        Some(Label::Band(self.edges(config)?.partition_point(|&edge| edge <= value)))
    }

    /// The name of a group in files and tables.
    pub(super) fn name_of(self, label: Label<'_>, config: &BreakdownConfig) -> String {
        let at = match label {
            Label::Name(name) => return name.to_owned(),
            Label::Band(at) => at,
        };
        let edges = self.edges(config).unwrap_or_default();
        match (at.checked_sub(1).map(|below| edges[below]), edges.get(at)) {
            (None, Some(above)) => format!("below {above}"),
            (Some(below), Some(above)) => format!("{below} to {above}"),
            (Some(below), None) => format!("{below} and more"),
            (None, None) => "all".to_owned(),
        }
    }
}

/// A group, in the order of an axis' groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Label<'a> {
    /// One of the bands between the edges, by its place.
    Band(usize),
    Name(&'a str),
}
