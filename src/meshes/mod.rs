//! Mesh files of others (OBJ, STL, GLB) made ready for the world: upright, in metres, with few triangles and convex hulls.
//!
//! [`prepare()`] takes one file. What it had to guess (unit, axis, mass) is told in [`Prepared::notes`].

mod glb;
mod glb_writer;
mod hulls;
mod obj;
mod prepare;
mod reduce;
mod settings;
mod stl;
mod topology;

use std::path::{Component, Path};

use fs_err as fs;
use image::RgbImage;

pub use glb_writer::to_glb;
pub use hulls::Hull;
pub use prepare::{Prepared, prepare, snake_case};
pub use settings::{Settings, SettingsError, SettingsFile, UpAxis};

/// Names of files that are read, by their ends.
pub const EXTENSIONS: [&str; 3] = ["glb", "obj", "stl"];

/// Triangles of one material, in the unit and axes of the file or, once prepared, in the model's frame in metres.
#[derive(Debug, Clone, Default)]
pub struct MeshPart {
    pub positions: Vec<[f32; 3]>,
    /// One for each position, v upwards; empty without a texture.
    pub texture_places: Vec<[f32; 2]>,
    /// Corners, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Red, green, blue, 0 to 1.
    pub color: [f32; 3],
    pub texture: Option<RgbImage>,
}

/// What a file holds.
#[derive(Debug, Clone)]
struct Content {
    parts: Vec<MeshPart>,
    /// What the format says of its unit and axes: glTF is in metres with y up, the others say nothing.
    metres: bool,
    up: Option<UpAxis>,
    notes: Vec<String>,
}

/// The colour of what has no material.
const GREY: [f32; 3] = [0.6, 0.6, 0.6];

/// Most triangles that a file may have, and the greatest size of a texture's side, pixels.
const MOST_TRIANGLES: usize = 5_000_000;
const TEXTURE_SIDE_PX: u32 = 256;

/// Reads a file; `folder` is what it may name other files of.
///
/// # Errors
/// Why the file cannot be used.
fn read(path: &Path, folder: &Path) -> Result<Content, String> {
    let bytes = fs::read(path).map_err(|error| error.to_string())?;
    let extension = path.extension().and_then(|end| end.to_str()).unwrap_or_default().to_lowercase();
    let content = match extension.as_str() {
        "glb" => glb::read(&bytes, path, folder)?,
        "obj" => obj::read(&bytes, path, folder)?,
        "stl" => stl::read(&bytes)?,
        _ => return Err(format!("it ends in none of {EXTENSIONS:?}")),
    };
    let n_triangles: usize = content.parts.iter().map(|part| part.triangles.len()).sum();
    if n_triangles == 0 {
        return Err("it holds no triangle".into());
    }
    if n_triangles > MOST_TRIANGLES {
        return Err(format!("it holds {n_triangles} triangles; up to {MOST_TRIANGLES} are read"));
    }
    for part in &content.parts {
        if part.positions.iter().flatten().any(|value| !value.is_finite()) {
            return Err("a vertex is not finite".into());
        }
        let is_missing = |corner: &u32| *corner as usize >= part.positions.len();
        if part.triangles.iter().flatten().any(is_missing) {
            return Err("a triangle names a vertex that is missing".into());
        }
    }
    Ok(content)
}

/// Why a file that a mesh names is not read.
enum Unread {
    /// It is missing or broken, which costs colours alone.
    Missing(String),
    /// It lies outside of the folder: nothing there is touched.
    Outside(String),
}

/// Reads a file that another names, which must lie in the folder.
fn named_file(folder: &Path, base: &Path, name: &str) -> Result<Vec<u8>, Unread> {
    let path = base.join(name.replace('\\', "/"));
    let outside =
        || Unread::Outside(format!("it names the file `{name}`, outside of the folder {}", folder.display()));
    let missing = |_| Unread::Missing(format!("it names the file `{name}`, which is not there"));
    let depth = |path: &Path| {
        path.strip_prefix(folder).ok()?.components().try_fold(0_u32, |depth, part| match part {
            Component::Normal(_) => Some(depth + 1),
            Component::CurDir => Some(depth),
            _ => depth.checked_sub(1),
        })
    };
    if depth(&path).is_none() {
        return Err(outside());
    }
    let found = fs::canonicalize(&path).map_err(missing)?;
    // A link may lead out.
    if !found.starts_with(fs::canonicalize(folder).map_err(missing)?) {
        return Err(outside());
    }
    fs::read(found).map_err(missing)
}

/// The texture in a file that another names; with a note where it is left out.
fn named_texture(
    folder: &Path,
    base: &Path,
    name: &str,
    notes: &mut Vec<String>,
) -> Result<Option<RgbImage>, String> {
    let read = match named_file(folder, base, name) {
        Ok(bytes) => texture(&bytes).map_err(|reason| format!("`{name}`: {reason}")),
        Err(Unread::Missing(reason)) => Err(reason),
        Err(Unread::Outside(reason)) => return Err(reason),
    };
    Ok(read.map_err(|reason| notes.push(format!("{reason}: its colour is plain"))).ok())
}

/// An image that is small enough to draw.
fn texture(bytes: &[u8]) -> Result<RgbImage, String> {
    let picture = image::load_from_memory(bytes)
        .map_err(|error| format!("a texture cannot be read: {error}; PNG and JPEG are"))?;
    let picture = if picture.width().max(picture.height()) > TEXTURE_SIDE_PX {
        picture.thumbnail(TEXTURE_SIDE_PX, TEXTURE_SIDE_PX)
    } else {
        picture
    };
    Ok(picture.to_rgb8())
}

#[cfg(test)]
mod tests;
