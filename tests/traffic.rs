//! A town in motion, with a bicycle model in place of the physics: nobody drives through anybody,
//! and the ego gets about.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmzone::geometry::{Transform, convex_overlap_area};
use harmzone::scene::car::{DRIVE_RESPONSE_S, EGO_LENGTH_M, EGO_WIDTH_M, FRONT_BUMPER_X_M, WHEELBASE_M};
use harmzone::scene::{
    ActorConfig, ActorMotion, Aspect, EgoObservation, EgoOrders, Footprint, Lighting, PopulateConfig, Town,
    Traffic, Vec2, World, populate, town_names,
};

const DT_S: f64 = 0.05;
/// Nobody is deeper in anybody than this.
const MAX_DEPTH_M: f64 = 0.1;

#[derive(Debug, Default)]
struct Drive {
    /// (time, what) of meetings.
    meetings: Vec<(f64, &'static str, Vec2)>,
    speeds_mps: Vec<f64>,
    steering_rad: Vec<f64>,
    /// Longest time that the ego stood.
    stood_s: f64,
    driven_m: f64,
    vehicles_driven_m: f64,
}

/// Whether two bodies overlap by more than [`MAX_DEPTH_M`].
fn is_deep(a: &Footprint, b: &Footprint) -> bool {
    let (a, b) = (a.grow(-MAX_DEPTH_M / 2.0), b.grow(-MAX_DEPTH_M / 2.0));
    (a.center - b.center).norm() < a.radius_m() + b.radius_m()
        && convex_overlap_area(&a.corners(), &b.corners()) > 1e-6
}

fn overlap(a: &Footprint, b: &Footprint) -> f64 {
    if (a.center - b.center).norm() > a.radius_m() + b.radius_m() {
        return 0.0;
    }
    convex_overlap_area(&a.corners(), &b.corners())
}

fn drive(world: &World, seed: u64, duration_s: f64, look: impl FnMut(f64, Vec2, f64, &Traffic)) -> Drive {
    drive_in(world, Traffic::new(world, seed), duration_s, look)
}

fn drive_in(
    world: &World,
    mut traffic: Traffic,
    duration_s: f64,
    mut look: impl FnMut(f64, Vec2, f64, &Traffic),
) -> Drive {
    let (mut position, mut yaw_rad) = world.ego_start();
    let mut speed_mps: f64 = 0.0;
    let mut result = Drive::default();
    let mut last = traffic.vehicle_footprints();
    let mut stands_s = 0.0;
    for step in 0..(duration_s / DT_S) as usize {
        let time_s = step as f64 * DT_S;
        let z_m = world.town.surface.ground_m(position);
        let world_from_ego = Transform::from_xyz_yaw(position.x, position.y, z_m, yaw_rad);
        let commands = traffic.step(DT_S, &EgoObservation { world_from_ego, speed_mps });
        let steering_rad = commands.ego.steering_angle_rad;
        let wanted = (commands.ego.target_speed_mps - speed_mps) / DRIVE_RESPONSE_S;
        speed_mps += wanted.clamp(-8.0, 4.0) * DT_S;
        let direction = Vec2::new(yaw_rad.cos(), yaw_rad.sin());
        position += direction * speed_mps * DT_S;
        yaw_rad += speed_mps * steering_rad.tan() / WHEELBASE_M * DT_S;
        result.speeds_mps.push(speed_mps);
        result.steering_rad.push(steering_rad);
        result.driven_m += speed_mps.abs() * DT_S;
        stands_s = if speed_mps.abs() < 0.3 { stands_s + DT_S } else { 0.0 };
        result.stood_s = result.stood_s.max(stands_s);
        look(time_s, position + direction * FRONT_BUMPER_X_M, speed_mps, &traffic);
        let ahead = FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0;
        let ego = Footprint {
            center: position + Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * ahead,
            yaw_rad,
            length_m: EGO_LENGTH_M,
            width_m: EGO_WIDTH_M,
        };
        let vehicles = traffic.vehicle_footprints();
        // Who starts elsewhere has not driven there.
        let moved = vehicles.iter().zip(&last).map(|(a, b)| (a.center - b.center).norm());
        result.vehicles_driven_m += moved.filter(|&moved_m| moved_m < 2.0).sum::<f64>();
        for (i, body) in traffic.footprints().iter().enumerate() {
            if is_deep(&ego, body) {
                let what = if i < vehicles.len() { "ego meets vehicle" } else { "ego meets other" };
                result.meetings.push((time_s, what, body.center));
            }
            for vehicle in vehicles.iter().take(i.min(vehicles.len())) {
                if is_deep(vehicle, body) {
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

fn filled(town: &Arc<Town>, seed: u64, ood: bool) -> World {
    populate(town, &PopulateConfig { ood, ..PopulateConfig::default() }, seed).unwrap()
}

fn town_of(text: &str, name: &str) -> Arc<Town> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs_err::write(&path, text).unwrap();
    Arc::new(Town::load(path.to_str().unwrap()).unwrap())
}

/// A quiet town, with a car that stands so far ahead in the ego's lane, or without one.
fn with_car_ahead(town: &Arc<Town>, ahead_m: Option<f64>) -> World {
    // It would drive if the ego came nearer than 0 m.
    let car = |ahead_m: f64| ActorConfig {
        model: "car".to_owned(),
        motion: ActorMotion::Drives,
        trigger_m: 0.0,
        ahead_m,
        ..ActorConfig::default()
    };
    let quiet = PopulateConfig {
        traffic_density: 0.0,
        pedestrian_density: 0.0,
        leader_share: 0.0,
        jaywalker_share: 0.0,
        actors: ahead_m.map(|ahead_m| ("car".to_owned(), car(ahead_m))).into_iter().collect(),
        ..PopulateConfig::default()
    };
    populate(town, &quiet, 5).unwrap()
}

#[test]
fn no_car_in_its_lane_holds_the_driver_under_test_who_sees_none() {
    let (mut n_held, mut n_ways) = (0, 0);
    for name in ["downtown", "suburb"] {
        let town = Arc::new(Town::load(name).unwrap());
        let speeds = |ahead_m: Option<f64>, is_tested: bool| {
            let world = with_car_ahead(&town, ahead_m);
            let mut traffic = Traffic::new(&world, 5);
            if is_tested {
                traffic.order(EgoOrders::default());
            }
            drive_in(&world, traffic, 20.0, |_, _, _, _| {}).speeds_mps
        };
        let (tested, scripted) = (speeds(None, true), speeds(None, false));
        for ahead_m in (2..12).map(|i| f64::from(i) * 10.0) {
            assert_eq!(speeds(Some(ahead_m), true), tested, "{name}, {ahead_m} m");
            n_held += usize::from(speeds(Some(ahead_m), false) != scripted);
            n_ways += 1;
        }
    }
    // The scripted driver sees it.
    assert!(n_held > n_ways / 2, "{n_held} of {n_ways}");
}

#[test]
fn in_every_town_nobody_drives_through_anybody_and_the_ego_gets_about() {
    let (mut left_most, mut right_most, mut slowest) = (0.0_f64, 0.0_f64, f64::INFINITY);
    for name in town_names() {
        let town = Arc::new(Town::load(&name).unwrap());
        let limit_mps = town.graph.lanes.iter().map(|lane| lane.limit_mps).fold(0.0, f64::max);
        let (mut fastest_mps, mut driven_m, mut n_stuck) = (0.0_f64, 0.0, 0);
        for seed in 0..8 {
            let world = filled(&town, seed, seed % 2 == 1);
            let drive = drive(&world, seed, 40.0, |_, _, _, _| {});
            assert_eq!(drive.meetings, [], "{name}, seed {seed}");
            fastest_mps = drive.speeds_mps.iter().copied().fold(fastest_mps, f64::max);
            slowest = drive.speeds_mps.iter().copied().fold(slowest, f64::min);
            left_most = drive.steering_rad.iter().copied().fold(left_most, f64::max);
            right_most = drive.steering_rad.iter().copied().fold(right_most, f64::min);
            driven_m += drive.driven_m;
            n_stuck += usize::from(drive.driven_m < 20.0);
            println!(
                "{name} {seed}: ego {:.0} m, stood {:.1} s, others {:.0} m",
                drive.driven_m, drive.stood_s, drive.vehicles_driven_m
            );
            assert!(drive.vehicles_driven_m > 300.0, "{name}, seed {seed}: {}", drive.vehicles_driven_m);
        }
        println!("{name}: up to {fastest_mps:.1} of {limit_mps:.1} m/s");
        assert!(fastest_mps > 0.6 * limit_mps && fastest_mps < limit_mps + 0.8, "{name}: {fastest_mps}");
        assert!(driven_m > 8.0 * 50.0 && n_stuck <= 2, "{name}: {driven_m} m, {n_stuck} stuck");
    }
    println!("steering {:.1} to {:.1} degrees", right_most.to_degrees(), left_most.to_degrees());
    assert!(slowest < 0.1, "{slowest}");
    assert!(left_most.to_degrees() > 25.0 && right_most.to_degrees() < -25.0, "{left_most} {right_most}");
}

/// Networks by others: one that lies here, and those beside the repository where they are.
fn samples() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = vec![root.join("tests/data/crossroads.xodr")];
    let more = root.join("../shared/samples/opendrive");
    if let Ok(entries) = fs_err::read_dir(&more) {
        paths.extend(entries.map(|entry| entry.unwrap().path()));
    } else {
        // Not by `eprintln!`, which a passing test does not show.
        let told = format!("\nSKIPPED: there are no further sample networks in {}\n", more.display());
        std::io::stderr().write_all(told.as_bytes()).unwrap();
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "xodr"));
    paths.sort();
    paths
}

#[test]
fn networks_by_others_load_and_drive() {
    for path in samples() {
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let town = Arc::new(Town::load(path.to_str().unwrap()).unwrap());
        println!("{name}: {:?}", town.notes);
        let mut driven_m = 0.0;
        for seed in 0..2 {
            let world = filled(&town, seed, false);
            let drive = drive(&world, seed, 30.0, |_, _, _, _| {});
            println!("{name} {seed}: ego {:.0} m, stood {:.1} s", drive.driven_m, drive.stood_s);
            assert_eq!(drive.meetings, [], "{name}, seed {seed}");
            driven_m += drive.driven_m;
        }
        assert!(driven_m > 60.0, "{name}: {driven_m}");
    }
}

/// A street of 240 m with a lane each way and a light for eastbound traffic at 120 m.
const STREET: &str = r#"<OpenDRIVE><header revMajor="1" revMinor="6"/>
<road id="1" length="240" junction="-1" rule="RHT"><type s="0" type="town"><speed max="50" unit="km/h"/></type>
 <planView><geometry s="0" x="0" y="0" hdg="0" length="240"><line/></geometry></planView>
 <lanes><laneSection s="0">
  <left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
  <center><lane id="0" type="none"/></center>
  <right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
 </laneSection></lanes>
 <signals><signal id="5" name="" s="120" t="-5" zOffset="0" orientation="+" dynamic="yes" country="OpenDRIVE"
  type="1000001" subtype="-1"><validity fromLane="-1" toLane="-1"/></signal></signals>
</road></OpenDRIVE>"#;

#[test]
fn the_ego_stops_at_a_red_light_and_drives_on_at_green() {
    let town = town_of(STREET, "street.xodr");
    assert_eq!(town.lights.lights.len(), 1);
    let config = PopulateConfig { traffic_density: 0.0, leader_share: 0.0, ..PopulateConfig::default() };
    let (mut n_east, mut n_stopped, mut n_passed) = (0, 0, 0);
    for seed in 0..24 {
        let world = populate(&town, &config, seed).unwrap();
        if world.ego_start().1.abs() > 0.5 {
            continue;
        }
        n_east += 1;
        let (mut before_m, mut has_stopped) = (0.0, false);
        drive(&world, seed, 60.0, |time_s, front, speed_mps, traffic| {
            let aspect = traffic.aspects()[0];
            let is_crossing = before_m < 120.0 && front.x >= 120.0;
            assert!(!is_crossing || aspect != Aspect::Red, "seed {seed}: over the line at red, {time_s} s");
            n_passed += usize::from(is_crossing);
            has_stopped |= (114.0..120.0).contains(&front.x) && speed_mps < 0.2 && aspect == Aspect::Red;
            before_m = front.x;
        });
        n_stopped += usize::from(has_stopped);
    }
    assert!(n_east > 4 && n_passed == n_east, "{n_passed} of {n_east} passed");
    assert!(n_stopped > 0 && n_stopped < n_east, "{n_stopped} of {n_east} had to stop");
}

#[test]
fn where_traffic_keeps_left_so_does_everybody() {
    let right = town_of(STREET, "right.xodr");
    let left = town_of(&STREET.replace("RHT", "LHT"), "left.xodr");
    assert!(!right.graph.keeps_left && left.graph.keeps_left);
    for (town, sign) in [(right, -1.0), (left, 1.0)] {
        for lane in &town.graph.lanes {
            // Offset of the lane from the middle of the street, to the left of its own way.
            let offset_m = lane.path.at(10.0).y * lane.path.direction(10.0).x;
            assert!((offset_m - sign * 1.75).abs() < 0.01, "{offset_m}");
        }
    }
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
