//! A dressed body in a pose, as a surface: trunk, limbs, head and hair.
//!
//! Radii are those of a man of 1.75 m with a body mass index of 23 times the body's girth.

use super::outfit::{Hair, Headwear, Lower, Outfit, Upper};
use super::shell::{Hue, Ring, Shell, Vec3};
use super::skeleton::{SIDES, Skeleton};
use super::stature::Body;

/// Corners around a limb, and around the trunk.
pub const LIMB: usize = 8;
pub const TRUNK: usize = 12;

/// Along the trunk from the hips (0) to the shoulders (1): half width and half depth of men and women, metres.
const TRUNK_M: [[f64; 5]; 9] = [
    [-0.16, 0.105, 0.095, 0.110, 0.100],
    [-0.06, 0.158, 0.118, 0.168, 0.122],
    [0.07, 0.168, 0.120, 0.178, 0.122],
    [0.22, 0.155, 0.110, 0.158, 0.106],
    [0.40, 0.143, 0.104, 0.128, 0.094],
    [0.58, 0.150, 0.108, 0.133, 0.102],
    [0.76, 0.164, 0.117, 0.145, 0.124],
    [0.90, 0.168, 0.104, 0.148, 0.100],
    [1.01, 0.115, 0.075, 0.102, 0.068],
];

/// What is made into a surface.
pub struct Dressed<'a> {
    pub body: &'a Body,
    pub outfit: &'a Outfit,
    pub skeleton: &'a Skeleton,
}

