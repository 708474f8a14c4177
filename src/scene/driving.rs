//! Following and gaps: the intelligent driver model, and what is in the way along a path.
//!
//! IDM (Treiber, Hennecke and Helbing, 2000):
//! `a = a_max (1 - (v / v0)^4 - (s* / s)^2)`, `s* = s0 + v T + v dv / (2 sqrt(a_max b))`.

use super::occupancy::Footprint;
use super::path::{Path, Vec2};

/// Comfortable acceleration and braking, time gap: IDM's usual values for towns.
const MAX_ACCELERATION_MPS2: f64 = 1.8;
const COMFORT_BRAKING_MPS2: f64 = 2.5;
const TIME_GAP_S: f64 = 1.2;
/// Hardest braking on a dry road.
const MAX_BRAKING_MPS2: f64 = 8.0;
/// Sideways acceleration that people accept in bends.
const MAX_LATERAL_MPS2: f64 = 2.2;
/// Braking before bends.
const BEND_BRAKING_MPS2: f64 = 1.5;
/// Step of the search along a path.
const STEP_M: f64 = 0.6;
/// Room kept to both sides.
const SIDE_ROOM_M: f64 = 0.25;

/// Who or what takes ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Owner {
    Ego,
    /// Index of a placement.
    Placement(usize),
}

/// Ground that is taken now, or by someone on foot within the next moments.
#[derive(Debug, Clone, Copy)]
pub struct Obstacle {
    pub owner: Owner,
    pub footprint: Footprint,
    pub velocity_mps: Vec2,
    /// Whether it never moves.
    pub is_still: bool,
    pub is_vehicle: bool,
    /// Whether it backs up, or would if it had room.
    pub backs_up: bool,
}

/// The nearest thing in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    pub distance_m: f64,
    /// Its speed along the path, not below zero.
    pub lead_mps: f64,
    pub is_still: bool,
}

impl Gap {
    /// A line to stop at.
    pub fn line(distance_m: f64) -> Self {
        Self { distance_m, lead_mps: 0.0, is_still: false }
    }
}

/// The first obstacle that a body of `half_width_m` meets from `from_m` on, within `reach_m`.
///
/// `left_m` gives the body's offset to the left of the path at each station.
pub fn gap_ahead<'a>(
    path: &Path,
    (from_m, reach_m): (f64, f64),
    half_width_m: f64,
    left_m: impl Fn(f64) -> f64,
    obstacles: impl Iterator<Item = &'a Obstacle>,
) -> Option<Gap> {
    let middle = path.at(from_m + reach_m / 2.0);
    let room_m = half_width_m + SIDE_ROOM_M;
    // With the square of the distance beyond which the body is clear of each, whichever way it lies.
    let near: Vec<(&Obstacle, f64)> = obstacles
        .map(|other| (other, other.footprint.radius_m()))
        .filter(|(other, radius_m)| (other.footprint.center - middle).norm() < reach_m / 2.0 + radius_m + 6.0)
        .map(|(other, radius_m)| (other, (room_m + radius_m).powi(2)))
        .collect();
    if near.is_empty() {
        return None;
    }
    let n = (reach_m / STEP_M).ceil() as usize;
    (0..=n).find_map(|i| {
        let s_m = from_m + STEP_M * i as f64;
        let point = path.beside(s_m, left_m(s_m));
        let is_hit = |(other, clear_m2): &&(&Obstacle, f64)| {
            (other.footprint.center - point).norm_squared() <= *clear_m2
                && other.footprint.distance_m(point) <= room_m
        };
        let (hit, _) = near.iter().find(is_hit)?;
        let lead_mps = hit.velocity_mps.dot(&path.direction(s_m)).max(0.0);
        Some(Gap { distance_m: s_m - from_m, lead_mps, is_still: hit.is_still })
    })
}

