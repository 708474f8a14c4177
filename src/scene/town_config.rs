//! `town.toml`: how a town is built, furnished and filled. Lengths in metres, shares 0 to 1.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::looks::{BoundaryLook, BuildingStyle, FacadeLook, GroundLook, MedianLook, RoofStyle, TownColor};
use super::split::SceneSplit;
use super::town_parts::{BasinConfig, HillConfig, LandmarkConfig, TrackConfig, WaveConfig};
use crate::config::{Bounds, Check, InvalidConfig, Keys, Rule, SHARE, define_config, from_to, part, require};

/// Open ground with things to sit on and to look at, free of buildings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SquareConfig {
    /// Place in the map's coordinates.
    pub center_m: [f64; 2],
    pub radius_m: f64,
    /// How many props are tried.
    pub n_props: u32,
    /// How likely each prop model is, relative to the others.
    pub prop_weights: BTreeMap<String, f64>,
}

define_config! {
    /// How a town is built and filled: `town.toml`.
    pub struct TownConfig {
        description: String = String::new();
        /// Whether the town is for learning and choosing, or kept for reporting.
        split: SceneSplit = SceneSplit::Dev;
        building_style: BuildingStyle = BuildingStyle::Row;
        building_height_m: [f64; 2] = [7.0, 20.0], in from_to(2.0, 200.0).pair();
        /// Along the street.
        building_width_m: [f64; 2] = [9.0, 20.0], in from_to(4.0, 200.0).pair();
        building_depth_m: [f64; 2] = [9.0, 13.0], in from_to(3.0, 200.0).pair();
        /// Gap between detached buildings.
        building_gap_m: [f64; 2] = [0.0, 0.0], in from_to(0.0, 100.0).pair();
        /// Distance from the outer edge of the pavement.
        building_setback_m: [f64; 2] = [0.5, 3.0], in from_to(0.0, 100.0).pair();
        /// Share of the plots that are built on.
        building_share: f64 = 0.8, in SHARE;
        /// Most that a detached building is turned against the street, degrees.
        building_turn_deg: f64 = 0.0, in from_to(0.0, 30.0);
        /// Share of detached buildings with a lower one against their back or side.
        annex_share: f64 = 0.0, in SHARE;
        /// Plots also along roads that have no pavement.
        builds_on_bare_roads: bool = false;
        roof_style: RoofStyle = RoofStyle::Flat;
        /// Styles that are drawn as often as `roof_style`.
        more_roof_styles: Vec<RoofStyle> = Vec::new();
        /// Pitch of sloping roofs, degrees.
        roof_pitch_deg: [f64; 2] = [30.0, 40.0], in from_to(1.0, 60.0).pair();
        /// Looks of facades; wall colours take them in turn.
        facades: Vec<FacadeLook> = vec![FacadeLook::Brick, FacadeLook::Plaster, FacadeLook::Shutters];
        wall_colors: Vec<TownColor> =
            colors(&[[150, 92, 74], [206, 192, 164], [176, 178, 180], [188, 150, 112], [214, 208, 198], [132, 142, 150]]);
        /// Colours of window frames and cornices, in turn with the walls.
        trim_colors: Vec<TownColor> =
            colors(&[[212, 204, 192], [240, 234, 222], [110, 112, 116], [232, 222, 204], [150, 132, 112], [224, 226, 228]]);
        roof_colors: Vec<TownColor> = colors(&[[107, 77, 66], [89, 89, 92], [128, 117, 107]]);
        /// Share of the bays of upper floors, towards the street, that have a balcony.
        balcony_share: f64 = 0.0, in SHARE;
        /// How far balconies stand out.
        balcony_depth_m: [f64; 2] = [0.8, 1.2], in from_to(0.3, 3.0).pair();
        /// One is drawn for each plot whose building stands back far enough, and for gaps in a row.
        boundaries: Vec<BoundaryLook> = vec![
            BoundaryLook::Open, BoundaryLook::Hedge, BoundaryLook::WildHedge, BoundaryLook::ChainLink, BoundaryLook::Wall,
        ];
        /// Share of detached houses with a driveway beside them.
        driveway_share: f64 = 0.0, in SHARE;
        /// Share of the buildings set back by 9 m or more with loading bays in front.
        loading_bay_share: f64 = 0.0, in SHARE;
        /// Share of the plots without a building that are fenced yards for vehicles.
        yard_share: f64 = 0.0, in SHARE;
        /// Share of the plots without a building that are stacked with containers.
        container_share: f64 = 0.0, in SHARE;
        /// Props in each garden: least and most.
        garden_props: [f64; 2] = [0.0, 0.0], in from_to(0.0, 50.0).pair();
        /// How likely each prop model is in gardens, relative to the others.
        garden_weights: BTreeMap<String, f64> = BTreeMap::new(), in WEIGHTS;
        squares: Vec<SquareConfig> = Vec::new(), in part::<SquareConfig>();
        /// Rectangles of water, on land without slopes.
        basins: Vec<BasinConfig> = Vec::new(), in part::<BasinConfig>();
        /// Height of their water.
        water_level_m: f64 = -1.6, in from_to(-10.0, -0.3);
        /// Land beside basins that is kept free of plots.
        apron_m: f64 = 10.0, in from_to(0.0, 100.0);
        landmarks: Vec<LandmarkConfig> = Vec::new(), in part::<LandmarkConfig>();
        tracks: Vec<TrackConfig> = Vec::new(), in part::<TrackConfig>();
        hills: Vec<HillConfig> = Vec::new(), in part::<HillConfig>();
        /// Waves of the land, roads included.
        waves: Vec<WaveConfig> = Vec::new(), in part::<WaveConfig>();
        /// Height of the steps of sloping land between roads; 0: none.
        terrace_m: f64 = 0.0, in from_to(0.0, 10.0);
        /// How far the land beside a road keeps the road's height.
        verge_m: f64 = 7.0, in from_to(0.5, 20.0);
        /// Height of dry-stone walls where the land beside a road rises or falls; 0: none.
        retaining_wall_m: [f64; 2] = [0.0, 0.0], in from_to(0.0, 6.0).pair();
        /// Share of the bends whose outer side has a guard rail.
        bend_rail_share: f64 = 0.25, in SHARE;
        median: MedianLook = MedianLook::Open;
        road_texture: GroundLook = GroundLook::Asphalt;
        sidewalk_texture: GroundLook = GroundLook::Pavement;
        ground_texture: GroundLook = GroundLook::Grass;
        /// Distance from one static prop to the next on a pavement.
        prop_spacing_m: [f64; 2] = [8.0, 18.0], in from_to(0.5, 1000.0).pair();
        /// Distance from the kerb to the middle of the prop.
        prop_kerb_distance_m: f64 = 0.55, in from_to(0.1, 20.0);
        /// How likely each prop model is, relative to the others; empty: all alike.
        prop_weights: BTreeMap<String, f64> = BTreeMap::new(), in WEIGHTS;
        /// Distance from one thing that is never annotated to the next along a pavement's outer edge.
        clutter_spacing_m: [f64; 2] = [7.0, 20.0], in from_to(0.5, 1000.0).pair();
        /// How likely each background model is there, relative to the others; empty: none.
        clutter_weights: BTreeMap<String, f64> = weights(&[
            ("bush_bare", 0.5), ("bush_column", 0.7), ("bush_low", 1.0), ("bush_round", 1.0), ("bush_tall", 1.5),
            ("bush_wild", 2.0),
        ]), in WEIGHTS;
        /// Share of the pavements with a row of things along the kerb, times `scene.prop_density`.
        row_share: f64 = 0.25, in SHARE;
        /// How likely each model is for a row, relative to the others; empty: no rows.
        row_weights: BTreeMap<String, f64> =
            weights(&[("barrier", 1.0), ("bin", 1.0), ("road_barrier", 2.0)]), in WEIGHTS;
        traffic: TrafficConfig = TrafficConfig::default(), in part::<TrafficConfig>();
    }
}

