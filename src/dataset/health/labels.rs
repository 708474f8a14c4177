//! Label sets: whether each is of this data set, of these objects, by its zone, and counted rightly.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use super::check::{Aspect, Found, Remark};
use super::folder::{label_folders, listed};
use super::times;
use crate::episode::manifest::{EpisodeEntry, LabelCounts, LabelManifest, Manifest};
use crate::episode::{EpisodeError, LabelReader, check_stamps, label_command, zone_in};
use crate::files::{is_file, is_lock, is_unfinished, read_sealed};
use crate::sample::Sample;
use crate::store;
use crate::zone::{Zone, ZoneConfig};

/// Parts of a set, until all are joined.
const PART_PREFIX: &str = "part-";
/// What a run that broke off has noted.
const SO_FAR_PREFIX: &str = "part-so-far";

/// A label set of which the manifest could be read.
pub(super) struct LabelSet {
    pub name: String,
    pub manifest: LabelManifest,
    pub zone: Option<Zone>,
    /// `harmzone label` with the set's zone.
    command: String,
}

/// How a set is made anew.
fn remedy(command: &str) -> String {
    format!("`{command} --force` makes the set anew")
}

/// The zone of a set that has no manifest: that of a part of it, else of one of its label files.
fn zone_beside(folder: &Path, names: &BTreeSet<String>) -> Option<ZoneConfig> {
    let of_part = |name: &String| {
        let part: LabelManifest = serde_json::from_str(&read_sealed(&folder.join(name)).ok()?).ok()?;
        zone_in(&part.zone_toml)
    };
    let of_labels = |name: &String| zone_in(&LabelReader::open(&folder.join(name)).ok()?.meta().config_toml);
    let is_mcap = |name: &&String| Path::new(name).extension().is_some_and(|suffix| suffix == "mcap");
    let parts = names.iter().filter(|name| name.starts_with(PART_PREFIX)).filter_map(of_part);
    parts.chain(names.iter().filter(is_mcap).filter_map(of_labels)).next()
}

/// Reads the sets' manifests, and tells what is wrong with them.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn open_all(path: &Path, manifest: &Manifest, found: &mut Found) -> io::Result<Vec<LabelSet>> {
    let mut sets = Vec::new();
    for (name, folder) in label_folders(path)? {
        let files = file_names(&folder)?;
        let command_beside = || label_command(path, &name, zone_beside(&folder, &files).as_ref());
        if !is_file(&folder.join(LabelManifest::FILE))? {
            if !files.is_empty() {
                let text = format!(
                    "the label set has no {}, by which stages read it; `{}` goes on with it",
                    LabelManifest::FILE,
                    command_beside()
                );
                // Parts that wait for each other are no fault.
                let is_part = |file: &str| file.starts_with(PART_PREFIX) && !file.starts_with(SO_FAR_PREFIX);
                let is_in_parts = files.iter().any(|file| is_part(file));
                found.add(&name, Remark::unless(is_in_parts, Aspect::Labels, "unfinished set", text));
            }
            continue;
        }
        match LabelManifest::read(path, &name) {
            Ok(labels) => {
                let zone = zone_of(&labels);
                let command = label_command(path, &name, zone.as_ref().ok().map(Zone::config));
                let set = LabelSet { name, zone: zone.as_ref().ok().cloned(), manifest: labels, command };
                let bad_zone = zone.err().map(|message| format!("its zone is not valid ({message})"));
                set.examine(manifest, bad_zone, &files, found);
                sets.push(set);
            }
            Err(error) => {
                let text = format!("{error}; {}", remedy(&command_beside()));
                found.add(&name, Remark::fault(Aspect::Labels, "set", text));
            }
        }
    }
    Ok(sets)
}

/// Names of what lies in a set's folder, without what is unfinished.
fn file_names(folder: &Path) -> io::Result<BTreeSet<String>> {
    let paths = listed(folder)?.into_iter().filter(|path| !is_unfinished(path) && !is_lock(path));
    Ok(paths.map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect())
}

fn zone_of(labels: &LabelManifest) -> Result<Zone, String> {
    let config: ZoneConfig = toml::from_str(&labels.zone_toml).map_err(|error| error.message().to_owned())?;
    Zone::try_from(config).map_err(|error| error.to_string())
}

