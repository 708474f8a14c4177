//! Labels one episode.

use std::path::Path;

use fs_err as fs;

use super::LabelError;
use super::apply::label_sample;
use crate::episode::manifest::{EpisodeEntry, LabelCounts, LabelEntry, LabelManifest};
use crate::episode::{EpisodeReader, LabelWriter, SourceMeta};
use crate::files::sha256_hex;
use crate::object::{Harm, Object};
use crate::zone::Zone;

/// An episode's entry in the set's manifest, and its counts.
pub(super) type LabelledEpisode = (LabelEntry, LabelCounts);

pub(super) fn label_episode(
    dataset: &Path,
    entry: &EpisodeEntry,
    zone: &Zone,
    set: &str,
    zone_toml: &str,
    on_sample: &dyn Fn(),
) -> Result<LabelledEpisode, LabelError> {
    let mut counts = LabelCounts::default();
    let reader = EpisodeReader::open_entry(dataset, entry)?;
    let meta = SourceMeta {
        episode: entry.name.clone(),
        episode_sha256: entry.sha256.clone(),
        set: set.to_owned(),
        config_toml: zone_toml.to_owned(),
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let file = format!("{}.mcap", entry.name);
    let mut writer = LabelWriter::create(&LabelManifest::folder(dataset, set).join(&file), &meta)?;
    for (sample_idx, sample) in reader.samples().enumerate() {
        let sample = sample?;
        let found = label_sample(zone, &entry.name, sample_idx, &sample)?;
        for (object, label) in sample.objects().iter().zip(&found.labels) {
            count(&mut counts, object, label.harm);
        }
        writer.write(&found, &sample)?;
        on_sample();
    }
    let path = writer.finish()?;
    let entry = LabelEntry {
        name: entry.name.clone(),
        file,
        episode_sha256: entry.sha256.clone(),
        sha256: sha256_hex(&fs::read(path)?),
        n_samples: entry.n_samples,
    };
    Ok((entry, counts))
}

fn count(counts: &mut LabelCounts, object: &Object, harm: Harm) {
    if let Some(count) = counts.of_mut(object) {
        count.add(harm);
    }
}
