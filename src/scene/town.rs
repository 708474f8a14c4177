//! Towns: an OpenDRIVE road network with a `town.toml` beside it, shipped in the binary or on disk.

use std::path::{Path as FilePath, PathBuf};

use fs_err as fs;
use include_dir::{Dir, include_dir};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::buildings::{self, Building};
use super::lights::Lights;
use super::network::LaneGraph;
use super::opendrive;
use super::surface::{Levels, Surface};

static SCENES: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/scenes");

/// Why a scene could not be made.
#[derive(Debug, Error)]
pub enum SceneError {
    #[error("no town `{name}`; there are {found:?}, or give the path of a .xodr file")]
    UnknownTown { name: String, found: Vec<String> },
    #[error("cannot read the town: {0}")]
    Read(#[from] std::io::Error),
    #[error("{message}: {}", path.display())]
    TownConfig { message: String, path: PathBuf },
    #[error("not a usable OpenDRIVE map: {message}: {}", path.display())]
    OpenDrive { message: String, path: PathBuf },
    #[error("the map has no lane that can be driven: {}", path.display())]
    NoLanes { path: PathBuf },
    #[error("{message}: {}", path.display())]
    Model { message: String, path: PathBuf },
    #[error("the town `{town}` has no place where the ego could start")]
    NoStart { town: String },
}

/// How a town is built and filled: `town.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TownConfig {
    pub description: String,
    /// `row`: walls touch; `detached`: `building_gap_m` lies between.
    pub building_style: String,
    pub building_height_m: [f64; 2],
    /// Along the street.
    pub building_width_m: [f64; 2],
    pub building_depth_m: [f64; 2],
    pub building_gap_m: [f64; 2],
    /// From the outer edge of the pavement.
    pub building_setback_m: [f64; 2],
    /// Share of the frontage that is built up, 0 to 1.
    pub building_share: f64,
    pub facade_textures: Vec<String>,
    pub road_texture: String,
    pub sidewalk_texture: String,
    pub ground_texture: String,
    /// Between one static prop and the next on a pavement.
    pub prop_spacing_m: [f64; 2],
    /// From the kerb to the middle of the prop.
    pub prop_kerb_distance_m: f64,
    /// How likely each category of prop is, relative to the others.
    pub prop_weights: std::collections::BTreeMap<String, f64>,
    pub traffic: TrafficConfig,
}

/// What moves and parks in a town.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrafficConfig {
    /// Share of parking places taken, 0 to 1.
    pub parked_share: f64,
    /// Length of one parking place.
    pub parking_place_m: f64,
    /// Moving vehicles in the whole town.
    pub n_vehicles: u32,
    /// Walking pedestrians in the whole town.
    pub n_pedestrians: u32,
    /// Share of pedestrians that set out across the street, 0 to 1.
    pub pedestrian_crossing_share: f64,
    /// How likely each category of vehicle is, relative to the others.
    pub vehicle_weights: std::collections::BTreeMap<String, f64>,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            parked_share: 0.4,
            parking_place_m: 6.0,
            n_vehicles: 28,
            n_pedestrians: 40,
            pedestrian_crossing_share: 0.15,
            vehicle_weights: std::collections::BTreeMap::new(),
        }
    }
}

impl Default for TownConfig {
    fn default() -> Self {
        Self {
            description: String::new(),
            building_style: "row".into(),
            building_height_m: [7.0, 20.0],
            building_width_m: [9.0, 20.0],
            building_depth_m: [9.0, 13.0],
            building_gap_m: [0.0, 0.0],
            building_setback_m: [0.5, 3.0],
            building_share: 0.8,
            facade_textures: Vec::new(),
            road_texture: "asphalt".into(),
            sidewalk_texture: "pavement".into(),
            ground_texture: "grass".into(),
            prop_spacing_m: [8.0, 18.0],
            prop_kerb_distance_m: 0.55,
            prop_weights: std::collections::BTreeMap::new(),
            traffic: TrafficConfig::default(),
        }
    }
}

