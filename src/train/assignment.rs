//! The match of queries and objects: Hungarian matching on the costs of TransFusion (Bai et al. 2022).
//!
//! Cost of a query and an object: class (focal, alpha 0.25, gamma 2) + L1 distance of the centres in bird's-eye
//! view, each axis over the map's length, - IoU of the boxes in 3D; each with its weight from the config.

use super::config::LossConfig;
use super::targets::class_of;
use crate::geometry::{Box3, Ego, convex_overlap_area};
use crate::model::coder::{CODE_SIZE, decode};
use crate::model::{ModelConfig, Query};
use crate::object::LabelledObject;

/// More than all that else costs.
const TOO_FAR_COST: f64 = 1e6;

/// Pairs `(query, object)` of one sample: each object gets one query, as long as there are queries left in its reach.
///
/// `codes` is `[query, CODE_SIZE]`, `logits` `[query, class]`.
#[must_use]
pub fn assign(
    queries: &[Query],
    codes: &[f32],
    logits: &[f32],
    objects: &[LabelledObject],
    model: &ModelConfig,
    loss: &LossConfig,
) -> Vec<(usize, usize)> {
    if objects.is_empty() {
        return Vec::new();
    }
    let costs = costs(queries, codes, logits, objects, model, loss);
    let (rows, columns) = lsap::solve(queries.len(), objects.len(), &costs, false)
        .expect("costs are finite: the loss before them was checked");
    let is_near = |&(q, object): &(usize, usize)| {
        is_in_reach(&queries[q], &objects[object].truth.box_in_ego, loss.match_reach_m)
    };
    rows.into_iter().zip(columns).filter(is_near).collect()
}

/// Whether a query sits near enough to an object to stand for it.
fn is_in_reach(query: &Query, truth: &Box3<Ego>, reach_m: f64) -> bool {
    let [x_m, y_m] = query.center_m;
    let distance_m = (x_m - truth.center.x()).hypot(y_m - truth.center.y());
    distance_m <= reach_m.max(truth.length_m.hypot(truth.width_m) / 2.0 + reach_m / 2.0)
}

/// The costs, `[query, object]`.
fn costs(
    queries: &[Query],
    codes: &[f32],
    logits: &[f32],
    objects: &[LabelledObject],
    model: &ModelConfig,
    loss: &LossConfig,
) -> Vec<f64> {
    let (grid, classes) = (&model.grid, model.head.classes);
    let (length_m, width_m) = (grid.x_max_m - grid.x_min_m, grid.y_max_m - grid.y_min_m);
    let mut costs = Vec::with_capacity(queries.len() * objects.len());
    for (q, query) in queries.iter().enumerate() {
        let (guess, _) = decode(&codes[q * CODE_SIZE..(q + 1) * CODE_SIZE], query.center_m, grid.cell_size_m);
        for object in objects {
            let truth = &object.truth.box_in_ego;
            let center = (guess.center.x() - truth.center.x()).abs() / length_m
                + (guess.center.y() - truth.center.y()).abs() / width_m;
            let harm = focal_cost(f64::from(logits[classes.n() * q + class_of(object, classes)]));
            let near =
                loss.harm_cost * harm + loss.center_cost * center - loss.iou_cost * iou_3d(&guess, truth);
            let is_near = is_in_reach(query, truth, loss.match_reach_m);
            costs.push(if is_near { near } else { near + TOO_FAR_COST });
        }
    }
    costs
}

/// Cost of a query's class score: the focal loss (alpha 0.25, gamma 2) of the right answer less that of the wrong one.
fn focal_cost(logit: f64) -> f64 {
    let p = 1.0 / (1.0 + (-logit).exp());
    let right = -(p + 1e-12).ln() * 0.25 * (1.0 - p).powi(2);
    let wrong = -(1.0 - p + 1e-12).ln() * 0.75 * p.powi(2);
    right - wrong
}

