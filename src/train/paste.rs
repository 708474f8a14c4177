//! Objects of other samples pasted into a sample's cloud, labelled by the zone at their new place.
//!
//! Copy-paste of LiDAR objects is SECOND's (Yan et al. 2018). Here an object turns about the LiDAR and keeps its
//! distance or moves straight away, so that it shows the side that the sensor would see of it; of its points those
//! are taken that the sample's own LiDAR would have hit. It hides the points
//! behind it, and loses its own points where something hides it. It may be stretched along each axis and tipped over:
//! that gives shapes and places that the training split does not hold, as an unfamiliar object has them. The
//! picture does not show it.

use std::collections::{HashMap, HashSet};

use rand::RngExt;

use super::config::AugmentConfig;
use super::cut_out::{CutOut, Return, is_above_ground_in, returns};
use super::rings::{Ray, RingElevations};
use crate::dataset::LabelledSample;
use crate::geometry::{Ego, Lidar, Point, Transform, convex_signed_distance_m};
use crate::object::{LabelledObject, Object};
use crate::random::Rng;
use crate::sample::{LidarPoint, Measured};
use crate::zone::{Zone, ZoneError};

/// Fewest points of a pasted object that nothing hides.
const MIN_VISIBLE_POINTS: usize = 3;
/// Points this far above the ground show that a place is taken.
const TAKEN_ABOVE_GROUND_M: f64 = 0.3;
const MAX_POINTS_OF_TAKEN: usize = 2;
/// Least gap to other objects and to the front bumper.
const CLEARANCE_M: f64 = 0.3;
/// Ground height is that of the lowest points this near.
const GROUND_RADIUS_M: f64 = 2.5;
const MIN_GROUND_POINTS: usize = 5;
/// Lowest points this much above or below the object's old ground do not count as ground.
const MAX_RISE_M: f64 = 1.5;
/// An object hides another that is this much farther away.
const DEPTH_M: f64 = 0.3;
/// Donors tried for one object.
const N_TRIES: usize = 4;

/// A sample with objects of other samples in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Pasted {
    pub measured: Measured,
    pub objects: Vec<LabelledObject>,
}

/// Pastes up to `config.max_pasted` objects; `None` if none was drawn or none found a place.
///
/// # Errors
/// The sample's state or a box is not valid.
pub fn paste(
    sample: &LabelledSample,
    donors: &[LabelledSample],
    zone: &Zone,
    config: &AugmentConfig,
    rng: &mut Rng,
) -> Result<Option<Pasted>, ZoneError> {
    let n = rng.random_range(0..=config.max_pasted);
    if n == 0 {
        return Ok(None);
    }
    let area = zone.at(&sample.true_state)?;
    let mut scene = Scene::of(sample);
    for i in 0..n {
        for _ in 0..N_TRIES {
            let cut_out = CutOut::draw(donors, sample, config, rng);
            if let Some((truth, points)) = cut_out.and_then(|cut_out| scene.place(cut_out)) {
                let harm = area.harm_of_object(&truth)?.harm;
                scene.add(
                    LabelledObject { truth: Object { id: Some(format!("pasted-{i}")), ..truth }, harm },
                    points,
                );
                break;
            }
        }
    }
    Ok(scene.into_pasted(sample))
}

/// A sample that objects are pasted into.
struct Scene {
    ego_from_lidar: Transform<Ego, Lidar>,
    beams: RingElevations,
    min_x_m: f64,
    returns: Vec<Return>,
    objects: Vec<LabelledObject>,
    n_pasted: usize,
}

impl Scene {
    fn of(sample: &LabelledSample) -> Self {
        let measured = &sample.measured;
        Self {
            ego_from_lidar: measured.ego_from_lidar,
            beams: RingElevations::of(measured),
            min_x_m: measured.ego_state.front_bumper_x_m + CLEARANCE_M,
            returns: returns(measured).collect(),
            objects: sample.objects.clone(),
            n_pasted: 0,
        }
    }

