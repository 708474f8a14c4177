//! The zone's config as `zone.toml` gives it, and the parts of it that zones share.

use super::corridor::Body;
use super::error::ZoneError;
use super::kinds::ZoneKind;
use crate::config::{Check, above, define_config, from_to, part};
use crate::sample::EgoState;

define_config! {
    /// The zone as `zone.toml` gives it, unchecked; [`super::Zone`] is the checked form.
    pub struct ZoneConfig {
        /// Shape; default `rect`.
        kind: ZoneKind = ZoneKind::Rect;
        /// `rect`, `arc`: part of the depth that does not depend on speed, metres; default 5.
        min_safe_distance_m: f64 = 5.0, in above(0.0, 1000.0);
        /// `rect`, `arc`: part of the depth that grows with speed, seconds; default 2 (the two-second rule).
        time_gap_s: f64 = 2.0, in above(0.0, 100.0);
        /// `rect`, `arc`: width, metres; default 3.5 (a lane).
        width_m: f64 = 3.5, in above(0.0, 100.0);
        /// `rect`, `arc`: overlap from which an object is harmful, square metres; default 1.
        min_overlap_area_m2: f64 = 1.0, in above(0.0, 1e6);
        /// `rect`, `arc`: overlap over the object's footprint from which it is harmful, above 0 and at most 1; default 0.25.
        min_overlap_ratio: f64 = 0.25, in above(0.0, 1.0);
        /// An object whose lowest point is higher above the ground is harmless until it falls, metres; 0: height does
        /// not matter, as in the paper; default 2.5.
        max_clearance_m: f64 = 2.5, in from_to(0.0, 1000.0);
        /// `arc`, `ttc`, `rss`: the ego's arc ends when the ego has turned this far, degrees, above 0 and at
        /// most 180; default 180.
        max_turn_deg: f64 = 180.0, in above(0.0, 180.0);
        /// `ttc`, `rss`: the ego's body.
        body: BodyConfig = BodyConfig::default(), in part::<BodyConfig>();
        /// Keys of `ttc`.
        ttc: TtcConfig = TtcConfig::default(), in part::<TtcConfig>();
        /// Keys of `rss`.
        rss: RssConfig = RssConfig::default(), in part::<RssConfig>();
    }
}

define_config! {
    /// Measures of the ego's body that its state does not contain; by default those of the simulated car.
    #[derive(Copy)]
    pub struct BodyConfig {
        /// Metres; default 1.73.
        width_m: f64 = 1.73, in above(0.0, 100.0);
        /// From the rear axle to the rear bumper, metres; default 0.734.
        rear_overhang_m: f64 = 0.734, in above(0.0, 100.0);
    }
}

impl Check for ZoneConfig {}

define_config! {
    /// Keys of `ttc` alone.
    #[derive(Copy)]
    pub struct TtcConfig {
        /// Contact within this time is harmful, seconds; default 4.
        horizon_s: f64 = 4.0, in above(0.0, 60.0);
    }
}

define_config! {
    /// Keys of `rss` alone: what each side is assumed to do. Defaults: ad-rss-lib's parameter discussion.
    #[derive(Copy)]
    pub struct RssConfig {
        /// Response time of the ego, seconds; default 1.
        response_time_s: f64 = 1.0, in above(0.0, 60.0);
        /// Response time of the other, seconds; default 2.
        other_response_time_s: f64 = 2.0, in above(0.0, 60.0);
        /// Greatest acceleration along the road while responding, m/s²; default 3.5.
        max_accel_mps2: f64 = 3.5, in above(0.0, 100.0);
        /// Least braking after the response, m/s²; default 4.
        min_brake_mps2: f64 = 4.0, in above(0.0, 100.0);
        /// Greatest braking of the one ahead, m/s²; default 8.
        max_brake_mps2: f64 = 8.0, in above(0.0, 100.0);
        /// Least braking of the ego against oncoming traffic, m/s²; default 3.
        min_brake_correct_mps2: f64 = 3.0, in above(0.0, 100.0);
        /// Greatest acceleration to the side while responding, m/s²; default 0.2.
        lateral_max_accel_mps2: f64 = 0.2, in above(0.0, 100.0);
        /// Least braking to the side after the response, m/s²; default 0.8.
        lateral_min_brake_mps2: f64 = 0.8, in above(0.0, 100.0);
        /// Kept to the side beyond all motion, metres; default 0.1.
        lateral_margin_m: f64 = 0.1, in above(0.0, 100.0);
        /// An object that approaches more slowly than this along the ego's course counts as standing, m/s;
        /// default 0.5.
        standing_speed_mps: f64 = 0.5, in above(0.0, 100.0);
    }
}

impl ZoneConfig {
    /// Depth of the rectangle and of the arc; a car that rolls backwards keeps the safe distance alone.
    pub(super) fn depth_at_m(&self, speed_mps: f64) -> f64 {
        self.time_gap_s * speed_mps.max(0.0) + self.min_safe_distance_m
    }

    pub(super) fn depth_m(&self, ego: &EgoState) -> Result<f64, ZoneError> {
        let depth_m = self.depth_at_m(ego.speed_mps);
        let error = ZoneError::Depth { depth_m, speed_mps: ego.speed_mps };
        depth_m.is_finite().then_some(depth_m).ok_or(error)
    }

    pub(super) fn body_of(&self, ego: &EgoState) -> Body {
        let (front_m, rear_m) = (ego.front_bumper_x_m, self.body.rear_overhang_m);
        let half_width_m = self.body.width_m / 2.0;
        Body { front_m, rear_m, left_m: half_width_m, right_m: half_width_m }
    }

    pub(super) fn max_turn_rad(&self) -> f64 {
        self.max_turn_deg.to_radians()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::car::{EGO_LENGTH_M, EGO_WIDTH_M, FRONT_BUMPER_X_M};

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
    fn every_number_is_checked() {
        crate::config::assert_every_number_is_checked(&ZoneConfig::default());
        let config = ZoneConfig { max_turn_deg: 270.0, ..ZoneConfig::default() };
        let wanted = "max_turn_deg is 270.0; a number above 0 and at most 180 is needed";
        assert_eq!(config.check().unwrap_err().to_string(), wanted);
    }
}
