//! Box codes: the numbers that the head predicts for a query, from boxes and back.
//!
//! A code has ten numbers as in TransFusion: centre offset from the query's cell in cells (2),
//! centre height in metres, log of length, width, height, sine and cosine of yaw, velocity in m/s.

use std::f64::consts::{PI, SQRT_2};

use crate::geometry::{Box3, Ego, Point};
use crate::object::BoxSpread;

/// Numbers of a box code.
pub const CODE_SIZE: usize = 10;

/// Decoding clamps log sizes to this: 20 m, longer than any vehicle.
const MAX_LOG_SIZE: f32 = 3.0;

/// Encodes a box for a query at `query_m`.
#[must_use]
pub fn encode(
    truth: &Box3<Ego>,
    velocity_mps: [f64; 2],
    query_m: [f64; 2],
    cell_size_m: f64,
) -> [f32; CODE_SIZE] {
    [
        (truth.center.x() - query_m[0]) / cell_size_m,
        (truth.center.y() - query_m[1]) / cell_size_m,
        truth.center.z(),
        truth.length_m.ln(),
        truth.width_m.ln(),
        truth.height_m.ln(),
        truth.yaw_rad.sin(),
        truth.yaw_rad.cos(),
        velocity_mps[0],
        velocity_mps[1],
    ]
    .map(|value| value as f32)
}

/// Decodes a code to a box and its velocity.
#[must_use]
pub fn decode(code: &[f32], query_m: [f64; 2], cell_size_m: f64) -> (Box3<Ego>, [f64; 2]) {
    let size = |log: f32| f64::from(log.clamp(-MAX_LOG_SIZE, MAX_LOG_SIZE)).exp();
    let decoded = Box3 {
        center: Point::new(
            query_m[0] + f64::from(code[0]) * cell_size_m,
            query_m[1] + f64::from(code[1]) * cell_size_m,
            f64::from(code[2]),
        ),
        length_m: size(code[3]),
        width_m: size(code[4]),
        height_m: size(code[5]),
        yaw_rad: f64::from(code[6]).atan2(f64::from(code[7])),
    };
    (decoded, [f64::from(code[8]), f64::from(code[9])])
}

/// Decodes logarithms of spreads (of Laplace's distribution, whose standard deviation is the square root of two of them) of
/// a code's numbers.
#[must_use]
pub fn decode_spread(log_spreads: &[f32], cell_size_m: f64) -> BoxSpread {
    let deviation = |i: usize| SQRT_2 * f64::from(log_spreads[i]).exp();
    BoxSpread {
        x_m: cell_size_m * deviation(0),
        y_m: cell_size_m * deviation(1),
        z_m: deviation(2),
        length: deviation(3),
        width: deviation(4),
        height: deviation(5),
        // Sine and cosine are off by as much as the angle where it changes them most.
        yaw_rad: deviation(6).max(deviation(7)).min(PI / 2.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decoding_undoes_encoding(x in 0.0..50.0, y in -30.0..30.0, length in 0.1..15.0, yaw in -3.1..3.1) {
            let truth = Box3 { center: Point::new(x, y, 0.8), length_m: length, width_m: 1.9, height_m: 1.6, yaw_rad: yaw };
            let query = [x + 0.7, y - 1.1];
            let code = encode(&truth, [3.0, -1.0], query, 0.8);
            let (back, velocity) = decode(&code, query, 0.8);
            prop_assert!((back.center.coords - truth.center.coords).norm() < 1e-5);
            prop_assert!((back.length_m - length).abs() < 1e-5 * length && (back.yaw_rad - yaw).abs() < 1e-5);
            prop_assert!((velocity[0] - 3.0).abs() < 1e-6 && (velocity[1] + 1.0).abs() < 1e-6);
        }
    }
}
