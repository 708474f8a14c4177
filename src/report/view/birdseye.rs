//! The LiDAR from above: ego at the bottom, ahead is up, left is left; metres on range rings.

use super::canvas::{Align, Canvas, Pen, Px};
use super::{Area, FOCUS, Mark, palette};
use crate::geometry::{Box3, Ego, Point};
use crate::sample::Measured;

/// How far ahead is drawn, metres.
const AHEAD_M: f64 = 60.0;
/// How much is drawn behind the rear axle, metres.
const BEHIND_M: f64 = 3.0;
const RING_STEP_M: f64 = 10.0;
/// Drawn width of the ego, which a sample does not hold, metres.
const EGO_WIDTH_M: f64 = 1.9;
const EGO_REAR_OVERHANG_M: f64 = 0.9;
/// Distance between a marked box and the ring around it, metres.
const FOCUS_GAP_M: f64 = 1.0;
/// Steps of the height colours.
const N_HEIGHT_STEPS: usize = 24;

/// Draws the panel; the scale is set by its height.
pub fn draw(measured: &Measured, areas: &[Area], marks: &[Mark], width_px: u32, height_px: u32) -> Canvas {
    let mut canvas = Canvas::new(width_px, height_px, palette::PANEL);
    let plan = PlanView::of(width_px, height_px);
    let camera = measured.ego_from_camera.isometry.translation;
    let half_fov_rad = measured.intrinsics.horizontal_fov_rad() / 2.0;
    let wedge = Wedge { x_m: camera.x, y_m: camera.y, half_fov_rad };
    canvas.fill(&wedge.outline(&plan), palette::WEDGE);
    draw_rings(&mut canvas, &plan, &wedge);
    draw_points(&mut canvas, &plan, measured);
    for area in areas {
        let corners: Vec<Px> = area.corners.iter().map(|corner| plan.at(corner.x_m, corner.y_m)).collect();
        canvas.fill(&corners, area.color.with_alpha(area.fill));
        canvas.outline(&corners, Pen::solid(area.color, 1.4));
    }
    for mark in marks {
        let corners = mark.box_in_ego.footprint().map(|corner| plan.at(corner.x_m, corner.y_m));
        canvas.fill(&corners, mark.pen.color.with_alpha(0.16));
        canvas.outline(&corners, mark.pen);
        // From the middle to the front edge: the object's heading.
        let front = (f32::midpoint(corners[0].0, corners[3].0), f32::midpoint(corners[0].1, corners[3].1));
        let center = plan.at(mark.box_in_ego.center.x(), mark.box_in_ego.center.y());
        canvas.line(&[center, front], Pen { is_dashed: false, ..mark.pen });
    }
    draw_ego(&mut canvas, &plan, measured.ego_state.front_bumper_x_m);
    canvas
}

/// Draws a ring around a box, over a drawn panel.
pub fn point_at(canvas: &mut Canvas, focus: &Box3<Ego>) {
    let plan = PlanView::of(canvas.width_px() as u32, canvas.height_px() as u32);
    let center = plan.at(focus.center.x(), focus.center.y());
    let radius_px = ((focus.length_m.hypot(focus.width_m) / 2.0 + FOCUS_GAP_M) * plan.px_per_m) as f32;
    let ring = (0..48).map(|step| {
        let (sin, cos) = (step as f32 / 48.0 * std::f32::consts::TAU).sin_cos();
        (center.0 + radius_px * cos, center.1 + radius_px * sin)
    });
    canvas.outline(&ring.collect::<Vec<Px>>(), Pen { width_px: FOCUS.width_px / 3.0, ..FOCUS });
}

/// The map from ego metres to the panel's pixels.
pub struct PlanView {
    center_px: f64,
    bottom_px: f64,
    px_per_m: f64,
}

impl PlanView {
    /// The scale of a panel of this size.
    pub fn of(width_px: u32, height_px: u32) -> Self {
        Self {
            center_px: f64::from(width_px) / 2.0,
            bottom_px: f64::from(height_px),
            px_per_m: f64::from(height_px) / (AHEAD_M + BEHIND_M),
        }
    }

