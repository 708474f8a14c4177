//! `xtask results`: an experiment from nothing, resumable; what `make results` runs.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use clap::Args;

use crate::results::{self, ReportStamp, Request, ResultsConfig};
use harmzone::cli::{Bar, DeviceArg, ExitStatus, command_line, print};
use harmzone::report::page::PAGE_FILE;

#[derive(Debug, Args)]
pub struct ResultsArgs {
    /// Folder of the experiment: data, runs, scores, results.json, results.csv, RESULTS.md, report.html. The same
    /// command again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Rows and tables (TOML); `configs/results.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. preset=demo
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Data set to train and validate on [default: made in the experiment's folder]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Data set with unfamiliar objects [default: made in the experiment's folder]
    #[arg(long, value_name = "DIR")]
    ood: Option<PathBuf>,
    /// Finished run to stand above the tables, of these data or of its own [default: trained as the config says]
    #[arg(long, value_name = "RUN")]
    headline: Option<PathBuf>,
    /// Finished run of the headline's training from another seed, whose figures stand beside it; may be given several times
    #[arg(long, value_name = "RUN", requires = "headline")]
    headline_again: Vec<PathBuf>,
    /// Card whose figures are written anew, e.g. models/small.md; its network lies beside it
    #[arg(long, value_name = "MD")]
    card: Option<PathBuf>,
    /// Train and score one row
    #[arg(long, value_name = "ROW", conflicts_with = "tables_only")]
    only: Option<String>,
    /// Also score the headline, its other seeds and the rows side by side on split test, for reporting: the figures are kept, and
    /// made once a network
    #[arg(long = "final", conflicts_with_all = ["only", "tables_only"])]
    is_final: bool,
    /// Date beside the figures on split test [default: the commit's]
    #[arg(long, value_name = "YYYY-MM-DD", requires = "is_final")]
    date: Option<String>,
    /// Write RESULTS.md, results.csv, report.html and the card anew from what is kept, and do nothing else
    #[arg(long)]
    tables_only: bool,
    #[command(flatten)]
    device: DeviceArg,
}

pub fn run(args: ResultsArgs) -> anyhow::Result<ExitStatus> {
    let (text, page) = (args.out.join("RESULTS.md"), args.out.join(PAGE_FILE));
    if args.tables_only {
        results::rewrite(&args.out, args.card.as_deref())?;
        print(text.display())?;
        return Ok(ExitStatus::Done);
    }
    let reported = if args.is_final { Some(release(args.date)?) } else { None };
    let config: ResultsConfig = harmzone::config::load(args.config.as_deref(), &args.overrides)?;
    let request = Request {
        config: &config,
        out: args.out,
        data: args.data,
        ood: args.ood,
        headline: args.headline,
        headline_repeats: args.headline_again,
        only: args.only,
        reported,
        card: args.card,
        program: std::env::current_exe()?,
        command: command_line("cargo run --release -p xtask --"),
        jobs: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let results = results::run(&request, &args.device.open()?, &Bar::default())?;
    print(format!("{} of {} rows: {}", results.rows.len(), config.rows.len(), text.display()))?;
    if page.is_file() {
        print(page.display())?;
    }
    Ok(ExitStatus::Done)
}

/// The commit that this program was built from, as its checkout tells it, and its date.
fn release(date: Option<String>) -> anyhow::Result<ReportStamp> {
    let commit = git(&["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"])?;
    let date = date.map_or_else(|| git(&["show", "--no-patch", "--format=%cs", "HEAD"]), Ok)?;
    Ok(ReportStamp { commit, date })
}

fn git(args: &[&str]) -> anyhow::Result<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let told = Command::new("git")
        .arg("-C")
        .arg(root)
        .args(args)
        .output()
        .context("figures for reporting bear their commit, but git does not start")?;
    ensure!(
        told.status.success(),
        "figures for reporting bear their commit, which git cannot tell ({}): {}",
        String::from_utf8_lossy(&told.stderr).trim(),
        root.display()
    );
    Ok(String::from_utf8_lossy(&told.stdout).trim().to_owned())
}
