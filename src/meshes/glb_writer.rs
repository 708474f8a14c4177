//! Meshes as binary glTF 2.0, for viewers: positions, triangles and plain colours.
//!
//! A file is a header, a JSON part and a binary part, each padded to four bytes; y is up there and z here.

use serde_json::{Value, json};

use super::MeshPart;

/// `glTF`, `JSON` and `BIN\0`, little endian.
const MAGIC: u32 = 0x4654_6c67;
const JSON_PART: u32 = 0x4e4f_534a;
const BINARY_PART: u32 = 0x004e_4942;
const VERSION: u32 = 2;
/// glTF's numbers for what a buffer holds and of which type.
const VERTICES: u32 = 34962;
const CORNERS: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const TRIANGLES: u32 = 4;

/// The parts, in metres with z up, as one GLB; textures are left out. Without parts the scene is empty.
#[must_use]
pub fn to_glb(parts: &[MeshPart]) -> Vec<u8> {
    let mut file = Content::default();
    parts.iter().filter(|part| !part.triangles.is_empty()).for_each(|part| file.add(part));
    file.pack()
}

#[derive(Default)]
struct Content {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    primitives: Vec<Value>,
}

impl Content {
    fn add(&mut self, part: &MeshPart) {
        let upright: Vec<[f32; 3]> = part.positions.iter().map(|&[x, y, z]| [x, z, -y]).collect();
        let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..3).map(|axis| upright.iter().map(|at| at[axis]).reduce(pick).unwrap_or_default()).collect()
        };
        let positions = upright.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(positions, VERTICES);
        let (least, most) = (bound(f32::min), bound(f32::max));
        self.accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": upright.len(), "type": "VEC3", "min": least, "max": most
        }));
        let corners = part.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect();
        let view = self.view(corners, CORNERS);
        self.accessors.push(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": 3 * part.triangles.len(), "type": "SCALAR"
        }));
        let [red, green, blue] = part.color.map(linear);
        self.materials.push(json!({
            "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": [red, green, blue, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6
            }
        }));
        let n = self.accessors.len();
        self.primitives.push(json!({
            "attributes": { "POSITION": n - 2 }, "indices": n - 1, "material": self.materials.len() - 1,
            "mode": TRIANGLES
        }));
    }

    /// Adds numbers of four bytes each; returns the number of their view.
    fn view(&mut self, bytes: Vec<u8>, target: u32) -> usize {
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len(), "target": target
        }));
        self.binary.extend(bytes);
        self.views.len() - 1
    }

    fn pack(self) -> Vec<u8> {
        let asset = json!({ "version": "2.0", "generator": concat!("harmzone ", env!("CARGO_PKG_VERSION")) });
        let document = if self.primitives.is_empty() {
            json!({ "asset": asset, "scene": 0, "scenes": [{}] })
        } else {
            json!({
                "asset": asset, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
                "meshes": [{ "primitives": self.primitives }], "materials": self.materials,
                "accessors": self.accessors, "bufferViews": self.views,
                "buffers": [{ "byteLength": self.binary.len() }]
            })
        };
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut file = Vec::new();
        let put = |file: &mut Vec<u8>, number: usize| {
            file.extend(
                u32::try_from(number).expect("a drawn model has far fewer than 2^32 bytes").to_le_bytes(),
            );
        };
        let binary_bytes = if self.binary.is_empty() { 0 } else { 8 + self.binary.len() };
        file.extend(MAGIC.to_le_bytes());
        file.extend(VERSION.to_le_bytes());
        put(&mut file, 12 + 8 + text.len() + binary_bytes);
        put(&mut file, text.len());
        file.extend(JSON_PART.to_le_bytes());
        file.extend(text);
        if !self.binary.is_empty() {
            put(&mut file, self.binary.len());
            file.extend(BINARY_PART.to_le_bytes());
            file.extend(self.binary);
        }
        file
    }
}

/// A part of a colour as screens show it (sRGB), as glTF counts it.
fn linear(part: f32) -> f32 {
    if part <= 0.040_45 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_comes_back_turned_upright() {
        let part = MeshPart {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 3.0]],
            triangles: vec![[0, 1, 2]],
            color: [1.0, 0.5, 0.0],
            ..MeshPart::default()
        };
        let nowhere = std::path::Path::new("");
        let content =
            super::super::glb::read(&to_glb(std::slice::from_ref(&part)), nowhere, nowhere).unwrap();
        let [read] = content.parts.as_slice() else { panic!("{} parts", content.parts.len()) };
        assert_eq!(read.triangles, part.triangles);
        assert_eq!(read.positions[2], [0.0, 3.0, -2.0]);
        assert_eq!(read.color[0], 1.0);
        assert!((read.color[1] - 0.214).abs() < 1e-3, "{:?}", read.color);
    }

    #[test]
    fn no_part_is_an_empty_scene() {
        // A scene without nodes has no list of them in glTF: an empty list is not valid.
        let file = to_glb(&[]);
        let document: Value = serde_json::from_slice(&file[20..]).unwrap();
        assert_eq!((&document["scenes"], document.get("nodes")), (&json!([{}]), None));
        assert_eq!(file[8..12], u32::try_from(file.len()).unwrap().to_le_bytes());
    }
}
