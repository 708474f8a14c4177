//! Height of the ground over the plane, one value for each place, metres over the lowest road.
//!
//! A regular grid of nodes, bilinear in between. Under roads and pavements the nodes are the network's
//! elevation and superelevation; a verge keeps the height of the edge beside it; from there on the
//! land runs smoothly between the roads (a relaxed membrane, `4 z = sum of the neighbours`), and falls
//! to zero towards the grid's border. A network without slopes has no grid: its ground is zero.
//!
//! One place has one height: where roads lie on several levels the lowest counts, and those above it are
//! reported as unusable.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::path::{Vec2, rotate};
use super::town_parts::WaveConfig;

/// Height of pavements over the road.
pub const PAVEMENT_M: f64 = 0.14;
/// Height of the grass plane.
pub const GRASS_M: f64 = -0.05;
/// Networks whose heights differ by less are flat: less than a road's camber.
const FLAT_M: f64 = 0.03;
/// Side of a cell where the network is small enough.
const CELL_M: f64 = 1.0;
/// Larger networks get larger cells, so that a grid stays below 16 MB.
const MAX_NODES: f64 = 4.0e6;
/// Land beyond the outermost road.
const MARGIN_M: f64 = 200.0;
/// Over this width the land falls to zero at the grid's border.
const FADE_M: f64 = 120.0;
/// Roads this far above the lowest one at the same place are on another level.
const LEVEL_M: f64 = 2.0;
/// A lane is on another level where this share of it lies above others.
const LEVEL_SHARE: f64 = 0.1;

/// Longest edge of a strip that lies on waves.
const WAVE_STEP_M: f64 = 4.0;

/// A strip of road as its two edges, with heights.
#[derive(Debug, Clone, Default)]
pub struct Ribbon {
    pub left: Vec<Vector3<f64>>,
    pub right: Vec<Vector3<f64>>,
}

impl Ribbon {
    /// The strip with the waves of the land added, with edges of [`WAVE_STEP_M`] at most.
    pub(super) fn on_waves(&self, waves: &[WaveConfig]) -> Self {
        let (mut left, mut right) = (Vec::new(), Vec::new());
        let n = self.left.len().min(self.right.len());
        for i in 1..n {
            let longer_m =
                (self.left[i] - self.left[i - 1]).norm().max((self.right[i] - self.right[i - 1]).norm());
            let n_steps = (longer_m / WAVE_STEP_M).ceil().max(1.0) as usize;
            for step in usize::from(i > 1)..=n_steps {
                let share = step as f64 / n_steps as f64;
                left.push(self.left[i - 1].lerp(&self.left[i], share));
                right.push(self.right[i - 1].lerp(&self.right[i], share));
            }
        }
        for point in left.iter_mut().chain(&mut right) {
            point.z += waves_at(waves, point.xy());
        }
        Self { left, right }
    }
}

/// Height of all waves at a place, metres.
pub(super) fn waves_at(waves: &[WaveConfig], point: Vec2) -> f64 {
    waves.iter().map(|wave| wave.height_at(point)).sum()
}

/// Heights of the ground.
#[derive(Debug, Clone, Default)]
pub struct Ground {
    grid: Option<Grid>,
    /// Height of the lowest road in the map.
    base_m: f64,
}

/// The nodes of a ground that is not flat.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Place of the first node, the one with the least x and y.
    pub origin: Vec2,
    pub cell_m: f64,
    pub n_x: usize,
    pub n_y: usize,
    /// Heights, row by row of equal y, least y first.
    pub z_m: Vec<f32>,
}

impl Ground {
    /// The ground under ribbons, which keeps the height of their edges over `verge_m` beside them; and for each
    /// ribbon whether it lies on an upper level and was left out.
    pub fn under(ribbons: &[Ribbon], verge_m: f64) -> (Self, Vec<bool>) {
        let mut is_above = vec![false; ribbons.len()];
        let points = || ribbons.iter().flat_map(|ribbon| ribbon.left.iter().chain(&ribbon.right));
        let (low, high) = points().fold(
            (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)),
            |(low, high), point| (low.inf(point), high.sup(point)),
        );
        if points().next().is_none() || high.z - low.z < FLAT_M {
            return (Self::default(), is_above);
        }
        let span = (high - low).xy() + Vec2::repeat(2.0 * MARGIN_M);
        let cell_m = CELL_M.max((span.x * span.y / MAX_NODES).sqrt());
        let origin = low.xy() - Vec2::repeat(MARGIN_M);
        let (n_x, n_y) = ((span.x / cell_m).ceil() as usize + 1, (span.y / cell_m).ceil() as usize + 1);
        let mut grid = Grid { origin, cell_m, n_x, n_y, z_m: vec![0.0; n_x * n_y] };

