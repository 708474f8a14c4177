//! An object cut out of a sample, made ready for another: turned, stretched, perhaps tipped over.

use nalgebra::Vector3;
use rand::RngExt;

use super::config::AugmentConfig;
use crate::dataset::{LabelledSample, SampleFacts};
use crate::geometry::{Box3, Ego, Lidar, Point, Transform};
use crate::object::{Kind, LabelledObject, Object, SolidPart};
use crate::random::Rng;
use crate::sample::Measured;

/// An object with fewer points is not worth pasting.
const MIN_POINTS_OF_DONOR: u32 = 8;
/// Margin to the edges of the cloud.
const EDGE_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Lower points in a donor's box belong to the ground.
const ABOVE_GROUND_M: f64 = 0.05;
/// Taller objects are not tipped over.
const MAX_HEIGHT_OF_TIPPED_M: f64 = 2.5;
const INTENSITY_SPREAD: f64 = 0.4;
/// Donors that are drawn anew where the weather is to be alike: among as many there is one, or it is a rare weather.
const N_DONORS: usize = 30;
/// Where fog and rain begin, and where they are dense: meteorological optical range, m, and rain rate, mm/h.
const FOG_M: [f64; 2] = [1000.0, 200.0];
const RAIN_MMPH: [f64; 2] = [0.1, 10.0];

/// A LiDAR return in the ego frame.
#[derive(Debug, Clone, Copy)]
pub struct Return {
    pub at: Point<Ego>,
    pub intensity: f32,
    pub ring: u16,
}

/// An object and its returns.
pub struct CutOut {
    pub truth: Object,
    pub points: Vec<Return>,
    /// Whether it stands farther away than it did, so that its own ground says nothing of the ground there.
    pub is_moved: bool,
}

impl CutOut {
    /// Draws two objects of one sample and takes the nearer; turns it about the LiDAR of `into`, stretches it, and may
    /// shrink it, move it away or tip it over. `None` where the sample has no object with enough points.
    pub fn draw(
        donors: &[LabelledSample],
        into: &LabelledSample,
        config: &AugmentConfig,
        rng: &mut Rng,
    ) -> Option<Self> {
        let mut donor = &donors[rng.random_range(0..donors.len())];
        if config.paste_alike {
            for _ in 0..N_DONORS {
                if is_alike(&donor.facts, &into.facts) {
                    break;
                }
                donor = &donors[rng.random_range(0..donors.len())];
            }
        }
        let into = &into.measured;
        let known = |object: &&LabelledObject| object.truth.n_lidar_points >= Some(MIN_POINTS_OF_DONOR);
        let candidates: Vec<&LabelledObject> = donor.objects.iter().filter(known).collect();
        if candidates.is_empty() {
            return None;
        }
        let lidar = into.ego_from_lidar.isometry.translation.vector;
        let distance_m =
            |object: &LabelledObject| (object.truth.box_in_ego.center.coords.coords - lidar).xy().norm();
        let mut any = || candidates[rng.random_range(0..candidates.len())];
        let (one, other) = (any(), any());
        let object = if distance_m(other) < distance_m(one) { other } else { one };

        let mut truth = object.truth.clone();
        let mut points = returns_in(&donor.measured, &truth.box_in_ego);
        let mut factor = || config.max_stretch.powf(2.0 * rng.random::<f64>() - 1.0);
        let mut factors = [factor(), factor(), factor()];
        let intensity = 1.0 + INTENSITY_SPREAD * (2.0 * rng.random::<f64>() - 1.0);
        let is_tipped = rng.random::<f64>() < config.tipped_share
            && truth.kind == Some(Kind::Static)
            && truth.box_in_ego.height_m < MAX_HEIGHT_OF_TIPPED_M;
        let is_static = truth.kind == Some(Kind::Static);
        let [is_shrunk, is_moved] =
            [config.shrunk_share, config.moved_share].map(|share| rng.random::<f64>() < share);
        let [shrink, move_] =
            [config.min_shrink, config.max_moved].map(|most| most.powf(rng.random::<f64>()));
        let of = &truth.box_in_ego;
        let least_shrink = (config.least_pasted_m / of.length_m.max(of.width_m).max(of.height_m)).min(1.0);
        let shrink = if is_shrunk && is_static { shrink.max(least_shrink) } else { 1.0 };
        let away = if is_moved { move_ } else { 1.0 };
        factors = factors.map(|factor| factor * shrink);
        reshape(&mut truth.box_in_ego, &mut points, factors, is_tipped);
        // A ring's points come closer to each other as the object gets smaller or farther.
        points.retain(|_| rng.random::<f64>() < shrink / away);
        truth.solid = truth.solid.filter(|_| !is_tipped).map(|part| stretch(part, factors));
        // It is set down on the ground, and the picture does not show it.
        truth.clearance_m = Some(0.0);
        truth.visible_px = Some(0);
        for point in &mut points {
            point.intensity = (f64::from(point.intensity) * intensity).min(255.0) as f32;
        }

        let center = truth.box_in_ego.center;
        let farther = (center.coords.coords - lidar) * (away - 1.0);
        let outwards = |p: Point<Ego>| Point::new(p.x() + farther.x, p.y() + farther.y, p.z());
        truth.box_in_ego.center = outwards(center);
        points.iter_mut().for_each(|point| point.at = outwards(point.at));
        let bearing = (center.y() - lidar.y).atan2(center.x() - lidar.x);
        let reach = (into.intrinsics.horizontal_fov_rad() / 2.0 - EDGE_RAD).max(0.0);
        let turn = (2.0 * rng.random::<f64>() - 1.0) * reach - bearing;
        let about_origin = Transform::<Ego, Ego>::from_xyz_yaw(0.0, 0.0, 0.0, turn);
        let axis = Vector3::new(lidar.x, lidar.y, 0.0);
        let turned =
            Transform::<Ego, Ego>::new(axis - about_origin.rotate(&axis), about_origin.isometry.rotation);
        truth.box_in_ego = truth.box_in_ego.in_frame(&turned);
        let [x, y] = truth.velocity_in_ego_mps;
        let velocity = turned.rotate(&Vector3::new(x, y, 0.0));
        truth.velocity_in_ego_mps = [velocity.x, velocity.y];
        points.iter_mut().for_each(|point| point.at = turned * point.at);
        Some(Self { truth, points, is_moved })
    }
}

