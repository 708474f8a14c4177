//! Training targets: the heatmap to draw, and which query answers for which object.
//!
//! Heatmap: a Gaussian at each object's cell, its radius from CornerNet's overlap rule (Law and Deng
//! 2018) at overlap 0.1, at least two cells. Assignment: Hungarian matching on focal, centre and IoU
//! costs (TransFusion).

use super::config::LossConfig;
use crate::geometry::{Box3, Ego, convex_overlap_area};
use crate::model::coder::{CODE_SIZE, decode};
use crate::model::{GridConfig, Heatmap, ModelConfig, Query};
use crate::object::{Harm, LabelledObject};

/// Smallest Gaussian radius, cells.
const MIN_RADIUS: usize = 2;
/// Overlap of two boxes whose corners lie within the radius.
const GAUSSIAN_OVERLAP: f64 = 0.1;
/// Scale of centre costs, metres: the reach of the map.
const CENTER_SCALE_M: f64 = 50.0;

/// Objects a detector can be asked for: inside the grid and hit by a LiDAR point, as the evaluation counts.
#[must_use]
pub fn trainable(objects: &[LabelledObject], grid: &GridConfig) -> Vec<LabelledObject> {
    objects
        .iter()
        .filter(|object| {
            let center = object.truth.box_in_ego.center;
            object.truth.n_lidar_points > 0
                && (grid.x_min_m..grid.x_max_m).contains(&center.x())
                && (grid.y_min_m..grid.y_max_m).contains(&center.y())
        })
        .cloned()
        .collect()
}

/// Draws the target heatmap `[heatmap_channel, cell_y, cell_x]` of one sample.
#[must_use]
pub fn draw_heatmap(objects: &[LabelledObject], config: &ModelConfig) -> Vec<f32> {
    let grid = &config.grid;
    let (n_x, n_y) = (grid.n_cells_x(), grid.n_cells_y());
    let mut map = vec![0f32; config.heatmap.n_channels() * n_y * n_x];
    for object in objects {
        let truth = &object.truth.box_in_ego;
        let channel = match config.heatmap {
            Heatmap::Agnostic => 0,
            Heatmap::PerClass => object.harm.index(),
        };
        let x = ((truth.center.x() - grid.x_min_m) / grid.cell_size_m()) as usize;
        let y = ((truth.center.y() - grid.y_min_m) / grid.cell_size_m()) as usize;
        let radius = gaussian_radius(truth.length_m / grid.cell_size_m(), truth.width_m / grid.cell_size_m());
        let sigma = (2 * radius + 1) as f64 / 6.0;
        for cell_y in y.saturating_sub(radius)..(y + radius + 1).min(n_y) {
            for cell_x in x.saturating_sub(radius)..(x + radius + 1).min(n_x) {
                let distance2 = (cell_x.abs_diff(x).pow(2) + cell_y.abs_diff(y).pow(2)) as f64;
                let value = (-distance2 / (2.0 * sigma * sigma)).exp() as f32;
                let cell = &mut map[(channel * n_y + cell_y) * n_x + cell_x];
                *cell = cell.max(value);
            }
        }
    }
    map
}

/// CornerNet's radius for a box of `length` by `width` cells, as CenterPoint and TransFusion use it.
fn gaussian_radius(length: f64, width: f64) -> usize {
    let overlap = GAUSSIAN_OVERLAP;
    let (sum, area) = (length + width, length * width);
    let root = |a: f64, b: f64, c: f64| f64::midpoint(b, (b * b - 4.0 * a * c).max(0.0).sqrt());
    let r1 = root(1.0, sum, area * (1.0 - overlap) / (1.0 + overlap));
    let r2 = root(4.0, 2.0 * sum, (1.0 - overlap) * area);
    let r3 = root(4.0 * overlap, -2.0 * overlap * sum, (overlap - 1.0) * area);
    (r1.min(r2).min(r3) as usize).max(MIN_RADIUS)
}

/// Pairs `(query, object)` of one sample, each object with one query as long as queries last.
///
/// `codes` is `[query, CODE_SIZE]`, `harm_logits` `[query, 2]`.
#[must_use]
pub fn assign(
    queries: &[Query],
    codes: &[f32],
    harm_logits: &[f32],
    objects: &[LabelledObject],
    grid: &GridConfig,
    loss: &LossConfig,
) -> Vec<(usize, usize)> {
    if objects.is_empty() {
        return Vec::new();
    }
    let mut costs = Vec::with_capacity(queries.len() * objects.len());
    for (q, query) in queries.iter().enumerate() {
        let (guess, _) =
            decode(&codes[q * CODE_SIZE..(q + 1) * CODE_SIZE], query.center_m, grid.cell_size_m());
        for object in objects {
            let truth = &object.truth.box_in_ego;
            let center_l1 = ((guess.center.x() - truth.center.x()).abs()
                + (guess.center.y() - truth.center.y()).abs())
                / CENTER_SCALE_M;
            let harm = focal_cost(f64::from(harm_logits[2 * q + object.harm.index()]));
            costs.push(
                loss.harm_cost * harm + loss.center_cost * center_l1 - loss.iou_cost * iou_3d(&guess, truth),
            );
        }
    }
    let (rows, columns) = lsap::solve(queries.len(), objects.len(), &costs, false)
        .expect("costs are finite: the loss before them was checked");
    rows.into_iter().zip(columns).collect()
}

