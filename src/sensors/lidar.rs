//! The spinning LiDAR: which rays it fires, and what comes back of their hits.
//!
//! intensity = 255 * reflectivity * cos(incidence) * exp(-2 * attenuation * range), whole numbers:
//! Lambert's law and the air's loss on the way there and back.

use nalgebra::Vector3;
use rand::RngExt;

use crate::geometry::{Camera, Lidar, Pinhole, Point, Transform};
use crate::random::Rng;
use crate::sample::LidarPoint;

/// The rays of one turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Unit vectors in the LiDAR frame, by azimuth from right to left, then by ring.
    pub directions: Vec<Vector3<f64>>,
    /// The beam of each ray, 0 the lowest.
    pub rings: Vec<u16>,
}

impl Pattern {
    /// A whole turn of `(beams, lowest, highest elevation in degrees)`, evenly spaced.
    #[must_use]
    pub fn spinning((n_beams, low_deg, high_deg): (u16, f64, f64), azimuth_step_deg: f64) -> Self {
        let half_turn = (180.0 / azimuth_step_deg).floor();
        let beam_step_deg = (high_deg - low_deg) / f64::from(n_beams.max(2) - 1);
        let (mut directions, mut rings) = (Vec::new(), Vec::new());
        let mut firing = -half_turn;
        while firing <= half_turn {
            let azimuth_rad = (firing * azimuth_step_deg).to_radians();
            for ring in 0..n_beams {
                let elevation_rad = (low_deg + beam_step_deg * f64::from(ring)).to_radians();
                directions.push(Vector3::new(
                    elevation_rad.cos() * azimuth_rad.cos(),
                    elevation_rad.cos() * azimuth_rad.sin(),
                    elevation_rad.sin(),
                ));
                rings.push(ring);
            }
            firing += 1.0;
        }
        Self { directions, rings }
    }

    /// Only the rays that can hit something in the camera's horizontal field of view within the range.
    #[must_use]
    pub fn cut_to(
        &self,
        intrinsics: &Pinhole,
        camera_from_lidar: &Transform<Camera, Lidar>,
        max_range_m: f64,
    ) -> Self {
        // The lateral position in the image is monotonic along a ray, so its ends and middle tell.
        let ranges_m = [1.0, max_range_m / 8.0, max_range_m];
        let keeps = |direction: &Vector3<f64>| {
            ranges_m.iter().any(|range_m| is_in_view(&(direction * *range_m), intrinsics, camera_from_lidar))
        };
        let (directions, rings) = self
            .directions
            .iter()
            .zip(&self.rings)
            .filter(|(direction, _)| keeps(direction))
            .map(|(direction, ring)| (*direction, *ring))
            .unzip();
        Self { directions, rings }
    }
}

/// Whether a point of the LiDAR frame lies between the image's left and right edges (at any height).
#[must_use]
pub fn is_in_view(
    point_in_lidar: &Vector3<f64>,
    intrinsics: &Pinhole,
    camera_from_lidar: &Transform<Camera, Lidar>,
) -> bool {
    let point: Point<Camera> = *camera_from_lidar * Point::<Lidar>::from_coords((*point_in_lidar).into());
    intrinsics.project(&point).is_some_and(|(u_px, _)| (0.0..f64::from(intrinsics.width_px)).contains(&u_px))
}

/// What disturbs the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    pub max_range_m: f64,
    /// Standard deviation.
    pub range_noise_m: f64,
    /// Share of returns lost at random.
    pub dropout: f64,
    /// Attenuation of the air, one way.
    pub attenuation_per_m: f64,
}

/// A ray's true hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Infinite where nothing is hit.
    pub range_m: f64,
    /// Cosine of the angle between ray and surface normal, 0 to 1.
    pub cos_incidence: f64,
    /// Of the surface, 0 to 1.
    pub reflectivity: f64,
}

