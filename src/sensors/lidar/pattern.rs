//! Which rays a spinning LiDAR fires, and which of them can land in the camera's view.

use nalgebra::Vector3;

use crate::geometry::{Camera, Lidar, Pinhole, Point, Transform};

/// The rays of one turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Unit vectors in the LiDAR frame, by azimuth from right to left, then by ring.
    pub directions: Vec<Vector3<f64>>,
    /// The beam of each ray, 0 the lowest.
    pub rings: Vec<u16>,
}

impl Pattern {
    /// A whole turn of beams at these elevations, the lowest first.
    pub fn spinning(elevations_deg: &[f64], azimuth_step_deg: f64) -> Self {
        let half_turn = (180.0 / azimuth_step_deg).floor();
        let (mut directions, mut rings) = (Vec::new(), Vec::new());
        let mut firing = -half_turn;
        while firing <= half_turn {
            let azimuth_rad = (firing * azimuth_step_deg).to_radians();
            for (ring, elevation_deg) in (0..).zip(elevations_deg) {
                let elevation_rad = elevation_deg.to_radians();
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

    /// The rays of all beams but these.
    #[must_use]
    pub fn without(mut self, lost_beams: &[u16]) -> Self {
        if !lost_beams.is_empty() {
            let is_left = |ring: &u16| !lost_beams.contains(ring);
            let mut left = self.rings.iter().map(is_left);
            self.directions.retain(|_| left.next().unwrap_or(true));
            self.rings.retain(is_left);
        }
        self
    }

    /// Only the rays that can hit something in the camera's horizontal field of view within the range.
    #[must_use]
    pub fn cut_to(
        &self,
        intrinsics: &Pinhole,
        camera_from_lidar: &Transform<Camera, Lidar>,
        max_range_m: f64,
    ) -> Self {
        // The lateral position in the image is monotonic along a ray, so its ends and middle suffice.
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
pub fn is_in_view(
    point_in_lidar: &Vector3<f64>,
    intrinsics: &Pinhole,
    camera_from_lidar: &Transform<Camera, Lidar>,
) -> bool {
    let point: Point<Camera> = *camera_from_lidar * Point::<Lidar>::from_coords((*point_in_lidar).into());
    intrinsics.project(&point).is_some_and(|(u_px, _)| (0.0..f64::from(intrinsics.width_px)).contains(&u_px))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_beam_fires_nothing_and_the_others_keep_their_rings() {
        let whole = Pattern::spinning(&[-30.0, 0.0, 10.0], 90.0);
        let left = whole.clone().without(&[1]);
        assert_eq!((left.rings[..4].to_vec(), left.directions.len()), (vec![0, 2, 0, 2], 10));
        assert_eq!(left.directions[1], whole.directions[2]);
    }

    #[test]
    fn rays_run_by_azimuth_then_by_ring() {
        let pattern = Pattern::spinning(&[-30.0, 0.0, 10.0], 90.0);
        assert_eq!(pattern.rings[..4], [0, 1, 2, 0]);
        let ahead: Vec<_> = pattern.directions.iter().filter(|d| d.y.abs() < 1e-12 && d.x > 0.0).collect();
        let degrees: Vec<f64> = ahead.iter().map(|d| d.z.asin().to_degrees()).collect();
        assert!(degrees.iter().zip([-30.0, 0.0, 10.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{degrees:?}");
    }
}
