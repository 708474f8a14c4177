//! Legs and what covers them, sleeves, and cloth that hangs around both legs.

use super::figure::{Dressed, LIMB, TRUNK};
use super::outfit::{Lower, Upper};
use super::shell::{Hue, Ring, Shell, Vec3};
use super::skeleton::SIDES;

/// Along a leg from the hip (0) to the ankle (1): radius, metres.
const LEG_M: [[f64; 2]; 9] = [
    [-0.02, 0.084],
    [0.12, 0.087],
    [0.3, 0.071],
    [0.44, 0.058],
    [0.5, 0.057],
    [0.56, 0.055],
    [0.7, 0.056],
    [0.86, 0.043],
    [1.0, 0.038],
];

fn radius_at(table: &[[f64; 2]], t: f64) -> f64 {
    let next = table.iter().position(|row| row[0] >= t).unwrap_or(table.len() - 1).max(1);
    let (low, high) = (table[next - 1], table[next]);
    low[1] + ((t - low[0]) / (high[0] - low[0])).clamp(0.0, 1.0) * (high[1] - low[1])
}

/// How thick a leg is there: girth tells at the thigh, bones at the ankle.
fn leg_radius_m(figure: &Dressed, t: f64) -> f64 {
    let bones = figure.body.height_m / 1.75;
    let soft = figure.body.girth * if figure.body.is_female { 1.04 } else { 1.0 };
    let share = t.clamp(0.0, 1.0);
    radius_at(&LEG_M, t) * (soft + (bones - soft) * share)
}

fn leg_ring(figure: &Dressed, i: usize, t: f64, radius_m: f64) -> Ring {
    let (at, along) = figure.skeleton.leg_at(i, t.max(0.0));
    let at = at + along * (t.min(0.0) * figure.body.leg_m());
    Ring::new(at, &along, &figure.skeleton.pelvis_left, radius_m, 1.05 * radius_m)
}

/// Both legs with trousers, shorts or bare, and shoes.
pub fn legs(figure: &Dressed, shell: &mut Shell) {
    let outfit = figure.outfit;
    let ease_m = outfit.ease_m;
    let stations = LEG_M.map(|row| row[0]);
    for i in 0..2 {
        let bare = |t: f64| leg_ring(figure, i, t, leg_radius_m(figure, t));
        match outfit.lower {
            Lower::Trousers(flare) => {
                let hem_m = flare * radius_at(&LEG_M, 1.0) * figure.body.height_m / 1.75;
                let rings = stations.map(|t| {
                    let close_m = leg_radius_m(figure, t) + ease_m * 0.8;
                    // Below the knee the cloth falls straight to the hem.
                    let straight_m = hem_m.max(close_m * 0.9);
                    let radius_m = close_m + (straight_m - close_m) * ((t - 0.5) / 0.4).clamp(0.0, 1.0);
                    leg_ring(figure, i, t, radius_m)
                });
                shell.tube(Hue::Legs, LIMB, &rings);
            }
            Lower::Shorts(hem) => {
                let rings = [-0.02, 0.5 * hem, hem]
                    .map(|t| leg_ring(figure, i, t, leg_radius_m(figure, t) + 1.5 * ease_m));
                shell.tube(Hue::Legs, LIMB, &rings);
                shell.tube(Hue::Skin, LIMB, &[hem - 0.05, 0.44, 0.5, 0.56, 0.7, 0.86, 1.0].map(bare));
            }
            Lower::Skirt(_) | Lower::Dress(_) => {
                let tone = if outfit.bare_legs { Hue::Skin } else { Hue::Dark };
                shell.tube(tone, LIMB, &stations.map(bare));
            }
        }
        shoe(figure, shell, i);
    }
}

fn shoe(figure: &Dressed, shell: &mut Shell, i: usize) {
    let [forward, up] = figure.skeleton.feet[i];
    let (ankle, body) = (figure.skeleton.ankles[i], figure.body);
    let left = up.cross(&forward);
    let wide_m = 0.029 * body.height_m;
    // Along the foot: place, height of the upper and width, as parts of length, of the ankle's height and of the width.
    let rows = [
        (-0.27, 0.5, 0.5),
        (-0.22, 1.0, 0.78),
        (-0.02, 1.25, 0.86),
        (0.18, 1.0, 0.92),
        (0.42, 0.66, 1.08),
        (0.62, 0.5, 0.95),
        (0.74, 0.35, 0.5),
    ];
    // A foot that rolls off bends at its ball: the toes stay flat.
    let ball = 0.52;
    let toes = Vec3::new(forward.x, forward.y, forward.z.max(0.08 * forward.z)).normalize();
    let sole = ankle + forward * (ball * body.foot_m) - up * body.ankle_m;
    let rings = rows.map(|(x, high, wide)| {
        let high_m = high * body.ankle_m;
        let (along, up) = if x > ball { (toes, toes.cross(&left)) } else { (forward, up) };
        let center = sole + along * ((x - ball) * body.foot_m) + up * (high_m / 2.0);
        Ring { center, a: left * (wide * wide_m), b: up * (high_m / 2.0) }
    });
    shell.tube(Hue::Shoes, LIMB, &rings);
}