impl LabelSet {
    fn examine(
        &self,
        manifest: &Manifest,
        bad_zone: Option<String>,
        files: &BTreeSet<String>,
        found: &mut Found,
    ) {
        let Self { name, manifest: labels, command, .. } = self;
        let other_data = (labels.dataset_config_sha256 != manifest.config_sha256)
            .then(|| "it belongs to a data set of another config".to_owned());
        for what in [other_data, bad_zone].into_iter().flatten() {
            found.add(name, Remark::fault(Aspect::Labels, "set", format!("{what}; {}", remedy(command))));
        }
        let known: BTreeSet<&str> = manifest.episodes.iter().map(|entry| entry.name.as_str()).collect();
        for label in labels.episodes.iter().filter(|label| !known.contains(label.name.as_str())) {
            let text = format!(
                "label set `{name}` has labels of an episode that dataset.json lacks; `harmzone gen`, the same command again, \
                 makes the episode, or {}",
                remedy(command)
            );
            found.add(&label.name, Remark::warning(Aspect::Labels, "labels without episode", text));
        }
        let listed: BTreeSet<&str> = labels.episodes.iter().map(|label| label.file.as_str()).collect();
        let is_ours = |file: &str| {
            file == LabelManifest::FILE || file.starts_with(PART_PREFIX) || listed.contains(file)
        };
        for file in files.iter().filter(|file| !is_ours(file.as_str())) {
            let text = format!("labels.json does not name this file of label set `{name}`; nothing reads it");
            found.add(file, Remark::warning(Aspect::Files, "unknown label file", text));
        }
    }

    /// Opens an episode's labels, and tells what is wrong with them; `None` where they cannot be read.
    pub(super) fn open<'a>(
        &'a self,
        path: &Path,
        entry: &EpisodeEntry,
        n_hashed: &mut u64,
        remarks: &mut Vec<Remark>,
    ) -> Option<EpisodeLabels<'a>> {
        let Self { name, command, .. } = self;
        let Some(label) = self.manifest.episodes.iter().find(|label| label.name == entry.name) else {
            let text = format!("label set `{name}` lacks the episode; `{command}` makes it anew");
            remarks.push(Remark::fault(Aspect::Labels, "labels of an episode", text));
            return None;
        };
        let file = LabelManifest::folder(path, name).join(&label.file);
        if matches!(store::is_there(&file), Ok(false)) {
            let text = format!("the label file is not there; {}: {}", remedy(command), file.display());
            remarks.push(Remark::fault(Aspect::Files, "missing label file", text));
            return None;
        }
        match store::sha256_of(&file) {
            Ok(found) if found == label.sha256 => *n_hashed += 1,
            Ok(found) => {
                let (wanted, path) = (label.sha256.clone(), file.clone());
                let error = EpisodeError::OtherContent { found, wanted, path };
                remarks.push(Remark::fault(Aspect::Hashes, "label file", error.to_string()));
            }
            Err(error) => remarks.push(Remark::fault(Aspect::Hashes, "label file", error.to_string())),
        }
        // Label files are by this program alone.
        let read = check_stamps(&file, true).and_then(|(_, off)| Ok((LabelReader::open(&file)?, off)));
        let (reader, off) = match read {
            Ok(read) => read,
            Err(error) => {
                let is_damage = matches!(error, EpisodeError::Damaged { .. } | EpisodeError::NoIndex { .. });
                let aspect = if is_damage { Aspect::Checksums } else { Aspect::Schemas };
                remarks.push(Remark::fault(aspect, "label file", error.to_string()));
                return None;
            }
        };
        remarks.extend(times::examine_stamps(&file, &off, false));
        let meta = reader.meta();
        let n = reader.samples().len();
        let told = |sha256: &str| {
            format!("of an episode with the content hash {sha256}, and it is {}", entry.sha256)
        };
        let faults = [
            (label.episode_sha256 != entry.sha256).then(|| told(&label.episode_sha256)),
            (meta.episode_sha256 != entry.sha256).then(|| told(&meta.episode_sha256)),
            (meta.episode != entry.name).then(|| format!("of episode `{}`", meta.episode)),
            (meta.set != *name).then(|| format!("of label set `{}`", meta.set)),
            (meta.config_toml != self.manifest.zone_toml)
                .then(|| "by another zone than labels.json has".to_owned()),
            (n != label.n_samples)
                .then(|| format!("of {n} samples, and labels.json says {}", label.n_samples)),
        ];
        if let Some(what) = faults.into_iter().flatten().next() {
            let text = format!("these are labels {what}; {}: {}", remedy(command), file.display());
            remarks.push(Remark::fault(Aspect::Labels, "other labels", text));
            return None;
        }
        Some(EpisodeLabels { set: self, reader, counts: LabelCounts::default(), n_labels: 0 })
    }

    /// Sets the sum of an episode-wise count beside the manifest's.
    pub(super) fn examine_counts(&self, counts: &LabelCounts, found: &mut Found) {
        if *counts == self.manifest.counts {
            return;
        }
        let all = |counts: &LabelCounts| crate::label::count_of(counts, None, None);
        let (told, counted) = (all(&self.manifest.counts), all(counts));
        let text = format!(
            "labels.json counts {} harmful and {} harmless boxes, and the label files hold {} and {} (or others of a kind); \
             {}",
            told.harmful,
            told.harmless,
            counted.harmful,
            counted.harmless,
            remedy(&self.command)
        );
        found.add(&self.name, Remark::fault(Aspect::Labels, "counts", text));
    }
}

