//! Towns: an OpenDRIVE road network with a `town.toml` beside it, shipped in the binary or on disk.

use std::path::{Path as FilePath, PathBuf};

use fs_err as fs;
use include_dir::{Dir, include_dir};
use thiserror::Error;

use super::buildings::Building;
use super::network::LaneGraph;
use super::plots::{self, Boundary, Furnishing, Stand};
use super::surface::Surface;
use super::town_config::TownConfig;

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
    #[error("not an OpenDRIVE map: {message}: {}", path.display())]
    OpenDrive { message: String, path: PathBuf },
    #[error("the map has no lane that can be driven: {}", path.display())]
    NoLanes { path: PathBuf },
    #[error("{message}: {}", path.display())]
    Model { message: String, path: PathBuf },
    #[error("the town `{town}` has no place where the ego could start")]
    NoStart { town: String },
}

/// A town: its roads, its ground and its buildings.
#[derive(Debug, Clone)]
pub struct Town {
    pub name: String,
    pub config: TownConfig,
    pub graph: LaneGraph,
    pub surface: Surface,
    pub buildings: Vec<Building>,
    /// Places for parked vehicles off the street.
    pub stands: Vec<Stand>,
    /// Props that belong to gardens, squares and bus stops.
    pub furnishings: Vec<Furnishing>,
    pub boundaries: Vec<Boundary>,
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
        config.check().map_err(|message| SceneError::TownConfig {
            message,
            path: path.with_file_name("town.toml"),
        })?;
        let network = xodr::load_str(xodr)
            .map_err(|error| SceneError::OpenDrive { message: error.to_string(), path: path.to_owned() })?;
        let graph = LaneGraph::new(&network);
        if graph.lanes.is_empty() {
            return Err(SceneError::NoLanes { path: path.to_owned() });
        }
        let surface = Surface::new(&network, &graph);
        let mut plots = plots::grow(&surface, &config, 0);
        plots.furnishings.extend(plots::bus_stops(&network));
        let plots::Plots { buildings, stands, furnishings, boundaries } = plots;
        Ok(Self { name: name.to_owned(), config, graph, surface, buildings, stands, furnishings, boundaries })
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
