//! One frame at several speeds or steering angles: the view from above for each, side by side.

use image::RgbImage;

use super::canvas::{Align, Canvas, text_width_px};
use super::{BIRDSEYE_PX, MARGIN_PX, SIZE_PX, Scene, TITLE_PX, birdseye, legend, palette};

/// One state of a frame.
pub struct StatePanel<'a> {
    /// The title above it.
    pub title: String,
    pub scene: Scene<'a>,
}

/// Draws the panels from left to right, [`SIZE_PX`] large; without any the page is empty.
#[must_use]
pub fn draw_states(panels: &[StatePanel<'_>]) -> RgbImage {
    let mut page = Canvas::new(SIZE_PX.0, SIZE_PX.1, palette::PAGE);
    let n = panels.len().max(1) as u32;
    let width_px = SIZE_PX.0.saturating_sub(MARGIN_PX * (n + 1)) / n;
    for (i, panel) in panels.iter().enumerate() {
        let left_px = MARGIN_PX + i as u32 * (width_px + MARGIN_PX);
        let scene = &panel.scene;
        let (areas, marks) = (scene.areas(), scene.marks());
        let above = birdseye::draw(&scene.sample.measured, &areas, &marks, width_px, BIRDSEYE_PX.1);
        page.paste(&above, left_px as i32, TITLE_PX as i32);
        let left = left_px as f32;
        page.text((left, 39.0), 22.0, palette::TEXT, Align::Left, &panel.title);
        let x = left + text_width_px(22.0, &panel.title) + 14.0;
        let counts = legend::counts(&panel.scene);
        page.text((x, 39.0), 15.0, palette::TEXT_SOFT, Align::Left, &counts);
    }
    if let Some(panel) = panels.first() {
        legend::draw_legend(&mut page, &panel.scene, (TITLE_PX + BIRDSEYE_PX.1) as f32);
    }
    page.into_rgb()
}
