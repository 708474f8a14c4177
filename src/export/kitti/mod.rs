//! A data set as KITTI's object set: clouds, left colour pictures, calibration, labels, lists of frames.
//!
//! Frames of the splits train and val lie in `training`, those of dev and test in `testing`, which has labels too; without either it
//! is a link to `training`, and its list that of val. What the layout cannot hold lies beside it in files of our own: the ego's state, the rings, and in `harmzone.json` which sample each frame is.

mod frames;
mod label;
mod layout;
mod rig;
mod state;

use std::collections::BTreeMap;
use std::fmt;
use std::io::Cursor;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

use super::nuscenes::Naming;
use super::{DataSource, ExportError, LabelledEpisode, MARKER};
use crate::episode::{EpisodeEntry, Split};
use crate::files::NewFolder;
use crate::interrupt;
use crate::progress::Progress;
use crate::sample::{EncodedImage, ImageFormat, Sample};

pub use frames::FrameNames;
pub use label::{KittiRow, type_of_harm};
use layout::{CONTENT, PARTS};
pub use rig::{KittiRig, RectifiedBox};
use state::{EgoStateFile, cloud_bytes, ring_bytes};

/// What to export.
#[derive(Debug)]
pub struct KittiRequest<'a> {
    pub dataset: &'a Path,
    pub out: &'a Path,
    /// The label set of namings that tell harm.
    pub labels: &'a str,
    pub naming: Naming,
    pub force: bool,
}

/// What was exported.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct KittiSummary {
    pub n_frames: BTreeMap<Split, usize>,
    pub n_labels: usize,
    /// Objects that are not in the picture, which KITTI does not label.
    pub n_out_of_view: usize,
    pub n_ignored_regions: usize,
    /// JPEG pictures, unpacked to PNG.
    pub n_unpacked: usize,
    /// Frames that nobody annotated, which have no label file.
    pub n_without_truth: usize,
    /// Pictures of further cameras, for which the object set has no place.
    pub n_pictures_left_out: usize,
}

impl KittiSummary {
    fn merge(&mut self, other: &Self) {
        for (split, n) in &other.n_frames {
            *self.n_frames.entry(*split).or_default() += n;
        }
        self.n_labels += other.n_labels;
        self.n_out_of_view += other.n_out_of_view;
        self.n_ignored_regions += other.n_ignored_regions;
        self.n_unpacked += other.n_unpacked;
        self.n_without_truth += other.n_without_truth;
        self.n_pictures_left_out += other.n_pictures_left_out;
    }
}

impl fmt::Display for KittiSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames: Vec<String> =
            self.n_frames.iter().map(|(split, n)| format!("{n} {}", split.name())).collect();
        writeln!(f, "frames           {}", frames.join(", "))?;
        writeln!(f, "labels           {}", self.n_labels)?;
        for (name, n) in [
            ("out of view", self.n_out_of_view),
            ("DontCare", self.n_ignored_regions),
            ("unpacked JPEGs", self.n_unpacked),
            ("without truth", self.n_without_truth),
        ] {
            if n > 0 {
                writeln!(f, "{name:<16} {n}")?;
            }
        }
        Ok(())
    }
}

/// A frame in `harmzone.json`.
#[derive(Debug, Serialize)]
struct FrameEntry {
    frame: String,
    episode: String,
    sample_idx: usize,
    split: Split,
    /// Ids of the label file's rows, in their order; `DontCare` has none.
    objects: Vec<Option<String>>,
}

/// `harmzone.json`, by which the program knows its own export.
#[derive(Debug, Serialize)]
struct ExportFile<'a> {
    format: &'static str,
    generator_version: &'static str,
    dataset_config_sha256: &'a str,
    labels: Option<&'a str>,
    categories: &'static str,
    frames: Vec<FrameEntry>,
}

