//! The annotated objects of an episode: their ids, their boxes, and the LiDAR points that they are said to have.
//!
//! Boxes are in the ego frame, metres. Simulated points are counted by the object that a beam hit, which range noise moves by
//! centimetres; of a log the points in the box are counted.

use std::collections::BTreeMap;

use super::check::{Aspect, Remark};
use crate::episode::manifest::ObjectCounts;
use crate::geometry::{Box3, Ego, Point};
use crate::object::{Event, Kind, Object};

/// Nothing on or beside a road is longer than this, nor shorter than that.
const MAX_SIZE_M: f64 = 60.0;
const MIN_SIZE_M: f64 = 0.005;
/// No sensor for cars sees farther.
const MAX_RANGE_M: f64 = 1_000.0;
/// 360 km/h.
const MAX_SPEED_MPS: f64 = 100.0;
/// Rounding of a centre that lies at the annotation's range.
const RANGE_ROUNDING_M: f64 = 0.01;

/// An object's points lie in its box or this near to it: range noise, and what walks moves its limbs.
pub(super) const MARGIN_M: f64 = 0.3;
/// Of an object's points this share must be in its box, less [`FEW_POINTS`].
const MIN_INSIDE: f64 = 0.8;
const FEW_POINTS: f64 = 2.0;
/// Points deeper than this in a vehicle's box are the vehicle's; so many of them say something.
const DEPTH_M: f64 = 0.1;
const MANY_POINTS: usize = 30;
/// So many times the stated points are too many.
const MAX_TIMES: f64 = 3.0;
/// A box's sides are measured along the ego's axes, and a tilt stretches them: on hills by up to 1.6 times.
const MAX_STRETCH: f64 = 3.0;

/// The objects of an episode.
pub(super) struct Objects {
    is_log: bool,
    /// Farthest that the config annotates.
    max_range_m: Option<f64>,
    /// How far an object's points may lie outside its box.
    margin_m: f64,
    pub counts: ObjectCounts,
    pub n_boxes: u64,
    pub n_counted: u64,
    pub farthest_m: f64,
    pub fastest_mps: f64,
    by_id: BTreeMap<String, Identity>,
}

/// What an id stands for.
struct Identity {
    kind: Option<Kind>,
    category: Option<String>,
    least_m: [f64; 3],
    most_m: [f64; 3],
}

impl Objects {
    pub(super) fn new(is_log: bool, max_range_m: Option<f64>, margin_m: f64) -> Self {
        Self {
            is_log,
            max_range_m,
            margin_m,
            counts: ObjectCounts::default(),
            n_boxes: 0,
            n_counted: 0,
            farthest_m: 0.0,
            fastest_mps: 0.0,
            by_id: BTreeMap::new(),
        }
    }

    pub(super) fn n_ids(&self) -> u64 {
        self.by_id.len() as u64
    }

    /// Adds a sample's objects; `points` are those of all LiDARs.
    pub(super) fn add(&mut self, objects: &[Object], points: &[Point<Ego>]) -> Vec<Remark> {
        let mut remarks: Vec<Remark> = twice(objects).into_iter().collect();
        for object in objects {
            self.n_boxes += 1;
            if let Some(count) = self.counts.of_mut(object) {
                *count += 1;
            }
            let found = [
                self.examine_identity(object),
                self.examine_box(object),
                self.examine_points(object, points),
            ];
            remarks.extend(found.into_iter().flatten());
        }
        remarks
    }

