//! The camera's picture with the zone on the ground and the boxes in space.

use image::imageops::FilterType;

use super::canvas::{Align, Canvas, Pen, Px, text_width_px};
use super::{Area, INK, Mark, palette};
use crate::geometry::{Box3, Camera, Ego, Point, Transform};
use crate::sample::Measured;

/// Nothing nearer than this is projected: lines are cut there, metres.
const NEAR_M: f64 = 0.25;
const TAG_SIZE_PX: f32 = 13.0;
/// Corner pairs of a box: base, top, uprights.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Draws the panel, the camera's picture as large as fits.
pub fn draw(
    measured: &Measured,
    areas: &[Area],
    marks: &[Mark],
    width_px: u32,
    height_px: u32,
) -> Result<Canvas, image::ImageError> {
    let picture = measured.image.decode()?;
    let scale = (f64::from(width_px) / f64::from(picture.width().max(1)))
        .min(f64::from(height_px) / f64::from(picture.height().max(1)));
    let scaled = |side_px: u32| ((f64::from(side_px) * scale).round() as u32).max(1);
    let (inner_width, inner_height) = (scaled(picture.width()), scaled(picture.height()));
    let resized = image::imageops::resize(&picture, inner_width, inner_height, FilterType::CatmullRom);
    let mut inner = Canvas::from_rgb(&resized);
    let lens = Lens {
        camera_from_ego: measured.ego_from_camera.inverse(),
        measured,
        scale: (
            f64::from(inner_width) / f64::from(measured.intrinsics.width_px.max(1)),
            f64::from(inner_height) / f64::from(measured.intrinsics.height_px.max(1)),
        ),
    };
    for area in areas {
        let ground: Vec<Point<Ego>> =
            area.corners.iter().map(|corner| Point::new(corner.x_m, corner.y_m, 0.0)).collect();
        let seen = lens.polygon(&ground);
        // A little more than from above: a photograph is brighter than the panel.
        inner.fill(&seen, area.color.with_alpha(1.2 * area.fill));
        inner.outline(&seen, Pen::solid(area.color.with_alpha(0.9), 1.6));
    }
    let mut marks: Vec<&Mark> = marks.iter().collect();
    // Far to near, so that near boxes and tags lie on top.
    marks.sort_by(|a, b| b.box_in_ego.center.x().total_cmp(&a.box_in_ego.center.x()));
    for mark in &marks {
        lens.draw_box(&mut inner, mark);
    }
    let mut taken = Vec::new();
    for mark in marks.iter().rev() {
        lens.draw_tag(&mut inner, mark, &mut taken);
    }
    let mut panel = Canvas::new(width_px, height_px, palette::PANEL);
    let margin = |outer: u32, inner: u32| (outer.saturating_sub(inner) / 2) as i32;
    panel.paste(&inner, margin(width_px, inner_width), margin(height_px, inner_height));
    Ok(panel)
}

struct Lens<'a> {
    camera_from_ego: Transform<Camera, Ego>,
    measured: &'a Measured,
    scale: (f64, f64),
}

