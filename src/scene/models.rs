//! Object models: one folder each under `mjcf_assets/`, read into ready MJCF pieces and triangles.
//!
//! A model's frame has its origin at the footprint's centre on the ground, x forward, z up; its box
//! is the axis-aligned bound of its visual meshes.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};
use serde::Deserialize;

pub use super::bounds::Bounds;
use super::bounds::{bounds_below, bounds_of};
use super::error::SceneError;
pub use super::facing::{Faces, Role, RollAxis};
use super::mesh::triangles_of_obj;
use super::shape::Shape;
use super::shipped;
use super::split::SceneSplit;
use crate::object::{Distribution, Kind};

/// Where the models are in the source tree.
const FOLDER: &str = "mjcf_assets";
/// The file that describes a model, in the model's folder.
pub(super) const MODEL_FILE: &str = "model.xml";

/// Height below which a car could hit something, with some room.
pub const SOLID_M: f64 = 1.9;

/// Parts above this height may hang over the road: the clearance that German roads keep, metres.
const CLEARANCE_M: f64 = 4.5;

/// The content of a model's `<custom>` element.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFacts {
    /// The family of the model: `car`, `hay_bale`.
    pub category: String,
    pub kind: Kind,
    pub distribution: Distribution,
    #[serde(default)]
    pub role: Role,
    /// Where the model is unfamiliar, the worlds that may hold it; the familiar ones are in all.
    #[serde(default)]
    pub split: SceneSplit,
    /// Share of LiDAR light sent back at right angles, 0 to 1.
    pub reflectivity: f64,
    /// How likely the model is, relative to others of its kind, where a town gives no weights.
    #[serde(default = "one")]
    pub weight: f64,
    #[serde(default)]
    pub faces: Faces,
    /// If it rolls.
    pub rolls: Option<RollAxis>,
    /// Material that may be recoloured for each instance.
    pub paint: Option<String>,
}

fn one() -> f64 {
    1.0
}

/// One object model.
#[derive(Debug, Clone)]
pub struct Model {
    pub name: String,
    pub facts: ModelFacts,
    /// Bounds of its collision shapes.
    pub mass_kg: f64,
    /// Bounds of the visual meshes, in the model frame.
    pub bounds: Bounds,
    /// Bounds of the part below [`SOLID_M`]: a tree's trunk without its crown.
    pub solid: Bounds,
    /// Greatest x of the parts that hang too low over a road.
    pub(super) overhang_m: f64,
    /// Visual triangles in the model frame.
    pub triangles: Arc<Vec<[Point3<f32>; 3]>>,
    /// `<asset>` children as MJCF text.
    pub(super) assets_xml: String,
    /// The paint material's element, for recolouring.
    pub(super) paint_xml: Option<String>,
    /// `<body>` children as MJCF text.
    pub(super) geoms_xml: String,
    /// Its looks, if it changes its shape: at rest, then the phases of a gait. `geoms_xml` shows nothing then.
    pub(super) shapes: Vec<Shape>,
    /// Way that a cycle of the gait takes.
    pub(super) stride_m: f64,
    /// Files that the assets name.
    pub(super) files: Vec<(String, Arc<[u8]>)>,
}

impl Model {
    pub fn length_m(&self) -> f64 {
        self.bounds[1].x - self.bounds[0].x
    }

    pub fn width_m(&self) -> f64 {
        self.bounds[1].y - self.bounds[0].y
    }

    pub fn height_m(&self) -> f64 {
        self.bounds[1].z - self.bounds[0].z
    }
}

/// Names of all models of the binary, sorted.
pub fn names() -> Vec<String> {
    shipped::folders_with(FOLDER, MODEL_FILE).into_iter().map(str::to_owned).collect()
}

/// All models of the binary, sorted by name; a process reads them once.
///
/// # Errors
/// [`SceneError::Model`] names the file and what is wrong in it.
pub fn load() -> Result<Vec<Model>, SceneError> {
    static MODELS: OnceLock<Vec<Model>> = OnceLock::new();
    if let Some(models) = MODELS.get() {
        return Ok(models.clone());
    }
    let models = read_all()?;
    Ok(MODELS.get_or_init(|| models).clone())
}

