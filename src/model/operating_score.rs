//! The scores from which on a network's boxes count, chosen on data that it did not learn from and kept with its weights.

use serde::{Deserialize, Serialize};

/// From which score on detections count, and what that cost where it was chosen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OperatingScore {
    /// The lowest that spends no more false alarms than were allowed.
    pub score: f64,
    /// What was allowed, per kilometre driven.
    pub max_false_alarms_per_km: f64,
    /// What it spent.
    pub false_alarms_per_km: f64,
    /// Share of the harmful events that it missed; `None` where none could be told apart.
    pub missed_per_event: Option<f64>,
    pub driven_km: f64,
    pub n_samples: usize,
}

/// A network's scores, each for what it is for.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatingScores {
    /// From here on its harmful boxes are warnings.
    pub warning: OperatingScore,
    /// From here on a car brakes for them, which it does less lightly than it warns.
    pub braking: OperatingScore,
}
