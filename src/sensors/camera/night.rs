//! Light at night: the car's headlamps, street lamps, the city's glow, and what shines by itself.
//!
//! Illuminance E = I cos(incidence) / d^2 in lux from the lamps' luminous intensities I in candela; a
//! thing of albedo a reflects a E, and the exposure maps that to the display with a soft shoulder,
//! 1 - exp(-a E / E_white). The headlamps' low beam has its sharp edge just below the horizon, as ECE R112
//! demands. Lamps cast no shadows. Light is worked out for every second pixel.

use std::sync::LazyLock;

use nalgebra::{Point3, Vector3};

use super::picture::{Colour, Picture, View, mix};
use super::shot::{Material, Rendered, StreetLamp};
use super::table::Table;

/// Illuminance at which white shows as nearly white.
const WHITE_LUX: f32 = 16.0;
/// Illuminance of a lit city's sky on everything.
const AMBIENT_LUX: Colour = [0.42, 0.44, 0.52];
/// Luminous intensity of a street lamp, straight down.
const STREET_LAMP_CD: f32 = 900.0;
const STREET_LAMP: Colour = [1.0, 0.82, 0.58];
/// Street lamps farther than this from a thing leave it dark.
const STREET_LAMP_REACH_M: f32 = 28.0;
/// Most lamps that light one picture.
const MAX_LAMPS: usize = 12;
const HEADLAMP: Colour = [1.0, 0.96, 0.86];
/// The ego's headlamps in the ego frame: x forward, y to both sides, height.
const HEADLAMP_X_M: f32 = 3.3;
const HEADLAMP_Y_M: f32 = 0.62;
const HEADLAMP_Z_M: f32 = 0.66;
/// Width of the pixels on which glow is spread.
const GLOW_CELL_PX: usize = 4;

/// Luminous intensity of one low beam, by angles to the left and up in radians.
fn low_beam_cd(left_rad: f32, up_rad: f32) -> f32 {
    let bell = |x: f32, width_deg: f32| (-(x / width_deg.to_radians()).powi(2)).exp();
    let deg = std::f32::consts::PI / 180.0;
    // 0 above the edge, 1 below.
    let below = ((-0.4 * deg - up_rad) / (0.5 * deg)).clamp(0.0, 1.0);
    let hot = 17_000.0 * bell(left_rad, 13.0) * bell(up_rad + 1.4 * deg, 3.0);
    let wide = 5_500.0 * bell(left_rad, 33.0) * bell(up_rad + 6.0 * deg, 9.0);
    (hot + wide) * (0.035 + 0.965 * below)
}

/// Luminous intensity of one low beam by the tangents of both angles.
#[derive(Debug, Clone)]
struct LowBeam(Vec<f32>);

impl LowBeam {
    const LEFT_STEPS_PER_UNIT: f32 = 64.0;
    const UP_STEPS_PER_UNIT: f32 = 512.0;
    /// Tangents within which it is tabulated; beyond them the edge's value holds.
    const LEFT: f32 = 2.5;
    const DOWN: f32 = 1.0;
    const UP: f32 = 0.25;
    const N_LEFT: usize = (2.0 * Self::LEFT * Self::LEFT_STEPS_PER_UNIT) as usize + 1;
    const N_UP: usize = ((Self::DOWN + Self::UP) * Self::UP_STEPS_PER_UNIT) as usize + 1;

    fn new() -> Self {
        let left = |i: usize| (i as f32 / Self::LEFT_STEPS_PER_UNIT - Self::LEFT).atan();
        let up = |j: usize| (j as f32 / Self::UP_STEPS_PER_UNIT - Self::DOWN).atan();
        let rows = 0..Self::N_UP;
        Self(rows.flat_map(|j| (0..Self::N_LEFT).map(move |i| low_beam_cd(left(i), up(j)))).collect())
    }

    /// Luminous intensity along a ray with these parts forward (above zero), to the left and up.
    fn cd(&self, forward: f32, left: f32, up: f32) -> f32 {
        let i = (left / forward + Self::LEFT) * Self::LEFT_STEPS_PER_UNIT + 0.5;
        let j = (up / forward + Self::DOWN) * Self::UP_STEPS_PER_UNIT + 0.5;
        let i = i.clamp(0.0, (Self::N_LEFT - 1) as f32) as i32 as usize;
        let j = j.clamp(0.0, (Self::N_UP - 1) as f32) as i32 as usize;
        self.0[j * Self::N_LEFT + i]
    }
}

/// The curves of light at night.
#[derive(Debug, Clone)]
pub(super) struct Curves {
    low_beam: LowBeam,
    /// Display value by the root of linear light: sqrt(1 - exp(-x^2)).
    shoulder: Table,
    /// exp(-x).
    fade: Table,
}