        let mut lowest = vec![f64::INFINITY; n_x * n_y];
        for ribbon in ribbons {
            grid.visit(ribbon, 0.0, |node, z_m, _| lowest[node] = lowest[node].min(z_m));
        }
        for (ribbon, is_above) in ribbons.iter().zip(&mut is_above) {
            let (mut n, mut n_above) = (0.0, 0.0);
            grid.visit(ribbon, 0.0, |node, z_m, _| {
                n += 1.0;
                n_above += if z_m > lowest[node] + LEVEL_M { 1.0 } else { 0.0 };
            });
            *is_above = n_above > LEVEL_SHARE * n;
        }
        let mut sums = vec![(0.0, 0.0); n_x * n_y];
        for (ribbon, _) in ribbons.iter().zip(&is_above).filter(|(_, is_above)| !**is_above) {
            grid.visit(ribbon, verge_m, |node, z_m, beside_m| {
                let weight = if beside_m > 0.0 { 0.01 / (1.0 + beside_m * beside_m) } else { 1.0 };
                sums[node].0 += weight * (z_m - low.z);
                sums[node].1 += weight;
            });
        }
        grid.z_m = relaxed(&sums, n_x, n_y);
        grid.fade_out();
        (Self { grid: Some(grid), base_m: low.z }, is_above)
    }

    pub fn is_flat(&self) -> bool {
        self.grid.is_none()
    }

    pub(super) fn grid_mut(&mut self) -> Option<&mut Grid> {
        self.grid.as_mut()
    }

    /// The nodes, unless the ground is flat.
    pub fn grid(&self) -> Option<&Grid> {
        self.grid.as_ref()
    }

    /// Height in the map of what is zero here: its lowest road.
    pub(super) fn base_m(&self) -> f64 {
        self.base_m
    }

    /// Height at a place; beyond the grid, zero.
    pub fn height_m(&self, point: Vec2) -> f64 {
        self.grid.as_ref().map_or(0.0, |grid| grid.height_m(point))
    }

    /// Height and turn of a body that stands on the ground with its four corners.
    ///
    /// The turn takes the body's axes (x forward) to the world's; on flat ground it is the yaw alone.
    pub fn stance(
        &self,
        center: Vec2,
        yaw_rad: f64,
        length_m: f64,
        width_m: f64,
    ) -> (f64, UnitQuaternion<f64>) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        if self.is_flat() {
            return (0.0, turn);
        }
        let (sin, cos) = yaw_rad.sin_cos();
        let (half_m, side_m) = (length_m.max(0.2) / 2.0, width_m.max(0.2) / 2.0);
        let height = |along: f64, across: f64| {
            let (x, y) = (along * half_m, across * side_m);
            self.height_m(center + rotate(x, y, yaw_rad))
        };
        let [fl, fr, rl, rr] = [height(1.0, 1.0), height(1.0, -1.0), height(-1.0, 1.0), height(-1.0, -1.0)];
        let forward = Vector3::new(cos, sin, (fl + fr - rl - rr) / (4.0 * half_m));
        let left = Vector3::new(-sin, cos, (fl + rl - fr - rr) / (4.0 * side_m));
        let up = forward.cross(&left).normalize();
        let forward = forward.normalize();
        let axes = Matrix3::from_columns(&[forward, up.cross(&forward), up]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        ((fl + fr + rl + rr) / 4.0, turn)
    }
}

impl Grid {
    /// The place of a node.
    pub fn node(&self, i: usize, j: usize) -> Vec2 {
        self.origin + Vec2::new(i as f64, j as f64) * self.cell_m
    }

    pub fn z_at(&self, i: usize, j: usize) -> f64 {
        f64::from(self.z_m[j * self.n_x + i])
    }

    /// Middle of the grid, and half of its extent along x and y.
    pub fn extent(&self) -> (Vec2, Vec2) {
        let half = Vec2::new((self.n_x - 1) as f64, (self.n_y - 1) as f64) * (self.cell_m / 2.0);
        (self.origin + half, half)
    }

    fn height_m(&self, point: Vec2) -> f64 {
        let at = (point - self.origin) / self.cell_m;
        let (x, y) = (at.x.floor(), at.y.floor());
        if !(x >= 0.0 && y >= 0.0 && x + 1.0 < self.n_x as f64 && y + 1.0 < self.n_y as f64) {
            return 0.0;
        }
        let (i, j, u, v) = (x as usize, y as usize, at.x - x, at.y - y);
        let z = |i: usize, j: usize| self.z_at(i, j);
        (z(i, j) * (1.0 - u) + z(i + 1, j) * u) * (1.0 - v)
            + (z(i, j + 1) * (1.0 - u) + z(i + 1, j + 1) * u) * v
    }

