//! Time and memory of a large data set: its manifests read, checked and written, its shards merged, its episodes streamed as
//! training streams them, without the network's step.
//!
//! The data set is made up: each of its episodes is a link to one of a few small ones, under a name of its own. Each stage runs in
//! a process of its own, so that its memory is its own.

mod make;
mod stages;

use std::fmt;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use clap::ValueEnum;
use harmzone::progress::Progress;
use harmzone::text_table::text_table;
use serde::{Deserialize, Serialize};

pub use stages::run as run_stage;

/// What is made, and how it is streamed.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct StreamOptions {
    /// Episodes of the data set.
    pub n_entries: u32,
    /// Of these, the ones of the split `train`, which are streamed.
    pub n_streamed: u32,
    pub n_shards: u32,
    pub window_episodes: usize,
}

/// A part of the measurement, in the order in which they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum StreamStage {
    /// Check all shards and join them
    Merge,
    /// Read `dataset.json` and check it
    ReadManifest,
    /// Write it
    WriteManifest,
    /// Find that all episodes are labelled
    LabelAgain,
    /// Open the split that is streamed, with its labels
    OpenSplit,
    /// Show every sample of the split once
    Stream,
    /// Read as many samples one by one, in any order
    OneByOne,
}

impl StreamStage {
    const ALL: [Self; 7] = [
        Self::Merge,
        Self::ReadManifest,
        Self::WriteManifest,
        Self::LabelAgain,
        Self::OpenSplit,
        Self::Stream,
        Self::OneByOne,
    ];

    fn name(self) -> String {
        self.to_possible_value().expect("no stage is skipped").get_name().to_owned()
    }
}

/// The time and memory of a stage.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StageFigures {
    pub stage: StreamStage,
    pub seconds: f64,
    /// The most that its process ever had resident; `None` where the system does not tell.
    pub peak_mib: Option<f64>,
    /// Resident after each tenth of the samples.
    pub tenths_mib: Vec<f64>,
    pub n_samples: usize,
}

/// All stages.
#[derive(Debug, Serialize)]
pub struct StreamReport {
    #[serde(flatten)]
    pub options: StreamOptions,
    pub episode_bytes: u64,
    pub stages: Vec<StageFigures>,
}

/// Makes the data set in `work` and measures all stages.
///
/// # Errors
/// The folder cannot be filled, or a stage fails.
pub fn run(options: StreamOptions, work: &Path, progress: &dyn Progress) -> anyhow::Result<StreamReport> {
    let episode_bytes = make::shards(&options, work, progress)?;
    let mut stages = Vec::new();
    for stage in StreamStage::ALL {
        progress.note(&stage.name());
        stages.push(in_own_process(stage, &options, work)?);
    }
    Ok(StreamReport { options, episode_bytes, stages })
}

fn in_own_process(stage: StreamStage, options: &StreamOptions, work: &Path) -> anyhow::Result<StageFigures> {
    let output = Command::new(std::env::current_exe()?)
        .args(["bench-stream-stage", &stage.name()])
        .args(["--window", &options.window_episodes.to_string()])
        .arg("--work")
        .arg(work)
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(output.status.success(), "stage {} ended with {}", stage.name(), output.status);
    serde_json::from_slice(&output.stdout).context("a stage told something else than its figures")
}

impl fmt::Display for StreamReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let StreamOptions { n_entries, n_streamed, n_shards, window_episodes } = self.options;
        writeln!(
            f,
            "{n_entries} episodes of {:.0} kB in {n_shards} shards; {n_streamed} of them streamed in windows of {window_episodes}\n",
            self.episode_bytes as f64 / 1e3
        )?;
        let mib = |mib: f64| format!("{mib:.0}");
        let row = |of: &StageFigures| {
            let samples = if of.n_samples > 0 { of.n_samples.to_string() } else { String::new() };
            let peak = of.peak_mib.map_or_else(String::new, mib);
            [of.stage.name(), format!("{:.1}", of.seconds), peak, samples]
        };
        let head = ["", "seconds", "peak MiB", "samples"].map(str::to_owned);
        f.write_str(&text_table(std::iter::once(head).chain(self.stages.iter().map(row))))?;
        for of in self.stages.iter().filter(|of| !of.tenths_mib.is_empty()) {
            let tenths: Vec<String> = of.tenths_mib.iter().copied().map(mib).collect();
            write!(f, "\n{}: MiB resident after each tenth: {}", of.stage.name(), tenths.join(" "))?;
        }
        Ok(())
    }
}
