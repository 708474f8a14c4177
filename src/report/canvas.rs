//! A small drawing surface: antialiased lines, polygons and text. Pixels, origin top left.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, Glyph, ScaleFont, point};
use tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, PixmapPaint, PremultipliedColorU8, Stroke,
    StrokeDash, Transform,
};

/// Ubuntu Light (Ubuntu Font Licence 1.0), as `epaint_default_fonts` ships it.
static FONT: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).expect("the embedded font is a font")
});

/// A colour with opacity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Color {
    pub rgb: [u8; 3],
    /// 0 clear to 1 solid.
    pub alpha: f32,
}

impl Color {
    pub const fn new(hex: u32) -> Self {
        let [_, r, g, b] = hex.to_be_bytes();
        Self { rgb: [r, g, b], alpha: 1.0 }
    }

    pub const fn with_alpha(self, alpha: f32) -> Self {
        Self { alpha, ..self }
    }

    /// The colour `t` of the way to another, 0 to 1.
    pub fn mix(self, other: Self, t: f32) -> Self {
        let rgb = std::array::from_fn(|i| {
            let (a, b) = (f32::from(self.rgb[i]), f32::from(other.rgb[i]));
            (a + (b - a) * t).round() as u8
        });
        Self { rgb, alpha: self.alpha }
    }

    fn paint(self) -> Paint<'static> {
        let mut paint = Paint::default();
        let [r, g, b] = self.rgb;
        paint.set_color_rgba8(r, g, b, (self.alpha * 255.0).round() as u8);
        paint.anti_alias = true;
        paint
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen {
    pub color: Color,
    pub width_px: f32,
    pub is_dashed: bool,
}

impl Pen {
    pub const fn solid(color: Color, width_px: f32) -> Self {
        Self { color, width_px, is_dashed: false }
    }
}

/// Where text stands relative to its x.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    Left,
    Right,
}

/// A point in pixels.
pub type Px = (f32, f32);

/// The surface.
pub struct Canvas {
    pixmap: Pixmap,
}

impl Canvas {
    /// A surface of one colour; sides of zero count as one.
    pub fn new(width_px: u32, height_px: u32, background: Color) -> Self {
        let mut pixmap =
            Pixmap::new(width_px.max(1), height_px.max(1)).expect("a size above zero makes a pixmap");
        let [r, g, b] = background.rgb;
        pixmap.fill(tiny_skia::Color::from_rgba8(r, g, b, 255));
        Self { pixmap }
    }

    /// A surface that holds a picture.
    pub fn from_rgb(picture: &image::RgbImage) -> Self {
        let mut canvas = Self::new(picture.width(), picture.height(), Color::new(0));
        for (to, from) in canvas.pixmap.pixels_mut().iter_mut().zip(picture.pixels()) {
            let [r, g, b] = from.0;
            *to = solid(r, g, b);
        }
        canvas
    }

    pub fn into_rgb(self) -> image::RgbImage {
        let (width, height) = (self.pixmap.width(), self.pixmap.height());
        let bytes = self.pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
        image::RgbImage::from_raw(width, height, bytes).expect("three bytes a pixel")
    }

    pub fn width_px(&self) -> f32 {
        self.pixmap.width() as f32
    }

    pub fn height_px(&self) -> f32 {
        self.pixmap.height() as f32
    }

    /// Draws through the points in order.
    pub fn line(&mut self, points: &[Px], pen: Pen) {
        self.stroke(points, false, pen);
    }

    /// Draws through the points and back to the first.
    pub fn outline(&mut self, points: &[Px], pen: Pen) {
        self.stroke(points, true, pen);
    }

    pub fn fill(&mut self, points: &[Px], color: Color) {
        let Some(path) = path_through(points, true) else { return };
        self.pixmap.fill_path(&path, &color.paint(), FillRule::Winding, Transform::identity(), None);
    }

    /// Fills a rectangle with round corners.
    pub fn fill_rounded(&mut self, left: f32, top: f32, size: Px, radius_px: f32, color: Color) {
        let (right, bottom, r) = (left + size.0, top + size.1, radius_px);
        let mut path = PathBuilder::new();
        path.move_to(left + r, top);
        path.line_to(right - r, top);
        path.quad_to(right, top, right, top + r);
        path.line_to(right, bottom - r);
        path.quad_to(right, bottom, right - r, bottom);
        path.line_to(left + r, bottom);
        path.quad_to(left, bottom, left, bottom - r);
        path.line_to(left, top + r);
        path.quad_to(left, top, left + r, top);
        path.close();
        let Some(path) = path.finish() else { return };
        self.pixmap.fill_path(&path, &color.paint(), FillRule::Winding, Transform::identity(), None);
    }

    /// Fills a small disc at each point.
    pub fn dots(&mut self, centers: &[Px], radius_px: f32, color: Color) {
        let mut path = PathBuilder::new();
        for &(x, y) in centers {
            path.push_circle(x, y, radius_px);
        }
        let Some(path) = path.finish() else { return };
        self.pixmap.fill_path(&path, &color.paint(), FillRule::Winding, Transform::identity(), None);
    }

