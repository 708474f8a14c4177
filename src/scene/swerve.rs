//! Ways round what stands in the lane: the offset from the lane's middle to drive at.

use super::driving::{self, Gap, Obstacle};
use super::occupancy::StripGrid;
use super::path::Path;

/// How far ahead to look for a way round.
const REACH_M: f64 = 26.0;
/// How far ahead oncoming vehicles are waited for.
const ONCOMING_REACH_M: f64 = 45.0;
/// The same for vehicles that stand there.
const STANDING_REACH_M: f64 = 16.0;
/// Part of the room on each side that a driver gives up on a narrow way, and the weight of such a way.
const SPARED_M: f64 = 0.2;
const NARROW_SHARE: f64 = 0.25;
/// A narrow way leads past a thing if it is free so much farther.
const PASSED_M: f64 = 3.0;
/// Offsets that are tried, in steps: to the kerb's side and away from it. What is placed on the road leaves one of these.
pub(super) const STEP_M: f64 = 0.3;
pub(super) const STEPS: [i32; 2] = [-4, 16];

/// A body on its path.
#[derive(Debug, Clone, Copy)]
pub struct Swerve<'a> {
    pub path: &'a Path,
    /// Station of its front.
    pub front_m: f64,
    /// Offset of its front to the left of the path.
    pub now_m: f64,
    pub half_width_m: f64,
    pub length_m: f64,
    pub speed_mps: f64,
    /// Whether it takes nearly any way round.
    pub is_bold: bool,
    /// 1 where traffic keeps right, -1 where it keeps left.
    pub mirror: f64,
    /// Whether a junction is right ahead, where leaving the lane is to be avoided.
    pub is_near_junction: bool,
}

impl Swerve<'_> {
    /// The obstacle ahead on the way over to `left_m`, and whether it is something still that can be passed at a walk, with little
    /// room to the sides.
    pub fn gap_or_narrow(&self, left_m: f64, reach_m: f64, others: &[Obstacle]) -> (Option<Gap>, bool) {
        let gap = self.gap_of(self.half_width_m, left_m, reach_m, others.iter());
        let is_narrow = gap.filter(|gap| gap.is_still).is_some_and(|gap| {
            let narrow = self.gap_of(self.half_width_m - SPARED_M, left_m, reach_m, others.iter());
            narrow.is_none_or(|narrow| narrow.distance_m > gap.distance_m + PASSED_M)
        });
        (gap, is_narrow)
    }

    /// The obstacle ahead if a body of this width moves over to `left_m` as fast as it comfortably can.
    fn gap_of<'b>(
        &self,
        half_width_m: f64,
        left_m: f64,
        reach_m: f64,
        others: impl Iterator<Item = &'b Obstacle>,
    ) -> Option<Gap> {
        // Far over, as to another lane, takes longer.
        let blend_m = (1.6 * self.speed_mps).clamp(4.5, 10.0).max(if (left_m - self.now_m).abs() > 2.0 {
            2.3 * self.speed_mps
        } else {
            0.0
        });
        let left_at = |s_m: f64| {
            let share = ((s_m - self.front_m) / blend_m).clamp(0.0, 1.0);
            self.now_m + (left_m - self.now_m) * share * share * (3.0 - 2.0 * share)
        };
        driving::gap_ahead(self.path, (self.front_m, reach_m), half_width_m, left_at, others)
    }

    /// The offset that costs least: a free way first, then near the lane's middle, then no change.
    pub fn best_offset(&self, before_m: f64, road: &StripGrid, others: &[Obstacle]) -> f64 {
        let free_m = |left_m: f64, half_width_m: f64| {
            let still = others.iter().filter(|other| other.is_still);
            self.gap_of(half_width_m, left_m, REACH_M, still).map_or(REACH_M, |gap| gap.distance_m)
        };
        if before_m.abs() < 0.01 && self.now_m.abs() < 0.5 && free_m(0.0, self.half_width_m) >= REACH_M {
            return 0.0;
        }
        // An obstacle that is being passed counts until the rear is past it.
        let is_beside = |left_m: f64| {
            let body = (self.front_m - self.length_m, self.length_m);
            driving::gap_ahead(self.path, body, self.half_width_m, |_| left_m, others.iter()).is_some()
        };
        let is_met = others.iter().any(|other| self.meets_oncoming(other));
        let cost = |left_m: f64| {
            // Where no way has room to both sides, a narrow one is driven at a walk.
            let wide_m = free_m(left_m, self.half_width_m);
            let narrow_m =
                if wide_m < REACH_M { free_m(left_m, self.half_width_m - SPARED_M) } else { REACH_M };
            let shortfall_m = REACH_M - (1.0 - NARROW_SHARE) * wide_m - NARROW_SHARE * narrow_m;
            // Both sides of the body must be on the road.
            let beyond_m = [-self.half_width_m, self.half_width_m]
                .map(|side_m| road.clearance_m(self.path.beside(self.front_m + 6.0, left_m + side_m)))
                .into_iter()
                .fold(f64::NEG_INFINITY, f64::max);
            let meets = if self.mirror * left_m > 0.9 && is_met {
                if self.is_bold { 6.0 } else { 60.0 }
            } else {
                0.0
            };
            let leaves = if beyond_m > 0.1 { if self.is_bold { 4.0 } else { 30.0 } } else { 0.0 };
            let turns = if self.is_near_junction && left_m.abs() > 0.9 { 4.0 } else { 0.0 };
            let scrapes = if is_beside(left_m) { 25.0 } else { 0.0 };
            shortfall_m
                + scrapes
                + meets
                + leaves
                + turns
                + 0.5 * left_m.abs()
                + 0.4 * (left_m - before_m).abs()
        };
        let [first, last] = STEPS;
        let candidates =
            (first..=last).map(|i| self.mirror * STEP_M * f64::from(i)).map(|left_m| (cost(left_m), left_m));
        candidates.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(before_m, |(_, left_m)| left_m)
    }

    /// Whether a vehicle comes, or stands, on the other half of the street ahead.
    fn meets_oncoming(&self, other: &Obstacle) -> bool {
        if !other.is_vehicle || other.is_still {
            return false;
        }
        let rear_m = self.front_m - 5.0;
        let (s_m, left_m) =
            self.path.project(other.footprint.center, rear_m, self.front_m + ONCOMING_REACH_M);
        let along_mps = other.velocity_mps.dot(&self.path.direction(s_m));
        // A vehicle that stands far off, perhaps at a junction, leaves enough time.
        let comes = along_mps < -0.3 || (along_mps < 0.5 && s_m < self.front_m + STANDING_REACH_M);
        comes && s_m > rear_m + 0.1 && (1.2..6.0).contains(&(self.mirror * left_m))
    }
}

