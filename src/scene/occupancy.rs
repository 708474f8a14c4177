//! Ground that is taken: strips of road and pavement, and the footprints of things that stand.

use std::collections::BTreeMap;

use super::path::{Vec2, rotate};
use crate::geometry::{Point2, convex_overlap_area};

const CELL_M: f64 = 8.0;

/// An oriented rectangle on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    pub center: Vec2,
    pub yaw_rad: f64,
    pub length_m: f64,
    pub width_m: f64,
}

impl Footprint {
    /// An upright square.
    pub fn square(center: Vec2, side_m: f64) -> Self {
        Self { center, yaw_rad: 0.0, length_m: side_m, width_m: side_m }
    }

    /// A strip from one point to another.
    pub fn between(from: Vec2, to: Vec2, width_m: f64) -> Self {
        let way = to - from;
        Self { center: (from + to) / 2.0, yaw_rad: way.y.atan2(way.x), length_m: way.norm(), width_m }
    }

    /// The point `x` along from the centre and `y` to the left.
    pub fn at(&self, x: f64, y: f64) -> Vec2 {
        self.center + rotate(x, y, self.yaw_rad)
    }

    /// Half of the diagonal.
    pub fn radius_m(&self) -> f64 {
        // `hypot` is many times slower, and drivers ask this most.
        (self.length_m * self.length_m + self.width_m * self.width_m).sqrt() / 2.0
    }

    #[must_use]
    pub fn grow(&self, margin_m: f64) -> Self {
        Self { length_m: self.length_m + 2.0 * margin_m, width_m: self.width_m + 2.0 * margin_m, ..*self }
    }

    pub fn corners(&self) -> [Point2; 4] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)].map(|(along, across)| {
            let (x, y) = (along * self.length_m, across * self.width_m);
            Point2 { x_m: self.center.x + x * cos - y * sin, y_m: self.center.y + x * sin + y * cos }
        })
    }

    /// How far along and to the left of the centre a point lies.
    pub fn place_of(&self, point: Vec2) -> (f64, f64) {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let offset = point - self.center;
        (offset.x * cos + offset.y * sin, offset.y * cos - offset.x * sin)
    }

    /// Distance from a point to it, zero inside.
    pub fn distance_m(&self, point: Vec2) -> f64 {
        let (x, y) = self.place_of(point);
        let beyond = |at: f64, size_m: f64| (at.abs() - size_m / 2.0).max(0.0);
        let (x, y) = (beyond(x, self.length_m), beyond(y, self.width_m));
        (x * x + y * y).sqrt()
    }

    /// Whether a point lies inside.
    pub fn contains(&self, point: Vec2) -> bool {
        if (point - self.center).norm_squared() > self.radius_m().powi(2) {
            return false;
        }
        let (x, y) = self.place_of(point);
        x.abs() <= self.length_m / 2.0 && y.abs() <= self.width_m / 2.0
    }

    /// Whether two rectangles share more than a square centimetre.
    pub fn meets(&self, other: &Self) -> bool {
        (self.center - other.center).norm() < self.radius_m() + other.radius_m()
            && convex_overlap_area(&self.corners(), &other.corners()) > 1e-4
    }
}

fn cell(point: Vec2) -> (i64, i64) {
    ((point.x / CELL_M).floor() as i64, (point.y / CELL_M).floor() as i64)
}

fn around(point: Vec2) -> impl Iterator<Item = (i64, i64)> {
    let (x, y) = cell(point);
    (-1..=1).flat_map(move |dx| (-1..=1).map(move |dy| (x + dx, y + dy)))
}

/// Centre points of strips with their half widths, found by cell.
#[derive(Debug, Clone, Default)]
pub struct StripGrid {
    cells: BTreeMap<(i64, i64), Vec<(Vec2, f64)>>,
}

impl StripGrid {
    pub fn add(&mut self, points: &[Vec2], half_width_m: f64) {
        for &point in points {
            self.cells.entry(cell(point)).or_default().push((point, half_width_m));
        }
    }

    /// All centre points with their half widths.
    pub fn discs(&self) -> impl Iterator<Item = (Vec2, f64)> {
        self.cells.values().flatten().copied()
    }

    /// Distance from a point to the nearest strip's edge, negative inside; at most one cell.
    pub fn clearance_m(&self, point: Vec2) -> f64 {
        let near = around(point).filter_map(|key| self.cells.get(&key)).flatten();
        near.map(|(center, half_m)| (point - center).norm() - half_m).fold(CELL_M, f64::min)
    }
}

/// Footprints that must not meet.
#[derive(Debug, Clone, Default)]
pub struct Occupied {
    footprints: Vec<Footprint>,
}

impl Occupied {
    /// Takes the ground if it is free, with `gap_m` to everything else; returns whether it was free.
    pub fn claim(&mut self, footprint: Footprint, gap_m: f64) -> bool {
        let is_free = self.is_free(&footprint, gap_m);
        if is_free {
            self.footprints.push(footprint);
        }
        is_free
    }

    /// Takes the ground, whatever stands there.
    pub fn take(&mut self, footprint: Footprint) {
        self.footprints.push(footprint);
    }

    pub fn is_free(&self, footprint: &Footprint, gap_m: f64) -> bool {
        let grown = footprint.grow(gap_m);
        !self.footprints.iter().any(|other| grown.meets(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x_m: f64) -> Footprint {
        Footprint { center: Vec2::new(x_m, 0.0), yaw_rad: 0.0, length_m: 2.0, width_m: 2.0 }
    }

    #[test]
    fn ground_can_be_claimed_once() {
        let mut occupied = Occupied::default();
        assert!(occupied.claim(square(0.0), 0.0));
        assert!(!occupied.claim(square(1.9), 0.0));
        assert!(occupied.claim(square(2.1), 0.0));
        assert!(!occupied.is_free(&square(4.2), 0.5));
    }

    #[test]
    fn clearance_is_negative_on_the_strip() {
        let mut grid = StripGrid::default();
        grid.add(&[Vec2::zeros()], 2.0);
        assert!((grid.clearance_m(Vec2::new(5.0, 0.0)) - 3.0).abs() < 1e-12);
        assert!(grid.clearance_m(Vec2::new(1.0, 0.0)) < 0.0);
    }
}
