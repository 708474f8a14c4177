//! Parts of `town.toml` that have places of their own, in the map's coordinates: basins, landmarks, tracks, hills, waves.

use serde::{Deserialize, Serialize};

use super::looks::LandmarkLook;
use super::path::{Vec2, direction_of};
use crate::config::{Bounds, Keys, Rule, from_to};

const PLACE: Rule = from_to(-1e6, 1e6).list(2, 2);
const YAW: Rule = from_to(-360.0, 360.0);

/// A rectangle of water with quays around it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BasinConfig {
    pub center_m: [f64; 2],
    /// Direction of the length, counter-clockwise from +x.
    #[serde(default)]
    pub yaw_deg: f64,
    /// Length and width.
    pub size_m: [f64; 2],
    /// Whether railings stand along its edges.
    #[serde(default)]
    pub railings: bool,
}

impl Bounds for BasinConfig {
    const BOUNDS: Keys =
        &[("center_m", PLACE), ("yaw_deg", YAW), ("size_m", from_to(1.0, 2000.0).list(2, 2))];
}

/// A large thing at a place of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LandmarkConfig {
    pub look: LandmarkLook,
    pub center_m: [f64; 2],
    #[serde(default)]
    pub yaw_deg: f64,
}

impl Bounds for LandmarkConfig {
    const BOUNDS: Keys = &[("center_m", PLACE), ("yaw_deg", YAW)];
}

/// Two rails in the ground, straight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(clippy::struct_field_names, reason = "all are lengths, and names carry their unit")]
pub struct TrackConfig {
    pub from_m: [f64; 2],
    pub to_m: [f64; 2],
    /// Between the rails.
    pub gauge_m: f64,
}

impl Bounds for TrackConfig {
    const BOUNDS: Keys = &[("from_m", PLACE), ("to_m", PLACE), ("gauge_m", from_to(0.3, 40.0))];
}

/// A rise of the land away from roads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(clippy::struct_field_names, reason = "all are lengths, and names carry their unit")]
pub struct HillConfig {
    pub center_m: [f64; 2],
    /// Where it begins to rise.
    pub radius_m: f64,
    /// Of its middle over the land without it.
    pub height_m: f64,
}

impl Bounds for HillConfig {
    const BOUNDS: Keys =
        &[("center_m", PLACE), ("radius_m", from_to(1.0, 1000.0)), ("height_m", from_to(-100.0, 200.0))];
}

/// A long wave of the land, roads and pavements included, over what the map says of their heights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaveConfig {
    /// From crest to crest.
    pub length_m: f64,
    /// Direction in which it runs, counter-clockwise from +x.
    pub yaw_deg: f64,
    /// Of a crest over a trough.
    pub height_m: f64,
    /// Where it stands at the map's origin: 0 half-way up, 90 on the crest.
    pub phase_deg: f64,
}

impl WaveConfig {
    /// Rise over run where it is steepest.
    pub(super) fn steepest(&self) -> f64 {
        std::f64::consts::PI * self.height_m / self.length_m
    }

    /// Height at a place, metres; the middle between crest and trough is zero.
    pub(super) fn height_at(&self, point: Vec2) -> f64 {
        let along_m = point.dot(&direction_of(self.yaw_deg.to_radians()));
        let phase = std::f64::consts::TAU * along_m / self.length_m + self.phase_deg.to_radians();
        self.height_m / 2.0 * phase.sin()
    }
}

impl Bounds for WaveConfig {
    const BOUNDS: Keys = &[
        ("length_m", from_to(20.0, 10_000.0)),
        ("yaw_deg", YAW),
        ("height_m", from_to(0.0, 200.0)),
        ("phase_deg", YAW),
    ];
}
