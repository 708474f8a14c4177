//! Object models: one folder each under `mjcf_assets/`, read into ready MJCF pieces and triangles.
//!
//! A model's frame has its origin at the footprint's centre on the ground, x forward, z up; its box
//! is the axis-aligned bound of its visual meshes.

use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

use super::mesh::triangles_of_obj;
use super::shipped;
use super::town::SceneError;
use crate::object::{Distribution, Kind};

/// Where the models are in the source tree.
const FOLDER: &str = "mjcf_assets";

/// Height below which a car could hit something, with some room.
pub const SOLID_M: f64 = 1.9;

/// What is higher may hang over the road: the clearance that German roads keep, metres.
const CLEARANCE_M: f64 = 4.5;

/// One object model.
#[derive(Debug, Clone)]
pub struct Model {
    pub name: String,
    pub category: String,
    pub kind: Kind,
    pub distribution: Distribution,
    /// Share of LiDAR light sent back at right angles, 0 to 1.
    pub reflectivity: f64,
    /// Against the other models of its kind, where a town gives no weights.
    pub weight: f64,
    /// Whether it faces the drivers who come, and not the street across the kerb.
    pub faces_traffic: bool,
    /// Of its collision shapes.
    pub mass_kg: f64,
    /// The axis, 0 to 2, about which it is round, if it rolls.
    pub rolls: Option<usize>,
    /// Material that may be recoloured for each instance.
    pub paint: Option<String>,
    /// Lowest and highest corner of the visual meshes, in the model frame.
    pub bounds: ([f64; 3], [f64; 3]),
    /// Lowest and highest x, y of what lies below [`SOLID_M`]: a tree's trunk without its crown.
    pub solid: ([f64; 2], [f64; 2]),
    /// Highest x of what hangs too low over a road.
    pub(super) overhang_m: f64,
    /// Visual triangles in the model frame.
    pub triangles: Arc<Vec<[Point3<f32>; 3]>>,
    /// `<asset>` children as MJCF text.
    pub(super) assets_xml: String,
    /// The paint material's element, for recolouring.
    pub(super) paint_xml: Option<String>,
    /// `<body>` children as MJCF text.
    pub(super) geoms_xml: String,
    /// Files that the assets name.
    pub(super) files: Vec<(String, &'static [u8])>,
}

impl Model {
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.bounds.1[0] - self.bounds.0[0]
    }

    #[must_use]
    pub fn width_m(&self) -> f64 {
        self.bounds.1[1] - self.bounds.0[1]
    }

    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.bounds.1[2] - self.bounds.0[2]
    }
}

/// Names of all models of the binary, sorted.
#[must_use]
pub fn names() -> Vec<String> {
    shipped::folders_with(FOLDER, "model.xml").into_iter().map(str::to_owned).collect()
}

/// All models of the binary, sorted by name.
#[derive(Debug, Clone)]
pub struct ModelLibrary {
    pub models: Vec<Model>,
}

impl ModelLibrary {
    /// Reads every model folder.
    ///
    /// # Errors
    /// [`SceneError::Model`] names the folder and what is wrong in it.
    pub fn load() -> Result<Self, SceneError> {
        let read = |name: &str| {
            read(name)
                .map_err(|message| SceneError::Model { message, path: PathBuf::from(FOLDER).join(name) })
        };
        let models = shipped::folders_with(FOLDER, "model.xml").into_iter().map(read);
        Ok(Self { models: models.collect::<Result<_, _>>()? })
    }

    /// Indices of the models of a kind and distribution.
    #[must_use]
    pub fn indices(&self, kind: Kind, distribution: Distribution) -> Vec<usize> {
        let fits = |model: &Model| model.kind == kind && model.distribution == distribution;
        (0..self.models.len()).filter(|&i| fits(&self.models[i])).collect()
    }
}

