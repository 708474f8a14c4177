//! An episode, its labels and predictions as one file for viewers, in the pictures' colours.

use std::path::Path;

use super::clip::make_room;
use super::episode_view::EpisodeView;
use super::load::ViewError;
use super::{INK, palette};
use crate::episode::merged::{MergeSources, MergedLook, write_merged};
use crate::object::Harm;
use crate::progress::Progress;

/// Writes the file that the layout of [`crate::report::foxglove_layout()`] shows.
///
/// # Errors
/// A file is there already and no `force`, or a broken file.
pub fn write_episode_mcap(
    view: &EpisodeView,
    out: &Path,
    force: bool,
    progress: &dyn Progress,
) -> Result<(), ViewError> {
    make_room(out, force)?;
    let sources = MergeSources {
        episode: &view.episode,
        labels: view.labels.as_ref(),
        detections: view.detections.as_ref(),
    };
    let look = MergedLook {
        harmful: palette::truth(Harm::Harmful).rgb,
        harmless: palette::truth(Harm::Harmless).rgb,
        unlabelled: palette::UNLABELLED.rgb,
        predicted_harmful: palette::predicted(Harm::Harmful).rgb,
        predicted_harmless: palette::predicted(Harm::Harmless).rgb,
        zone: palette::ZONE.rgb,
        ink: INK.rgb,
        text: palette::TEXT.rgb,
        min_score: view.min_score,
    };
    write_merged(out, sources, &look, progress)?;
    Ok(())
}