define_config! {
    /// What moves and parks in a town.
    pub struct TrafficConfig {
        /// Share of the parking places at the kerb that are taken.
        parked_share: f64 = 0.4, in SHARE;
        /// Length of one parking place.
        parking_place_m: f64 = 6.0, in from_to(0.1, 50.0);
        /// Share of the places in driveways, loading bays and yards that are taken.
        stand_share: f64 = 0.6, in SHARE;
        /// Moving vehicles in the whole town.
        n_vehicles: u32 = 28, in from_to(0.0, 1000.0);
        /// Walking pedestrians in the whole town.
        n_pedestrians: u32 = 40, in from_to(0.0, 1000.0);
        /// Share of pedestrians that set out across the street.
        pedestrian_crossing_share: f64 = 0.15, in SHARE;
        /// How likely each vehicle model is, relative to the others; empty: all alike.
        vehicle_weights: BTreeMap<String, f64> = BTreeMap::new(), in WEIGHTS;
        /// The same for parked vehicles; empty: `vehicle_weights`.
        parked_weights: BTreeMap<String, f64> = BTreeMap::new(), in WEIGHTS;
    }
}

fn colors(list: &[[u8; 3]]) -> Vec<TownColor> {
    list.iter().map(|&rgb| TownColor(rgb)).collect()
}

