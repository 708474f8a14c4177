//! The same frames with another speed or steering: does the harmful set follow the zone's, and whose does so better?

use std::io;

use fs_err as fs;

use super::groups::spoken;
use super::model::{Block, Figure, Table, ap, number};
use super::pictures::{self, Picture};
use super::plot::{Axis, Chart, Look, Series, Tone};
use super::scores::SWEEPS_FILE;
use super::{ReportError, Side};
use crate::eval::judge::Judge;
use crate::eval::sweep::{Change, SweepCurve, SweepPoint, Sweeps};

/// A title, and the axis below.
fn named(change: Change) -> (&'static str, &'static str) {
    match change {
        Change::SpeedMps => ("Speed set to", "speed of every frame, m/s"),
        Change::SteeringDeg => ("Steering set to", "steering of every frame, degrees, left positive"),
        Change::SpeedFactor => ("Speed sensor errs", "measured speed over the true one"),
        Change::SteeringOffsetDeg => ("Steering sensor errs", "measured steering less the true one, degrees"),
    }
}

/// A judge as a person names it, and its line.
fn line(judge: Judge) -> (&'static str, Tone, Look) {
    match judge {
        Judge::Network => ("the network", Tone::Harmful, Look::LineAndDots),
        Judge::Zone => ("zone over its boxes", Tone::Harmless, Look::LineAndDots),
        Judge::ZoneSoft => ("zone over its boxes, soft", Tone::Harmless, Look::Dashed),
        Judge::SpeedZone => ("zone by speed alone", Tone::Green, Look::LineAndDots),
        Judge::SpeedZoneSoft => ("zone by speed alone, soft", Tone::Green, Look::Dashed),
    }
}

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let Some(sweeps) = &side.scores.sweeps else {
            let what = format!("{}: no sweeps of speed and steering ({SWEEPS_FILE})", side.name);
            let command = format!("harmzone sweep RUN --data DIR --out {}", side.scores.folder.display());
            blocks.push(Block::absent(what, command));
            continue;
        };
        blocks.push(Block::heading(side.name));
        let mut figures = Vec::new();
        for change in Change::ALL {
            let curves: Vec<&SweepCurve> =
                sweeps.curves.iter().filter(|curve| curve.change == change).collect();
            if curves.iter().all(|curve| curve.points.is_empty()) {
                continue;
            }
            let (title, _) = named(change);
            if change.moves_truth() {
                figures.push(harmful(sweeps, &curves, change)?);
                let chart = chart(&curves, change, "IoU of the harmful sets", |point| point.set_iou);
                figures.push(Figure::new(format!("{title}: agreement of the harmful sets"), &chart)?);
            }
            let chart = chart(&curves, change, "mAP", |point| Some(point.scores.total.mean));
            figures.push(Figure::new(format!("{title}: mAP"), &chart)?);
        }
        blocks.push(Block::Figures { figures });
        blocks.push(Block::text(
            "Where speed or steering is set, the truth is the zone of that speed and steering. Where a sensor errs, the \
             labels stay as they are.",
        ));
        blocks.push(Block::fold("As a table", vec![table(sweeps)]));
        blocks.extend(pictures(side)?);
    }
    Ok(blocks)
}

/// What `harmzone sweep` drew beside its figures.
fn pictures(side: &Side) -> Result<Vec<Block>, ReportError> {
    let folder = &side.scores.folder;
    let mut frames = Vec::new();
    for (file, title) in [
        ("frame_speed.png", "The frame of which most objects change sides with the speed"),
        ("frame_steering.png", "The frame of which most objects change sides with the steering"),
    ] {
        frames.extend(pictures::of_file(&folder.join(file), title)?);
    }
    let mut kinds = Vec::new();
    let folder = folder.join("kinds");
    if folder.is_dir() {
        let found = fs::read_dir(&folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>();
        let mut found = found?;
        found.sort();
        for path in found.iter().filter(|path| path.extension().is_some_and(|ending| ending == "png")) {
            let name = path.file_stem().map(|name| spoken(&name.to_string_lossy())).unwrap_or_default();
            kinds.extend(pictures::of_file(path, &name)?);
        }
    }
    let fold = |title: &str, pictures: Vec<Picture>| {
        (!pictures.is_empty()).then(|| Block::fold(title, vec![Block::Pictures { pictures }]))
    };
    let titles = ["One frame at several states, in pictures", "Each kind out of distribution, in pictures"];
    Ok(titles
        .into_iter()
        .zip([frames, kinds])
        .filter_map(|(title, pictures)| fold(title, pictures))
        .collect())
}

/// A line for each judge, from 0 to 1.
fn chart(
    curves: &[&SweepCurve],
    change: Change,
    y_name: &str,
    y: impl Fn(&SweepPoint) -> Option<f64>,
) -> Chart {
    let series = curves.iter().map(|curve| {
        let (name, tone, look) = line(curve.judge);
        let points = curve.points.iter().filter_map(|point| Some((point.value, y(point)?))).collect();
        Series { name: name.to_owned(), tone, look, points }
    });
    let values = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.value);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    Chart {
        x: Axis::over(named(change).1, low, high),
        y: Axis::share(y_name),
        series: series.collect(),
        height_px: 340,
    }
}

/// How many objects are harmful and called so.
fn harmful(sweeps: &Sweeps, curves: &[&SweepCurve], change: Change) -> Result<Figure, ReportError> {
    let a_frame = |n: usize| n as f64 / sweeps.n_samples.max(1) as f64;
    let mut chart = chart(curves, change, "", |point| Some(a_frame(point.n_called_harmful)));
    let truth = curves.first().map_or(&[][..], |curve| &curve.points);
    chart.series.insert(
        0,
        Series {
            name: "truth".to_owned(),
            tone: Tone::Ink,
            look: Look::Dashed,
            points: truth.iter().map(|point| (point.value, a_frame(point.n_harmful))).collect(),
        },
    );
    let most = chart.series.iter().flat_map(|series| &series.points).map(|point| point.1).fold(0.0, f64::max);
    chart.y = Axis::over("harmful objects a frame", 0.0, 1.08 * most);
    Figure::new(format!("{}: the harmful set", named(change).0), &chart)
}

fn table(sweeps: &Sweeps) -> Block {
    let rows = sweeps.curves.iter().flat_map(|curve| {
        curve.points.iter().map(|point| {
            let scores = &point.scores.total;
            vec![
                format!("{} {}", named(curve.change).0, point.value).into(),
                line(curve.judge).0.into(),
                point.n_harmful.to_string().into(),
                point.n_called_harmful.to_string().into(),
                number(point.set_iou, 3).into(),
                ap(scores.harmful).into(),
                ap(scores.harmless).into(),
                ap(scores.mean).into(),
            ]
        })
    });
    let head = ["value", "judge", "harmful", "called harmful", "IoU", "AP harmful", "AP harmless", "mAP"];
    Block::Table(Table::new(&head, rows.collect()))
}