    /// Height of the ground near a point of the plane.
    fn ground_m(&self, x_m: f64, y_m: f64) -> Option<f64> {
        let near = |of: &&Return| (of.at.x() - x_m).hypot(of.at.y() - y_m) < GROUND_RADIUS_M;
        let mut heights: Vec<f64> = self.returns.iter().filter(near).map(|of| of.at.z()).collect();
        if heights.len() < MIN_GROUND_POINTS {
            return None;
        }
        let tenth = heights.len() / 10;
        Some(*heights.select_nth_unstable_by(tenth, f64::total_cmp).1)
    }

    /// Puts an object on the ground; returns it with the points that stay visible, `None` if it cannot stand
    /// there or is hidden.
    fn place(&self, cut_out: CutOut) -> Option<(Object, Vec<Return>)> {
        let CutOut { mut truth, mut points, is_moved } = cut_out;
        let of = &mut truth.box_in_ego;
        let bottom_m = of.bottom_m();
        let ground_m = self.ground_m(of.center.x(), of.center.y()).or((!is_moved).then_some(bottom_m));
        let rise_m = ground_m? - bottom_m;
        if rise_m.abs() > MAX_RISE_M {
            return None;
        }
        let raised = |p: Point<Ego>| Point::new(p.x(), p.y(), p.z() + rise_m);
        of.center = raised(of.center);
        points.iter_mut().for_each(|point| point.at = raised(point.at));

        let footprint = of.footprint();
        let is_ahead = footprint.iter().all(|corner| corner.x_m > self.min_x_m);
        let gap_m = |object: &LabelledObject| {
            convex_signed_distance_m(&footprint, &object.truth.box_in_ego.footprint())
        };
        if !is_ahead || self.objects.iter().any(|object| gap_m(object) < CLEARANCE_M) {
            return None;
        }
        let taken_above_m = bottom_m + rise_m + TAKEN_ABOVE_GROUND_M;
        let takes = |other: &&Return| other.at.z() > taken_above_m && of.contains(&other.at, 0.0);
        if self.returns.iter().filter(takes).count() > MAX_POINTS_OF_TAKEN {
            return None;
        }
        let mut points = self.beams.take(points);
        let mut nearest: HashMap<Ray, f64> =
            points.iter().map(|point| (self.beams.ray(point).0, f64::INFINITY)).collect();
        for other in &self.returns {
            let (ray, distance_m) = self.beams.ray(other);
            if let Some(nearest_m) = nearest.get_mut(&ray) {
                *nearest_m = nearest_m.min(distance_m);
            }
        }
        points.retain(|point| {
            let (ray, distance_m) = self.beams.ray(point);
            nearest[&ray] > distance_m - DEPTH_M
        });
        truth.n_lidar_points = Some(points.len() as u32);
        (points.len() >= MIN_VISIBLE_POINTS).then_some((truth, points))
    }

    /// Adds an object in its place and removes the points that it hides.
    fn add(&mut self, object: LabelledObject, points: Vec<Return>) {
        let mut nearest: HashMap<Ray, f64> = HashMap::new();
        for point in &points {
            let (ray, distance_m) = self.beams.ray(point);
            let nearest_m = nearest.entry(ray).or_insert(distance_m);
            *nearest_m = nearest_m.min(distance_m);
        }
        let is_hidden = |of: &Return| {
            let (ray, distance_m) = self.beams.ray(of);
            nearest.get(&ray).is_some_and(|nearest_m| distance_m > *nearest_m)
        };
        let hidden: HashSet<usize> =
            self.returns.iter().enumerate().filter(|(_, of)| is_hidden(of)).map(|(i, _)| i).collect();
        for other in &mut self.objects {
            let of = &other.truth.box_in_ego;
            let n = hidden.iter().filter(|&&i| is_above_ground_in(of, &self.returns[i])).count();
            other.truth.n_lidar_points = other.truth.n_lidar_points.map(|of| of.saturating_sub(n as u32));
        }
        let mut i = 0;
        self.returns.retain(|_| {
            i += 1;
            !hidden.contains(&(i - 1))
        });
        self.returns.extend(points);
        self.objects.push(object);
        self.n_pasted += 1;
    }