/// Reads every model folder of the binary.
fn read_all() -> Result<Vec<Model>, SceneError> {
    let read = |name: &str| {
        let path = inside(name, MODEL_FILE);
        let xml = shipped::text(&path).ok_or("it is not UTF-8 text".to_owned());
        let bytes = |file: &str| shipped::bytes(&inside(name, file)).map(Into::into);
        xml.and_then(|xml| read(name, xml, &bytes))
            .map_err(|message| SceneError::Model { message, path: PathBuf::from(path) })
    };
    shipped::folders_with(FOLDER, MODEL_FILE).into_iter().map(read).collect()
}

/// Indices of the models of a kind and distribution.
pub fn indices_of(models: &[Model], kind: Kind, distribution: Distribution) -> Vec<usize> {
    let fits = |model: &Model| model.facts.kind == kind && model.facts.distribution == distribution;
    (0..models.len()).filter(|&i| fits(&models[i])).collect()
}

/// A file of a model's folder by its name.
pub(super) type FileOf<'a> = &'a dyn Fn(&str) -> Option<Arc<[u8]>>;

/// Reads a model's description.
pub(super) fn read(name: &str, xml: &str, file_of: FileOf) -> Result<Model, String> {
    let document = Document::parse(xml).map_err(|error| error.to_string())?;
    let root = document.root_element();
    require_only(root, &["custom", "asset", "worldbody"])?;
    let facts = read_facts(child(root, "custom")?)?;
    let asset = child(root, "asset")?;
    let body = child(child(root, "worldbody")?, "body")?;
    require_only(body, &["geom"])?;

    let mut files: Vec<(String, Arc<[u8]>)> = Vec::new();
    let mut assets_xml = String::new();
    let mut paint_xml = None;
    for node in asset.children().filter(Node::is_element) {
        let own = node.attribute("name").unwrap_or_default();
        if !own.starts_with(&format!("{name}/")) {
            let tag = node.tag_name().name();
            return Err(format!(
                "<{tag} name=\"{own}\">: the name must begin with `{name}/`, the folder's name"
            ));
        }
        let is_second = |name: &&str| name.starts_with("file") && *name != "file";
        if let Some(second) = node.attributes().map(|attribute| attribute.name()).find(is_second) {
            return Err(format!("`{own}` names a file by `{second}`; `file` alone is read"));
        }
        let mut text = xml[node.range()].to_owned();
        if let Some(file) = node.attribute("file") {
            let bytes =
                file_of(file).ok_or(format!("there is no file `{file}` (.obj or .png) in the folder"))?;
            let key = format!("{name}__{}", file.replace('/', "_"));
            text = text.replace(&format!("file=\"{file}\""), &format!("file=\"{key}\""));
            files.push((key, bytes));
        }
        if node.has_tag_name("material") && Some(own) == facts.paint.as_deref() {
            paint_xml = Some(text.clone());
        }
        assets_xml.push_str(&text);
        assets_xml.push('\n');
    }
    if let (Some(paint), None) = (&facts.paint, &paint_xml) {
        return Err(format!("`paint` is `{paint}`; there is no such <material>"));
    }

    let mut geoms_xml = String::new();
    let mut triangles = Vec::new();
    let mut mass_kg = 0.0;
    for geom in body.children().filter(Node::is_element) {
        geoms_xml.push_str(&xml[geom.range()]);
        geoms_xml.push('\n');
        mass_kg += numbers(geom, "mass")?
            .and_then(|mass| mass.first().copied())
            .ok_or("a <geom> has no `mass`; it takes 0 for what is only seen")?;
        if let (Some(mesh), Some("2")) = (geom.attribute("mesh"), geom.attribute("group")) {
            let node = asset
                .children()
                .find(|node| node.has_tag_name("mesh") && node.attribute("name") == Some(mesh))
                .ok_or(format!("there is no <mesh> `{mesh}`"))?;
            triangles.extend(mesh_triangles(file_of, node, geom)?);
        }
    }
    if mass_kg <= 0.0 {
        return Err("no <geom> has a mass; give one of group 3, the shape that others hit".into());
    }
    let corners = triangles.iter().flatten().copied();
    let bounds = bounds_of(corners).ok_or("no <geom> of group 2 shows a mesh: nothing can be seen")?;
    let solid = bounds_below(&triangles, SOLID_M).unwrap_or(bounds);
    let overhang_m = bounds_below(&triangles, CLEARANCE_M).unwrap_or(bounds)[1].x;
    let triangles = Arc::new(triangles);
    let name = name.to_owned();
    Ok(Model {
        name,
        facts,
        mass_kg,
        bounds,
        solid,
        overhang_m,
        triangles,
        assets_xml,
        paint_xml,
        geoms_xml,
        shapes: Vec::new(),
        stride_m: 0.0,
        files,
    })
}