/// Skirts, dresses and the lower parts of coats: rings around both legs, from the waist down.
pub fn drape(figure: &Dressed, shell: &mut Shell) {
    let outfit = figure.outfit;
    if let Lower::Skirt(hem) | Lower::Dress(hem) = outfit.lower {
        let tone = if matches!(outfit.lower, Lower::Dress(_)) { Hue::Top } else { Hue::Legs };
        hang(figure, shell, tone, hem, 0.9 * outfit.ease_m, 0.10 * hem);
    }
    if let Upper::Coat(hem) = outfit.upper {
        hang(figure, shell, Hue::Top, hem, 2.2 * outfit.ease_m, 0.05 * hem);
    }
}

fn hang(figure: &Dressed, shell: &mut Shell, tone: Hue, hem: f64, out_m: f64, flare_m: f64) {
    let s = figure.skeleton;
    let mut rings: Vec<Ring> = [0.3, 0.08].map(|t| figure.trunk_ring(t, out_m)).into();
    let n = if hem > 0.5 { 5 } else { 3 };
    for step in 0..=n {
        let share = 0.04 + (hem - 0.04) * f64::from(step) / f64::from(n);
        let ([left, way_l], [right, way_r]) =
            ([0, 1].map(|i| s.leg_at(i, share))).map(|(at, way)| [at, way]).into();
        let along = (way_l + way_r).normalize();
        let across = s.pelvis_left;
        let ring = Ring::new((left + right) / 2.0, &along, &across, 1.0, 1.0);
        let apart = left - right;
        let radius_m = leg_radius_m(figure, share) + out_m + flare_m * share;
        // Cloth hangs from the hips: it is never much narrower than they are.
        let [hip_a, hip_b] = figure.trunk_m(0.05).map(|half_m| 0.92 * (half_m + out_m));
        let half = |axis: &Vec3, least_m: f64| (apart.dot(axis).abs() * 0.5 + radius_m).max(least_m);
        rings.push(Ring { a: ring.a * half(&ring.a, hip_a), b: ring.b * half(&ring.b, hip_b), ..ring });
    }
    shell.tube(tone, TRUNK, &rings);
}

/// Along an arm from the shoulder (0) over the elbow (1) to the wrist (2): radius, metres.
const ARM_M: [[f64; 2]; 7] =
    [[-0.06, 0.048], [0.2, 0.055], [0.6, 0.045], [1.0, 0.041], [1.3, 0.042], [1.7, 0.033], [2.0, 0.027]];

/// One arm, bare, in part or wholly in a sleeve.
pub fn arm_sleeve(figure: &Dressed, shell: &mut Shell, i: usize) {
    let girth = 0.35 * figure.body.height_m / 1.75 + 0.65 * figure.body.girth;
    let (s, outfit) = (figure.skeleton, figure.outfit);
    let (shoulder, elbow, wrist) = (s.shoulders[i], s.elbows[i], s.wrists[i]);
    let (upper, lower) = ((elbow - shoulder).normalize(), (wrist - elbow).normalize());
    let side = s.chest_left * SIDES[i];
    let toward = if upper.cross(&side).norm() > 0.2 { side } else { s.chest_up };
    let ring = |t: f64, out_m: f64| {
        let at = if t < 1.0 { shoulder + (elbow - shoulder) * t } else { elbow.lerp(&wrist, t - 1.0) };
        let along = upper.lerp(&lower, ((t - 0.85) / 0.3).clamp(0.0, 1.0)).normalize();
        let radius_m = radius_at(&ARM_M, t) * girth + out_m;
        Ring::new(at, &along, &toward, radius_m, radius_m)
    };
    let ease_m = outfit.ease_m;
    let (out_m, sleeve) = match outfit.upper {
        Upper::Shirt => (1.1 * ease_m, 0.62),
        Upper::Pullover => (0.9 * ease_m, 1.97),
        Upper::Jacket | Upper::Coat(_) => (1.5 * ease_m, 2.03),
    };
    let stations = [-0.06, 0.2, 0.6, 0.88, 1.12, 1.3, 1.7, 2.0];
    let mut sleeved: Vec<Ring> =
        stations.iter().filter(|t| **t < sleeve - 0.05).map(|&t| ring(t, out_m)).collect();
    sleeved.push(ring(sleeve.min(2.0), out_m));
    // The top of the shoulder is round.
    let top = ring(-0.06, 0.35 * out_m);
    sleeved.insert(0, Ring { center: top.center - upper * (0.02 * girth), a: top.a * 0.6, b: top.b * 0.6 });
    shell.tube(Hue::Top, LIMB, &sleeved);
    if sleeve < 1.9 {
        let bare: Vec<Ring> =
            [sleeve - 0.1, 0.88, 1.12, 1.3, 1.7, 2.0].iter().map(|&t| ring(t, 0.0)).collect();
        shell.tube(Hue::Skin, LIMB, &bare);
    }
}
