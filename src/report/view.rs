//! One sample as a picture, or an episode as a clip or as a file for viewers: the camera with zone and boxes on the left, the LiDAR from above on the right.
//!
//! Truth is drawn thin (red harmful, blue harmless, dashed when out of distribution), predictions thick in
//! their own tones with the score, the danger zone green on the ground.

pub(super) mod birdseye;
mod clip;
mod episode_view;
mod film;
pub(super) mod front;
mod legend;
pub(super) mod load;
mod merged_file;
mod moment;
mod rerun_file;
mod rerun_process;
mod states;

pub use clip::{ClipRequest, ClipSummary, write_episode_clip};
pub use episode_view::{EpisodeRequest, EpisodeView, ViewedSample};
pub use film::{Film, WIDTHS_PX};
pub(in crate::report) use load::read_detections;
pub use load::{LabelledView, ViewError, ViewRequest, ViewSummary, run};
pub use merged_file::write_episode_mcap;
pub use moment::{Moment, MomentError};
pub use rerun_file::write_episode_rrd;
pub use rerun_process::RerunError;
pub use states::{StatePanel, draw_states};

use image::RgbImage;

use super::canvas::{self, Canvas, Color, Pen};
use super::palette;
use crate::geometry::{Box3, Ego, Point2};
use crate::object::{Detection, Harm};
use crate::sample::Sample;

/// Size of the picture, pixels.
pub const SIZE_PX: (u32, u32) = (1600, 620);

const MARGIN_PX: u32 = 16;
const TITLE_PX: u32 = 60;
const FRONT_PX: (u32, u32) = (896, 504);
const BIRDSEYE_PX: (u32, u32) = (656, 504);

/// The content of the picture.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The episode's name, for the title.
    pub episode: &'a str,
    /// The sample's place in its episode, for the title.
    pub sample_idx: usize,
    pub sample: &'a Sample,
    /// One label for each of the sample's true objects, in their order; `None` draws them grey.
    pub harms: Option<&'a [Harm]>,
    /// Corners of the danger zone in the ego frame, metres.
    pub zone: Option<&'a [Point2]>,
    pub detections: Option<&'a [Detection]>,
}

/// The two panels alone, in their sizes: the camera's picture, and the view from above. `focus` is marked, by
/// a light around it in the one and by a ring in the other.
///
/// # Errors
/// The sample's camera image cannot be unpacked.
pub fn panels(
    scene: &Scene,
    focus: Option<&Box3<Ego>>,
    front_px: (u32, u32),
    birdseye_px: (u32, u32),
) -> Result<[RgbImage; 2], image::ImageError> {
    let (measured, areas, mut marks) = (&scene.sample.measured, scene.areas(), scene.marks());
    let mut birdseye = birdseye::draw(measured, &areas, &marks, birdseye_px.0, birdseye_px.1);
    if let Some(focus) = focus {
        birdseye::point_at(&mut birdseye, focus);
        // Drawn first, so that it lies below the lines of its own box.
        marks.insert(0, Mark { box_in_ego: *focus, pen: FOCUS, tag: None });
    }
    let front = front::draw(measured, &areas, &marks, front_px.0, front_px.1)?;
    Ok([front.into_rgb(), birdseye.into_rgb()])
}

/// Draws a sample, [`SIZE_PX`] large.
///
/// # Errors
/// The sample's camera image cannot be unpacked.
pub fn draw(scene: &Scene) -> Result<RgbImage, image::ImageError> {
    let mut page = Canvas::new(SIZE_PX.0, SIZE_PX.1, palette::PAGE);
    let (measured, areas, marks) = (&scene.sample.measured, scene.areas(), scene.marks());
    let front = front::draw(measured, &areas, &marks, FRONT_PX.0, FRONT_PX.1)?;
    let birdseye = birdseye::draw(measured, &areas, &marks, BIRDSEYE_PX.0, BIRDSEYE_PX.1);
    page.paste(&front, MARGIN_PX as i32, TITLE_PX as i32);
    page.paste(&birdseye, (2 * MARGIN_PX + FRONT_PX.0) as i32, TITLE_PX as i32);
    legend::draw_title(&mut page, scene);
    legend::draw_legend(&mut page, scene, (TITLE_PX + FRONT_PX.1) as f32);
    Ok(page.into_rgb())
}

/// Words on a coloured ground.
const INK: Color = Color::new(0x000c_0f14);

/// The light around the marked box.
const FOCUS: Pen = Pen::solid(palette::TEXT, 6.0);

/// A box to draw: where, with which pen, and what to write on it.
pub struct Mark {
    pub box_in_ego: Box3<Ego>,
    pub pen: Pen,
    pub tag: Option<String>,
}

/// Ground to draw: its outline in the ego frame, metres, and how opaque its inside is.
pub struct Area<'a> {
    pub corners: &'a [Point2],
    pub color: Color,
    pub fill: f32,
}

impl Scene<'_> {
    fn areas(&self) -> Vec<Area<'_>> {
        self.zone.map(|corners| Area { corners, color: palette::ZONE, fill: 0.20 }).into_iter().collect()
    }

    /// Every box: truth first, predictions over it.
    fn marks(&self) -> Vec<Mark> {
        let truths = self.sample.objects().iter().enumerate().map(|(i, object)| {
            let harm = self.harms.and_then(|harms| harms.get(i).copied());
            let color = harm.map_or(palette::UNLABELLED, palette::truth);
            let is_ood = object.is_ood();
            let is_worth_a_name = self.detections.is_none() && (is_ood || harm == Some(Harm::Harmful));
            Mark {
                box_in_ego: object.box_in_ego,
                pen: Pen { color, width_px: 1.5, is_dashed: is_ood },
                tag: object.category.as_ref().filter(|_| is_worth_a_name).map(|name| name.replace('_', " ")),
            }
        });
        let predictions = self.detections.unwrap_or_default().iter().map(|detection| Mark {
            box_in_ego: detection.box_in_ego,
            pen: Pen::solid(palette::predicted(detection.harm), 2.6),
            tag: Some(format!("{:.2}", detection.score)),
        });
        truths.chain(predictions).collect()
    }
}

#[cfg(test)]
mod tests;
