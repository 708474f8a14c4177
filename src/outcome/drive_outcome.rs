//! What one drive came to.

use serde::{Deserialize, Serialize};

use crate::episode::EpisodeEntry;
use crate::object::{Distribution, Event, Kind, Spot};

/// How an episode ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// Its time was over, or the route.
    Time,
    /// The ego drove into something.
    Collision,
    /// The ego stands before something harmful.
    Stopped,
    /// The ego stands, perception's brake on, with nothing harmful before it.
    Stuck,
    /// The detector failed; nothing can be said of the drive.
    Failed(String),
}

/// What the ego drove into, and how hard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Collision {
    /// Since the start.
    pub time_s: f64,
    /// Id and category of the object; `scenery-N` and `scenery` for what is no object, by the simulator's number of its body.
    pub object: String,
    pub category: String,
    /// `None`: scenery.
    pub kind: Option<Kind>,
    pub distribution: Option<Distribution>,
    pub event: Event,
    pub spot: Spot,
    /// Whether it is of the surroundings that are never annotated.
    pub is_background: bool,
    /// Closing speed of ego and object, along the normal of the contact.
    pub impact_mps: f64,
    /// Speed of the ego against the object, in whatever direction: of a graze much more than the closing speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_mps: Option<f64>,
    pub ego_mps: f64,
    /// `m v^2 / 2` with the reduced mass and the closing speed along the normal of the contact.
    pub energy_j: f64,
    /// From when the ego's coming set the object off, for what falls, rolls, is thrown or dashes.
    pub set_off_s: Option<f64>,
    /// Whether it was set off too late for any brake: see [`is_sudden`].
    pub is_sudden: bool,
    /// Whether the object was truly harmful, in the zone or about to meet the ego, within the two seconds before.
    pub was_harmful: bool,
}

/// From an event to the earliest brake: a sample and its confirmation.
const REACTION_S: f64 = 0.35;
/// All brakes on a dry road.
const FULL_BRAKING_MPS2: f64 = 8.0;

/// Whether an object that is set off so long before it is hit is so too late for a car at this speed to stop before it, if it
/// brakes with all it has from a third of a second after: `v t < v 0.35 s + v^2 / (2 * 8 m/s^2)`.
#[must_use]
pub fn is_sudden(set_off_s: f64, ego_mps: f64) -> bool {
    set_off_s < REACTION_S + ego_mps / (2.0 * FULL_BRAKING_MPS2)
}

/// A brake by perception's order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HardStop {
    pub time_s: f64,
    /// Greatest braking that was ordered.
    pub braking_mps2: f64,
    /// Whether nothing was truly harmful while it braked, nor for the time before in which a hazard is remembered.
    pub is_false: bool,
}

/// One drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveOutcome {
    pub episode: String,
    /// Of a scenario; else empty.
    pub family: String,
    pub seed: u64,
    pub town: String,
    pub weather: String,
    pub end: End,
    pub duration_s: f64,
    pub distance_m: f64,
    /// How far a car comes in this time with nothing in its way and all lights green.
    pub free_m: f64,
    pub collision: Option<Collision>,
    /// Objects that ran into the ego while it stood, or towards which it did not drive: from the side or from behind.
    pub struck_by: Vec<String>,
    /// Above 3 m/s².
    pub hard_stops: Vec<HardStop>,
    /// Above 1 m/s², the hard ones too; empty in what older rules wrote.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub brakes: Vec<HardStop>,
    /// At the first brake with something harmful there: until the ego would meet the first of it if both kept their speeds, from the
    /// bumper along the ego's x axis. `None` where nothing comes nearer, too.
    pub first_brake_ttc_s: Option<f64>,
    /// Greatest deceleration of the car, over 0.25 s.
    pub hardest_mps2: f64,
    /// Root mean square of the change of the acceleration, both over 0.25 s.
    pub rms_jerk_mps3: f64,
    pub n_samples: usize,
    /// The recorded episode, if it was recorded.
    pub entry: Option<EpisodeEntry>,
}

impl DriveOutcome {
    #[must_use]
    pub fn is_failed(&self) -> bool {
        matches!(self.end, End::Failed(_))
    }

    /// Hard brakes with nothing truly harmful.
    #[must_use]
    pub fn n_false_stops(&self) -> usize {
        self.hard_stops.iter().filter(|stop| stop.is_false).count()
    }

    /// Brakes of any strength with nothing truly harmful.
    #[must_use]
    pub fn n_vain_brakes(&self) -> usize {
        self.brakes.iter().filter(|stop| stop.is_false).count()
    }
}
