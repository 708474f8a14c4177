//! Wavefront OBJ with its MTL.

use std::cell::RefCell;
use std::path::Path;

use super::{Content, GREY, MeshPart, Unread, named_file, named_texture};

pub(super) fn read(bytes: &[u8], path: &Path, folder: &Path) -> Result<Content, String> {
    let base = path.parent().unwrap_or(folder);
    let mut notes = Vec::new();
    let refusal = RefCell::new(None);
    let load = |name: &Path| match named_file(folder, base, &name.to_string_lossy()) {
        Ok(bytes) if has_short_color(&bytes) => {
            let reason = format!("a colour of the file `{}` has fewer than three numbers", name.display());
            refusal.borrow_mut().get_or_insert(Unread::Missing(reason));
            Err(tobj::LoadError::MaterialParseError)
        }
        Ok(bytes) => tobj::load_mtl_buf(&mut &*bytes),
        Err(reason) => {
            refusal.borrow_mut().get_or_insert(reason);
            Err(tobj::LoadError::OpenFileFailed)
        }
    };
    let (models, materials) = tobj::load_obj_buf(&mut &*bytes, &tobj::GPU_LOAD_OPTIONS, load)
        .map_err(|error| format!("it is not a whole OBJ file: {error}"))?;
    match refusal.into_inner() {
        Some(Unread::Outside(reason)) => return Err(reason),
        Some(Unread::Missing(reason)) => notes.push(format!("{reason}: it is grey")),
        None => {}
    }
    let materials = materials.unwrap_or_default();
    let mut parts = Vec::new();
    for tobj::Model { mesh, .. } in models {
        let material = mesh.material_id.and_then(|id| materials.get(id));
        let texture_file = material.and_then(|material| material.diffuse_texture.as_deref());
        let texture = match texture_file.filter(|_| !mesh.texcoords.is_empty()) {
            // Names may have spaces, and options such as `-s 1 1 1` stand before them.
            Some(words) => {
                let last = words.split_whitespace().last().unwrap_or(words);
                let name = if named_file(folder, base, words).is_ok() { words } else { last };
                named_texture(folder, base, name, &mut notes)?
            }
            None => None,
        };
        let corners = mesh.indices.as_chunks::<3>();
        if !corners.1.is_empty() {
            return Err("a face is not a triangle".into());
        }
        parts.push(MeshPart {
            positions: mesh.positions.as_chunks::<3>().0.to_vec(),
            texture_places: if texture.is_some() {
                mesh.texcoords.as_chunks::<2>().0.to_vec()
            } else {
                Vec::new()
            },
            triangles: corners.0.to_vec(),
            color: material.and_then(|material| material.diffuse).unwrap_or(GREY),
            texture,
        });
    }
    Ok(Content { parts, metres: false, up: None, notes })
}

/// Whether a colour of an MTL file has fewer than three numbers, on which `tobj` panics.
fn has_short_color(mtl: &[u8]) -> bool {
    let is_short = |line: &str| {
        let mut words = line.split_whitespace();
        words.next().is_some_and(|word| ["Ka", "Kd", "Ks", "Ke"].contains(&word)) && words.count() < 3
    };
    String::from_utf8_lossy(mtl).lines().any(is_short)
}
