//! Whether the manifest says of an episode what the episode says of itself.

use super::check::{Aspect, Remark};
use super::maker::{Maker, Plans};
use crate::episode::manifest::{EpisodeEntry, ObjectCounts};
use crate::episode::{EpisodeMeta, EpisodeReader};
use crate::object::{Distribution, Kind};
use crate::sensors::RigConfig;

/// The first fact that an entry says otherwise than its episode: the key, the entry's value and the episode's.
pub(super) fn difference(
    entry: &EpisodeEntry,
    reader: &EpisodeReader,
    counts: &ObjectCounts,
) -> Option<(String, String, String)> {
    let meta = reader.meta();
    let facts = [
        ("name", entry.name.clone(), meta.name.clone()),
        ("seed", entry.seed.to_string(), meta.seed.to_string()),
        ("town", entry.town.clone(), meta.town.clone()),
        ("weather", entry.weather.clone(), meta.weather.clone()),
        ("ood", entry.ood.to_string(), meta.ood.to_string()),
        ("n_samples", entry.n_samples.to_string(), reader.len().to_string()),
    ];
    let facts = facts.map(|(key, told, found)| (key.to_owned(), told, found));
    let counted = [Distribution::Id, Distribution::Ood].into_iter().flat_map(|distribution| {
        Kind::ALL.map(|kind| {
            let of = |counts: &ObjectCounts| counts.get(distribution).get(kind).to_string();
            (format!("n_objects.{}.{}", distribution.name(), kind.name()), of(&entry.n_objects), of(counts))
        })
    });
    facts.into_iter().chain(counted).find(|(_, told, found)| told != found)
}

/// What is wrong with the entry of an episode that was read whole.
pub(super) fn examine(
    entry: &EpisodeEntry,
    reader: &EpisodeReader,
    counts: &ObjectCounts,
    maker: &Maker,
    plans: &Plans,
) -> Vec<Remark> {
    let other = difference(entry, reader, counts).map(|(key, told, found)| {
        let text = format!(
            "dataset.json says {key} {told}, and the episode says {found}; both should agree: {}",
            reader.path().display()
        );
        Remark::fault(Aspect::Entries, "other facts", text)
    });
    let split = plans.get(&entry.name).filter(|(_, split)| *split != entry.split).map(|(_, split)| {
        let text = format!(
            "dataset.json has it in split {}; the config puts it into {}, and a network might be scored on what it learnt",
            entry.split.name(),
            split.name()
        );
        Remark::fault(Aspect::Entries, "split", text)
    });
    [other, split].into_iter().flatten().chain(examine_config(reader.meta(), reader.len(), maker)).collect()
}

/// Whether the episode is one of this config.
fn examine_config(meta: &EpisodeMeta, n_samples: usize, maker: &Maker) -> Vec<Remark> {
    if !maker.has_made(meta) {
        let text =
            "the config in its metadata is another than the data set's; it belongs to another data set";
        return vec![Remark::fault(Aspect::Entries, "other config", text)];
    }
    let Some(config) = maker.gen_config() else { return Vec::new() };
    let wanted = config.samples as usize;
    let samples = (n_samples != wanted).then(|| {
        let text = format!("it has {n_samples} samples; the config says {wanted}");
        Remark::fault(Aspect::Entries, "samples of the config", text)
    });
    let is_other = |rig: &RigConfig| !config.rig_variation.enabled && *rig != config.rig;
    let rig = toml::from_str::<RigConfig>(&meta.rig_toml).ok().filter(is_other).map(|_| {
        let text = "the rig in its metadata is another than the config's, which gives all episodes one rig";
        Remark::fault(Aspect::Rig, "other rig", text)
    });
    samples.into_iter().chain(rig).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::episode::Manifest;

    #[test]
    fn each_fact_that_differs_is_named_with_both_values() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1]);
        let mut entry = Manifest::read(folder.path()).unwrap().episodes.remove(0);
        let reader = EpisodeReader::open(&folder.path().join(&entry.file)).unwrap();
        let counts = entry.n_objects;
        // Its episodes say one seed, and the entries number them.
        entry.seed = 3;
        assert_eq!(difference(&entry, &reader, &counts), None);
        let key = |entry: &EpisodeEntry| {
            difference(entry, &reader, &counts).map(|(key, ..)| key).unwrap_or_default()
        };
        assert_eq!(key(&EpisodeEntry { town: "oldtown".into(), ..entry.clone() }), "town");
        assert_eq!(key(&EpisodeEntry { ood: true, ..entry.clone() }), "ood");
        let mut other = entry.clone();
        other.n_objects.id.vehicle += 1;
        assert_eq!(key(&other), "n_objects.id.vehicle");
        let found = examine(&other, &reader, &counts, &Maker::Unknown, &Plans::new());
        assert!(found.len() == 1 && found[0].text.contains("n_objects.id.vehicle 6"), "{found:?}");
    }
}