/// Cost of calling a query's class right rather than wrong (focal loss, alpha 0.25, gamma 2).
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
    let top = (a.center.z() + a.height_m / 2.0).min(b.center.z() + b.height_m / 2.0);
    let bottom = (a.center.z() - a.height_m / 2.0).max(b.center.z() - b.height_m / 2.0);
    let shared = convex_overlap_area(&a.footprint(), &b.footprint()) * (top - bottom).max(0.0);
    let volume = |c: &Box3<Ego>| c.length_m * c.width_m * c.height_m;
    shared / (volume(a) + volume(b) - shared)
}

/// The class target of a matched query, `[harmful, harmless]`.
#[must_use]
pub fn one_hot(harm: Harm) -> [f32; 2] {
    match harm {
        Harm::Harmful => [1.0, 0.0],
        Harm::Harmless => [0.0, 1.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;
    use crate::model::coder::encode;
    use crate::object::{Distribution, Event, Kind, ObjectTruth};

    fn car(x: f64, y: f64, harm: Harm) -> LabelledObject {
        LabelledObject {
            truth: ObjectTruth {
                id: format!("car-{x}-{y}"),
                category: "car".into(),
                kind: Kind::Vehicle,
                distribution: Distribution::Id,
                box_in_ego: Box3 {
                    center: Point::new(x, y, 0.75),
                    length_m: 4.0,
                    width_m: 1.8,
                    height_m: 1.5,
                    yaw_rad: 0.0,
                },
                velocity_in_ego_mps: [0.0; 2],
                n_lidar_points: 10,
                visible_px: 100,
                visible_fraction: 1.0,
                event: Event::None,
            },
            harm,
        }
    }

    #[test]
    fn the_heatmap_is_one_at_the_object_and_falls_off() {
        let config = ModelConfig::default();
        let map = draw_heatmap(&[car(10.1, 0.1, Harm::Harmful)], &config);
        let at = |x: usize, y: usize| map[y * 64 + x];
        assert!((at(12, 40) - 1.0).abs() < 1e-6);
        assert!(at(13, 40) < 1.0 && at(13, 40) > at(14, 40) && at(12, 50) == 0.0);
    }

    #[test]
    fn each_object_goes_to_the_query_that_already_sits_on_it() {
        let grid = GridConfig::default();
        let objects = [car(10.0, 0.0, Harm::Harmful), car(30.0, 5.0, Harm::Harmless)];
        let centers = [[30.0, 5.0], [20.0, 0.0], [10.0, 0.0]];
        let queries = centers.map(|center_m| Query { channel: 0, cell: 0, score: 0.5, center_m });
        let codes: Vec<f32> = centers
            .iter()
            .flat_map(|&center| {
                let mut at = objects[0].truth.box_in_ego;
                at.center = Point::new(center[0], center[1], 0.75);
                encode(&at, [0.0; 2], center, grid.cell_size_m())
            })
            .collect();
        let mut pairs = assign(&queries, &codes, &[0.0; 6], &objects, &grid, &LossConfig::default());
        pairs.sort_unstable();
        assert_eq!(pairs, [(0, 1), (2, 0)]);
    }

    #[test]
    fn equal_boxes_have_an_iou_of_one_and_half_shifted_ones_a_third() {
        let a = car(10.0, 0.0, Harm::Harmful).truth.box_in_ego;
        let b = car(12.0, 0.0, Harm::Harmful).truth.box_in_ego;
        assert!((iou_3d(&a, &a) - 1.0).abs() < 1e-12);
        assert!((iou_3d(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn objects_without_lidar_points_are_not_asked_for() {
        let mut unseen = car(10.0, 0.0, Harm::Harmful);
        unseen.truth.n_lidar_points = 0;
        let kept = trainable(
            &[unseen, car(70.0, 0.0, Harm::Harmless), car(20.0, 0.0, Harm::Harmless)],
            &GridConfig::default(),
        );
        assert_eq!(kept.len(), 1);
    }
}
