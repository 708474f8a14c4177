//! The ground's height under the rear axle, fitted to the clouds of a drive.
//!
//! Of each square metre near the car the low points count. Their most frequent height begins, and a plane through those that lie near it
//! (least squares, with a narrowing band) gives the height at the origin. Metres, in the ego frame of the importer.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

/// The road near the car: x ahead, y to each side.
const NEAR_X_M: [f64; 2] = [-15.0, 25.0];
const NEAR_Y_M: f64 = 8.0;
/// The car's own body, which its LiDAR may see.
const BODY_X_M: [f64; 2] = [-2.0, 5.0];
const BODY_Y_M: f64 = 1.3;
/// How far from the guess the ground may be.
const REACH_M: f64 = 2.5;
/// Bins of the most frequent height.
const BIN_M: f64 = 0.2;
/// A cell counts with so many points, and lies at this share of them from below.
const MIN_POINTS: usize = 4;
const LOW_SHARE: f64 = 0.2;
/// A plane needs so many cells.
const MIN_CELLS: usize = 20;
/// Half widths of the band in which cells count, one a round.
const BANDS_M: [f64; 6] = [0.4, 0.3, 0.2, 0.15, 0.1, 0.1];

/// A plane through the road near the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroundFit {
    /// Height at the origin.
    pub(super) z_m: f64,
    /// Greatest slope against the ego's xy plane.
    pub(super) tilt_rad: f64,
    pub(super) n_cells: usize,
}

/// Fits the ground to points in the ego frame; `None` where too little road is seen.
pub(super) fn fit_ground(
    points_in_ego: impl Iterator<Item = Vector3<f64>>,
    guess_m: f64,
) -> Option<GroundFit> {
    let mut cells: BTreeMap<(i32, i32), Vec<f64>> = BTreeMap::new();
    for point in points_in_ego {
        let is_near = (NEAR_X_M[0]..NEAR_X_M[1]).contains(&point.x) && point.y.abs() < NEAR_Y_M;
        let is_body = (BODY_X_M[0]..BODY_X_M[1]).contains(&point.x) && point.y.abs() < BODY_Y_M;
        if is_near && !is_body && (point.z - guess_m).abs() < REACH_M {
            cells.entry((point.x.floor() as i32, point.y.floor() as i32)).or_default().push(point.z);
        }
    }
    let mut lows: Vec<Vector3<f64>> = Vec::new();
    for ((x, y), mut heights) in cells {
        if heights.len() >= MIN_POINTS {
            heights.sort_unstable_by(f64::total_cmp);
            let z = heights[((heights.len() - 1) as f64 * LOW_SHARE) as usize];
            lows.push(Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, z));
        }
    }
    let mut bins: BTreeMap<i64, usize> = BTreeMap::new();
    lows.iter().for_each(|low| *bins.entry((low.z / BIN_M).floor() as i64).or_default() += 1);
    // Of two bins alike the lower.
    let (&bin, _) = bins.iter().rev().max_by_key(|(_, n)| **n)?;
    let mut plane = Vector3::new(0.0, 0.0, (bin as f64 + 0.5) * BIN_M);
    let mut n_cells = 0;
    for band_m in BANDS_M {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        n_cells = 0;
        for low in &lows {
            let row = Vector3::new(low.x, low.y, 1.0);
            if (low.z - row.dot(&plane)).abs() <= band_m {
                normal += row * row.transpose();
                right += row * low.z;
                n_cells += 1;
            }
        }
        if n_cells < MIN_CELLS {
            return None;
        }
        plane = normal.try_inverse()? * right;
    }
    Some(GroundFit { z_m: plane.z, tilt_rad: plane.x.hypot(plane.y).atan(), n_cells })
}

/// The middle one of some heights; `None` of none.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A road that rises by 2 cm a metre ahead, with kerbs, and a wall on one side.
    fn road(height_m: f64) -> Vec<Vector3<f64>> {
        let mut points = Vec::new();
        for i in -60..100 {
            for j in -31..31 {
                let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
                let kerb_m = if y > 5.0 { 0.15 } else { 0.0 };
                points.push(Vector3::new(x, y, height_m + 0.02 * x + kerb_m));
                if j == 30 {
                    points.extend((1..20).map(|k| Vector3::new(x, y, height_m + f64::from(k) * 0.1)));
                }
            }
        }
        points
    }

    #[test]
    fn a_road_with_kerbs_is_found_at_its_height_under_the_axle() {
        let fit = fit_ground(road(-0.33).into_iter(), -0.5).unwrap();
        assert!((fit.z_m + 0.33).abs() < 0.01, "{fit:?}");
        assert!((fit.tilt_rad - 0.02).abs() < 0.005, "{fit:?}");
    }

    #[test]
    fn a_far_guess_still_finds_it_and_an_empty_cloud_finds_nothing() {
        assert!((fit_ground(road(-1.8).into_iter(), 0.0).unwrap().z_m + 1.8).abs() < 0.01);
        assert_eq!(fit_ground(std::iter::empty(), 0.0), None);
    }
}
