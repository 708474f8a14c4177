//! Roofs with one slope, and with teeth.

use super::mesh::TriangleMesh;
use super::occupancy::Footprint;
use super::shapes::Site;

/// Width of a tooth of a sawtooth roof.
const TOOTH_M: f64 = 6.0;
/// How far a slope reaches beyond the walls.
const EAVES_M: f64 = 0.3;
/// Width of a tile, of roofs and of blank walls.
const TILE_M: f64 = 3.0;

/// Adds a roof over the walls of a building, whose front is on the side of `-width`: one slope down to the front, or
/// teeth along it. `levels_m`: top of the walls, and how high the roof rises over them.
pub fn add(
    [roof, walls]: [&mut TriangleMesh; 2],
    footprint: &Footprint,
    [top_m, rise_m]: [f64; 2],
    is_shed: bool,
) {
    let site = Site { footprint: *footprint, base_m: top_m };
    let (half_x, half_y) = (footprint.length_m / 2.0, footprint.width_m / 2.0);
    if is_shed {
        let slope = Slope { from: [-half_y, 0.0], to: [half_y, rise_m], along: false };
        slope.add([roof, walls], &site, half_x);
        return;
    }
    let n = (footprint.length_m / TOOTH_M).round().max(1.0);
    for k in 0..n as usize {
        let at = |k: f64| footprint.length_m * (k / n - 0.5);
        let slope = Slope { from: [at(k as f64), 0.0], to: [at(k as f64 + 1.0), rise_m], along: true };
        slope.add([roof, walls], &site, half_y);
    }
}

/// A slope between two heights over the walls, along a building or across it, and the walls below its high side.
struct Slope {
    /// Place and height.
    from: [f64; 2],
    to: [f64; 2],
    along: bool,
}

impl Slope {
    fn add(&self, [roof, walls]: [&mut TriangleMesh; 2], site: &Site, half_m: f64) {
        let at = |[place, up]: [f64; 2], aside: f64| {
            if self.along { site.at(place, aside, up) } else { site.at(-aside, place, up) }
        };
        let ([low, low_up], [high, high_up]) = (self.from, self.to);
        let drop_m = EAVES_M * (high_up - low_up) / (high - low);
        let out = half_m + EAVES_M;
        let eaves = if self.along { [low, low_up] } else { [low - EAVES_M, low_up - drop_m] };
        let ridge = [high, high_up + 0.02];
        let (n_along, n_up) = (2.0 * out / TILE_M, (high - low).hypot(high_up) / TILE_M);
        roof.add_polygon(&[
            (at(eaves, out), [0.0, 0.0]),
            (at(eaves, -out), [n_along, 0.0]),
            (at(ridge, -out), [n_along, n_up]),
            (at(ridge, out), [0.0, n_up]),
        ]);
        // Under the high side, and at both ends of the slope.
        let [u, v] = [half_m / TILE_M, high_up / TILE_M];
        walls.add_polygon(&[
            (at([high, 0.0], -half_m), [-u, 0.0]),
            (at([high, 0.0], half_m), [u, 0.0]),
            (at(self.to, half_m), [u, v]),
            (at(self.to, -half_m), [-u, v]),
        ]);
        for side in [-1.0, 1.0] {
            let mut corners = [
                (at([low, 0.0], side * half_m), [low / TILE_M, 0.0]),
                (at([high, 0.0], side * half_m), [high / TILE_M, 0.0]),
                (at(self.to, side * half_m), [high / TILE_M, v]),
            ];
            if side > 0.0 {
                corners.reverse();
            }
            walls.add_polygon(&corners);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Vec2;

    #[test]
    fn slopes_and_the_walls_below_them_face_outwards() {
        let center = Vec2::new(3.0, 7.0);
        let footprint = Footprint { center, yaw_rad: 0.4, length_m: 18.0, width_m: 10.0 };
        for is_shed in [true, false] {
            let (mut roof, mut walls) = (TriangleMesh::default(), TriangleMesh::default());
            add([&mut roof, &mut walls], &footprint, [5.0, 3.0], is_shed);
            assert!(roof.corners().iter().all(|[a, b, c]| (b - a).cross(&(c - a)).z > 0.0));
            let n_teeth = if is_shed { 1 } else { 3 };
            assert_eq!((roof.n_triangles(), walls.n_triangles()), (2 * n_teeth, 4 * n_teeth));
            // Front and back of the teeth, sides of the slope: away from the building's middle.
            for [a, b, c] in walls.corners() {
                let normal = (b - a).cross(&(c - a)).cast::<f64>().xy();
                let out = ((a.coords + b.coords + c.coords) / 3.0).cast::<f64>().xy() - center;
                let (x, y) = (out.dot(&crate::scene::path::direction_of(0.4)), normal.dot(&out));
                assert!(y > 0.0 || (!is_shed && x.abs() < 4.0), "{a} {b} {c}");
            }
        }
    }
}