    fn examine_identity(&mut self, object: &Object) -> Option<Remark> {
        let of = &object.box_in_ego;
        let size_m = [of.length_m, of.width_m, of.height_m];
        let id = object.id.clone()?;
        let told = name(object);
        let Some(known) = self.by_id.get_mut(&id) else {
            let (kind, category) = (object.kind, object.category.clone());
            self.by_id.insert(id, Identity { kind, category, least_m: size_m, most_m: size_m });
            return None;
        };
        let is_other = known.kind != object.kind || !self.is_log && known.category != object.category;
        if is_other {
            let (was, is) = (
                words(known.kind, known.category.as_deref()),
                words(object.kind, object.category.as_deref()),
            );
            let text =
                format!("{told} is {is} here and {was} in a sample before; an id stands for one object");
            return Some(Remark::unless(self.is_log, Aspect::Ids, "kind", text));
        }
        for (axis, size_m) in size_m.into_iter().enumerate() {
            known.least_m[axis] = known.least_m[axis].min(size_m);
            known.most_m[axis] = known.most_m[axis].max(size_m);
        }
        // What falls, rolls or lies tipped over has other sides each time.
        let is_upright = matches!(object.event, Some(Event::None) | None) && object.is_tipped != Some(true);
        let stretch = (0..3).map(|axis| known.most_m[axis] / known.least_m[axis]).fold(1.0, f64::max);
        (!self.is_log && is_upright && stretch > MAX_STRETCH).then(|| {
            let text = format!("{told} has a side that changes {stretch:.1}-fold; an object keeps its size");
            Remark::fault(Aspect::Ids, "size", text)
        })
    }

    fn examine_box(&mut self, object: &Object) -> Option<Remark> {
        let of = &object.box_in_ego;
        let told = name(object);
        let fault = |kind, text| Some(Remark::fault(Aspect::Boxes, kind, text));
        let range_m = of.center.x().hypot(of.center.y());
        self.farthest_m = self.farthest_m.max(range_m);
        let [vx_mps, vy_mps] = object.velocity_in_ego_mps;
        let speed_mps = vx_mps.hypot(vy_mps);
        // `max` leaves out the NaN of an unknown velocity.
        self.fastest_mps = self.fastest_mps.max(speed_mps);
        let sizes_m = [of.length_m, of.width_m, of.height_m];
        if let Some(size_m) = sizes_m.into_iter().find(|size_m| !(MIN_SIZE_M..=MAX_SIZE_M).contains(size_m)) {
            return fault(
                "size",
                format!("{told} has a side of {size_m} m; from {MIN_SIZE_M} to {MAX_SIZE_M} m can be"),
            );
        }
        if range_m.max(of.center.z().abs()) > MAX_RANGE_M {
            return fault(
                "range",
                format!("{told} is {range_m:.0} m away; at most {MAX_RANGE_M} m can be annotated"),
            );
        }
        if let Some(max_m) = self.max_range_m.filter(|max_m| range_m > max_m + RANGE_ROUNDING_M) {
            let text = format!("{told} is {range_m:.1} m away; the config annotates up to {max_m} m");
            return fault("annotated range", text);
        }
        if speed_mps > MAX_SPEED_MPS {
            return fault(
                "speed",
                format!("{told} moves at {speed_mps:.0} m/s; at most {MAX_SPEED_MPS} m/s can be"),
            );
        }
        let share = object.visible_fraction.filter(|share| !(0.0..=1.0).contains(share))?;
        fault("visible fraction", format!("{told} is visible to {share}; a share from 0 to 1 is needed"))
    }

    fn examine_points(&mut self, object: &Object, points: &[Point<Ego>]) -> Option<Remark> {
        let n_told = object.n_lidar_points?;
        self.n_counted += 1;
        let of = &object.box_in_ego;
        let near = near(of, points, self.margin_m);
        let n_within = |margin_m: f64| near.iter().filter(|point| of.contains(point, margin_m)).count();
        let n_around = n_within(self.margin_m);
        if (n_around as f64) < MIN_INSIDE * f64::from(n_told) - FEW_POINTS {
            let text = format!(
                "{} is said to have {n_told} LiDAR points, and {n_around} lie within {:.1} m of its box; they should: the \
                 count, the box or the LiDAR's mounting may be wrong",
                name(object),
                self.margin_m
            );
            return Some(Remark::fault(Aspect::Points, "too few points", text));
        }
        let n_deep = n_within(-DEPTH_M);
        let is_solid = self.is_log || object.kind == Some(Kind::Vehicle);
        (is_solid && n_deep >= MANY_POINTS && n_deep as f64 > MAX_TIMES * f64::from(n_told)).then(|| {
            let text = format!(
                "{} is said to have {n_told} LiDAR points, and {n_deep} lie deep in its box; both should be about as many",
                name(object)
            );
            Remark::fault(Aspect::Points, "too many points", text)
        })
    }
}