/// Whether it is as foggy and as rainy in two samples.
fn is_alike(one: &SampleFacts, other: &SampleFacts) -> bool {
    let class = |facts: &SampleFacts| {
        let fog = facts.mor_m.map(|mor_m| FOG_M.iter().filter(|&&from_m| mor_m < from_m).count());
        let rain = facts.rain_rate_mmph.map(|rate| RAIN_MMPH.iter().filter(|&&from| rate > from).count());
        (fog, rain)
    };
    class(one) == class(other)
}

/// Finds the returns inside a box, without those of the ground.
pub fn returns_in(measured: &Measured, box_in_ego: &Box3<Ego>) -> Vec<Return> {
    returns(measured).filter(|of| is_above_ground_in(box_in_ego, of)).collect()
}

/// How many returns of each object there are above the ground.
pub fn count_returns(measured: &Measured, objects: &[LabelledObject]) -> Vec<u32> {
    let all: Vec<Return> = returns(measured).collect();
    let count = |object: &LabelledObject| {
        let of = &object.truth.box_in_ego;
        let reach_m = of.length_m.hypot(of.width_m) / 2.0 + 2.0 * ABOVE_GROUND_M;
        let is_near = |point: &&Return| {
            (point.at.x() - of.center.x()).abs() < reach_m && (point.at.y() - of.center.y()).abs() < reach_m
        };
        all.iter().filter(is_near).filter(|point| is_above_ground_in(of, point)).count() as u32
    };
    objects.iter().map(count).collect()
}

/// Whether a return in or next to a box is not one of the ground below it.
pub fn is_above_ground_in(of: &Box3<Ego>, point: &Return) -> bool {
    of.contains(&point.at, ABOVE_GROUND_M) && point.at.z() > of.bottom_m() + ABOVE_GROUND_M
}

