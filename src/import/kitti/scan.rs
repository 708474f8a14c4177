//! KITTI's clouds: x, y, z and reflectance as little-endian floats, stored beam by beam from the highest.

use std::path::Path;

use crate::import::error::read;
use crate::import::{ImportError, Notes, RawPoint};

const POINT_BYTES: usize = 16;
/// Beams of the HDL-64E; fewer are found where the lowest or highest ones saw nothing.
const N_BEAMS: std::ops::RangeInclusive<usize> = 40..=64;
/// Time of a turn: the Velodyne spins at 10 Hz.
const TURN_S: f64 = 0.1;

/// Whether points get stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stamps {
    /// Still frames.
    None,
    /// By the azimuth: the head spins clockwise, seen from above, from behind to behind, and the stamp of the scan is that of looking ahead.
    ByAzimuth,
}

/// Reads a cloud.
pub(super) fn read_scan(
    path: &Path,
    stamps: Stamps,
    notes: &mut Notes,
) -> Result<Vec<RawPoint>, ImportError> {
    let bytes = read(path)?;
    if bytes.len() % POINT_BYTES != 0 {
        let message =
            format!("the cloud has {} bytes, no multiple of {POINT_BYTES}; it is cut short", bytes.len());
        return Err(ImportError::at(path, message));
    }
    let mut points: Vec<RawPoint> = bytes
        .chunks_exact(POINT_BYTES)
        .map(|point| {
            let [x_m, y_m, z_m, intensity] =
                std::array::from_fn(|i| f32::from_le_bytes(std::array::from_fn(|byte| point[4 * i + byte])));
            let turned = -f64::from(y_m).atan2(f64::from(x_m)) / std::f64::consts::TAU;
            let time_offset_s = (stamps == Stamps::ByAzimuth).then_some((turned * TURN_S) as f32);
            RawPoint { x_m, y_m, z_m, intensity, ring: None, time_offset_s }
        })
        .collect();
    match rings_by_order(&points) {
        Some(rings) => points.iter_mut().zip(rings).for_each(|(point, ring)| point.ring = Some(ring)),
        None => notes.tell("clouds are not stored beam by beam, from the highest, as KITTI's are; rings come from the elevation"),
    }
    Ok(points)
}

/// A beam ends where the azimuth, which rises from 0 to 360 degrees, falls back. `None` where that gives no beams of falling elevation.
fn rings_by_order(points: &[RawPoint]) -> Option<Vec<u16>> {
    let azimuth_deg = |point: &RawPoint| point.y_m.atan2(point.x_m).to_degrees().rem_euclid(360.0);
    let mut beams = Vec::with_capacity(points.len());
    let (mut beam, mut last_deg) = (0u16, 0.0);
    for point in points {
        let here_deg = azimuth_deg(point);
        beam += u16::from(here_deg - last_deg < -180.0);
        last_deg = here_deg;
        beams.push(beam);
    }
    let n_beams = usize::from(beam) + 1;
    if !N_BEAMS.contains(&n_beams) {
        return None;
    }
    let mut sums = vec![(0.0f64, 0.0f64); n_beams];
    for (point, &beam) in points.iter().zip(&beams) {
        let sum = &mut sums[usize::from(beam)];
        sum.0 += f64::from(point.z_m.atan2(point.x_m.hypot(point.y_m)));
        sum.1 += 1.0;
    }
    let means: Vec<f64> = sums.iter().map(|(sum, n)| sum / n).collect();
    let falls = means.windows(2).filter(|pair| pair[1] < pair[0]).count();
    // Two neighbours of a torn cloud may be out of order.
    (falls * 10 >= (n_beams - 1) * 9).then(|| beams.iter().map(|of| beam - of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 64 beams from +2 to -24 degrees, each point 10 m away on the ground plane.
    fn scan() -> Vec<u8> {
        let mut bytes = Vec::new();
        for beam in 0..64 {
            let z = 10.0 * (2.0 - f64::from(beam) * 26.0 / 63.0).to_radians().tan();
            for step in 0..36 {
                let azimuth = f64::from(step * 10).to_radians();
                for value in [10.0 * azimuth.cos(), 10.0 * azimuth.sin(), z, 0.25] {
                    bytes.extend((value as f32).to_le_bytes());
                }
            }
        }
        bytes
    }

    #[test]
    fn rings_follow_from_the_order_and_stamps_from_the_azimuth() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.bin");
        fs_err::write(&path, scan()).unwrap();
        let points = read_scan(&path, Stamps::ByAzimuth, &mut Notes::default()).unwrap();
        assert_eq!((points[0].ring, points[64 * 36 - 1].ring), (Some(63), Some(0)));
        // A quarter turn to the left was seen a quarter turn before looking ahead.
        assert!((points[9].time_offset_s.unwrap() + 0.025).abs() < 1e-6);
    }

    #[test]
    fn a_cloud_that_is_cut_short_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000000.bin");
        fs_err::write(&path, &scan()[..1001]).unwrap();
        let told = read_scan(&path, Stamps::None, &mut Notes::default()).unwrap_err().to_string();
        assert!(told.contains("1001 bytes") && told.contains("000000.bin"), "{told}");
    }
}
