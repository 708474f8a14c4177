//! `harmzone report`: one HTML file from the scores of both data sets.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use serde_json::json;

use super::{ExitStatus, command_line, number, path_text, print_either, tell};
use crate::report::page::{self, ReportRequest, ScoresRequest};

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("scores").args(["id", "ood", "drives"]).required(true).multiple(true))]
pub struct ReportArgs {
    /// The page to write: a name that ends in .html, or a folder, which gets report.html
    out: PathBuf,
    /// Scores in distribution: what `harmzone eval RUN --data DIR --out SCORES` wrote
    #[arg(long, value_name = "SCORES")]
    id: Option<PathBuf>,
    /// Scores out of distribution, of `harmzone eval .. --ood`
    #[arg(long, value_name = "SCORES")]
    ood: Option<PathBuf>,
    /// Data set of the scores --id, for pictures [default: the one that was scored, if it still is there]
    #[arg(long, value_name = "DIR", requires = "id")]
    id_data: Option<PathBuf>,
    /// Data set of the scores --ood
    #[arg(long, value_name = "DIR", requires = "ood")]
    ood_data: Option<PathBuf>,
    /// Ablations and rivals: results.json of `make results`
    #[arg(long, value_name = "JSON")]
    results: Option<PathBuf>,
    /// Closed-loop drives: what `harmzone drive WHO.. --out DIR` wrote
    #[arg(long, value_name = "DIR")]
    drives: Option<PathBuf>,
    /// Pictures of each kind of fault in each data set, at most
    #[arg(long, value_name = "N", default_value_t = page::DEFAULT_CARDS, value_parser = number(0..=usize::MAX))]
    cards: usize,
    /// Replace the page if it exists
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: ReportArgs) -> anyhow::Result<ExitStatus> {
    let scores = |folder: Option<PathBuf>, data| folder.map(|folder| ScoresRequest { folder, data });
    let summary = page::run(&ReportRequest {
        out: args.out,
        id: scores(args.id, args.id_data),
        ood: scores(args.ood, args.ood_data),
        results: args.results,
        drives: args.drives,
        n_cards: args.cards,
        command: command_line("harmzone"),
        force: args.force,
    })?;
    for absent in &summary.absent {
        tell(format!("left out: {absent}"));
    }
    let size_mb = summary.bytes as f64 / 1e6;
    let words = format!("{}: {} cards, {size_mb:.1} MB", summary.out.display(), summary.n_cards);
    let json = json!({
        "page": path_text(&summary.out),
        "n_cards": summary.n_cards,
        "bytes": summary.bytes,
        "left_out": summary.absent,
        "is_whole": summary.is_whole,
    });
    print_either(words, &json, args.json)?;
    Ok(if summary.is_whole { ExitStatus::Done } else { ExitStatus::DoneWithLosses })
}
