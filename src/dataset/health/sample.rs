//! What is odd about one sample: its cloud, its picture, its camera, its boxes.

use super::check::{Aspect, Remark};
use crate::geometry::{Ego, Lidar, Point, Transform};
use crate::sample::{LidarPoint, Measured, Sample};

/// Points on the road lie in this ring around the ego, metres.
const ROAD_FROM_M: f64 = 3.0;
const ROAD_TO_M: f64 = 20.0;
/// A road that lies farther from the ego's zero height than this was mounted wrongly, metres.
const MAX_GROUND_M: f64 = 0.5;
/// The share of the points that lie lower than the road: reflections and slopes.
const BELOW_ROAD: f64 = 0.02;
/// Objects nearer than this should hold points, metres.
const NEAR_M: f64 = 25.0;
/// Fewer near objects than this say nothing.
const MIN_NEAR_OBJECTS: usize = 3;
/// Boxes of logs are drawn by hand: points beside them belong to them, metres.
const BOX_MARGIN_M: f64 = 0.1;

/// Everything odd about a sample; `points` are those of its top LiDAR.
pub(super) fn examine(sample: &Sample, points: &[Point<Ego>]) -> Vec<Remark> {
    let measured = &sample.measured;
    [
        examine_cloud(measured, points),
        examine_intensity(&measured.points),
        examine_picture(measured),
        examine_boxes(sample, points),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The finite points of a cloud in the ego frame.
pub(super) fn in_ego(ego_from_lidar: &Transform<Ego, Lidar>, points: &[LidarPoint]) -> Vec<Point<Ego>> {
    let is_finite =
        |point: &&LidarPoint| point.x_m.is_finite() && point.y_m.is_finite() && point.z_m.is_finite();
    let at = |point: &LidarPoint| {
        *ego_from_lidar * Point::new(point.x_m.into(), point.y_m.into(), point.z_m.into())
    };
    points.iter().filter(is_finite).map(at).collect()
}

fn examine_cloud(measured: &Measured, finite: &[Point<Ego>]) -> Option<Remark> {
    let n_points = measured.points.len();
    if n_points == 0 {
        let text = "the cloud is empty; points are needed to find objects";
        return Some(Remark::warning(Aspect::Clouds, "empty cloud", text));
    }
    let n_broken = n_points - finite.len();
    (n_broken > 0).then(|| {
        let text = format!(
            "{n_broken} of {n_points} points are not finite and are left out; finite ones are needed"
        );
        Remark::warning(Aspect::Clouds, "points", text)
    })
}

fn examine_intensity(points: &[LidarPoint]) -> Option<Remark> {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for point in points {
        if !point.intensity.is_finite() {
            let text = format!("an intensity is {}; numbers from 0 to 255 are needed", point.intensity);
            return Some(Remark::warning(Aspect::Clouds, "intensity", text));
        }
        (low, high) = (low.min(point.intensity), high.max(point.intensity));
    }
    let is_outside = points.len() > 1 && (low < 0.0 || high > 255.0);
    is_outside.then(|| {
        let text = format!("intensities are from {low} to {high}; 0 to 255 is needed");
        Remark::warning(Aspect::Clouds, "intensity", text)
    })
}

/// Whether the road is where the ego's zero height is, over the samples of an episode. A slope lifts single samples.
#[derive(Default)]
pub(super) struct Ground {
    /// Of the road in each sample that shows enough of it.
    heights_m: Vec<f64>,
}

impl Ground {
    /// Takes a sample's points. The lowest ones near the ego are the road's.
    pub(super) fn add(&mut self, points: &[Point<Ego>]) {
        let is_near = |point: &&Point<Ego>| (ROAD_FROM_M..ROAD_TO_M).contains(&point.x().hypot(point.y()));
        let mut near_m: Vec<f64> = points.iter().filter(is_near).map(Point::z).collect();
        if near_m.len() < 100 {
            return;
        }
        near_m.sort_unstable_by(f64::total_cmp);
        self.heights_m.push(near_m[(near_m.len() as f64 * BELOW_ROAD) as usize]);
    }

    /// What the median of the samples says.
    pub(super) fn judge(mut self) -> Option<Remark> {
        self.heights_m.sort_unstable_by(f64::total_cmp);
        let n_samples = self.heights_m.len();
        let road_m = *self.heights_m.get(n_samples / 2)?;
        (road_m.abs() > MAX_GROUND_M).then(|| {
            let text = format!(
                "the lowest points within {ROAD_TO_M:.0} m lie at z = {road_m:.2} m in the ego frame, in the median of \
                 {n_samples} samples; the road should lie near 0: the LiDAR's mounting height or axes may be wrong, or metres \
                 are not the unit"
            );
            Remark::warning(Aspect::Clouds, "ground", text)
        })
    }
}

fn examine_picture(measured: &Measured) -> Option<Remark> {
    let image = match measured.image.decode() {
        Ok(image) => image,
        Err(error) => {
            let text = format!("the picture cannot be unpacked ({error}); a whole JPEG or PNG is needed");
            return Some(Remark::fault(Aspect::Pictures, "picture", text));
        }
    };
    let first = image.pixels().next();
    image.pixels().all(|pixel| Some(pixel) == first).then(|| {
        let text = "the picture has one colour, so the network sees with the LiDAR alone; a camera's picture is needed";
        Remark::warning(Aspect::Pictures, "plain picture", text)
    })
}

/// Whether boxes that should hold points do.
fn examine_boxes(sample: &Sample, points: &[Point<Ego>]) -> Option<Remark> {
    let near: Vec<_> = sample
        .objects()
        .iter()
        .map(|object| &object.box_in_ego)
        .filter(|of| of.center.x().hypot(of.center.y()) < NEAR_M)
        .collect();
    let is_empty =
        |of: &&&crate::geometry::Box3<Ego>| !points.iter().any(|point| of.contains(point, BOX_MARGIN_M));
    let n_empty = near.iter().filter(is_empty).count();
    (near.len() >= MIN_NEAR_OBJECTS && 2 * n_empty > near.len()).then(|| {
        let text = format!(
            "{n_empty} of {} boxes within {NEAR_M:.0} m hold no point; most should: the cloud's axes, unit or \
             mounting, or the boxes' frame may be wrong",
            near.len()
        );
        Remark::warning(Aspect::Points, "boxes without points", text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::sample::Truth;

    /// A flat road around the car, and boxes that hold points.
    fn street() -> Sample {
        let labelled = test_data::dataset(1).samples()[0].clone();
        let objects: Vec<_> = labelled.objects.iter().map(|object| object.truth.clone()).collect();
        let mut measured = labelled.measured.clone();
        let lidar_from_ego = measured.ego_from_lidar.inverse();
        let road =
            (0..40).flat_map(|i| (-10..10).map(move |j| [f64::from(i) * 0.5 + 3.0, f64::from(j) * 0.5, 0.0]));
        let inside = objects.iter().map(|object| {
            let center = object.box_in_ego.center;
            [center.x(), center.y(), center.z()]
        });
        let point = |[x, y, z]: [f64; 3]| {
            let at = lidar_from_ego * Point::<Ego>::new(x, y, z);
            let (x_m, y_m, z_m) = (at.x() as f32, at.y() as f32, at.z() as f32);
            LidarPoint { x_m, y_m, z_m, intensity: 20.0, ring: 0 }
        };
        measured.points = road.chain(inside).map(point).collect();
        Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) }
    }

    fn checks(change: impl Fn(&mut Sample)) -> Vec<&'static str> {
        let mut sample = street();
        change(&mut sample);
        let points = in_ego(&sample.measured.ego_from_lidar, &sample.measured.points);
        examine(&sample, &points).iter().map(|remark| remark.kind).collect()
    }

    fn checks_of_points(change: impl Fn(&mut LidarPoint)) -> Vec<&'static str> {
        checks(|sample| sample.measured.points.iter_mut().for_each(&change))
    }

    #[test]
    fn a_road_beside_the_egos_zero_height_is_told_where_most_samples_show_it() {
        let road: Vec<Point<Ego>> = in_ego(&street().measured.ego_from_lidar, &street().measured.points);
        let judge = |lifts_m: &[f64]| {
            let mut ground = Ground::default();
            for lift_m in lifts_m {
                let lifted = road.iter().map(|point| Point::new(point.x(), point.y(), point.z() + lift_m));
                ground.add(&lifted.collect::<Vec<_>>());
            }
            ground.judge().map(|remark| (remark.kind, remark.text))
        };
        assert_eq!((judge(&[]), judge(&[0.0, 0.1, 0.9, -0.8, 0.0])), (None, None), "a slope here and there");
        let (kind, text) = judge(&[-1.0, -1.1, -1.0, 0.0]).unwrap();
        assert!(kind == "ground" && text.contains("z = -1.00 m") && text.contains("4 samples"), "{text}");
    }

    #[test]
    fn what_is_odd_about_a_sample_is_told_and_nothing_else() {
        let usual = checks(|_| ());
        let odd = |found: Vec<&'static str>| -> Vec<&'static str> {
            found.into_iter().filter(|check| !usual.contains(check)).collect()
        };
        assert_eq!(odd(checks_of_points(|point| point.intensity = 300.0)), ["intensity"]);
        assert_eq!(odd(checks_of_points(|point| point.intensity = f32::NAN)), ["intensity"]);
        assert_eq!(odd(checks(|sample| sample.measured.points.clear())), ["empty cloud"]);
        assert_eq!(odd(checks(|sample| sample.measured.points[0].x_m = f32::NAN)), ["points"]);
        assert_eq!(odd(checks(|sample| sample.measured.image.bytes.truncate(20))), ["picture"]);
    }
}