fn weights(list: &[(&str, f64)]) -> BTreeMap<String, f64> {
    list.iter().map(|&(name, weight)| (name.to_owned(), weight)).collect()
}

/// The steepest that all waves may be where they add up.
const MAX_GRADE: f64 = 0.2;

/// Weights by the names of models.
const WEIGHTS: Rule = from_to(0.0, 1e6).by_name();

impl Check for TownConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let n_roofs = self.more_roof_styles.len();
        require(
            n_roofs <= 8,
            "more_roof_styles",
            format!("a list of {n_roofs}"),
            "up to 8 entries are allowed",
        )?;
        let lists = [
            ("facades", self.facades.len()),
            ("wall_colors", self.wall_colors.len()),
            ("trim_colors", self.trim_colors.len()),
            ("roof_colors", self.roof_colors.len()),
            ("boundaries", self.boundaries.len()),
        ];
        for (key, length) in lists {
            let found = format!("a list of {length}");
            require((1..=8).contains(&length), key, found, "1 to 8 entries are needed")?;
        }
        let grade: f64 = self.waves.iter().map(WaveConfig::steepest).sum();
        require(
            grade <= MAX_GRADE,
            "waves",
            format!("a list of waves that together climb by up to {:.0} %", 100.0 * grade),
            "up to 20 % is allowed (pi times height_m over length_m, summed)",
        )
    }
}

impl Bounds for SquareConfig {
    const BOUNDS: Keys = &[
        ("center_m", from_to(-1e6, 1e6).list(2, 2)),
        ("radius_m", from_to(1.0, 200.0)),
        ("n_props", from_to(0.0, 1000.0)),
        ("prop_weights", WEIGHTS),
    ];
}

impl TownConfig {
    /// Takes from all places what was taken from the map's x and y.
    pub fn move_places(&mut self, offset_m: [f64; 2]) {
        let squares = self.squares.iter_mut().map(|square| &mut square.center_m);
        let basins = self.basins.iter_mut().map(|basin| &mut basin.center_m);
        let landmarks = self.landmarks.iter_mut().map(|landmark| &mut landmark.center_m);
        let tracks = self.tracks.iter_mut().flat_map(|track| [&mut track.from_m, &mut track.to_m]);
        let hills = self.hills.iter_mut().map(|hill| &mut hill.center_m);
        for place_m in squares.chain(basins).chain(landmarks).chain(tracks).chain(hills) {
            *place_m = [place_m[0] - offset_m[0], place_m[1] - offset_m[1]];
        }
    }

