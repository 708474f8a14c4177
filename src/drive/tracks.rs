//! What moves over ground, from the boxes of a few samples.
//!
//! A detector's box of a thing seen in part grows as more of it comes into sight, and its centre moves although the thing stands.
//! So a box has moved as far as the stillest of its centre and its corners, and what comes into the ego's way is believed when
//! enough of the last samples say so.

use nalgebra::Vector2;

use super::config::ReflexConfig;
use crate::geometry::{Box3, World};

/// A box over ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub at: Box3<World>,
    /// Whether its score is enough for a full brake.
    pub is_sure: bool,
    pub is_harmful: bool,
    /// Over ground, where whoever tells of the box knows it, m/s.
    pub velocity_mps: Option<[f64; 2]>,
    /// Whether it was foreseen to meet the ego.
    pub meets: bool,
}

/// The boxes of one sample.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    pub time_s: f64,
    pub seen: Vec<Seen>,
    /// When it takes effect.
    pub due_s: f64,
}

/// Samples back over which a velocity is taken.
const N_BACK: usize = 2;

/// A box of a sample and those of the same thing before, the latest first; as far back as it is known without a gap.
pub(super) struct Track<'a>(Vec<(&'a Sample, Seen)>);

impl<'a> Track<'a> {
    /// Of the `i`-th box of a sample; `before`: the samples before it, the latest first.
    pub fn of(
        sample: &'a Sample,
        i: usize,
        before: impl Iterator<Item = &'a Sample>,
        config: &ReflexConfig,
    ) -> Self {
        let (mut of, mut idx) = (sample, i);
        let mut found = vec![(of, of.seen[idx])];
        for earlier in before {
            let Some(earlier_idx) = config.partner(&of.seen, idx, &earlier.seen) else { break };
            (of, idx) = (earlier, earlier_idx);
            found.push((of, of.seen[idx]));
        }
        Self(found)
    }

    /// Whether it is there in so many samples.
    pub fn is_seen_in(&self, n_samples: usize) -> bool {
        self.0.len() >= n_samples
    }

    /// How fast it moves over ground: as it was told, else as it has moved. `None` for what was not there before.
    pub fn velocity_mps(&self) -> Option<[f64; 2]> {
        if let Some(told) = self.0.first().and_then(|(_, seen)| seen.velocity_mps) {
            return Some(told);
        }
        let [(to, now), .., (from, first)] = &self.0[..self.0.len().min(N_BACK + 1)] else { return None };
        let after_s = to.time_s - from.time_s;
        (after_s > 0.0).then(|| (moved_m(&first.at, &now.at) / after_s).into())
    }

    /// How many of its boxes before the last are harmful or were foreseen to meet the ego, of those that count.
    pub fn n_alarming_before(&self, counts: impl Fn(&Seen) -> bool) -> usize {
        let is_alarming = |seen: &Seen| (seen.is_harmful || seen.meets) && counts(seen);
        self.0.iter().skip(1).filter(|(_, seen)| is_alarming(seen)).count()
    }
}

/// How far a thing has moved that was in the one box and is in the other.
pub(super) fn moved_m(from: &Box3<World>, to: &Box3<World>) -> Vector2<f64> {
    let points = |of: &Box3<World>| of.footprint().map(|corner| Vector2::new(corner.x_m, corner.y_m));
    let (before, now) = (points(from), points(to));
    let center = Vector2::new(to.center.x() - from.center.x(), to.center.y() - from.center.y());
    // A detector may turn a box by a quarter or a half from one sample to the next: the corners are paired so that they differ
    // least about the centre.
    let turned =
        (0..4).map(|turn| -> [Vector2<f64>; 4] { std::array::from_fn(|i| now[(i + turn) % 4] - before[i]) });
    let apart = |corners: &[Vector2<f64>; 4]| -> f64 {
        corners.iter().map(|corner| (corner - center).norm_squared()).sum()
    };
    let corners = turned.min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("there are four turns");
    let points = corners.into_iter().chain([center]);
    points.min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).expect("there are five points")
}

impl ReflexConfig {
    /// Whether two boxes of different samples may be of one thing.
    pub(super) fn is_same(&self, a: &Box3<World>, b: &Box3<World>) -> bool {
        apart_m(a, b) < self.same_m
    }

    /// The box of another sample that is of the same thing: each is the other's nearest.
    pub(super) fn partner(&self, of: &[Seen], i: usize, others: &[Seen]) -> Option<usize> {
        let near = |a: &Seen, among: &[Seen]| {
            let to_each = among.iter().map(|b| apart_m(&a.at, &b.at)).enumerate();
            to_each.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|&(_, apart_m)| apart_m < self.same_m)
        };
        let (j, there_m) = near(&of[i], others)?;
        let (_, back_m) = near(&others[j], of)?;
        (there_m <= back_m).then_some(j)
    }
}

/// Between the centres of two boxes on the ground.
pub(super) fn apart_m(a: &Box3<World>, b: &Box3<World>) -> f64 {
    (a.center.x() - b.center.x()).hypot(a.center.y() - b.center.y())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::geometry::Point;

    fn car(x_m: f64, length_m: f64) -> Box3<World> {
        Box3 { center: Point::new(x_m, 3.0, 0.7), length_m, width_m: 1.8, height_m: 1.5, yaw_rad: 0.0 }
    }

    #[test]
    fn a_box_that_grows_at_one_end_has_not_moved() {
        let moved = moved_m(&car(10.0, 2.0), &car(11.0, 4.0));
        assert!(moved.norm() < 1e-12, "{moved}");
    }

    #[test]
    fn a_box_that_moves_whole_has_moved_so_far_however_its_sides_are_named() {
        let moved = moved_m(&car(10.0, 4.0), &car(12.0, 4.0));
        assert!((moved - Vector2::new(2.0, 0.0)).norm() < 1e-12, "{moved}");
        for turn in 1..4 {
            let mut to = car(12.0, 4.0);
            to.yaw_rad = FRAC_PI_2 * f64::from(turn);
            if turn % 2 == 1 {
                (to.length_m, to.width_m) = (to.width_m, to.length_m);
            }
            let moved = moved_m(&car(10.0, 4.0), &to);
            assert!((moved - Vector2::new(2.0, 0.0)).norm() < 1e-9, "{turn}: {moved}");
        }
    }

    #[test]
    fn a_track_goes_back_to_the_first_gap() {
        let sample = |time_s: f64, x_m: f64| Sample {
            time_s,
            seen: vec![Seen {
                at: car(x_m, 4.0),
                is_sure: true,
                is_harmful: false,
                velocity_mps: None,
                meets: time_s > 0.5,
            }],
            due_s: time_s,
        };
        let (now, before) = (sample(0.9, 12.0), [sample(0.6, 11.0), sample(0.3, 10.0), sample(0.0, 30.0)]);
        let track = Track::of(&now, 0, before.iter(), &ReflexConfig::default());
        let velocity_mps = track.velocity_mps().unwrap();
        assert!((velocity_mps[0] - 2.0 / 0.6).abs() < 1e-9, "{velocity_mps:?}");
        assert_eq!(track.n_alarming_before(|_| true), 1);
        assert!(Track::of(&now, 0, before[2..].iter(), &ReflexConfig::default()).velocity_mps().is_none());
    }
}