    /// Draws text on a baseline.
    pub fn text(&mut self, (x, baseline): Px, size_px: f32, color: Color, align: Align, text: &str) {
        let width = text_width_px(size_px, text);
        let left = match align {
            Align::Left => x,
            Align::Right => x - width,
        };
        let [r, g, b] = color.rgb;
        for glyph in glyphs(size_px, text, left, baseline) {
            let Some(outline) = FONT.outline_glyph(glyph) else { continue };
            let origin = outline.px_bounds().min;
            outline.draw(|gx, gy, coverage| {
                // The face is light: a root thickens its thin strokes at small sizes.
                let alpha = coverage.clamp(0.0, 1.0).powf(0.7) * color.alpha;
                self.blend(origin.x as i32 + gx as i32, origin.y as i32 + gy as i32, [r, g, b], alpha);
            });
        }
    }

    /// Lays another surface over this one; parts beyond the border are cut.
    pub fn paste(&mut self, other: &Self, left_px: i32, top_px: i32) {
        let paint = PixmapPaint::default();
        self.pixmap.draw_pixmap(left_px, top_px, other.pixmap.as_ref(), &paint, Transform::identity(), None);
    }

    fn stroke(&mut self, points: &[Px], is_closed: bool, pen: Pen) {
        let Some(path) = path_through(points, is_closed) else { return };
        let dash = if pen.is_dashed {
            StrokeDash::new(vec![3.5 + pen.width_px, 2.5 + pen.width_px], 0.0)
        } else {
            None
        };
        let cap = if pen.is_dashed { LineCap::Butt } else { LineCap::Round };
        let stroke = Stroke {
            width: pen.width_px,
            line_cap: cap,
            line_join: LineJoin::Round,
            dash,
            ..Stroke::default()
        };
        self.pixmap.stroke_path(&path, &pen.color.paint(), &stroke, Transform::identity(), None);
    }

    fn blend(&mut self, x: i32, y: i32, rgb: [u8; 3], alpha: f32) {
        let (width, height) = (self.pixmap.width() as i32, self.pixmap.height() as i32);
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let pixel = &mut self.pixmap.pixels_mut()[(y * width + x) as usize];
        let mixed = |under: u8, over: u8| {
            (f32::from(under) + (f32::from(over) - f32::from(under)) * alpha).round() as u8
        };
        *pixel = solid(mixed(pixel.red(), rgb[0]), mixed(pixel.green(), rgb[1]), mixed(pixel.blue(), rgb[2]));
    }
}

/// Width of a text in pixels.
pub fn text_width_px(size_px: f32, text: &str) -> f32 {
    let font = FONT.as_scaled(size_px);
    text.chars().map(|character| font.h_advance(font.glyph_id(character))).sum()
}

fn glyphs(size_px: f32, text: &str, left: f32, baseline: f32) -> Vec<Glyph> {
    let font = FONT.as_scaled(size_px);
    let mut x = left;
    text.chars()
        .map(|character| {
            let mut glyph = font.scaled_glyph(character);
            glyph.position = point(x, baseline);
            x += font.h_advance(glyph.id);
            glyph
        })
        .collect()
}

fn path_through(points: &[Px], is_closed: bool) -> Option<tiny_skia::Path> {
    let (&(x, y), rest) = points.split_first()?;
    let mut path = PathBuilder::new();
    path.move_to(x, y);
    for &(x, y) in rest {
        path.line_to(x, y);
    }
    if is_closed {
        path.close();
    }
    path.finish()
}

fn solid(r: u8, g: u8, b: u8) -> PremultipliedColorU8 {
    PremultipliedColorU8::from_rgba(r, g, b, 255).expect("a solid colour is premultiplied")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filled_square_colours_its_inside_only() {
        let mut canvas = Canvas::new(10, 10, Color::new(0));
        canvas.fill(&[(2.0, 2.0), (8.0, 2.0), (8.0, 8.0), (2.0, 8.0)], Color::new(0x00ff_0000));
        let picture = canvas.into_rgb();
        assert_eq!((picture.get_pixel(5, 5).0, picture.get_pixel(1, 1).0), ([255, 0, 0], [0, 0, 0]));
    }

    #[test]
    fn right_aligned_text_ends_where_it_is_told() {
        let mut canvas = Canvas::new(60, 20, Color::new(0));
        canvas.text((40.0, 15.0), 14.0, Color::new(0x00ff_ffff), Align::Right, "60 m");
        let picture = canvas.into_rgb();
        let lit = |range: std::ops::Range<u32>| {
            range.flat_map(|x| (0..20).map(move |y| (x, y))).any(|(x, y)| picture.get_pixel(x, y).0[0] > 40)
        };
        assert!(lit(10..40) && !lit(42..60));
    }

    #[test]
    fn the_font_has_every_sign_that_the_picture_uses() {
        assert!("0123456789.·°±+−/m²%".chars().all(|c| FONT.glyph_id(c).0 != 0));
    }

    #[test]
    fn text_and_lines_far_outside_do_no_harm() {
        let mut canvas = Canvas::new(4, 4, Color::new(0));
        canvas.text((-500.0, 1e4), 14.0, Color::new(0x00ff_ffff), Align::Left, "far");
        canvas.line(&[(-1e6, -1e6), (-1e6, 1e6)], Pen::solid(Color::new(0x00ff_ffff), 2.0));
        assert!(canvas.into_rgb().pixels().all(|pixel| pixel.0 == [0, 0, 0]));
    }
}
