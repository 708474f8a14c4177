//! Danger zone: the ground the ego will soon sweep, and which footprints meet it.
//!
//! `depth_m = time_gap_s * max(speed_mps, 0) + min_safe_distance_m`; the rectangle begins at the middle of the
//! front bumper `p0 = (front_bumper_x_m, 0)` and runs along `u = (cos s, sin s)`, `s` the steering angle, with
//! `n = (-sin s, cos s)` to its left (paper, section on the danger zone). Metres, radians, ego frame.
//! Nothing here reads a file, a clock or a random number.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::{Box3, BoxError, Ego, Point2, convex_overlap_area};
use crate::object::Harm;
use crate::sample::EgoState;

/// The shape of the zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ZoneKind {
    /// The paper's rectangle, turned by the steering angle.
    #[default]
    Rect,
}

impl ZoneKind {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rect => "rect",
        }
    }
}

/// The zone as `zone.toml` gives it, unchecked; [`Zone`] is the checked form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ZoneConfig {
    /// Shape; default `rect`.
    pub kind: ZoneKind,
    /// Part of the depth that does not depend on speed, metres; default 5.
    pub min_safe_distance_m: f64,
    /// Part of the depth that grows with speed, seconds; default 2 (the two-second rule).
    pub time_gap_s: f64,
    /// Width, metres; default 3.5 (a lane).
    pub width_m: f64,
    /// Overlap from which an object is harmful, square metres; default 1.
    pub min_overlap_area_m2: f64,
    /// Overlap over the object's footprint from which it is harmful, above 0 and at most 1; default 0.25.
    pub min_overlap_ratio: f64,
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
        }
    }
}

/// What is wrong with a zone's config, or with the state or box it is applied to.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ZoneError {
    #[error("the zone's {field} is {found}; a finite number above zero is needed")]
    Config { field: &'static str, found: f64 },
    #[error("the zone's min_overlap_ratio is {found}; a number above 0 and at most 1 is needed")]
    Ratio { found: f64 },
    #[error("the ego's {field} is {found}; a finite number is needed")]
    StateNotFinite { field: &'static str, found: f64 },
    #[error("the ego's {field} is {found}; a number above zero is needed")]
    StateNotPositive { field: &'static str, found: f64 },
    #[error("the zone's depth comes out as {depth_m} m at {speed_mps} m/s; a finite depth is needed")]
    Depth { depth_m: f64, speed_mps: f64 },
    #[error("{0}")]
    Box(#[from] BoxError),
    #[error(
        "footprint and overlap come out as {footprint_area_m2} and {overlap_area_m2} m²; finite areas are needed"
    )]
    Overlap { footprint_area_m2: f64, overlap_area_m2: f64 },
}

/// A checked zone rule: every number finite and above zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    config: ZoneConfig,
}

impl TryFrom<ZoneConfig> for Zone {
    type Error = ZoneError;

    fn try_from(config: ZoneConfig) -> Result<Self, ZoneError> {
        let fields = [
            ("min_safe_distance_m", config.min_safe_distance_m),
            ("time_gap_s", config.time_gap_s),
            ("width_m", config.width_m),
            ("min_overlap_area_m2", config.min_overlap_area_m2),
            ("min_overlap_ratio", config.min_overlap_ratio),
        ];
        for (field, found) in fields {
            if !found.is_finite() || found <= 0.0 {
                return Err(ZoneError::Config { field, found });
            }
        }
        if config.min_overlap_ratio > 1.0 {
            return Err(ZoneError::Ratio { found: config.min_overlap_ratio });
        }
        Ok(Self { config })
    }
}

impl Zone {
    /// The config it was made from.
    #[must_use]
    pub fn config(&self) -> &ZoneConfig {
        &self.config
    }

    /// The rectangle for one state of the ego. A car that rolls backwards keeps the safe distance alone.
    ///
    /// # Errors
    /// Speed, steering angle or bumper is not finite, or the bumper is not ahead of the rear axle.
    pub fn rect(&self, ego: &EgoState) -> Result<RectZone, ZoneError> {
        let fields = [
            ("speed_mps", ego.speed_mps),
            ("steering_angle_rad", ego.steering_angle_rad),
            ("front_bumper_x_m", ego.front_bumper_x_m),
        ];
        for (field, found) in fields {
            if !found.is_finite() {
                return Err(ZoneError::StateNotFinite { field, found });
            }
        }
        if ego.front_bumper_x_m <= 0.0 {
            let found = ego.front_bumper_x_m;
            return Err(ZoneError::StateNotPositive { field: "front_bumper_x_m", found });
        }
        let depth_m = self.config.time_gap_s * ego.speed_mps.max(0.0) + self.config.min_safe_distance_m;
        if !depth_m.is_finite() {
            return Err(ZoneError::Depth { depth_m, speed_mps: ego.speed_mps });
        }
        let (sin, cos) = ego.steering_angle_rad.sin_cos();
        let half_width_m = self.config.width_m / 2.0;
        let corner = |along_m: f64, left_m: f64| Point2 {
            x_m: ego.front_bumper_x_m + along_m * cos - left_m * sin,
            y_m: along_m * sin + left_m * cos,
        };
        Ok(RectZone {
            corners: [
                corner(0.0, -half_width_m),
                corner(depth_m, -half_width_m),
                corner(depth_m, half_width_m),
                corner(0.0, half_width_m),
            ],
            min_overlap_area_m2: self.config.min_overlap_area_m2,
            min_overlap_ratio: self.config.min_overlap_ratio,
        })
    }
}