    /// Visits each node in the ribbon or within `reach_m` beside it: its index, the ribbon's height
    /// there (beside it, the edge's) and the distance from the edge.
    fn visit(&self, ribbon: &Ribbon, reach_m: f64, mut tell: impl FnMut(usize, f64, f64)) {
        for i in 1..ribbon.left.len().min(ribbon.right.len()) {
            let corners = [ribbon.left[i - 1], ribbon.right[i - 1], ribbon.left[i], ribbon.right[i]];
            let (from, to) = ((corners[0] + corners[1]) / 2.0, (corners[2] + corners[3]) / 2.0);
            let way = (to - from).xy();
            if way.norm() < 1e-6 {
                continue;
            }
            let normal = Vec2::new(-way.y, way.x).normalize();
            let (low, high) = corners.iter().fold(
                (Vec2::repeat(f64::INFINITY), Vec2::repeat(f64::NEG_INFINITY)),
                |(low, high), corner| (low.inf(&corner.xy()), high.sup(&corner.xy())),
            );
            let first = (low - Vec2::repeat(reach_m) - self.origin) / self.cell_m;
            let last = (high + Vec2::repeat(reach_m) - self.origin) / self.cell_m;
            for j in first.y.ceil().max(0.0) as usize..=(last.y.floor() as usize).min(self.n_y - 1) {
                for i in first.x.ceil().max(0.0) as usize..=(last.x.floor() as usize).min(self.n_x - 1) {
                    let point = self.node(i, j);
                    let along = (point - from.xy()).dot(&way) / way.norm_squared();
                    if !(-0.02..=1.02).contains(&along) {
                        continue;
                    }
                    let left = corners[0] + (corners[2] - corners[0]) * along;
                    let right = corners[1] + (corners[3] - corners[1]) * along;
                    let half_m = (left - right).xy().norm() / 2.0;
                    let offset_m = (point - ((left + right) / 2.0).xy()).dot(&normal);
                    let beside_m = (offset_m.abs() - half_m).max(0.0);
                    if beside_m <= reach_m {
                        let share = (offset_m / half_m.max(0.01)).clamp(-1.0, 1.0) / 2.0 + 0.5;
                        tell(j * self.n_x + i, right.z + (left.z - right.z) * share, beside_m);
                    }
                }
            }
        }
    }

    fn fade_out(&mut self) {
        for j in 0..self.n_y {
            for i in 0..self.n_x {
                let to_border = i.min(self.n_x - 1 - i).min(j).min(self.n_y - 1 - j);
                let share = (to_border as f64 * self.cell_m / FADE_M).min(1.0);
                self.z_m[j * self.n_x + i] *= (share * share * (3.0 - 2.0 * share)) as f32;
            }
        }
    }
}

/// Heights from weighted sums; nodes without weight lie between their neighbours.
fn relaxed(sums: &[(f64, f64)], n_x: usize, n_y: usize) -> Vec<f32> {
    let known: Vec<(f64, f64)> = sums
        .iter()
        .map(|&(sum, weight)| (if weight > 0.0 { sum / weight } else { 0.0 }, weight.min(1.0)))
        .collect();
    let mut z_m = filled(&known, n_x, n_y);
    let is_road: Vec<bool> = known.iter().map(|&(_, weight)| weight >= 1.0).collect();
    for pass in 0..80 {
        // The last passes smooth the roads too, where lanes of a junction disagree.
        let is_last = pass >= 78;
        let before = z_m.clone();
        for j in 1..n_y.saturating_sub(1) {
            for i in 1..n_x - 1 {
                let at = j * n_x + i;
                let (own, weight) = known[at];
                if is_road[at] && !is_last {
                    continue;
                }
                let around = (before[at - 1] + before[at + 1] + before[at - n_x] + before[at + n_x]) / 4.0;
                let pull = if is_road[at] || weight == 0.0 { 0.0 } else { 0.2 };
                let share = if is_road[at] { 0.5 } else { 1.0 };
                let free = before[at] + (around - before[at]) * share;
                z_m[at] = free + (own - free) * pull;
            }
        }
    }
    z_m.into_iter().map(|z| z as f32).collect()
}

