//! The pictures of a clip: the camera beside the view from above, what the ego does over them, and below a line through the time that
//! tells when something was harmful and when the network said so.

use std::collections::BTreeSet;
use std::ops::Range;

use image::RgbImage;

use super::canvas::{Align, Canvas, Color, Pen, text_width_px};
use super::episode_view::{EpisodeView, ViewedSample};
use super::load::ViewError;
use super::moment::seconds_after;
use super::{Scene, birdseye, front, legend, palette};
use crate::episode::LabelReader;
use crate::object::{Detection, Harm};

/// The widths that a clip may have: narrower nothing can be read, wider no encoder takes it.
pub const WIDTHS_PX: (u32, u32) = (480, 1920);

const MARGIN_PX: u32 = 10;
const HEADER_PX: u32 = 38;
const LEGEND_PX: u32 = 26;
/// A row of the line through the time, and the gap between two.
const ROW_PX: f32 = 6.0;
const ROW_GAP_PX: f32 = 3.0;
const FOOTER_PX: u32 = 2 * (ROW_PX as u32) + 3 * (ROW_GAP_PX as u32) + 4;
/// The camera's share of the width.
const FRONT_SHARE: f64 = 0.58;
/// The camera's sides.
const FRONT_ASPECT: f64 = 9.0 / 16.0;
const HEADER_SIZE_PX: f32 = 16.0;
const LEGEND_SIZE_PX: f32 = 12.5;
/// As many names of harmful things are told.
const MOST_NAMES: usize = 3;

/// How the parts of a picture lie, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(clippy::struct_field_names, reason = "a length in pixels ends in its unit")]
struct FilmPage {
    width_px: u32,
    front_px: (u32, u32),
    birdseye_width_px: u32,
}

impl FilmPage {
    /// Of an even width.
    fn of_width(width_px: u32) -> Self {
        let inner_px = width_px - 3 * MARGIN_PX;
        let front_width_px = (f64::from(inner_px) * FRONT_SHARE).round() as u32;
        // With the other parts the height is even.
        let front_height_px = (f64::from(front_width_px) * FRONT_ASPECT / 2.0).round() as u32 * 2;
        Self {
            width_px,
            front_px: (front_width_px, front_height_px),
            birdseye_width_px: inner_px - front_width_px,
        }
    }

    fn height_px(self) -> u32 {
        (HEADER_PX + self.front_px.1 + LEGEND_PX + FOOTER_PX).next_multiple_of(2)
    }
}

/// A part of an episode as pictures.
pub struct Film<'a> {
    view: &'a EpisodeView,
    span: Range<usize>,
    page: FilmPage,
    /// Of the whole span: whether anything is harmful, and whether the network says so.
    is_harmful: Vec<bool>,
    is_predicted: Option<Vec<bool>>,
}

impl<'a> Film<'a> {
    /// Prepares the pictures of some samples, of a width within [`WIDTHS_PX`], else the nearest.
    #[must_use]
    pub fn of(view: &'a EpisodeView, span: Range<usize>, width_px: u32) -> Self {
        let width_px = width_px.clamp(WIDTHS_PX.0, WIDTHS_PX.1).next_multiple_of(2);
        let times: BTreeSet<u64> = view.times_ns()[span.clone()].iter().copied().collect();
        let harmful_at: BTreeSet<u64> = view
            .labels
            .iter()
            .flat_map(LabelReader::samples)
            .filter(|sample| sample.labels.iter().any(|label| label.harm == Harm::Harmful))
            .map(|sample| sample.time_ns)
            .collect();
        let is_warning =
            |detection: &Detection| detection.harm == Harm::Harmful && detection.score >= view.min_score;
        let predicted = view.detections.as_ref().map(|found| {
            let warned = found.samples().iter().filter(|sample| sample.detections.iter().any(is_warning));
            let warned_at: BTreeSet<u64> = warned.map(|sample| sample.time_ns).collect();
            times.iter().map(|time_ns| warned_at.contains(time_ns)).collect()
        });
        Self {
            view,
            span,
            page: FilmPage::of_width(width_px),
            is_harmful: times.iter().map(|time_ns| harmful_at.contains(time_ns)).collect(),
            is_predicted: predicted,
        }
    }

