//! Training targets: the objects that count, and the heatmap.
//!
//! A Gaussian stands at each object's cell, its radius from CornerNet's overlap rule (Law and Deng 2018)
//! at overlap 0.1, at least two cells of the heatmap.

use super::config::{LossConfig, Unhit};
use crate::geometry::{Point2, distance_to_convex_m};
use crate::model::{Classes, GridConfig, Heatmap, ModelConfig};
use crate::object::{Kind, LabelledObject};
use crate::sample::IgnoredRegion;

/// Smallest Gaussian radius, cells.
const MIN_RADIUS: usize = 2;
/// Overlap of two boxes whose corners lie within the radius.
const GAUSSIAN_OVERLAP: f64 = 0.1;

/// Top of the Gaussian of an object that is neither object nor nothing: cells under it hardly count.
const IGNORED_PEAK: f32 = 0.98;

/// Picks the objects that a detector is trained on: inside the grid and hit by a LiDAR point, as in the evaluation; and
/// unhit ones that the picture shows, if they are to be more than background.
#[must_use]
pub fn trainable(objects: &[LabelledObject], grid: &GridConfig, config: &LossConfig) -> Vec<LabelledObject> {
    objects
        .iter()
        .filter(|object| {
            let center = object.truth.box_in_ego.center;
            let is_shown = object.truth.visible_px.is_some_and(|px| px >= config.min_visible_px);
            (object.truth.is_hit() || (config.unhit != Unhit::Background && is_shown))
                && (grid.x_min_m..grid.x_max_m).contains(&center.x())
                && (grid.y_min_m..grid.y_max_m).contains(&center.y())
        })
        .cloned()
        .collect()
}

/// Whether an object is neither object nor nothing.
#[must_use]
pub fn is_ignored(object: &LabelledObject, config: &LossConfig) -> bool {
    config.unhit == Unhit::Ignored && !object.truth.is_hit()
}

/// Cells and queries on ignored ground, or this near to it, learn of no nothing: the half diagonal of a cell of the heatmap.
const GROUND_GAP_M: f64 = 0.3;

/// Convex polygons of one sample where nobody annotated.
pub type IgnoredGround = Vec<Vec<Point2>>;

/// The ignored ground, reflected where the view is. Rectangles of the picture have no place on it.
#[must_use]
pub fn ignored_ground(regions: &[IgnoredRegion], mirror: bool) -> IgnoredGround {
    let sign = if mirror { -1.0 } else { 1.0 };
    let shown = |at: &Point2| Point2 { x_m: at.x_m, y_m: sign * at.y_m };
    let polygon = |region: &IgnoredRegion| match region {
        IgnoredRegion::Ground { corners_in_ego_m } => Some(corners_in_ego_m.iter().map(shown).collect()),
        IgnoredRegion::Image { .. } => None,
    };
    regions.iter().filter_map(polygon).collect()
}

/// Whether a place lies on ignored ground or just beside it.
#[must_use]
pub fn is_on(ground: &[Vec<Point2>], [x_m, y_m]: [f64; 2]) -> bool {
    ground.iter().any(|corners| {
        // Most cells are far away; distances are dear.
        let reaches = |at_m: f64, of: fn(&Point2) -> f64| {
            corners.iter().any(|corner| of(corner) <= at_m + GROUND_GAP_M)
                && corners.iter().any(|corner| of(corner) >= at_m - GROUND_GAP_M)
        };
        reaches(x_m, |corner| corner.x_m)
            && reaches(y_m, |corner| corner.y_m)
            && distance_to_convex_m(Point2 { x_m, y_m }, corners) <= GROUND_GAP_M
    })
}

