//! Binary glTF 2.0: the meshes of its scene, with base colours and their textures.

use std::path::Path;

use gltf::accessor::{DataType, Dimensions};
use gltf::image::Source;
use gltf::mesh::Mode;
use image::RgbImage;
use nalgebra::{Matrix4, Point3};

use super::{Content, MOST_TRIANGLES, MeshPart, UpAxis, named_texture, texture};

pub(super) fn read(bytes: &[u8], path: &Path, folder: &Path) -> Result<Content, String> {
    let no_whole_file = |error: gltf::Error| format!("it is not a whole GLB file: {error}");
    check_attributes(&gltf::Gltf::from_slice_without_validation(bytes).map_err(no_whole_file)?.document)?;
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(bytes).map_err(no_whole_file)?;
    let blob = blob.ok_or("it has no binary part; glTF in several files is not read")?;
    let mut reader = Reader {
        blob: &blob,
        base: path.parent().unwrap_or(folder),
        folder,
        n_left: document.nodes().len(),
        n_numbers: 0,
        parts: Vec::new(),
        notes: Vec::new(),
    };
    let scene = document.default_scene().or_else(|| document.scenes().next()).ok_or("it has no scene")?;
    for node in scene.nodes() {
        reader.add(&node, &Matrix4::identity(), 0)?;
    }
    Ok(Content { parts: reader.parts, metres: true, up: Some(UpAxis::Y), notes: reader.notes })
}

/// Refuses meshes whose numbers the file does not list, on which the crate `gltf` panics while it validates.
fn check_attributes(document: &gltf::Document) -> Result<(), String> {
    let root = document.as_json();
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let n_accessors = root.accessors.len();
    match primitives.flat_map(|of| of.attributes.values()).find(|accessor| accessor.value() >= n_accessors) {
        Some(accessor) => {
            Err(format!("a mesh names the numbers {} of {n_accessors} in the file", accessor.value()))
        }
        None => Ok(()),
    }
}

/// Nodes lie in nodes at most so deep; glTF forbids circles, a broken file may have them.
const DEEPEST: usize = 64;

/// Most numbers of a file. A mesh need hold none of its own: parts share them, and what is not stated is zero.
const MOST_NUMBERS: usize = 12 * MOST_TRIANGLES;

struct Reader<'a> {
    blob: &'a [u8],
    /// The file's own folder, from which it names others, and the one that they must lie in.
    base: &'a Path,
    folder: &'a Path,
    /// Nodes that can still come: each lies in one other at most.
    n_left: usize,
    /// Positions, corners and places in textures so far.
    n_numbers: usize,
    parts: Vec<MeshPart>,
    notes: Vec<String>,
}

impl Reader<'_> {
    fn add(
        &mut self,
        node: &gltf::Node,
        scene_from_parent: &Matrix4<f32>,
        depth: usize,
    ) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("its nodes lie deeper than {DEEPEST} in each other"));
        }
        self.n_left = self.n_left.checked_sub(1).ok_or("one of its nodes lies in two others")?;
        let parent_from_node = Matrix4::from_fn(|row, column| node.transform().matrix()[column][row]);
        let scene_from_node = scene_from_parent * parent_from_node;
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            if primitive.mode() == Mode::Triangles {
                let part = self.part(&primitive, &scene_from_node)?;
                self.parts.push(part);
            } else {
                self.notes.push("lines, points, strips and fans are left out".into());
            }
        }
        for child in node.children() {
            self.add(&child, &scene_from_node, depth + 1)?;
        }
        Ok(())
    }

    fn part(
        &mut self,
        primitive: &gltf::Primitive,
        scene_from_node: &Matrix4<f32>,
    ) -> Result<MeshPart, String> {
        self.n_numbers = self.n_numbers.saturating_add(count(primitive)?);
        if self.n_numbers > MOST_NUMBERS {
            return Err(format!("it has more than {MOST_NUMBERS} positions, corners and places in textures"));
        }
        let blob = self.blob;
        let reader = primitive.reader(|buffer| (buffer.index() == 0).then_some(blob));
        let place =
            |position: [f32; 3]| scene_from_node.transform_point(&Point3::from(position)).coords.into();
        let positions: Vec<[f32; 3]> =
            reader.read_positions().ok_or("a mesh has no positions")?.map(place).collect();
        let corners: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let mut triangles = corners.as_chunks::<3>().0.to_vec();
        if scene_from_node.fixed_view::<3, 3>(0, 0).determinant() < 0.0 {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let material = primitive.material().pbr_metallic_roughness();
        let [red, green, blue, _] = material.base_color_factor();
        let textured = material.base_color_texture();
        let places: Vec<[f32; 2]> = textured
            .as_ref()
            .and_then(|info| reader.read_tex_coords(info.tex_coord()))
            // glTF counts v downwards.
            .map(|places| places.into_f32().map(|[u, v]| [u, 1.0 - v]).collect())
            .unwrap_or_default();
        let texture = match textured.filter(|_| places.len() == positions.len()) {
            Some(info) => self.image(info.texture().source().source())?,
            None => None,
        };
        let texture_places = if texture.is_some() { places } else { Vec::new() };
        Ok(MeshPart { positions, texture_places, triangles, color: [red, green, blue], texture })
    }

    fn image(&mut self, source: Source) -> Result<Option<RgbImage>, String> {
        match source {
            Source::View { view, .. } => {
                let end = view.offset().checked_add(view.length());
                let bytes = end.and_then(|end| self.blob.get(view.offset()..end));
                texture(bytes.ok_or("a texture ends beyond the file")?).map(Some)
            }
            Source::Uri { uri, .. } => named_texture(self.folder, self.base, uri, &mut self.notes),
        }
    }
}

/// The numbers that a mesh has; refuses those that glTF does not allow, on which the crate `gltf` panics.
fn count(primitive: &gltf::Primitive) -> Result<usize, String> {
    let places =
        primitive.attributes().filter(|(semantic, _)| matches!(semantic, gltf::Semantic::TexCoords(_)));
    let whole = [DataType::U8, DataType::U16, DataType::U32];
    let positions = primitive.get(&gltf::Semantic::Positions).into_iter();
    let positions = positions.map(|of| ("positions", of, &[DataType::F32][..], Dimensions::Vec3));
    let corners = primitive.indices().into_iter().map(|of| ("corners", of, &whole[..], Dimensions::Scalar));
    let floats = [DataType::U8, DataType::U16, DataType::F32];
    let places = places.map(|(_, of)| ("places in a texture", of, &floats[..], Dimensions::Vec2));
    let mut n_numbers = 0_usize;
    for (what, accessor, types, dimensions) in positions.chain(corners).chain(places) {
        if !types.contains(&accessor.data_type()) || accessor.dimensions() != dimensions {
            let (found, each) = (accessor.data_type(), accessor.dimensions());
            return Err(format!(
                "its {what} are {found:?} as {each:?}; {types:?} as {dimensions:?} is valid"
            ));
        }
        let of_values = accessor.sparse().map(|sparse| (sparse.values().view(), accessor.size()));
        let of_indices = accessor.sparse().map(|sparse| {
            let indices = sparse.indices();
            (indices.view(), indices.index_type().size())
        });
        let views = accessor.view().map(|view| (view, accessor.size())).into_iter();
        let is_short =
            |(view, size): (gltf::buffer::View, usize)| view.stride().is_some_and(|stride| stride < size);
        if views.chain(of_values).chain(of_indices).any(is_short) {
            return Err(format!("its {what} lie over each other"));
        }
        n_numbers = accessor.count().saturating_add(n_numbers);
    }
    Ok(n_numbers)
}