#[cfg(test)]
mod tests {
    use super::super::driving::Owner;
    use super::super::occupancy::Footprint;
    use super::super::path::Vec2;
    use super::*;

    fn thing(x_m: f64, y_m: f64, velocity_mps: Option<Vec2>) -> Obstacle {
        Obstacle {
            owner: Owner::Placement(0),
            footprint: Footprint { center: Vec2::new(x_m, y_m), yaw_rad: 0.0, length_m: 1.0, width_m: 1.0 },
            velocity_mps: velocity_mps.unwrap_or_default(),
            is_still: velocity_mps.is_none(),
            is_vehicle: velocity_mps.is_some(),
            backs_up: false,
        }
    }

    fn best(others: &[Obstacle]) -> f64 {
        let path = path();
        // The lane and the one of the other direction on its left.
        let mut road = StripGrid::default();
        road.add(&path.points_every(0.5), 1.75);
        road.add(
            &path.points_every(0.5).iter().map(|point| point + Vec2::new(0.0, 3.5)).collect::<Vec<_>>(),
            1.75,
        );
        body(&path).best_offset(0.0, &road, others)
    }

    fn path() -> Path {
        Path::new([Vec2::zeros(), Vec2::new(100.0, 0.0)]).unwrap()
    }

    fn body(path: &Path) -> Swerve<'_> {
        Swerve {
            path,
            front_m: 10.0,
            now_m: 0.0,
            half_width_m: 0.9,
            length_m: 4.0,
            speed_mps: 6.0,
            is_bold: false,
            mirror: 1.0,
            is_near_junction: false,
        }
    }

    #[test]
    fn between_two_things_a_little_farther_apart_than_the_body_is_wide_one_drives_at_a_walk() {
        let path = path();
        // The room between them, from the middle of the way to each.
        let is_narrow = |half_m: f64| {
            let things = [thing(28.0, half_m + 0.5, None), thing(28.0, -half_m - 0.5, None)];
            body(&path).gap_or_narrow(0.0, 30.0, &things)
        };
        assert!(matches!(is_narrow(1.0), (Some(_), true)));
        assert!(matches!(is_narrow(0.8), (Some(_), false)), "too narrow");
        assert!(matches!(is_narrow(1.3), (None, false)), "wide enough");
    }

    #[test]
    fn an_object_on_the_right_is_passed_on_the_left_unless_someone_comes() {
        assert!(best(&[]).abs() < 1e-12);
        let left_m = best(&[thing(28.0, -0.5, None)]);
        // Half the object, half the car and the room, from the object's middle: 1.65 - 0.5 m.
        assert!(left_m > 1.1 && left_m < 2.0, "{left_m}");
        let oncoming = thing(40.0, 3.5, Some(Vec2::new(-8.0, 0.0)));
        assert!(best(&[thing(28.0, -0.5, None), oncoming]) < 0.9);
    }
}