    fn into_pasted(self, sample: &LabelledSample) -> Option<Pasted> {
        let lidar_from_ego = self.ego_from_lidar.inverse();
        let point = |of: &Return| {
            let at = lidar_from_ego * of.at;
            let [x_m, y_m, z_m] = [at.x() as f32, at.y() as f32, at.z() as f32];
            LidarPoint { x_m, y_m, z_m, intensity: of.intensity, ring: of.ring }
        };
        (self.n_pasted > 0).then(|| Pasted {
            measured: Measured {
                points: self.returns.iter().map(point).collect(),
                ..sample.measured.clone()
            },
            objects: self.objects,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::cut_out::returns_in;
    use super::*;
    use crate::dataset::test_data;
    use crate::object::Harm;
    use crate::random;
    use crate::train::targets::car;

    fn at(x: f64, y: f64, z: f64, ring: u16) -> Return {
        Return { at: Point::new(x, y, z), intensity: 100.0, ring }
    }

    /// A flat road of `rings` circles before the test data's LiDAR, without objects.
    fn road() -> LabelledSample {
        let mut sample = test_data::dataset(1).samples()[0].clone();
        sample.objects.clear();
        let ring = |ring: u16| {
            (-60..60).map(move |i| {
                let (azimuth, radius_m) = (f64::from(i) * 0.0058, 4.0 + 2.0 * f64::from(ring));
                let (x, y) = (radius_m * azimuth.cos(), radius_m * azimuth.sin());
                LidarPoint { x_m: x as f32, y_m: y as f32, z_m: -1.8, intensity: 20.0, ring }
            })
        };
        sample.measured.points = (0..12).flat_map(ring).collect();
        sample
    }

    /// A donor: the road with one car 12 m away, on whose front there are points.
    fn donor() -> LabelledSample {
        let mut sample = road();
        let mut object = car(12.0, 0.0, Harm::Harmless);
        object.truth.n_lidar_points = Some(20);
        object.truth.velocity_in_ego_mps = [-3.0, 0.0];
        let lidar_from_ego = sample.measured.ego_from_lidar.inverse();
        for i in 0..20 {
            let on_front = Point::new(10.05, -0.8 + 0.08 * f64::from(i), 0.4 + 0.3 * f64::from(i % 3));
            let p = lidar_from_ego * on_front;
            let [x_m, y_m, z_m] = [p.x() as f32, p.y() as f32, p.z() as f32];
            sample.measured.points.push(LidarPoint {
                x_m,
                y_m,
                z_m,
                intensity: 90.0,
                ring: 5 + (i % 3) as u16,
            });
        }
        sample.objects.push(object);
        sample
    }

    fn config() -> AugmentConfig {
        AugmentConfig {
            max_pasted: 1,
            max_stretch: 1.0,
            tipped_share: 0.0,
            moved_share: 0.0,
            shrunk_share: 0.0,
            ..AugmentConfig::default()
        }
    }

    fn pasted(config: &AugmentConfig) -> Vec<Pasted> {
        let (sample, donors) = (road(), [donor()]);
        let data = test_data::dataset(1);
        let one = |i| paste(&sample, &donors, data.zone(), config, &mut random::stream(3, "paste-test", i));
        (0..40).filter_map(|i| one(i).unwrap()).collect()
    }

    #[test]
    fn a_pasted_object_keeps_its_distance_and_its_points_and_is_labelled_where_it_stands() {
        let found = pasted(&config());
        assert!(found.len() > 10);
        let mut harms = HashSet::new();
        for Pasted { measured, objects } in &found {
            let of = &objects[0].truth;
            let center = of.box_in_ego.center;
            let lidar = measured.ego_from_lidar.isometry.translation.vector;
            assert!(((center.x() - lidar.x).hypot(center.y() - lidar.y) - (12.0 - lidar.x)).abs() < 1e-6);
            assert!((of.velocity_in_ego_mps[0].hypot(of.velocity_in_ego_mps[1]) - 3.0).abs() < 1e-9);
            let inside = returns_in(measured, &of.box_in_ego);
            assert_eq!(inside.len(), 20);
            assert_eq!((of.n_lidar_points, of.visible_px), (Some(20), Some(0)));
            let bottom_m = of.box_in_ego.bottom_m();
            assert!(bottom_m.abs() < 1e-3, "on the road: {bottom_m}");
            let area = test_data::dataset(1).zone().at(&measured.ego_state).unwrap();
            assert_eq!(objects[0].harm, area.harm_of_object(of).unwrap().harm);
            harms.insert(objects[0].harm.index());
            // The car's rings meet the road behind it; a car in front hides that.
            if center.y().atan2(center.x() - lidar.x).abs() < 0.2 {
                let ring = inside.iter().map(|p| p.ring).max().unwrap();
                let n_of_ring = |of: &Measured| of.points.iter().filter(|p| p.ring == ring).count();
                let n_of_car = inside.iter().filter(|p| p.ring == ring).count();
                assert!(n_of_ring(&road().measured) > n_of_ring(measured) - n_of_car);
            }
        }
        assert_eq!(harms.len(), 2, "some stand before the car and some beside its way");
    }

    #[test]
    fn no_object_is_pasted_where_another_stands_or_behind_a_wall() {
        let scene = |points: Vec<Return>, objects| Scene { returns: points, objects, ..Scene::of(&road()) };
        let cut_out = || CutOut {
            truth: car(12.0, 0.0, Harm::Harmless).truth,
            points: (0..20).map(|i| at(10.05, -0.8 + 0.08 * f64::from(i), 0.8, 4)).collect(),
            is_moved: false,
        };
        assert!(scene(Vec::new(), Vec::new()).place(cut_out()).is_some());
        let moved = CutOut { is_moved: true, ..cut_out() };
        assert!(scene(Vec::new(), Vec::new()).place(moved).is_none(), "nobody knows the ground there");
        let neighbour = car(16.1, 0.5, Harm::Harmless);
        assert!(scene(Vec::new(), vec![neighbour]).place(cut_out()).is_none());
        let of_wall = |ring| (0..400).map(move |i| at(6.0, -2.0 + 0.01 * f64::from(i), 1.2, ring));
        let wall = (0..12).flat_map(of_wall).collect();
        assert!(scene(wall, Vec::new()).place(cut_out()).is_none(), "hidden");
        let mut bush: Vec<Return> = returns(&road().measured).collect();
        assert!(scene(bush.clone(), Vec::new()).place(cut_out()).is_some());
        bush.extend((0..5).map(|i| at(12.0 + 0.1 * f64::from(i), 0.2, 0.9, 9)));
        assert!(scene(bush, Vec::new()).place(cut_out()).is_none(), "the place is taken");
        let roof = (0..9).map(|i| at(12.0 + 0.1 * f64::from(i), 0.2, 3.9, 9)).collect();
        assert!(scene(roof, Vec::new()).place(cut_out()).is_none(), "no ground is seen there");
    }

    fn returns_of(scene: &Scene, x_m: f64) -> usize {
        scene.returns.iter().filter(|of| of.at.x() == x_m && of.at.z() > 0.1).count()
    }

    #[test]
    fn what_is_hidden_is_counted_off_its_object() {
        let mut scene = Scene::of(&road());
        scene.returns = (0..20).map(|i| at(20.0, -0.8 + 0.08 * f64::from(i), 0.8, 4)).collect();
        let mut behind = car(22.0, 0.0, Harm::Harmless);
        behind.truth.n_lidar_points = Some(20);
        scene.objects.push(behind);
        // The road under it is none of its points.
        scene.returns.extend((0..8).map(|i| at(20.0 + 0.4 * f64::from(i), -0.4, 0.01, 4)));
        let front = (0..40).map(|i| at(10.05, -0.8 + 0.02 * f64::from(i), 0.8, 4)).collect();
        scene.add(car(12.0, 0.0, Harm::Harmful), front);
        let left = scene.objects[0].truth.n_lidar_points.unwrap();
        assert!(left > 0 && left < 20, "{left}");
        assert_eq!(returns_of(&scene, 20.0), left as usize);
        assert!(scene.returns.len() < left as usize + 40 + 8, "road is hidden too: {}", scene.returns.len());
    }
}
