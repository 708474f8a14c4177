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
    /// Mean time between samples: more samples on the same way make more false alarms a kilometre. `None` where it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_period_s: Option<f64>,
}

impl OperatingScore {
    /// What another time between samples makes of it, in words; nothing where it is about the same, or not known.
    #[must_use]
    pub fn tell_other_period(&self, period_s: f64) -> Option<String> {
        let own_s = self.sample_period_s.filter(|own_s| (own_s / period_s - 1.0).abs() > 0.1)?;
        Some(format!(
            "the score {:.3} was chosen at a sample every {own_s:.1} s, and here one is taken every {period_s:.1} s: expect {:.1} times as \
             many false alarms a kilometre as the {:.1} that it may spend",
            self.score,
            own_s / period_s,
            self.max_false_alarms_per_km
        ))
    }
}

/// A network's scores, each for what it is for.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatingScores {
    /// From here on its harmful boxes are warnings.
    pub warning: OperatingScore,
    /// From here on a car brakes for them, which it does less lightly than it warns.
    pub braking: OperatingScore,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_time_between_samples_is_told_with_what_it_costs() {
        let of = |sample_period_s| OperatingScore {
            score: 0.3,
            max_false_alarms_per_km: 10.0,
            false_alarms_per_km: 9.8,
            missed_per_event: None,
            driven_km: 3.0,
            n_samples: 500,
            sample_period_s,
        };
        let told = of(Some(1.2)).tell_other_period(0.3).unwrap();
        assert!(told.contains("every 1.2 s") && told.contains("4.0 times"), "{told}");
        assert_eq!(of(Some(0.31)).tell_other_period(0.3), None);
        assert_eq!(of(None).tell_other_period(0.3), None);
    }
}
