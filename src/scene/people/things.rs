//! What people carry, push and sit in.

use super::figure::Dressed;
use super::outfit::Luggage;
use super::poses::{Holds, WHEELCHAIR_M};
use super::shell::{Hue, Ring, Shell, Vec3};
use super::skeleton::SIDES;

/// Bags on the body, and what the hands hold.
pub fn carry(figure: &Dressed, holds: Holds, shell: &mut Shell) {
    let (s, body) = (figure.skeleton, figure.body);
    let h = body.height_m;
    let (forward, left, up) = (s.chest_forward(), s.chest_left, s.chest_up);
    match figure.outfit.bag {
        Luggage::None => {}
        Luggage::Backpack => {
            let [_, depth_m] = figure.trunk_m(0.7);
            let size = h * (0.8 + 0.4 * figure.outfit.reflectivity);
            let center = s.waist.lerp(&s.chest, 0.5) - forward * (depth_m + 0.042 * size) + up * (0.01 * h);
            let row = |z: f64, wide: f64, deep: f64| Ring {
                center: center + up * (z * size),
                a: left * (wide * size),
                b: forward * (deep * size),
            };
            let rings = [
                row(-0.125, 0.072, 0.04),
                row(-0.11, 0.088, 0.056),
                row(-0.02, 0.09, 0.06),
                row(0.08, 0.082, 0.045),
                row(0.115, 0.05, 0.025),
            ];
            shell.tube(Hue::Bag, 10, &rings);
            for side in SIDES {
                let top = s.chest + left * (side * 0.5 * body.half_shoulders_m) + up * (0.025 * h);
                let front = top + forward * (depth_m + 0.012 * h) - up * (0.05 * h);
                let low = s.waist + left * (side * 0.09 * h) + forward * (0.5 * depth_m);
                shell.rod(Hue::Bag, top - forward * depth_m, front, 0.012);
                shell.rod(Hue::Bag, front, low, 0.012);
            }
        }
        Luggage::Shoulder(i) => {
            let [wide_m, depth_m] = figure.trunk_m(0.05);
            let left = s.pelvis_left;
            let at = s.pelvis + left * (SIDES[i] * (wide_m + 0.05)) + Vec3::z() * (0.01 * h);
            shell.slab(Hue::Bag, at, [Vec3::x() * (0.085 * h), left * 0.035, Vec3::z() * (0.06 * h)]);
            let top = s.chest - s.chest_left * (SIDES[i] * 0.6 * body.half_shoulders_m) + up * (0.02 * h);
            for way in [1.0, -1.0] {
                let chest = s.waist.lerp(&s.chest, 0.5) + forward * (way * (depth_m + 0.03));
                shell.rod(Hue::Bag, top, chest, 0.009);
                shell.rod(Hue::Bag, chest, at + Vec3::z() * (0.05 * h), 0.009);
            }
        }
    }
    match holds {
        Holds::Nothing | Holds::Bar => {}
        Holds::Umbrella(i) => umbrella(figure, i, shell),
        Holds::Bag(i) => {
            let hand = s.wrists[i] - Vec3::z() * (0.8 * body.hand_m);
            let size = h * (0.75 + 0.6 * figure.outfit.ease_m / 0.03);
            let row = |z: f64, long: f64, wide: f64| Ring {
                center: hand - Vec3::z() * z,
                a: Vec3::x() * (long * size),
                b: Vec3::y() * (wide * size),
            };
            let rings = [
                row(0.1, 0.07, 0.012),
                row(0.13, 0.085, 0.035),
                row(0.3 * h, 0.1, 0.05),
                row(0.32 * h, 0.08, 0.04),
            ];
            // A short person's bag ends above the ground.
            let lift_m = (0.04 - (hand.z - 0.32 * h)).max(0.0);
            let lifted = rings.map(|ring| Ring { center: ring.center + Vec3::z() * lift_m, ..ring });
            shell.tube(Hue::Thing, 8, &lifted);
            for side in [-1.0, 1.0] {
                shell.rod(Hue::Thing, hand, lifted[1].center + Vec3::x() * (side * 0.05 * h), 0.006);
            }
        }
        Holds::Crate => {
            let middle = (s.wrists[0] + s.wrists[1]) / 2.0 + forward * (0.075 * h) + Vec3::z() * (0.03 * h);
            let half = [forward * (0.09 * h), left * (0.11 * h), forward.cross(&left) * (0.08 * h)];
            shell.slab(Hue::Thing, middle, half);
        }
        Holds::Phone(i) | Holds::Call(i) => {
            let along = s.hand(i);
            let at = s.wrists[i] + along * (0.75 * body.hand_m);
            let across = along.cross(&left).normalize();
            let [long, wide, thin] = [along * 0.075, along.cross(&across) * 0.038, across * 0.007];
            shell.slab(Hue::Dark, at + across * 0.02, [long, wide, thin]);
        }
    }
}

