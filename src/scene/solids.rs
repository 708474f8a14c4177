//! Random solids: things of no kind, each episode's own, for a network to learn that whatever stands out of the road is
//! an object. None is one of the unfamiliar kinds: they are drawn, not modelled. They stand, lie, fall and roll where
//! unfamiliar objects do, but are in distribution.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use super::error::SceneError;
use super::models::{self, MODEL_FILE, Model};
use super::solid_shapes::Surface;
use crate::object::Distribution;
use crate::random::{self, Rng};

/// Category of every random solid.
pub(super) const CATEGORY: &str = "random_solid";
/// Shortest and longest side, metres: from a shoe box to a small van's load.
const SIDES_M: [f64; 2] = [0.15, 2.4];
/// Longest side over the shortest.
const MOST_STRETCH: f64 = 8.0;
/// Share of things put together of several.
const HEAP_SHARE: f64 = 0.4;
/// From a bag of leaves to a stone, kg/m³.
const DENSITY_KGPM3: [f64; 2] = [40.0, 1500.0];
const HEAVIEST_KG: f64 = 800.0;
/// Side of a texture.
const TEXTURE_PX: u32 = 32;
/// Most vertices of a hull: MuJoCo collides such hulls fast.
const MOST_HULL_VERTICES: u32 = 32;

impl Model {
    /// Whether it stands and moves as unfamiliar objects do: one of them, or a random solid.
    pub(super) fn is_strange(&self) -> bool {
        self.facts.distribution == Distribution::Ood || self.facts.category == CATEGORY
    }
}

/// Draws the random solids of a world.
///
/// # Errors
/// [`SceneError::Model`], if one cannot be read back.
pub(super) fn draw_solids(n: usize, seed: u64) -> Result<Vec<Model>, SceneError> {
    (0..n).map(|i| draw_solid(i, &mut random::stream(seed, "random-solid", i as u64))).collect()
}

fn draw_solid(i: usize, rng: &mut Rng) -> Result<Model, SceneError> {
    let name = format!("{CATEGORY}_{i}");
    let parts = on_the_ground(draw_parts(rng));
    let mut files: HashMap<String, Vec<u8>> = HashMap::new();
    let (mut assets, mut geoms) = (String::new(), String::new());
    let [least, most] = DENSITY_KGPM3;
    let density_kgpm3 = least * (most / least).powf(rng.random());
    let volume_m3: f64 = parts.iter().map(Surface::volume_m3).sum();
    let mass_kg = (density_kgpm3 * volume_m3).clamp(0.6, HEAVIEST_KG);
    for (part_idx, part) in parts.iter().enumerate() {
        let key = format!("{name}/part_{part_idx}");
        let (png, obj) = (format!("part_{part_idx}.png"), format!("part_{part_idx}.obj"));
        let mass_kg = mass_kg * part.volume_m3() / volume_m3;
        let _ = writeln!(assets, "<texture name=\"{key}\" type=\"2d\" file=\"{png}\"/>");
        let _ = writeln!(
            assets,
            "<material name=\"{key}\" texture=\"{key}\" specular=\"0.2\" shininess=\"0.2\"/>"
        );
        let _ = writeln!(
            assets,
            "<mesh name=\"{key}\" file=\"{obj}\" inertia=\"convex\" maxhullvert=\"{MOST_HULL_VERTICES}\"/>"
        );
        let _ = writeln!(
            geoms,
            "<geom type=\"mesh\" mesh=\"{key}\" material=\"{key}\" group=\"2\" contype=\"0\" conaffinity=\"0\" mass=\"0\"/>\n\
             <geom type=\"mesh\" mesh=\"{key}\" group=\"3\" mass=\"{mass_kg:.4}\" condim=\"6\" priority=\"1\" friction=\"0.7 0.01 0.01\" solref=\"0.02 0.8\"/>"
        );
        files.insert(png, texture(rng));
        files.insert(obj, to_obj(part));
    }
    let reflectivity = 0.05 + 0.75 * rng.random::<f64>().powi(2);
    let xml = format!(
        "<mujoco model=\"{name}\"><custom><text name=\"category\" data=\"{CATEGORY}\"/><text name=\"kind\" data=\"static\"/>\
         <text name=\"distribution\" data=\"id\"/><numeric name=\"reflectivity\" data=\"{reflectivity:.3}\"/>\
         <numeric name=\"weight\" data=\"0\"/></custom><asset>{assets}</asset><worldbody><body name=\"{name}\">{geoms}\
         </body></worldbody></mujoco>"
    );
    let file_of = |file: &str| files.get(file).map(|bytes| Arc::from(bytes.as_slice()));
    models::read(&name, &xml, &file_of)
        .map_err(|message| SceneError::Model { message, path: format!("{name}/{MODEL_FILE}").into() })
}

/// The surfaces of one thing, not yet on the ground.
fn draw_parts(rng: &mut Rng) -> Vec<Surface> {
    let size_m = draw_size(rng, SIDES_M);
    if rng.random::<f64>() >= HEAP_SHARE {
        return vec![draw_surface(size_m, rng)];
    }
    // Parts of half its size, near its middle, so that they touch.
    let n = rng.random_range(2..6);
    let is_heap = rng.random_bool(0.5);
    (0..n)
        .map(|_| {
            let part_m = size_m.map(|side_m| side_m * (0.3 + 0.5 * rng.random::<f64>()));
            let part = draw_surface(part_m, rng);
            let turn = if is_heap { draw_turn(rng) } else { UnitQuaternion::identity() };
            let off = Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5).component_mul(&(size_m - part_m));
            part.placed(&turn, off)
        })
        .collect()
}

