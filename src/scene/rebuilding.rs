//! A town built anew beside its roads, so that a detector learns no town's houses, walls and hedges by heart: what stands there is
//! drawn from all that a `town.toml` may ask for. Roads, squares, water, landmarks, props and traffic stay as they are. And
//! towns on rolling land, so that flat streets are not learnt either.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use rand::RngExt;

use super::looks::{BoundaryLook, BuildingStyle, FacadeLook, GroundLook, MedianLook, RoofStyle, TownColor};
use super::town_config::TownConfig;
use super::town_parts::{HillConfig, WaveConfig};
use crate::random::{self, Rng};

const ROOFS: [RoofStyle; 5] =
    [RoofStyle::Flat, RoofStyle::Gable, RoofStyle::GableFront, RoofStyle::Shed, RoofStyle::Sawtooth];
const FACADES: [FacadeLook; 9] = [
    FacadeLook::Brick,
    FacadeLook::Plaster,
    FacadeLook::Shutters,
    FacadeLook::Stone,
    FacadeLook::Glass,
    FacadeLook::House,
    FacadeLook::Metal,
    FacadeLook::Warehouse,
    FacadeLook::Rubble,
];
const BOUNDARIES: [BoundaryLook; 9] = [
    BoundaryLook::Open,
    BoundaryLook::Hedge,
    BoundaryLook::WildHedge,
    BoundaryLook::Fence,
    BoundaryLook::Wall,
    BoundaryLook::Railings,
    BoundaryLook::ChainLink,
    BoundaryLook::GuardRail,
    BoundaryLook::DryStone,
];
const MEDIANS: [MedianLook; 4] =
    [MedianLook::Open, MedianLook::Barrier, MedianLook::GuardRail, MedianLook::Hedge];
const ROADS: [GroundLook; 4] =
    [GroundLook::Asphalt, GroundLook::WornAsphalt, GroundLook::Concrete, GroundLook::Cobbles];
const PAVEMENTS: [GroundLook; 5] = [
    GroundLook::Pavement,
    GroundLook::Flagstones,
    GroundLook::Cobbles,
    GroundLook::Concrete,
    GroundLook::Asphalt,
];
const LAND: [GroundLook; 5] =
    [GroundLook::Grass, GroundLook::Grass, GroundLook::Dirt, GroundLook::Gravel, GroundLook::Concrete];
const GARDENS: [&str; 11] = [
    "bush_round",
    "bush_tall",
    "bush_wild",
    "hedge",
    "planter",
    "tree",
    "tree_autumn",
    "tree_bare",
    "tree_birch",
    "tree_conifer",
    "tree_young",
];
const CLUTTER: [&str; 10] = [
    "bike_rack",
    "bush_bare",
    "bush_column",
    "bush_low",
    "bush_round",
    "bush_tall",
    "bush_wild",
    "crates",
    "hedge",
    "rubbish_bags",
];
/// How far from the map's origin hills lie, metres.
const HILLS_M: f64 = 350.0;

/// The steepest that drawn waves may be all together: least, most.
const STEEPEST: [f64; 2] = [0.03, 0.12];
const WAVE_LENGTH_M: [f64; 2] = [90.0, 350.0];
const N_WAVES: usize = 3;

/// What of a town is drawn anew, from seeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TownVariation {
    /// Houses, boundaries and land beside the roads.
    pub rebuilt: Option<u64>,
    /// Long waves under all of it, roads included; a town with basins stays level.
    pub rolling: Option<u64>,
}

impl TownVariation {
    pub(super) fn of(self, config: &TownConfig) -> TownConfig {
        let config = self.rebuilt.map_or_else(|| config.clone(), |seed| rebuild(config, seed));
        match self.rolling {
            // Water is level, and ships lie in it.
            Some(seed) if config.basins.is_empty() => TownConfig { waves: waves(seed), ..config },
            _ => config,
        }
    }
}

/// Waves which nowhere make a slope steeper than one drawn for all of them together.
fn waves(seed: u64) -> Vec<WaveConfig> {
    let rng = &mut random::stream(seed, "rolling-town", 0);
    let steepest = between(rng, STEEPEST);
    let shares: [f64; N_WAVES] = std::array::from_fn(|_| between(rng, [0.3, 1.0]));
    let all: f64 = shares.iter().sum();
    let mut wave = |share: f64| {
        let length_m = between(rng, WAVE_LENGTH_M);
        WaveConfig {
            length_m,
            yaw_deg: between(rng, [0.0, 360.0]),
            height_m: steepest * share / all * length_m / PI,
            phase_deg: between(rng, [0.0, 360.0]),
        }
    };
    shares.map(&mut wave).into()
}

