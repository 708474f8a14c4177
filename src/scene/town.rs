//! Towns: an OpenDRIVE road network with a `town.toml` beside it, shipped in the binary or on disk.

use std::collections::BTreeMap;
use std::path::Path as FilePath;
use std::sync::LazyLock;

use fs_err as fs;

use super::buildings::Building;
use super::bus_stops;
use super::dry_walls::DryWall;
use super::error::SceneError;
use super::landmarks::Landmark;
use super::lights::Lights;
use super::models;
use super::network::LaneGraph;
use super::occupancy::Footprint;
use super::opendrive::{self, RoadMap};
use super::path::Vec2;
use super::plots::{self, Boundary, Furnishing, Stand};
use super::rebuilding::TownVariation;
use super::shipped;
use super::split::SceneSplit;
use super::surface::{Levels, Surface};
use super::town_config::TownConfig;
use super::town_parts::BasinConfig;
use super::water;
use crate::config::Checked;

/// A town: its roads, its ground and its buildings.
#[derive(Debug, Clone)]
pub struct Town {
    pub name: String,
    pub config: Checked<TownConfig>,
    pub graph: LaneGraph,
    pub lights: Lights,
    pub surface: Surface,
    pub buildings: Vec<Building>,
    /// Places for parked vehicles off the street.
    pub stands: Vec<Stand>,
    /// Props that belong to gardens, squares and bus stops.
    pub furnishings: Vec<Furnishing>,
    pub boundaries: Vec<Boundary>,
    pub landmarks: Vec<Landmark>,
    /// Plots that are stacked with containers.
    pub stacks: Vec<Footprint>,
    pub walls: Vec<DryWall>,
    /// The parts of the map that could not be used, in counts.
    pub notes: Vec<String>,
}

/// Names of the shipped towns, sorted.
pub fn town_names() -> Vec<String> {
    shipped::folders_with("scenes", "road.xodr").into_iter().map(str::to_owned).collect()
}

/// Names of the shipped towns that are for a split, sorted.
pub fn town_names_of(split: SceneSplit) -> Vec<String> {
    town_names().into_iter().filter(|name| shipped_split(name) == Some(split)).collect()
}

/// The split that a town, given by name or by path, is kept for.
///
/// `None` where it may be in any: an unknown town, or a map by path that does not bear a shipped town's name and beside
/// which no `town.toml` says `split = "test"`.
pub fn town_split(name_or_path: &str) -> Option<SceneSplit> {
    shipped_split(&town_name(name_or_path)).or_else(|| {
        let path = FilePath::new(name_or_path);
        let toml = is_map_file(path).then(|| fs::read_to_string(path.with_file_name("town.toml")).ok())?;
        split_of(&toml?).filter(|split| *split == SceneSplit::Test)
    })
}

fn shipped_split(name: &str) -> Option<SceneSplit> {
    static SPLITS: LazyLock<BTreeMap<String, SceneSplit>> = LazyLock::new(|| {
        let toml = |name: &str| shipped::text(&format!("scenes/{name}/town.toml")).unwrap_or_default();
        let split = |name: String| split_of(toml(&name)).map(|split| (name, split));
        town_names().into_iter().filter_map(split).collect()
    });
    SPLITS.get(name).copied()
}

/// `None` where the config is not valid, which [`Town::load`] reports.
fn split_of(toml: &str) -> Option<SceneSplit> {
    toml::from_str(toml).ok().map(|config: TownConfig| config.split)
}

/// The name of a town that is given by name or by path: a shipped town's own, else its file's or folder's.
pub fn town_name(name_or_path: &str) -> String {
    let path = FilePath::new(name_or_path);
    if !is_map_file(path) {
        return name_or_path.to_owned();
    }
    let stem = path.file_stem().map_or_else(|| "town".into(), |stem| stem.to_string_lossy());
    // A shipped town given by path keeps its folder's name.
    match path.parent().and_then(FilePath::file_name) {
        Some(folder) if stem == "road" => folder.to_string_lossy().into_owned(),
        _ => stem.to_lowercase(),
    }
}