fn read(name: &str) -> Result<Model, String> {
    let xml = shipped::text(&inside(name, "model.xml")).ok_or("model.xml is not UTF-8 text")?;
    let document = Document::parse(xml).map_err(|error| error.to_string())?;
    let find = |tag: &str| document.descendants().find(|node| node.has_tag_name(tag));
    let custom = |key: &str| {
        let mut entries = document.descendants().filter(|node| node.attribute("data").is_some());
        entries.find(|node| node.attribute("name") == Some(key)).and_then(|node| node.attribute("data"))
    };
    let needed = |key: &str| custom(key).ok_or(format!("no custom `{key}`"));
    let kind = match needed("kind")? {
        "vehicle" => Kind::Vehicle,
        "pedestrian" => Kind::Pedestrian,
        "static" => Kind::Static,
        other => return Err(format!("kind `{other}` is none of vehicle, pedestrian, static")),
    };
    let distribution = match needed("distribution")? {
        "id" => Distribution::Id,
        "ood" => Distribution::Ood,
        other => return Err(format!("distribution `{other}` is none of id, ood")),
    };
    let reflectivity = needed("reflectivity")?.trim().parse().map_err(|_| "reflectivity is no number")?;
    let weight = custom("weight").map_or(Ok(1.0), |text| text.trim().parse());
    let weight = weight.map_err(|_| "weight is no number")?;
    let faces_traffic = match custom("faces") {
        None | Some("street") => false,
        Some("traffic") => true,
        Some(other) => return Err(format!("faces `{other}` is none of street, traffic")),
    };
    let rolls = match custom("rolls") {
        None => None,
        Some("y") => Some(1),
        Some("z") => Some(2),
        Some(other) => return Err(format!("rolls `{other}` is none of y, z")),
    };
    let paint = custom("paint").map(str::to_owned);

    let mut files: Vec<(String, &'static [u8])> = Vec::new();
    let mut assets_xml = String::new();
    let mut paint_xml = None;
    let asset_nodes = find("asset").ok_or("no <asset>")?;
    for node in asset_nodes.children().filter(Node::is_element) {
        let mut text = xml[node.range()].to_owned();
        if let Some(file) = node.attribute("file") {
            let bytes = shipped::bytes(&inside(name, file)).ok_or(format!("no file `{file}`"))?;
            let key = format!("{name}__{}", file.replace('/', "_"));
            text = text.replace(&format!("file=\"{file}\""), &format!("file=\"{key}\""));
            files.push((key, bytes));
        }
        if node.has_tag_name("material") && node.attribute("name") == paint.as_deref() {
            paint_xml = Some(text.clone());
        }
        assets_xml.push_str(&text);
        assets_xml.push('\n');
    }

    let body = find("worldbody").and_then(|world| world.children().find(|node| node.has_tag_name("body")));
    let body = body.ok_or("no <body> in <worldbody>")?;
    let mut geoms_xml = String::new();
    let mut triangles = Vec::new();
    let mut mass_kg = 0.0;
    for geom in body.children().filter(|node| node.has_tag_name("geom")) {
        geoms_xml.push_str(&xml[geom.range()]);
        geoms_xml.push('\n');
        mass_kg +=
            numbers(geom, "mass")?.and_then(|mass| mass.first().copied()).ok_or("a geom without mass")?;
        if let (Some(mesh), Some("2")) = (geom.attribute("mesh"), geom.attribute("group")) {
            let node = asset_nodes
                .children()
                .find(|node| node.has_tag_name("mesh") && node.attribute("name") == Some(mesh))
                .ok_or(format!("no mesh `{mesh}`"))?;
            triangles.extend(mesh_triangles(name, node, geom)?);
        }
    }
    let bounds = bounds_of(&triangles).ok_or("no visual triangles in group 2")?;
    let whole = ([bounds.0[0], bounds.0[1]], [bounds.1[0], bounds.1[1]]);
    let solid = bounds_below(&triangles, SOLID_M).unwrap_or(whole);
    let overhang_m = bounds_below(&triangles, CLEARANCE_M).unwrap_or(whole).1[0];
    let triangles = Arc::new(triangles);
    Ok(Model {
        name: name.to_owned(),
        category: needed("category")?.to_owned(),
        kind,
        distribution,
        reflectivity,
        weight,
        faces_traffic,
        mass_kg,
        rolls,
        paint,
        bounds,
        solid,
        overhang_m,
        triangles,
        assets_xml,
        paint_xml,
        geoms_xml,
        files,
    })
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

fn mesh_triangles(name: &str, mesh: Node, geom: Node) -> Result<Vec<[Point3<f32>; 3]>, String> {
    let file = mesh.attribute("file").ok_or("a mesh without a file")?;
    let text = shipped::text(&inside(name, file));
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
        return Err("a visual geom may be turned by quat only".into());
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

fn bounds_of(triangles: &[[Point3<f32>; 3]]) -> Option<([f64; 3], [f64; 3])> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in triangles.iter().flatten() {
        for axis in 0..3 {
            low[axis] = low[axis].min(f64::from(point[axis]));
            high[axis] = high[axis].max(f64::from(point[axis]));
        }
    }
    (!triangles.is_empty()).then_some((low, high))
}

/// Bounds on the ground of what is lower than a height.
fn bounds_below(triangles: &[[Point3<f32>; 3]], limit_m: f64) -> Option<([f64; 2], [f64; 2])> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let limit = limit_m as f32;
    let mut add = |point: Point3<f32>| {
        for axis in 0..2 {
            low[axis] = low[axis].min(f64::from(point[axis]));
            high[axis] = high[axis].max(f64::from(point[axis]));
        }
    };
    for triangle in triangles {
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            if a.z <= limit {
                add(a);
            }
            if (a.z <= limit) != (b.z <= limit) {
                add(a + (b - a) * ((limit - a.z) / (b.z - a.z)));
            }
        }
    }
    (low[0] < high[0] && low[1] < high[1]).then_some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_model_stands_on_the_ground_and_is_centred() {
        let library = ModelLibrary::load().unwrap();
        for model in &library.models {
            assert!(model.mass_kg > 0.5, "{} weighs {}", model.name, model.mass_kg);
            assert!(model.bounds.0[2].abs() < 0.06, "{} starts at {}", model.name, model.bounds.0[2]);
            for axis in 0..2 {
                let middle = f64::midpoint(model.bounds.0[axis], model.bounds.1[axis]);
                assert!(middle.abs() < 0.15, "{} is off by {middle} along {axis}", model.name);
            }
        }
    }

    #[test]
    fn a_lamp_reaches_over_the_road_and_a_crown_does_not() {
        let library = ModelLibrary::load().unwrap();
        let model = |name: &str| library.models.iter().find(|model| model.name == name).unwrap();
        assert!(model("street_lamp").overhang_m < model("street_lamp").bounds.1[0] - 0.3);
        assert!(model("tree").overhang_m > model("tree").bounds.1[0] - 0.1);
        assert!(model("traffic_sign").faces_traffic && !model("bench").faces_traffic);
        assert!(model("stall").weight == 0.0 && model("bench").weight == 1.0);
    }

    #[test]
    fn asset_names_are_unique_over_all_models() {
        let library = ModelLibrary::load().unwrap();
        let mut names = std::collections::BTreeSet::new();
        for model in &library.models {
            assert!(model.files.iter().all(|(name, _)| names.insert(name.clone())), "{}", model.name);
        }
    }
}
