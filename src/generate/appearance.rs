//! How each geom of a world looks to the sensors: material for the camera, surface for the LiDAR.
//!
//! Found by the names that the scene gives its geoms, and the models their materials.

use std::collections::{BTreeSet, HashMap};

use super::GenerateError;
use super::drive::Drive;
use super::surfaces::{Surface, surface_of};
use crate::scene::{Motion, World};
use crate::sensors::camera::{Material, StreetLamp};
use crate::sensors::lidar::Finish;

/// Geoms on which water stands.
const PAVED: [&str; 5] = ["scene_road", "scene_pavement", "scene_kerb", "scene_marks", "ground"];

/// The geoms of one world, by geom id.
#[derive(Debug, Clone)]
pub(super) struct Appearance {
    /// Object of each geom, if it belongs to one.
    objects: Vec<Option<usize>>,
    materials: Vec<Material>,
    surfaces: Vec<Surface>,
    is_paved: Vec<bool>,
    /// Index in `background` of what each geom shows that is never annotated.
    background_of_geom: Vec<Option<usize>>,
    /// Categories of all that stands in the world and is never annotated, sorted.
    pub background: Vec<String>,
    /// All lamps that light the streets.
    pub lamps: Vec<StreetLamp>,
}

impl Appearance {
    pub(super) fn new(world: &World, drive: &Drive) -> Result<Self, GenerateError> {
        let simulator = &drive.simulator;
        let mut object_of_body: HashMap<usize, usize> =
            drive.object_bodies.iter().enumerate().map(|(object, &body)| (body, object)).collect();
        for (i, object) in world.objects().iter().enumerate() {
            let bodies = (0..object.shapes.len()).map(|shape| object.shape_body_name(shape));
            object_of_body.extend(bodies.filter_map(|name| Some((simulator.body(&name)?, i))));
        }
        let objects: Vec<Option<usize>> =
            simulator.geom_bodies().iter().map(|body| object_of_body.get(body).copied()).collect();
        let names = simulator.geom_names();
        // Parked cars are dark.
        let is_lit = |object: Option<usize>| {
            object.is_some_and(|i| matches!(world.placements[i].motion, Motion::Drives { .. }))
        };
        let material_of = |geom: usize| {
            let part = simulator.geom_materials()[geom].rsplit('/').next().unwrap_or_default();
            match part {
                "headlamp" if is_lit(objects[geom]) => Material::Headlamp,
                "taillamp" if is_lit(objects[geom]) => Material::Taillamp,
                "signal_red" | "signal_yellow" | "signal_green" => Material::Signal,
                _ if PAVED.iter().any(|start| names[geom].starts_with(start)) => Material::Paved,
                _ if names[geom].starts_with("scene_facade") => Material::Facade,
                _ => Material::Solid,
            }
        };
        let surface = |geom: usize| {
            let object = objects[geom].map(|object| &world.objects()[object]);
            let paint = objects[geom].and_then(|object| world.placements[object].paint);
            surface_of(&names[geom], &simulator.geom_materials()[geom], object, paint)
        };
        let n_geoms = objects.len();
        let background_category = |geom: usize| match objects[geom] {
            Some(object) => {
                let object = &world.objects()[object];
                object.is_background.then_some(object.category.as_str())
            }
            // `scene_roof_2` is a roof.
            None => names[geom]
                .strip_prefix("scene_")
                .map(|name| name.trim_end_matches(|last: char| last == '_' || last.is_ascii_digit())),
        };
        let background: BTreeSet<&str> = (0..n_geoms).filter_map(background_category).collect();
        let background: Vec<String> = background.into_iter().map(str::to_owned).collect();
        let number = |category: &str| background.iter().position(|name| name == category);
        let background_of_geom =
            (0..n_geoms).map(|geom| background_category(geom).and_then(number)).collect();
        let materials: Vec<Material> = (0..n_geoms).map(material_of).collect();
        let centers = simulator.geom_centers()?;
        let is_lamp = |geom: &usize| simulator.geom_materials()[*geom].ends_with("_lamp/lamp");
        let lamps = (0..n_geoms)
            .filter(is_lamp)
            .map(|geom| StreetLamp { position_in_world: centers[geom] })
            .collect();
        Ok(Self {
            surfaces: (0..n_geoms).map(surface).collect(),
            is_paved: materials.iter().map(|material| *material == Material::Paved).collect(),
            materials,
            objects,
            background_of_geom,
            background,
            lamps,
        })
    }

    /// The object that a geom belongs to; -1 means no geom.
    pub(super) fn object(&self, geom: i32) -> Option<usize> {
        usize::try_from(geom).ok().and_then(|geom| self.objects[geom])
    }

    /// Index of the background category that a geom shows, if it does; -1 means no geom.
    pub(super) fn background(&self, geom: i32) -> Option<usize> {
        usize::try_from(geom).ok().and_then(|geom| self.background_of_geom[geom])
    }

    /// What a geom shows; -1, no geom, is the sky.
    pub(super) fn material(&self, geom: i32) -> Material {
        usize::try_from(geom).map_or(Material::Sky, |geom| self.materials[geom])
    }

    /// What a beam meets, and whether water stands on it; -1 means no geom.
    pub(super) fn surface(&self, geom: i32) -> (Surface, bool) {
        let none = Surface { reflectivity: 0.0, finish: Finish::Matt };
        usize::try_from(geom).map_or((none, false), |geom| (self.surfaces[geom], self.is_paved[geom]))
    }
}
