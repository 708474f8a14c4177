//! A description of a data set, beside the paper's: counts, shares, hardness and histograms, as text, JSON
//! and a picture.

mod charts;
mod comparison;
mod logs;
mod text;
mod unfamiliar;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

pub use self::comparison::{Comparison, TOLERANCE};
use self::comparison::{harmful_share, share};
pub use self::logs::LogGroup;
pub use self::unfamiliar::{SpotInfo, UnfamiliarInfo};
use super::chart::{self, ChartError};
use crate::dataset::DatasetError;
use crate::dataset::statistics::{Category, Group, Histograms, Statistics};
use crate::episode::manifest::{LabelCounts, Manifest, ManifestError, ObjectCounts, label_sets};
use crate::episode::{EpisodeError, MadeWith, PartOf, Split};
use crate::files::{self, write_atomic};
use crate::label::count_of;
use crate::object::{Distribution, Kind};
use crate::progress::Progress;

/// The label set that is used if none is named.
pub const DEFAULT_SET: &str = "rect";

/// Why a data set cannot be described.
#[derive(Debug, Error)]
pub enum InfoError {
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Chart(#[from] ChartError),
    #[error("the file exists; --force replaces it: {}", path.display())]
    Exists { path: PathBuf },
}

/// What to describe.
#[derive(Debug, Clone, PartialEq)]
pub struct InfoRequest {
    pub dataset: PathBuf,
    /// `None` takes [`DEFAULT_SET`] if it is there.
    pub label_set: Option<String>,
    /// Where to draw the histograms.
    pub plot: Option<PathBuf>,
    pub force: bool,
}

/// A data set described.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Info {
    pub dataset: PathBuf,
    pub generator_version: String,
    /// Version of the data: from 2 on, split test has towns and unfamiliar objects of its own.
    pub data_version: u32,
    /// Which part of a larger data set this is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<PartOf>,
    /// What the episodes were made with, where that is known.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub made_with: Vec<MadeWith>,
    pub seed: u64,
    /// Whether it was made with unfamiliar objects, or holds some: recorded drives of scenarios bring their own.
    pub ood: bool,
    /// `None` if the set is not labelled.
    pub label_set: Option<String>,
    /// What is missing, and how to get it.
    pub note: Option<String>,
    /// Where imported episodes come from.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub logs: Vec<LogGroup>,
    /// Categories of what stands in simulated episodes and is never annotated.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub background: BTreeSet<String>,
    #[serde(flatten)]
    pub all: GroupInfo,
    pub splits: BTreeMap<Split, GroupInfo>,
    pub towns: BTreeMap<String, GroupInfo>,
    pub weathers: BTreeMap<String, GroupInfo>,
    pub comparison: Vec<Comparison>,
    pub hardness: Hardness,
    /// Where the objects out of distribution are; `None` without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unfamiliar: Option<UnfamiliarInfo>,
    /// Size of the episodes' files, without labels.
    pub n_bytes: u64,
    pub bytes_per_sample: Option<f64>,
    /// The most frequent first.
    pub categories: Vec<CategoryInfo>,
    pub histograms: Histograms,
}

/// Some episodes of a data set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupInfo {
    pub n_episodes: u64,
    pub n_samples: u64,
    pub n_objects: u64,
    pub objects_per_sample: Option<f64>,
    pub objects: ObjectCounts,
    pub labels: Option<LabelCounts>,
    pub harmful_share: Option<HarmfulShares>,
}

/// Harmful objects over all; `None` if there is no such object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HarmfulShares {
    pub all: Option<f64>,
    pub vehicle: Option<f64>,
    pub pedestrian: Option<f64>,
    #[serde(rename = "static")]
    pub static_object: Option<f64>,
    pub id: Option<f64>,
    pub ood: Option<f64>,
}

/// How hard the annotated objects are to find.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Hardness {
    /// Share of objects that are less than half visible.
    pub more_than_half_occluded: Option<f64>,
    /// Share of objects with ten LiDAR points or fewer.
    pub ten_points_or_fewer: Option<f64>,
    pub farthest_m: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CategoryInfo {
    #[serde(flatten)]
    pub category: Category,
    pub n_objects: u64,
    pub n_harmful: Option<u64>,
}

