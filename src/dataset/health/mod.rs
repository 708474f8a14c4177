//! The health of a data set: whether each file is the one in the manifest, and whether its values can be what they say.
//!
//! A fault is what no stage can use, or what says something else than it is; a warning is what every stage takes, although it
//! is seldom meant. Each is one sentence: what was found, and what would be right. Metres, seconds; the whole cloud is
//! examined, not the part in view. `docs/health.md` lists the checks.

mod archive;
mod camera;
mod check;
mod entries;
mod episode;
mod folder;
mod labels;
#[cfg(test)]
mod made;
mod maker;
mod mend;
mod motion;
mod objects;
mod rebuild;
mod rig;
mod sample;
mod spread;
mod tally;
mod times;

use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

use self::check::{Aspect, Found, Remark};
use self::episode::{Context, Examined};
use self::labels::LabelSet;
use self::maker::{ConfigFile, Maker};
use self::tally::Tally;
use super::DatasetError;
use crate::episode::manifest::{EpisodeEntry, LabelCounts, Manifest};
use crate::progress::Progress;
use crate::zone::ZoneConfig;

pub use self::mend::mend;

/// How much a symptom matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// No stage can use it, or it would be used as what it is not.
    Fault,
    /// Every stage takes it, although it is seldom meant.
    Warning,
}

impl Severity {
    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Warning => "warning",
        }
    }
}

/// What a check came to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CheckVerdict {
    /// The check's name.
    pub check: &'static str,
    /// `ok`, `warning` or `fault`: the worst of its symptoms.
    pub verdict: &'static str,
    /// What it looked at, in words.
    pub figures: String,
}

/// One thing that is wrong or odd, wherever it occurs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Symptom {
    pub severity: Severity,
    /// Name of the check that found it.
    pub check: &'static str,
    /// Where it occurs first: an episode, and the sample if it is of one; else a file or a label set.
    pub first_at: String,
    /// In how many places (samples, or episodes where it is of a whole one).
    pub n_places: usize,
    /// What was found and what would be right, in the first place.
    pub text: String,
}

/// The result of examining a data set.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Health {
    pub n_episodes: usize,
    pub n_samples: usize,
    /// One for each check, always in the same order.
    pub verdicts: Vec<CheckVerdict>,
    /// Faults first, then as they were found.
    pub symptoms: Vec<Symptom>,
}

impl Health {
    /// How many symptoms are of a severity.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        self.symptoms.iter().filter(|symptom| symptom.severity == severity).count()
    }
}