impl Lens<'_> {
    fn draw_box(&self, canvas: &mut Canvas, mark: &Mark) {
        let corners = mark.box_in_ego.corners().map(|corner| self.camera_from_ego * corner);
        // A dark line under each line keeps the colour readable on a bright wall.
        let shade =
            Pen { color: palette::PANEL.with_alpha(0.35), width_px: mark.pen.width_px + 1.6, ..mark.pen };
        for pen in [shade, mark.pen] {
            for (from, to) in EDGES {
                if let Some(line) = self.segment(corners[from], corners[to]) {
                    canvas.line(&line, pen);
                }
            }
        }
    }

    /// Writes the mark's text above its box, unless another tag is in the way.
    fn draw_tag(&self, canvas: &mut Canvas, mark: &Mark, taken: &mut Vec<[f32; 4]>) {
        let Some(text) = &mark.tag else { return };
        let Some((x, top)) = self.tag_anchor(&mark.box_in_ego) else { return };
        let (width, height) = (text_width_px(TAG_SIZE_PX, text) + 10.0, TAG_SIZE_PX + 5.0);
        let left = (x - width / 2.0).clamp(2.0, (canvas.width_px() - width - 2.0).max(2.0));
        let mut top = (top - height - 4.0).clamp(2.0, (canvas.height_px() - height - 2.0).max(2.0));
        // Up to three rows above one another; beyond that there is only the box.
        for _ in 0..3 {
            let rect = [left, top, left + width, top + height];
            if !taken.iter().any(|other| overlaps(&rect, other)) {
                taken.push(rect);
                canvas.fill_rounded(left, top, (width, height), 4.0, mark.pen.color.with_alpha(0.92));
                let baseline = top + TAG_SIZE_PX + 0.5;
                canvas.text((left + 5.0, baseline), TAG_SIZE_PX, INK, Align::Left, text);
                return;
            }
            top -= height + 2.0;
            if top < 2.0 {
                return;
            }
        }
    }

    /// Middle of the box's top edge in the picture; `None` if the box is behind or outside.
    fn tag_anchor(&self, box_in_ego: &Box3<Ego>) -> Option<Px> {
        let seen: Vec<Px> = box_in_ego
            .corners()
            .iter()
            .map(|&corner| self.camera_from_ego * corner)
            .filter(|corner| corner.z() > NEAR_M)
            .filter_map(|corner| self.pixel(&corner))
            .collect();
        let (left, right) = seen.iter().fold((f32::MAX, f32::MIN), |(l, r), p| (l.min(p.0), r.max(p.0)));
        let top = seen.iter().map(|p| p.1).fold(f32::MAX, f32::min);
        let width_px = f64::from(self.measured.intrinsics.width_px) * self.scale.0;
        let height_px = f64::from(self.measured.intrinsics.height_px) * self.scale.1;
        (right > 0.0 && f64::from(left) < width_px && f64::from(top) < height_px)
            .then_some((f32::midpoint(left, right), top))
    }

    fn pixel(&self, point_in_camera: &Point<Camera>) -> Option<Px> {
        let (u, v) = self.measured.intrinsics.project(point_in_camera)?;
        Some(((u * self.scale.0) as f32, (v * self.scale.1) as f32))
    }

    /// A segment, cut at the near plane.
    fn segment(&self, a: Point<Camera>, b: Point<Camera>) -> Option<[Px; 2]> {
        let (near, far) = if a.z() < b.z() { (a, b) } else { (b, a) };
        if far.z() <= NEAR_M {
            return None;
        }
        let near = if near.z() < NEAR_M { cut(near, far) } else { near };
        Some([self.pixel(&near)?, self.pixel(&far)?])
    }

    /// A polygon in the picture, cut at the near plane; empty when it lies behind.
    fn polygon(&self, corners: &[Point<Ego>]) -> Vec<Px> {
        let corners: Vec<_> = corners.iter().map(|&corner| self.camera_from_ego * corner).collect();
        let mut kept = Vec::with_capacity(corners.len() + 2);
        for (i, &current) in corners.iter().enumerate() {
            let next = corners[(i + 1) % corners.len()];
            if current.z() >= NEAR_M {
                kept.push(current);
            }
            if (current.z() >= NEAR_M) != (next.z() >= NEAR_M) {
                kept.push(cut(current, next));
            }
        }
        kept.iter().filter_map(|corner| self.pixel(corner)).collect()
    }
}

/// The point where a segment crosses the near plane.
fn cut(a: Point<Camera>, b: Point<Camera>) -> Point<Camera> {
    let t = (NEAR_M - a.z()) / (b.z() - a.z());
    Point::from_coords(a.coords + (b.coords - a.coords) * t)
}

fn overlaps(a: &[f32; 4], b: &[f32; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}