/// A town: its roads, its ground and its buildings.
#[derive(Debug, Clone)]
pub struct Town {
    pub name: String,
    pub config: TownConfig,
    pub graph: LaneGraph,
    pub lights: Lights,
    pub surface: Surface,
    pub buildings: Vec<Building>,
    /// What of the map could not be used, in counts.
    pub notes: Vec<String>,
}

/// Names of the shipped towns, sorted.
#[must_use]
pub fn town_names() -> Vec<String> {
    let mut names: Vec<String> = SCENES
        .dirs()
        .filter(|dir| dir.get_file(dir.path().join("road.xodr")).is_some())
        .map(|dir| dir.path().display().to_string())
        .collect();
    names.sort();
    names
}

impl Town {
    /// Loads a shipped town by name, or any `.xodr` by path with the `town.toml` beside it, if any.
    ///
    /// # Errors
    /// [`SceneError`]: no such town (the message lists those that exist), unreadable file, broken
    /// map or config, a map without driving lanes.
    pub fn load(name_or_path: &str) -> Result<Self, SceneError> {
        let path = FilePath::new(name_or_path);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xodr")) {
            let xodr = fs::read_to_string(path)?;
            let toml_path = path.with_file_name("town.toml");
            let toml = if toml_path.exists() { Some(fs::read_to_string(&toml_path)?) } else { None };
            let stem = path.file_stem().map_or_else(|| "town".into(), |stem| stem.to_string_lossy());
            // A shipped town given by path keeps its folder's name.
            let name = match path.parent().and_then(FilePath::file_name) {
                Some(folder) if stem == "road" => folder.to_string_lossy().into_owned(),
                _ => stem.to_lowercase(),
            };
            return Self::parse(&name, &xodr, toml.as_deref(), path);
        }
        let file = |leaf: &str| SCENES.get_file(format!("{name_or_path}/{leaf}"))?.contents_utf8();
        let xodr = file("road.xodr")
            .ok_or_else(|| SceneError::UnknownTown { name: name_or_path.to_owned(), found: town_names() })?;
        Self::parse(name_or_path, xodr, file("town.toml"), &FilePath::new("scenes").join(name_or_path))
    }

    fn parse(name: &str, xodr: &str, toml: Option<&str>, path: &FilePath) -> Result<Self, SceneError> {
        let config: TownConfig =
            toml.map_or_else(|| Ok(TownConfig::default()), toml::from_str).map_err(|error| {
                SceneError::TownConfig { message: error.to_string(), path: path.with_file_name("town.toml") }
            })?;
        let (network, mut notes) = opendrive::read(xodr)
            .map_err(|message| SceneError::OpenDrive { message, path: path.to_owned() })?;
        let levels = Levels::of(&network);
        notes.extend(levels.note());
        let (mut graph, unused) = LaneGraph::read(&network, |id| levels.is_above(id));
        notes.extend(unused);
        if graph.lanes.is_empty() {
            return Err(SceneError::NoLanes { path: path.to_owned() });
        }
        let crosswalks = opendrive::crosswalks(&network);
        let (lights, unknown) = Lights::read(&network, &mut graph, &crosswalks);
        notes.extend(unknown);
        let surface = Surface::new(&network, &graph, levels, &crosswalks);
        let buildings = buildings::grow(&surface, &config, 0);
        Ok(Self { name: name.to_owned(), config, graph, lights, surface, buildings, notes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_town_lists_those_that_exist() {
        let message = Town::load("atlantis").unwrap_err().to_string();
        assert!(message.contains("atlantis") && message.contains("downtown"), "{message}");
    }

    #[test]
    fn every_lane_of_a_shipped_town_leads_on() {
        for name in town_names() {
            let town = Town::load(&name).unwrap();
            assert!(town.graph.lanes.iter().all(|lane| !lane.successors.is_empty()), "{name}");
        }
    }

    #[test]
    fn no_building_stands_on_a_road_or_in_another() {
        let town = Town::load("downtown").unwrap();
        assert!(town.buildings.len() > 50, "{}", town.buildings.len());
        for (i, building) in town.buildings.iter().enumerate() {
            assert!(town.surface.road_grid.clearance_m(building.footprint.center) > 3.0);
            assert!(town.buildings[..i].iter().all(|other| !other.footprint.meets(&building.footprint)));
        }
    }
}
