//! The worst of a driver's drives as strips of pictures: the last seconds before it hit something, braked for nothing, or was
//! stuck for good; and as a clip.

use std::ops::Range;
use std::path::Path;

use super::ReportError;
use super::pictures::{clip_of, jpeg};
use crate::episode::EpisodeReader;
use crate::eval::center_distance_m;
use crate::object::{Detection, Harm, Object};
use crate::outcome::{Case, DriveOutcome, DriveSummary, Origin, Source, Wrong, worst};
use crate::report::canvas::{Align, Canvas};
use crate::report::document::{Block, Picture};
use crate::report::palette;
use crate::report::score_tables::to_words;
use crate::report::view::{
    self, EpisodeRequest, EpisodeView, LabelledView, Scene, ViewError, read_detections,
};

/// Pictures of a strip, and samples from one to the next; of a drive that stood for seconds, so that it is seen how it came there.
const N_PICTURES: usize = 5;
const EVERY: usize = 2;
const EVERY_STUCK: usize = 5;
/// A clip begins and ends so long before and after the case, where the drive does not.
const CLIP_BEFORE_S: f64 = 6.0;
const CLIP_AFTER_S: f64 = 2.0;
/// The camera's picture and, below it, the view from above, pixels.
const FRONT_PX: (u32, u32) = (352, 198);
const BIRDSEYE_PX: (u32, u32) = (352, 240);
const TITLE_PX: u32 = 30;
/// A box so near is of the object, metres.
const ON_OBJECT_M: f64 = 3.0;
/// Boxes of a network whose score `drive.json` does not tell, an older one, are drawn from this on.
const OLD_MIN_SCORE: f64 = 0.2;

/// Strips of each driver's worst cases, as [`worst`] ranks them. Drives that were not recorded have no pictures.
pub fn worst_cases(folder: &Path, summary: &DriveSummary, most: usize) -> Result<Vec<Block>, ReportError> {
    let truth = summary.figures.iter().position(|of| of.who.source == Source::Truth);
    let mut blocks = Vec::new();
    for (i, (origin, outcomes)) in summary.origins.iter().zip(&summary.outcomes).enumerate() {
        if origin.who.source == Source::Blind || most == 0 {
            continue;
        }
        let truth = truth.filter(|&truth| truth != i).map(|truth| &summary.outcomes[truth][..]);
        let cases = worst(outcomes, truth, most);
        let recorded: Vec<&Case<'_>> = cases.iter().filter(|case| case.outcome.entry.is_some()).collect();
        let name = &origin.who.name;
        if recorded.len() < cases.len() {
            let n = cases.len() - recorded.len();
            let what = format!(
                "{name}: no pictures of {n} of its {} worst cases, which were not recorded",
                cases.len()
            );
            blocks.push(Block::absent(what, format!("harmzone drive WHO.. --out DIR --record-worst {most}")));
        }
        if recorded.is_empty() {
            continue;
        }
        blocks.push(Block::heading(&format!("Worst cases of {name}")));
        let pictures = recorded.into_iter().map(|case| strip(folder, origin, &summary.labels, case));
        blocks.push(Block::Pictures { pictures: pictures.collect::<Result<_, _>>()? });
    }
    if blocks.iter().any(|block| matches!(block, Block::Pictures { .. })) {
        let note = "The last seconds of each, to the right. Truth is thin (red harmful, blue harmless, dashed out of distribution), \
                    what the driver's detector told is thick (amber harmful, violet harmless), the zone is green, and a white light or \
                    ring marks what is hit. Below each, a clip from 6 s before it to 2 s after.";
        blocks.insert(0, Block::text(note));
    }
    Ok(blocks)
}

/// What the detector said of the object in one picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Said {
    Absent,
    NotSeen,
    Harmless,
    Harmful,
}

impl Said {
    fn of(object: Option<&Object>, found: &[Detection]) -> Self {
        let Some(object) = object else { return Self::Absent };
        let on_it = found
            .iter()
            .filter(|one| center_distance_m(&one.box_in_ego, &object.box_in_ego) < ON_OBJECT_M)
            .max_by(|a, b| {
                (a.harm == Harm::Harmful, a.score)
                    .partial_cmp(&(b.harm == Harm::Harmful, b.score))
                    .expect("scores are finite")
            });
        match on_it.map(|one| one.harm) {
            None => Self::NotSeen,
            Some(Harm::Harmless) => Self::Harmless,
            Some(Harm::Harmful) => Self::Harmful,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Absent => "not there yet",
            Self::NotSeen => "not seen",
            Self::Harmless => "called harmless",
            Self::Harmful => "called harmful",
        }
    }
}

/// The score from which on a driver's boxes counted.
fn counted_from(origin: &Origin) -> f32 {
    let of_old = if matches!(origin.who.source, Source::Network { .. }) { OLD_MIN_SCORE } else { 0.0 };
    origin.seen_from.or(origin.min_score).unwrap_or(of_old) as f32
}

