//! What a scenario says of an actor.

use serde::{Deserialize, Serialize};

use crate::config::{define_config, from_to};

/// What an actor does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActorMotion {
    /// Stands, or lies.
    #[default]
    Stands,
    /// Sets out when the ego comes, straight on along its yaw, and stops after its way.
    Dashes,
    /// The same along the ego's route, with it or, with a yaw of 180 degrees, towards it.
    Drives,
    /// Is let go when the ego comes, at its height, along its yaw; physics has it from then on.
    Flies,
}

define_config! {
    /// One actor, of a scenario.
    pub struct ActorConfig {
        /// Name of a model, or a category, of which the world's seed draws one.
        model: String = String::new();
        /// From the ego's start along its route, metres.
        ahead_m: f64 = 40.0, in from_to(-100.0, 2000.0);
        /// To the left of the route.
        left_m: f64 = 0.0, in from_to(-50.0, 50.0);
        /// Heading against the route's.
        yaw_deg: f64 = 0.0, in from_to(-360.0, 360.0);
        motion: ActorMotion = ActorMotion::Stands;
        speed_mps: f64 = 2.0, in from_to(0.0, 40.0);
        /// What dashes or drives goes so far.
        way_m: f64 = 6.0, in from_to(0.0, 1000.0);
        /// It sets out when the ego's rear axle is so near to where it stands; what flies, to where it comes down.
        trigger_m: f64 = 25.0, in from_to(0.0, 1000.0);
        /// Over the ground, of what flies.
        height_m: f64 = 0.0, in from_to(0.0, 50.0);
    }
}
