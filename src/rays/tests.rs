//! The search held to trying every triangle and every solid, one ray at a time.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::solid::Meeting;
use super::*;

const MAX_RANGE_M: f64 = 80.0;

/// Nearest geom by id and where it is met, by trying all.
fn try_all(
    visible: &Visible,
    poses: &[Isometry3<f64>],
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<(i32, Meeting)> {
    let meet = |(index, geom): (usize, &VisibleGeom)| -> Option<(i32, Meeting)> {
        let pose = poses[geom.body] * geom.body_from_geom;
        let origin = pose.inverse_transform_point(&Point3::from(*origin)).coords;
        let direction = pose.inverse_transform_vector(direction);
        let met = match geom.solid {
            Solid::Mesh(_) => {
                let triangles = visible.triangles(index).into_iter();
                triangles.filter_map(|corners| meet_inside(corners, &origin, &direction)).min_by(nearer)
            }
            _ => geom.solid.meet(&origin, &direction),
        };
        met.map(|(t, normal)| (geom.id, (t, pose * normal)))
    };
    let all = visible.geoms.iter().enumerate().filter_map(meet);
    all.filter(|(_, (t, _))| *t <= MAX_RANGE_M).min_by(|a, b| nearer(&a.1, &b.1))
}

fn nearer(a: &Meeting, b: &Meeting) -> std::cmp::Ordering {
    a.0.total_cmp(&b.0)
}

/// By barycentric coordinates (Moeller and Trumbore).
fn meet_inside(
    [a, b, c]: [Vector3<f64>; 3],
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<Meeting> {
    let (ab, ac, to) = (b - a, c - a, origin - a);
    let determinant = ab.dot(&direction.cross(&ac));
    let u = to.dot(&direction.cross(&ac)) / determinant;
    let v = direction.dot(&to.cross(&ab)) / determinant;
    let t = ac.dot(&to.cross(&ab)) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then(|| (t, ab.cross(&ac)))
}

fn solid() -> impl Strategy<Value = Solid> {
    let size = || 0.1..3.0;
    prop_oneof![
        size().prop_map(|radius| Solid::Sphere { radius }),
        (size(), size()).prop_map(|(radius, half)| Solid::Capsule { radius, half }),
        [size(), size(), size()].prop_map(|radii| Solid::Ellipsoid { radii }),
        (size(), size()).prop_map(|(radius, half)| Solid::Cylinder { radius, half }),
        [size(), size(), size()].prop_map(|half| Solid::Box { half }),
        [size(), size()].prop_map(|half| Solid::Plane { half }),
        (0usize..2).prop_map(Solid::Mesh),
    ]
}

fn pose(reach_m: f64) -> impl Strategy<Value = Isometry3<f64>> {
    let at = -reach_m..reach_m;
    ([at.clone(), at.clone(), at], [-3.0..3.0, -3.0..3.0, -3.0..3.0f64]).prop_map(|([x, y, z], turn)| {
        Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
        )
    })
}

fn mesh() -> impl Strategy<Value = VisibleMesh> {
    let vertex = || [-2.0..2.0f32, -2.0..2.0, -2.0..2.0];
    (prop::collection::vec(vertex(), 12), prop::collection::vec([0u32..12, 0..12, 0..12], 1..40))
        .prop_map(|(vertices, faces)| VisibleMesh { vertices, faces })
}

prop_compose! {
    /// A world of which every second body moves.
    fn world()(
        bodies in prop::collection::vec(pose(20.0), 6),
        moved in prop::collection::vec(pose(20.0), 6),
        geoms in prop::collection::vec((solid(), pose(3.0), 0usize..6), 1..40),
        meshes in prop::collection::vec(mesh(), 2),
    ) -> (Visible, Vec<Isometry3<f64>>, Vec<Isometry3<f64>>) {
        let moves: Vec<bool> = (0..6).map(|body| body % 2 == 1).collect();
        let after = (0..6).map(|body| if moves[body] { moved[body] } else { bodies[body] }).collect();
        let geoms = geoms.into_iter().enumerate().map(|(id, (solid, body_from_geom, body))| {
            VisibleGeom { id: 100 + id as i32, body, body_from_geom, solid }
        });
        (Visible { geoms: geoms.collect(), meshes, moves }, bodies, after)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Rays within a hair of an edge may pass on its other side.
    #[test]
    fn rays_meet_what_trying_all_finds((visible, before, after) in world(), sensor in pose(15.0)) {
        let directions: Vec<Vector3<f64>> = (0..400)
            .map(|i| (f64::from(i) * 2.4, (f64::from(i) + 0.5) / 200.0 - 1.0))
            .map(|(turn, z)| Vector3::new(turn.cos() * (1.0 - z * z).sqrt(), turn.sin() * (1.0 - z * z).sqrt(), z))
            .collect();
        let mut scene = RayScene::new(visible.clone(), &before);
        scene.set_poses(&after);
        let hits = scene.cast(&sensor, &Beams::new(&directions), MAX_RANGE_M);
        let mut n_other = 0;
        for (ray, direction) in directions.iter().enumerate() {
            let direction = sensor * direction;
            match try_all(&visible, &after, &sensor.translation.vector, &direction) {
                Some((id, (t, normal))) if id == hits.geom[ray] => {
                    let cos = (normal.dot(&direction) / normal.norm()).abs();
                    // Another triangle of the same mesh, where they cross.
                    let is_near = (t - hits.range_m[ray]).abs() < 1e-3;
                    prop_assert!(is_near, "ray {ray}: {t} and {}", hits.range_m[ray]);
                    n_other += usize::from((cos - hits.cos_incidence[ray]).abs() > 1e-6);
                }
                None => n_other += usize::from(hits.geom[ray] != -1),
                Some(_) => n_other += 1,
            }
        }
        prop_assert!(n_other <= 2, "{n_other} of 400 differ");
    }
}

fn wall_and_ball() -> Visible {
    let geom = |id, body, x: f64, solid| VisibleGeom {
        id,
        body,
        body_from_geom: Isometry3::translation(x, 0.0, 0.0),
        solid,
    };
    Visible {
        geoms: vec![
            geom(3, 0, 10.0, Solid::Box { half: [1.0, 8.0, 4.0] }),
            geom(5, 1, 0.0, Solid::Sphere { radius: 0.5 }),
        ],
        meshes: Vec::new(),
        moves: vec![false, true],
    }
}

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

#[test]
fn a_ray_from_within_meets_the_far_side_and_one_that_starts_behind_meets_nothing() {
    let scene = RayScene::new(wall_and_ball(), &[at(0.0, 0.0, 0.0), at(0.0, 50.0, 0.0)]);
    let beams = Beams::new(&[Vector3::x(), -Vector3::x(), Vector3::z()]);
    let hits = scene.cast(&at(10.5, 0.0, 0.0), &beams, 80.0);
    assert_eq!(hits.geom, [3, 3, 3]);
    assert!(hits.range_m.iter().zip([0.5, 1.5, 4.0]).all(|(found, wanted)| (found - wanted).abs() < 1e-12));
    assert_eq!(scene.cast(&at(12.0, 0.0, 0.0), &beams, 80.0).geom, [-1, 3, -1]);
}

#[test]
fn a_hit_at_the_range_counts_and_one_behind_it_does_not() {
    let scene = RayScene::new(wall_and_ball(), &[at(0.0, 0.0, 0.0), at(0.0, 50.0, 0.0)]);
    let beams = Beams::new(&[Vector3::x()]);
    assert_eq!(scene.cast(&at(0.0, 0.0, 0.0), &beams, 9.0).range_m, [9.0]);
    assert_eq!(scene.cast(&at(0.0, 0.0, 0.0), &beams, 8.999).range_m, [f64::INFINITY]);
}

#[test]
fn directions_of_another_length_give_the_same_ranges() {
    let scene = RayScene::new(wall_and_ball(), &[at(0.0, 0.0, 0.0), at(4.0, 0.0, 0.0)]);
    let long = scene.cast(&at(0.0, 0.0, 0.0), &Beams::new(&[Vector3::new(5.0, 0.0, 0.5)]), 80.0);
    let unit = scene.cast(&at(0.0, 0.0, 0.0), &Beams::new(&[Vector3::new(1.0, 0.0, 0.1).normalize()]), 80.0);
    assert_eq!((long.geom[0], unit.geom[0]), (5, 5));
    assert!((long.range_m[0] - unit.range_m[0]).abs() < 1e-12);
}

#[test]
fn an_empty_world_shows_nothing() {
    let scene = RayScene::new(Visible::default(), &[]);
    assert_eq!(scene.cast(&at(0.0, 0.0, 0.0), &Beams::new(&[Vector3::x()]), 80.0).geom, [-1]);
}
