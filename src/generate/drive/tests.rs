//! Drives on slopes and past events.

use super::*;
use crate::geometry::Pinhole;
use crate::object::Event;
use crate::scene::{PopulateConfig, Town, populate};
use crate::sim::Renderer;
use std::sync::Arc;

const LIGHTING: Lighting = Lighting { ambient: [0.5; 3], sun: None };

/// One road of 400 m: level, then from 60 m on 8 % uphill, then from 220 m on banked by 4 %.
const SLOPE: &str = r#"<OpenDRIVE><header revMajor="1" revMinor="6"/>
<road id="1" length="400" junction="-1"><type s="0" type="town"><speed max="50" unit="km/h"/></type>
 <planView><geometry s="0" x="0" y="0" hdg="0.5" length="400"><line/></geometry></planView>
 <elevationProfile>
  <elevation s="0" a="3" b="0" c="0" d="0"/>
  <elevation s="60" a="3" b="0" c="0.001" d="0"/>
  <elevation s="100" a="4.6" b="0.08" c="0" d="0"/>
 </elevationProfile>
 <lateralProfile>
  <superelevation s="0" a="0" b="0" c="0" d="0"/>
  <superelevation s="200" a="0" b="0.002" c="0" d="0"/>
  <superelevation s="220" a="0.04" b="0" c="0" d="0"/>
 </lateralProfile>
 <lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>
  <lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
  <lane id="-2" type="sidewalk"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
 </right></laneSection></lanes>
</road></OpenDRIVE>"#;

fn mount() -> CameraMount {
    CameraMount {
        body: "ego".into(),
        cameras: vec![(
            Transform::looking_forward(Vector3::new(1.5, 0.0, 1.5), 0.0),
            Pinhole::from_horizontal_fov(160, 90, 1.2),
        )],
        n_samples: 0,
        shadow_size_px: 256,
        renderer: Renderer::default(),
    }
}

#[test]
fn on_a_slope_the_car_keeps_to_the_ground_and_to_its_speed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slope.xodr");
    fs_err::write(&path, SLOPE).unwrap();
    let town = Arc::new(Town::load(path.to_str().unwrap()).unwrap());
    let config = PopulateConfig {
        traffic_density: 0.0,
        leader_share: 0.0,
        pedestrian_density: 0.0,
        prop_density: 0.1,
        ..PopulateConfig::default()
    };
    let world = populate(&town, &config, 1).unwrap();
    let mut drive = Drive::new(&world, &LIGHTING, &mount(), 1).unwrap();
    let (mut farthest_m, mut jerks, mut speeds) = (0.0_f64, Vec::new(), Vec::new());
    let (mut steepest, mut widest_roll) = (0.0_f64, 0.0_f64);
    let mut climb_before = 0.0;
    for step in 0..760 {
        drive.step().unwrap();
        let pose = drive.world_from_ego().isometry;
        let at = pose.translation.vector;
        let over_m = at.z - town.surface.ground_m(at.xy());
        assert!(over_m.abs() < 0.03, "step {step}: {over_m} m over the ground at {at}");
        let (forward, left) = (pose.rotation * Vector3::x(), pose.rotation * Vector3::y());
        let s_m = at.xy().dot(&nalgebra::Vector2::new(0.5_f64.cos(), 0.5_f64.sin()));
        if (110.0..360.0).contains(&s_m) {
            speeds.push(drive.speed_mps);
            steepest = steepest.max((forward.z - 0.08_f64.atan().sin()).abs());
            // Change of the climb rate in one control step, which shows bumps in the contact.
            jerks.push((forward.z * drive.speed_mps - climb_before).abs());
        }
        if (240.0..360.0).contains(&s_m) {
            // The left edge is the higher one.
            widest_roll = widest_roll.max((left.z - 0.04).abs());
        }
        climb_before = forward.z * drive.speed_mps;
        farthest_m = farthest_m.max(s_m);
    }
    let (slowest, fastest) =
        speeds.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(*v), high.max(*v)));
    assert!(farthest_m > 365.0, "{farthest_m}");
    assert!(slowest > 13.0 && fastest < 14.2, "{slowest} to {fastest} m/s of 13.9");
    assert!(steepest < 0.01 && widest_roll < 0.01, "pitch {steepest}, roll {widest_roll}");
    let worst = jerks.iter().copied().fold(0.0, f64::max);
    assert!(worst < 0.08, "a bump of {worst} m/s");
    // It has come to rest before the end, and stays.
    assert!(drive.speed_mps.abs() < 0.05, "{}", drive.speed_mps);
}

fn world(seed: u64, traffic_density: f64) -> scene::World {
    let town = Arc::new(Town::load("downtown").unwrap());
    let config = PopulateConfig {
        ood: true,
        event_share: 0.8,
        traffic_density,
        leader_share: 0.0,
        pedestrian_density: 0.0,
        ..PopulateConfig::default()
    };
    populate(&town, &config, seed).unwrap()
}

