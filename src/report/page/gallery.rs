//! The worst misses and false alarms as cards with pictures, for a page that sorts and filters them.

use image::ImageError;
use rayon::prelude::*;

use super::pictures::jpeg;
use super::scored_data::NoData;
use super::{ReportError, Side};
use crate::eval::{Fault, FaultKind};
use crate::object::Distribution;
use crate::report::document::{Block, Card, Filter, Gallery};
use crate::report::score_tables::to_words;
use crate::report::scores::FAULTS_FILE;
use crate::report::table::number;
use crate::report::view::{self, Scene};

/// The camera's picture and the view from above, pixels; the camera's has the shape of the sensor's default.
const FRONT_PX: (u32, u32) = (576, 324);
const BIRDSEYE_PX: (u32, u32) = (324, 324);

/// The section's blocks; `most` cards of a kind and side.
pub fn blocks(sides: &[Side], most: usize) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    let mut cards = Vec::new();
    for side in sides {
        let Some(faults) = &side.scores.faults else {
            let what = format!("{}: no faults to show ({FAULTS_FILE})", side.name);
            blocks.push(Block::absent(what, side.command_of_scores()));
            continue;
        };
        if let Err(why) = &side.dataset {
            blocks.push(no_pictures(side, why));
        }
        let chosen: Vec<(usize, &Fault)> = FaultKind::ALL
            .into_iter()
            .flat_map(|kind| faults.iter().filter(move |fault| fault.kind == kind).take(most).enumerate())
            .collect();
        let of_side: Vec<Card> =
            chosen.into_par_iter().map(|(i, fault)| card(side, i + 1, fault)).collect::<Result<_, _>>()?;
        let n_without = of_side.iter().filter(|card| card.pictures.is_none()).count();
        if side.dataset.is_ok() && n_without > 0 {
            let what = format!(
                "{}: no pictures of {n_without} of {} faults, since their labels or episodes are not there",
                side.name,
                of_side.len()
            );
            blocks.push(Block::absent(what, side.command_with_data()));
        }
        cards.extend(of_side);
    }
    if cards.is_empty() {
        blocks.push(Block::text("There is no fault to show."));
        return Ok(blocks);
    }
    let note = "Misses: harmful objects that no harmful box found. False alarms: harmful boxes on anything else. An object \
                is shown once an episode, where it is worst: misses where the least room to stop is left, false alarms \
                where the score is highest. In the pictures truth is thin (red harmful, blue harmless, dashed out of \
                distribution), detections are thick (amber harmful, violet harmless), the zone is green, and a white \
                light or ring marks the fault.";
    blocks.insert(0, Block::text(note));
    blocks.push(Block::Gallery(Gallery { filters: filters(&cards), cards }));
    Ok(blocks)
}

/// Says why a side has no pictures at all, and what helps.
fn no_pictures(side: &Side, why: &NoData) -> Block {
    let (why, command) = match why {
        NoData::Unknown => ("the data set is not known or not there", side.command_with_data()),
        NoData::Changed => {
            ("the data set or its labels are not those that were scored", side.command_of_scores())
        }
        NoData::Unlabelled { path, labels } => {
            let command = format!("harmzone label {} --labels {labels}", path.display());
            ("the labels that were scored are not there", command)
        }
    };
    Block::absent(format!("{}: no pictures, since {why}", side.name), command)
}

fn filters(cards: &[Card]) -> Vec<Filter> {
    let names = [
        ("set", "Set"),
        ("kind", "Fault"),
        ("object", "Object"),
        ("family", "Family"),
        ("town", "Town"),
        ("weather", "Weather"),
    ];
    let with_options = names.into_iter().enumerate().map(|(i, (key, name))| {
        let mut values: Vec<&str> = cards.iter().map(|card| card.choices[i].1.as_str()).collect();
        // Sets and kinds stay in the order of the cards, which has a meaning.
        if i > 1 {
            values.sort_unstable();
        }
        let mut options: Vec<String> = Vec::new();
        for value in values {
            if !value.is_empty() && !options.iter().any(|option| option == value) {
                options.push(value.to_owned());
            }
        }
        Filter { key, name, options }
    });
    with_options.filter(|filter| filter.options.len() > 1).collect()
}

