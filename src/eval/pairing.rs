//! Which detections of one sample take which of its objects, at every threshold.
//!
//! The rules stand in [`super::matching`]. Matching never leaves a sample, so each is decided by itself.

use std::cmp::Reverse;

use super::filter::KeptSample;
use super::neutral::NeutralReason;
use crate::object::{Detection, Harm};

/// What became of a detection; objects by their number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// A true positive on this object.
    Matched(u32),
    /// A false positive; this object of the other class is the nearest within the threshold.
    Misclassified(u32),
    /// A false positive with no object within the threshold that it could be attributed to.
    Unmatched,
    /// As unmatched, but nobody annotated what may be there: neither a true nor a false positive.
    Neutral(NeutralReason),
}

impl Outcome {
    /// The outcome where all that is not a true positive is a false one.
    #[must_use]
    pub fn strictly(self) -> Self {
        if let Self::Neutral(_) = self { Self::Unmatched } else { self }
    }
}

/// A number that sorts as the score does, lowest first; both zeros are alike. The score must be finite.
pub(super) fn order_of(score: f64) -> u64 {
    // Negative zero becomes zero.
    let bits = (score + 0.0).to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// Decides sample after sample, in memory that is asked for once.
pub(super) struct Pairing<'a> {
    thresholds_m: &'a [f64],
    reach_m: f64,
    /// The detections' order and their places in the sample, best first.
    order: Vec<(u64, usize)>,
    /// Of each object: where it is, and its class.
    objects: Vec<([f64; 2], Harm)>,
    /// `[threshold][object]`.
    is_claimed: Vec<bool>,
    /// Objects of a detection's class within reach, nearest first.
    same_class: Vec<(f64, usize)>,
}

impl<'a> Pairing<'a> {
    pub fn new(thresholds_m: &'a [f64]) -> Self {
        let reach_m = thresholds_m.iter().copied().fold(0.0, f64::max);
        Self {
            thresholds_m,
            reach_m,
            order: Vec::new(),
            objects: Vec::new(),
            is_claimed: Vec::new(),
            same_class: Vec::new(),
        }
    }

    /// Outcomes of a sample's detections, `[detection][threshold]`, in the sample's order; `first_number` is that of its
    /// first object.
    pub fn decide(&mut self, sample: &KeptSample<'_>, first_number: usize, outcomes: &mut [Outcome]) {
        let n_thresholds = self.thresholds_m.len();
        self.order.clear();
        self.order.extend(sample.detections.iter().enumerate().map(|(i, found)| (order_of(found.score), i)));
        self.order.sort_unstable_by_key(|&of| Reverse(of));
        self.objects.clear();
        self.objects.extend(sample.objects.iter().map(|object| {
            let center = &object.truth.box_in_ego.center;
            ([center.x(), center.y()], object.harm)
        }));
        self.is_claimed.clear();
        self.is_claimed.resize(n_thresholds * self.objects.len(), false);
        for place in 0..self.order.len() {
            let at = self.order[place].1;
            let of_detection = &mut outcomes[at * n_thresholds..(at + 1) * n_thresholds];
            let otherwise = sample.neutral_at(at).map_or(Outcome::Unmatched, Outcome::Neutral);
            self.decide_one(sample.detections[at], first_number, otherwise, of_detection);
        }
    }

    fn decide_one(
        &mut self,
        found: &Detection,
        first_number: usize,
        otherwise: Outcome,
        outcomes: &mut [Outcome],
    ) {
        let other_class = self.find_neighbours(found);
        for (i, (&threshold_m, outcome)) in self.thresholds_m.iter().zip(outcomes).enumerate() {
            let is_claimed = &mut self.is_claimed[i * self.objects.len()..][..self.objects.len()];
            let free = self.same_class.iter().find(|&&(_, object)| !is_claimed[object]);
            *outcome = match (free, other_class) {
                (Some(&(distance_m, object)), _) if distance_m < threshold_m => {
                    is_claimed[object] = true;
                    Outcome::Matched((first_number + object) as u32)
                }
                (_, Some((distance_m, object))) if distance_m < threshold_m => {
                    Outcome::Misclassified((first_number + object) as u32)
                }
                _ => otherwise,
            };
        }
    }

    /// Collects the objects of the detection's class within reach, nearest first, and returns the nearest of the other
    /// class within reach, with its distance.
    fn find_neighbours(&mut self, found: &Detection) -> Option<(f64, usize)> {
        let (x_m, y_m) = (found.box_in_ego.center.x(), found.box_in_ego.center.y());
        let mut other_class: Option<(f64, usize)> = None;
        self.same_class.clear();
        // More than what rounding can add to a distance within reach.
        let reach_m2 = self.reach_m * self.reach_m * (1.0 + 1e-9);
        for (object, &([object_x_m, object_y_m], harm)) in self.objects.iter().enumerate() {
            let (dx, dy) = (x_m - object_x_m, y_m - object_y_m);
            let squared = dx * dx + dy * dy;
            if squared > reach_m2 {
                continue;
            }
            // As `center_distance_m` has it, to the last bit.
            let distance_m = squared.sqrt();
            if distance_m >= self.reach_m {
                continue;
            }
            if harm != found.harm {
                if other_class.is_none_or(|(nearest_m, _)| distance_m < nearest_m) {
                    other_class = Some((distance_m, object));
                }
                continue;
            }
            let is_nearer = |&&(other_m, _): &&(f64, usize)| other_m > distance_m;
            let n_farther = self.same_class.iter().rev().take_while(is_nearer).count();
            self.same_class.insert(self.same_class.len() - n_farther, (distance_m, object));
        }
        other_class
    }
}
