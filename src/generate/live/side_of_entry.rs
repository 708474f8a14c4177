//! Which side of the ego's body is hit.

use nalgebra::Vector3;

use crate::generate::CONTROL_PERIOD_S;
use crate::scene::car;

/// Deeper in the ego's body than what comes so fast can have got since the last step, metres: it was there before, underneath.
const UNDERNEATH_M: f64 = 0.1;

/// Out of which of the four sides of the ego's body that comes in which touches it at a point, moving so against it; both in the ego frame.
/// `None` where it came in through none: it does not move, or was underneath before.
pub(super) fn side_of_entry(point_m: &Vector3<f64>, comes_mps: &Vector3<f64>) -> Option<Vector3<f64>> {
    let front_m = car::FRONT_BUMPER_X_M;
    let half_width_m = car::EGO_WIDTH_M / 2.0;
    let ends_m = [[front_m - car::EGO_LENGTH_M, front_m], [-half_width_m, half_width_m]];
    // Going back in time, the side that it leaves the body by first is the one that it came in by; within a step of the physics nobody
    // can tell, and the one that it comes faster against is.
    let sides = [0, 1].into_iter().filter(|&axis| comes_mps[axis] != 0.0).map(|axis| {
        let outward = -comes_mps[axis].signum();
        let end_m = ends_m[axis][usize::from(outward > 0.0)];
        let since_s = (end_m - point_m[axis]) * outward / comes_mps[axis].abs();
        let mut normal = Vector3::zeros();
        normal[axis] = outward;
        (since_s.max(car::TIMESTEP_S), comes_mps[axis].abs(), normal)
    });
    let (since_s, _, normal) = sides.min_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)))?;
    let is_new = since_s <= CONTROL_PERIOD_S || since_s * comes_mps.xy().norm() <= UNDERNEATH_M;
    is_new.then_some(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_in_from_ahead_is_hit_by_the_front_however_low_or_close_to_the_corner_it_is() {
        let side = |point_m: [f64; 2], comes_mps: [f64; 2]| {
            let [x_mps, y_mps] = comes_mps;
            let point_m = Vector3::new(point_m[0], point_m[1], 0.2);
            side_of_entry(&point_m, &Vector3::new(x_mps, y_mps, 0.0)).map(|of| [of.x, of.y])
        };
        // The front is at 3.35 m, the sides 0.865 m to the left and to the right.
        assert_eq!(side([3.33, 0.4], [-9.0, 0.1]), Some([1.0, 0.0]));
        assert_eq!(side([3.36, 0.0], [-9.0, 0.0]), Some([1.0, 0.0]));
        assert_eq!(side([3.33, 0.87], [-9.0, -0.1]), Some([1.0, 0.0]), "a little beside the corner");
        // An oncoming car that a control step has moved far in.
        assert_eq!(side([2.9, 0.8], [-17.0, -0.1]), Some([1.0, 0.0]));
        // A walker who comes against the door, and a car against the boot.
        assert_eq!(side([1.0, 0.85], [-9.0, -1.5]), Some([0.0, 1.0]));
        assert_eq!(side([1.0, -0.85], [-9.0, 1.5]), Some([0.0, -1.0]));
        assert_eq!(side([-0.7, 0.2], [6.0, 0.0]), Some([-1.0, 0.0]));
        // What stands with the ego came in nowhere, and what rises under it did so long ago.
        assert_eq!(side([3.3, 0.0], [0.0, 0.0]), None);
        assert_eq!(side([1.0, 0.0], [-9.0, 0.0]), None);
    }
}