/// Lists the returns of a sample.
pub fn returns(measured: &Measured) -> impl Iterator<Item = Return> {
    measured.points.iter().map(|of| {
        let in_lidar = Point::<Lidar>::new(f64::from(of.x_m), f64::from(of.y_m), f64::from(of.z_m));
        Return { at: measured.ego_from_lidar * in_lidar, intensity: of.intensity, ring: of.ring }
    })
}

fn stretch(part: SolidPart, [along, across, _]: [f64; 3]) -> SolidPart {
    SolidPart {
        along_m: part.along_m * along,
        across_m: part.across_m * across,
        length_m: part.length_m * along,
        width_m: part.width_m * across,
    }
}

/// Stretches a box and its points about the middle of its bottom, and lays a tipped one on its side.
fn reshape(of: &mut Box3<Ego>, points: &mut [Return], [along, across, up]: [f64; 3], is_tipped: bool) {
    let bottom = of.center.coords.coords - Vector3::z() * (of.height_m / 2.0);
    let (sin, cos) = of.yaw_rad.sin_cos();
    (of.length_m, of.width_m, of.height_m) = (of.length_m * along, of.width_m * across, of.height_m * up);
    let (stretched_width_m, stretched_height_m) = (of.width_m, of.height_m);
    if is_tipped {
        (of.width_m, of.height_m) = (of.height_m, of.width_m);
    }
    for point in points {
        let offset = point.at.coords.coords - bottom;
        let x = (offset.x * cos + offset.y * sin) * along;
        let mut y = (offset.y * cos - offset.x * sin) * across;
        let mut z = offset.z * up;
        if is_tipped {
            (y, z) = (z - stretched_height_m / 2.0, stretched_width_m / 2.0 - y);
        }
        let turned = bottom + Vector3::new(x * cos - y * sin, x * sin + y * cos, z);
        point.at = Point::new(turned.x, turned.y, turned.z);
    }
    of.center = Point::new(bottom.x, bottom.y, bottom.z + of.height_m / 2.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::object::Harm;
    use crate::random;
    use crate::sample::LidarPoint;
    use crate::train::targets::car;

    #[test]
    fn stretched_and_tipped_objects_fill_their_boxes() {
        let mut of = car(12.0, 3.0, Harm::Harmless).truth.box_in_ego;
        of.yaw_rad = 0.7;
        let corners = of.corners();
        let mut points: Vec<Return> =
            corners.iter().map(|p| Return { at: *p, intensity: 100.0, ring: 0 }).collect();
        reshape(&mut of, &mut points, [1.5, 0.5, 2.0], true);
        assert!(
            (of.length_m - 6.0).abs() < 1e-9
                && (of.height_m - 0.9).abs() < 1e-9
                && (of.width_m - 3.0).abs() < 1e-9
        );
        assert!((of.center.z() - 0.45).abs() < 1e-9);
        for point in &points {
            assert!(of.contains(&point.at, 1e-9) && !of.contains(&point.at, -0.01), "{point:?}");
        }
    }

    /// One standing thing 12 m ahead, full of points.
    fn donor() -> LabelledSample {
        let mut sample = test_data::dataset(1).samples()[0].clone();
        let mut object = car(12.0, 0.0, Harm::Harmless);
        object.truth.kind = Some(Kind::Static);
        object.truth.n_lidar_points = Some(600);
        let lidar_from_ego = sample.measured.ego_from_lidar.inverse();
        let returned = |i: u16| {
            let (x, y, z) = (i % 10, i / 10 % 10, i / 100);
            let at = [10.2 + 0.4 * f64::from(x), -0.8 + 0.17 * f64::from(y), 0.2 + 0.2 * f64::from(z)];
            let p = lidar_from_ego * Point::new(at[0], at[1], at[2]);
            let [x_m, y_m, z_m] = [p.x(), p.y(), p.z()].map(|of| of as f32);
            LidarPoint { x_m, y_m, z_m, intensity: 90.0, ring: z }
        };
        sample.measured.points = (0..600).map(returned).collect();
        sample.objects = vec![object];
        sample
    }

    /// Cut-outs of the donor at these shares of moved and of shrunk ones, to half the size and to twice the distance at most.
    fn drawn(moved_share: f64, shrunk_share: f64) -> Vec<CutOut> {
        let config = AugmentConfig {
            max_stretch: 1.0,
            tipped_share: 0.0,
            moved_share,
            max_moved: 2.0,
            shrunk_share,
            min_shrink: 0.5,
            ..AugmentConfig::default()
        };
        let donors = [donor()];
        let into = &donors[0];
        let draw =
            |i| CutOut::draw(&donors, into, &config, &mut random::stream(5, "cut-out-test", i)).unwrap();
        (0..50).map(draw).collect()
    }

    #[test]
    fn donors_are_of_like_weather_and_things_stay_large_enough_where_that_is_asked_for() {
        let weather = |mor_m: f64, sample: LabelledSample| LabelledSample {
            facts: SampleFacts { mor_m: Some(mor_m), rain_rate_mmph: Some(0.0), ..sample.facts.clone() },
            ..sample
        };
        let mut far = donor();
        far.objects[0].truth.id = Some("clear".into());
        let donors = [weather(20_000.0, far), weather(150.0, donor())];
        let drawn = |paste_alike, least_pasted_m| {
            let config =
                AugmentConfig { paste_alike, least_pasted_m, shrunk_share: 1.0, ..AugmentConfig::default() };
            let draw =
                |i| CutOut::draw(&donors, &donors[1], &config, &mut random::stream(6, "cut-out-test", i));
            (0..60).filter_map(draw).map(|cut_out| cut_out.truth).collect::<Vec<Object>>()
        };
        let n_clear = |of: &[Object]| of.iter().filter(|truth| truth.id.as_deref() == Some("clear")).count();
        let (any, alike) = (drawn(false, 0.0), drawn(true, 6.0));
        assert!(n_clear(&any) > 15 && n_clear(&alike) == 0, "{} {}", n_clear(&any), n_clear(&alike));
        // A car of 4 m is stretched by up to a half, and not shrunk.
        let longest_m = |truth: &Object| {
            let of = &truth.box_in_ego;
            of.length_m.max(of.width_m).max(of.height_m)
        };
        assert!(any.iter().any(|truth| longest_m(truth) < 2.0));
        assert!(alike.iter().all(|truth| longest_m(truth) > 2.6));
    }

    #[test]
    fn objects_that_are_moved_away_or_shrunk_keep_the_points_that_a_lidar_would_find() {
        let of_donor = donor().objects[0].truth.box_in_ego;
        let lidar = donor().measured.ego_from_lidar.isometry.translation.vector;
        let range_m = |of: &Box3<Ego>| (of.center.coords.coords - lidar).xy().norm();
        for (moved_share, shrunk_share) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (mut n_points, mut expected, mut ratios) = (0.0, 0.0, Vec::new());
            for CutOut { truth, points, is_moved } in drawn(moved_share, shrunk_share) {
                let of = &truth.box_in_ego;
                assert_eq!(is_moved, moved_share > 0.0);
                for point in &points {
                    assert!(of.contains(&point.at, 1e-6), "{point:?}");
                }
                let (farther, smaller) = (range_m(of) / range_m(&of_donor), of.height_m / of_donor.height_m);
                assert!((1.0 - 1e-9..2.0 + 1e-9).contains(&farther), "{farther}");
                assert!((0.5 - 1e-9..1.0 + 1e-9).contains(&smaller), "{smaller}");
                let [along, across] = [of.length_m / of_donor.length_m, of.width_m / of_donor.width_m];
                assert!((along - smaller).abs() < 1e-9 && (across - smaller).abs() < 1e-9);
                assert!((of.bottom_m() - of_donor.bottom_m()).abs() < 1e-9, "it stands as it stood");
                n_points += points.len() as f64;
                expected += 600.0 * smaller / farther;
                ratios.push([farther, smaller]);
            }
            // 30,000 points are kept or not, so that the share is off by less than a hundredth.
            assert!((n_points / expected - 1.0).abs() < 0.02, "{n_points} of {expected}");
            for (i, share) in [moved_share, shrunk_share].into_iter().enumerate() {
                let n_changed = ratios.iter().filter(|of| (of[i] - 1.0).abs() > 1e-6).count();
                assert_eq!(n_changed, if share > 0.0 { 50 } else { 0 });
            }
        }
    }
}
