//! Polylines on the ground plane, addressed by arc length: lanes, routes and footways.

use nalgebra::Vector2;

/// A point or direction on the ground plane, metres.
pub type Vec2 = Vector2<f64>;

/// A polyline with at least two distinct points.
#[derive(Debug, Clone)]
pub struct Path {
    points: Vec<Vec2>,
    /// Arc length at each point; the first is zero.
    stations_m: Vec<f64>,
}

impl Path {
    /// `None` for fewer than two distinct points; repeated points are dropped.
    pub fn new(raw: impl IntoIterator<Item = Vec2>) -> Option<Self> {
        let mut path = Self { points: Vec::new(), stations_m: Vec::new() };
        path.extend(raw);
        (path.points.len() >= 2).then_some(path)
    }

    /// Appends points; those within a centimetre of the one before are dropped.
    pub fn extend(&mut self, raw: impl IntoIterator<Item = Vec2>) {
        for point in raw {
            if let (Some(last), Some(station)) = (self.points.last(), self.stations_m.last()) {
                let step_m = (point - last).norm();
                if step_m > 0.01 {
                    self.stations_m.push(station + step_m);
                    self.points.push(point);
                }
            } else {
                self.points.push(point);
                self.stations_m.push(0.0);
            }
        }
    }

    /// The same way from its end to its start.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let mut path = Self { points: Vec::new(), stations_m: Vec::new() };
        path.extend(self.points.iter().rev().copied());
        path
    }

    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    pub fn length_m(&self) -> f64 {
        *self.stations_m.last().expect("a path has two points")
    }

    /// Segment that holds a station, and how far along it that is; ends extend straight.
    fn locate(&self, s_m: f64) -> (usize, f64) {
        let i =
            self.stations_m.partition_point(|&station| station <= s_m).clamp(1, self.points.len() - 1) - 1;
        (i, (s_m - self.stations_m[i]) / (self.stations_m[i + 1] - self.stations_m[i]))
    }

    /// The point at a station; beyond the ends, on the straight extension.
    pub fn at(&self, s_m: f64) -> Vec2 {
        let (i, t) = self.locate(s_m);
        self.points[i] + (self.points[i + 1] - self.points[i]) * t
    }

    /// Unit direction of travel, from a chord of two metres, so that it turns without steps.
    pub fn direction(&self, s_m: f64) -> Vec2 {
        let (low_m, high_m) = (s_m.clamp(0.0, self.length_m()) - 1.0, s_m.clamp(0.0, self.length_m()) + 1.0);
        let chord = self.at(high_m) - self.at(low_m);
        if chord.norm() > 1e-6 { chord.normalize() } else { Vec2::x() }
    }

    pub fn heading_rad(&self, s_m: f64) -> f64 {
        let direction = self.direction(s_m);
        direction.y.atan2(direction.x)
    }

    /// The point `left_m` to the left of a station.
    pub fn beside(&self, s_m: f64, left_m: f64) -> Vec2 {
        let direction = self.direction(s_m);
        self.at(s_m) + Vec2::new(-direction.y, direction.x) * left_m
    }

    /// Signed curvature over a chord of six metres, positive to the left.
    pub fn curvature_per_m(&self, s_m: f64) -> f64 {
        let (before, after) = (self.direction(s_m - 2.0), self.direction(s_m + 2.0));
        before.perp(&after).asin() / 4.0
    }

    /// Station and signed left offset of the nearest point among segments that meet `[from_m, to_m]`.
    pub fn project(&self, point: Vec2, from_m: f64, to_m: f64) -> (f64, f64) {
        let (first, last) = (self.locate(from_m).0, self.locate(to_m).0);
        let mut best = (f64::INFINITY, 0.0, 0.0);
        for i in first..=last {
            let (a, b) = (self.points[i], self.points[i + 1]);
            let along = b - a;
            let t = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let offset = point - (a + along * t);
            if offset.norm_squared() < best.0 {
                let station_m = self.stations_m[i] + t * along.norm();
                best = (offset.norm_squared(), station_m, along.perp(&offset).signum() * offset.norm());
            }
        }
        (best.1, best.2)
    }

    /// Distance from a point to the whole polyline.
    pub fn distance_m(&self, point: Vec2) -> f64 {
        self.project(point, 0.0, self.length_m()).1.abs()
    }

    /// Points every `step_m`, both ends included.
    pub fn points_every(&self, step_m: f64) -> Vec<Vec2> {
        let n = (self.length_m() / step_m).ceil().max(1.0);
        (0..=n as usize).map(|i| self.at(self.length_m() * i as f64 / n)).collect()
    }
}

/// Unit vector along a heading.
pub fn direction_of(yaw_rad: f64) -> Vec2 {
    Vec2::new(yaw_rad.cos(), yaw_rad.sin())
}

/// A vector `x` along a heading and `y` to its left.
pub fn rotate(x: f64, y: f64, yaw_rad: f64) -> Vec2 {
    let (sin, cos) = yaw_rad.sin_cos();
    Vec2::new(x * cos - y * sin, x * sin + y * cos)
}

/// The shorter way from one heading to another, in (-pi, pi].
pub fn turn_between(from_rad: f64, to_rad: f64) -> f64 {
    let turn = (to_rad - from_rad).rem_euclid(std::f64::consts::TAU);
    if turn > std::f64::consts::PI { turn - std::f64::consts::TAU } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Path {
        Path::new([Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(10.0, 5.0)]).unwrap()
    }

    #[test]
    fn stations_run_along_the_corner_and_beyond_the_end() {
        assert!((corner().length_m() - 15.0).abs() < 1e-12);
        assert!((corner().at(12.0) - Vec2::new(10.0, 2.0)).norm() < 1e-12);
        assert!((corner().at(16.0) - Vec2::new(10.0, 6.0)).norm() < 1e-12);
    }

    #[test]
    fn a_point_left_of_travel_has_a_positive_offset() {
        let (station_m, left_m) = corner().project(Vec2::new(4.0, 1.5), 0.0, 15.0);
        assert!((station_m - 4.0).abs() < 1e-12 && (left_m - 1.5).abs() < 1e-12);
    }

    #[test]
    fn a_single_point_is_no_path() {
        assert!(Path::new([Vec2::zeros(), Vec2::zeros()]).is_none());
    }
}