/// The town's config with what stands beside its roads drawn anew.
pub(super) fn rebuild(config: &TownConfig, seed: u64) -> TownConfig {
    let rng = &mut random::stream(seed, "rebuilt-town", 0);
    let is_detached = rng.random_bool(0.65);
    let only_detached = |of: f64| if is_detached { of } else { 0.0 };
    let n_hills = rng.random_range(0..4);
    let terraced = f64::from(u8::from(rng.random_bool(0.5)));
    let walled = f64::from(u8::from(rng.random_bool(0.5)));
    TownConfig {
        building_style: if is_detached { BuildingStyle::Detached } else { BuildingStyle::Row },
        building_height_m: range(rng, [3.8, 10.0], [0.5, 14.0]),
        building_width_m: range(rng, [6.0, 14.0], [2.0, 12.0]),
        building_depth_m: range(rng, [6.5, 11.0], [1.0, 5.0]),
        building_gap_m: range(rng, [0.8, 5.0], [0.5, 6.0]).map(only_detached),
        building_setback_m: range(rng, [0.3, 5.0], [0.3, 5.0]),
        building_share: between(rng, [0.4, 0.95]),
        building_turn_deg: only_detached(between(rng, [0.0, 8.0])),
        annex_share: only_detached(between(rng, [0.0, 0.5])),
        roof_style: any(rng, &ROOFS),
        more_roof_styles: some(rng, 0..3, &ROOFS),
        roof_pitch_deg: range(rng, [12.0, 45.0], [1.0, 12.0]),
        facades: some(rng, 1..5, &FACADES),
        wall_colors: colors(rng, [0.35, 0.95]),
        trim_colors: colors(rng, [0.2, 0.95]),
        roof_colors: colors(rng, [0.2, 0.6]),
        balcony_share: (between(rng, [-0.3, 0.4])).max(0.0),
        boundaries: some(rng, 4..9, &BOUNDARIES),
        driveway_share: between(rng, [0.0, 0.8]),
        loading_bay_share: between(rng, [0.0, 0.5]),
        yard_share: between(rng, [0.0, 0.5]),
        container_share: between(rng, [0.0, 0.3]),
        garden_props: range(rng, [0.0, 1.0], [0.0, 4.0]),
        garden_weights: weights(rng, &GARDENS),
        hills: (0..n_hills).map(|_| hill(rng)).collect(),
        terrace_m: terraced * between(rng, [0.8, 2.5]),
        verge_m: between(rng, [1.5, 7.0]),
        retaining_wall_m: range(rng, [0.4, 1.0], [0.0, 1.5]).map(|height_m| walled * height_m),
        bend_rail_share: between(rng, [0.0, 0.7]),
        median: any(rng, &MEDIANS),
        road_texture: any(rng, &ROADS),
        sidewalk_texture: any(rng, &PAVEMENTS),
        ground_texture: any(rng, &LAND),
        clutter_spacing_m: range(rng, [3.0, 9.0], [3.0, 14.0]),
        clutter_weights: weights(rng, &CLUTTER),
        ..config.clone()
    }
}

fn between(rng: &mut Rng, [least, most]: [f64; 2]) -> f64 {
    least + (most - least) * rng.random::<f64>()
}

/// A range that begins in `least` and is as wide as drawn from `width`.
fn range(rng: &mut Rng, least: [f64; 2], width: [f64; 2]) -> [f64; 2] {
    let least = between(rng, least);
    [least, least + between(rng, width)]
}

fn any<T: Copy>(rng: &mut Rng, of: &[T]) -> T {
    of[rng.random_range(0..of.len())]
}

/// As many as drawn, each one of all.
fn some<T: Copy>(rng: &mut Rng, n: std::ops::Range<usize>, of: &[T]) -> Vec<T> {
    (0..rng.random_range(n)).map(|_| any(rng, of)).collect()
}

/// Three to six pale colours, as bright as drawn from `value`.
fn colors(rng: &mut Rng, value: [f64; 2]) -> Vec<TownColor> {
    let color = |rng: &mut Rng| {
        let (value, saturation) = (between(rng, value), between(rng, [0.0, 0.3]));
        // The one of three that is brightest, the one that is not, and the third between.
        let (bright, dark) = (rng.random_range(0..3_usize), rng.random_range(1..3_usize));
        let third = rng.random::<f64>();
        let mut rgb = [1.0 - saturation * third; 3];
        (rgb[bright], rgb[(bright + dark) % 3]) = (1.0, 1.0 - saturation);
        TownColor(rgb.map(|part| (255.0 * value * part).round() as u8))
    };
    (0..rng.random_range(3..7)).map(|_| color(rng)).collect()
}

/// About two thirds of the models, with weights; one at least.
fn weights(rng: &mut Rng, of: &[&str]) -> BTreeMap<String, f64> {
    let sure = any(rng, of);
    let mut weight = |name: &&str| {
        let weight = between(rng, [0.2, 2.0]);
        (rng.random_bool(0.6) || *name == sure).then(|| ((*name).to_owned(), weight))
    };
    of.iter().filter_map(&mut weight).collect()
}