/// Examines the folder, every episode and every label set of a data set; several episodes at a time, each a sample at a time.
///
/// # Errors
/// The folder holds no data set, or one of a later version; everything else is a symptom.
pub fn examine(path: &Path, progress: &dyn Progress) -> Result<Health, DatasetError> {
    let mut found = Found::default();
    let (manifest, of_manifest) = read_manifest(path, &mut found)?;
    let config = ConfigFile::find(path)?;
    let maker = Maker::of(config.as_ref(), &manifest.config_sha256);
    // Twice as many as are there: `gen` may have been interrupted.
    let n_planned = u32::try_from(2 * manifest.episodes.len() + 1_000).unwrap_or(u32::MAX);
    let n_planned = manifest.part.map_or(n_planned, |part| part.n_episodes);
    let plans = maker.plans(n_planned);
    let of_files = folder::examine(path, &manifest, &mut found)?;
    if let Some(config) = maker.gen_config().filter(|config| config.render.aov) {
        folder::examine_pictures(path, &manifest, config.rig.cameras.len(), &mut found)?;
    }
    let sets = labels::open_all(path, &manifest, &mut found)?;
    progress.start("examine", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
    let context = Context { path, maker: &maker, plans: &plans, sets: &sets };
    let examine_one = |entry: &EpisodeEntry| {
        progress.note(&entry.name);
        episode::examine(&context, entry, progress)
    };
    let mut all: Vec<Examined> = manifest.episodes.par_iter().map(examine_one).collect();
    progress.finish();

    let mut tally = Tally::default();
    for examined in &mut all {
        tally.add(&examined.tally);
        for (at, remark) in std::mem::take(&mut examined.remarks) {
            found.add(&at, remark);
        }
    }
    let in_episodes: Vec<String> = all.iter().filter_map(|examined| examined.config_sha256.clone()).collect();
    let is_of_gen = all.iter().any(|examined| examined.is_of_gen);
    let of_config =
        maker::examine(path, &manifest, config.as_ref(), (in_episodes.as_slice(), is_of_gen), &mut found)?;
    examine_rigs(&manifest, &all, &mut found);
    let usual_labels = examine_counts(&sets, &all, &mut found);
    let portraits: Vec<_> = all.into_iter().filter_map(|examined| examined.portrait).collect();
    for (at, remark) in spread::judge(&portraits, maker.gen_config(), usual_labels.as_ref()) {
        found.add(&at, remark);
    }
    let of_set = spread::figures(&portraits, usual_labels.as_ref());
    let (verdicts, symptoms) = found.finish(|aspect| match aspect {
        Aspect::Manifest => of_manifest.clone(),
        Aspect::Config => of_config.clone(),
        Aspect::Files => of_files.clone(),
        Aspect::Statistics => of_set.clone(),
        other => tally.figures(other),
    });
    let n_samples = manifest.episodes.iter().map(|entry| entry.n_samples).sum();
    Ok(Health { n_episodes: manifest.episodes.len(), n_samples, verdicts, symptoms })
}

/// The manifest and what is to be said of it. Where it is lost, the one that the episodes tell.
fn read_manifest(path: &Path, found: &mut Found) -> Result<(Manifest, String), DatasetError> {
    let error = match Manifest::read(path) {
        Ok(manifest) => {
            let (version, n_episodes) = (manifest.format_version, manifest.episodes.len());
            let part = manifest.part.map_or_else(String::new, |part| format!(", shard {}", part.shard));
            let mut files: Vec<&str> = manifest.episodes.iter().map(|entry| entry.file.as_str()).collect();
            files.sort_unstable();
            if let Some((file, _)) = files.iter().zip(files.iter().skip(1)).find(|(file, next)| file == next)
            {
                let text = format!("dataset.json names the file `{file}` for two episodes; each has its own");
                found.add(Manifest::FILE, Remark::fault(Aspect::Manifest, "same file", text));
            }
            let figures = format!("dataset.json of version {version} names {n_episodes} episodes{part}");
            return Ok((manifest, figures));
        }
        Err(error) if rebuild::is_of_a_set(path, &error) => error,
        Err(error) => return Err(error.into()),
    };
    let rebuild::Rebuilt { manifest, doubt } = rebuild::rebuild(path)?;
    let remedy = doubt.map_or_else(
        || "`--fix` makes it anew of the config and the episodes".to_owned(),
        |doubt| format!("it cannot be made anew of the episodes, since {doubt}: copy it again, or make the data set again"),
    );
    let text = format!("{error}; {remedy}");
    found.add(Manifest::FILE, Remark::fault(Aspect::Manifest, "manifest", text));
    let figures = format!("dataset.json cannot be read; {} whole episodes are here", manifest.episodes.len());
    Ok((manifest, figures))
}

/// Whether episodes without a rig in their metadata have one and the same.
fn examine_rigs(manifest: &Manifest, all: &[Examined], found: &mut Found) {
    let mut first = None;
    for (entry, examined) in manifest.episodes.iter().zip(all) {
        let Some(calibration) = examined.calibration else { continue };
        if !first.get_or_insert(calibration).is(&calibration) {
            let text = "its sensors are mounted otherwise than those of the first episode, and no rig in its metadata says so";
            found.add(&entry.name, Remark::warning(Aspect::Rig, "rig of the set", text));
        }
    }
}

/// Sets the counts of each label set beside those in its files; returns those of the set that the default zone made.
fn examine_counts(sets: &[LabelSet], all: &[Examined], found: &mut Found) -> Option<LabelCounts> {
    let mut usual = None;
    for (i, set) in sets.iter().enumerate() {
        let of_episodes: Option<Vec<LabelCounts>> = all.iter().map(|examined| examined.labels[i]).collect();
        // Where labels or samples cannot be read, that is told.
        let Some(of_episodes) = of_episodes.filter(|counts| counts.len() == set.manifest.episodes.len())
        else {
            continue;
        };
        let mut sum = LabelCounts::default();
        of_episodes.iter().for_each(|counts| sum.add_all(counts));
        set.examine_counts(&sum, found);
        let is_usual = set.zone.as_ref().is_some_and(|zone| *zone.config() == ZoneConfig::default());
        usual = usual.or(is_usual.then_some(sum));
    }
    usual
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::LabelManifest;
    use crate::progress::Silent;
    use fs_err as fs;

    /// The checks that find a fault.
    fn faults(path: &Path) -> Vec<&'static str> {
        let health = examine(path, &Silent).unwrap();
        let is_fault = |symptom: &&Symptom| symptom.severity == Severity::Fault;
        let mut checks: Vec<_> =
            health.symptoms.iter().filter(is_fault).map(|symptom| symptom.check).collect();
        let by_verdicts = health.verdicts.iter().filter(|verdict| verdict.verdict == "fault").count();
        checks.sort_unstable();
        checks.dedup();
        assert_eq!(checks.len(), by_verdicts);
        checks
    }

    #[test]
    fn a_whole_set_has_no_fault_and_every_check_says_what_it_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        made::write(folder.path(), 3);
        let health = examine(folder.path(), &Silent).unwrap();
        assert_eq!(health.count(Severity::Fault), 0, "{:?}", health.symptoms);
        assert_eq!((health.n_episodes, health.n_samples), (3, 9));
        assert_eq!(health.verdicts.len(), Aspect::ALL.len());
        assert!(health.verdicts.iter().all(|verdict| !verdict.figures.is_empty()), "{:?}", health.verdicts);
        let hashes = health.verdicts.iter().find(|verdict| verdict.check == "hashes").unwrap();
        assert_eq!(hashes.figures, "6 files are as their manifests say");
    }

    #[test]
    fn each_damage_of_the_folder_is_found_by_its_check() {
        type Damage = fn(&Path, &mut Manifest);
        let damages: [(Damage, &[&str]); 6] = [
            (|path, of| fs::remove_file(path.join(&of.episodes[0].file)).unwrap(), &["files"]),
            (|path, _| fs::write(path.join("episodes/x.mcap"), "").unwrap(), &["files"]),
            (|path, _| fs::write(path.join("gen.toml"), "seed = 7\n").unwrap(), &["config"]),
            (|path, _| fs::remove_file(path.join("gen.toml")).unwrap(), &["config"]),
            (|_, of| of.episodes[1].n_objects.id.vehicle += 1, &["entries"]),
            (|_, of| of.episodes[0].sha256 = "0".repeat(64), &["hashes", "labels"]),
        ];
        for (i, (damage, wanted)) in damages.into_iter().enumerate() {
            let folder = tempfile::tempdir().unwrap();
            let mut manifest = made::write(folder.path(), 2);
            damage(folder.path(), &mut manifest);
            manifest.write(folder.path()).unwrap();
            assert_eq!(faults(folder.path()), wanted, "damage {i}");
        }
    }

    #[test]
    fn labels_of_other_counts_and_a_lost_label_file_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = made::write(folder.path(), 2);
        let mut labels = LabelManifest::read(folder.path(), "rect").unwrap();
        labels.counts.id.vehicle.harmful += 1;
        labels.write(folder.path()).unwrap();
        assert_eq!(faults(folder.path()), ["labels"]);
        let file = format!("labels/rect/{}.mcap", manifest.episodes[0].name);
        fs::remove_file(folder.path().join(file)).unwrap();
        assert_eq!(faults(folder.path()), ["files"]);
    }

    #[test]
    fn a_lost_manifest_beside_its_config_is_a_fault_and_no_error() {
        let folder = tempfile::tempdir().unwrap();
        made::write(folder.path(), 2);
        fs::write(folder.path().join(Manifest::FILE), "{").unwrap();
        assert_eq!(faults(folder.path()), ["manifest"]);
        assert_eq!(examine(folder.path(), &Silent).unwrap().n_episodes, 2);
    }

    #[test]
    fn a_folder_without_a_manifest_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(examine(folder.path(), &Silent), Err(DatasetError::Manifest(_))));
    }
}
