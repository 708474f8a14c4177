//! The zone's config as `zone.toml` gives it, and what can be wrong with it or with what it is applied to.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::BoxError;

/// The shape of the zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ZoneKind {
    /// The paper's rectangle, turned by the steering angle.
    #[default]
    Rect,
    /// A lane-wide corridor as deep as the rectangle, along the arc that the ego drives.
    Arc,
    /// Contact with the ego's body within a time, if both keep their motion.
    Ttc,
    /// Nearer than the longitudinal and the lateral safe distance of RSS.
    Rss,
}

impl ZoneKind {
    /// All of them; the paper's first.
    pub const ALL: [Self; 4] = [Self::Rect, Self::Arc, Self::Ttc, Self::Rss];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rect => "rect",
            Self::Arc => "arc",
            Self::Ttc => "ttc",
            Self::Rss => "rss",
        }
    }
}

/// The zone as `zone.toml` gives it, unchecked; [`super::Zone`] is the checked form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ZoneConfig {
    /// Shape; default `rect`.
    pub kind: ZoneKind,
    /// `rect`, `arc`: part of the depth that does not depend on speed, metres; default 5.
    pub min_safe_distance_m: f64,
    /// `rect`, `arc`: part of the depth that grows with speed, seconds; default 2 (the two-second rule).
    pub time_gap_s: f64,
    /// `rect`, `arc`: width, metres; default 3.5 (a lane).
    pub width_m: f64,
    /// `rect`, `arc`: overlap from which an object is harmful, square metres; default 1.
    pub min_overlap_area_m2: f64,
    /// `rect`, `arc`: overlap over the object's footprint from which it is harmful, above 0 and at most 1; default 0.25.
    pub min_overlap_ratio: f64,
    /// `arc`, `ttc`, `rss`: the ego's arc ends when it has turned so far, degrees, above 0 and at most 180; default 180.
    pub max_turn_deg: f64,
    /// `ttc`, `rss`: the ego's body.
    pub body: BodyConfig,
    /// `ttc`.
    pub ttc: TtcConfig,
    /// `rss`.
    pub rss: RssConfig,
}

impl Default for ZoneConfig {
    fn default() -> Self {
        Self {
            kind: ZoneKind::Rect,
            min_safe_distance_m: 5.0,
            time_gap_s: 2.0,
            width_m: 3.5,
            min_overlap_area_m2: 1.0,
            min_overlap_ratio: 0.25,
            max_turn_deg: 180.0,
            body: BodyConfig::default(),
            ttc: TtcConfig::default(),
            rss: RssConfig::default(),
        }
    }
}

/// What of the ego's body its state does not tell; by default the simulated car's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodyConfig {
    /// Metres; default 1.73.
    pub width_m: f64,
    /// From the rear axle to the rear bumper, metres; default 0.734.
    pub rear_overhang_m: f64,
}

impl Default for BodyConfig {
    fn default() -> Self {
        Self { width_m: 1.73, rear_overhang_m: 0.734 }
    }
}

/// Keys of `ttc` alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TtcConfig {
    /// Contact within this time is harmful, seconds; default 4.
    pub horizon_s: f64,
}

impl Default for TtcConfig {
    fn default() -> Self {
        Self { horizon_s: 4.0 }
    }
}

/// Keys of `rss` alone: what each side is assumed to do. Defaults: ad-rss-lib's parameter discussion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RssConfig {
    /// Of the ego, seconds; default 1.
    pub response_time_s: f64,
    /// Of the other, seconds; default 2.
    pub other_response_time_s: f64,
    /// Greatest acceleration along the road while responding, m/s²; default 3.5.
    pub max_accel_mps2: f64,
    /// Least braking after the response, m/s²; default 4.
    pub min_brake_mps2: f64,
    /// Greatest braking of the one ahead, m/s²; default 8.
    pub max_brake_mps2: f64,
    /// Least braking of the ego against oncoming traffic, m/s²; default 3.
    pub min_brake_correct_mps2: f64,
    /// Greatest acceleration to the side while responding, m/s²; default 0.2.
    pub lateral_max_accel_mps2: f64,
    /// Least braking to the side after the response, m/s²; default 0.8.
    pub lateral_min_brake_mps2: f64,
    /// Kept to the side beyond all motion, metres; default 0.1.
    pub lateral_margin_m: f64,
    /// An object that comes more slowly along the ego's course counts as standing, m/s; default 0.5.
    pub standing_speed_mps: f64,
}

impl Default for RssConfig {
    fn default() -> Self {
        Self {
            response_time_s: 1.0,
            other_response_time_s: 2.0,
            max_accel_mps2: 3.5,
            min_brake_mps2: 4.0,
            max_brake_mps2: 8.0,
            min_brake_correct_mps2: 3.0,
            lateral_max_accel_mps2: 0.2,
            lateral_min_brake_mps2: 0.8,
            lateral_margin_m: 0.1,
            standing_speed_mps: 0.5,
        }
    }
}

