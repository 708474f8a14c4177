//! Pictures of a sweep: one frame at several states, and an object of each kind out of distribution.

use std::collections::BTreeMap;

use image::RgbImage;

use super::SweepReportError;
use crate::dataset::LabelledSample;
use crate::eval::sweep::{Change, Series, SweepConfig, Swept};
use crate::geometry::Point2;
use crate::object::{Detection, Harm};
use crate::report::view::{self, Scene, StatePanel, draw_states};
use crate::sample::{EgoState, Sample, Truth};
use crate::zone::Zone;

/// Names of one frame's pictures.
pub const FRAME_SPEED: &str = "frame_speed.png";
pub const FRAME_STEERING: &str = "frame_steering.png";
/// Name of the folder of pictures by kind.
pub const KINDS: &str = "kinds";

/// Pictures by their names in the folder.
type Named = Vec<(String, RgbImage)>;

/// Draws all of them.
///
/// # Errors
/// A state is not valid, or an image cannot be unpacked.
pub fn draw_all(
    swept: &Swept<'_>,
    zone: &Zone,
    config: &SweepConfig,
    series: &[Series<'_>],
) -> Result<Named, SweepReportError> {
    let mut pictures = Vec::new();
    for Series { frame, change, values, found } in series {
        let name = if *change == Change::SpeedMps { FRAME_SPEED } else { FRAME_STEERING };
        let picture = draw_frame(frame, zone, *change, values, found, config.picture_min_score)?;
        pictures.push((name.to_owned(), picture));
    }
    for (category, frame_idx) in best_seen(swept.frames()) {
        let found = shown(swept.recorded(frame_idx), config.picture_min_score);
        let picture = draw_kind(&swept.frames()[frame_idx], zone, &found)?;
        pictures.push((format!("{KINDS}/{category}.png"), picture));
    }
    Ok(pictures)
}

/// The boxes that are drawn: for each query only the better class.
fn shown(found: &[Detection], min_score: f32) -> Vec<Detection> {
    let mut shown: Vec<Detection> = Vec::new();
    for detection in found.iter().filter(|detection| detection.score >= f64::from(min_score)) {
        if !shown.iter().any(|better| better.box_in_ego == detection.box_in_ego) {
            shown.push(*detection);
        }
    }
    shown
}

/// The zone at a state, and the labels of a frame's objects by it.
fn labels_at(
    frame: &LabelledSample,
    zone: &Zone,
    state: &EgoState,
) -> Result<(Vec<Point2>, Vec<Harm>), SweepReportError> {
    let fail = |source| SweepReportError::Zone { sample: frame.id.clone(), source };
    let area = zone.at(state).map_err(fail)?;
    let harms = frame.objects.iter().map(|object| {
        let verdict = area.harm_of_object(&object.truth).map_err(fail)?;
        Ok::<_, SweepReportError>(verdict.harm)
    });
    Ok((area.corners().to_vec(), harms.collect::<Result<_, _>>()?))
}

/// A sample of a frame at a state.
fn sample_at(frame: &LabelledSample, state: EgoState) -> Sample {
    let objects = frame.objects.iter().map(|object| object.truth.clone()).collect();
    let mut measured = frame.measured.clone();
    measured.ego_state = state;
    Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) }
}

/// Episode and place in it, from a frame's id.
fn place(frame: &LabelledSample) -> (&str, usize) {
    let (episode, idx) = frame.id.rsplit_once('/').unwrap_or((&frame.id, "0"));
    (episode, idx.parse().unwrap_or(0))
}

fn draw_frame(
    frame: &LabelledSample,
    zone: &Zone,
    change: Change,
    values: &[f64],
    found: &[Vec<Detection>],
    min_score: f32,
) -> Result<RgbImage, SweepReportError> {
    let (episode, sample_idx) = place(frame);
    let states: Vec<EgoState> = values.iter().map(|&value| change.apply(&frame.true_state, value)).collect();
    let samples: Vec<Sample> = states.iter().map(|&state| sample_at(frame, state)).collect();
    let labels = states.iter().map(|state| labels_at(frame, zone, state)).collect::<Result<Vec<_>, _>>()?;
    let found: Vec<_> = found.iter().map(|found| shown(found, min_score)).collect();
    let panels: Vec<StatePanel<'_>> = values
        .iter()
        .enumerate()
        .map(|(i, &value)| StatePanel {
            title: title(change, value),
            scene: Scene {
                episode,
                sample_idx,
                sample: &samples[i],
                harms: Some(&labels[i].1),
                zone: Some(&labels[i].0),
                detections: Some(&found[i]),
            },
        })
        .collect();
    Ok(draw_states(&panels))
}