/// Sides of a thing: the longest at random, the others between it and an eighth of it.
fn draw_size(rng: &mut Rng, [least_m, most_m]: [f64; 2]) -> Vector3<f64> {
    let longest_m = least_m * (most_m / least_m).powf(rng.random());
    let mut side = || (longest_m / MOST_STRETCH.powf(rng.random::<f64>())).max(least_m / 2.0);
    let mut sides = [longest_m, side(), side()];
    let first = rng.random_range(0..3);
    sides.rotate_left(first);
    sides.into()
}

fn draw_surface(size_m: Vector3<f64>, rng: &mut Rng) -> Surface {
    match rng.random_range(0..10) {
        0..4 => {
            let mut exponent = || if rng.random_bool(0.5) { 0.15 } else { 0.2 + 1.4 * rng.random::<f64>() };
            let exponents = [exponent(), exponent()];
            Surface::superquadric(size_m, exponents)
        }
        4..8 => {
            let roughness = 0.3 + 1.2 * rng.random::<f64>();
            Surface::blob(size_m, roughness, rng)
        }
        _ => Surface::post(size_m, rng),
    }
}

fn draw_turn(rng: &mut Rng) -> UnitQuaternion<f64> {
    let mut angle = || std::f64::consts::TAU * rng.random::<f64>();
    UnitQuaternion::from_euler_angles(angle(), angle(), angle())
}

/// Moves a thing so that it stands on the ground, its footprint's middle at the origin.
fn on_the_ground(parts: Vec<Surface>) -> Vec<Surface> {
    let bounds = parts.iter().map(Surface::bounds);
    let all = bounds.reduce(|[low, high], [a, b]| [low.inf(&a), high.sup(&b)]);
    let [low, high] = all.expect("a thing has a part");
    let shift = Vector3::new(-(low.x + high.x) / 2.0, -(low.y + high.y) / 2.0, -low.z);
    parts.into_iter().map(|part| part.placed(&UnitQuaternion::identity(), shift)).collect()
}

/// A texture of two colours, in stripes, patches or one of the two alone.
fn texture(rng: &mut Rng) -> Vec<u8> {
    let mut colour = || {
        let grey = rng.random::<f64>();
        let colour = [rng.random::<f64>(), rng.random::<f64>(), rng.random::<f64>()];
        let vividness = rng.random::<f64>();
        colour.map(|part| (255.0 * (grey + vividness * (part - grey)).clamp(0.02, 0.98)) as u8)
    };
    let (one, other) = (colour(), colour());
    let [along, across, phase] = [0, 0, 0].map(|_| rng.random::<f64>());
    let style = rng.random_range(0..4);
    let contrast = rng.random::<f64>();
    let side = f64::from(TEXTURE_PX);
    let pixel = |x: u32, y: u32| {
        let [u, v] = [x, y].map(|at| std::f64::consts::TAU * f64::from(at) / side);
        let wave = match style {
            0 => -1.0,
            1 => (u * (1.0 + 6.0 * along).floor() + phase).sin(),
            2 => (v * (1.0 + 6.0 * across).floor() + phase).sin(),
            _ => (u * (1.0 + 3.0 * along).floor()).sin() + (v * (1.0 + 3.0 * across) + phase).sin(),
        };
        let share = if wave > 0.0 { contrast } else { 0.0 };
        let mix = |i: usize| (f64::from(one[i]) + share * (f64::from(other[i]) - f64::from(one[i]))) as u8;
        image::Rgb([mix(0), mix(1), mix(2)])
    };
    let picture = image::RgbImage::from_fn(TEXTURE_PX, TEXTURE_PX, pixel);
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).expect("memory takes a picture");
    png.into_inner()
}

fn to_obj(of: &Surface) -> Vec<u8> {
    let mut text = String::new();
    for at in &of.positions {
        let _ = writeln!(text, "v {:.5} {:.5} {:.5}", at.x, at.y, at.z);
    }
    for [u, v] in &of.places {
        let _ = writeln!(text, "vt {u:.5} {v:.5}");
    }
    for corners in &of.triangles {
        let [a, b, c] = corners.map(|corner| corner + 1);
        let _ = writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}");
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_stand_on_the_ground_in_their_sizes_and_differ_from_seed_to_seed() {
        let solids = draw_solids(60, 7).unwrap();
        for model in &solids {
            let [low, high] = model.bounds;
            assert!(low.z.abs() < 1e-3 && model.mass_kg > 0.5 && model.mass_kg < 801.0, "{}", model.name);
            let middle = nalgebra::center(&low, &high);
            assert!(middle.x.abs() < 1e-3 && middle.y.abs() < 1e-3, "{}", model.name);
            let longest_m = (high - low).max();
            assert!((0.1..4.0).contains(&longest_m), "{} is {longest_m} m long", model.name);
            assert!(model.is_strange() && model.facts.distribution == Distribution::Id);
        }
        let sizes = |seed| draw_solids(3, seed).unwrap().iter().map(Model::height_m).collect::<Vec<_>>();
        assert_eq!(sizes(7), solids[..3].iter().map(Model::height_m).collect::<Vec<_>>());
        assert_ne!(sizes(7), sizes(8));
        let low = solids.iter().filter(|model| model.height_m() < 0.5).count();
        assert!((10..50).contains(&low), "{low} of 60 are low");
    }
}