/// Describes a data set, and draws its histograms if asked to.
///
/// # Errors
/// [`InfoError`]: no data set, no label set of the given name, labels of other episodes, a picture
/// that exists.
pub fn run(request: &InfoRequest, progress: &dyn Progress) -> Result<Info, InfoError> {
    if let Some(path) = request.plot.as_ref().filter(|_| !request.force)
        && files::is_there(path)?
    {
        return Err(InfoError::Exists { path: path.clone() });
    }
    let dataset = &request.dataset;
    let manifest = Manifest::read(dataset)?;
    let (label_set, note) = choose_labels(dataset, request.label_set.as_deref())?;
    let statistics = Statistics::of(dataset, &manifest, label_set.as_deref(), progress)?;
    let (logs, background) = logs::read(dataset, &manifest)?;
    let is_annotated = logs.is_empty() || logs.iter().any(|group| group.facts.labelled.is_some());
    let nobody = || "nobody annotated these logs, so there is nothing to label".to_owned();
    let note = if is_annotated { note } else { Some(nobody()) };
    let info = Info { logs, background, ..describe(dataset, &manifest, label_set, note, statistics) };
    if let Some(path) = &request.plot {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        write_atomic(path, &chart::png(&charts::sheet(&info))?)?;
    }
    Ok(info)
}

/// The label set to read, or a note if there is none.
fn choose_labels(dataset: &Path, wanted: Option<&str>) -> std::io::Result<(Option<String>, Option<String>)> {
    // A named set must be there; otherwise reading it fails.
    if let Some(set) = wanted {
        return Ok((Some(set.to_owned()), None));
    }
    let found = label_sets(dataset)?;
    if found.iter().any(|set| set == DEFAULT_SET) {
        return Ok((Some(DEFAULT_SET.to_owned()), None));
    }
    let mut note = format!(
        "no labels `{DEFAULT_SET}`, so no harmful shares; `harmzone label {}` makes them",
        dataset.display()
    );
    if !found.is_empty() {
        note += &format!("; or choose by --labels: {}", found.join(", "));
    }
    Ok((None, Some(note)))
}

fn describe(
    dataset: &Path,
    manifest: &Manifest,
    label_set: Option<String>,
    note: Option<String>,
    statistics: Statistics,
) -> Info {
    let is_labelled = label_set.is_some();
    let group = |group: &Group| GroupInfo::new(group, is_labelled);
    let of_names = |groups: &BTreeMap<String, Group>| -> BTreeMap<String, GroupInfo> {
        groups.iter().map(|(name, of_name)| (name.clone(), group(of_name))).collect()
    };
    let n_objects = statistics.all.objects.total();
    let ood = manifest.ood || statistics.all.objects.ood.values().into_iter().any(|n| *n > 0);
    let mut categories: Vec<CategoryInfo> = statistics
        .by_category
        .into_iter()
        .map(|(category, count)| {
            let n_harmful = is_labelled.then_some(count.labels.harmful);
            CategoryInfo { category, n_objects: count.n_objects, n_harmful }
        })
        .collect();
    categories.sort_by_key(|category| std::cmp::Reverse(category.n_objects));
    Info {
        dataset: dataset.to_owned(),
        generator_version: manifest.generator_version.clone(),
        data_version: manifest.format_version,
        part: manifest.part,
        made_with: manifest.made_with.clone(),
        seed: manifest.seed,
        ood,
        label_set,
        note,
        logs: Vec::new(),
        background: BTreeSet::new(),
        all: group(&statistics.all),
        splits: statistics.by_split.iter().map(|(&split, of_split)| (split, group(of_split))).collect(),
        towns: of_names(&statistics.by_town),
        weathers: of_names(&statistics.by_weather),
        comparison: comparison::rows(&statistics.all, ood, is_labelled),
        hardness: Hardness {
            more_than_half_occluded: share(statistics.n_occluded, n_objects),
            ten_points_or_fewer: share(statistics.n_few_points, n_objects),
            farthest_m: statistics.histograms.range_m.most,
        },
        unfamiliar: UnfamiliarInfo::new(&statistics.unfamiliar, is_labelled),
        n_bytes: statistics.n_bytes,
        bytes_per_sample: share(statistics.n_bytes, statistics.all.n_samples),
        categories,
        histograms: statistics.histograms,
    }
}