/// A drive through a world with one small camera.
pub(in crate::generate) fn drive(world: &scene::World, seed: u64) -> Drive {
    Drive::new(world, &LIGHTING, &mount(), seed).unwrap()
}

/// Height of the lowest point that is seen.
fn lowest_m(pose: &Isometry3<f64>, object: &scene::SceneObject) -> f64 {
    let points = object.triangles.iter().flatten();
    points.map(|point| (pose * point.cast::<f64>()).z).fold(f64::INFINITY, f64::min)
}

#[test]
fn each_kind_of_event_moves_as_it_says_and_ends_at_rest_on_the_ground() {
    let world = world(3, 0.0);
    let mut drive = drive(&world, 3);
    for thing in &drive.loose {
        drive.simulator.release(thing.body, &thing.plan.linear_mps, &thing.plan.angular_rps).unwrap();
    }
    let starts: Vec<Isometry3<f64>> = drive.loose.iter().map(|thing| drive.poses[thing.body]).collect();
    let route = &world.ego_route.path;
    let mut nearest_m = vec![f64::INFINITY; starts.len()];
    for _ in 0..200 {
        drive.simulator.step(&[0.0; car::N_ACTUATORS], &[], drive.physics_steps).unwrap();
        drive.poses_before = std::mem::replace(&mut drive.poses, drive.simulator.body_poses().unwrap());
        for (thing, nearest_m) in drive.loose.iter().zip(&mut nearest_m) {
            *nearest_m = nearest_m.min(route.distance_m(drive.poses[thing.body].translation.vector.xy()));
        }
    }
    let (mut counts, mut stuck) = (std::collections::BTreeMap::new(), Vec::new());
    for ((thing, start), nearest_m) in drive.loose.iter().zip(&starts).zip(&nearest_m) {
        let (now, before) = (drive.poses[thing.body], drive.poses_before[thing.body]);
        let object = &world.objects()[thing.placement];
        let way = now.translation.vector - start.translation.vector;
        let nearer_m = route.distance_m(start.translation.vector.xy()) - nearest_m;
        let moves = match thing.plan.event {
            Event::Falls => way.z < -2.0,
            Event::Rolls => way.xy().norm() > 2.0,
            Event::Thrown => nearer_m > 3.0,
            Event::None | Event::Lies => false,
        };
        stuck.extend(
            (!moves).then(|| {
                format!("{} {:?}: moved by {way}, nearer by {nearer_m}", object.id, thing.plan.event)
            }),
        );
        let speed_mps = (now.translation.vector - before.translation.vector).norm() / CONTROL_PERIOD_S;
        let low_m = lowest_m(&now, object) - world.town.surface.ground_m(now.translation.vector.xy());
        let is_at_rest = speed_mps < 0.1 && (-0.04..0.2).contains(&low_m);
        assert!(is_at_rest, "{} {:?}: {speed_mps} m/s, {low_m} m high", object.id, thing.plan.event);
        *counts.entry(thing.plan.event).or_insert(0) += 1;
    }
    assert!(stuck.is_empty(), "{stuck:?}");
    assert!(counts.len() == 3 && counts.values().all(|&n| n > 3), "{counts:?}");
}

#[test]
fn what_is_held_keeps_still_until_the_ego_is_near_and_is_then_seen_by_the_drivers() {
    let world = world(5, 0.3);
    let mut drive = drive(&world, 5);
    let starts: Vec<Isometry3<f64>> = drive.loose.iter().map(|thing| drive.poses[thing.body]).collect();
    for _ in 0..300 {
        let was_held: Vec<bool> = drive.loose.iter().map(|thing| thing.is_held).collect();
        let ego = drive.poses[drive.ego_body].translation.vector.xy();
        drive.step().unwrap();
        for ((thing, start), was_held) in drive.loose.iter().zip(&starts).zip(was_held) {
            let moved_m = (drive.poses[thing.body].translation.vector - start.translation.vector).norm();
            let id = &world.objects()[thing.placement].id;
            // The weld gives way where another thing or a car pushes it.
            assert!(!thing.is_held || moved_m < 0.2, "{id} is held and moved by {moved_m} m");
            let is_let_go = was_held && !thing.is_held;
            assert!(!is_let_go || (thing.plan.aim - ego).norm() < thing.plan.release_m);
        }
    }
    let free: Vec<&LooseThing> = drive.loose.iter().filter(|thing| !thing.is_held).collect();
    assert!(!free.is_empty() && free.len() < drive.loose.len(), "{} of {}", free.len(), starts.len());
    let ground = drive.traffic.footprints();
    for thing in free {
        let at = drive.poses[thing.body].translation.vector.xy();
        assert!(ground.iter().any(|body| body.grow(0.5).contains(at)), "nobody sees what lies at {at}");
    }
}