fn kind_name(kind: FaultKind) -> &'static str {
    match kind {
        FaultKind::NotSeen => "missed: not seen",
        FaultKind::CalledHarmless => "missed: called harmless",
        FaultKind::CalledHarmful => "false alarm: harmless object",
        FaultKind::NothingThere => "false alarm: nothing there",
    }
}

fn card(side: &Side, rank: usize, fault: &Fault) -> Result<Card, ReportError> {
    let family = fault.object.as_ref().and_then(|object| object.truth.category.as_deref()).map(to_words);
    let distribution = fault.object.as_ref().and_then(|object| object.truth.distribution);
    let object = match distribution {
        Some(Distribution::Id) => "in distribution",
        Some(Distribution::Ood) => "out of distribution",
        None => "",
    };
    let title = family
        .clone()
        .unwrap_or_else(|| if fault.object.is_some() { "object".to_owned() } else { "nothing".to_owned() });
    let text = |value: &Option<String>| value.clone().unwrap_or_default();
    Ok(Card {
        kind: kind_name(fault.kind),
        is_miss: fault.kind.is_miss(),
        sample: fault.sample.clone(),
        facts: facts(fault),
        choices: vec![
            ("set", side.name.to_owned()),
            ("kind", kind_name(fault.kind).to_owned()),
            ("object", object.to_owned()),
            ("family", family.unwrap_or_default()),
            ("town", text(&fault.facts.town)),
            ("weather", text(&fault.facts.weather)),
        ],
        rank,
        score: fault.score,
        range_m: fault.range_m,
        margin_m: fault.stopping_margin_m,
        speed_mps: fault.facts.speed_mps,
        n_samples: fault.n_samples,
        pictures: pictures(side, fault)?,
        title,
    })
}

fn facts(fault: &Fault) -> Vec<String> {
    let mut facts = vec![format!("{:.1} m away", fault.range_m)];
    let of_miss = fault.kind.is_miss();
    facts.extend(match (of_miss, fault.score) {
        (true, None) => Some("no harmful box on it".to_owned()),
        (true, score) => Some(format!("best harmful score {}", number(score, 2))),
        (false, score) => Some(format!("score {}", number(score, 2))),
    });
    facts.extend(fault.facts.speed_mps.map(|speed_mps| format!("ego {} m/s", number(Some(speed_mps), 1))));
    facts.extend(fault.stopping_margin_m.map(|margin_m| format!("room to stop {margin_m:+.1} m")));
    facts.extend(fault.zone_distance_m.map(|distance_m| format!("zone's edge {distance_m:+.2} m")));
    if let Some(object) = &fault.object {
        facts.extend(object.truth.n_lidar_points.map(|n| format!("{n} LiDAR points")));
        facts.extend(object.truth.visible_fraction.map(|share| format!("{:.0} % visible", 100.0 * share)));
    }
    if fault.n_samples > 1 {
        facts.push(format!("in {} samples of the episode", fault.n_samples));
    }
    facts.extend(fault.facts.weather.clone());
    facts
}

/// `None` if the sample or its labels are not in the side's data set.
fn pictures(side: &Side, fault: &Fault) -> Result<Option<[String; 2]>, ReportError> {
    let Ok(dataset) = &side.dataset else { return Ok(None) };
    let Some((episode, sample_idx)) = fault.sample.rsplit_once('/') else { return Ok(None) };
    let entry = dataset.manifest.episodes.iter().find(|entry| entry.name == episode);
    let (Some(entry), Ok(sample_idx)) = (entry, sample_idx.parse()) else { return Ok(None) };
    let Some(labelled) = dataset.read(entry, sample_idx)? else { return Ok(None) };
    let scene = Scene {
        episode,
        sample_idx,
        sample: &labelled.sample,
        harms: Some(&labelled.harms),
        zone: Some(&labelled.zone),
        detections: Some(&fault.detections),
    };
    let picture = |source: ImageError| ReportError::Picture { source, sample: fault.sample.clone() };
    let [front, birdseye] =
        view::panels(&scene, Some(&fault.place), FRONT_PX, BIRDSEYE_PX).map_err(picture)?;
    Ok(Some([jpeg(&front).map_err(picture)?, jpeg(&birdseye).map_err(picture)?]))
}