/// The lamps as one picture's pixels need them, along the camera's axes.
struct Lights<'a> {
    low_beam: &'a LowBeam,
    street_lamps: Vec<Vector3<f32>>,
    headlamps: [Vector3<f32>; 2],
    /// The ego's axes: forward, left, up.
    axes: [Vector3<f32>; 3],
    world_up: Vector3<f32>,
}

impl<'a> Lights<'a> {
    fn new(low_beam: &'a LowBeam, view: &View<'_>, lamps: &[StreetLamp]) -> Self {
        let camera_from_world = view.pose.isometry.inverse();
        let mut near: Vec<Vector3<f32>> = lamps
            .iter()
            .map(|lamp| (camera_from_world * lamp.position_in_world).coords.cast::<f32>())
            .filter(|at| at.z > -15.0 && at.norm() < 90.0)
            .collect();
        near.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        near.truncate(MAX_LAMPS);
        let camera_from_ego = view.camera_from_ego;
        let headlamps = [HEADLAMP_Y_M, -HEADLAMP_Y_M].map(|y_m| {
            let at = Point3::new(HEADLAMP_X_M, y_m, HEADLAMP_Z_M).cast::<f64>();
            (camera_from_ego * at).coords.cast::<f32>()
        });
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis: Vector3<f64>| (camera_from_ego * axis).cast::<f32>());
        Self { low_beam, street_lamps: near, headlamps, axes, world_up: view.in_camera(&Vector3::z()) }
    }

    /// Illuminance on a small surface, by colour.
    fn on(&self, at: &Vector3<f32>, normal: &Vector3<f32>) -> Colour {
        let mut lux = AMBIENT_LUX;
        let mut add = |amount: f32, colour: Colour| {
            for (sum, part) in lux.iter_mut().zip(colour) {
                *sum += amount * part;
            }
        };
        for lamp in &self.headlamps {
            let way = at - lamp;
            let [forward, left, up] = [0, 1, 2].map(|i| way.dot(&self.axes[i]));
            if forward > 0.1 {
                let distance2 = way.norm_squared();
                let cos = (-way.dot(normal) / distance2.sqrt()).max(0.0);
                let candela = self.low_beam.cd(forward, left, up);
                add(candela * cos / distance2, HEADLAMP);
            }
        }
        for lamp in &self.street_lamps {
            let way = at - lamp;
            let distance2 = way.norm_squared();
            if distance2 > STREET_LAMP_REACH_M * STREET_LAMP_REACH_M {
                continue;
            }
            let distance = distance2.sqrt().max(0.3);
            let down = (-way.dot(&self.world_up) / distance).max(0.05);
            let cos = (-way.dot(normal) / distance).max(0.0);
            // Fades to nothing at its reach, so that no edge shows.
            let fade = 1.0 - distance2 / (STREET_LAMP_REACH_M * STREET_LAMP_REACH_M);
            add(STREET_LAMP_CD * down.sqrt() * cos * fade / distance2, STREET_LAMP);
        }
        lux
    }
}

/// Light spread round lamps, in linear units.
#[derive(Debug, Clone)]
pub(super) struct Glow {
    width: usize,
    height: usize,
    cells: Vec<Colour>,
    /// Light of the ego's own beams in the air, by cell.
    beam: Vec<f32>,
}

/// The curves, which are the same in all pictures.
pub(super) fn curves() -> &'static Curves {
    static CURVES: LazyLock<Curves> = LazyLock::new(Curves::new);
    &CURVES
}

impl Curves {
    fn new() -> Self {
        Self {
            low_beam: LowBeam::new(),
            shoulder: Table::new(0.0, 4.0, 4096, |x| (1.0 - (-x * x).exp()).sqrt()),
            fade: Table::new(0.0, 8.0, 1024, |x| (-x).exp()),
        }
    }

