//! The title above the panels and the legend below them.

use super::canvas::{Align, Canvas, Color, Pen, text_width_px};
use super::{FRONT_PX, MARGIN_PX, SIZE_PX, Scene, palette};
use crate::object::{Harm, Object};

const LEGEND_SIZE_PX: f32 = 15.0;
/// Turns of the road wheels below this are written as straight, degrees.
const STRAIGHT_DEG: f64 = 0.05;

/// Writes episode, sample, speed, steering and counts on the title strip.
pub fn draw_title(page: &mut Canvas, scene: &Scene) {
    let ego = scene.sample.true_state();
    let left = MARGIN_PX as f32;
    page.text((left, 39.0), 25.0, palette::TEXT, Align::Left, scene.episode);
    let x = left + text_width_px(25.0, scene.episode) + 18.0;
    let sample = format!("sample {}", scene.sample_idx);
    page.text((x, 39.0), 17.0, palette::TEXT_SOFT, Align::Left, &sample);

    let turn = turn(ego.steering_angle_rad);
    let right = (MARGIN_PX + FRONT_PX.0) as f32;
    // A sum with zero has no minus sign left: no "-0.0".
    let speed_mps = (10.0 * ego.speed_mps).round() / 10.0 + 0.0;
    let state = [("steering", turn), ("speed", format!("{speed_mps:.1} m/s"))];
    let mut x = right;
    for (name, value) in state {
        page.text((x, 39.0), 20.0, palette::TEXT, Align::Right, &value);
        x -= text_width_px(20.0, &value) + 8.0;
        page.text((x, 39.0), 17.0, palette::TEXT_SOFT, Align::Right, name);
        x -= text_width_px(17.0, name) + 24.0;
    }
    page.text((right + MARGIN_PX as f32, 39.0), 17.0, palette::TEXT_SOFT, Align::Left, &counts(scene));
}

/// A steering angle in words.
pub fn turn(steering_angle_rad: f64) -> String {
    let steering_deg = steering_angle_rad.to_degrees();
    if steering_deg.abs() < STRAIGHT_DEG {
        return "straight".to_owned();
    }
    format!("{:.1}° {}", steering_deg.abs(), if steering_deg > 0.0 { "left" } else { "right" })
}

/// The number of objects of each kind, as text.
pub fn counts(scene: &Scene) -> String {
    let objects = scene.sample.objects();
    let n_ood = objects.iter().filter(|object| object.is_ood()).count();
    let mut text = format!("{} object{}", objects.len(), if objects.len() == 1 { "" } else { "s" });
    if n_ood > 0 {
        text += &format!(" · {n_ood} out of distribution");
    }
    if let Some(harms) = scene.harms {
        let n_harmful = harms.iter().filter(|&&harm| harm == Harm::Harmful).count();
        text += &format!(" · {n_harmful} harmful");
    }
    if let Some(detections) = scene.detections {
        text += &format!(" · {} predicted", detections.len());
    }
    text
}

/// Explains the colours and lines, and the scale of the LiDAR's heights.
pub fn draw_legend(page: &mut Canvas, scene: &Scene, top: f32) {
    let baseline = top + 34.0;
    draw_entries(page, scene, (MARGIN_PX as f32, baseline), LEGEND_SIZE_PX);
    draw_height_scale(page, baseline);
}

/// Explains the colours and lines, from a place on a baseline to the right.
pub fn draw_entries(page: &mut Canvas, scene: &Scene, (left, baseline): (f32, f32), size_px: f32) {
    let middle = baseline - size_px / 3.0;
    let mut x = left;
    if scene.zone.is_some() {
        let corners =
            [(x, middle - 7.0), (x + 26.0, middle - 7.0), (x + 26.0, middle + 7.0), (x, middle + 7.0)];
        page.fill(&corners, palette::ZONE.with_alpha(0.24));
        page.outline(&corners, Pen::solid(palette::ZONE, 1.4));
        x = write_entry(page, (x, baseline), size_px, "danger zone");
    }
    for (pen, name) in entries(scene) {
        page.line(&[(x, middle), (x + 26.0, middle)], pen);
        x = write_entry(page, (x, baseline), size_px, name);
    }
}

fn write_entry(page: &mut Canvas, (x, baseline): (f32, f32), size_px: f32, name: &str) -> f32 {
    page.text((x + 34.0, baseline), size_px, palette::TEXT_SOFT, Align::Left, name);
    x + 34.0 + text_width_px(size_px, name) + 26.0 * size_px / LEGEND_SIZE_PX
}

fn entries(scene: &Scene) -> Vec<(Pen, &'static str)> {
    let truth = |color: Color| Pen::solid(color, 2.0);
    let mut entries = Vec::new();
    if scene.harms.is_some() {
        entries.push((truth(palette::truth(Harm::Harmful)), "harmful"));
        entries.push((truth(palette::truth(Harm::Harmless)), "harmless"));
    } else {
        entries.push((truth(palette::UNLABELLED), "object, no label"));
    }
    if scene.sample.objects().iter().any(Object::is_ood) {
        let pen = Pen { color: palette::TEXT_SOFT, width_px: 2.0, is_dashed: true };
        entries.push((pen, "out of distribution"));
    }
    if scene.detections.is_some() {
        entries.push((Pen::solid(palette::predicted(Harm::Harmful), 4.0), "predicted harmful"));
        entries.push((Pen::solid(palette::predicted(Harm::Harmless), 4.0), "predicted harmless"));
    }
    entries
}

fn draw_height_scale(page: &mut Canvas, baseline: f32) {
    let right = (SIZE_PX.0 - MARGIN_PX) as f32;
    let (low_m, high_m) = palette::HEIGHT_RANGE_M;
    let high = format!("{high_m:.0} m");
    page.text((right, baseline), LEGEND_SIZE_PX, palette::TEXT_SOFT, Align::Right, &high);
    let bar_right = right - text_width_px(LEGEND_SIZE_PX, &high) - 8.0;
    // On whole pixels, so that no seams show between the steps.
    let (bar_left, n_steps) = ((bar_right - 120.0).round(), 60);
    for step in 0..n_steps {
        let x = bar_left + step as f32 * 2.0;
        let (top, bottom) = (baseline - 9.0, baseline - 1.0);
        let color = palette::height(step as f32 / (n_steps - 1) as f32);
        page.fill(&[(x, top), (x + 2.0, top), (x + 2.0, bottom), (x, bottom)], color);
    }
    let low = format!("LiDAR, height above ground  {low_m:.0}");
    page.text((bar_left - 8.0, baseline), LEGEND_SIZE_PX, palette::TEXT_SOFT, Align::Right, &low);
}
