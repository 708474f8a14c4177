//! What a merged file tells in numbers: a row of figures for plots, and the objects for a table.

use super::Drawn;
use crate::episode::messages::{own_time, wire};
use crate::object::{Distribution, Harm};

/// The figures of a sample.
pub(super) fn numbers(drawn: &Drawn<'_>) -> wire::ViewNumbers {
    let (sample, ego) = (drawn.sample, drawn.sample.true_state());
    let count = |n: usize| u32::try_from(n).expect("a sample has few objects");
    let farthest_x_m =
        drawn.zone().and_then(|corners| corners.iter().map(|corner| corner.x_m).reduce(f64::max));
    let scores = drawn.detections.as_ref().map(|found| {
        let harmful = found.iter().filter(|detection| detection.harm == Harm::Harmful);
        harmful.map(|detection| detection.score).fold(0.0, f64::max)
    });
    let is_harmful = |harm: &&Harm| **harm == Harm::Harmful;
    wire::ViewNumbers {
        timestamp: Some(own_time(sample.measured.time_ns)),
        speed_mps: ego.speed_mps,
        steering_deg: ego.steering_angle_rad.to_degrees(),
        acceleration_mps2: ego.acceleration_mps2,
        zone_depth_m: farthest_x_m.map(|x_m| (x_m - ego.front_bumper_x_m).max(0.0)),
        n_objects: drawn.has_truth.then(|| count(sample.objects().len())),
        n_out_of_distribution: drawn
            .has_truth
            .then(|| count(sample.objects().iter().filter(|object| object.is_ood()).count())),
        n_harmful: drawn.harms.as_ref().map(|harms| count(harms.iter().filter(is_harmful).count())),
        n_predicted: drawn.detections.as_ref().map(|found| count(found.len())),
        n_predicted_harmful: drawn
            .detections
            .as_ref()
            .map(|found| count(found.iter().filter(|detection| detection.harm == Harm::Harmful).count())),
        highest_harmful_score: scores,
    }
}

/// The objects of a sample, harmful ones first, then by distance.
pub(super) fn objects(drawn: &Drawn<'_>) -> wire::ViewObjects {
    let mut rows: Vec<wire::ViewObject> = drawn
        .sample
        .objects()
        .iter()
        .enumerate()
        .map(|(i, object)| {
            let center = object.box_in_ego.center;
            let [vx, vy] = object.velocity_in_ego_mps;
            wire::ViewObject {
                id: object.id.clone().unwrap_or_default(),
                category: object.category.clone().unwrap_or_default(),
                harm: drawn.harm(i).map_or("", Harm::name).to_owned(),
                distribution: object.distribution.map_or("", Distribution::name).to_owned(),
                distance_m: center.x().hypot(center.y()),
                x_m: center.x(),
                y_m: center.y(),
                speed_mps: vx.hypot(vy),
                overlap_ratio: drawn.labels.map(|labels| labels.labels[i].overlap_ratio),
                n_lidar_points: object.n_lidar_points.unwrap_or_default(),
                visible_fraction: object.visible_fraction,
            }
        })
        .collect();
    let is_harmless = |row: &wire::ViewObject| row.harm != Harm::Harmful.name();
    rows.sort_by(|a, b| is_harmless(a).cmp(&is_harmless(b)).then(a.distance_m.total_cmp(&b.distance_m)));
    wire::ViewObjects { timestamp: Some(own_time(drawn.sample.measured.time_ns)), objects: rows }
}