    /// Lights a picture of the things' own colours, and returns the glow to add over the fog.
    pub(super) fn light(
        &self,
        picture: &mut Picture,
        view: &View<'_>,
        rendered: &Rendered<'_>,
        lamps: &[StreetLamp],
        extinction_per_m: f64,
    ) -> Glow {
        let lights = Lights::new(&self.low_beam, view, lamps);
        let width = picture.width;
        let (glow_width, glow_height) = (width.div_ceil(GLOW_CELL_PX), picture.height.div_ceil(GLOW_CELL_PX));
        let mut glow = Glow {
            width: glow_width,
            height: glow_height,
            cells: vec![[0.0; 3]; glow_width * glow_height],
            beam: vec![0.0; glow_width * glow_height],
        };
        for v in (0..picture.height).step_by(2) {
            for u in (0..width).step_by(2) {
                let mut light = None;
                for (du, dv) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (u, v) = (u + du, v + dv);
                    let at = v * width + u;
                    if u >= width || v >= picture.height || rendered.material[at] == Material::Sky {
                        continue;
                    }
                    // The root of the light, as display values are.
                    let light = *light.get_or_insert_with(|| {
                        let point = view.ray_in_camera(u, v) * rendered.depth_m[at];
                        let lux = lights.on(&point, &normal(view, rendered, &lights, u, v));
                        lux.map(|part| (part / WHITE_LUX).sqrt())
                    });
                    let own = picture.pixels[at];
                    let lit = [0, 1, 2].map(|i| own[i] * light[i]);
                    let shining = emission(rendered.material[at], own);
                    if shining == [0.0; 3] {
                        picture.pixels[at] = lit.map(|root| self.shoulder.near(root));
                    } else {
                        picture.pixels[at] =
                            [0, 1, 2].map(|i| self.shoulder.near((lit[i] * lit[i] + shining[i]).sqrt()));
                        let share = seen_share(extinction_per_m, rendered.depth_m[at]);
                        glow.shine(u, v, shining, share / (GLOW_CELL_PX * GLOW_CELL_PX) as f32);
                    }
                }
            }
        }
        for lamp in &lights.street_lamps {
            glow.shine_lamp(lamp, view, rendered, seen_share(extinction_per_m, lamp.norm()));
        }
        if turbidity(extinction_per_m) > 0.02 {
            for cell_v in 0..glow_height {
                for cell_u in 0..glow_width {
                    let ray = view.ray_in_camera(cell_u * GLOW_CELL_PX, cell_v * GLOW_CELL_PX);
                    let [forward, left, up] = [0, 1, 2].map(|i| ray.dot(&lights.axes[i]));
                    // The eye's ray passes through the beams at many angles, from above them.
                    let deg = std::f32::consts::PI / 180.0;
                    let passed = (0..8).map(|k| up + forward * (2.0 - 1.2 * k as f32) * deg);
                    let lit: f32 = passed.map(|up| self.low_beam.cd(forward, left, up)).sum();
                    glow.beam[cell_v * glow_width + cell_u] = lit / 8.0 / 20_000.0;
                }
            }
        }
        glow.spread();
        glow
    }

    /// Adds the glow of lamps and, in turbid air, of the ego's own beams.
    pub(super) fn add_glow(&self, glow: &Glow, picture: &mut Picture, extinction_per_m: f64) {
        let turbid = turbidity(extinction_per_m);
        let halo = 0.45 + 2.2 * turbid;
        // What the glow leaves of the dark, by cell: light on light counts less.
        let left: Vec<Colour> = glow
            .cells
            .iter()
            .zip(&glow.beam)
            .map(|(light, beam)| {
                [0, 1, 2].map(|i| self.fade.at(halo * light[i] + 0.22 * turbid * beam * HEADLAMP[i]))
            })
            .collect();
        let cell = GLOW_CELL_PX as f32;
        let place = |i: usize, n: usize| {
            let at = ((i as f32 + 0.5) / cell - 0.5).clamp(0.0, (n - 1) as f32);
            let first = at as i32 as usize;
            (first, (first + 1).min(n - 1), at - first as f32)
        };
        let columns: Vec<_> = (0..picture.width).map(|u| place(u, glow.width)).collect();
        let mut row_left = vec![[0.0; 3]; glow.width];
        for (v, row) in picture.pixels.chunks_mut(picture.width).enumerate() {
            // Interpolated between the four nearest cells, so that no cell shows.
            let (top, below, share) = place(v, glow.height);
            let [top, below] = [top, below].map(|line| &left[line * glow.width..][..glow.width]);
            for (at, (above, under)) in row_left.iter_mut().zip(top.iter().zip(below)) {
                *at = mix(*above, *under, share);
            }
            if row_left.as_flattened().iter().all(|part| *part > 0.9999) {
                continue;
            }
            for (pixel, &(near, next, share)) in row.iter_mut().zip(&columns) {
                let part = mix(row_left[near], row_left[next], share);
                for (channel, part) in pixel.iter_mut().zip(part) {
                    *channel = (1.0 - (1.0 - (*channel * *channel).min(1.0)) * part).sqrt();
                }
            }
        }
    }
}

/// The share of the beams that 12 m of air scatter back.
fn turbidity(extinction_per_m: f64) -> f32 {
    (1.0 - (-12.0 * extinction_per_m).exp()) as f32
}