/// Exports a data set.
///
/// # Errors
/// Something is at `out`, labels are missing, a file is damaged, a camera looks straight up or down, or a signal asks to end.
pub fn run(request: &KittiRequest<'_>, progress: &dyn Progress) -> Result<KittiSummary, ExportError> {
    let labels = request.naming.needs_labels().then_some(request.labels);
    let source = DataSource::open(request.dataset, labels)?;
    let manifest = source.manifest();
    let folder = NewFolder::create(request.out, CONTENT, request.force)?;
    let names = FrameNames::of(request.dataset, manifest)?;
    // Where nothing is for the test, dev or validation takes its place, since mmdetection3d's converter wants frames there.
    let has = |split: &Split| manifest.of_split(*split).next().is_some();
    let for_test = [Split::Test, Split::Dev].into_iter().find(has).unwrap_or(Split::Val);
    let has_test = for_test != Split::Val;
    if !has_test {
        fs_err::os::unix::fs::symlink("training", folder.path().join("testing"))?;
    }
    for half in ["training", "testing"].into_iter().filter(|half| has_test || *half == "training") {
        for part in PARTS {
            folder.make(&format!("{half}/{part}"))?;
        }
    }
    progress.start("export", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
    let write = |entry: &EpisodeEntry| {
        progress.note(&entry.name);
        write_episode(&source.episode(entry)?, request.naming, &names, &folder, progress)
    };
    let written: Vec<(KittiSummary, Vec<FrameEntry>)> =
        manifest.episodes.par_iter().map(write).collect::<Result<_, ExportError>>()?;
    progress.finish();
    let (mut summary, mut frames) = (KittiSummary::default(), Vec::new());
    for (of_episode, entries) in written {
        summary.merge(&of_episode);
        frames.extend(entries);
    }
    write_lists(&frames, for_test, &folder)?;
    let file = ExportFile {
        format: "kitti",
        generator_version: env!("CARGO_PKG_VERSION"),
        dataset_config_sha256: &manifest.config_sha256,
        labels,
        categories: request.naming.name(),
        frames,
    };
    let bytes = serde_json::to_vec_pretty(&file).expect("the list of frames has a JSON form");
    folder.write(MARKER, &bytes)?;
    folder.finish()?;
    Ok(summary)
}

/// Whether KITTI's folder for frames to score takes a split.
fn is_for_testing(split: Split) -> bool {
    matches!(split, Split::Dev | Split::Test)
}

/// `ImageSets/<list>.txt`: a frame a line.
fn write_lists(frames: &[FrameEntry], for_test: Split, folder: &NewFolder) -> Result<(), ExportError> {
    folder.make("ImageSets")?;
    let lists: [(&str, &[Split]); 4] = [
        ("train", &[Split::Train]),
        ("val", &[Split::Val]),
        ("trainval", &[Split::Train, Split::Val]),
        ("test", &[for_test]),
    ];
    for (name, splits) in lists {
        let of_list = frames.iter().filter(|entry| splits.contains(&entry.split));
        let mut names: Vec<&str> = of_list.map(|entry| entry.frame.as_str()).collect();
        names.sort_unstable();
        let text: String = names.iter().flat_map(|name| [name, "\n"]).collect();
        folder.write(&format!("ImageSets/{name}.txt"), text.as_bytes())?;
    }
    Ok(())
}

fn write_episode(
    episode: &LabelledEpisode,
    naming: Naming,
    names: &FrameNames,
    folder: &NewFolder,
    progress: &dyn Progress,
) -> Result<(KittiSummary, Vec<FrameEntry>), ExportError> {
    let entry = episode.entry();
    let half = if is_for_testing(entry.split) { "testing" } else { "training" };
    let (mut summary, mut frames) = (KittiSummary::default(), Vec::new());
    for sample_idx in 0..episode.reader.len() {
        interrupt::check()?;
        let frame = names.get(&entry.name, sample_idx).expect("every sample has a name").to_owned();
        let (sample, harms) = episode.sample(sample_idx)?;
        let unfit = |message: String| ExportError::Unfit {
            message: format!("sample {sample_idx} of episode `{}`: {message}", entry.name),
            path: episode.reader.path().to_owned(),
        };
        let rig = KittiRig::of(&sample.measured, episode.reader.log()).map_err(unfit)?;
        let write = |part: &str, ending: &str, bytes: &[u8]| {
            folder.write(&format!("{half}/{part}/{frame}.{ending}"), bytes)
        };
        write("velodyne", "bin", &cloud_bytes(&sample.measured.points))?;
        write("ring", "bin", &ring_bytes(&sample.measured.points))?;
        write("calib", "txt", rig.calibration_text().as_bytes())?;
        let image = &sample.measured.image;
        summary.n_unpacked += usize::from(image.format == ImageFormat::Jpeg);
        let png = png_of(image).map_err(|error| unfit(format!("its picture cannot be unpacked: {error}")))?;
        write("image_2", "png", png.as_deref().unwrap_or(&image.bytes))?;
        let state = EgoStateFile::new(&entry.name, sample_idx, entry.split, &sample.measured);
        let state = serde_json::to_vec_pretty(&state).expect("a state has a JSON form");
        write("ego_state", "json", &state)?;
        let objects = match label_text(&sample, &harms, naming, &rig, &mut summary) {
            Some((text, ids)) => {
                write("label_2", "txt", text.as_bytes())?;
                ids
            }
            None => Vec::new(),
        };
        let episode = entry.name.clone();
        frames.push(FrameEntry { frame, episode, sample_idx, split: entry.split, objects });
        progress.advance(1);
    }
    summary.n_pictures_left_out = episode.reader.cameras().len() * episode.reader.len();
    summary.n_frames.insert(entry.split, episode.reader.len());
    Ok((summary, frames))
}

/// The label file and the ids of its rows; `None` where nobody annotated.
fn label_text(
    sample: &Sample,
    harms: &[crate::object::Harm],
    naming: Naming,
    rig: &KittiRig,
    summary: &mut KittiSummary,
) -> Option<(String, Vec<Option<String>>)> {
    let Some(truth) = &sample.truth else {
        summary.n_without_truth += 1;
        return None;
    };
    let (mut text, mut ids) = (String::new(), Vec::new());
    for (i, object) in truth.objects.iter().enumerate() {
        let name = label::type_of(naming, object, harms.get(i).copied());
        let Some(row) = KittiRow::of_object(name, object, rig) else {
            summary.n_out_of_view += 1;
            continue;
        };
        text += &format!("{row}\n");
        ids.push(object.id.clone());
    }
    summary.n_labels += ids.len();
    for row in truth.ignored.iter().filter_map(|region| KittiRow::of_ignored(region, rig)) {
        text += &format!("{row}\n");
        summary.n_ignored_regions += 1;
    }
    Some((text, ids))
}

/// A picture as PNG; `None` where its own bytes are one.
fn png_of(image: &EncodedImage) -> Result<Option<Vec<u8>>, image::ImageError> {
    if image.format == ImageFormat::Png {
        return Ok(None);
    }
    let mut bytes = Cursor::new(Vec::new());
    image.decode()?.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(Some(bytes.into_inner()))
}
