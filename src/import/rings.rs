//! Rings for clouds that have none: the beam whose elevation is nearest.

use super::RawPoint;
use super::config::RingConfig;

/// Shares of the points that lie below the lowest and the highest beam's elevation: outliers do not count as beams.
const LOW_SHARE: f64 = 0.002;

/// The rings of points by their elevation; 0 is the lowest. Points of the log that have a ring keep it.
pub(super) fn rings_of(points: &[RawPoint], config: &RingConfig) -> Vec<u16> {
    let elevations: Vec<f64> = points.iter().map(elevation_deg).collect();
    if config.elevations_deg.is_empty() {
        let mut sorted = elevations.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let (low_deg, high_deg) = (at(LOW_SHARE), at(1.0 - LOW_SHARE));
        let step_deg = (high_deg - low_deg).max(1e-6) / f64::from(config.n_rings.max(2) - 1);
        let last = f64::from(config.n_rings - 1);
        let ring =
            |elevation_deg: &f64| ((elevation_deg - low_deg) / step_deg).round().clamp(0.0, last) as u16;
        return elevations.iter().map(ring).collect();
    }
    let beams = &config.elevations_deg;
    let nearest = |elevation_deg: &f64| {
        let above =
            beams.partition_point(|beam_deg| beam_deg < elevation_deg).clamp(1, beams.len().max(2) - 1);
        let (below, above) = (above - 1, above.min(beams.len() - 1));
        let is_below = elevation_deg - beams[below] <= beams[above] - elevation_deg;
        (if is_below { below } else { above }) as u16
    };
    elevations.iter().map(nearest).collect()
}

fn elevation_deg(point: &RawPoint) -> f64 {
    let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(f64::from);
    z.atan2(x.hypot(y)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elevation_deg: f64, azimuth_deg: f64) -> RawPoint {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        let z_m = (10.0 * elevation_deg.to_radians().tan()) as f32;
        RawPoint {
            x_m: (10.0 * cos) as f32,
            y_m: (10.0 * sin) as f32,
            z_m,
            intensity: 0.0,
            ring: None,
            time_offset_s: None,
        }
    }

    #[test]
    fn a_beam_of_the_table_takes_what_is_nearest() {
        let config = RingConfig { n_rings: 3, elevations_deg: vec![-20.0, -10.0, 2.0] };
        let points = [at(-30.0, 0.0), at(-14.0, 10.0), at(-4.1, 20.0), at(-3.9, 30.0), at(9.0, 40.0)];
        assert_eq!(rings_of(&points, &config), [0, 1, 1, 2, 2]);
    }

    #[test]
    fn even_beams_are_told_apart_by_their_height() {
        let config = RingConfig { n_rings: 4, elevations_deg: Vec::new() };
        let points: Vec<RawPoint> =
            (0..400).map(|i| at(f64::from(i % 4) * 5.0 - 15.0, f64::from(i))).collect();
        let wanted: Vec<u16> = (0..400).map(|i| i % 4).collect();
        assert_eq!(rings_of(&points, &config), wanted);
    }
}