fn child<'a, 'b>(node: Node<'a, 'b>, tag: &str) -> Result<Node<'a, 'b>, String> {
    let found = node.children().find(|child| child.has_tag_name(tag));
    found.ok_or_else(|| format!("<{}> has no <{tag}>", node.tag_name().name()))
}

/// Refuses what the program does not read, which would be lost without a word.
fn require_only(node: Node, tags: &[&str]) -> Result<(), String> {
    let is_other = |child: &Node| child.is_element() && !tags.contains(&child.tag_name().name());
    match node.children().find(is_other) {
        None => Ok(()),
        Some(other) => Err(format!(
            "<{}> holds <{}>; it takes only {tags:?}",
            node.tag_name().name(),
            other.tag_name().name()
        )),
    }
}

/// Texts and numbers by name.
fn read_facts(custom: Node) -> Result<ModelFacts, String> {
    let mut facts = serde_json::Map::new();
    for node in custom.children().filter(Node::is_element) {
        let needed = |key| node.attribute(key).ok_or(format!("an element of <custom> has no `{key}`"));
        let (key, data) = (needed("name")?, needed("data")?);
        let value = if node.has_tag_name("numeric") {
            let number =
                data.trim().parse::<f64>().map_err(|_| format!("`{key}` is `{data}`, not a number"))?;
            number.into()
        } else {
            data.into()
        };
        facts.insert(key.to_owned(), value);
    }
    let facts: ModelFacts =
        serde_json::from_value(facts.into()).map_err(|error| format!("<custom>: {error}"))?;
    for (key, value, most) in [("reflectivity", facts.reflectivity, 1.0), ("weight", facts.weight, 1e6)] {
        if !(0.0..=most).contains(&value) {
            return Err(format!("<custom>: `{key}` is {value}; it takes 0 to {most}"));
        }
    }
    if facts.split == SceneSplit::Test && facts.distribution == Distribution::Id {
        return Err("<custom>: `split` is `test`, which only a model of distribution `ood` takes".into());
    }
    Ok(facts)
}

/// Path of a model's file in the source tree.
fn inside(name: &str, file: &str) -> String {
    format!("{FOLDER}/{name}/{file}")
}

fn numbers(node: Node, attribute: &str) -> Result<Option<Vec<f64>>, String> {
    let Some(text) = node.attribute(attribute) else { return Ok(None) };
    let parsed: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    parsed.map(Some).map_err(|_| format!("{attribute}=\"{text}\" is not a list of numbers"))
}

