//! The config of `harmzone drive`: `drive.toml`.

use crate::config::{Check, InvalidConfig, define_config, from_to, part, require};
use crate::generate::{CONTROL_PERIOD_S, GenerateConfig};
use crate::zone::ZoneConfig;

/// Above this, a brake is a hard one: what a false stop is counted by.
pub const HARD_BRAKING_MPS2: f64 = 3.0;

define_config! {
    /// What is driven, and how the driver under test reacts.
    pub struct DriveConfig {
        /// Longest time of an episode, simulated seconds.
        seconds: f64 = 30.0, in from_to(1.0, 3600.0);
        /// An episode ends where the ego has stood so long because perception told it to.
        standing_s: f64 = 4.0, in from_to(0.1, 3600.0);
        /// What moves is truly harmful, too, where it and the ego would meet within so long if both kept their motion, seconds;
        /// for every driver alike.
        met_within_s: f64 = 2.0, in from_to(0.0, 10.0);
        /// Longest wait for an answer of an external detector, seconds of the wall clock; ten times as long for its first.
        reply_s: f64 = 30.0, in from_to(0.01, 3600.0);
        reflex: ReflexConfig = ReflexConfig::default(), in part::<ReflexConfig>();
        /// What is truly harmful, and the rule of `truth` and of `zone:RUN`.
        zone: ZoneConfig = ZoneConfig::default(), in part::<ZoneConfig>();
        /// Town, weather, traffic, objects and sensors, as `harmzone gen` takes them; its samples and warm-up have no part here.
        world: GenerateConfig = GenerateConfig::default(), in part::<GenerateConfig>();
    }
}

define_config! {
    /// How boxes become braking.
    pub struct ReflexConfig {
        /// Score from which on a box brakes as hard as it takes; 0: the detector's own, or any.
        score: f64 = 0.0, in from_to(0.0, 1.0);
        /// A harmful box counts when it is there in so many ..
        n_confirming: u32 = 2, in from_to(1.0, 100.0);
        /// .. of the last so many samples; three show how fast a thing moves.
        n_samples: u32 = 3, in from_to(3.0, 100.0);
        /// Boxes of two samples nearer than this are of one thing, metres between their centres on the ground.
        same_m: f64 = 3.0, in from_to(0.1, 100.0);
        /// The ego stops so far before the box, metres.
        margin_m: f64 = 2.0, in from_to(0.0, 50.0);
        /// Least and greatest braking, m/s².
        braking_mps2: [f64; 2] = [0.5, 8.0], in from_to(0.01, 50.0).pair();
        /// Greatest braking for a hazard whose boxes are below the score for braking, but not below that for warning, m/s²; 0: such
        /// boxes count for nothing.
        partial_mps2: f64 = 3.0, in from_to(0.0, 50.0);
        /// The way is free when no box has been confirmed for so long, seconds.
        free_s: f64 = 1.0, in from_to(0.0, 60.0);
        /// Nearer to the bumper than this, in the strip ahead, a hazard that stands is not free until it is passed: sensors look over
        /// what is low, metres.
        near_m: f64 = 3.0, in from_to(0.0, 50.0);
        /// .. where so many samples have confirmed it.
        near_confirming: u32 = 4, in from_to(1.0, 100.0);
        /// .. the last so many of them within this of where it is, metres: who walks by is free when no sample confirms it.
        near_moved_m: f64 = 0.5, in from_to(0.0, 50.0);
        /// From a sample's time to the brake, seconds; control acts every 0.05 s.
        latency_s: f64 = 0.0, in from_to(0.0, 10.0);
        /// The time that perception takes on this machine comes on top, and what is measured while it is busy is not looked at:
        /// the same seed then no longer gives the same bytes.
        real_latency: bool = false;
        /// Half the width of the strip ahead in which a box's distance is measured, metres: the zone's half width.
        half_width_m: f64 = 1.75, in from_to(0.1, 20.0);
        /// A thing that moves is a hazard, too, where it and the ego would meet within so long if both kept their motion,
        /// seconds; 0: only harmful boxes are.
        foresight_s: f64 = 2.0, in from_to(0.0, 10.0);
        /// From this speed over ground on a thing moves, m/s.
        moving_mps: f64 = 1.0, in from_to(0.0, 50.0);
        /// Who comes so near beside the ego's body meets it, metres.
        beside_m: f64 = 0.5, in from_to(0.0, 2.5);
        /// .. also where it slows down to this share of its speed, as what rolls or tumbles does; 1: nothing slows down.
        slows_to: f64 = 0.5, in from_to(0.0, 1.0);
        /// What stands on the ego's route is a hazard, too, where the zone's rectangle, which leaves a bend, does not reach it, and
        /// the ego would be there within so long, seconds; 0: it never is.
        route_foresight_s: f64 = 2.0, in from_to(0.0, 10.0);
    }
}

impl Check for DriveConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        self.world.check_relations().map_err(|error| error.within("world"))?;
        require(!self.world.render.aov, "world.render.aov", true, "drives write no AOVs; false is needed")?;
        let wanted = "drives record no sweeps; 0 is needed";
        require(self.world.sweeps == 0, "world.sweeps", self.world.sweeps, wanted)?;
        self.zone.check_relations().map_err(|error| error.within("zone"))?;
        self.reflex.check_relations().map_err(|error| error.within("reflex"))
    }
}

impl Check for ReflexConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let wanted = format!("at most n_samples, {}, is needed", self.n_samples);
        require(self.n_confirming <= self.n_samples, "n_confirming", self.n_confirming, wanted)
    }
}

impl DriveConfig {
    /// Control steps of an episode.
    pub(super) fn n_steps(&self) -> u64 {
        (self.seconds / CONTROL_PERIOD_S).round() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::assert_every_number_is_checked;

    #[test]
    fn the_shipped_file_holds_the_defaults_but_for_the_world() {
        let text = include_str!("../../configs/drive.toml");
        assert_eq!(toml::from_str::<DriveConfig>(text).unwrap(), DriveConfig::default());
    }

    #[test]
    fn every_number_has_bounds() {
        assert_every_number_is_checked(&DriveConfig::default());
    }

    #[test]
    fn more_confirming_samples_than_samples_are_refused() {
        let reflex = ReflexConfig { n_confirming: 4, ..ReflexConfig::default() };
        let error = DriveConfig { reflex, ..DriveConfig::default() }.check().unwrap_err().to_string();
        assert!(error.contains("reflex.n_confirming is 4") && error.contains("n_samples, 3"), "{error}");
    }
}
