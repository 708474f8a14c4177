//! Makes the shards of the data set: links to a few small episodes and their labels.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::config::to_toml;
use harmzone::dataset::test_data;
use harmzone::episode::{
    EpisodeEntry, EpisodeMeta, EpisodeWriter, LabelManifest, Manifest, MapDrawing, PartOf, Shard, Split,
};
use harmzone::files::sha256_hex;
use harmzone::generate::{CheckedConfig, EpisodePlan, GenerateConfig, plan};
use harmzone::label;
use harmzone::progress::{Progress, Silent};
use harmzone::sample::{Measured, Sample, Truth};
use harmzone::zone::ZoneConfig;

use super::StreamOptions;

/// The label set's name.
pub const LABELS: &str = "rect";
/// Different episodes, each with so many samples. A file system gives one file at most 65,000 names.
const N_DIFFERENT: usize = 8;
const N_SAMPLES: usize = 4;
/// The config's name in a data set's folder.
const CONFIG_FILE: &str = "gen.toml";

/// The folder of a shard.
pub fn shard_folder(work: &Path, index: u32) -> PathBuf {
    work.join(format!("shards/{index}"))
}

/// Makes all shards in a new folder; returns the size of an episode's file.
pub fn shards(options: &StreamOptions, work: &Path, progress: &dyn Progress) -> anyhow::Result<u64> {
    let few = work.join("few");
    write_few(&few)?;
    let (manifest, labels) = (Manifest::read(&few)?, LabelManifest::read(&few, LABELS)?);
    let config = GenerateConfig::default();
    let config_toml = to_toml(&config);
    let plans = plan(&CheckedConfig::try_from(&config)?, options.n_entries);
    progress.start("make", u64::from(options.n_entries));
    for index in 0..options.n_shards {
        let (folder, shard) = (shard_folder(work, index), Shard { index, of: options.n_shards });
        let label_folder = LabelManifest::folder(&folder, LABELS);
        fs::create_dir_all(folder.join("episodes"))?;
        fs::create_dir_all(&label_folder)?;
        fs::write(folder.join(CONFIG_FILE), &config_toml)?;
        let mut made = Manifest::new(sha256_hex(config_toml.as_bytes()), config.seed, false);
        made.part = Some(PartOf { shard, n_episodes: options.n_entries });
        let mut made_labels = LabelManifest::new(LABELS, labels.zone_toml.clone(), &made);
        for (number, plan) in (0..).zip(&plans).filter(|&(number, _)| shard.holds(number)) {
            let like = number as usize % N_DIFFERENT;
            let (entry, label) = (&manifest.episodes[like], &labels.episodes[like]);
            let split = if number < options.n_streamed { Split::Train } else { Split::Test };
            let entry = of_plan(plan, split, entry);
            fs::hard_link(few.join(&manifest.episodes[like].file), folder.join(&entry.file))?;
            let mut label = label.clone();
            let from = LabelManifest::folder(&few, LABELS).join(&label.file);
            (label.name, label.file) = (plan.name.clone(), format!("{}.mcap", plan.name));
            fs::hard_link(from, label_folder.join(&label.file))?;
            made.episodes.push(entry);
            made_labels.episodes.push(label);
            progress.advance(1);
        }
        made.write(&folder)?;
        made_labels.write(&folder)?;
    }
    progress.finish();
    Ok(fs::metadata(few.join(&manifest.episodes[0].file))?.len())
}

/// The entry of an episode under the name of a plan.
fn of_plan(plan: &EpisodePlan, split: Split, like: &EpisodeEntry) -> EpisodeEntry {
    EpisodeEntry {
        name: plan.name.clone(),
        file: plan.file(),
        split,
        seed: plan.seed,
        town: plan.town.clone(),
        weather: plan.weather.name().to_owned(),
        ..like.clone()
    }
}

/// Writes and labels the few episodes that all others are links to.
fn write_few(folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder.join("episodes"))?;
    let data = test_data::dataset(N_DIFFERENT * N_SAMPLES);
    let mut manifest = Manifest::new("0".repeat(64), 0, false);
    for (i, samples) in data.samples().chunks(N_SAMPLES).enumerate() {
        let name = format!("few-{i}");
        let meta = EpisodeMeta {
            name: name.clone(),
            seed: i as u64,
            town: "made".into(),
            weather: "ClearNoon".into(),
            ood: false,
            generator_version: String::new(),
            config_toml: String::new(),
            rig_toml: String::new(),
            n_samples: N_SAMPLES,
            background: String::new(),
        };
        let file = format!("episodes/{name}.mcap");
        let mut writer = EpisodeWriter::create(&folder.join(&file), &meta, &MapDrawing::default())?;
        for (j, sample) in samples.iter().enumerate() {
            let measured = Measured { time_ns: 1_000_000_000 * (j as u64 + 1), ..sample.measured.clone() };
            let objects = sample.objects.iter().map(|object| object.truth.clone()).collect();
            writer.write(&Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) })?;
        }
        let done = writer.finish()?;
        manifest.episodes.push(EpisodeEntry {
            name,
            file,
            split: Split::Train,
            seed: meta.seed,
            town: meta.town,
            weather: meta.weather,
            ood: false,
            n_samples: done.n_samples,
            n_objects: done.n_objects,
            sha256: done.sha256,
        });
    }
    manifest.write(folder)?;
    label::run(folder, &ZoneConfig::default(), LABELS, false, &Silent)?;
    Ok(())
}
