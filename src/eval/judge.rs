//! What decides on harm: the network itself, or its rival, the zone applied to the network's boxes.
//!
//! The rival knows the label's own rule, and the measured speed and steering angle; what it lacks is the true box.
//! Its boxes are the network's without their classes: a harmful and a harmless detection of one object become one
//! box, whose score is the sum of both, since the two exclude each other.

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use super::expected::ExpectedVerdict;
use super::matching::center_distance_m;
use crate::object::{Detection, Harm, MIN_SCORE};
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneError, ZoneKind};

/// A harmful and a harmless detection nearer than this are of one object, metres: less than two people side by side.
const SAME_M: f64 = 0.5;
/// Distance from the zone's edge over which the soft rule's doubt falls by a factor e, metres: about the
/// error of the centre of a located box.
const DOUBT_M: f64 = 0.5;
/// A probability that both judges together never pass.
const SUREST: f64 = 1e-3;
/// The soft rule stays at least this far on the hard rule's side of one half.
const LEAST_LEAN: f64 = 1e-3;

/// What decides on harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Judge {
    /// The network's class branch.
    Network,
    /// The zone, yes or no.
    Zone,
    /// The zone, with a probability by the distance to its edge.
    ZoneSoft,
    /// The zone's expected verdict over the spreads of the box, as the network tells them, and of measured speed and
    /// steering.
    ZoneExpected,
    /// The network and the expected verdict, the mean of their log odds.
    Both,
    /// The zone from the speed alone: straight ahead whatever the steering angle.
    SpeedZone,
    /// The same with a probability.
    SpeedZoneSoft,
}

impl Judge {
    /// All of them; the network first.
    pub const ALL: [Self; 7] = [
        Self::Network,
        Self::Zone,
        Self::ZoneSoft,
        Self::ZoneExpected,
        Self::Both,
        Self::SpeedZone,
        Self::SpeedZoneSoft,
    ];

    /// The name in files and flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Network => "network",
            Self::Zone => "zone",
            Self::ZoneSoft => "zone-soft",
            Self::ZoneExpected => "zone-expected",
            Self::Both => "both",
            Self::SpeedZone => "speed-zone",
            Self::SpeedZoneSoft => "speed-zone-soft",
        }
    }

    /// The judge with this name, if there is one.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|judge| judge.name() == name)
    }

    /// Whether it decides by what the network says of harm, not by boxes alone.
    #[must_use]
    pub fn asks_the_network(self) -> bool {
        matches!(self, Self::Network | Self::Both)
    }

    fn is_expected(self) -> bool {
        matches!(self, Self::ZoneExpected | Self::Both)
    }

    fn is_soft(self) -> bool {
        matches!(self, Self::ZoneSoft | Self::SpeedZoneSoft)
    }

    /// Whether it can judge by a zone: a soft rule needs one with an edge to measure a distance to.
    #[must_use]
    pub fn fits(self, zone: &Zone) -> bool {
        !self.is_soft() || zone.config().kind == ZoneKind::Rect
    }

    fn is_straight(self) -> bool {
        matches!(self, Self::SpeedZone | Self::SpeedZoneSoft)
    }

    /// Decides on the harm of one sample's detections at a measured state, best first. The hard rule gives each box one
    /// class, the soft one both with the shares of its score; shares below [`MIN_SCORE`] are left out.
    ///
    /// # Errors
    /// The state or a box is not valid, or the soft rule meets a zone other than `rect`.
    pub fn judge(
        self,
        found: &[Detection],
        state: &EgoState,
        zone: &Zone,
    ) -> Result<Vec<Detection>, ZoneError> {
        if self == Self::Network {
            return Ok(found.to_vec());
        }
        if self.is_expected() {
            return self.judge_expected(found, state, zone);
        }
        let straight = EgoState { steering_angle_rad: 0.0, ..*state };
        let zone = zone.at(if self.is_straight() { &straight } else { state })?;
        let mut judged = Vec::with_capacity(found.len());
        for Joined { object, .. } in join_classes(found) {
            let harm = zone.harm_of(&object.box_in_ego, object.velocity_in_ego_mps)?.harm;
            if !self.is_soft() {
                judged.push(Detection { harm, ..object });
                continue;
            }
            let distance_m = zone.edge_distance_m(&object.box_in_ego)?;
            share_score(&object, harm_probability(distance_m, harm), &mut judged);
        }
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(judged)
    }

    /// Judges by draws of what box and state may truly be: the share of the draws whose box the zone calls harmful.
    fn judge_expected(
        self,
        found: &[Detection],
        state: &EgoState,
        zone: &Zone,
    ) -> Result<Vec<Detection>, ZoneError> {
        let expected_verdict = ExpectedVerdict::at(state, zone)?;
        let mut judged = Vec::with_capacity(found.len());
        for Joined { object, harmful_share, .. } in join_classes(found) {
            let expected = expected_verdict.of(&object)?;
            let p = match self {
                Self::Both => mean_of_log_odds(expected, harmful_share),
                _ => expected,
            };
            share_score(&object, p, &mut judged);
        }
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(judged)
    }
}

