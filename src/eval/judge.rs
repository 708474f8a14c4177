//! What decides on harm: the network itself, or its rival, the zone applied to the network's boxes.
//!
//! The rival knows the label's own rule, and the measured speed and steering angle; what it lacks is the true box.
//! Its boxes are the network's without their classes: a harmful and a harmless detection of one object become one
//! box, whose score is the sum of both, since the two exclude each other.

use serde::{Deserialize, Serialize};

use super::expected::ExpectedVerdict;
use super::matching::center_distance_m;
use crate::object::{Detection, Harm, MIN_SCORE};
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneError};

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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::dataset::{SampleFacts, test_data};
    use crate::eval::{Columns, EvalSample, Mode, Protocol, score};
    use crate::geometry::{Box3, Ego, Point};
    use crate::object::Distribution;
    use crate::zone::{ZoneConfig, ZoneKind};

    fn state(speed_mps: f64, steering_deg: f64) -> EgoState {
        EgoState {
            speed_mps,
            steering_angle_rad: steering_deg.to_radians(),
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        }
    }

    fn found(x_m: f64, y_m: f64, harm: Harm, score: f64) -> Detection {
        let box_in_ego = Box3::<Ego> {
            center: Point::new(x_m, y_m, 0.5),
            length_m: 1.0,
            width_m: 1.0,
            height_m: 1.0,
            yaw_rad: 0.0,
        };
        Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
    }

    /// Class and score of each, in hundredths.
    fn told(judge: Judge, detections: &[Detection], state: &EgoState) -> Vec<(Harm, i32)> {
        let zone = Zone::try_from(ZoneConfig::default()).unwrap();
        let judged = judge.judge(detections, state, &zone).unwrap();
        judged.iter().map(|d| (d.harm, (100.0 * d.score).round() as i32)).collect()
    }

    #[test]
    fn both_classes_of_a_query_and_of_near_boxes_are_one_object_whose_harm_the_zone_says() {
        use Harm::{Harmful, Harmless};
        let detections = [
            found(10.0, 0.0, Harmless, 0.6),
            found(10.0, 0.0, Harmful, 0.3),
            // Another object beside it, of one class alone, and a third one with two boxes 0.3 m apart.
            found(10.4, 0.0, Harmless, 0.5),
            found(20.0, 9.0, Harmful, 0.4),
            found(20.3, 9.0, Harmless, 0.05),
        ];
        // At 10 m/s the zone is 25 m deep: both boxes at 10 m lie in it, the one 9 m to the left does not.
        let state = state(10.0, 0.0);
        assert_eq!(told(Judge::Zone, &detections, &state), [(Harmful, 90), (Harmful, 50), (Harmless, 45)]);
        assert_eq!(told(Judge::Network, &detections, &state).len(), 5);
    }

    #[test]
    fn the_rule_by_speed_alone_looks_straight_ahead() {
        let aside = [found(15.0, 5.0, Harm::Harmful, 0.8)];
        // atan(5 / 11.4) is 23.7 degrees.
        let turning = state(10.0, 23.7);
        assert_eq!(told(Judge::Zone, &aside, &turning), [(Harm::Harmful, 80)]);
        assert_eq!(told(Judge::SpeedZone, &aside, &turning), [(Harm::Harmless, 80)]);
        let shares = told(Judge::SpeedZoneSoft, &aside, &turning);
        assert_eq!(shares, told(Judge::ZoneSoft, &aside, &state(10.0, 0.0)));
    }

    #[test]
    fn the_soft_rule_is_in_doubt_at_the_edge_and_sure_away_from_it() {
        // The zone ends at 28.6 m: a box from 28.6 m on touches it, one from 29.1 m on is half a metre away.
        let at =
            |x_m: f64| told(Judge::ZoneSoft, &[found(x_m + 0.5, 0.0, Harm::Harmful, 1.0)], &state(10.0, 0.0));
        assert_eq!(at(28.6), [(Harm::Harmless, 50), (Harm::Harmful, 50)]);
        assert_eq!(at(29.1), [(Harm::Harmless, 73), (Harm::Harmful, 27)]);
        assert_eq!(at(20.0), [(Harm::Harmful, 99), (Harm::Harmless, 1)]);
        assert_eq!(at(40.0), [(Harm::Harmless, 100)]);
    }

    #[test]
    fn both_together_lie_between_the_network_and_the_expected_rule() {
        let detections = [found(20.0, 0.0, Harm::Harmless, 0.6), found(20.0, 0.0, Harm::Harmful, 0.2)];
        let harmful = |judge| {
            let all = told(judge, &detections, &state(10.0, 0.0)).into_iter();
            all.filter(|told| told.0 == Harm::Harmful).map(|told| told.1).sum::<i32>()
        };
        let (network, both, rule) =
            (harmful(Judge::Network), harmful(Judge::Both), harmful(Judge::ZoneExpected));
        assert!(network < both && both < rule, "{network} {both} {rule}");
    }

    #[test]
    fn names_are_those_of_files() {
        for judge in Judge::ALL {
            assert_eq!(serde_json::to_value(judge).unwrap(), judge.name());
            assert_eq!(Judge::named(judge.name()), Some(judge));
        }
        assert_eq!(Judge::named("oracle"), None);
    }

    #[test]
    fn every_zone_judges_hard_and_only_the_rectangle_softly() {
        for kind in ZoneKind::ALL {
            let zone = Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap();
            let boxes = [found(10.0, 0.0, Harm::Harmless, 0.9), found(10.0, 9.0, Harm::Harmful, 0.8)];
            let hard = Judge::Zone.judge(&boxes, &state(10.0, 0.0), &zone).unwrap();
            let harms: Vec<Harm> = hard.iter().map(|detection| detection.harm).collect();
            assert_eq!(harms, [Harm::Harmful, Harm::Harmless], "{kind:?}");
            let soft = Judge::ZoneSoft.judge(&boxes, &state(10.0, 0.0), &zone);
            assert_eq!(matches!(soft, Err(ZoneError::NoEdge)), kind != ZoneKind::Rect);
        }
    }

    /// AP of a judge over perfect boxes of made-up streets, every second object out of distribution.
    fn ap_of_perfect_boxes(judge: Judge, scores: &[f64], classes: &[bool]) -> Columns<[f64; 2]> {
        let dataset = test_data::dataset(12);
        let draws = scores.iter().zip(classes).cycle();
        let mut draws = draws.map(|(&score, &is_harmful)| (score, Harm::ALL[usize::from(!is_harmful)]));
        let samples: Vec<EvalSample> = dataset
            .samples()
            .iter()
            .map(|sample| {
                let mut objects = sample.objects.clone();
                for object in objects.iter_mut().skip(1).step_by(2) {
                    object.truth.distribution = Some(Distribution::Ood);
                }
                let boxes: Vec<Detection> = objects
                    .iter()
                    .map(|object| {
                        let (score, harm) = draws.next().unwrap();
                        let box_in_ego = object.truth.box_in_ego;
                        Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
                    })
                    .collect();
                let detections = judge.judge(&boxes, &sample.measured.ego_state, dataset.zone()).unwrap();
                EvalSample::new(&sample.id, SampleFacts::default(), objects, detections)
            })
            .collect();
        let columns = score(&samples, &Protocol::default(), Mode::Ood).unwrap().columns;
        let both = |scores: &crate::eval::ClassScores| [scores.harmful, scores.harmless].map(Option::unwrap);
        Columns {
            total: both(&columns.total),
            id_matched: columns.id_matched.as_ref().map(both),
            ood_all: columns.ood_all.as_ref().map(both),
            ood_matched: columns.ood_matched.as_ref().map(both),
        }
    }

    fn lowest(columns: &Columns<[f64; 2]>) -> f64 {
        let others = [&columns.id_matched, &columns.ood_all, &columns.ood_matched];
        let all = others.into_iter().map(|column| column.unwrap()).chain([columns.total]);
        all.flatten().fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn over_perfect_boxes_the_zone_has_an_ap_of_one_in_every_column_whatever_scores_and_classes_say(
            scores in prop::collection::vec(0.02_f64..1.0, 7),
            classes in prop::collection::vec(any::<bool>(), 11),
        ) {
            let lowest_of = |judge, scores: &[f64]| lowest(&ap_of_perfect_boxes(judge, scores, &classes));
            prop_assert!(lowest_of(Judge::Zone, &scores) > 1.0 - 1e-9);
            // The soft rule ranks by its doubt too: equal scores are needed. The shares of the other class, behind all
            // truths, count at full recall alone, the last of the 90 steps.
            prop_assert!(lowest_of(Judge::ZoneSoft, &[0.9]) > 1.0 - 1.0 / 90.0);
            // On made-up streets the wheels are turned: the rule that ignores this is wrong there.
            prop_assert!(lowest_of(Judge::SpeedZone, &scores) < 1.0 - 1.0 / 90.0);
        }
    }
}