    /// How many pictures there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.span.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.span.is_empty()
    }

    /// Width and height of each picture; both are even.
    #[must_use]
    pub fn size_px(&self) -> (u32, u32) {
        (self.page.width_px, self.page.height_px())
    }

    /// How long each picture is shown: until the next; the last as long as the one before.
    #[must_use]
    pub fn durations_ms(&self) -> Vec<u32> {
        /// Where an episode has one sample alone.
        const ALONE_MS: u32 = 300;
        let times_ns = &self.view.times_ns()[self.span.clone()];
        let to_ms = |time_ns: u64| (time_ns - times_ns[0] + 500_000) / 1_000_000;
        let steps = times_ns.windows(2).map(|pair| to_ms(pair[1]) - to_ms(pair[0]));
        let mut durations: Vec<u32> =
            steps.map(|step_ms| u32::try_from(step_ms).unwrap_or(u32::MAX).max(1)).collect();
        if !times_ns.is_empty() {
            durations.push(durations.last().copied().unwrap_or(ALONE_MS));
        }
        durations
    }

    /// Draws a picture, counted from the first of the span.
    ///
    /// # Errors
    /// [`ViewError`]: no such sample, or a broken file.
    pub fn picture(&self, place: usize) -> Result<RgbImage, ViewError> {
        let viewed = self.view.sample(self.span.start + place)?;
        let (page, scene) = (self.page, viewed.scene(self.view.name()));
        let (areas, marks, measured) = (scene.areas(), scene.marks(), &viewed.sample.measured);
        let front = front::draw(measured, &areas, &marks, page.front_px.0, page.front_px.1)
            .map_err(|source| ViewError::Image { source, path: self.view.episode.path().to_owned() })?;
        let above = birdseye::draw(measured, &areas, &marks, page.birdseye_width_px, page.front_px.1);
        let mut canvas = Canvas::new(page.width_px, page.height_px(), palette::PAGE);
        canvas.paste(&front, MARGIN_PX as i32, HEADER_PX as i32);
        canvas.paste(&above, (2 * MARGIN_PX + page.front_px.0) as i32, HEADER_PX as i32);
        self.draw_header(&mut canvas, &viewed);
        self.draw_footer(&mut canvas, &scene, place);
        Ok(canvas.into_rgb())
    }

    /// What is harmful on the left; time, speed and steering on the right.
    fn draw_header(&self, canvas: &mut Canvas, viewed: &ViewedSample) {
        let baseline = HEADER_PX as f32 - 12.0;
        let ego = viewed.sample.true_state();
        let seconds = seconds_after(self.view.times_ns(), viewed.sample.measured.time_ns);
        let facts = [
            format!("{seconds:.1} s"),
            // A sum with zero has no minus sign left: no "-0.0".
            format!("{:.1} m/s", (10.0 * ego.speed_mps).round() / 10.0 + 0.0),
            legend::turn(ego.steering_angle_rad),
        ];
        // Of the widest words, so that nothing moves while it plays.
        let widths =
            ["00.0 s", "00.0 m/s", "00.0° right"].map(|widest| text_width_px(HEADER_SIZE_PX, widest));
        let mut right = self.page.width_px as f32 - MARGIN_PX as f32;
        for (fact, width) in facts.iter().zip(widths).rev() {
            canvas.text((right, baseline), HEADER_SIZE_PX, palette::TEXT, Align::Right, fact);
            right -= width + 18.0;
        }
        let Some(harms) = &viewed.harms else { return };
        let left = MARGIN_PX as f32;
        let (words, color) = match harmful_names(viewed, harms) {
            None => ("nothing is in the way".to_owned(), palette::TEXT_SOFT),
            Some(names) => (names, palette::truth(Harm::Harmful)),
        };
        canvas.fill_rounded(left, baseline - 11.0, (11.0, 11.0), 5.5, color);
        canvas.text((left + 19.0, baseline), HEADER_SIZE_PX, color, Align::Left, &words);
    }

    /// The meaning of colours, and the line through the time.
    fn draw_footer(&self, canvas: &mut Canvas, scene: &Scene, place: usize) {
        let top = (HEADER_PX + self.page.front_px.1) as f32;
        legend::draw_entries(canvas, scene, (MARGIN_PX as f32, top + 18.0), LEGEND_SIZE_PX);
        let first = top + LEGEND_PX as f32;
        self.draw_row(canvas, first, &self.is_harmful, palette::truth(Harm::Harmful));
        if let Some(predicted) = &self.is_predicted {
            let second = first + ROW_PX + ROW_GAP_PX;
            self.draw_row(canvas, second, predicted, palette::predicted(Harm::Harmful));
        }
        let x = self.x_of(place) + self.step() / 2.0;
        let low = first + 2.0 * ROW_PX + 2.0 * ROW_GAP_PX;
        canvas.line(&[(x, first - 2.0), (x, low)], Pen::solid(palette::TEXT, 2.0));
    }

    fn draw_row(&self, canvas: &mut Canvas, top: f32, is_marked: &[bool], color: Color) {
        let (left, right) = (self.x_of(0), self.x_of(self.len()));
        let band =
            |left: f32, right: f32| [(left, top), (right, top), (right, top + ROW_PX), (left, top + ROW_PX)];
        canvas.fill(&band(left, right), palette::WEDGE);
        for (place, _) in is_marked.iter().enumerate().filter(|(_, is_marked)| **is_marked) {
            canvas.fill(&band(self.x_of(place), self.x_of(place + 1)), color);
        }
    }

    fn step(&self) -> f32 {
        (self.page.width_px - 2 * MARGIN_PX) as f32 / self.len().max(1) as f32
    }

    fn x_of(&self, place: usize) -> f32 {
        MARGIN_PX as f32 + place as f32 * self.step()
    }
}

/// The names of what is harmful; `None` where nothing is.
fn harmful_names(viewed: &ViewedSample, harms: &[Harm]) -> Option<String> {
    let objects = viewed.sample.objects().iter().zip(harms);
    let harmful = objects.filter(|(_, harm)| **harm == Harm::Harmful).map(|(object, _)| {
        object.category.as_deref().map_or_else(|| "object".to_owned(), |name| name.replace('_', " "))
    });
    let names: Vec<String> = harmful.collect();
    let told = names.iter().take(MOST_NAMES).cloned().collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => None,
        n if n > MOST_NAMES => Some(format!("harmful: {told} and {} more", n - MOST_NAMES)),
        _ => Some(format!("harmful: {told}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_every_width_have_even_sides_and_room_for_both_views() {
        for width_px in (WIDTHS_PX.0..=WIDTHS_PX.1).step_by(2) {
            let page = FilmPage::of_width(width_px);
            assert_eq!(page.height_px() % 2, 0, "{width_px}");
            assert!(page.birdseye_width_px > 150, "{width_px}");
            assert!(page.front_px.0 + page.birdseye_width_px + 3 * MARGIN_PX == width_px);
        }
        let page = FilmPage::of_width(1280);
        assert_eq!((page.front_px, page.height_px()), ((725, 408), 498));
    }
}
