//! The same frames with another speed or steering: does the harmful set follow the zone's, and which judge's
//! follows it best?

use std::io;

use fs_err as fs;

use super::{ReportError, Side, pictures};
use crate::eval::sweep::{Change, Sweeps};
use crate::report::document::{Block, Figure, Picture};
use crate::report::score_tables::to_words;
use crate::report::scores::SWEEPS_FILE;
use crate::report::sweeps::charts;
use crate::report::table::{Table, ap, number};

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
        let charts = Change::ALL.into_iter().flat_map(|change| charts::over(sweeps, change));
        let figures = charts.map(|chart| Figure::new(&chart)).collect::<Result<_, _>>()?;
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
            let name = path.file_stem().map(|name| to_words(&name.to_string_lossy())).unwrap_or_default();
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

fn table(sweeps: &Sweeps) -> Block {
    let rows = sweeps.curves.iter().flat_map(|curve| {
        curve.points.iter().map(|point| {
            let scores = &point.scores.total;
            vec![
                format!("{} {}", charts::title(curve.change), point.value).into(),
                charts::judge_name(curve.judge).into(),
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
    Block::Table(Table::new(head, rows.collect()))
}
