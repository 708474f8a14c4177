//! Guard rails along the outer sides of bends.

use rand::RngExt;

use super::occupancy::{Footprint, Occupied};
use super::path::{Path, Vec2};
use super::surface::{Strip, StripKind, Surface};
use crate::random;

/// Bends of a smaller radius have rails, and turns at corners, which are tighter than the second, have none.
const WIDEST_M: f64 = 90.0;
const TIGHTEST_M: f64 = 7.0;
/// From the edge of what is paved.
const BESIDE_M: f64 = 0.35;
/// Between the places where the bend is measured.
const STEP_M: f64 = 2.0;
const SHORTEST_M: f64 = 8.0;
/// Fences and hedges this near stand there already.
const FENCE_M: f64 = 1.2;

/// Lines of rails for a share of the bends, off what stands there already: the road lies to their right.
pub(super) fn along_bends(
    surface: &Surface,
    share: f64,
    fences: &[&Path],
    occupied: &mut Occupied,
) -> Vec<Path> {
    let mut rng = random::stream(0, "bend-rails", 0);
    let fence_points: Vec<Vec2> = fences.iter().flat_map(|fence| fence.points_every(STEP_M)).collect();
    let is_edge = |strip: &&Strip| matches!(strip.kind, StripKind::Road | StripKind::Pavement);
    let mut rails = Vec::new();
    for strip in surface.strips.iter().filter(|strip| !strip.is_in_junction()).filter(is_edge) {
        for side in [-1.0, 1.0] {
            let is_wanted = rng.random::<f64>() < share;
            let Some(line) = is_wanted.then(|| outside(surface, strip, side)).flatten() else { continue };
            let is_free = |at: &Vec2| {
                occupied.is_free(&Footprint::square(*at, 0.4), 0.0)
                    && fence_points.iter().all(|other| (other - at).norm() > FENCE_M)
            };
            let runs = line.chunk_by(|a, b| is_free(a) == is_free(b)).filter(|run| is_free(&run[0]));
            for mut run in runs.map(<[Vec2]>::to_vec).collect::<Vec<_>>() {
                if side < 0.0 {
                    run.reverse();
                }
                let Some(line) = Path::new(run).filter(|line| line.length_m() > SHORTEST_M) else { continue };
                for pair in line.points().windows(2) {
                    occupied.take(Footprint::between(pair[0], pair[1], 0.3));
                }
                rails.push(line);
            }
        }
    }
    rails
}

/// Points along the part of a strip's side that lies outside of a bend, in the strip's direction.
fn outside(surface: &Surface, strip: &Strip, side: f64) -> Option<Vec<Vec2>> {
    let n = (strip.center.length_m() / STEP_M).floor() as usize;
    let points = (1..n).map(|k| k as f64 * STEP_M).filter_map(|s_m| {
        // Positive to the left, away from which the outer side lies.
        let bend = -side * strip.center.curvature_per_m(s_m);
        let at = strip.center.beside(s_m, side * (strip.width_at_m(s_m) / 2.0 + BESIDE_M));
        let is_bend = (1.0 / WIDEST_M..1.0 / TIGHTEST_M).contains(&bend);
        (is_bend && surface.paved_grid.clearance_m(at) > BESIDE_M - 0.2).then_some(at)
    });
    let points: Vec<Vec2> = points.collect();
    // Two bends of a strip are no run.
    let longest = points.chunk_by(|a, b| (a - b).norm() < 2.0 * STEP_M).max_by_key(|run| run.len())?;
    Some(longest.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Town;

    #[test]
    fn rails_stand_outside_of_bends_with_their_beams_to_the_road() {
        let town = Town::load("hillside").unwrap();
        let rails = along_bends(&town.surface, 1.0, &[], &mut Occupied::default());
        assert!(rails.len() > 4, "{}", rails.len());
        for rail in &rails {
            let middle_m = rail.length_m() / 2.0;
            let right = rail.beside(middle_m, -1.0);
            assert!(town.surface.paved_grid.clearance_m(right) < 0.0);
            for point in rail.points() {
                assert!(town.surface.paved_grid.clearance_m(*point) > 0.1);
            }
        }
        assert!(along_bends(&town.surface, 0.0, &[], &mut Occupied::default()).is_empty());
    }
}
