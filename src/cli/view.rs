//! `harmzone view`: one sample as a picture; an episode as a clip, or as a file for Foxglove or Rerun.

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};
use serde_json::json;

use super::{Bar, ExitStatus, number, path_text, print};
use crate::infer::Trained;
use crate::report::view::{
    self, ClipRequest, EpisodeRequest, EpisodeView, Moment, ViewRequest, WIDTHS_PX, write_episode_clip,
    write_episode_mcap, write_episode_rrd,
};
use crate::store::{Access, Location};

/// Lowest score of the predictions that are drawn, of networks without a score of their own.
const DEFAULT_MIN_SCORE: f32 = 0.3;

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("what").required(true).multiple(true).args(["out", "mcap", "rrd", "video"]))]
pub struct ViewArgs {
    /// The data set's folder or URL
    dataset: Location,
    /// Number of the sample of --out, counted from 0 through all episodes
    #[arg(long, value_name = "K", value_parser = number(0..=usize::MAX), requires = "out")]
    sample: Option<usize>,
    /// Episode of --mcap, --rrd and --video [default: the first]
    #[arg(long, value_name = "NAME")]
    episode: Option<String>,
    /// Label set to draw [default: rect, where it is there]
    #[arg(long, value_name = "SET")]
    labels: Option<String>,
    /// Predictions to draw: a folder or URL with a file for each episode, a run's folder, or `small` for those of the
    /// network inside the program
    #[arg(long, value_name = "DIR")]
    predictions: Option<Location>,
    /// Leave out predictions below this score, 0 to 1; default the score that `calibrate` left in the network that
    /// --predictions names, else 0.3
    #[arg(long, value_name = "SCORE", value_parser = number(0.0..=1.0_f32))]
    min_score: Option<f32>,
    /// Write a picture of one sample
    #[arg(long, value_name = "PNG", requires = "sample")]
    out: Option<PathBuf>,
    /// Write one file of an episode, its labels and predictions, with drawings of all of it, for Foxglove
    /// (`harmzone foxglove-layout`; docs/look.md)
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Write a recording of an episode for Rerun; needs a Python with rerun-sdk (docs/look.md)
    #[arg(long, value_name = "FILE")]
    rrd: Option<PathBuf>,
    /// Write a clip of an episode at its true rate: `.mp4`, `.gif`, or a folder of pictures
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// First sample of --video: its number in the episode, or seconds such as 3.5s [default: the first]
    #[arg(long, value_name = "K", requires = "video")]
    from: Option<Moment>,
    /// End of --video, which is no part of it, as --from [default: the episode's end]
    #[arg(long, value_name = "K", requires = "video")]
    to: Option<Moment>,
    /// Width of --video in pixels [default: 1280, or 800 for a GIF]
    #[arg(long, value_name = "PX", value_parser = number(WIDTHS_PX.0..=WIDTHS_PX.1), requires = "video")]
    width: Option<u32>,
    /// Replace what exists
    #[arg(long)]
    force: bool,
    /// Print what was written as JSON, a line each
    #[arg(long)]
    json: bool,
}

pub fn run(args: ViewArgs) -> anyhow::Result<ExitStatus> {
    let (label_set, force) = (args.labels, args.force);
    let dataset = args.dataset.open(Access::Read)?.path().to_owned();
    let opened = args.predictions.map(|folder| folder.open(Access::Read)).transpose()?;
    let predictions = opened.map(|folder| folder.path().to_owned());
    // A folder needs no checkpoint; a name has one folder in each dataset.
    let network = predictions.as_deref().and_then(|folder| Trained::find(folder).ok());
    let predictions = predictions.map(|folder| match &network {
        Some(shipped @ Trained::Shipped(_)) => shipped.predictions_folder(&dataset),
        _ => Ok(folder),
    });
    let predictions = predictions.transpose()?;
    let min_score = match (args.min_score, network) {
        (None, Some(network)) => network.operating_score()?.map(|own| own.score as f32),
        (given, _) => given,
    };
    let min_score = min_score.unwrap_or(DEFAULT_MIN_SCORE);
    if let Some((sample, out)) = args.sample.zip(args.out) {
        let (dataset, label_set) = (dataset.clone(), label_set.clone());
        let predictions = predictions.clone();
        draw(&ViewRequest { dataset, sample, label_set, predictions, min_score, out, force }, args.json)?;
    }
    if args.mcap.is_none() && args.rrd.is_none() && args.video.is_none() {
        return Ok(ExitStatus::Done);
    }
    let request = EpisodeRequest { dataset, episode: args.episode, label_set, predictions, min_score };
    let view = EpisodeView::open(&request)?;
    if let Some(mcap) = args.mcap {
        write_episode_mcap(&view, &mcap, force, &Bar::default())?;
        tell_file(&mcap, &view, args.json)?;
    }
    if let Some(rrd) = args.rrd {
        write_episode_rrd(&view, &rrd, force, &Bar::default())?;
        tell_file(&rrd, &view, args.json)?;
    }
    if let Some(out) = args.video {
        let request = ClipRequest { out, from: args.from, to: args.to, width_px: args.width, force };
        let clip = write_episode_clip(&view, &request, &Bar::default())?;
        let words = format!(
            "{}: {} pictures of {} x {}, {:.1} s of {}",
            clip.out.display(),
            clip.n_pictures,
            clip.size_px.0,
            clip.size_px.1,
            clip.seconds,
            clip.episode
        );
        let json = json!({
            "file": path_text(&clip.out),
            "episode": clip.episode,
            "n_pictures": clip.n_pictures,
            "size_px": clip.size_px,
            "seconds": clip.seconds,
        });
        print_line(words, &json, args.json)?;
    }
    Ok(ExitStatus::Done)
}

/// What was written: words, or JSON on one line.
fn print_line(words: String, json: &serde_json::Value, as_json: bool) -> anyhow::Result<()> {
    print(if as_json { json.to_string() } else { words })
}

fn tell_file(path: &Path, view: &EpisodeView, as_json: bool) -> anyhow::Result<()> {
    let words = format!("{}: {} samples of {}", path.display(), view.n_samples(), view.name());
    print_line(
        words,
        &json!({"file": path_text(path), "episode": view.name(), "n_samples": view.n_samples()}),
        as_json,
    )
}

fn draw(request: &ViewRequest, as_json: bool) -> anyhow::Result<()> {
    let summary = view::run(request)?;
    let objects = match (summary.n_objects, summary.n_harmful) {
        (None, _) => "no truth".to_owned(),
        (Some(n_objects), None) => format!("{n_objects} objects, no labels"),
        (Some(n_objects), Some(n_harmful)) => format!("{n_objects} objects, {n_harmful} harmful"),
    };
    let words =
        format!("{}: sample {} of {}, {objects}", summary.out.display(), summary.sample_idx, summary.episode);
    let json = json!({
        "file": path_text(&summary.out),
        "episode": summary.episode,
        "sample": summary.sample_idx,
        "n_objects": summary.n_objects,
        "n_harmful": summary.n_harmful,
    });
    print_line(words, &json, as_json)
}