/// Intersection over union of two upright boxes.
fn iou_3d(a: &Box3<Ego>, b: &Box3<Ego>) -> f64 {
    let reach = f64::midpoint(a.length_m.hypot(a.width_m), b.length_m.hypot(b.width_m));
    let offset = a.center.coords - b.center.coords;
    if offset.x.hypot(offset.y) > reach {
        return 0.0;
    }
    let (top, bottom) = (a.top_m().min(b.top_m()), a.bottom_m().max(b.bottom_m()));
    let shared = convex_overlap_area(&a.footprint(), &b.footprint()) * (top - bottom).max(0.0);
    let volume = |c: &Box3<Ego>| c.length_m * c.width_m * c.height_m;
    shared / (volume(a) + volume(b) - shared)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;
    use crate::model::coder::encode;
    use crate::model::golden::Golden;
    use crate::object::Harm;
    use crate::train::targets::car;

    #[test]
    fn each_object_goes_to_the_query_that_already_sits_on_it() {
        let model = ModelConfig::default();
        let objects = [car(10.0, 0.0, Harm::Harmful), car(30.0, 5.0, Harm::Harmless)];
        let centers = [[30.0, 5.0], [20.0, 0.0], [10.0, 0.0]];
        let queries = centers.map(|center_m| Query { channel: 0, cell: 0, place: 0, score: 0.5, center_m });
        let codes: Vec<f32> = centers
            .iter()
            .flat_map(|&center| {
                let mut at = objects[0].truth.box_in_ego;
                at.center = Point::new(center[0], center[1], 0.75);
                encode(&at, [0.0; 2], center, model.grid.cell_size_m)
            })
            .collect();
        let mut pairs = assign(&queries, &codes, &[0.0; 6], &objects, &model, &LossConfig::default());
        pairs.sort_unstable();
        assert_eq!(pairs, [(0, 1), (2, 0)]);
    }

    #[test]
    fn no_query_stands_for_what_is_far_away_however_sure_it_is() {
        let model = ModelConfig::default();
        let objects = [car(10.0, 0.0, Harm::Harmful)];
        let codes = [0.0; 2 * CODE_SIZE];
        let pairs = |queries: [[f64; 2]; 2], logits: [f32; 4]| {
            assign(&queries.map(query), &codes, &logits, &objects, &model, &LossConfig::default())
        };
        let sure = [-3.0, -3.0, 6.0, 6.0];
        assert_eq!(pairs([[10.0, 1.0], [16.0, 1.0]], sure), [(0, 0)]);
        assert_eq!(pairs([[10.0, 20.0], [16.0, 1.0]], sure), []);
    }

    #[test]
    fn equal_boxes_have_an_iou_of_one_and_half_shifted_ones_a_third() {
        let a = car(10.0, 0.0, Harm::Harmful).truth.box_in_ego;
        let b = car(12.0, 0.0, Harm::Harmful).truth.box_in_ego;
        assert!((iou_3d(&a, &a) - 1.0).abs() < 1e-12);
        assert!((iou_3d(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
    }

    fn query(center_m: [f64; 2]) -> Query {
        Query { channel: 0, cell: 0, place: 0, score: 0.5, center_m }
    }

    #[test]
    fn costs_and_pairs_equal_scipys() {
        let golden = Golden::read("assignment");
        // scipy's pairs are of any distance.
        let (model, loss) =
            (ModelConfig::default(), LossConfig { match_reach_m: 1e6, ..LossConfig::default() });
        for case in ["more_queries", "more_objects", "as_many", "one", "ties"] {
            let numbers = |part: &str| golden.numbers(&format!("{case}.{part}"));
            let singles = |part: &str| numbers(part).iter().map(|&x| x as f32).collect::<Vec<_>>();
            let queries: Vec<Query> = numbers("queries_m").chunks(2).map(|m| query([m[0], m[1]])).collect();
            let objects: Vec<LabelledObject> = numbers("truths")
                .chunks(7)
                .zip(numbers("harm"))
                .map(|(numbers, harm)| {
                    let mut object = car(numbers[0], numbers[1], Harm::ALL[harm as usize]);
                    object.truth.box_in_ego = Box3 {
                        center: Point::new(numbers[0], numbers[1], numbers[2]),
                        length_m: numbers[3],
                        width_m: numbers[4],
                        height_m: numbers[5],
                        yaw_rad: numbers[6],
                    };
                    object
                })
                .collect();
            let (codes, logits) = (singles("codes"), singles("logits"));
            let found = costs(&queries, &codes, &logits, &objects, &model, &loss);
            let expected = numbers("costs");
            let largest = expected.iter().fold(0f64, |largest, cost| largest.max(cost.abs()));
            // The guess passes through an f32 code.
            let off = found.iter().zip(&expected).fold(0f64, |off, (a, b)| off.max((a - b).abs()));
            assert!(off < 1e-5 * largest, "{case}: costs off by {off} of {largest}");

            let mut pairs = assign(&queries, &codes, &logits, &objects, &model, &loss);
            pairs.sort_unstable();
            let scipys: Vec<(usize, usize)> =
                numbers("pairs").chunks(2).map(|pair| (pair[0] as usize, pair[1] as usize)).collect();
            assert_eq!(pairs.len(), queries.len().min(objects.len()), "{case}");
            let total = |pairs: &[(usize, usize)]| -> f64 {
                pairs.iter().map(|&(q, object)| expected[q * objects.len() + object]).sum()
            };
            assert!((total(&pairs) - total(&scipys)).abs() < 1e-6, "{case}: the cheapest pairs");
            // Two objects of one class, both ahead of two guesses, cost the same either way: `as_many` has such.
            if !["as_many", "ties"].contains(&case) {
                assert_eq!(pairs, scipys, "{case}");
            }
        }
    }
}
