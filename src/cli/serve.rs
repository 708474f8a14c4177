//! `harmzone serve`: a folder's episodes, scores and reports in the browser of this machine.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Bar, ExitStatus, number, path_text, print};
use crate::serve::{Server, SetOptions};

#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Folder with data sets, predictions, scores and reports, in it or below; nothing outside it is read
    folder: PathBuf,
    /// Port of the loopback, 127.0.0.1; 0 takes a free one
    #[arg(long, value_name = "PORT", default_value_t = 0, value_parser = number(0..=u16::MAX))]
    port: u16,
    /// Label set to show [default: rect, or the first where that is not there]
    #[arg(long, value_name = "SET")]
    labels: Option<String>,
    /// Leave out boxes below this score, 0 to 1; default the score that `calibrate` left in the network, else that of
    /// `eval`
    #[arg(long, value_name = "SCORE", value_parser = number(0.0..=1.0_f64))]
    min_score: Option<f64>,
    /// Print the URL as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: ServeArgs) -> anyhow::Result<ExitStatus> {
    let ServeArgs { folder, port, labels, min_score, json } = args;
    let server = Server::open(&folder, port, &SetOptions { labels, min_score })?;
    if json {
        print(json!({
            "url": server.url(),
            "port": server.port(),
            "folder": path_text(server.folder()),
            "n_episodes": server.n_episodes(),
        }))?;
    } else {
        print(format!("{}\n{} episodes, until Ctrl-C", server.url(), server.n_episodes()))?;
    }
    server.run(&Bar::default())?;
    Ok(ExitStatus::Done)
}