/// The probability whose log odds are the mean of those of two.
fn mean_of_log_odds(a: f64, b: f64) -> f64 {
    let log_odds = |p: f64| {
        let p = p.clamp(SUREST, 1.0 - SUREST);
        (p / (1.0 - p)).ln()
    };
    1.0 / (1.0 + (-f64::midpoint(log_odds(a), log_odds(b))).exp())
}

/// Gives each class a share of an object's score, as with the network's classes.
fn share_score(object: &Detection, p_harmful: f64, judged: &mut Vec<Detection>) {
    let p = p_harmful as f32;
    for (harm, share) in [(Harm::Harmful, p), (Harm::Harmless, 1.0 - p)] {
        let score = share * object.score as f32;
        if score >= MIN_SCORE {
            judged.push(Detection { harm, score: score.into(), ..*object });
        }
    }
}

/// Logistic in the signed distance to the zone's edge, kept on the rule's side of one half.
fn harm_probability(distance_m: f64, verdict: Harm) -> f64 {
    let p = 1.0 / (1.0 + (distance_m / DOUBT_M).exp());
    match verdict {
        Harm::Harmful => p.max(0.5 + LEAST_LEAN),
        Harm::Harmless => p.min(0.5 - LEAST_LEAN),
    }
}

/// One box of an object.
pub(super) struct Joined {
    /// With the sum of the scores of its two detections. The class left in it means nothing.
    pub object: Detection,
    /// Of the better detection among those given.
    pub place: usize,
    /// The harmful one's part of that sum.
    harmful_share: f64,
}

/// One box for each object, without regard to class: the better of its two detections. Detections with one box, which one
/// query reports, join first, then near ones.
pub(super) fn join_classes(found: &[Detection]) -> Vec<Joined> {
    let mut ranked: Vec<Joined> = found
        .iter()
        .enumerate()
        .map(|(place, &object)| {
            let harmful_share = f64::from(u8::from(object.harm == Harm::Harmful));
            Joined { object, place, harmful_share }
        })
        .collect();
    ranked.sort_by(|a, b| b.object.score.total_cmp(&a.object.score));
    let (mut is_joined, mut is_gone) = (vec![false; ranked.len()], vec![false; ranked.len()]);
    for reach_m in [0.0, SAME_M] {
        for i in 0..ranked.len() {
            if is_joined[i] {
                continue;
            }
            let one = ranked[i].object;
            let nearest = (i + 1..ranked.len())
                .filter(|&j| !is_joined[j] && ranked[j].object.harm != one.harm)
                .map(|j| (j, center_distance_m(&one.box_in_ego, &ranked[j].object.box_in_ego)))
                .filter(|&(_, distance_m)| distance_m <= reach_m)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((j, _)) = nearest {
                // The sum of two of a network's scores, as a network would give it.
                let other = ranked[j].object.score;
                let sum = one.score as f32 + other as f32;
                let harmful = if one.harm == Harm::Harmful { one.score } else { other };
                ranked[i].object.score = sum.min(1.0).into();
                ranked[i].harmful_share = harmful / (one.score + other);
                (is_joined[i], is_joined[j], is_gone[j]) = (true, true, true);
            }
        }
    }
    ranked.into_iter().zip(is_gone).filter_map(|(object, is_gone)| (!is_gone).then_some(object)).collect()
}