/// Draws the target heatmap `[heatmap_channel, scale * cell_y, scale * cell_x]` of one sample.
#[must_use]
pub fn draw_heatmap(
    objects: &[LabelledObject],
    ignored: &[Vec<Point2>],
    config: &ModelConfig,
    loss: &LossConfig,
) -> Vec<f32> {
    let grid = &config.grid;
    let scale = config.head.heatmap_scale;
    let cell_size_m = grid.cell_size_m / scale as f64;
    let (n_x, n_y) = (scale * grid.n_cells_x(), scale * grid.n_cells_y());
    let mut map = vec![0f32; config.head.heatmap.n_channels() * n_y * n_x];
    let is_ignored_cell = |&cell: &usize| is_on(ignored, grid.cell_center_m(cell, n_x, scale));
    let cells = if ignored.is_empty() { 0..0 } else { 0..n_y * n_x };
    for cell in cells.filter(is_ignored_cell) {
        // In every channel; the peaks of objects stay above.
        for value in map[cell..].iter_mut().step_by(n_y * n_x) {
            *value = IGNORED_PEAK;
        }
    }
    for object in objects {
        let truth = &object.truth.box_in_ego;
        let channel = match config.head.heatmap {
            Heatmap::Agnostic => 0,
            Heatmap::PerClass => object.harm.index(),
        };
        let x = ((truth.center.x() - grid.x_min_m) / cell_size_m) as usize;
        let y = ((truth.center.y() - grid.y_min_m) / cell_size_m) as usize;
        let radius = gaussian_radius(truth.length_m / cell_size_m, truth.width_m / cell_size_m);
        let sigma = (2 * radius + 1) as f64 / 6.0;
        let top = if is_ignored(object, loss) { IGNORED_PEAK } else { 1.0 };
        for cell_y in y.saturating_sub(radius)..(y + radius + 1).min(n_y) {
            for cell_x in x.saturating_sub(radius)..(x + radius + 1).min(n_x) {
                let distance2 = (cell_x.abs_diff(x).pow(2) + cell_y.abs_diff(y).pow(2)) as f64;
                let value = top * (-distance2 / (2.0 * sigma * sigma)).exp() as f32;
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

/// The channel of an object's class; an object of unknown kind counts as static.
#[must_use]
pub fn class_of(object: &LabelledObject, classes: Classes) -> usize {
    match classes {
        Classes::Harm => object.harm.index(),
        Classes::Kind => object.truth.kind.unwrap_or(Kind::Static).index(),
    }
}

/// A car that the LiDAR hit, for tests.
#[cfg(test)]
pub fn car(x: f64, y: f64, harm: crate::object::Harm) -> LabelledObject {
    use crate::geometry::{Box3, Point};
    use crate::object::{Distribution, Event, Kind, Object};
    LabelledObject {
        truth: Object {
            id: Some(format!("car-{x}-{y}")),
            category: Some("car".into()),
            kind: Some(Kind::Vehicle),
            distribution: Some(Distribution::Id),
            box_in_ego: Box3 {
                center: Point::new(x, y, 0.75),
                length_m: 4.0,
                width_m: 1.8,
                height_m: 1.5,
                yaw_rad: 0.0,
            },
            velocity_in_ego_mps: [0.0; 2],
            n_lidar_points: Some(10),
            visible_px: Some(100),
            visible_fraction: Some(1.0),
            event: Some(Event::None),
            solid: None,
            clearance_m: None,
            spot: None,
            is_tipped: None,
        },
        harm,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::{Harm, Kind};

    #[test]
    fn the_class_of_a_closed_set_is_the_kind_whatever_the_harm() {
        let mut person = car(10.0, 0.0, Harm::Harmful);
        person.truth.kind = Some(Kind::Pedestrian);
        assert_eq!((class_of(&person, Classes::Kind), class_of(&person, Classes::Harm)), (1, 0));
        person.harm = Harm::Harmless;
        assert_eq!((class_of(&person, Classes::Kind), class_of(&person, Classes::Harm)), (1, 1));
    }

    #[test]
    fn the_heatmap_is_one_at_the_object_and_falls_off() {
        let config = ModelConfig::default();
        let map = draw_heatmap(&[car(10.1, 0.1, Harm::Harmful)], &[], &config, &LossConfig::default());
        let at = |x: usize, y: usize| map[y * 128 + x];
        assert!((at(25, 80) - 1.0).abs() < 1e-6);
        assert!(at(26, 80) < 1.0 && at(26, 80) > at(27, 80) && at(25, 100) == 0.0);
    }

    #[test]
    fn objects_without_lidar_points_are_left_out_or_ignored_where_the_picture_shows_them() {
        let mut unseen = car(10.1, 0.1, Harm::Harmful);
        unseen.truth.n_lidar_points = Some(0);
        let mut hidden = unseen.clone();
        hidden.truth.visible_px = Some(3);
        let objects = [unseen, hidden, car(70.0, 0.0, Harm::Harmless), car(20.0, 0.0, Harm::Harmless)];
        let model = ModelConfig::default();
        let picked = |unhit| {
            let config = LossConfig { unhit, ..LossConfig::default() };
            let found = trainable(&objects, &model.grid, &config);
            let top = draw_heatmap(&found, &[], &model, &config)[80 * 128 + 25];
            (found.len(), top)
        };
        assert_eq!(picked(Unhit::Background), (1, 0.0));
        assert_eq!(picked(Unhit::Ignored), (2, IGNORED_PEAK));
        assert_eq!(picked(Unhit::Truth), (2, 1.0));
    }
    #[test]
    fn cells_on_ignored_ground_hardly_count_and_objects_there_do() {
        let config = ModelConfig::default();
        let corners = [[20.0, 3.0], [22.0, 3.0], [22.0, 5.0], [20.0, 5.0]];
        let corners_in_ego_m = corners.map(|[x_m, y_m]| Point2 { x_m, y_m }).to_vec();
        let picture = IgnoredRegion::Image { left_px: 0.0, top_px: 0.0, right_px: 9.0, bottom_px: 9.0 };
        let regions = [IgnoredRegion::Ground { corners_in_ego_m }, picture];
        for mirror in [false, true] {
            let ground = ignored_ground(&regions, mirror);
            let side = if mirror { -1.0 } else { 1.0 };
            assert_eq!(ground.len(), 1, "a rectangle of the picture has no place on the ground");
            assert!(is_on(&ground, [21.0, 4.0 * side]) && is_on(&ground, [21.0, 2.8 * side]));
            assert!(!is_on(&ground, [21.0, 2.0 * side]) && !is_on(&ground, [21.0, -4.0 * side]));
            let loss = LossConfig::default();
            let map = draw_heatmap(&[car(21.0, 4.0 * side, Harm::Harmless)], &ground, &config, &loss);
            let plain = draw_heatmap(&[car(21.0, 4.0 * side, Harm::Harmless)], &[], &config, &loss);
            let (grid, scale) = (&config.grid, config.head.heatmap_scale);
            let n_x = scale * grid.n_cells_x();
            for (cell, (&value, &without)) in map.iter().zip(&plain).enumerate() {
                let is_ignored = is_on(&ground, grid.cell_center_m(cell, n_x, scale));
                let wanted = if is_ignored { without.max(IGNORED_PEAK) } else { without };
                assert_eq!(value, wanted, "{cell}");
            }
            assert!(map.iter().filter(|&&value| value == IGNORED_PEAK).count() > 8);
            assert_eq!(map.iter().filter(|&&value| value == 1.0).count(), 1);
        }
    }
}