fn mesh_triangles(file_of: FileOf, mesh: Node, geom: Node) -> Result<Vec<[Point3<f32>; 3]>, String> {
    let file = mesh.attribute("file").ok_or("a <mesh> of group 2 has no `file`")?;
    let bytes = file_of(file);
    let text = bytes.as_ref().and_then(|bytes| std::str::from_utf8(bytes).ok());
    let triangles = text.and_then(triangles_of_obj).ok_or(format!("`{file}` is not an OBJ mesh"))?;
    let scale = match numbers(mesh, "scale")?.as_deref() {
        Some(&[x, y, z]) => Vector3::new(x, y, z),
        _ => Vector3::repeat(1.0),
    };
    let shift = match numbers(geom, "pos")?.as_deref() {
        Some(&[x, y, z]) => Translation3::new(x, y, z),
        _ => Translation3::identity(),
    };
    if geom.attribute("euler").is_some() || geom.attribute("axisangle").is_some() {
        return Err("a <geom> of group 2 may be turned by `quat` only".into());
    }
    let turn = match numbers(geom, "quat")?.as_deref() {
        Some(&[w, x, y, z]) => UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
        _ => UnitQuaternion::identity(),
    };
    let model_from_mesh = Isometry3::from_parts(shift, turn).cast::<f32>();
    let scale = scale.cast::<f32>();
    let place = |point: Point3<f32>| model_from_mesh * Point3::from(point.coords.component_mul(&scale));
    Ok(triangles.into_iter().map(|triangle| triangle.map(place)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_model_stands_on_the_ground_and_is_centred() {
        let library = load().unwrap();
        for model in &library {
            let [low, high] = model.bounds;
            assert!(model.mass_kg > 0.5, "{} weighs {}", model.name, model.mass_kg);
            assert!(low.z.abs() < 0.06, "{} starts at {}", model.name, low.z);
            let middle = nalgebra::center(&low, &high);
            assert!(middle.x.abs() < 0.15 && middle.y.abs() < 0.15, "{} is off by {middle}", model.name);
        }
    }

    #[test]
    fn a_lamp_reaches_over_the_road_and_a_crown_does_not() {
        let library = load().unwrap();
        let model = |name: &str| library.iter().find(|model| model.name == name).unwrap();
        assert!(model("street_lamp").overhang_m < model("street_lamp").bounds[1].x - 0.3);
        assert!(model("tree").overhang_m > model("tree").bounds[1].x - 0.1);
        assert_eq!(model("traffic_sign").facts.faces, Faces::Traffic);
        assert!(model("stall").facts.weight == 0.0 && model("bench").facts.weight == 1.0);
    }

    #[test]
    fn a_fault_in_a_model_is_named() {
        let xml = shipped::text("mjcf_assets/barrel_a/model.xml").unwrap();
        let bytes = |file: &str| shipped::bytes(&inside("barrel_a", file)).map(Into::into);
        for (from, to, wanted) in [
            ("</custom>", "", "expected 'custom' tag"),
            ("<custom>", "<default/><custom>", "<mujoco> holds <default>; it takes only"),
            ("data=\"ood\"", "data=\"odd\"", "<custom>: unknown variant `odd`, expected `id` or `ood`"),
            (
                "data=\"ood\"/>",
                "data=\"id\"/><text name=\"split\" data=\"test\"/>",
                "`split` is `test`, which only a model of distribution `ood` takes",
            ),
            (
                "name=\"rolls\"",
                "name=\"roles\"",
                "<custom>: unknown field `roles`, expected one of `category`",
            ),
            ("name=\"kind\"", "name=\"weight\"", "<custom>: invalid type: string"),
            ("data=\"0.5\"", "data=\"1.5\"", "<custom>: `reflectivity` is 1.5; it takes 0 to 1"),
            ("data=\"0.5\"", "data=\"half\"", "`reflectivity` is `half`, not a number"),
            ("file=\"paint.obj\"", "file=\"paint.stl\"", "there is no file `paint.stl` (.obj or .png)"),
            ("<mesh name=\"barrel_a/paint\"", "<mesh name=\"paint\"", "the name must begin with `barrel_a/`"),
            (
                "data=\"barrel_a/paint\"",
                "data=\"barrel_a/red\"",
                "`paint` is `barrel_a/red`; there is no such",
            ),
            ("mesh=\"barrel_a/paint\"", "mesh=\"barrel_a/lid\"", "there is no <mesh> `barrel_a/lid`"),
            ("mass=\"20\"", "", "a <geom> has no `mass`"),
            ("mass=\"20\"", "mass=\"0\"", "no <geom> has a mass"),
            ("group=\"2\"", "group=\"1\"", "nothing can be seen"),
            ("<geom type=\"cylinder\"", "<freejoint/><geom type=\"cylinder\"", "<body> holds <freejoint>"),
        ] {
            assert!(xml.contains(from), "{from}");
            let message = read("barrel_a", &xml.replace(from, to), &bytes).unwrap_err();
            assert!(message.contains(wanted), "{from} -> {to}: {message}");
        }
    }

    #[test]
    fn asset_names_are_unique_over_all_models() {
        let library = load().unwrap();
        let mut names = std::collections::BTreeSet::new();
        for model in &library {
            assert!(model.files.iter().all(|(name, _)| names.insert(name.clone())), "{}", model.name);
        }
    }
}
