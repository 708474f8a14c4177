//! From a file to a solid thing: scaled, turned upright, put on the ground, reduced, with hulls and a mass.

use std::path::Path;

use nalgebra::{Rotation3, Vector3};

use super::hulls::hulls;
use super::reduce::reduce;
use super::settings::{LengthUnit, Settings, UpAxis};
use super::topology::open_edges;
use super::{Hull, MeshPart};

/// Longest sides that an object on a road may have, metres.
const SIZES_M: std::ops::RangeInclusive<f64> = 0.05..=12.0;
/// A unit is guessed by these: most things that lie on roads.
const LIKELY_M: std::ops::RangeInclusive<f64> = 0.15..=4.0;
/// Mean over the hull of furniture, household things and animals, which are hollow in part: a chair has about 60, a
/// full suitcase 150, a boar 900.
const DENSITY_KGPM3: f64 = 150.0;

/// Boxes have no thinner side: below, an object cannot be told from the road.
const THINNEST_M: f64 = 0.005;

/// A square millimetre.
const LEAST_AREA_M2: f64 = 1e-6;

/// A mesh that is ready to be placed: in metres, z up, the middle of its footprint on the ground at the origin.
#[derive(Debug, Clone)]
pub struct Prepared {
    pub parts: Vec<MeshPart>,
    pub hulls: Vec<Hull>,
    pub category: String,
    pub mass_kg: f64,
    pub reflectivity: f64,
    /// Length, width, height.
    pub size_m: [f64; 3],
    /// Before and after reduction.
    pub n_triangles: [usize; 2],
    pub is_watertight: bool,
    /// What was guessed or left out.
    pub notes: Vec<String>,
}

/// Prepares a file of `folder`.
///
/// # Errors
/// Why it cannot be used: broken, of no size that a road could hold, or it names files outside of the folder.
pub fn prepare(path: &Path, folder: &Path, settings: &Settings) -> Result<Prepared, String> {
    let content = super::read(path, folder)?;
    let mut notes = content.notes;
    notes.dedup();
    let mut parts = content.parts;
    let n_before = parts.iter().map(|part| part.triangles.len()).sum();

    let up = settings.up.or(content.up).unwrap_or_else(|| {
        // Habits of the programs that write these formats: STL comes from CAD, OBJ from animation.
        let is_stl = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("stl"));
        let guess = if is_stl { UpAxis::Z } else { UpAxis::Y };
        notes.push(format!("up guessed: {}", format!("{guess:?}").to_lowercase()));
        guess
    });
    let size = extent(&parts).1;
    let longest = size.max();
    let scale = match (settings.longest_m, settings.unit) {
        (Some(longest_m), _) => longest_m / longest,
        (None, Some(unit)) => unit.metres(),
        (None, None) if content.metres => 1.0,
        (None, None) => {
            let unit = LengthUnit::ALL.into_iter().find(|unit| LIKELY_M.contains(&(longest * unit.metres())));
            let unit = unit.unwrap_or(LengthUnit::Metre);
            notes.push(format!("unit guessed: {}", unit.name()));
            unit.metres()
        }
    };
    if !SIZES_M.contains(&(longest * scale)) {
        return Err(format!(
            "its longest side is {:.3} m; {} to {} are valid: give `unit` or `longest_m` in models.toml",
            longest * scale,
            SIZES_M.start(),
            SIZES_M.end()
        ));
    }
    if settings.longest_m.is_none() && !LIKELY_M.contains(&(longest * scale)) {
        notes.push(format!("{:.2} m long: give `longest_m` or `unit` if that is not so", longest * scale));
    }
    stand(&mut parts, up, settings.yaw_deg.to_radians(), scale);
    let (n_open, n_edges) = open_edges(&parts);
    if n_open > 0 {
        notes.push(format!("not watertight: {n_open} of {n_edges} edges are open; its hulls are a shell"));
    }
    if reduce(&mut parts, settings.max_triangles as usize) {
        notes.push("reduced coarsely: its triangles hang together loosely".into());
    }
    let is_bare = parts.iter().all(|part| part.triangles.is_empty());
    if is_bare {
        return Err("no triangle is left after the reduction; give a greater `max_triangles`".into());
    }
    // MuJoCo refuses what has no area.
    parts.retain(|part| area_m2(part) > LEAST_AREA_M2);
    if parts.is_empty() {
        return Err("its triangles are lines or points: they have no area".into());
    }
    let shortest_m = extent(&parts).1.min();
    if shortest_m < THINNEST_M {
        return Err(format!(
            "its shortest side is {shortest_m:.4} m; more than {THINNEST_M} m is valid: give it some thickness, or a greater \
             `longest_m` in models.toml"
        ));
    }
    let hulls = hulls(&parts, n_open == 0);
    let volume_m3: f64 = hulls.iter().map(|hull| hull.volume_m3).sum();
    let mass_kg = settings.mass_kg.unwrap_or_else(|| {
        let guess = (DENSITY_KGPM3 * volume_m3).clamp(0.1, 2000.0);
        notes.push(format!("mass guessed: {guess:.1} kg"));
        guess
    });
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let n_after = parts.iter().map(|part| part.triangles.len()).sum();
    Ok(Prepared {
        category: settings.category.clone().unwrap_or_else(|| snake_case(&stem)),
        hulls,
        mass_kg,
        reflectivity: settings.reflectivity,
        size_m: extent(&parts).1.into(),
        n_triangles: [n_before, n_after],
        is_watertight: n_open == 0,
        notes,
        parts,
    })
}

