//! STL, binary or text.

use std::io::Cursor;

use super::{Content, GREY, MeshPart};

pub(super) fn read(bytes: &[u8]) -> Result<Content, String> {
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes))
        .map_err(|error| format!("it is not a whole STL file: {error}"))?;
    let part = MeshPart {
        positions: mesh.vertices.iter().map(|vertex| vertex.0).collect(),
        triangles: mesh.faces.iter().map(|face| face.vertices.map(|corner| corner as u32)).collect(),
        color: GREY,
        ..MeshPart::default()
    };
    Ok(Content { parts: vec![part], metres: false, up: None, notes: Vec::new() })
}