impl GroupInfo {
    fn new(group: &Group, is_labelled: bool) -> Self {
        let harmful = |distribution, kind| harmful_share(count_of(&group.labels, distribution, kind));
        Self {
            n_episodes: group.n_episodes,
            n_samples: group.n_samples,
            n_objects: group.objects.total(),
            objects_per_sample: share(group.objects.total(), group.n_samples),
            objects: group.objects,
            labels: is_labelled.then_some(group.labels),
            harmful_share: is_labelled.then(|| HarmfulShares {
                all: harmful(None, None),
                vehicle: harmful(None, Some(Kind::Vehicle)),
                pedestrian: harmful(None, Some(Kind::Pedestrian)),
                static_object: harmful(None, Some(Kind::Static)),
                id: harmful(Some(Distribution::Id), None),
                ood: harmful(Some(Distribution::Ood), None),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::manifest::LabelManifest;

    /// A data set without episodes, which has the label sets of these names.
    fn folder(sets: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let manifest = Manifest::new("0".repeat(64), 7, false);
        manifest.write(folder.path()).unwrap();
        for set in sets {
            fs::create_dir_all(LabelManifest::folder(folder.path(), set)).unwrap();
            LabelManifest::new(set, String::new(), &manifest).write(folder.path()).unwrap();
        }
        folder
    }

    fn info(folder: &Path, label_set: Option<&str>) -> Result<Info, InfoError> {
        let label_set = label_set.map(str::to_owned);
        let request = InfoRequest { dataset: folder.to_owned(), label_set, plot: None, force: false };
        run(&request, &crate::progress::Silent)
    }

    #[test]
    fn an_unlabelled_set_is_described_and_told_how_to_label() {
        let folder = folder(&["wide"]);
        let info = info(folder.path(), None).unwrap();
        assert_eq!((&info.label_set, info.all.labels, info.bytes_per_sample), (&None, None, None));
        let text = info.to_string();
        assert!(text.contains("harmzone label") && text.contains("--labels: wide"), "{text}");
    }

    #[test]
    fn a_label_set_that_was_named_must_be_there() {
        let folder = folder(&[DEFAULT_SET]);
        assert_eq!(info(folder.path(), None).unwrap().label_set.as_deref(), Some(DEFAULT_SET));
        let message = info(folder.path(), Some("wide")).unwrap_err().to_string();
        assert!(message.contains("wide") && message.contains(DEFAULT_SET), "{message}");
    }

    #[test]
    fn a_set_that_holds_unfamiliar_objects_is_called_so_whatever_its_manifest_says() {
        let manifest = Manifest::new("0".repeat(64), 7, false);
        let mut statistics = Statistics::default();
        let mut text_of = |n_unfamiliar| {
            statistics.all.objects.ood.static_object = n_unfamiliar;
            describe(Path::new("drives"), &manifest, None, None, statistics.clone()).to_string()
        };
        assert!(text_of(0).starts_with("drives: in distribution,"));
        assert!(text_of(1).starts_with("drives: in and out of distribution,"));
    }

    #[test]
    fn a_picture_that_exists_needs_force() {
        let folder = folder(&[]);
        let plot = folder.path().join("plot.png");
        let mut request = InfoRequest {
            dataset: folder.path().to_owned(),
            label_set: None,
            plot: Some(plot.clone()),
            force: false,
        };
        run(&request, &crate::progress::Silent).unwrap();
        assert!(image::open(&plot).unwrap().width() > 1000);
        assert!(matches!(run(&request, &crate::progress::Silent), Err(InfoError::Exists { .. })));
        request.force = true;
        run(&request, &crate::progress::Silent).unwrap();
    }
}