fn umbrella(figure: &Dressed, i: usize, shell: &mut Shell) {
    let (s, h) = (figure.skeleton, figure.body.height_m);
    let hand = s.wrists[i] + s.hand(i) * (0.5 * figure.body.hand_m);
    let over = s.head + Vec3::z() * (0.5 * figure.body.head_m + 0.12 * h);
    let top = Vec3::new(0.6 * hand.x + 0.4 * over.x, 0.6 * hand.y + 0.4 * over.y, over.z + 0.1 * h);
    shell.rod(Hue::Dark, hand - Vec3::z() * (0.06 * h), top + Vec3::z() * 0.05, 0.009);
    let radius_m = 0.3 * h;
    let ring = |wide: f64, down: f64| Ring {
        center: top - Vec3::z() * (down * h),
        a: Vec3::x() * (wide * radius_m),
        b: Vec3::y() * (wide * radius_m),
    };
    // Two skins, so that the hollow below can be seen.
    shell.tube(Hue::Hat, 8, &[ring(1.0, 0.115), ring(0.8, 0.065), ring(0.45, 0.02), ring(0.02, 0.0)]);
}

/// A wheelchair around the origin: the seat's middle over it.
pub fn wheelchair(shell: &mut Shell) {
    let x = Vec3::x;
    for side in SIDES {
        let y = 0.29 * side;
        shell.wheel(Hue::Dark, Vec3::new(-0.12, y, 0.3), 0.3, 0.035);
        shell.wheel(Hue::Dark, Vec3::new(0.34, 0.22 * side, 0.08), 0.08, 0.035);
        let y = 0.22 * side;
        let corners = [
            [-0.26, 1.0, -0.22, 0.2],
            [-0.22, WHEELCHAIR_M - 0.06, 0.22, WHEELCHAIR_M - 0.06],
            [0.22, WHEELCHAIR_M - 0.06, 0.34, 0.1],
            [-0.22, WHEELCHAIR_M + 0.18, 0.14, WHEELCHAIR_M + 0.18],
            [0.14, WHEELCHAIR_M + 0.18, 0.16, WHEELCHAIR_M - 0.06],
            [-0.22, 0.2, 0.26, 0.2],
            [-0.26, 1.0, -0.38, 1.02],
            [0.3, 0.2, 0.46, 0.11],
        ];
        for [x0, z0, x1, z1] in corners {
            shell.rod(Hue::Accent, Vec3::new(x0, y, z0), Vec3::new(x1, y, z1), 0.013);
        }
        shell.slab(
            Hue::Dark,
            Vec3::new(0.5, 0.11 * side, 0.1),
            [x() * 0.09, Vec3::y() * 0.07, Vec3::z() * 0.008],
        );
    }
    shell.slab(
        Hue::Bag,
        Vec3::new(0.0, 0.0, WHEELCHAIR_M - 0.04),
        [x() * 0.22, Vec3::y() * 0.21, Vec3::z() * 0.03],
    );
    shell.slab(Hue::Bag, Vec3::new(-0.25, 0.0, 0.75), [x() * 0.015, Vec3::y() * 0.21, Vec3::z() * 0.22]);
}

