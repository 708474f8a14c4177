//! A sweep of Argoverse 2's two stacked VLP-32C, which the log holds as one cloud in the egovehicle frame, freed from motion.

use std::path::Path;
use std::sync::LazyLock;

use super::feather::Table;
use crate::import::{ImportError, RawPoint};

/// Elevations of the upper LiDAR's lasers by `laser_number`, degrees: VLP-32C's table in the order of the logs (from a sweep, in which each
/// laser's points lie within 0.01 degrees). The lower one hangs upside down: lasers 32 to 63 have them negated.
const ELEVATIONS_DEG: [f64; 32] = [
    7.0, -1.667, 1.667, -0.667, 15.0, -0.333, 3.333, 0.667, 1.333, 0.0, 1.0, 2.333, 0.333, -1.0, 4.667,
    10.333, -6.148, -15.639, -3.0, -2.0, -4.0, -8.843, -4.667, -3.333, -2.667, -5.333, -1.333, -7.254,
    -3.667, -11.31, -2.333, -25.0,
];

/// By laser: its place among all 64 by elevation, 0 the lowest; of two alike the upper LiDAR's first.
static RINGS: LazyLock<[u16; 64]> = LazyLock::new(|| {
    let elevation_deg = |laser: usize| match ELEVATIONS_DEG.get(laser) {
        Some(elevation_deg) => *elevation_deg,
        None => -ELEVATIONS_DEG[laser - 32],
    };
    let mut lasers: Vec<usize> = (0..64).collect();
    lasers.sort_by(|a, b| elevation_deg(*a).total_cmp(&elevation_deg(*b)));
    let mut rings = [0; 64];
    lasers.iter().zip(0..).for_each(|(&laser, ring)| rings[laser] = ring);
    rings
});

/// Reads a sweep; the points are put into the frame of the LiDAR, which sits at `mount_m` with the ego's axes.
pub(super) fn read_sweep(path: &Path, mount_m: [f64; 3]) -> Result<Vec<RawPoint>, ImportError> {
    let table = Table::read(path)?;
    let [x, y, z] = [table.raw_floats("x")?, table.raw_floats("y")?, table.raw_floats("z")?];
    let intensity = table.raw_floats("intensity")?;
    let [mount_x, mount_y, mount_z] = mount_m;
    let shift = |value: f32, by_m: f64| (f64::from(value) - by_m) as f32;
    let point = |(i, &laser): (usize, &i64)| {
        let ring = usize::try_from(laser).ok().and_then(|laser| RINGS.get(laser));
        let told = || ImportError::at(path, format!("point {i} is of laser {laser}; 0 to 63 are valid"));
        Ok(RawPoint {
            x_m: shift(x[i], mount_x),
            y_m: shift(y[i], mount_y),
            z_m: shift(z[i], mount_z),
            intensity: intensity[i],
            ring: Some(*ring.ok_or_else(told)?),
            // Freed from motion already.
            time_offset_s: None,
        })
    };
    table.integers("laser_number")?.iter().enumerate().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_laser_has_its_own_ring_and_higher_beams_have_higher_ones() {
        let mut sorted = RINGS.to_vec();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..64));
        // The lower LiDAR's highest beam at 25 degrees, the upper one's lowest at -25.
        assert_eq!((RINGS[63], RINGS[31]), (63, 0));
        assert!(RINGS[9] > RINGS[5] && RINGS[4] > RINGS[15]);
    }
}
