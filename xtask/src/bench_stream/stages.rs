//! The stages, each as a process of its own runs it.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::ensure;
use fs_err as fs;
use harmzone::dataset::{LabelledSplit, OneByOne};
use harmzone::episode::{Manifest, Split};
use harmzone::generate;
use harmzone::label;
use harmzone::progress::Silent;
use harmzone::random;
use harmzone::train::memory::{peak_mib, resident_mib};
use harmzone::train::{Plan, Position, StreamConfig, TrainConfig, Windows};
use harmzone::zone::ZoneConfig;
use rand::RngExt;

use super::make::{LABELS, shard_folder};
use super::{StageFigures, StreamStage};

/// Runs one stage on the data that `make` left in `work`.
///
/// # Errors
/// The data are not there, or broken.
pub fn run(stage: StreamStage, work: &Path, window_episodes: usize) -> anyhow::Result<StageFigures> {
    let data = work.join("data");
    let mut figures =
        StageFigures { stage, seconds: 0.0, peak_mib: None, tenths_mib: Vec::new(), n_samples: 0 };
    // What a stage needs and is not of it.
    let manifest = (stage == StreamStage::WriteManifest).then(|| Manifest::read(&data)).transpose()?;
    let begin = Instant::now();
    match stage {
        StreamStage::Merge => {
            let shards: Vec<PathBuf> = (0..=u32::MAX)
                .map(|index| shard_folder(work, index))
                .take_while(|path| path.is_dir())
                .collect();
            generate::merge(&shards, &data, &Silent)?;
        }
        StreamStage::ReadManifest => drop(Manifest::read(&data)?),
        StreamStage::WriteManifest => {
            let folder = work.join("written");
            fs::create_dir_all(&folder)?;
            manifest.expect("it was read for this stage").write(&folder)?;
        }
        StreamStage::LabelAgain => {
            let summary = label::run(&data, &ZoneConfig::default(), LABELS, false, &Silent)?;
            ensure!(summary.was_complete, "episodes were not labelled");
        }
        StreamStage::OpenSplit => drop(open(&data)?),
        StreamStage::Stream => stream(&data, window_episodes, &mut figures)?,
        StreamStage::OneByOne => one_by_one(&data, &mut figures)?,
    }
    figures.seconds = begin.elapsed().as_secs_f64();
    figures.peak_mib = peak_mib();
    Ok(figures)
}

fn open(data: &Path) -> anyhow::Result<LabelledSplit> {
    Ok(LabelledSplit::open(data, LABELS, Split::Train)?)
}

/// Shows one epoch.
fn stream(data: &Path, window_episodes: usize, figures: &mut StageFigures) -> anyhow::Result<()> {
    let split = open(data)?;
    let config = TrainConfig { stream: StreamConfig { window_episodes }, ..TrainConfig::default() };
    let plan = Plan::new(&config, &split);
    let mut windows = Windows::new(&plan, &split);
    for step in 0..plan.steps_per_epoch {
        figures.n_samples += windows.step(Position { stage: 1, step })?.len();
        note_tenth(figures, step + 1, plan.steps_per_epoch);
    }
    ensure!(figures.n_samples == split.n_samples(), "samples were left out");
    Ok(())
}

/// Reads samples as Python's loaders do.
fn one_by_one(data: &Path, figures: &mut StageFigures) -> anyhow::Result<()> {
    let all = OneByOne::open(data, Some(Split::Train), Some(LABELS))?;
    for i in 0..all.len() {
        let idx = random::stream(0, "bench-one-by-one", i as u64).random_range(0..all.len());
        ensure!(all.sample(idx)?.is_labelled, "a sample has no labels");
        figures.n_samples += 1;
        note_tenth(figures, i + 1, all.len());
    }
    Ok(())
}

fn note_tenth(figures: &mut StageFigures, n_done: usize, n: usize) {
    if n_done * 10 / n > (n_done - 1) * 10 / n {
        figures.tenths_mib.extend(resident_mib());
    }
}
