//! Points drawn from the clouds of a data set, evenly from its samples: what clouds are compared by as a whole.

use rand::seq::index;

use crate::geometry::Point;
use crate::random;
use crate::sample::Measured;

/// Points of a set that are compared.
pub const N_POINTS: usize = 6000;
/// Points of one sample at most: more would tell of this sample and not of the set.
const MAX_POINTS_A_SAMPLE: usize = 750;
/// The draws are the same in every run.
const SEED: u64 = 0;

/// A point: range from the ego's origin in the plane, m; height over the ego's ground plane, m; intensity, 0 to 255.
pub(super) type CloudPoint = [f64; 3];

/// What the numbers of a [`CloudPoint`] are.
pub const PROPERTIES: [&str; 3] = ["range", "height", "intensity"];

/// How many points sample `idx` of `n_samples` gives.
pub(super) fn n_points_of(idx: usize, n_samples: usize) -> usize {
    ((idx + 1) * N_POINTS / n_samples - idx * N_POINTS / n_samples).min(MAX_POINTS_A_SAMPLE)
}

/// Draws `n` points of a sample, or takes all where there are no more; `idx` is the sample's place in its set.
pub(super) fn draw_points(measured: &Measured, n: usize, idx: usize) -> Vec<CloudPoint> {
    let points = &measured.points;
    let mut rng = random::stream(SEED, "compare-cloud", idx as u64);
    let of = |at: usize| {
        let point = &points[at];
        let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(f64::from);
        let in_ego = measured.ego_from_lidar * Point::new(x, y, z);
        [in_ego.x().hypot(in_ego.y()), in_ego.z(), f64::from(point.intensity)]
    };
    index::sample(&mut rng, points.len(), n.min(points.len())).into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_gives_its_share_of_the_points() {
        for n_samples in [1, 7, 8, 600, 50_000] {
            let n: usize = (0..n_samples).map(|idx| n_points_of(idx, n_samples)).sum();
            assert_eq!(n, N_POINTS.min(n_samples * MAX_POINTS_A_SAMPLE), "{n_samples}");
        }
    }
}
