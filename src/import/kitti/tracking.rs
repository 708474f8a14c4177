//! The tracking set: `training/{velodyne,image_02,calib,label_02,oxts}/NNNN`, and `testing` without labels.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::calib::Calibration;
use super::label::read_tracking_labels;
use super::oxts::Packet;
use super::rig::{FRONT, Rig};
use super::sequence::{Annotated, Parts};
use crate::files;
use crate::import::ImportError;
use crate::import::error::read_text;

/// The set has no stamps: ten frames a second, from 26 September 2011.
const FIRST_NS: u64 = 1_316_995_200_000_000_000;
const STEP_NS: u64 = 100_000_000;

/// Reads what a sequence needs. `folder` is `training` or `testing`.
pub(super) fn read_sequence(folder: &Path, sequence: &str, rig: &Rig) -> Result<Parts, ImportError> {
    let calibration = Calibration::read(&folder.join("calib").join(format!("{sequence}.txt")))?;
    let oxts = folder.join("oxts").join(format!("{sequence}.txt"));
    let lines = read_text(&oxts)?;
    let packets = lines.lines().filter(|line| !line.trim().is_empty()).enumerate();
    let time_ns = |frame_idx: usize| FIRST_NS + frame_idx as u64 * STEP_NS;
    let packet = |(i, line): (usize, &str)| Ok((time_ns(i), Packet::parse(line, &oxts)?));
    let packets = packets.map(packet).collect::<Result<Vec<_>, ImportError>>()?;
    let labels = folder.join("label_02").join(format!("{sequence}.txt"));
    let has_labels = files::is_dir(&folder.join("label_02"))?;
    let annotated =
        if has_labels { Some(annotate(&labels, rig, &calibration, packets.len())?) } else { None };
    let frames: Vec<(String, u64)> = (0..packets.len()).map(|i| (format!("{i:06}"), time_ns(i))).collect();
    let clouds = folder.join("velodyne").join(sequence);
    // Four clouds of sequence 0001 are missing in the set itself.
    let of_frames = frames.iter().map(|(stem, _)| clouds.join(format!("{stem}.bin")));
    if files::first_there(of_frames)?.is_none() {
        return Err(ImportError::at(&clouds, "the sequence has no clouds"));
    }
    let methods = vec![("time", "made up: the set has no stamps, but 10 frames a second".to_owned())];
    Ok(Parts {
        path: folder.to_owned(),
        description: format!("KITTI tracking set, sequence {sequence}"),
        picture_times_ns: frames.iter().map(|(_, time_ns)| *time_ns).collect(),
        frames,
        clouds,
        pictures: |parts, number| pictures(parts, number),
        calibration,
        packets,
        annotated,
        methods,
    })
}

/// `velodyne/NNNN` lies beside `image_02/NNNN`.
fn pictures(parts: &Parts, number: usize) -> PathBuf {
    let sequence = parts.clouds.file_name().unwrap_or_default();
    parts.path.join(format!("image_{number:02}")).join(sequence)
}

fn annotate(
    labels: &Path,
    rig: &Rig,
    calibration: &Calibration,
    n_frames: usize,
) -> Result<BTreeMap<usize, Annotated>, ImportError> {
    let ego_from_rect = rig.ego_from_rect(calibration);
    let mut annotated: BTreeMap<usize, Annotated> = BTreeMap::new();
    for row in read_tracking_labels(labels)? {
        if row.frame >= n_frames {
            let message =
                format!("a label is of frame {}; the sequence has {n_frames} (packets of oxts)", row.frame);
            return Err(ImportError::at(labels, message));
        }
        let of_frame = annotated.entry(row.frame).or_default();
        if row.is_region() {
            of_frame.ignored.push(row.region());
        } else {
            of_frame.objects.push(row.object(&ego_from_rect, [f64::NAN; 2]));
        }
    }
    Ok(annotated)
}

/// Whether a folder holds sequences: folders of clouds.
///
/// # Errors
/// It cannot be looked into.
pub(super) fn is_tracking(folder: &Path) -> std::io::Result<bool> {
    let mut is_hinted = false;
    for part in [&format!("image_0{FRONT}"), "label_02", "oxts"] {
        is_hinted |= files::is_dir(&folder.join(part))?;
    }
    if !is_hinted {
        return Ok(false);
    }
    for entry in fs_err::read_dir(folder.join("velodyne"))? {
        if files::is_dir(&entry?.path())? {
            return Ok(true);
        }
    }
    Ok(false)
}
