//! Worlds in which all unfamiliar objects stand at one kind of place.

use std::sync::Arc;

use super::ways::{APART_M, HALF_WAY_M};
use super::*;
use crate::object::Distribution;
use crate::scene::{OodPlacementConfig, Placement, PopulateConfig, Town, World, populate};

const NOWHERE: OodPlacementConfig = OodPlacementConfig {
    lane_share: 0.0,
    junction_share: 0.0,
    bend_share: 0.0,
    crossing_share: 0.0,
    behind_share: 0.0,
    tipped_share: 0.0,
    emerge_share: 0.0,
    late_share: 0.0,
    late_braking_mps2: [3.0, 6.0],
};

fn world(town: &str, ood_placement: OodPlacementConfig, seed: u64) -> World {
    let town = Arc::new(Town::load(town).unwrap());
    let config = PopulateConfig { ood: true, event_share: 0.0, ood_placement, ..PopulateConfig::default() };
    populate(&town, &config, seed).unwrap()
}

fn unfamiliar(world: &World) -> impl Iterator<Item = &Placement> {
    world.placements.iter().filter(|p| world.models[p.model].facts.distribution == Distribution::Ood)
}

/// Those that were put at a place, which must be most of them.
fn at(world: &World, spot: Spot) -> Vec<Vec2> {
    let n = unfamiliar(world).count();
    let found: Vec<Vec2> = unfamiliar(world)
        .filter(|placement| placement.spot == spot)
        .map(|placement| world.footprint(placement).center)
        .collect();
    assert!(n > 5 && 10 * found.len() > 4 * n, "{} of {n} at {spot:?}", found.len());
    found
}

#[test]
fn with_all_at_junctions_they_stand_in_or_before_one() {
    let world = world("downtown", OodPlacementConfig { junction_share: 1.0, ..NOWHERE }, 1);
    let lanes = world.town.graph.lanes.iter().filter(|lane| lane.junction.is_some());
    let ways: Vec<_> = lanes.map(|lane| &lane.path).collect();
    for place in at(&world, Spot::Junction) {
        let nearest_m = ways.iter().map(|way| way.distance_m(place)).fold(f64::INFINITY, f64::min);
        assert!(nearest_m < MOUTH_M + 5.0, "{nearest_m} m from the nearest junction");
    }
}

#[test]
fn with_all_on_crossings_they_stand_on_the_stripes() {
    let world = world("downtown", OodPlacementConfig { crossing_share: 1.0, ..NOWHERE }, 1);
    for place in at(&world, Spot::Crossing) {
        assert!(world.town.surface.crosswalks.iter().any(|walk| walk.contains(place)), "{place}");
    }
}

#[test]
fn with_all_in_bends_the_road_turns_where_they_stand() {
    let world = world("oldtown", OodPlacementConfig { bend_share: 1.0, ..NOWHERE }, 3);
    let path = &world.ego_route.path;
    for place in at(&world, Spot::Bend) {
        let (station_m, _) = path.project(place, 0.0, path.length_m());
        let sharpest = (-4..=4).map(|i| path.curvature_per_m(station_m + f64::from(i)).abs());
        assert!(sharpest.fold(0.0, f64::max) > 1.0 / BEND_RADIUS_M, "{place}");
    }
}

#[test]
fn what_hides_has_something_between_it_and_the_ego() {
    let world = world("downtown", OodPlacementConfig { behind_share: 1.0, ..NOWHERE }, 2);
    let path = &world.ego_route.path;
    let covers: Vec<Footprint> = world
        .placements
        .iter()
        .filter(|p| world.models[p.model].facts.distribution == Distribution::Id)
        .map(|placement| world.footprint(placement))
        .chain(world.town.buildings.iter().map(|building| building.footprint))
        .collect();
    let hidden = at(&world, Spot::Behind);
    let is_behind = |place: &&Vec2| {
        let (station_m, _) = path.project(**place, 0.0, path.length_m());
        (6..32).step_by(2).any(|back_m| {
            let sight = Footprint::between(path.at(station_m - f64::from(back_m)), **place, 0.1);
            covers.iter().any(|cover| cover.meets(&sight))
        })
    };
    let n_behind = hidden.iter().filter(is_behind).count();
    assert!(10 * n_behind > 8 * hidden.len(), "{n_behind} of {}", hidden.len());
}

#[test]
fn what_is_tipped_lies_and_everything_leaves_the_ego_a_way() {
    for (town, lane_share) in [("oldtown", 0.6), ("suburb", 0.6), ("market", 0.2)] {
        let ood_placement = OodPlacementConfig { tipped_share: 1.0, lane_share, ..NOWHERE };
        let world = world(town, ood_placement, 4);
        let tipped: Vec<_> = unfamiliar(&world).filter(|placement| placement.tilt.is_some()).collect();
        assert!(tipped.len() > 4, "{town}: {}", tipped.len());
        for placement in &tipped {
            let here = world.footprint(placement);
            let others = world.placements.iter().filter(|other| {
                matches!(other.motion, Motion::Still)
                    && other.id != placement.id
                    && world.footprint(other).meets(&here)
            });
            let met: Vec<&str> = others.map(|other| other.id.as_str()).collect();
            assert!(met.is_empty(), "{town}: {} meets {met:?}", placement.id);
            assert!(
                world.town.buildings.iter().all(|house| !house.footprint.meets(&here)),
                "{}",
                placement.id
            );
            let level_m = world.town.surface.level_m(here.center);
            let low_m = placement.z_m + placement.tilt.as_ref().unwrap().bounds[0].z - level_m;
            assert!((-0.02..0.05).contains(&low_m), "{} hangs at {low_m}", placement.id);
        }
        let path = &world.ego_route.path;
        let ways: Vec<Vec2> = unfamiliar(&world)
            .map(|placement| world.footprint(placement))
            .filter(|body| path.distance_m(body.center) < body.radius_m() + HALF_WAY_M)
            .map(|body| body.center)
            .collect();
        for (i, a) in ways.iter().enumerate() {
            assert!(ways[..i].iter().all(|b| (a - b).norm() > APART_M), "{town}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_world() {
    let places = |seed| {
        let world = world("suburb", OodPlacementConfig::default(), seed);
        unfamiliar(&world).map(|p| (p.id.clone(), p.position, p.tilt.clone(), p.spot)).collect::<Vec<_>>()
    };
    assert_eq!(places(7), places(7));
    assert!(places(7) != places(8));
}
