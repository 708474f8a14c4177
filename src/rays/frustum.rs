//! A packet of rays with one origin, and the pyramid around them.

/// Rays of a packet.
pub(super) const RAYS: usize = 32;

/// Directions of a packet's rays in one frame: all x, all y, all z.
pub(super) type Directions = [[f32; RAYS]; 3];

/// A plane through a point: its normal times a place, less `offset`, is the signed distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    normal: [f32; 3],
    offset: f32,
    /// Which side of a box, as lower and upper x, y, z, lies lowest, axis by axis.
    lowest: [usize; 3],
}

/// What lies above one of `sides` is met by no ray. `axis` is the rays' mean direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frustum {
    pub sides: [Plane; 4],
    pub axis: Plane,
    /// The longest way that a ray goes along the axis for each unit of its parameter.
    pub reach: f32,
}

/// A turn of axes; rows times a vector of the old frame give one of the new.
pub(super) type Turn = [[f32; 3]; 3];

impl Plane {
    #[inline(always)]
    fn new(normal: [f32; 3], origin: [f32; 3]) -> Self {
        let mut lowest = [0, 1, 2];
        for axis in 0..3 {
            lowest[axis] += if normal[axis] > 0.0 { 0 } else { 3 };
        }
        Self { normal, offset: dot(normal, origin), lowest }
    }

    #[inline(always)]
    fn turn(&self, turn: &Turn, origin: [f32; 3]) -> Self {
        let [x, y, z] = turn;
        Self::new([dot(*x, self.normal), dot(*y, self.normal), dot(*z, self.normal)], origin)
    }

    /// Signed distance of each box's lowest corner.
    #[inline(always)]
    pub(super) fn lowest<const N: usize>(&self, sides: &[[f32; N]; 6]) -> [f32; N] {
        let [x, y, z] = [&sides[self.lowest[0]], &sides[self.lowest[1]], &sides[self.lowest[2]]];
        let [nx, ny, nz] = self.normal;
        let mut lowest = [0.0; N];
        for i in 0..N {
            lowest[i] = nx * x[i] + ny * y[i] + nz * z[i] - self.offset;
        }
        lowest
    }

    /// Signed distance of points relative to the rays' origin.
    #[inline(always)]
    pub(super) fn height<const N: usize>(&self, [x, y, z]: [&[f32; N]; 3]) -> [f32; N] {
        let [nx, ny, nz] = self.normal;
        let mut heights = [0.0; N];
        for i in 0..N {
            heights[i] = nx * x[i] + ny * y[i] + nz * z[i];
        }
        heights
    }
}

impl Frustum {
    /// Around the first `n` rays from `origin`; where they span a right angle or more it may lose some.
    #[inline(always)]
    pub(super) fn new(origin: [f32; 3], [x, y, z]: &Directions, n: usize) -> Self {
        let mut sum = [0.0; 3];
        for i in 0..n {
            let ray = [x[i], y[i], z[i]];
            sum = [sum[0] + ray[0], sum[1] + ray[1], sum[2] + ray[2]];
        }
        let axis = unit(sum);
        let across = if axis[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
        let u = unit(cross(axis, across));
        let v = cross(axis, u);
        let (mut low, mut high, mut reach) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2], 0f32);
        for i in 0..n {
            let ray = [x[i], y[i], z[i]];
            let along = dot(ray, axis);
            reach = reach.max(along);
            let side = [dot(ray, u) / along, dot(ray, v) / along];
            for i in 0..2 {
                low[i] = low[i].min(side[i]);
                high[i] = high[i].max(side[i]);
            }
        }
        let sides = [
            lean(axis, u, high[0], 1.0, origin),
            lean(axis, u, low[0], -1.0, origin),
            lean(axis, v, high[1], 1.0, origin),
            lean(axis, v, low[1], -1.0, origin),
        ];
        Self { sides, axis: Plane::new(axis, origin), reach }
    }

    /// In a frame that is turned, and in which the rays come from `origin`.
    #[inline(always)]
    pub(super) fn turn(&self, turn: &Turn, origin: [f32; 3]) -> Self {
        let [a, b, c, d] = &self.sides;
        let sides = [a.turn(turn, origin), b.turn(turn, origin), c.turn(turn, origin), d.turn(turn, origin)];
        Self { sides, axis: self.axis.turn(turn, origin), reach: self.reach }
    }
}

/// The plane along `to`'s neighbour axis that leans by a slope from `axis` to `to`.
#[inline(always)]
fn lean(axis: [f32; 3], to: [f32; 3], slope: f32, sign: f32, origin: [f32; 3]) -> Plane {
    let [x, y, z] = [to[0] - slope * axis[0], to[1] - slope * axis[1], to[2] - slope * axis[2]];
    Plane::new(unit([sign * x, sign * y, sign * z]), origin)
}

#[inline(always)]
pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn unit(a: [f32; 3]) -> [f32; 3] {
    let length = dot(a, a).sqrt();
    [a[0] / length, a[1] / length, a[2] / length]
}