    pub fn at(&self, x_m: f64, y_m: f64) -> Px {
        let up_px = (x_m + BEHIND_M) * self.px_per_m;
        ((self.center_px - y_m * self.px_per_m) as f32, (self.bottom_px - up_px) as f32)
    }
}

/// The camera's field of view, from above.
struct Wedge {
    x_m: f64,
    y_m: f64,
    half_fov_rad: f64,
}

impl Wedge {
    /// The arc of a range about the ego's origin, from the right edge of the view to the left.
    fn arc(&self, range_m: f64) -> Vec<(f64, f64)> {
        (-32..=32)
            .filter_map(|step| {
                let (sin, cos) = (f64::from(step) / 32.0 * self.half_fov_rad).sin_cos();
                // Along the ray from the camera until it is `range_m` from the origin.
                let along = self.x_m * cos + self.y_m * sin;
                let rest = range_m * range_m - self.x_m * self.x_m - self.y_m * self.y_m;
                let root = along * along + rest;
                (root > 0.0 && rest > 0.0).then(|| {
                    let t = root.sqrt() - along;
                    (self.x_m + t * cos, self.y_m + t * sin)
                })
            })
            .collect()
    }

    fn outline(&self, plan: &PlanView) -> Vec<Px> {
        let mut corners = vec![plan.at(self.x_m, self.y_m)];
        corners.extend(self.arc(AHEAD_M).into_iter().map(|(x, y)| plan.at(x, y)));
        corners
    }
}

fn draw_rings(canvas: &mut Canvas, plan: &PlanView, wedge: &Wedge) {
    let mut range_m = RING_STEP_M;
    while range_m <= AHEAD_M {
        let arc = wedge.arc(range_m);
        let line: Vec<Px> = arc.iter().map(|&(x, y)| plan.at(x, y)).collect();
        canvas.line(&line, Pen::solid(palette::RING, 1.0));
        if let Some(&(x, y)) = line.first() {
            let at = (x + 7.0, y + 9.0);
            canvas.text(at, 12.5, palette::TEXT_SOFT, Align::Left, &format!("{range_m:.0} m"));
        }
        range_m += RING_STEP_M;
    }
}

fn draw_points(canvas: &mut Canvas, plan: &PlanView, measured: &Measured) {
    let (low_m, high_m) = palette::HEIGHT_RANGE_M;
    let mut steps: Vec<Vec<Px>> = vec![Vec::new(); N_HEIGHT_STEPS];
    for point in &measured.points {
        let in_lidar = Point::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m));
        let in_ego = measured.ego_from_lidar * in_lidar;
        let share = ((in_ego.z() as f32 - low_m) / (high_m - low_m)).clamp(0.0, 1.0);
        let step = ((share * N_HEIGHT_STEPS as f32) as usize).min(N_HEIGHT_STEPS - 1);
        let (x, y) = plan.at(in_ego.x(), in_ego.y());
        if (0.0..canvas.width_px()).contains(&x) && (0.0..canvas.height_px()).contains(&y) {
            steps[step].push((x, y));
        }
    }
    for (step, dots) in steps.iter().enumerate() {
        let share = step as f32 / (N_HEIGHT_STEPS - 1) as f32;
        canvas.dots(dots, 0.95 + 0.2 * share, palette::height(share));
    }
}

fn draw_ego(canvas: &mut Canvas, plan: &PlanView, front_bumper_x_m: f64) {
    let (left, top) = plan.at(front_bumper_x_m, EGO_WIDTH_M / 2.0);
    let (right, bottom) = plan.at(-EGO_REAR_OVERHANG_M, -EGO_WIDTH_M / 2.0);
    canvas.fill_rounded(left, top, (right - left, bottom - top), 4.0, palette::EGO);
    // The windscreen, which marks its front.
    let height = bottom - top;
    let (inset, glass) = (2.5, palette::PAGE.with_alpha(0.75));
    canvas.fill_rounded(
        left + inset,
        top + 0.28 * height,
        (right - left - 2.0 * inset, 0.16 * height),
        1.5,
        glass,
    );
}