fn title(change: Change, value: f64) -> String {
    match change {
        Change::SpeedMps => format!("{value} m/s"),
        Change::SteeringDeg if value == 0.0 => "straight".to_owned(),
        Change::SteeringDeg => format!("{}° {}", value.abs(), if value > 0.0 { "left" } else { "right" }),
        Change::SpeedFactor => format!("speed · {value}"),
        Change::SteeringOffsetDeg => format!("{value:+}°"),
    }
}

/// For each category out of distribution, the frame in which one of its objects shows the most pixels, if
/// any.
fn best_seen(frames: &[LabelledSample]) -> BTreeMap<&str, usize> {
    let mut best: BTreeMap<&str, (u32, usize)> = BTreeMap::new();
    for (frame_idx, frame) in frames.iter().enumerate() {
        let is_ood = |truth: &&crate::object::Object| truth.is_ood();
        for truth in frame.objects.iter().map(|object| &object.truth).filter(is_ood) {
            let (Some(category), Some(visible_px)) = (&truth.category, truth.visible_px) else { continue };
            let seen = best.entry(category).or_insert((0, frame_idx));
            if visible_px > seen.0 {
                *seen = (visible_px, frame_idx);
            }
        }
    }
    best.into_iter().map(|(category, (_, frame_idx))| (category, frame_idx)).collect()
}

fn draw_kind(frame: &LabelledSample, zone: &Zone, found: &[Detection]) -> Result<RgbImage, SweepReportError> {
    let (episode, sample_idx) = place(frame);
    let state = frame.true_state;
    let harms: Vec<Harm> = frame.objects.iter().map(|object| object.harm).collect();
    view::draw(&Scene {
        episode,
        sample_idx,
        sample: &sample_at(frame, state),
        harms: Some(&harms),
        zone: Some(&labels_at(frame, zone, &state)?.0),
        detections: Some(found),
    })
    .map_err(|source| SweepReportError::Image { sample: frame.id.clone(), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::object::Distribution;

    #[test]
    fn each_kind_is_shown_where_it_is_seen_best() {
        let mut dataset = test_data::dataset(3);
        for (frame_idx, px) in [(0, 50), (1, 900), (2, 400)] {
            let truth = &mut dataset.sample_mut(frame_idx).objects[2].truth;
            truth.category = Some("sofa".into());
            (truth.distribution, truth.visible_px) = (Some(Distribution::Ood), Some(px));
        }
        let best: Vec<_> = best_seen(dataset.samples()).into_iter().collect();
        assert_eq!(best, [("sofa", 1)]);
        let picture = draw_kind(&dataset.samples()[1], dataset.zone(), &[]).unwrap();
        assert_eq!(picture.dimensions(), view::SIZE_PX);
    }

    #[test]
    fn a_frame_at_three_speeds_has_three_panels_whose_zones_grow() {
        let dataset = test_data::dataset(1);
        let frame = &dataset.samples()[0];
        let values = [0.0, 7.0, 14.0];
        let found = vec![Vec::new(); 3];
        let picture = draw_frame(frame, dataset.zone(), Change::SpeedMps, &values, &found, 0.3).unwrap();
        let again = draw_frame(frame, dataset.zone(), Change::SpeedMps, &values, &found, 0.3).unwrap();
        assert!(picture == again);
        let third = picture.width() / 3;
        // The zone's edge is green.
        let n_green = |panel: u32| {
            let columns = panel * third..(panel + 1) * third;
            let pixels = columns.flat_map(|x| (60..560).map(move |y| (x, y)));
            let is_green = |p: [u8; 3]| p[1] > 150 && p[0] < 120 && p[2] < 160;
            pixels.filter(|&(x, y)| is_green(picture.get_pixel(x, y).0)).count()
        };
        assert!(n_green(0) < n_green(1) && n_green(1) < n_green(2), "{:?}", [0, 1, 2].map(n_green));
    }

    #[test]
    fn of_one_query_the_better_class_is_shown() {
        let found = |harm, score| Detection {
            box_in_ego: test_data::dataset(1).samples()[0].objects[0].truth.box_in_ego,
            velocity_in_ego_mps: [0.0; 2],
            harm,
            score,
            spread: None,
        };
        let shown = shown(&[found(Harm::Harmful, 0.5), found(Harm::Harmless, 0.4)], 0.3);
        assert_eq!(shown.iter().map(|d| d.harm).collect::<Vec<_>>(), [Harm::Harmful]);
    }
}