/// IDM acceleration, bounded by what brakes can do.
pub fn acceleration_mps2(speed_mps: f64, desired_mps: f64, gap: Option<Gap>, standstill_m: f64) -> f64 {
    let free = 1.0 - (speed_mps / desired_mps.max(0.1)).powi(4);
    let closeness = gap.map_or(0.0, |gap| {
        let closing_mps = speed_mps - gap.lead_mps;
        let dynamic_m = speed_mps * TIME_GAP_S
            + speed_mps * closing_mps / (2.0 * (MAX_ACCELERATION_MPS2 * COMFORT_BRAKING_MPS2).sqrt());
        ((standstill_m + dynamic_m.max(0.0)) / gap.distance_m.max(0.1)).powi(2)
    });
    (MAX_ACCELERATION_MPS2 * (free - closeness)).clamp(-MAX_BRAKING_MPS2, MAX_ACCELERATION_MPS2)
}

/// The speed that bends ahead allow, braking comfortably.
pub fn bend_speed_mps(path: &Path, s_m: f64, limit_mps: f64) -> f64 {
    // Looks as far as the braking distance.
    let n = (limit_mps * limit_mps / (2.0 * BEND_BRAKING_MPS2) / 3.0).ceil().clamp(8.0, 60.0) as usize;
    (0..=n).fold(limit_mps, |speed, i| {
        let ahead_m = 3.0 * i as f64;
        let curvature = path.curvature_per_m(s_m + ahead_m).abs().max(1e-4);
        let in_bend = (MAX_LATERAL_MPS2 / curvature).sqrt();
        speed.min((in_bend * in_bend + 2.0 * BEND_BRAKING_MPS2 * ahead_m).sqrt())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall(x_m: f64, y_m: f64) -> Obstacle {
        Obstacle {
            owner: Owner::Ego,
            footprint: Footprint { center: Vec2::new(x_m, y_m), yaw_rad: 0.0, length_m: 2.0, width_m: 2.0 },
            velocity_mps: Vec2::zeros(),
            is_still: true,
            is_vehicle: false,
            backs_up: false,
        }
    }

    #[test]
    fn a_wall_ahead_is_found_and_one_beside_is_not() {
        let path = Path::new([Vec2::zeros(), Vec2::new(100.0, 0.0)]).unwrap();
        let gap = |wall: &Obstacle| gap_ahead(&path, (0.0, 40.0), 0.9, |_| 0.0, [*wall].iter());
        let found = gap(&wall(20.0, 0.0)).unwrap().distance_m;
        // 20 m less half its length, less the body's half width and room.
        assert!((found - 17.85).abs() < STEP_M, "{found}");
        assert_eq!(gap(&wall(20.0, 2.5)), None);
        assert!(gap_ahead(&path, (0.0, 40.0), 0.9, |_| 2.0, [wall(20.0, 2.5)].iter()).is_some());
    }

    #[test]
    fn a_box_that_lies_askew_takes_no_more_room_than_its_corner_does() {
        let path = Path::new([Vec2::zeros(), Vec2::new(100.0, 0.0)]).unwrap();
        // Half the diagonal is 1.41 m, half the body and its room are 1.15 m.
        let gap = |y_m: f64| {
            let footprint = Footprint { yaw_rad: std::f64::consts::FRAC_PI_4, ..wall(20.0, y_m).footprint };
            gap_ahead(&path, (0.0, 40.0), 0.9, |_| 0.0, [Obstacle { footprint, ..wall(20.0, y_m) }].iter())
        };
        assert!(gap(2.45).is_some() && gap(2.65).is_none());
    }

    #[test]
    fn idm_is_at_rest_at_the_desired_speed_and_brakes_hard_for_a_near_wall() {
        assert!(acceleration_mps2(10.0, 10.0, None, 2.0).abs() < 1e-12);
        assert!((acceleration_mps2(10.0, 10.0, Some(Gap::line(4.0)), 2.0) + MAX_BRAKING_MPS2).abs() < 1e-12);
    }
}
