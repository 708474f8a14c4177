//! A packet of rays from one origin, and what each has met first.
//!
//! All arithmetic is lane by lane in f32 without fused operations: every instruction set gives the same bits.

use super::frustum::{Directions, Frustum, RAYS, Turn, dot};
use super::tree::{Bounds, Stack, Tree};

/// Number of what a ray that meets nothing has met.
pub(super) const NOTHING: u32 = u32::MAX;
/// Triangles of a block.
const LANES: usize = 4;
/// Triangles that lie outside of a frustum by less are still looked at, metres.
const SLACK_M: f32 = 1e-3;

/// What the rays have met so far: the parameter, in lengths of the direction, and the number of the thing.
#[derive(Debug, Clone)]
pub(super) struct First {
    pub t: [f32; RAYS],
    pub thing: [u32; RAYS],
    /// The largest `t`.
    pub t_max: f32,
}

impl First {
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self { t: [t_max; RAYS], thing: [NOTHING; RAYS], t_max }
    }

    #[inline(always)]
    fn note_farthest(&mut self) {
        let mut most = 0.0;
        for t in self.t {
            most = greater(t, most);
        }
        self.t_max = most;
    }

    /// Notes things of one number, of which each ray meets one at its `t`, if `is_met`.
    #[inline(always)]
    pub(super) fn note(&mut self, thing: u32, t: &[f32; RAYS], is_met: &[bool; RAYS]) {
        for ray in 0..RAYS {
            let is_first = is_met[ray] & (t[ray] > 0.0) & (t[ray] < self.t[ray]);
            self.t[ray] = if is_first { t[ray] } else { self.t[ray] };
            self.thing[ray] = if is_first { thing } else { self.thing[ray] };
        }
        self.note_farthest();
    }
}

#[inline(always)]
pub(super) fn turn_rays(turn: &Turn, rays: &Directions) -> Directions {
    let [x, y, z] = rays;
    let mut turned = [[0.0; RAYS]; 3];
    for axis in 0..3 {
        let [a, b, c] = turn[axis];
        for ray in 0..RAYS {
            turned[axis][ray] = a * x[ray] + b * y[ray] + c * z[ray];
        }
    }
    turned
}

/// Triangles: x, y, z of the first corner, the second and the third, and their numbers.
#[derive(Debug, Clone)]
struct Block {
    corners: [[f32; LANES]; 9],
    things: [u32; LANES],
}

/// Triangles of one frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Triangles {
    tree: Tree,
    blocks: Vec<Block>,
}

impl Triangles {
    /// Their numbers count from `first`.
    pub(super) fn new(triangles: &[[[f32; 3]; 3]], first: u32) -> Self {
        let boxes: Vec<Bounds> = triangles.iter().map(|corners| bounds_of(corners)).collect();
        let mut blocks = Vec::new();
        let tree = Tree::new(&boxes, LANES as u32, &mut |members| {
            let mut block = Block { corners: [[0.0; LANES]; 9], things: [NOTHING; LANES] };
            for (lane, &member) in members.iter().enumerate() {
                block.things[lane] = first + member;
                for (at, value) in triangles[member as usize].as_flattened().iter().enumerate() {
                    block.corners[at][lane] = *value;
                }
            }
            blocks.push(block);
            blocks.len() as u32 - 1
        });
        Self { tree, blocks }
    }

    /// Notes the first triangles that rays from `origin` meet.
    #[inline(always)]
    pub(super) fn cast(
        &self,
        origin: [f32; 3],
        rays: &Directions,
        frustum: &Frustum,
        stack: &mut Stack,
        first: &mut First,
    ) {
        let mut search = self.tree.search(frustum, stack);
        while let Some(block) = search.next(first.t_max * frustum.reach) {
            self.blocks[block as usize].cast(origin, rays, frustum, first);
        }
    }
}

impl Block {
    #[inline(always)]
    fn cast(&self, origin: [f32; 3], rays: &Directions, frustum: &Frustum, first: &mut First) {
        let mut p = self.corners;
        for at in 0..9 {
            for lane in 0..LANES {
                p[at][lane] -= origin[at % 3];
            }
        }
        let mut outside = [f32::NEG_INFINITY; LANES];
        for plane in &frustum.sides {
            let [a, b, c] =
                [plane.height(corner(&p, 0)), plane.height(corner(&p, 3)), plane.height(corner(&p, 6))];
            for lane in 0..LANES {
                let low = lesser(lesser(a[lane], b[lane]), c[lane]);
                outside[lane] = if low > outside[lane] { low } else { outside[lane] };
            }
        }
        // Of the planes through the origin and each edge, and of the triangle's own.
        let [a, b, c] = [corner(&p, 0), corner(&p, 3), corner(&p, 6)];
        let [ab, bc, ca] = [crosses(a, b), crosses(b, c), crosses(c, a)];
        let [to_b, to_c] = [less(b, a), less(c, a)];
        let normals = crosses([&to_b[0], &to_b[1], &to_b[2]], [&to_c[0], &to_c[1], &to_c[2]]);
        let mut is_new = false;
        for lane in 0..LANES {
            if outside[lane] > SLACK_M || self.things[lane] == NOTHING {
                continue;
            }
            let [ab, bc, ca] = [pick(&ab, lane), pick(&bc, lane), pick(&ca, lane)];
            let normal = pick(&normals, lane);
            let height = dot(normal, [a[0][lane], a[1][lane], a[2][lane]]);
            let mut n_new = 0;
            for ray in 0..RAYS {
                let d = [rays[0][ray], rays[1][ray], rays[2][ray]];
                let (u, v, w) = (dot(ab, d), dot(bc, d), dot(ca, d));
                let t = height / dot(normal, d);
                let is_within = (lesser(lesser(u, v), w) >= 0.0) | (greater(greater(u, v), w) <= 0.0);
                let is_first = is_within & (t > 0.0) & (t < first.t[ray]);
                first.t[ray] = if is_first { t } else { first.t[ray] };
                first.thing[ray] = if is_first { self.things[lane] } else { first.thing[ray] };
                n_new += u32::from(is_first);
            }
            is_new |= n_new > 0;
        }
        if is_new {
            first.note_farthest();
        }
    }
}

#[inline(always)]
fn corner(corners: &[[f32; LANES]; 9], at: usize) -> [&[f32; LANES]; 3] {
    [&corners[at], &corners[at + 1], &corners[at + 2]]
}

#[inline(always)]
fn crosses(a: [&[f32; LANES]; 3], b: [&[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
    let mut product = [[0.0; LANES]; 3];
    for (axis, [i, j]) in [[1, 2], [2, 0], [0, 1]].into_iter().enumerate() {
        for lane in 0..LANES {
            product[axis][lane] = a[i][lane] * b[j][lane] - a[j][lane] * b[i][lane];
        }
    }
    product
}

#[inline(always)]
fn less(a: [&[f32; LANES]; 3], b: [&[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
    let mut difference = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for lane in 0..LANES {
            difference[axis][lane] = a[axis][lane] - b[axis][lane];
        }
    }
    difference
}

#[inline(always)]
fn pick(rows: &[[f32; LANES]; 3], lane: usize) -> [f32; 3] {
    [rows[0][lane], rows[1][lane], rows[2][lane]]
}

/// As `f32::min`, but one instruction: there is no NaN to care for.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smallest box around points.
pub(super) fn bounds_of(points: &[[f32; 3]]) -> Bounds {
    points.iter().fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], point| {
        [
            std::array::from_fn(|axis| low[axis].min(point[axis])),
            std::array::from_fn(|axis| high[axis].max(point[axis])),
        ]
    })
}
