//! The ego's car for viewers: a hatchback of the ego's length, as GLB, its origin in the middle of its footprint.

use std::collections::{BTreeMap, HashMap};
use std::sync::OnceLock;

use roxmltree::Document;

use super::mesh::triangles_of_obj;
use super::models::MODEL_FILE;
use super::shipped;
use crate::meshes::{MeshPart, to_glb};

/// The model whose size is nearest to the ego's, in the source tree.
const FOLDER: &str = "mjcf_assets/car_hatch";

/// The car as binary glTF.
///
/// # Panics
/// Never: the model is a part of the program, and a test reads it.
#[must_use]
pub fn ego_glb() -> Vec<u8> {
    static GLB: OnceLock<Vec<u8>> = OnceLock::new();
    GLB.get_or_init(|| to_glb(&parts().expect("the program's own model is whole"))).clone()
}

/// The triangles of each material.
fn parts() -> Option<Vec<MeshPart>> {
    let document = Document::parse(shipped::text(&format!("{FOLDER}/{MODEL_FILE}"))?).ok()?;
    let named = |tag: &'static str, key: &'static str| -> BTreeMap<&str, &str> {
        let nodes = document.descendants().filter(move |node| node.has_tag_name(tag));
        nodes.filter_map(|node| Some((node.attribute("name")?, node.attribute(key)?))).collect()
    };
    let (files, colors) = (named("mesh", "file"), named("material", "rgba"));
    let shown = document.descendants().filter(|node| node.attribute("group") == Some("2"));
    shown
        .map(|geom| part(files.get(geom.attribute("mesh")?)?, colors.get(geom.attribute("material")?)?))
        .collect()
}

fn part(file: &str, rgba: &str) -> Option<MeshPart> {
    let mut part = MeshPart::default();
    for (to, word) in part.color.iter_mut().zip(rgba.split_whitespace()) {
        *to = word.parse().ok()?;
    }
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    for triangle in triangles_of_obj(shipped::text(&format!("{FOLDER}/{file}"))?)? {
        part.triangles.push(triangle.map(|corner| {
            let position: [f32; 3] = corner.coords.into();
            *known.entry(position.map(f32::to_bits)).or_insert_with(|| {
                part.positions.push(position);
                part.positions.len() as u32 - 1
            })
        }));
    }
    Some(part)
}

#[cfg(test)]
mod tests {
    use super::super::car::{EGO_HEIGHT_M, EGO_LENGTH_M};
    use super::*;

    #[test]
    fn the_car_is_as_long_as_the_ego_and_stands_on_the_ground() {
        let parts = parts().unwrap();
        assert!(parts.len() > 5 && parts.iter().all(|part| !part.triangles.is_empty()), "{}", parts.len());
        let bounds = |axis: usize| {
            let values = parts.iter().flat_map(|part| part.positions.iter().map(|at| f64::from(at[axis])));
            values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)))
        };
        let (rear, front) = bounds(0);
        assert!((front - rear - EGO_LENGTH_M).abs() < 0.1 && (front + rear).abs() < 0.1, "{rear} to {front}");
        let (low, high) = bounds(2);
        assert!(low.abs() < 0.03 && (high - EGO_HEIGHT_M).abs() < 0.15, "{low} to {high}");
        let glb = ego_glb();
        assert!(glb.starts_with(b"glTF") && glb.len() < 200_000, "{}", glb.len());
    }
}
