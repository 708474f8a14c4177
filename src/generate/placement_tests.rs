//! The unfamiliar objects in a world that moves: what lies stays, and what blocks the road stops nobody for long.

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::config::CONTROL_PERIOD_S;
use super::drive::tests::drive;
use crate::object::{Distribution, Event};
use crate::scene::{Loose, Motion, OodPlacementConfig, PopulateConfig, Town, World, populate};

/// Control steps of each drive: 30 s.
const N_STEPS: u32 = 600;

fn world(town: &str, config: PopulateConfig, seed: u64) -> World {
    populate(&Arc::new(Town::load(town).unwrap()), &PopulateConfig { ood: true, ..config }, seed).unwrap()
}

#[test]
fn what_was_tipped_over_rests_as_it_lies() {
    let ood_placement = OodPlacementConfig { tipped_share: 1.0, ..OodPlacementConfig::default() };
    let config =
        PopulateConfig { event_share: 0.0, ood_placement, traffic_density: 0.0, ..PopulateConfig::default() };
    let mut world = world("downtown", config, 4);
    let (start, yaw_rad) = world.ego_start();
    let aim = start + nalgebra::Vector2::new(yaw_rad.cos(), yaw_rad.sin()) * 30.0;
    let models = Arc::clone(&world.models);
    let mut freed = Vec::new();
    for (i, placement) in world.placements.iter_mut().enumerate() {
        let Some(tilt) = &placement.tilt else { continue };
        // What is round may roll on.
        if models[placement.model].facts.rolls.is_some() {
            continue;
        }
        let at = Translation3::new(placement.position.x, placement.position.y, placement.z_m + 0.003);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), placement.yaw_rad) * tilt.turn;
        placement.motion = Motion::Loose(Box::new(Loose {
            event: Event::Rolls,
            world_from_model: Isometry3::from_parts(at, turn),
            aim,
            release_m: 1e6,
            linear_mps: Vector3::zeros(),
            angular_rps: Vector3::zeros(),
        }));
        freed.push(i);
    }
    assert!(freed.len() > 15, "{}", freed.len());
    let mut drive = drive(&world, 4);
    let before: Vec<_> = freed.iter().map(|&i| drive.poses[drive.object_bodies[i]]).collect();
    for _ in 0..50 {
        drive.step().unwrap();
    }
    let moved = |&(&i, before): &(&usize, &Isometry3<f64>)| {
        let now = drive.poses[drive.object_bodies[i]];
        now.rotation.angle_to(&before.rotation) > 0.3
    };
    let n_moved = freed.iter().zip(&before).filter(moved).count();
    // Hulls are coarser than what is seen, so a few find another side.
    assert!(10 * n_moved <= freed.len(), "{n_moved} of {} turned over", freed.len());
}

#[test]
fn no_unfamiliar_object_holds_the_ego_up_for_long() {
    let mut worst_s: f64 = 0.0;
    let mut speeds = Vec::new();
    // The first three alone must get about too.
    let towns =
        ["suburb", "oldtown", "arterial", "suburb", "oldtown", "arterial", "downtown", "market", "suburb"];
    for (town, seed) in towns.into_iter().zip(1..) {
        let config = PopulateConfig { traffic_density: 0.0, leader_share: 0.0, ..PopulateConfig::default() };
        let world = world(town, config, seed);
        let n_unfamiliar = world.objects().iter().filter(|o| o.distribution == Distribution::Ood).count();
        assert!(n_unfamiliar > 20, "{town}: {n_unfamiliar}");
        let mut drive = drive(&world, seed);
        let (mut stands_s, mut driven_m) = (0.0, 0.0);
        for _ in 0..N_STEPS {
            drive.step().unwrap();
            let speed_mps = drive.ego_state().unwrap().speed_mps;
            driven_m += speed_mps * CONTROL_PERIOD_S;
            stands_s = if speed_mps.abs() < 0.3 { stands_s + CONTROL_PERIOD_S } else { 0.0 };
            worst_s = worst_s.max(stands_s);
        }
        speeds.push(driven_m / (f64::from(N_STEPS) * CONTROL_PERIOD_S));
    }
    assert!(worst_s < 15.0, "it stands for {worst_s} s");
    let mean_mps = |speeds: &[f64]| speeds.iter().sum::<f64>() / speeds.len() as f64;
    assert!(mean_mps(&speeds[..3]) > 3.0 && mean_mps(&speeds) > 3.0, "m/s of each drive: {speeds:?}");
}