/// Fills nodes without weight from ever coarser means (push-pull, Gortler et al., 1996).
fn filled(known: &[(f64, f64)], n_x: usize, n_y: usize) -> Vec<f64> {
    if n_x <= 2 || n_y <= 2 || known.iter().all(|&(_, weight)| weight > 0.0) {
        return known.iter().map(|&(z, _)| z).collect();
    }
    let (m_x, m_y) = (n_x.div_ceil(2), n_y.div_ceil(2));
    let mut sums = vec![(0.0, 0.0); m_x * m_y];
    for j in 0..n_y {
        for i in 0..n_x {
            let (z, weight) = known[j * n_x + i];
            let sum = &mut sums[(j / 2) * m_x + i / 2];
            sum.0 += z * weight;
            sum.1 += weight;
        }
    }
    let means: Vec<(f64, f64)> = sums
        .iter()
        .map(|&(sum, weight)| (if weight > 0.0 { sum / weight } else { 0.0 }, weight.min(1.0)))
        .collect();
    let coarse = filled(&means, m_x, m_y);
    let sample = |i: usize, j: usize| {
        let (x, y) = ((i as f64 - 0.5).max(0.0) / 2.0, (j as f64 - 0.5).max(0.0) / 2.0);
        let (i0, j0) = (x as usize, y as usize);
        let (i1, j1) = ((i0 + 1).min(m_x - 1), (j0 + 1).min(m_y - 1));
        let (u, v) = (x - i0 as f64, y - j0 as f64);
        (coarse[j0 * m_x + i0] * (1.0 - u) + coarse[j0 * m_x + i1] * u) * (1.0 - v)
            + (coarse[j1 * m_x + i0] * (1.0 - u) + coarse[j1 * m_x + i1] * u) * v
    };
    (0..n_x * n_y)
        .map(|at| if known[at].1 > 0.0 { known[at].0 } else { sample(at % n_x, at / n_x) })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 m along x, 8 m wide, heights by a function of x.
    fn road(y_m: f64, height_m: impl Fn(f64) -> f64) -> Ribbon {
        let edge = |side_m: f64| {
            (0..=50).map(|i| 2.0 * f64::from(i)).map(|x| Vector3::new(x, y_m + side_m, height_m(x))).collect()
        };
        Ribbon { left: edge(4.0), right: edge(-4.0) }
    }

    #[test]
    fn a_level_network_is_flat_at_zero_whatever_its_height() {
        let (ground, _) = Ground::under(&[road(0.0, |_| 312.5)], 7.0);
        assert!(ground.is_flat() && ground.height_m(Vec2::new(3.0, 3.0)).abs() < 1e-12);
    }

    #[test]
    fn the_ground_is_the_road_on_a_slope_and_its_verge_beside_it() {
        let (ground, _) = Ground::under(&[road(0.0, |x| 5.0 + 0.08 * x)], 7.0);
        for x in [10.0, 33.3, 71.7] {
            for y in [0.0, 3.2, -6.0] {
                let found = ground.height_m(Vec2::new(x, y));
                assert!((found - 0.08 * x).abs() < 0.05, "{x} {y}: {found}");
            }
        }
        assert!(ground.height_m(Vec2::new(50.0, 190.0)) < 4.0, "the land falls to the border");
        assert!(ground.height_m(Vec2::new(1e4, 0.0)).abs() < 1e-12);
    }

    #[test]
    fn a_body_stands_along_the_slope() {
        let (ground, _) = Ground::under(&[road(0.0, |x| 0.08 * x)], 7.0);
        let (z_m, turn) = ground.stance(Vec2::new(50.0, 0.0), std::f64::consts::PI, 4.0, 1.8);
        assert!((z_m - 4.0).abs() < 0.02, "{z_m}");
        let forward = turn * Vector3::x();
        // Downhill, as it looks along -x.
        assert!((forward.z + 0.08_f64.atan().sin()).abs() < 2e-3, "{forward}");
        assert!((turn * Vector3::y()).z.abs() < 1e-3);
    }

    #[test]
    fn of_two_levels_the_lower_one_is_the_ground() {
        let bridge = Ribbon {
            left: vec![Vector3::new(46.0, -30.0, 7.0), Vector3::new(46.0, 30.0, 7.0)],
            right: vec![Vector3::new(54.0, -30.0, 7.0), Vector3::new(54.0, 30.0, 7.0)],
        };
        let (ground, is_above) = Ground::under(&[road(0.0, |_| 0.0), bridge], 7.0);
        assert_eq!(is_above, [false, true]);
        assert!(ground.height_m(Vec2::new(50.0, 0.0)).abs() < 1e-6);
    }
}