/// A pram with its hood, the bar at the rear; the origin is the middle of its wheels.
pub fn pram(shell: &mut Shell) {
    for side in SIDES {
        shell.wheel(Hue::Dark, Vec3::new(-0.28, 0.25 * side, 0.14), 0.14, 0.035);
        shell.wheel(Hue::Dark, Vec3::new(0.3, 0.22 * side, 0.1), 0.1, 0.035);
        let y = 0.22 * side;
        for [x0, z0, x1, z1] in [
            [-0.28, 0.14, 0.12, 0.6],
            [0.3, 0.1, -0.2, 0.62],
            [-0.2, 0.62, -0.52, 1.02],
            [0.12, 0.6, -0.2, 0.62],
        ] {
            shell.rod(Hue::Accent, Vec3::new(x0, y, z0), Vec3::new(x1, y, z1), 0.014);
        }
    }
    shell.rod(Hue::Dark, Vec3::new(-0.52, 0.23, 1.02), Vec3::new(-0.52, -0.23, 1.02), 0.018);
    let ring = |x: f64, z: f64, wide: f64, high: f64| Ring {
        center: Vec3::new(x, 0.0, z),
        a: Vec3::y() * wide,
        b: Vec3::z() * high,
    };
    shell.tube(
        Hue::Top,
        10,
        &[
            ring(-0.4, 0.66, 0.15, 0.07),
            ring(-0.34, 0.65, 0.21, 0.12),
            ring(0.3, 0.64, 0.2, 0.1),
            ring(0.42, 0.67, 0.13, 0.05),
        ],
    );
    // The hood stands over the rear half.
    let rings: Vec<Ring> = (0..=5)
        .map(|i| {
            let (sin, cos) = (0.35 + 0.42 * f64::from(i)).sin_cos();
            let along = Vec3::new(0.34 * cos, 0.0, 0.34 * sin);
            Ring { center: Vec3::new(-0.1, 0.0, 0.66) + along * 0.52, a: Vec3::y() * 0.225, b: along * 0.5 }
        })
        .collect();
    shell.tube(Hue::Hat, 8, &rings);
    shell.slab(Hue::Bag, Vec3::new(0.0, 0.0, 0.3), [Vec3::x() * 0.22, Vec3::y() * 0.18, Vec3::z() * 0.07]);
}

/// A shopping trolley of wire, half full, the bar at the rear.
pub fn trolley(shell: &mut Shell) {
    for (x, y) in [(-0.3, 0.22), (-0.3, -0.22), (0.3, 0.16), (0.3, -0.16)] {
        shell.wheel(Hue::Dark, Vec3::new(x, y, 0.06), 0.06, 0.03);
    }
    let steel = Hue::Accent;
    let corner = |x: f64, z: f64| {
        let wide = 0.26 - 0.08 * (x + 0.3) - 0.07 * (0.98 - z);
        Vec3::new(x, wide, z)
    };
    let mirror = |at: Vec3| Vec3::new(at.x, -at.y, at.z);
    for side in [|at: Vec3| at, mirror] {
        let bars = [
            [corner(-0.4, 0.98), corner(0.42, 0.98)],
            [corner(-0.36, 0.78), corner(0.41, 0.8)],
            [corner(-0.33, 0.56), corner(0.4, 0.6)],
            [corner(-0.4, 0.98), corner(-0.3, 0.12)],
            [corner(-0.3, 0.15), corner(0.36, 0.12)],
            [corner(-0.33, 0.56), corner(-0.2, 0.14)],
        ];
        for [from, to] in bars {
            shell.rod(steel, side(from), side(to), 0.011);
        }
        for i in 0..7 {
            let x = -0.32 + 0.12 * f64::from(i);
            shell.rod(steel, side(corner(x, 0.57)), side(corner(x, 0.98)), 0.006);
        }
    }
    for (x, z) in [(-0.4, 0.98), (0.42, 0.98), (0.41, 0.8), (0.4, 0.6), (-0.33, 0.56), (0.36, 0.12)] {
        shell.rod(steel, corner(x, z), mirror(corner(x, z)), 0.011);
    }
    for i in 0..5 {
        let x = -0.25 + 0.14 * f64::from(i);
        shell.rod(steel, corner(x, 0.58), mirror(corner(x, 0.58)), 0.006);
    }
    shell.rod(Hue::Hat, corner(-0.44, 1.02), mirror(corner(-0.44, 1.02)), 0.018);
    shell.slab(
        Hue::Thing,
        Vec3::new(0.1, 0.03, 0.68),
        [Vec3::x() * 0.22, Vec3::y() * 0.13, Vec3::z() * 0.08],
    );
    shell.slab(Hue::Bag, Vec3::new(-0.12, -0.05, 0.72), [Vec3::x() * 0.1, Vec3::y() * 0.1, Vec3::z() * 0.12]);
}

/// The bag on the ground that someone bends to.
pub fn bag_on_ground(figure: &Dressed, shell: &mut Shell) {
    let h = figure.body.height_m;
    let middle = (figure.skeleton.wrists[0] + figure.skeleton.wrists[1]) / 2.0;
    let size = 0.11 * h;
    let center = Vec3::new(middle.x + 0.03 * h, middle.y, size);
    let ring = |z: f64, wide: f64| Ring {
        center: center + Vec3::z() * (z * size),
        a: Vec3::x() * (0.8 * wide * size),
        b: Vec3::y() * (1.3 * wide * size),
    };
    shell.tube(Hue::Thing, 10, &[ring(-1.0, 0.9), ring(-0.8, 1.0), ring(0.4, 0.9), ring(0.9, 0.5)]);
}
