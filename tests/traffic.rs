//! A town in motion, with a bicycle model in place of the physics: nobody drives through anybody,
//! and the ego gets about.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::Arc;

use harmzone::geometry::{Transform, convex_overlap_area};
use harmzone::scene::mjcf::{DRIVE_RESPONSE_S, EGO_LENGTH_M, EGO_WIDTH_M, FRONT_BUMPER_X_M, WHEELBASE_M};
use harmzone::scene::{EgoObservation, Footprint, Lighting, PopulateConfig, Town, Traffic, Vec2, populate};

const DT_S: f64 = 0.05;

#[derive(Debug, Default)]
struct Drive {
    /// (time, what) of meetings.
    meetings: Vec<(f64, &'static str, Vec2)>,
    speeds_mps: Vec<f64>,
    steering_rad: Vec<f64>,
    driven_m: f64,
    vehicles_driven_m: f64,
}

fn overlap(a: &Footprint, b: &Footprint) -> f64 {
    if (a.center - b.center).norm() > a.radius_m() + b.radius_m() {
        return 0.0;
    }
    convex_overlap_area(&a.corners(), &b.corners())
}

fn drive(town: &Arc<Town>, seed: u64, ood: bool, duration_s: f64) -> Drive {
    let world = populate(town, &PopulateConfig { ood, ..PopulateConfig::default() }, seed).unwrap();
    let mut traffic = Traffic::new(&world, seed);
    let (mut position, mut yaw_rad) = world.ego_start();
    let mut speed_mps: f64 = 0.0;
    let mut result = Drive::default();
    let mut last = traffic.vehicle_footprints();
    for step in 0..(duration_s / DT_S) as usize {
        let time_s = step as f64 * DT_S;
        let world_from_ego = Transform::from_xyz_yaw(position.x, position.y, 0.0, yaw_rad);
        let commands = traffic.step(DT_S, &EgoObservation { world_from_ego, speed_mps });
        let steering_rad = commands.ego.steering_angle_rad;
        let wanted = (commands.ego.target_speed_mps - speed_mps) / DRIVE_RESPONSE_S;
        speed_mps += wanted.clamp(-8.0, 4.0) * DT_S;
        position += Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * speed_mps * DT_S;
        yaw_rad += speed_mps * steering_rad.tan() / WHEELBASE_M * DT_S;
        result.speeds_mps.push(speed_mps);
        result.steering_rad.push(steering_rad);
        result.driven_m += speed_mps.abs() * DT_S;
        let ahead = FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0;
        let ego = Footprint {
            center: position + Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * ahead,
            yaw_rad,
            length_m: EGO_LENGTH_M,
            width_m: EGO_WIDTH_M,
        };
        let vehicles = traffic.vehicle_footprints();
        result.vehicles_driven_m +=
            vehicles.iter().zip(&last).map(|(a, b)| (a.center - b.center).norm()).sum::<f64>();
        for (i, body) in traffic.footprints().iter().enumerate() {
            if overlap(&ego, body) > 0.02 {
                let what = if i < vehicles.len() { "ego meets vehicle" } else { "ego meets other" };
                result.meetings.push((time_s, what, body.center));
            }
            for vehicle in vehicles.iter().take(i.min(vehicles.len())) {
                if overlap(vehicle, body) > 0.05 {
                    let what =
                        if i < vehicles.len() { "vehicle meets vehicle" } else { "vehicle meets other" };
                    result.meetings.push((time_s, what, body.center));
                }
            }
        }
        last = vehicles;
    }
    result
}

#[test]
fn nobody_drives_through_anybody_and_the_ego_gets_about() {
    let town = Arc::new(Town::load("downtown").unwrap());
    let (mut fastest_mps, mut driven_m) = (0.0_f64, 0.0);
    let (mut left_most, mut right_most) = (0.0_f64, 0.0_f64);
    for seed in 0..4 {
        let drive = drive(&town, seed, seed % 2 == 1, 30.0);
        assert_eq!(drive.meetings, [], "seed {seed}");
        fastest_mps = drive.speeds_mps.iter().copied().fold(fastest_mps, f64::max);
        left_most = drive.steering_rad.iter().copied().fold(left_most, f64::max);
        right_most = drive.steering_rad.iter().copied().fold(right_most, f64::min);
        driven_m += drive.driven_m;
        assert!(drive.vehicles_driven_m > 500.0, "seed {seed}: {}", drive.vehicles_driven_m);
    }
    assert!(fastest_mps > 6.0 && fastest_mps < 14.5, "{fastest_mps}");
    assert!(left_most > 0.1 && right_most < -0.1, "{left_most} {right_most}");
    assert!(driven_m > 4.0 * 50.0, "{driven_m}");
}

#[test]
fn placed_things_do_not_overlap_and_ids_are_unique_and_stable() {
    let town = Arc::new(Town::load("downtown").unwrap());
    let config = PopulateConfig { ood: true, ..PopulateConfig::default() };
    let (world, again) = (populate(&town, &config, 3).unwrap(), populate(&town, &config, 3).unwrap());
    let light = Lighting { ambient: [0.5; 3], sun: None };
    assert_eq!(world.mjcf(&light).xml, again.mjcf(&light).xml);
    let mut ids: Vec<&str> = world.objects().iter().map(|object| object.id.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), world.objects().len());
    let bodies: Vec<Footprint> =
        world.placements.iter().map(|placement| world.footprint(placement)).collect();
    for (i, body) in bodies.iter().enumerate() {
        assert!(bodies[..i].iter().all(|other| overlap(body, other) < 0.01), "{}", world.placements[i].id);
    }
}

#[test]
fn only_an_ood_world_holds_objects_out_of_distribution() {
    use harmzone::object::Distribution;
    let town = Arc::new(Town::load("downtown").unwrap());
    let n_ood = |ood: bool| {
        let world = populate(&town, &PopulateConfig { ood, ..PopulateConfig::default() }, 1).unwrap();
        world.objects().iter().filter(|object| object.distribution == Distribution::Ood).count()
    };
    assert_eq!(n_ood(false), 0);
    assert!(n_ood(true) > 20);
}