pub(super) fn is_map_file(path: &FilePath) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xodr"))
}

impl Town {
    /// Loads a shipped town by name, or any `.xodr` by path with the `town.toml` beside it, if any.
    ///
    /// # Errors
    /// [`SceneError`]: no such town (the message lists those that exist), unreadable file, broken
    /// map or config, a map without driving lanes.
    pub fn load(name_or_path: &str) -> Result<Self, SceneError> {
        Self::varied(name_or_path, TownVariation::default())
    }

    /// A town that is built anew in part.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn varied(name_or_path: &str, variation: TownVariation) -> Result<Self, SceneError> {
        let path = FilePath::new(name_or_path);
        if is_map_file(path) {
            let xodr = fs::read_to_string(path)?;
            let toml_path = path.with_file_name("town.toml");
            let toml = if fs::exists(&toml_path)? { Some(fs::read_to_string(&toml_path)?) } else { None };
            return Self::parse(&town_name(name_or_path), &xodr, toml.as_deref(), path, variation);
        }
        let file = |leaf: &str| shipped::text(&format!("scenes/{name_or_path}/{leaf}"));
        let xodr = file("road.xodr")
            .ok_or_else(|| SceneError::UnknownTown { name: name_or_path.to_owned(), found: town_names() })?;
        Self::parse(
            name_or_path,
            xodr,
            file("town.toml"),
            &FilePath::new("scenes").join(name_or_path),
            variation,
        )
    }

    /// Whether a place is land, not the water of a basin.
    pub fn is_land(&self, point: Vec2) -> bool {
        let basins = self.basins().iter().map(water::footprint);
        basins.into_iter().all(|basin| !basin.contains(point))
    }

    /// Basins of a town without slopes.
    pub(super) fn basins(&self) -> &[BasinConfig] {
        if self.surface.ground.is_flat() { &self.config.basins } else { &[] }
    }

    fn parse(
        name: &str,
        xodr: &str,
        toml: Option<&str>,
        path: &FilePath,
        variation: TownVariation,
    ) -> Result<Self, SceneError> {
        let mut config: TownConfig =
            toml.map_or_else(|| Ok(TownConfig::default()), toml::from_str).map_err(|error| {
                SceneError::TownConfig { message: error.to_string(), path: path.with_file_name("town.toml") }
            })?;
        let RoadMap { network, mut notes, offset_m } = opendrive::read(xodr)
            .map_err(|message| SceneError::OpenDrive { message, path: path.to_owned() })?;
        config.move_places(offset_m);
        let config = variation.of(&config);
        let config = Checked::new(config).map_err(|error| SceneError::TownConfig {
            message: error.to_string(),
            path: path.with_file_name("town.toml"),
        })?;
        let levels = Levels::of(&network, config.verge_m, &config.waves);
        notes.extend(levels.note());
        let (mut graph, unused) = LaneGraph::read(&network, |id| levels.is_above(id));
        notes.extend(unused);
        notes.extend(config.unknown_models(&models::names()));
        if graph.lanes.is_empty() {
            return Err(SceneError::NoLanes { path: path.to_owned() });
        }
        let crosswalks = opendrive::crosswalks(&network);
        let (lights, unknown) = Lights::read(&network, &mut graph, &crosswalks);
        notes.extend(unknown);
        let mut surface = Surface::new(&network, &graph, levels, &crosswalks, &config.waves);
        let terraces = surface.shape_land(&config.hills, config.terrace_m);
        if !config.basins.is_empty() && !surface.ground.is_flat() {
            notes.push("town.toml: basins are left out, as the land has slopes".to_owned());
        }
        let mut plots = plots::grow(&surface, &config, &terraces, variation.rebuilt.unwrap_or(0));
        plots.furnishings.extend(bus_stops::furnishings(&network));
        let plots::Plots { buildings, stands, furnishings, boundaries, landmarks, stacks, walls } = plots;
        Ok(Self {
            name: name.to_owned(),
            config,
            graph,
            lights,
            surface,
            buildings,
            stands,
            furnishings,
            boundaries,
            landmarks,
            stacks,
            walls,
            notes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::path::turn_between;
    use super::super::route::Route;
    use super::*;
    use crate::random;

    #[test]
    fn an_unknown_town_lists_those_that_exist() {
        let message = Town::load("atlantis").unwrap_err().to_string();
        assert!(message.contains("atlantis") && message.contains("downtown"), "{message}");
    }

    #[test]
    fn a_town_by_name_or_of_a_shipped_ones_name_has_a_split_and_a_users_map_only_if_it_says_test() {
        assert_eq!(town_split("downtown"), Some(SceneSplit::Dev));
        assert_eq!(town_split("copies/downtown/road.xodr"), Some(SceneSplit::Dev));
        assert_eq!(town_split("atlantis"), None);
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("Town01.xodr");
        assert_eq!(town_split(map.to_str().unwrap()), None);
        for (split, wanted) in [("dev", None), ("test", Some(SceneSplit::Test))] {
            fs::write(folder.path().join("town.toml"), format!("split = \"{split}\"\n")).unwrap();
            assert_eq!(town_split(map.to_str().unwrap()), wanted);
        }
        let of_both = SceneSplit::ALL.map(town_names_of).concat();
        assert_eq!(of_both.len(), town_names().len(), "{of_both:?}");
    }

    fn shipped() -> Vec<Town> {
        town_names().iter().map(|name| Town::load(name).unwrap()).collect()
    }

    #[test]
    fn the_towns_of_the_docs_are_shipped() {
        let docs = include_str!("../../docs/towns.md");
        for name in town_names() {
            assert!(docs.contains(&format!("**{name}**")), "docs/towns.md does not describe {name}");
        }
    }

    #[test]
    fn shipped_towns_are_used_whole_and_name_only_models_that_exist() {
        for town in shipped() {
            assert_eq!(town.notes, Vec::<String>::new(), "{}", town.name);
        }
    }

    #[test]
    fn every_lane_of_a_shipped_town_leads_on() {
        for town in shipped() {
            let end = town.graph.lanes.iter().position(|lane| lane.successors.is_empty());
            assert!(end.is_none(), "{}: lane {end:?} leads nowhere", town.name);
        }
    }

    #[test]
    fn lanes_of_a_shipped_town_meet_end_to_end_and_bend_gently() {
        for town in shipped() {
            let name = &town.name;
            for lane in &town.graph.lanes {
                let length_m = lane.path.length_m();
                for &next in &lane.successors {
                    let next = &town.graph.lanes[next].path;
                    let gap_m = (next.at(0.0) - lane.path.at(length_m)).norm();
                    let turn_rad = turn_between(lane.path.heading_rad(length_m), next.heading_rad(0.0));
                    assert!(gap_m < 0.1 && turn_rad.abs() < 0.25, "{name}: gap {gap_m} m, turn {turn_rad}");
                }
                for i in 1..(length_m - 4.0).max(0.0) as usize {
                    let curvature = lane.path.curvature_per_m(i as f64 + 2.0).abs();
                    assert!(curvature < 1.0 / 5.5, "{name}: radius {:.1} m", 1.0 / curvature);
                }
            }
        }
    }

    #[test]
    fn a_shipped_town_offers_long_drives_from_nearly_everywhere() {
        for town in shipped() {
            let mut rng = random::stream(3, "drives", 0);
            let n_long = (0..town.graph.lanes.len())
                .filter(|&lane| Route::random(&town.graph, lane, 700.0, &mut rng).path.length_m() >= 700.0)
                .count();
            let n = town.graph.lanes.len();
            assert!(n_long * 20 >= n * 19, "{}: {n_long} of {n} lanes offer a drive of 700 m", town.name);
        }
    }

    #[test]
    fn no_building_stands_on_a_road_or_in_another() {
        for town in shipped() {
            assert!(town.buildings.len() > 20, "{}: {}", town.name, town.buildings.len());
            for (i, building) in town.buildings.iter().enumerate() {
                let footprint = &building.footprint;
                let points = footprint.corners().map(|corner| Vec2::new(corner.x_m, corner.y_m));
                for point in points.into_iter().chain([footprint.center]) {
                    assert!(town.surface.road_grid.clearance_m(point) > 0.5, "{}: {point}", town.name);
                }
                assert!(town.buildings[..i].iter().all(|other| !other.footprint.meets(footprint)));
            }
        }
    }

    #[test]
    fn what_belongs_to_plots_keeps_off_the_roads() {
        for town in shipped() {
            let clearance = |point: Vec2| town.surface.road_grid.clearance_m(point);
            let walls = town.boundaries.iter().flat_map(|boundary| boundary.line.points());
            assert!(walls.copied().all(|point| clearance(point) > 0.1), "{}", town.name);
            assert!(town.furnishings.iter().all(|prop| clearance(prop.position) > 0.2), "{}", town.name);
            let stands = town.stands.iter().flat_map(|stand| stand.footprint.corners());
            assert!(
                stands.map(|at| Vec2::new(at.x_m, at.y_m)).all(|point| clearance(point) > 0.0),
                "{}",
                town.name
            );
        }
    }

    #[test]
    fn each_town_has_what_makes_it_that_town() {
        let [arterial, market, oldtown, suburb] =
            ["arterial", "market", "oldtown", "suburb"].map(|name| Town::load(name).unwrap());
        let n_balconies: usize = oldtown.buildings.iter().map(|building| building.balconies.len()).sum();
        assert!(n_balconies > 200, "{n_balconies}");
        assert!(oldtown.buildings.len() > 150 && suburb.buildings.len() > 70);
        assert!(suburb.stands.len() > 40 && suburb.boundaries.len() > 80);
        assert!(market.stands.len() > 40, "{}", market.stands.len());
        assert_eq!(arterial.furnishings.iter().filter(|prop| prop.model == "bus_shelter").count(), 2);
        let fastest = arterial.graph.lanes.iter().map(|lane| lane.limit_mps).fold(0.0, f64::max);
        assert!(fastest > 19.0, "{fastest}");
    }

    #[test]
    fn the_towns_for_testing_have_what_the_others_have_not() {
        let [harbour, hillside] = ["harbour", "hillside"].map(|name| Town::load(name).unwrap());
        assert!(harbour.landmarks.len() > 10 && harbour.stacks.len() > 3, "{}", harbour.stacks.len());
        assert!(!harbour.is_land(Vec2::new(0.0, -80.0)) && harbour.is_land(Vec2::new(0.0, 60.0)));
        for lane in &harbour.graph.lanes {
            assert!(lane.path.points().iter().all(|&point| harbour.is_land(point)));
        }
        for building in &harbour.buildings {
            let corners = building.footprint.corners().map(|at| Vec2::new(at.x_m, at.y_m));
            assert!(corners.iter().all(|&corner| harbour.is_land(corner)));
        }
        assert!(hillside.walls.len() > 60, "{}", hillside.walls.len());
        let n_annexes = hillside.buildings.iter().filter(|building| building.annex.is_some()).count();
        assert!(n_annexes > 20, "{n_annexes}");
        for wall in &hillside.walls {
            for point in wall.line.points_every(1.0) {
                assert!(hillside.surface.road_grid.clearance_m(point) > 0.1, "{point}");
            }
        }
        let heights = hillside.graph.lanes.iter().map(|lane| hillside.surface.ground_m(lane.path.at(0.0)));
        assert!(heights.fold(0.0, f64::max) > 16.0);
    }
}
