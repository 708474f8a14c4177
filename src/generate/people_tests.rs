//! People in the simulator: the look of the present phase is the one that is seen and hit.

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::drive::tests::drive;
use crate::rays::Beams;
use crate::scene::{PeopleConfig, PopulateConfig, Town, populate};

#[test]
fn rays_meet_a_walker_in_the_phase_it_is_in_and_the_phases_follow_its_way() {
    let town = Arc::new(Town::load("downtown").unwrap());
    let people = PeopleConfig { group_share: 0.6, ..PeopleConfig::default() };
    let config = PopulateConfig { pedestrian_density: 0.5, people, ..PopulateConfig::default() };
    let world = populate(&town, &config, 3).unwrap();
    let mut drive = drive(&world, 3);
    let mut scene = drive.simulator.ray_scene().unwrap();
    let walkers: Vec<usize> =
        (0..world.objects().len()).filter(|&i| !world.objects()[i].shapes.is_empty()).collect();
    assert!(walkers.len() > 5, "{}", walkers.len());
    let (mut n_hits, mut shown) = (0, vec![std::collections::BTreeSet::new(); walkers.len()]);
    for _ in 0..12 {
        for _ in 0..5 {
            drive.step().unwrap();
        }
        scene.set_poses(&drive.poses);
        for (walker, shown) in walkers.iter().zip(&mut shown) {
            let (object, shape) = (&world.objects()[*walker], drive.shapes[*walker]);
            shown.insert(shape);
            let bodies: Vec<usize> = (0..object.shapes.len())
                .map(|shape| drive.simulator.body(&object.shape_body_name(shape)).unwrap())
                .collect();
            let pose = drive.poses[drive.object_bodies[*walker]];
            assert!((drive.poses[bodies[shape]].translation.vector - pose.translation.vector).norm() < 1e-9);
            let elsewhere = bodies.iter().enumerate().filter(|(other, _)| *other != shape);
            for (_, body) in elsewhere {
                assert!(drive.poses[*body].translation.z < -1000.0, "{} shows two looks", object.id);
            }
            // From a metre and a half beside it, at all heights.
            let from = pose
                * Isometry3::from_parts(
                    Translation3::new(0.0, -1.5, 0.9),
                    UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
                );
            let rays: Vec<Vector3<f64>> =
                (0..40).map(|i| Vector3::new(1.0, 0.0, f64::from(i) / 40.0 - 0.5).normalize()).collect();
            let hits = scene.cast(&from, &Beams::new(&rays), 3.0);
            for geom in hits.geom.iter().filter_map(|&geom| usize::try_from(geom).ok()) {
                let body = drive.simulator.geom_bodies()[geom];
                if let Some(hit) = bodies.iter().position(|other| *other == body) {
                    assert_eq!(hit, shape, "{}", object.id);
                    n_hits += 1;
                }
            }
        }
    }
    assert!(n_hits > 1000, "{n_hits}");
    let changing = shown.iter().filter(|shown| shown.len() > 4).count();
    assert!(2 * changing > walkers.len(), "{changing} of {} walk", walkers.len());
}
