//! `town.toml`: how a town is built, furnished and filled. Lengths in metres, shares 0 to 1.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::looks::{BoundaryLook, BuildingStyle, FacadeLook, GroundLook, MedianLook, RoofStyle, TownColor};

/// Open ground with things to sit on and to look at, free of buildings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SquareConfig {
    /// In the map's coordinates.
    pub center_m: [f64; 2],
    pub radius_m: f64,
    /// How many props are tried.
    pub n_props: u32,
    /// How likely each prop model is, relative to the others.
    pub prop_weights: BTreeMap<String, f64>,
}

/// How a town is built and filled: `town.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TownConfig {
    pub description: String,
    pub building_style: BuildingStyle,
    pub building_height_m: [f64; 2],
    /// Along the street.
    pub building_width_m: [f64; 2],
    pub building_depth_m: [f64; 2],
    /// Between detached buildings.
    pub building_gap_m: [f64; 2],
    /// From the outer edge of the pavement.
    pub building_setback_m: [f64; 2],
    /// Share of the plots that are built on.
    pub building_share: f64,
    pub roof_style: RoofStyle,
    /// Of gabled roofs, degrees.
    pub roof_pitch_deg: [f64; 2],
    /// Looks of facades; wall colours take them in turn.
    pub facades: Vec<FacadeLook>,
    pub wall_colors: Vec<TownColor>,
    /// Of window frames and cornices, in turn with the walls.
    pub trim_colors: Vec<TownColor>,
    pub roof_colors: Vec<TownColor>,
    /// Share of the bays of upper floors, towards the street, that have a balcony.
    pub balcony_share: f64,
    /// How far balconies stand out.
    pub balcony_depth_m: [f64; 2],
    /// One is drawn for each plot whose building stands back far enough, and for gaps in a row.
    pub boundaries: Vec<BoundaryLook>,
    /// Share of detached houses with a driveway beside them.
    pub driveway_share: f64,
    /// Share of the buildings set back by 9 m or more with loading bays in front.
    pub loading_bay_share: f64,
    /// Share of the plots without a building that are fenced yards for vehicles.
    pub yard_share: f64,
    /// Props in each garden: least and most.
    pub garden_props: [f64; 2],
    /// How likely each prop model is in gardens, relative to the others.
    pub garden_weights: BTreeMap<String, f64>,
    pub squares: Vec<SquareConfig>,
    pub median: MedianLook,
    pub road_texture: GroundLook,
    pub sidewalk_texture: GroundLook,
    pub ground_texture: GroundLook,
    /// Between one static prop and the next on a pavement.
    pub prop_spacing_m: [f64; 2],
    /// From the kerb to the middle of the prop.
    pub prop_kerb_distance_m: f64,
    /// How likely each prop model is, relative to the others; empty: all alike.
    pub prop_weights: BTreeMap<String, f64>,
    pub traffic: TrafficConfig,
}

/// What moves and parks in a town.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrafficConfig {
    /// Share of the parking places at the kerb that are taken.
    pub parked_share: f64,
    /// Length of one parking place.
    pub parking_place_m: f64,
    /// Share of the places in driveways, loading bays and yards that are taken.
    pub stand_share: f64,
    /// Moving vehicles in the whole town.
    pub n_vehicles: u32,
    /// Walking pedestrians in the whole town.
    pub n_pedestrians: u32,
    /// Share of pedestrians that set out across the street.
    pub pedestrian_crossing_share: f64,
    /// How likely each vehicle model is, relative to the others; empty: all alike.
    pub vehicle_weights: BTreeMap<String, f64>,
    /// The same for what parks; empty: `vehicle_weights`.
    pub parked_weights: BTreeMap<String, f64>,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            parked_share: 0.4,
            parking_place_m: 6.0,
            stand_share: 0.6,
            n_vehicles: 28,
            n_pedestrians: 40,
            pedestrian_crossing_share: 0.15,
            vehicle_weights: BTreeMap::new(),
            parked_weights: BTreeMap::new(),
        }
    }
}

impl Default for TownConfig {
    fn default() -> Self {
        let colors = |list: &[[u8; 3]]| list.iter().map(|&rgb| TownColor(rgb)).collect();
        Self {
            description: String::new(),
            building_style: BuildingStyle::Row,
            building_height_m: [7.0, 20.0],
            building_width_m: [9.0, 20.0],
            building_depth_m: [9.0, 13.0],
            building_gap_m: [0.0, 0.0],
            building_setback_m: [0.5, 3.0],
            building_share: 0.8,
            roof_style: RoofStyle::Flat,
            roof_pitch_deg: [30.0, 40.0],
            facades: vec![FacadeLook::Brick, FacadeLook::Plaster, FacadeLook::Shutters],
            wall_colors: colors(&[
                [150, 92, 74],
                [206, 192, 164],
                [176, 178, 180],
                [188, 150, 112],
                [214, 208, 198],
                [132, 142, 150],
            ]),
            trim_colors: colors(&[
                [212, 204, 192],
                [240, 234, 222],
                [110, 112, 116],
                [232, 222, 204],
                [150, 132, 112],
                [224, 226, 228],
            ]),
            roof_colors: colors(&[[107, 77, 66], [89, 89, 92], [128, 117, 107]]),
            balcony_share: 0.0,
            balcony_depth_m: [0.8, 1.2],
            boundaries: vec![BoundaryLook::Open],
            driveway_share: 0.0,
            loading_bay_share: 0.0,
            yard_share: 0.0,
            garden_props: [0.0, 0.0],
            garden_weights: BTreeMap::new(),
            squares: Vec::new(),
            median: MedianLook::Open,
            road_texture: GroundLook::Asphalt,
            sidewalk_texture: GroundLook::Pavement,
            ground_texture: GroundLook::Grass,
            prop_spacing_m: [8.0, 18.0],
            prop_kerb_distance_m: 0.55,
            prop_weights: BTreeMap::new(),
            traffic: TrafficConfig::default(),
        }
    }
}