fn hill(rng: &mut Rng) -> HillConfig {
    HillConfig {
        center_m: [between(rng, [-HILLS_M, HILLS_M]), between(rng, [-HILLS_M, HILLS_M])],
        radius_m: between(rng, [120.0, 260.0]),
        height_m: between(rng, [10.0, 60.0]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Checked;
    use crate::scene::Town;
    use crate::scene::ground::waves_at;

    #[test]
    fn every_draw_is_a_valid_town_with_the_same_streets_and_its_own_surroundings() {
        let config = TownConfig { prop_spacing_m: [3.0, 4.0], ..TownConfig::default() };
        for seed in 0..200 {
            let rebuilt = rebuild(&config, seed);
            assert_eq!(rebuilt, rebuild(&config, seed));
            assert_ne!(rebuilt, rebuild(&config, seed + 1));
            assert_eq!((rebuilt.prop_spacing_m, &rebuilt.traffic), (config.prop_spacing_m, &config.traffic));
            let known: Vec<String> = GARDENS.iter().chain(&CLUTTER).map(|&name| name.to_owned()).collect();
            assert!(
                rebuilt
                    .garden_weights
                    .keys()
                    .chain(rebuilt.clutter_weights.keys())
                    .all(|name| known.contains(name))
            );
            Checked::new(rebuilt).unwrap();
        }
    }

    #[test]
    fn a_rebuilt_town_has_the_town_s_lanes_and_other_houses() {
        for name in ["suburb", "arterial"] {
            let (town, rebuilt) =
                (Town::load(name).unwrap(), varied(name, TownVariation { rebuilt: Some(7), rolling: None }));
            assert_eq!((town.graph.lanes.len(), &town.name), (rebuilt.graph.lanes.len(), &rebuilt.name));
            assert_eq!(town.notes, rebuilt.notes, "no model is unknown");
            assert!(rebuilt.buildings.len() > 10);
            let places = |town: &Town| -> Vec<[i64; 2]> {
                let at = |building: &super::super::buildings::Building| building.footprint.center;
                town.buildings.iter().map(|of| [at(of).x, at(of).y].map(|m| (10.0 * m) as i64)).collect()
            };
            let known = places(&town);
            let n_same = places(&rebuilt).iter().filter(|place| known.contains(place)).count();
            assert!(4 * n_same < known.len(), "{n_same} of {}", known.len());
        }
    }

    #[test]
    fn a_flat_town_on_rolling_land_keeps_its_lanes_and_paint_and_climbs_as_its_waves_do() {
        let (flat, rolling) = (
            Town::load("downtown").unwrap(),
            varied("downtown", TownVariation { rebuilt: None, rolling: Some(3) }),
        );
        assert!(flat.surface.ground.is_flat() && !rolling.surface.ground.is_flat());
        assert_eq!(flat.graph.lanes.len(), rolling.graph.lanes.len());
        assert_eq!(flat.surface.marks().len(), rolling.surface.marks().len());
        assert_eq!(flat.buildings.len(), rolling.buildings.len());
        let waves = &rolling.config.waves;
        let steepest: f64 = waves.iter().map(WaveConfig::steepest).sum();
        assert!((STEEPEST[0]..STEEPEST[1]).contains(&steepest), "{steepest}");
        let mut lowest_m = f64::INFINITY;
        let mut offs = Vec::new();
        for lane in &rolling.graph.lanes {
            for at in lane.path.points_every(3.0) {
                let ground_m = rolling.surface.ground_m(at);
                lowest_m = lowest_m.min(ground_m);
                offs.push(ground_m - waves_at(waves, at));
            }
        }
        let (least, most) = offs.iter().fold((f64::MAX, f64::MIN), |(a, b), off| (a.min(*off), b.max(*off)));
        assert!(most - least < 0.1 && lowest_m < 0.3, "{least} {most} {lowest_m}");
    }

    #[test]
    fn a_town_with_water_stays_level() {
        let harbour = varied("harbour", TownVariation { rebuilt: None, rolling: Some(3) });
        assert!(harbour.surface.ground.is_flat() && !harbour.basins().is_empty());
    }

    #[test]
    fn a_share_of_the_episodes_has_rolling_land() {
        let config = crate::scene::PopulateConfig { rolling_share: 0.25, ..Default::default() };
        let n = (0..400).filter(|&seed| config.variation(seed).rolling.is_some()).count();
        assert!((70..130).contains(&n), "{n}");
        assert!((0..400).all(|seed| config.variation(seed).rebuilt.is_none()));
    }

    fn varied(name: &str, variation: TownVariation) -> Town {
        Town::varied(name, variation).unwrap()
    }
}