    /// Names in tables of weights that no model has: they have no effect, which is hardly intended.
    pub fn unknown_models(&self, known: &[String]) -> Vec<String> {
        let named =
            self.weight_tables().flat_map(|(key, weights)| weights.keys().map(move |name| (key, name)));
        named
            .filter(|(_, name)| !known.contains(name))
            .map(|(key, name)| {
                format!("town.toml: {key} names no model `{name}`; there are {}", known.join(", "))
            })
            .collect()
    }

    /// All tables of weights by model name, with their keys.
    pub fn weight_tables(&self) -> impl Iterator<Item = (&'static str, &BTreeMap<String, f64>)> {
        [
            ("prop_weights", &self.prop_weights),
            ("garden_weights", &self.garden_weights),
            ("clutter_weights", &self.clutter_weights),
            ("row_weights", &self.row_weights),
            ("traffic.vehicle_weights", &self.traffic.vehicle_weights),
            ("traffic.parked_weights", &self.traffic.parked_weights),
        ]
        .into_iter()
        .chain(self.squares.iter().map(|square| ("squares.prop_weights", &square.prop_weights)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_equals_the_defaults() {
        let shipped: TownConfig = toml::from_str(include_str!("../../scenes/default_town.toml")).unwrap();
        assert_eq!(shipped, TownConfig::default());
        crate::config::assert_every_number_is_checked(&shipped);
    }

    #[test]
    fn an_unknown_look_lists_those_that_exist() {
        let told = |text: &str| toml::from_str::<TownConfig>(text).unwrap_err().to_string();
        let message = told("road_texture = \"lava\"");
        assert!(message.contains("lava") && message.contains("worn_asphalt"), "{message}");
        assert!(told("roof_stile = \"flat\"").contains("roof_style"));
        assert!(told("wall_colors = [\"red\"]").contains("#b4866a"));
    }

    #[test]
    fn a_weight_for_no_model_is_told_with_those_that_exist() {
        let mut config = TownConfig::default();
        config.clutter_weights.clear();
        config.row_weights.clear();
        config.garden_weights.insert("gnome".into(), 1.0);
        config.prop_weights.insert("tree".into(), 1.0);
        let told = config.unknown_models(&["bin".into(), "tree".into()]);
        assert_eq!(told, ["town.toml: garden_weights names no model `gnome`; there are bin, tree"]);
    }

    #[test]
    fn all_places_move_with_the_map() {
        let text = "squares = [{ center_m = [10, 5], radius_m = 9, n_props = 1, prop_weights = {} }]\n\
                    basins = [{ center_m = [10, 5], size_m = [9, 9] }]\n\
                    landmarks = [{ look = \"silos\", center_m = [10, 5] }]\n\
                    tracks = [{ from_m = [10, 5], to_m = [10, 5], gauge_m = 1.4 }]\n\
                    hills = [{ center_m = [10, 5], radius_m = 9, height_m = 3 }]\n";
        let mut moved: TownConfig = toml::from_str(text).unwrap();
        moved.move_places([10.0, 7.0]);
        let wanted: TownConfig = toml::from_str(&text.replace("[10, 5]", "[0, -2]")).unwrap();
        assert_eq!(moved, wanted);
    }

    #[test]
    fn waves_that_no_car_climbs_are_refused() {
        let waves = |height_m: f64| {
            let text =
                format!("waves = [{{ length_m = 100, yaw_deg = 30, height_m = {height_m}, phase_deg = 0 }}]");
            toml::from_str::<TownConfig>(&text).unwrap().check()
        };
        assert!(waves(6.0).is_ok());
        assert!(waves(7.0).unwrap_err().to_string().contains("22 %"));
        assert!(waves(-1.0).unwrap_err().to_string().contains("height_m"));
    }

    #[test]
    fn a_falling_range_and_a_share_above_one_are_refused() {
        let falling = TownConfig { building_height_m: [9.0, 4.0], ..TownConfig::default() };
        assert!(falling.check().unwrap_err().to_string().contains("building_height_m"));
        let share = TownConfig { balcony_share: 1.5, ..TownConfig::default() };
        assert!(share.check().unwrap_err().to_string().contains("balcony_share is 1.5"));
    }
}