impl TownConfig {
    /// Refuses what cannot be built.
    ///
    /// # Errors
    /// A message with the key, what was found and what would be valid.
    pub fn check(&self) -> Result<(), String> {
        let ranges = [
            ("building_height_m", self.building_height_m, 2.0, 200.0),
            ("building_width_m", self.building_width_m, 4.0, 200.0),
            ("building_depth_m", self.building_depth_m, 3.0, 200.0),
            ("building_gap_m", self.building_gap_m, 0.0, 100.0),
            ("building_setback_m", self.building_setback_m, 0.0, 100.0),
            ("roof_pitch_deg", self.roof_pitch_deg, 1.0, 60.0),
            ("balcony_depth_m", self.balcony_depth_m, 0.3, 3.0),
            ("garden_props", self.garden_props, 0.0, 50.0),
            ("prop_spacing_m", self.prop_spacing_m, 0.5, 1000.0),
        ];
        for (key, [low, high], least, most) in ranges {
            if !(least <= low && low <= high && high <= most) {
                return Err(format!(
                    "{key} = [{low}, {high}]; it takes two rising numbers in {least} to {most}"
                ));
            }
        }
        let traffic = &self.traffic;
        let shares = [
            ("building_share", self.building_share),
            ("balcony_share", self.balcony_share),
            ("driveway_share", self.driveway_share),
            ("loading_bay_share", self.loading_bay_share),
            ("yard_share", self.yard_share),
            ("traffic.parked_share", traffic.parked_share),
            ("traffic.stand_share", traffic.stand_share),
            ("traffic.pedestrian_crossing_share", traffic.pedestrian_crossing_share),
        ];
        for (key, share) in shares {
            if !(0.0..=1.0).contains(&share) {
                return Err(format!("{key} = {share}; it takes a share, 0 to 1"));
            }
        }
        let lengths = [
            ("prop_kerb_distance_m", self.prop_kerb_distance_m, 20.0),
            ("traffic.parking_place_m", traffic.parking_place_m, 50.0),
        ];
        for (key, length_m, most) in lengths {
            if !(0.1..=most).contains(&length_m) {
                return Err(format!("{key} = {length_m}; it takes metres, 0.1 to {most}"));
            }
        }
        let lists = [
            ("facades", self.facades.len()),
            ("wall_colors", self.wall_colors.len()),
            ("trim_colors", self.trim_colors.len()),
            ("roof_colors", self.roof_colors.len()),
            ("boundaries", self.boundaries.len()),
        ];
        for (key, length) in lists {
            if !(1..=8).contains(&length) {
                return Err(format!("{key} has {length} entries; it takes 1 to 8"));
            }
        }
        for square in &self.squares {
            if !(1.0..=200.0).contains(&square.radius_m) {
                return Err(format!("squares.radius_m = {}; it takes 1 to 200", square.radius_m));
            }
        }
        for (key, weights) in self.weight_tables() {
            if let Some((name, weight)) = weights.iter().find(|(_, weight)| !(0.0..=1e6).contains(*weight)) {
                return Err(format!("{key}.{name} = {weight}; it takes a weight of 0 or more"));
            }
        }
        Ok(())
    }

    /// Names in tables of weights that no model has: they have no effect, hardly what their author wants.
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
        assert_eq!(shipped.check(), Ok(()));
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
        config.garden_weights.insert("gnome".into(), 1.0);
        config.prop_weights.insert("tree".into(), 1.0);
        let told = config.unknown_models(&["bin".into(), "tree".into()]);
        assert_eq!(told, ["town.toml: garden_weights names no model `gnome`; there are bin, tree"]);
    }

    #[test]
    fn a_falling_range_and_a_share_above_one_are_refused() {
        let falling = TownConfig { building_height_m: [9.0, 4.0], ..TownConfig::default() };
        assert!(falling.check().unwrap_err().contains("building_height_m"));
        let share = TownConfig { balcony_share: 1.5, ..TownConfig::default() };
        assert!(share.check().unwrap_err().contains("balcony_share = 1.5"));
    }
}