/// The points that may lie in a box with a margin.
fn near(of: &Box3<Ego>, points: &[Point<Ego>], margin_m: f64) -> Vec<Point<Ego>> {
    let reach_m = of.length_m.hypot(of.width_m) / 2.0 + 2.0 * margin_m + 1e-6;
    let (x, y) = (of.center.x(), of.center.y());
    let is_near = |point: &&Point<Ego>| (point.x() - x).abs() <= reach_m && (point.y() - y).abs() <= reach_m;
    points.iter().filter(is_near).copied().collect()
}

fn twice(objects: &[Object]) -> Option<Remark> {
    let mut ids: Vec<&str> = objects.iter().filter_map(|object| object.id.as_deref()).collect();
    ids.sort_unstable();
    let (id, _) = ids.iter().zip(ids.iter().skip(1)).find(|(id, next)| id == next)?;
    Some(Remark::fault(
        Aspect::Ids,
        "twice",
        format!("object `{id}` is there twice; each object needs its own id"),
    ))
}

fn name(object: &Object) -> String {
    format!("object `{}`", object.id.as_deref().unwrap_or_default())
}

fn words(kind: Option<Kind>, category: Option<&str>) -> String {
    format!("a {} ({})", category.unwrap_or("thing"), kind.map_or("unknown", Kind::name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    /// The kinds of what is found in one sample, and then in a second with one thing changed.
    fn kinds(is_log: bool, change: impl Fn(&mut Vec<Object>)) -> Vec<&'static str> {
        let sample = test_data::dataset(1).samples()[0].clone();
        let mut objects: Vec<Object> = sample.objects.iter().map(|object| object.truth.clone()).collect();
        let points: Vec<Point<Ego>> =
            objects.iter().flat_map(|object| std::iter::repeat_n(object.box_in_ego.center, 60)).collect();
        let mut all = Objects::new(is_log, Some(60.0), MARGIN_M);
        assert_eq!(all.add(&objects, &points), []);
        change(&mut objects);
        all.add(&objects, &points).iter().map(|remark| remark.kind).collect()
    }

    #[test]
    fn what_an_object_cannot_be_is_named() {
        assert_eq!(kinds(false, |_| ()), [""; 0]);
        let same_id = |of: &mut Vec<Object>| {
            let id = of[0].id.clone();
            of[1].id = id;
        };
        assert_eq!(kinds(false, same_id), ["twice"]);
        assert_eq!(kinds(false, |of| of[0].category = Some("bus".into())), ["kind"]);
        assert_eq!(kinds(true, |of| of[0].category = Some("bus".into())), [""; 0]);
        assert_eq!(kinds(false, |of| of[0].box_in_ego.height_m = 5.0), ["size"]);
        assert_eq!(kinds(true, |of| of[0].box_in_ego.height_m = 80.0), ["size"]);
        assert_eq!(kinds(false, |of| of[0].velocity_in_ego_mps = [150.0, 0.0]), ["speed"]);
        assert_eq!(kinds(false, |of| of[0].velocity_in_ego_mps = [f64::NAN; 2]), [""; 0]);
        assert_eq!(kinds(false, |of| of[0].visible_fraction = Some(1.5)), ["visible fraction"]);
        assert_eq!(kinds(false, |of| of[0].n_lidar_points = Some(600)), ["too few points"]);
        assert_eq!(kinds(false, |of| of[0].n_lidar_points = Some(1)), ["too many points"]);
    }

    #[test]
    fn a_box_beside_its_points_and_one_out_of_the_annotated_range_are_named() {
        assert_eq!(
            kinds(false, |of| of[0].box_in_ego.center = Point::new(0.0, 40.0, 0.75)),
            ["too few points"]
        );
        let far = kinds(false, |of| {
            of[0].box_in_ego.center = Point::new(65.0, 0.0, 0.75);
            of[0].n_lidar_points = Some(0);
        });
        assert_eq!(far, ["annotated range"]);
    }
}