/// Share of a lamp's light that comes through the air, straight or scattered a little on the way: the
/// glow is what scatters, so half of the extinction counts.
fn seen_share(extinction_per_m: f64, distance_m: f32) -> f32 {
    (-0.5 * extinction_per_m as f32 * distance_m).exp()
}

/// Surface normal towards the eye, along the camera's axes.
fn normal(view: &View<'_>, rendered: &Rendered<'_>, lights: &Lights, u: usize, v: usize) -> Vector3<f32> {
    let width = view.width();
    let at = v * width + u;
    if rendered.material[at] == Material::Paved {
        return lights.world_up;
    }
    let here = view.ray_in_camera(u, v) * rendered.depth_m[at];
    let toward_eye = -here.normalize();
    let height = rendered.depth_m.len() / width;
    if u + 2 >= width || v + 2 >= height {
        return toward_eye;
    }
    let right = view.ray_in_camera(u + 2, v) * rendered.depth_m[at + 2] - here;
    let below = view.ray_in_camera(u, v + 2) * rendered.depth_m[at + 2 * width] - here;
    // Across an edge the difference is not a tangent.
    let is_edge = right.z.abs().max(below.z.abs()) > 0.05 * here.z + 0.2;
    let normal = right.cross(&below);
    if is_edge || !normal.norm().is_normal() {
        return toward_eye;
    }
    let normal = normal.normalize();
    if normal.dot(&toward_eye) < 0.0 { -normal } else { normal }
}

/// Light that a pixel sends out by itself, linear.
fn emission(material: Material, own: Colour) -> Colour {
    match material {
        Material::Headlamp => [5.0, 4.8, 4.2],
        Material::Taillamp => [1.6, 0.06, 0.04],
        Material::Signal => own.map(|c| 2.0 * c * c),
        // Lit windows are painted in a yellow that no wall has.
        Material::Facade if own[0] > 0.9 && own[1] > 0.75 && own[2] < 0.72 => [0.62, 0.48, 0.24],
        _ => [0.0; 3],
    }
}

impl Glow {
    fn shine(&mut self, u: usize, v: usize, light: Colour, share: f32) {
        let at = v / GLOW_CELL_PX * self.width + u / GLOW_CELL_PX;
        for (sum, part) in self.cells[at].iter_mut().zip(light) {
            *sum += part * share;
        }
    }

    /// The bright head of a street lamp, if nothing hides it.
    fn shine_lamp(&mut self, lamp: &Vector3<f32>, view: &View<'_>, rendered: &Rendered<'_>, share: f32) {
        if lamp.z < 1.0 {
            return;
        }
        let intrinsics = view.intrinsics;
        let u = intrinsics.cx_px as f32 + intrinsics.fx_px as f32 * lamp.x / lamp.z;
        let v = intrinsics.cy_px as f32 + intrinsics.fy_px as f32 * lamp.y / lamp.z;
        if u < 0.0 || v < 0.0 || u >= intrinsics.width_px as f32 || v >= intrinsics.height_px as f32 {
            return;
        }
        let (u, v) = (u as usize, v as usize);
        if rendered.depth_m[v * view.width() + u] > lamp.z - 1.0 {
            let head_px = 0.35 * intrinsics.fx_px as f32 / lamp.z / GLOW_CELL_PX as f32;
            self.shine(u, v, STREET_LAMP.map(|c| 14.0 * c), share * (head_px * head_px).clamp(0.05, 4.0));
        }
    }

    /// Five box filters make a bell.
    fn spread(&mut self) {
        for _ in 0..5 {
            self.cells = filter_box(&self.cells, self.width, self.height, true);
            self.cells = filter_box(&self.cells, self.width, self.height, false);
        }
    }
}

/// Mean over 5 cells of a row (or column).
fn filter_box(cells: &[Colour], width: usize, height: usize, along_rows: bool) -> Vec<Colour> {
    const REACH: usize = 2;
    let (n_lines, n) = if along_rows { (height, width) } else { (width, height) };
    let index = |line: usize, i: usize| if along_rows { line * width + i } else { i * width + line };
    let mut filtered = vec![[0.0; 3]; cells.len()];
    for line in 0..n_lines {
        let mut sum = [0.0f32; 3];
        for i in 0..n + REACH {
            for channel in 0..3 {
                if i < n {
                    sum[channel] += cells[index(line, i)][channel];
                }
                if i > 2 * REACH {
                    sum[channel] -= cells[index(line, i - 2 * REACH - 1)][channel];
                }
            }
            if i >= REACH {
                filtered[index(line, i - REACH)] = sum.map(|c| c / (2 * REACH + 1) as f32);
            }
        }
    }
    filtered
}