/// The labels of one episode while they are set beside its samples.
pub(super) struct EpisodeLabels<'a> {
    set: &'a LabelSet,
    reader: LabelReader,
    pub counts: LabelCounts,
    pub n_labels: u64,
}

impl EpisodeLabels<'_> {
    /// Sets a sample's labels beside its objects.
    pub(super) fn examine(&mut self, sample_idx: usize, sample: &Sample) -> Option<Remark> {
        let LabelSet { name, command, .. } = self.set;
        let Some(labels) = self.reader.samples().get(sample_idx) else {
            let text =
                format!("label set `{name}` ends before this sample; `{command} --force` makes it anew");
            return Some(Remark::fault(Aspect::Labels, "labels of a sample", text));
        };
        let ids = labels.labels.iter().map(|label| Some(label.id.as_str()));
        let is_same = labels.time_ns == sample.measured.time_ns
            && ids.eq(sample.objects().iter().map(|object| object.id.as_deref()));
        if !is_same {
            let text = format!(
                "label set `{name}` has {} labels at {} ns for {} objects at {} ns; one for each object, in its order, is \
                 needed: `{command} --force` makes it anew",
                labels.labels.len(),
                labels.time_ns,
                sample.objects().len(),
                sample.measured.time_ns
            );
            return Some(Remark::fault(Aspect::Labels, "labels of a sample", text));
        }
        let here = self.set.zone.as_ref().and_then(|zone| zone.at(sample.true_state()).ok());
        let mut other = None;
        for (object, label) in sample.objects().iter().zip(&labels.labels) {
            self.n_labels += 1;
            if let Some(count) = self.counts.of_mut(object) {
                count.add(label.harm);
            }
            let verdict = here.as_ref().and_then(|here| here.harm_of_object(object).ok());
            if let Some(verdict) = verdict.filter(|verdict| verdict.harm != label.harm) {
                other.get_or_insert_with(|| {
                    let text = format!(
                        "label set `{name}` calls object `{}` {}, and its zone calls it {} today; `{command} --force` makes it \
                         anew",
                        label.id,
                        label.harm.name(),
                        verdict.harm.name()
                    );
                    Remark::warning(Aspect::Labels, "other harm", text)
                });
            }
        }
        other
    }
}

#[cfg(test)]
mod tests {
    use fs_err as fs;

    use super::*;
    use crate::dataset::health::{examine, made};
    use crate::progress::Silent;
    use crate::zone::ZoneKind;

    #[test]
    fn a_set_is_made_anew_by_its_own_zone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let manifest = made::write(path, 2);
        let zone = ZoneConfig { kind: ZoneKind::Ttc, ..ZoneConfig::default() };
        crate::label::run(path, &zone, "late", false, &Silent).unwrap();
        let told = || {
            let texts = examine(path, &Silent).unwrap().symptoms.into_iter().map(|symptom| symptom.text);
            texts.collect::<Vec<_>>().join("\n")
        };
        let set = LabelManifest::folder(path, "late");
        fs::remove_file(set.join(format!("{}.mcap", manifest.episodes[0].name))).unwrap();
        let command = format!("`harmzone label {} --labels late --set kind=ttc", path.display());
        assert!(told().contains(&format!("{command} --force` makes the set anew")), "{}", told());
        // What is left of the set tells it, too.
        let whole = fs::read(set.join(LabelManifest::FILE)).unwrap();
        fs::write(set.join(LabelManifest::FILE), "{").unwrap();
        assert!(told().contains(&format!("{command} --force` makes the set anew")), "{}", told());
        fs::remove_file(set.join(LabelManifest::FILE)).unwrap();
        assert!(told().contains(&format!("{command}` goes on with it")), "{}", told());
        fs::remove_file(set.join(format!("{}.mcap", manifest.episodes[1].name))).unwrap();
        fs::write(set.join("part-0-of-2.json"), whole).unwrap();
        assert!(told().contains(&format!("{command}` goes on with it")), "{}", told());
    }
}