fn area_m2(part: &MeshPart) -> f64 {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|corner| Vector3::from(part.positions[corner as usize]).cast::<f64>());
        (b - a).cross(&(c - a)).norm() / 2.0
    };
    part.triangles.iter().map(area).sum()
}

/// Lowest corner and size.
fn extent(parts: &[MeshPart]) -> (Vector3<f64>, Vector3<f64>) {
    // Vertices that no triangle names are not seen.
    let used = parts.iter().flat_map(|part| {
        part.triangles
            .iter()
            .flatten()
            .map(|&corner| Vector3::from(part.positions[corner as usize]).cast::<f64>())
    });
    let bounds = used.fold(None, |bounds, point| {
        let (low, high): (Vector3<f64>, Vector3<f64>) = bounds.unwrap_or((point, point));
        Some((low.inf(&point), high.sup(&point)))
    });
    bounds.map_or((Vector3::zeros(), Vector3::zeros()), |(low, high)| (low, high - low))
}

/// Scales the parts, turns them upright and by the yaw, and puts them on the ground over the origin.
fn stand(parts: &mut [MeshPart], up: UpAxis, yaw_rad: f64, scale: f64) {
    let upright = match up {
        UpAxis::X => Rotation3::from_axis_angle(&-Vector3::y_axis(), std::f64::consts::FRAC_PI_2),
        UpAxis::Y => Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
        UpAxis::Z => Rotation3::identity(),
    };
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad) * upright;
    let each = |parts: &mut [MeshPart], place: &dyn Fn(Vector3<f64>) -> Vector3<f64>| {
        for position in parts.iter_mut().flat_map(|part| &mut part.positions) {
            *position = place(Vector3::from(*position).cast()).cast::<f32>().into();
        }
    };
    each(parts, &|point| turn * point * scale);
    let (low, size) = extent(parts);
    let foot = low + Vector3::new(size.x / 2.0, size.y / 2.0, 0.0);
    each(parts, &|point| point - foot);
}

/// Letters and digits in lower case, with underscores between words.
#[must_use]
pub fn snake_case(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    let lower: String = name.chars().map(plain).collect();
    let words: Vec<&str> = lower.split('_').filter(|word| !word.is_empty()).collect();
    if words.is_empty() { "mesh".into() } else { words.join("_") }
}
