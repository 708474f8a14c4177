//! Episodes of the rig `surround`: what it sees all round, its front camera, and its sweeps.

use std::path::Path;

use nalgebra::Vector3;

use super::GenerateConfig;
use super::episode::tests::record_first;
use crate::episode::EpisodeReader;
use crate::geometry::{Ego, Point};
use crate::object::Object;
use crate::sample::{Measured, Sample};
use crate::sensors::ShippedRig;

const N_SWEEPS: u32 = 9;

/// Some samples through a town.
fn record(rig: ShippedRig, samples: u32, sample_period_s: f64, sweeps: u32, folder: &Path) -> EpisodeReader {
    let config = GenerateConfig {
        towns: vec!["suburb".into()],
        seed: 3,
        samples,
        sample_period_s,
        sweeps,
        warm_up_s: [4.0, 4.0],
        rig: rig.config(),
        ..GenerateConfig::default()
    };
    record_first(&config, folder)
}

fn points_in_ego(measured: &Measured) -> Vec<Point<Ego>> {
    let at = |x_m: f32, y_m: f32, z_m: f32| Point::new(x_m.into(), y_m.into(), z_m.into());
    measured.points.iter().map(|p| measured.ego_from_lidar * at(p.x_m, p.y_m, p.z_m)).collect()
}

/// Ahead, left, behind, right.
fn quarter_of(object: &Object) -> usize {
    let center = &object.box_in_ego.center;
    let turn = center.y().atan2(center.x()) / std::f64::consts::FRAC_PI_2;
    turn.round().rem_euclid(4.0) as usize % 4
}

#[test]
fn the_whole_circle_is_seen_and_annotated_and_its_front_is_the_front_rigs() {
    let folder = tempfile::tempdir().unwrap();
    let surround = record(ShippedRig::Surround, 12, 1.5, 0, &folder.path().join("surround"));
    let front = record(ShippedRig::Front, 12, 1.5, 0, &folder.path().join("front"));
    let names = ["cam_back", "cam_back_left", "cam_back_right", "cam_front_left", "cam_front_right"];
    assert_eq!((surround.cameras(), front.cameras().len()), (&names.map(str::to_owned)[..], 0));
    let (mut n_by_quarter, mut n_hit) = ([0; 4], [0; 4]);
    for sample_idx in 0..surround.len() {
        let whole = surround.whole_sample(sample_idx).unwrap();
        let alone = front.sample(sample_idx).unwrap();
        assert_eq!(whole.measured.image, alone.measured.image, "the pictures of one camera differ");
        assert_eq!(whole.measured.world_from_ego, alone.measured.world_from_ego);
        assert_eq!(surround.views(sample_idx).unwrap().len(), 5);
        let points = points_in_ego(&whole.measured);
        for object in whole.objects() {
            let (n_points, visible_px) = (object.n_lidar_points.unwrap(), object.visible_px.unwrap());
            assert!(n_points > 0 || visible_px >= 20, "{object:?}");
            n_by_quarter[quarter_of(object)] += 1;
            // Noise may put single points outside.
            let is_hit = n_points >= 5;
            let inside = object.box_in_ego.count_inside(&points);
            assert!(!is_hit || inside > 0, "{object:?}");
            n_hit[quarter_of(object)] += usize::from(is_hit);
        }
        // All that the front rig annotates is there, and the cut cloud is about as large as the front rig's.
        let has = |object: &&Object| whole.objects().iter().any(|other| other.id == object.id);
        assert!(alone.objects().iter().all(|object| has(&object)), "sample {sample_idx}");
        let Sample { measured: cut, .. } = surround.sample(sample_idx).unwrap();
        let share = cut.points.len() as f64 / alone.measured.points.len() as f64;
        assert!((share - 1.0).abs() < 0.03, "{share}");
        assert!(whole.measured.points.len() > 4 * cut.points.len(), "{}", whole.measured.points.len());
    }
    assert!(n_hit.iter().all(|&n| n >= 3), "{n_by_quarter:?} of which hit {n_hit:?}");
}

#[test]
fn sweeps_lie_on_the_way_between_two_samples() {
    let folder = tempfile::tempdir().unwrap();
    let reader = record(ShippedRig::Surround, 3, 0.5, N_SWEEPS, folder.path());
    assert_eq!(reader.sweeping(), ["lidar_top".to_owned()]);
    assert!(reader.sweeps(0).unwrap().is_empty());
    let pose = |sample_idx: usize| {
        let measured = reader.whole_sample(sample_idx).unwrap().measured;
        measured.world_from_ego * measured.ego_from_lidar
    };
    for sample_idx in 1..reader.len() {
        let (before, after) = (pose(sample_idx - 1).isometry, pose(sample_idx).isometry);
        let moved_m = (after.translation.vector - before.translation.vector).norm();
        assert!(moved_m > 1.0, "the ego drives: {moved_m}");
        let sweeps = reader.sweeps(sample_idx).unwrap();
        assert_eq!(sweeps.len(), N_SWEEPS as usize);
        for (sweep, n) in sweeps.iter().zip(1_u32..) {
            let from = reader.times_ns()[sample_idx - 1];
            assert_eq!(sweep.time_ns, from + u64::from(n) * 50_000_000);
            let between = before.lerp_slerp(&after, f64::from(n) / 10.0);
            let found = sweep.world_from_lidar.isometry;
            let off: Vector3<f64> = found.translation.vector - between.translation.vector;
            assert!(off.norm() < 0.1 && found.rotation.angle_to(&between.rotation) < 0.01, "{off}");
            assert!(sweep.points.len() > 10_000, "{}", sweep.points.len());
            // The road under the car lies where the world has it.
            let at = sweep
                .points
                .iter()
                .map(|p| found * nalgebra::Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m)));
            let lowest_m = at.map(|point| point.z).fold(f64::INFINITY, f64::min);
            assert!(lowest_m > found.translation.z - 1.84 - 3.0, "{lowest_m}");
        }
    }
}