fn strip(folder: &Path, origin: &Origin, labels: &str, case: &Case<'_>) -> Result<Picture, ReportError> {
    let dataset = folder.join(&origin.who.name);
    let entry = case.outcome.entry.as_ref().expect("only recorded drives are drawn");
    let reader = EpisodeReader::open_entry(&dataset, entry).map_err(ViewError::from)?;
    let times_s = seconds(reader.times_ns());
    let last = times_s.partition_point(|&at_s| at_s <= case.time_s + 1e-6).saturating_sub(1);
    let every = if case.what == Wrong::Stuck { EVERY_STUCK } else { EVERY };
    let first = last - every * (last / every).min(N_PICTURES - 1);
    let numbers: Vec<usize> = (first..=last).step_by(every).collect();
    let height_px = TITLE_PX + FRONT_PX.1 + BIRDSEYE_PX.1;
    let mut page = Canvas::new(numbers.len() as u32 * FRONT_PX.0, height_px, palette::PAGE);
    let mut said = Vec::new();
    for (i, &sample_idx) in numbers.iter().enumerate() {
        let LabelledView { sample, harms, zone } = LabelledView::read(&dataset, labels, entry, sample_idx)?;
        let predictions = dataset.join("predictions");
        let time_ns = sample.measured.time_ns;
        let found = read_detections(&predictions, &dataset, entry, time_ns, counted_from(origin))?;
        let hit = case.what.hit();
        let object = hit.and_then(|id| sample.objects().iter().find(|of| of.id.as_deref() == Some(id)));
        let of_object = Said::of(object, &found);
        said.push(of_object);
        let scene = Scene {
            episode: &entry.name,
            sample_idx,
            sample: &sample,
            harms: Some(&harms),
            zone: Some(&zone),
            detections: Some(&found),
        };
        let name = || format!("{}/{sample_idx}", entry.name);
        let focus = object.map(|object| &object.box_in_ego);
        let [front, above] = view::panels(&scene, focus, FRONT_PX, BIRDSEYE_PX)
            .map_err(|source| ReportError::Picture { source, sample: name() })?;
        let left_px = i as u32 * FRONT_PX.0;
        page.paste(&Canvas::from_rgb(&front), left_px as i32, TITLE_PX as i32);
        page.paste(&Canvas::from_rgb(&above), left_px as i32, (TITLE_PX + FRONT_PX.1) as i32);
        let before_s = case.time_s - times_s[sample_idx];
        let speed_mps = sample.measured.ego_state.speed_mps;
        let mut title = format!("{before_s:.1} s before, {speed_mps:.1} m/s");
        if hit.is_some() {
            title += &format!(": {}", of_object.name());
        }
        page.text((left_px as f32 + 8.0, 21.0), 15.0, palette::TEXT, Align::Left, &title);
    }
    let picture = page.into_rgb();
    let (width_px, height_px) = picture.dimensions();
    let data =
        jpeg(&picture).map_err(|source| ReportError::Picture { source, sample: entry.name.clone() })?;
    let view = EpisodeView::open(&EpisodeRequest {
        predictions: Some(dataset.join("predictions")),
        dataset,
        episode: Some(entry.name.clone()),
        label_set: Some(labels.to_owned()),
        min_score: counted_from(origin),
    })?;
    let clip = Some(clip_of(&view, filmed(&times_s, case.time_s))?);
    Ok(Picture { title: tell(case, &said), data, width_px, height_px, clip })
}

/// The samples of a clip; one at least.
fn filmed(times_s: &[f64], case_s: f64) -> Range<usize> {
    let last = times_s.len().saturating_sub(1);
    let begin = times_s.partition_point(|&at_s| at_s < case_s - CLIP_BEFORE_S).min(last);
    let end = times_s.partition_point(|&at_s| at_s <= case_s + CLIP_AFTER_S);
    begin..end.max(begin + 1)
}

/// Since the first.
fn seconds(times_ns: &[u64]) -> Vec<f64> {
    let first_ns = times_ns.first().copied().unwrap_or_default();
    times_ns.iter().map(|&time_ns| (time_ns - first_ns) as f64 / 1e9).collect()
}

/// The case in a line.
fn tell(case: &Case<'_>, said: &[Said]) -> String {
    let DriveOutcome { town, weather, episode, collision, hard_stops, .. } = case.outcome;
    let place = format!("{town}, {weather}; {episode}");
    if case.what == Wrong::Stuck {
        let DriveOutcome { distance_m, free_m, .. } = case.outcome;
        return format!(
            "Stuck, with nothing harmful before it, after {distance_m:.0} m of {free_m:.0} m. {place}"
        );
    }
    let Some(hit) = collision.as_ref().filter(|_| case.what.hit().is_some()) else {
        let stop = hard_stops.iter().find(|stop| stop.time_s == case.time_s);
        let braking = stop.map(|stop| format!(" at {:.1} m/s²", stop.braking_mps2)).unwrap_or_default();
        return format!("Brakes{braking} for nothing. {place}");
    };
    let mut text = format!("Hits {} at {:.1} m/s", to_words(&hit.category), hit.impact_mps);
    if let Some(set_off_s) = hit.set_off_s {
        let sudden = if hit.is_sudden { ", too late for any brake" } else { "" };
        text += &format!(", {set_off_s:.1} s after it was set off{sudden}");
    }
    let n_harmful = said.iter().filter(|&&said| said == Said::Harmful).count();
    text += &format!("; called harmful in {n_harmful} of {} pictures", said.len());
    match case.outcome.first_brake_ttc_s {
        None => text += ", never braked for",
        Some(ttc_s) => text += &format!(", first braked {ttc_s:.1} s away"),
    }
    format!("{text}. {place}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_has_the_seconds_around_the_case_and_one_picture_at_least() {
        let times_s: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.5).collect();
        assert_eq!(filmed(&times_s, 20.0), 28..45);
        assert_eq!(filmed(&times_s, 2.0), 0..9);
        assert_eq!(filmed(&times_s, 49.5), 87..100);
        assert_eq!(filmed(&[0.0], 8.0), 0..1, "it hits something before the next sample");
        assert_eq!(filmed(&[0.0, 10.0], 17.0), 1..2);
    }
}