/// The measured points with the index of each one's ray; hits beyond the range and lost ones are left out.
///
/// Every ray draws the same amount from the stream, so one object more disturbs no other's noise.
///
/// # Panics
/// If hits and rays differ in number.
#[must_use]
pub fn returns(pattern: &Pattern, hits: &[Hit], noise: &Noise, rng: &mut Rng) -> Vec<(usize, LidarPoint)> {
    assert_eq!(hits.len(), pattern.directions.len(), "one hit for each ray");
    let mut points = Vec::new();
    for (ray, hit) in hits.iter().enumerate() {
        let range_error_m = noise.range_noise_m * standard_normal(rng);
        let is_lost = rng.random::<f64>() < noise.dropout;
        let range_m = hit.range_m + range_error_m;
        if is_lost || !range_m.is_finite() || range_m <= 0.0 || range_m > noise.max_range_m {
            continue;
        }
        let air = (-2.0 * noise.attenuation_per_m * hit.range_m).exp();
        let intensity = (255.0 * hit.reflectivity * hit.cos_incidence * air).clamp(0.0, 255.0).round();
        let at = pattern.directions[ray] * range_m;
        let point = LidarPoint {
            x_m: at.x as f32,
            y_m: at.y as f32,
            z_m: at.z as f32,
            intensity: intensity as f32,
            ring: pattern.rings[ray],
        };
        points.push((ray, point));
    }
    points
}

/// Box-Muller; `1 - u` keeps the logarithm's argument above zero.
fn standard_normal(rng: &mut Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    const QUIET: Noise =
        Noise { max_range_m: 70.0, range_noise_m: 0.0, dropout: 0.0, attenuation_per_m: 0.0 };

    #[test]
    fn the_hdl32e_spans_its_elevations() {
        let pattern = Pattern::spinning((32, -92.0 / 3.0, 32.0 / 3.0), 0.33);
        let ahead = pattern.directions.iter().filter(|d| d.y == 0.0 && d.x > 0.0);
        let degrees: Vec<f64> = ahead.map(|d| d.z.asin().to_degrees()).collect();
        assert_eq!(degrees.len(), 32);
        assert!((degrees[0] + 30.667).abs() < 1e-3 && (degrees[31] - 10.667).abs() < 1e-3);
        assert!((degrees[1] - degrees[0] - 4.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn half_the_reflectivity_at_sixty_degrees_gives_a_quarter_of_the_intensity() {
        let pattern = Pattern { directions: vec![Vector3::x()], rings: vec![7] };
        let hit = Hit { range_m: 10.0, cos_incidence: 0.5, reflectivity: 0.5 };
        let points = returns(&pattern, &[hit], &QUIET, &mut random::stream(1, "t", 0));
        assert_eq!((points[0].1.x_m, points[0].1.intensity, points[0].1.ring), (10.0, 64.0, 7));
    }

    #[test]
    fn what_is_out_of_range_does_not_return() {
        let pattern = Pattern { directions: vec![Vector3::x(); 2], rings: vec![0; 2] };
        let hits =
            [70.1, f64::INFINITY].map(|range_m| Hit { range_m, cos_incidence: 1.0, reflectivity: 1.0 });
        assert!(returns(&pattern, &hits, &QUIET, &mut random::stream(1, "t", 0)).is_empty());
    }

    #[test]
    fn noise_has_the_stated_spread_and_dropout_the_stated_share() {
        let n = 20_000;
        let pattern = Pattern { directions: vec![Vector3::x(); n], rings: vec![0; n] };
        let hits = vec![Hit { range_m: 20.0, cos_incidence: 1.0, reflectivity: 1.0 }; n];
        let noise = Noise { range_noise_m: 0.02, dropout: 0.1, ..QUIET };
        let points = returns(&pattern, &hits, &noise, &mut random::stream(1, "t", 0));
        let share = points.len() as f64 / n as f64;
        assert!((share - 0.9).abs() < 0.01, "{share}");
        let square: f64 = points.iter().map(|(_, p)| (f64::from(p.x_m) - 20.0).powi(2)).sum();
        let spread_m = (square / points.len() as f64).sqrt();
        assert!((spread_m - 0.02).abs() < 0.001, "{spread_m}");
    }
}
