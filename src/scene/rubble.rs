//! A pattern of rough stones: the cells nearest to scattered points, which repeats at the edges of its tile.
//!
//! Cells are those of Worley, A cellular texture basis function, SIGGRAPH 1996: the distances to the nearest point and to
//! the next one tell how far a joint is.

use rand::RngExt;

use crate::random;

/// Stones are wider than high.
const FLAT: f64 = 1.7;
/// Half of a joint's width, in the mean distance of stones.
const JOINT: f64 = 0.08;

/// Stones of a tile.
pub struct Rubble {
    n: u32,
    /// Place in the tile and brightness, row by row of cells.
    stones: Vec<[f64; 3]>,
}

impl Rubble {
    /// About `n` rows of stones in a tile.
    pub fn new(name: &str, n: u32) -> Self {
        let mut rng = random::stream(0, name, 2);
        let n_x = columns(n);
        let stone = |at: u32| {
            let shifted = |cell: u32, n: u32, draw: f64| (f64::from(cell) + 0.1 + 0.8 * draw) / f64::from(n);
            let [x, y, tone] = std::array::from_fn(|_| rng.random::<f64>());
            [shifted(at % n_x, n_x, x), shifted(at / n_x, n, y), 0.86 + 0.26 * tone]
        };
        let stones = (0..n_x * n).map(stone).collect();
        Self { n, stones }
    }

    /// Brightness at a place of the tile.
    pub fn at(&self, u: f64, v: f64) -> f64 {
        let (n_x, n_y) = (columns(self.n), self.n);
        let (column, row) = ((u * f64::from(n_x)) as i64, (v * f64::from(n_y)) as i64);
        let (mut nearest, mut next, mut tone) = (f64::MAX, f64::MAX, 1.0);
        for j in row - 1..=row + 1 {
            for i in column - 1..=column + 1 {
                let (x, y) = (i.rem_euclid(i64::from(n_x)), j.rem_euclid(i64::from(n_y)));
                let [at_u, at_v, own] = self.stones[(y * i64::from(n_x) + x) as usize];
                // A cell beyond the edge is the one at the other edge, a tile away.
                let (du, dv) = (wrapped(u - at_u) * f64::from(n_x), wrapped(v - at_v) * f64::from(n_y));
                let far = du.hypot(dv);
                if far < nearest {
                    (nearest, next, tone) = (far, nearest, own);
                } else {
                    next = next.min(far);
                }
            }
        }
        let rise = ((next - nearest) / (2.0 * JOINT)).min(1.0);
        tone * (0.62 + 0.38 * rise)
    }
}

fn columns(n: u32) -> u32 {
    (f64::from(n) / FLAT).round().max(2.0) as u32
}

/// A difference of places in a tile, the short way round.
fn wrapped(difference: f64) -> f64 {
    difference - difference.round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pattern_repeats_and_joints_are_dark() {
        let rubble = Rubble::new("test", 12);
        for at in [0.1, 0.37, 0.82] {
            assert!((rubble.at(0.0, at) - rubble.at(1.0 - 1e-9, at)).abs() < 1e-3);
            assert!((rubble.at(at, 0.0) - rubble.at(at, 1.0 - 1e-9)).abs() < 1e-3);
        }
        let all: Vec<f64> =
            (0..10_000).map(|i| rubble.at(f64::from(i % 100) / 100.0, f64::from(i / 100) / 100.0)).collect();
        let (low, high) = all.iter().fold((f64::MAX, f64::MIN), |(l, h), &x| (l.min(x), h.max(x)));
        assert!(low < 0.65 && high > 1.05, "{low} {high}");
    }
}
