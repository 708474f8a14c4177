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
    SpeedMps,
    SteeringDeg,
}

impl Axis {
    pub const ALL: [Self; 13] = [
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
        Self::SpeedMps,
        Self::SteeringDeg,
    ];

    /// Whether a group is a set of samples, not of objects.
    #[must_use]
    pub fn is_of_samples(self) -> bool {
        matches!(self, Self::Town | Self::Weather | Self::SpeedMps | Self::SteeringDeg)
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
            Self::SpeedMps => "speed_mps",
            Self::SteeringDeg => "steering_deg",
        }
    }

    /// The group of a sample on an axis of samples.
    pub(super) fn label_sample(self, facts: &SampleFacts, config: &BreakdownConfig) -> Option<Label> {
        match self {
            Self::Town => facts.town.as_deref().map(word),
            Self::Weather => facts.weather.as_deref().map(word),
            Self::SpeedMps => Some(band(facts.speed_mps?, &config.speed_mps)),
            Self::SteeringDeg => {
                Some(band(facts.steering_angle_rad?.abs().to_degrees(), &config.steering_deg))
            }
            _ => None,
        }
    }

    /// The group of an object on an axis of objects.
    pub(super) fn label_object(
        self,
        facts: &SampleFacts,
        object: &Object,
        config: &BreakdownConfig,
    ) -> Option<Label> {
        let category_if = |distribution| {
            let fits = object.distribution == Some(distribution);
            object.category.as_deref().filter(|_| fits).map(word)
        };
        match self {
            Self::Distribution => object.distribution.map(|distribution| word(distribution.name())),
            Self::Kind => object.kind.map(|kind| word(kind.name())),
            Self::IdCategory => category_if(Distribution::Id),
            Self::OodCategory => category_if(Distribution::Ood),
            Self::RangeM => {
                let center = object.box_in_ego.center;
                Some(band(center.x().hypot(center.y()), &config.range_m))
            }
            Self::VisibleFraction => Some(band(object.visible_fraction?, &config.visible_fraction)),
            Self::NLidarPoints => Some(band(f64::from(object.n_lidar_points?), &config.n_lidar_points)),
            Self::Event => object.event.map(|event| word(event.name())),
            Self::ZoneDistanceM => {
                Some(band(facts.zone_distance_m(&object.box_in_ego)?, &config.zone_distance_m))
            }
            _ => None,
        }
    }
}

/// A group's place in the order, and its name.
pub(super) type Label = (usize, String);

fn word(name: &str) -> Label {
    (0, name.to_owned())
}

fn band(value: f64, edges: &[f64]) -> Label {
    let at = edges.partition_point(|&edge| edge <= value);
    let name = match (at.checked_sub(1).map(|below| edges[below]), edges.get(at)) {
        (None, Some(above)) => format!("below {above}"),
        (Some(below), Some(above)) => format!("{below} to {above}"),
        (Some(below), None) => format!("{below} and more"),
        (None, None) => "all".to_owned(),
    };
    (at, name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_named_by_their_edges() {
        let names = [-3.0, -1.0, 0.0, 7.0].map(|value| band(value, &[-1.0, 0.5]));
        let wanted = [(0, "below -1"), (1, "-1 to 0.5"), (1, "-1 to 0.5"), (2, "0.5 and more")];
        assert_eq!(names, wanted.map(|(at, name)| (at, name.to_owned())));
    }
}