/// The zone at one instant: a rectangle on the ground in the ego frame, and the rule of its overlap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectZone {
    corners: [Point2; 4],
    min_overlap_area_m2: f64,
    min_overlap_ratio: f64,
}

/// What the zone says of one box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    pub harm: Harm,
    /// Area that the box's footprint shares with the zone, square metres.
    pub overlap_area_m2: f64,
    /// That area over the footprint's own, 0 to 1.
    pub overlap_ratio: f64,
}

impl RectZone {
    /// Corners counter-clockwise from the near right one, in the ego frame.
    #[must_use]
    pub fn corners(&self) -> &[Point2; 4] {
        &self.corners
    }

    /// Whether a box is harmful: its footprint shares enough area, or enough of itself, with the zone.
    ///
    /// # Errors
    /// The box has a number that is not finite, a size that is not above zero, or is absurdly large.
    pub fn harm_of(&self, box_in_ego: &Box3<Ego>) -> Result<Verdict, ZoneError> {
        box_in_ego.check()?;
        let footprint_area_m2 = box_in_ego.length_m * box_in_ego.width_m;
        // The zone is clipped by the box, not the other way round: its corners stay exact beside a vast box.
        let overlap_area_m2 = convex_overlap_area(&self.corners, &box_in_ego.footprint());
        let overlap_ratio = overlap_area_m2 / footprint_area_m2;
        if !footprint_area_m2.is_finite() || !overlap_ratio.is_finite() {
            return Err(ZoneError::Overlap { footprint_area_m2, overlap_area_m2 });
        }
        let is_harmful =
            overlap_area_m2 >= self.min_overlap_area_m2 || overlap_ratio >= self.min_overlap_ratio;
        let harm = if is_harmful { Harm::Harmful } else { Harm::Harmless };
        Ok(Verdict { harm, overlap_area_m2, overlap_ratio })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;
    use crate::geometry::{Point, polygon_area};

    fn ego(speed_mps: f64, steering_angle_rad: f64) -> EgoState {
        EgoState {
            speed_mps,
            steering_angle_rad,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        }
    }

    fn rect(speed_mps: f64, steering_angle_rad: f64) -> RectZone {
        Zone::try_from(ZoneConfig::default()).unwrap().rect(&ego(speed_mps, steering_angle_rad)).unwrap()
    }

    fn block(x_m: f64, y_m: f64, length_m: f64, width_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 0.5), length_m, width_m, height_m: 1.0, yaw_rad: 0.0 }
    }

    fn assert_corners(zone: &RectZone, expected: [(f64, f64); 4]) {
        for (corner, (x_m, y_m)) in zone.corners().iter().zip(expected) {
            assert!((corner.x_m - x_m).abs() < 1e-12 && (corner.y_m - y_m).abs() < 1e-12, "{corner:?}");
        }
    }

    #[test]
    fn shipped_config_equals_the_default() {
        let shipped: ZoneConfig = toml::from_str(include_str!("../../configs/zone.toml")).unwrap();
        assert_eq!(shipped, ZoneConfig::default());
    }

    #[test]
    fn at_ten_metres_a_second_the_zone_is_twenty_five_metres_deep() {
        assert_corners(&rect(10.0, 0.0), [(3.6, -1.75), (28.6, -1.75), (28.6, 1.75), (3.6, 1.75)]);
    }

    #[test]
    fn a_car_that_stands_or_rolls_back_keeps_the_safe_distance() {
        assert_eq!(rect(0.0, 0.0), rect(-3.0, 0.0));
        assert_corners(&rect(0.0, 0.0), [(3.6, -1.75), (8.6, -1.75), (8.6, 1.75), (3.6, 1.75)]);
    }

    #[test]
    fn steering_to_the_left_turns_the_zone_about_the_bumper() {
        assert_corners(&rect(0.0, FRAC_PI_2), [(5.35, 0.0), (5.35, 5.0), (1.85, 5.0), (1.85, 0.0)]);
    }

    #[test]
    fn object_behind_ego_is_harmless() {
        let verdict = rect(10.0, 0.0).harm_of(&block(-5.0, 0.0, 4.0, 2.0)).unwrap();
        assert_eq!((verdict.harm, verdict.overlap_area_m2), (Harm::Harmless, 0.0));
    }

    #[test]
    fn one_square_metre_of_a_large_object_is_harmful_and_less_is_not() {
        // A 10 m x 2 m truck whose right metre-fraction reaches into the zone: overlap 10 * reach.
        let reach = |reach_m: f64| rect(10.0, 0.0).harm_of(&block(15.0, 2.75 - reach_m, 10.0, 2.0)).unwrap();
        assert_eq!(reach(0.125).harm, Harm::Harmful);
        assert!((reach(0.125).overlap_area_m2 - 1.25).abs() < 1e-12);
        assert_eq!(reach(0.09375).harm, Harm::Harmless);
    }

    #[test]
    fn a_quarter_of_a_small_object_is_harmful_and_less_is_not() {
        // A 0.5 m cube: a quarter of it is 0.0625 square metres, far below one.
        let at = |y_m: f64| rect(10.0, 0.0).harm_of(&block(15.0, y_m, 0.5, 0.5)).unwrap();
        assert_eq!(at(1.875).overlap_ratio, 0.25);
        assert_eq!(at(1.875).harm, Harm::Harmful);
        assert_eq!(at(1.89).harm, Harm::Harmless);
    }

    #[test]
    fn an_object_that_swallows_the_zone_is_harmful() {
        let verdict = rect(0.0, 0.3).harm_of(&block(5.0, 0.0, 100.0, 100.0)).unwrap();
        assert!((verdict.overlap_area_m2 - 5.0 * 3.5).abs() < 1e-9);
        assert_eq!(verdict.harm, Harm::Harmful);
    }

    #[test]
    fn numbers_that_cannot_be_are_errors_that_name_the_field() {
        let config = ZoneConfig { width_m: 0.0, ..ZoneConfig::default() };
        assert!(Zone::try_from(config).unwrap_err().to_string().contains("width_m is 0"));
        let config = ZoneConfig { min_overlap_ratio: 1.5, ..ZoneConfig::default() };
        assert!(matches!(Zone::try_from(config), Err(ZoneError::Ratio { .. })));
        let zone = Zone::try_from(ZoneConfig::default()).unwrap();
        assert!(zone.rect(&ego(f64::NAN, 0.0)).unwrap_err().to_string().contains("speed_mps is NaN"));
        assert!(matches!(zone.rect(&ego(1e308, 0.0)), Err(ZoneError::Depth { .. })));
        let bumper = EgoState { front_bumper_x_m: -1.0, ..ego(1.0, 0.0) };
        assert!(matches!(zone.rect(&bumper), Err(ZoneError::StateNotPositive { .. })));
        let flat = rect(1.0, 0.0).harm_of(&block(1.0, 0.0, 2.0, -1.0)).unwrap_err();
        assert!(flat.to_string().contains("width_m is -1"));
        assert!(matches!(
            rect(1.0, 0.0).harm_of(&block(0.0, 0.0, 1e200, 1e200)),
            Err(ZoneError::Overlap { .. })
        ));
    }

    proptest! {
        #[test]
        fn the_zone_has_the_area_of_its_depth_and_width(speed in -5.0..40.0, steering in -0.7..0.7) {
            let depth_m = 2.0 * f64::max(speed, 0.0) + 5.0;
            prop_assert!((polygon_area(rect(speed, steering).corners()) - depth_m * 3.5).abs() < 1e-9);
        }

        #[test]
        fn mirroring_road_and_steering_changes_nothing(
            speed in 0.0..30.0, steering in -0.6..0.6, x in 0.0..60.0, y in -8.0..8.0, yaw in -3.0..3.0,
        ) {
            let seen = Box3 { yaw_rad: yaw, ..block(x, y, 4.2, 1.8) };
            let mirrored = Box3 { yaw_rad: -yaw, ..block(x, -y, 4.2, 1.8) };
            let verdict = rect(speed, steering).harm_of(&seen).unwrap();
            let other = rect(speed, -steering).harm_of(&mirrored).unwrap();
            prop_assert!((verdict.overlap_area_m2 - other.overlap_area_m2).abs() < 1e-9);
            prop_assert!((0.0..=1.0 + 1e-9).contains(&verdict.overlap_ratio));
        }

        #[test]
        fn more_speed_never_makes_an_object_less_harmful(
            speed in 0.0..20.0, more in 0.0..20.0, steering in -0.6..0.6, x in 0.0..60.0, y in -8.0..8.0,
        ) {
            let slow = rect(speed, steering).harm_of(&block(x, y, 1.0, 1.0)).unwrap();
            let fast = rect(speed + more, steering).harm_of(&block(x, y, 1.0, 1.0)).unwrap();
            prop_assert!(fast.overlap_area_m2 >= slow.overlap_area_m2 - 1e-9);
        }
    }
}
