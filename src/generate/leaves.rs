//! How far beams can go among the leaves that they meet.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::scene::models::Bounds;
use crate::scene::{Town, World};
use crate::sensors::lidar::TUFT_M;

/// Where the leaves of a world end.
pub(super) struct Leaves {
    town: Arc<Town>,
    /// Of each object, in the frame of its body.
    bounds: Vec<Bounds>,
}

impl Leaves {
    pub(super) fn new(world: &World) -> Self {
        let bounds = world.objects().iter().map(|object| object.bounds).collect();
        Self { town: Arc::clone(&world.town), bounds }
    }

    /// How far there are leaves behind a place in the world where a beam comes along `way`, a unit vector: to the end of the
    /// box of the object that it meets, given with its pose, or else to the ground; a tuft's depth at most.
    pub(super) fn behind_m(
        &self,
        at: &Point3<f64>,
        way: &Vector3<f64>,
        object: Option<(usize, &Isometry3<f64>)>,
    ) -> f64 {
        if let Some((object, pose)) = object {
            let (at, way) = (pose.inverse_transform_point(at), pose.inverse_transform_vector(way));
            let [low, high] = &self.bounds[object];
            let to_side_m = |axis: usize| {
                let side = if way[axis] > 0.0 { high } else { low };
                if way[axis] == 0.0 { f64::INFINITY } else { (side[axis] - at[axis]) / way[axis] }
            };
            return (0..3).map(to_side_m).fold(TUFT_M, f64::min).max(0.0);
        }
        let [here_m, there_m] =
            [*at, at + way * TUFT_M].map(|at| at.z - self.town.surface.ground_m(at.coords.xy()));
        match (here_m > 0.0, there_m >= 0.0) {
            (false, _) => 0.0,
            (true, true) => TUFT_M,
            (true, false) => TUFT_M * here_m / (here_m - there_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves() -> Leaves {
        let bounds = vec![[Point3::new(-0.4, -0.2, 0.0), Point3::new(0.4, 0.2, 0.3)]];
        Leaves { town: Arc::new(Town::load("downtown").unwrap()), bounds }
    }

    #[test]
    fn no_beam_leaves_the_box_of_what_it_meets() {
        let pose = Isometry3::new(Vector3::new(5.0, 1.0, 2.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
        // Turned by a quarter, 0.4 m deep along the world's x.
        let behind_m = |at: [f64; 3], way: [f64; 3]| {
            leaves().behind_m(&at.into(), &Vector3::from(way), Some((0, &pose)))
        };
        assert!((behind_m([4.8, 1.0, 2.1], [1.0, 0.0, 0.0]) - 0.4).abs() < 1e-9);
        assert!((behind_m([5.0, 1.4, 2.1], [0.0, -1.0, 0.0]) - TUFT_M).abs() < 1e-9);
        // 0.1 m over the ground, downwards by 0.6: 0.1 / 0.6.
        assert!((behind_m([4.8, 1.0, 2.1], [0.8, 0.0, -0.6]) - 0.1 / 0.6).abs() < 1e-9);
        assert_eq!(behind_m([5.2 + 1e-9, 1.0, 2.1], [1.0, 0.0, 0.0]), 0.0);
    }

    #[test]
    fn no_beam_ends_under_the_ground() {
        let leaves = leaves();
        let lane = &leaves.town.graph.lanes[0].path;
        let foot = lane.at(lane.length_m() / 2.0);
        let at = |up_m: f64| Point3::new(foot.x, foot.y, leaves.town.surface.ground_m(foot) + up_m);
        let down = Vector3::new(0.0, 0.6, -0.8);
        assert!((leaves.behind_m(&at(0.2), &down, None) - 0.25).abs() < 0.01);
        assert_eq!(leaves.behind_m(&at(2.0), &down, None), TUFT_M);
        assert_eq!(leaves.behind_m(&at(-0.01), &down, None), 0.0);
    }
}
