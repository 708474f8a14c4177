//! Results as KITTI's evaluation takes them: a folder with one `NNNNNN.txt` a frame, boxes in the rectified camera's frame.
//!
//! Frames are those of `harmzone export kitti`, or the log's own where the data set was imported from KITTI. Rows hold no velocity.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::error::ExchangeError;
use super::export::WriteBoxes;
use super::import::{ForeignBox, ReadBoxes};
use super::samples::NamedSample;
use crate::episode::Manifest;
use crate::export::kitti::{FrameNames, KittiRig, KittiRow, type_of_harm};
use crate::export::nuscenes::Naming;
use crate::files::{FolderContent, NewFolder};
use crate::object::Detection;

/// The file by which the program knows a folder of results as its own.
const MARKER: &str = "harmzone-results.json";

/// All files of such a folder.
const CONTENT: FolderContent = FolderContent { marker: MARKER, files: &["######.txt"] };

/// A folder of results to be written.
pub struct KittiWriter {
    folder: NewFolder,
    path: PathBuf,
    naming: Naming,
    names: FrameNames,
}

/// A folder of results that was read.
pub struct KittiReader {
    path: PathBuf,
    names: FrameNames,
    /// Files by frame that no sample has asked for.
    files: BTreeMap<String, PathBuf>,
}

impl KittiWriter {
    /// Starts a folder for predictions on a data set; `naming` gives harm a name: [`Naming::Harm`] or [`Naming::HarmAsCarTruck`].
    ///
    /// # Errors
    /// The folder is there and may not be replaced, or the data set cannot be read.
    pub fn create(path: &Path, data: &Path, naming: Naming, force: bool) -> Result<Self, ExchangeError> {
        let names = FrameNames::of(data, &Manifest::read(data)?)?;
        let folder = NewFolder::create(path, CONTENT, force)?;
        folder.write(MARKER, b"{\"format\": \"kitti\"}\n")?;
        Ok(Self { folder, path: path.to_owned(), naming, names })
    }
}

impl WriteBoxes for KittiWriter {
    fn add(&mut self, sample: &NamedSample<'_>, found: &[Detection]) -> Result<(), ExchangeError> {
        let fail = |message: String| ExchangeError::Foreign {
            message: format!("sample `{}`: {message}", sample.id),
            path: self.path.clone(),
        };
        let frame = frame_of(&self.names, sample, &self.path)?;
        let rig = KittiRig::of(sample.measured, sample.log).map_err(fail)?;
        let row = |of: &Detection| {
            let row =
                KittiRow::of_detection(type_of_harm(self.naming, of.harm), &of.box_in_ego, of.score, &rig);
            format!("{row}\n")
        };
        let text: String = found.iter().map(row).collect();
        Ok(self.folder.write(&format!("{frame}.txt"), text.as_bytes())?)
    }

    fn finish(self: Box<Self>) -> Result<(), ExchangeError> {
        Ok(self.folder.finish()?)
    }
}

impl KittiReader {
    /// Finds the files of results on a data set.
    ///
    /// # Errors
    /// No such folder, no file in it, or the data set cannot be read.
    pub fn open(path: &Path, data: &Path) -> Result<Self, ExchangeError> {
        let names = FrameNames::of(data, &Manifest::read(data)?)?;
        let mut files = BTreeMap::new();
        for entry in fs::read_dir(path)? {
            let file = entry?.path();
            if file.extension().is_some_and(|ending| ending == "txt") {
                let stem = file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
                files.insert(stem.unwrap_or_default(), file);
            }
        }
        if files.is_empty() {
            let message = "no results of KITTI: one `NNNNNN.txt` a frame is needed".to_owned();
            return Err(ExchangeError::Foreign { message, path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), names, files })
    }
}

impl ReadBoxes for KittiReader {
    fn boxes_of(&mut self, sample: &NamedSample<'_>) -> Result<Option<Vec<ForeignBox>>, ExchangeError> {
        let frame = frame_of(&self.names, sample, &self.path)?;
        let Some(path) = self.files.remove(frame) else { return Ok(None) };
        let fail = |message: String| ExchangeError::Foreign {
            message: format!("sample `{}`: {message}", sample.id),
            path: path.clone(),
        };
        let rig = KittiRig::of(sample.measured, sample.log).map_err(fail)?;
        let text = fs::read_to_string(&path)?;
        let rows = text.lines().filter(|line| !line.trim().is_empty()).enumerate();
        let read = |(index, line): (usize, &str)| {
            parse_box(line, &rig).map_err(|message| ExchangeError::BadBox {
                message,
                index,
                sample: sample.id.to_owned(),
                path: path.clone(),
            })
        };
        // A region without a class is no box.
        rows.filter(|(_, line)| !line.starts_with("DontCare")).map(read).collect::<Result<_, _>>().map(Some)
    }

    fn n_unknown(&self) -> usize {
        self.files.len()
    }

    fn path(&self) -> &Path {
        &self.path
    }
}

fn parse_box(line: &str, rig: &KittiRig) -> Result<ForeignBox, String> {
    let row = KittiRow::parse_result(line)?;
    let box_in_ego = rig.in_ego(&row.of);
    box_in_ego.check().map_err(|fault| fault.to_string())?;
    // KITTI's types begin with a capital letter; harm's names and the devkit's classes do not.
    let (name, score) = (row.name.to_lowercase(), row.score.unwrap_or_default());
    Ok(ForeignBox { box_in_ego, velocity_in_ego_mps: [f64::NAN; 2], name, score })
}

/// The frame of a sample, which the data set must hold.
fn frame_of<'a>(
    names: &'a FrameNames,
    sample: &NamedSample<'_>,
    path: &Path,
) -> Result<&'a str, ExchangeError> {
    names.get(&sample.episode.name, sample.sample_idx).ok_or_else(|| ExchangeError::Foreign {
        message: format!("sample `{}` is not in the data set's manifest", sample.id),
        path: path.to_owned(),
    })
}