impl Dressed<'_> {
    /// Half width and half depth of the bare trunk.
    pub fn trunk_m(&self, t: f64) -> [f64; 2] {
        let Body { girth, belly, .. } = *self.body;
        let sex =
            f64::from(u8::from(self.body.is_female)) * ((self.body.age_years - 9.0) / 7.0).clamp(0.0, 1.0);
        let last = TRUNK_M.len() - 1;
        let next = TRUNK_M.iter().position(|row| row[0] >= t).unwrap_or(last).max(1);
        let (low, high) = (TRUNK_M[next - 1], TRUNK_M[next]);
        let share = ((t - low[0]) / (high[0] - low[0])).clamp(0.0, 1.0);
        let row: [f64; 5] = std::array::from_fn(|i| low[i] + share * (high[i] - low[i]));
        let stout = 1.0 + (belly - 1.0) * (1.0 - ((t - 0.35) / 0.5).powi(2)).max(0.0);
        let width_m = girth * stout * (row[1] + sex * (row[3] - row[1]));
        let depth_m = girth * stout.powf(1.6) * (row[2] + sex * (row[4] - row[2]));
        // Shoulders are as wide as their bones, whatever the girth.
        let bones = ((t - 0.7) / 0.25).clamp(0.0, 1.0) * if t > 0.95 { 0.3 } else { 0.8 };
        let wide_m = 0.93 * self.body.half_shoulders_m;
        [width_m + bones * (wide_m - width_m), depth_m]
    }

    /// A point of the spine, the way up there, and to the left.
    pub fn spine(&self, t: f64) -> (Vec3, Vec3, Vec3) {
        let s = self.skeleton;
        let (lower, upper) = (s.waist - s.pelvis, s.chest - s.waist);
        let at = if t < 0.42 { s.pelvis + lower * (t / 0.42) } else { s.waist + upper * ((t - 0.42) / 0.58) };
        let up = lower.normalize().lerp(&upper.normalize(), ((t - 0.2) / 0.5).clamp(0.0, 1.0)).normalize();
        let left = s.pelvis_left.lerp(&s.chest_left, t.clamp(0.0, 1.0));
        (at, up, left)
    }

    /// A ring around the trunk, this far outside of the body.
    pub fn trunk_ring(&self, t: f64, out_m: f64) -> Ring {
        let (at, up, left) = self.spine(t);
        let [a_m, b_m] = self.trunk_m(t);
        // The belly and the chest bulge forwards, the seat backwards.
        let forward = left.cross(&up);
        let shift = if t < 0.12 { -0.012 } else { 0.008 + 0.02 * (self.body.belly - 1.0) };
        let center = at + forward * (shift * self.body.height_m / 1.75);
        Ring::new(center, &up, &left, a_m + out_m, b_m + out_m)
    }

    /// The trunk from the seat to the neck, with what the upper part wears.
    pub fn add_trunk(&self, shell: &mut Shell) {
        let Outfit { upper, lower, ease_m, .. } = *self.outfit;
        let (out_m, hem) = match upper {
            Upper::Shirt => (ease_m, -0.02),
            Upper::Pullover => (1.2 * ease_m, 0.0),
            Upper::Jacket => (1.9 * ease_m, -0.1),
            Upper::Coat(_) => (2.1 * ease_m, -0.12),
        };
        let tone = if matches!(lower, Lower::Dress(_)) { Hue::Top } else { Hue::Legs };
        let seat: Vec<Ring> = [-0.16, -0.06, 0.07, 0.2]
            .map(|t| self.trunk_ring(t, if t < -0.1 { 0.0 } else { 0.8 * ease_m }))
            .into();
        shell.tube(tone, TRUNK, &seat);
        // Bands across the trunk are pieces of their own.
        let stations = [hem, 0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.93, 1.01];
        let ring = |t: f64| self.trunk_ring(t, if t > 1.0 { 0.6 * out_m } else { out_m });
        if self.outfit.is_striped {
            for (i, pair) in stations.windows(2).enumerate() {
                let tone = if i % 2 == 0 { Hue::Top } else { Hue::Accent };
                shell.tube(tone, TRUNK, &[ring(pair[0]), ring(pair[1])]);
            }
        } else {
            shell.tube(Hue::Top, TRUNK, &stations.map(ring));
        }
        // From the shoulders to the neck.
        let (s, h) = (self.skeleton, self.body.height_m);
        let neck = s.head - s.head_axes[2] * (0.3 * self.body.head_m) - s.head_axes[0] * (0.008 * h);
        let collar = s.chest.lerp(&neck, 0.3);
        let slope = [ring(1.0), Ring::new(collar, &s.chest_up, &s.chest_left, 0.047 * h, 0.042 * h)];
        shell.tube(Hue::Top, TRUNK, &slope);
        let girth = self.body.girth.clamp(0.6, 1.2);
        let around = |at: Vec3, radius_m: f64| {
            Ring::new(at, &(neck - s.chest), &s.chest_left, radius_m * girth, 1.05 * radius_m * girth)
        };
        let base = s.chest - s.chest_up * (0.02 * h);
        shell.tube(Hue::Skin, LIMB, &[around(base, 0.062), around(collar, 0.057), around(neck, 0.055)]);
        let is_thick = self.outfit.has_scarf || self.outfit.headwear == Headwear::Hood;
        if is_thick || matches!(upper, Upper::Coat(_)) {
            let tone = if self.outfit.has_scarf { Hue::Accent } else { Hue::Top };
            let wide = if is_thick { 0.088 } else { 0.076 };
            let low = s.chest + s.chest_up * (0.004 * h);
            let rings =
                [around(low, 1.1 * wide), around(low.lerp(&neck, 0.5), wide), around(neck, 0.8 * wide)];
            shell.tube(tone, LIMB, &rings);
        }
    }

    pub fn add_hand(&self, shell: &mut Shell, i: usize) {
        let (s, body) = (self.skeleton, self.body);
        // A hand: the palm's side faces the body.
        let (wrist, along) = (s.wrists[i], s.hand(i));
        let inward = s.chest_left * -SIDES[i];
        let ring = |share: f64, wide: f64, thick: f64| {
            let scale = body.hand_m / 0.175;
            Ring::new(wrist + along * (share * body.hand_m), &along, &inward, thick * scale, wide * scale)
        };
        let rings = [
            ring(-0.1, 0.027, 0.022),
            ring(0.25, 0.043, 0.02),
            ring(0.6, 0.04, 0.022),
            ring(0.95, 0.018, 0.012),
        ];
        shell.tube(Hue::Skin, 6, &rings);
    }

    pub fn add_head(&self, shell: &mut Shell) {
        let [forward, left, up] = self.skeleton.head_axes;
        let head_m = self.body.head_m;
        // From the chin to the crown: height, half width, half depth and shift forwards, as parts of the head's height.
        let rows = [
            (-0.50, 0.10, 0.09, 0.20),
            (-0.44, 0.20, 0.24, 0.12),
            (-0.30, 0.27, 0.34, 0.05),
            (-0.12, 0.31, 0.39, 0.02),
            (0.08, 0.335, 0.42, 0.0),
            (0.25, 0.32, 0.41, -0.02),
            (0.39, 0.25, 0.33, -0.03),
            (0.48, 0.12, 0.16, -0.03),
            (0.50, 0.01, 0.01, -0.03),
        ];
        let rings = rows.map(|(z, a, b, x)| Ring {
            center: self.skeleton.head + (up * z + forward * x) * head_m,
            a: left * (a * head_m),
            b: -forward * (b * head_m),
        });
        shell.tube(Hue::Skin, 10, &rings);
        let nose = self.skeleton.head + (forward * 0.41 - up * 0.08) * head_m;
        shell.ball(Hue::Skin, [5, 3], nose, [forward, left, up].map(|axis| axis * (0.06 * head_m)));
    }

    /// A part of an ellipsoid around the head: from a height up, grown, and shifted backwards.
    fn cap(&self, shell: &mut Shell, tone: Hue, [from, grow, back]: [f64; 3]) {
        let [forward, left, up] = self.skeleton.head_axes;
        let head_m = self.body.head_m;
        let rings: Vec<Ring> = (0..=5)
            .map(|i| {
                let z = from + (0.53 - from) * f64::from(i) / 5.0;
                let round = (1.0 - ((z - 0.04) / 0.49).powi(2)).max(4e-4).sqrt();
                Ring {
                    center: self.skeleton.head + (up * z - forward * back) * head_m,
                    a: left * (0.335 * grow * round * head_m),
                    b: -forward * (0.42 * grow * round * head_m),
                }
            })
            .collect();
        shell.tube(tone, 10, &rings);
    }

    /// Hair, or what the head wears.
    pub fn add_hair(&self, shell: &mut Shell) {
        let [forward, left, up] = self.skeleton.head_axes;
        let (head, head_m) = (self.skeleton.head, self.body.head_m);
        let at = |x: f64, z: f64| head + (forward * x + up * z) * head_m;
        let fall = |shell: &mut Shell, tone: Hue, rows: &[(f64, f64, f64, f64)]| {
            let ring = |&(x, z, a, b): &(f64, f64, f64, f64)| Ring {
                center: at(x, z),
                a: left * (a * head_m),
                b: -forward * (b * head_m),
            };
            shell.tube(tone, 10, &rows.iter().map(ring).collect::<Vec<_>>());
        };
        match self.outfit.headwear {
            Headwear::Hood | Headwear::Scarf => {
                let tone = if self.outfit.headwear == Headwear::Hood { Hue::Top } else { Hue::Hat };
                self.cap(shell, tone, [-0.1, 1.16, 0.07]);
                fall(
                    shell,
                    tone,
                    &[(-0.14, 0.1, 0.39, 0.40), (-0.1, -0.35, 0.39, 0.38), (-0.06, -0.72, 0.46, 0.42)],
                );
                return;
            }
            Headwear::Cap => {
                self.cap(shell, Hue::Hat, [0.1, 1.1, 0.01]);
                let edges = [(forward - up * 0.15) * 0.16, left * 0.26, up * 0.02].map(|edge| edge * head_m);
                shell.slab(Hue::Hat, at(0.52, 0.13), edges);
            }
            Headwear::Beanie => self.cap(shell, Hue::Hat, [0.02, 1.12, 0.03]),
            Headwear::Brim => {
                fall(shell, Hue::Hat, &[(0.0, 0.16, 0.72, 0.78), (0.0, 0.2, 0.72, 0.78)]);
                fall(
                    shell,
                    Hue::Hat,
                    &[(0.0, 0.18, 0.38, 0.45), (-0.01, 0.5, 0.34, 0.4), (-0.01, 0.6, 0.26, 0.32)],
                );
            }
            Headwear::None => {}
        }
        let hair = self.outfit.hair;
        if hair == Hair::None {
            return;
        }
        self.cap(shell, Hue::Hair, [if hair == Hair::Short { -0.16 } else { -0.3 }, 1.08, 0.052]);
        match hair {
            Hair::Bob => fall(
                shell,
                Hue::Hair,
                &[(-0.1, 0.1, 0.37, 0.36), (-0.1, -0.3, 0.38, 0.33), (-0.1, -0.5, 0.34, 0.28)],
            ),
            Hair::Long => fall(
                shell,
                Hue::Hair,
                &[
                    (-0.1, 0.1, 0.37, 0.36),
                    (-0.13, -0.4, 0.4, 0.3),
                    (-0.24, -0.85, 0.44, 0.2),
                    (-0.28, -1.25, 0.3, 0.1),
                ],
            ),
            Hair::Tail => fall(
                shell,
                Hue::Hair,
                &[
                    (-0.42, 0.28, 0.08, 0.08),
                    (-0.6, 0.1, 0.13, 0.12),
                    (-0.62, -0.3, 0.12, 0.1),
                    (-0.55, -0.7, 0.03, 0.03),
                ],
            ),
            Hair::Bun => {
                let size = 0.17 * head_m;
                shell.ball(Hue::Hair, [6, 4], at(-0.5, 0.22), [forward, left, up].map(|axis| axis * size));
            }
            Hair::None | Hair::Short => {}
        }
    }
}