/// What is wrong with a zone's config, or with the state or box it is applied to.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ZoneError {
    #[error("the zone's {field} is {found}; a finite number above zero is needed")]
    Config { field: &'static str, found: f64 },
    #[error("the zone's {field} is {found}; a number above 0 and at most {most} is needed")]
    AtMost { field: &'static str, found: f64, most: f64 },
    #[error("the ego's {field} is {found}; a finite number is needed")]
    StateNotFinite { field: &'static str, found: f64 },
    #[error("the ego's {field} is {found}; a number above zero is needed")]
    StateNotPositive { field: &'static str, found: f64 },
    #[error("the zone's depth comes out as {depth_m} m at {speed_mps} m/s; a finite depth is needed")]
    Depth { depth_m: f64, speed_mps: f64 },
    #[error("the ego's steering_angle_rad is {found}; a car that drives on needs less than a right angle")]
    Steering { found: f64 },
    #[error(
        "at steering_angle_rad {steering_angle_rad} the ego turns on a radius of {radius_m} m; the zone's width needs \
         more than {needed_m} m"
    )]
    Radius { steering_angle_rad: f64, radius_m: f64, needed_m: f64 },
    #[error("the object's velocity is {found:?} m/s; finite numbers are needed")]
    Velocity { found: [f64; 2] },
    #[error("only zone `rect` has an edge to measure a distance to; hard rules take every zone")]
    NoEdge,
    #[error("{0}")]
    Box(#[from] BoxError),
    #[error(
        "footprint and overlap come out as {footprint_area_m2} and {overlap_area_m2} m²; finite areas are needed"
    )]
    Overlap { footprint_area_m2: f64, overlap_area_m2: f64 },
}

impl ZoneConfig {
    /// Checks every key, also those of the other shapes.
    pub(super) fn check(&self) -> Result<(), ZoneError> {
        let fields = [
            ("min_safe_distance_m", self.min_safe_distance_m),
            ("time_gap_s", self.time_gap_s),
            ("width_m", self.width_m),
            ("min_overlap_area_m2", self.min_overlap_area_m2),
            ("min_overlap_ratio", self.min_overlap_ratio),
            ("max_turn_deg", self.max_turn_deg),
            ("body.width_m", self.body.width_m),
            ("body.rear_overhang_m", self.body.rear_overhang_m),
            ("ttc.horizon_s", self.ttc.horizon_s),
            ("rss.response_time_s", self.rss.response_time_s),
            ("rss.other_response_time_s", self.rss.other_response_time_s),
            ("rss.max_accel_mps2", self.rss.max_accel_mps2),
            ("rss.min_brake_mps2", self.rss.min_brake_mps2),
            ("rss.max_brake_mps2", self.rss.max_brake_mps2),
            ("rss.min_brake_correct_mps2", self.rss.min_brake_correct_mps2),
            ("rss.lateral_max_accel_mps2", self.rss.lateral_max_accel_mps2),
            ("rss.lateral_min_brake_mps2", self.rss.lateral_min_brake_mps2),
            ("rss.lateral_margin_m", self.rss.lateral_margin_m),
            ("rss.standing_speed_mps", self.rss.standing_speed_mps),
        ];
        for (field, found) in fields {
            if !found.is_finite() || found <= 0.0 {
                return Err(ZoneError::Config { field, found });
            }
        }
        let limited =
            [("min_overlap_ratio", self.min_overlap_ratio, 1.0), ("max_turn_deg", self.max_turn_deg, 180.0)];
        for (field, found, most) in limited {
            if found > most {
                return Err(ZoneError::AtMost { field, found, most });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::mjcf::{EGO_LENGTH_M, EGO_WIDTH_M, FRONT_BUMPER_X_M};

    #[test]
    fn shipped_config_equals_the_default() {
        let shipped: ZoneConfig = toml::from_str(include_str!("../../configs/zone.toml")).unwrap();
        assert_eq!(shipped, ZoneConfig::default());
    }

    #[test]
    fn the_default_body_is_the_simulated_car() {
        let body = BodyConfig::default();
        assert_eq!(body.width_m, EGO_WIDTH_M);
        assert!((body.rear_overhang_m - (EGO_LENGTH_M - FRONT_BUMPER_X_M)).abs() < 1e-9);
    }

    #[test]
    fn a_config_of_before_the_other_shapes_still_reads() {
        let old = "kind = \"rect\"\nmin_safe_distance_m = 5.0\ntime_gap_s = 2.0\nwidth_m = 3.5\n\
                   min_overlap_area_m2 = 1.0\nmin_overlap_ratio = 0.25\n";
        assert_eq!(toml::from_str::<ZoneConfig>(old).unwrap(), ZoneConfig::default());
    }

    #[test]
    fn keys_that_cannot_be_are_named() {
        let mut config = ZoneConfig { max_turn_deg: 270.0, ..ZoneConfig::default() };
        assert!(config.check().unwrap_err().to_string().contains("max_turn_deg is 270"));
        config.max_turn_deg = 90.0;
        config.rss.max_brake_mps2 = f64::NAN;
        assert!(config.check().unwrap_err().to_string().contains("rss.max_brake_mps2 is NaN"));
    }
}
