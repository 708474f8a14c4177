//! An episode, its labels and predictions as a recording for Rerun, which a process of Python with rerun-sdk writes.
//!
//! Rerun's own crate would add more crates to the build than harmzone has dependencies; its Python package is one wheel. The process is
//! told each sample in a line of JSON and the bytes of picture and points after it (`python/harmzone/_rerun.py`).

use std::io::{self, ErrorKind, Write};
use std::path::Path;

use fs_err as fs;
use serde::Serialize;
use serde_json::{Value, json};
use tempfile::TempPath;

use super::clip::make_room;
use super::episode_view::{EpisodeView, ViewedSample};
use super::load::ViewError;
use super::palette;
use super::rerun_process::RerunProcess;
use crate::files::{FolderLock, PARTIAL_SUFFIX, keep_as, remove_if_there, sha256_hex};
use crate::geometry::{Box3, Ego, Frame, Point, Transform};
use crate::interrupt;
use crate::object::{Detection, Harm, Object};
use crate::progress::Progress;
use crate::sample::ImageFormat;
use crate::scene::car::EGO_LENGTH_M;
use crate::scene::ego_glb;
use crate::store::sha256_of;

/// Digits of the hash in a recording's id.
const ID_DIGITS: usize = 16;

/// Writes the recording of a whole episode.
///
/// # Errors
/// A file is there already and no `force`; there is no Python with rerun-sdk; a broken file.
pub fn write_episode_rrd(
    view: &EpisodeView,
    out: &Path,
    force: bool,
    progress: &dyn Progress,
) -> Result<(), ViewError> {
    make_room(out, force)?;
    let _lock = FolderLock::take_beside(out)?;
    let mut partial = out.as_os_str().to_owned();
    partial.push(format!(".{PARTIAL_SUFFIX}"));
    // It is removed where anything fails.
    let partial = TempPath::try_from_path(partial)?;
    remove_if_there(&partial)?;
    let mut process = RerunProcess::start(&partial)?;
    progress.start("record", view.n_samples() as u64);
    let told = tell(view, process.input(), progress);
    match told {
        // What it says tells more than that it no longer reads.
        Err(ViewError::Io(error)) if error.kind() == ErrorKind::BrokenPipe => {
            process.finish()?;
            return Err(error.into());
        }
        Err(error) => {
            // It was not told all, and what it says of that is no news.
            let _ = process.finish();
            return Err(error);
        }
        Ok(()) => process.finish()?,
    }
    progress.finish();
    fs::File::open(&partial)?.sync_all()?;
    Ok(keep_as(partial, out)?)
}

/// What a recording is made from, by which two of one episode's name are told apart: drivers share the names of their episodes.
#[derive(Debug, Clone, Serialize)]
struct RecordedFiles {
    episode_sha256: String,
    labels_sha256: Option<String>,
    detections_sha256: Option<String>,
    /// Of the detections.
    min_score: Option<f64>,
}

impl RecordedFiles {
    fn of(view: &EpisodeView) -> io::Result<Self> {
        Ok(Self {
            episode_sha256: view.entry.sha256.clone(),
            labels_sha256: view.labels.as_ref().map(|labels| sha256_of(labels.path())).transpose()?,
            detections_sha256: view.detections.as_ref().map(|found| sha256_of(found.path())).transpose()?,
            min_score: view.detections.as_ref().map(|_| view.min_score),
        })
    }

    /// The recording's id: the episode's name with a short hash of this.
    fn id(&self, episode: &str) -> String {
        let json = serde_json::to_string(self).expect("texts and numbers have a JSON form");
        format!("{episode}-{}", &sha256_hex(json.as_bytes())[..ID_DIGITS])
    }
}

/// Tells the header and every sample.
fn tell(view: &EpisodeView, to: &mut impl Write, progress: &dyn Progress) -> Result<(), ViewError> {
    let first = view.sample(0)?;
    let map = view.episode.map()?;
    let glb = ego_glb();
    let lines: Vec<Vec<[f64; 3]>> =
        map.lane_lines.iter().map(|line| line.iter().map(plain).collect()).collect();
    let road: Vec<[[f64; 3]; 3]> =
        map.drivable_area.iter().map(|corners| corners.each_ref().map(plain)).collect();
    let front_m = first.sample.measured.ego_state.front_bumper_x_m;
    let recording_id = RecordedFiles::of(view)?.id(view.name());
    let header = json!({
        "bytes": [glb.len()], "episode": view.name(), "recording_id": recording_id,
        "colors": colors(), "lane_lines": lines, "road": road, "car_x_m": front_m - EGO_LENGTH_M / 2.0,
    });
    write_message(to, &header, &[&glb])?;
    for sample_idx in 0..view.n_samples() {
        interrupt::check()?;
        tell_sample(&view.sample(sample_idx)?, to)?;
        progress.advance(1);
    }
    Ok(to.flush()?)
}

fn write_message(to: &mut impl Write, said: &Value, parts: &[&[u8]]) -> Result<(), ViewError> {
    serde_json::to_writer(&mut *to, said).map_err(std::io::Error::from)?;
    to.write_all(b"\n")?;
    Ok(parts.iter().try_for_each(|part| to.write_all(part))?)
}

fn colors() -> Value {
    json!({
        "harmful": palette::truth(Harm::Harmful).rgb, "harmless": palette::truth(Harm::Harmless).rgb,
        "unlabelled": palette::UNLABELLED.rgb, "predicted_harmful": palette::predicted(Harm::Harmful).rgb,
        "predicted_harmless": palette::predicted(Harm::Harmless).rgb, "zone": palette::ZONE.rgb,
        "ring": palette::TEXT_SOFT.rgb, "road": palette::WEDGE.rgb, "text": palette::TEXT.rgb,
    })
}

fn tell_sample(viewed: &ViewedSample, to: &mut impl Write) -> Result<(), ViewError> {
    let (sample, measured) = (&viewed.sample, &viewed.sample.measured);
    let (low_m, high_m) = palette::HEIGHT_RANGE_M;
    let (mut points, mut point_colors) = (Vec::new(), Vec::new());
    for point in &measured.points {
        let in_lidar = Point::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m));
        let in_ego = measured.ego_from_lidar * in_lidar;
        let place = [in_ego.x() as f32, in_ego.y() as f32, in_ego.z() as f32];
        points.extend(place.into_iter().flat_map(f32::to_le_bytes));
        point_colors.extend(palette::height((place[2] - low_m) / (high_m - low_m)).rgb);
    }
    let (ego, camera) = (sample.true_state(), &measured.intrinsics);
    let farthest_x_m = viewed.zone.iter().flatten().map(|corner| corner.x_m).reduce(f64::max);
    let detections = viewed.detections.as_deref();
    let predicted = |wanted: Harm| -> Vec<BoxTold> {
        let of_harm = detections.unwrap_or_default().iter().filter(|found| found.harm == wanted);
        of_harm.map(BoxTold::of_detection).collect()
    };
    let parts = [measured.image.bytes.as_slice(), &points, &point_colors];
    let said = json!({
        "bytes": parts.map(<[u8]>::len),
        "time_ns": measured.time_ns,
        "sample_idx": viewed.sample_idx,
        "world_from_ego": rows(&measured.world_from_ego),
        "ego_from_camera": rows(&measured.ego_from_camera),
        "image_from_camera":
            [[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]],
        "size_px": [camera.width_px, camera.height_px],
        "media_type": match measured.image.format {
            ImageFormat::Jpeg => "image/jpeg",
            ImageFormat::Png => "image/png",
        },
        "zone": viewed.zone.as_ref().map(|corners| {
            corners.iter().map(|corner| [corner.x_m, corner.y_m]).collect::<Vec<_>>()
        }),
        "truth": truth(viewed),
        "predicted": detections.map(|_| json!({
            "harmful": predicted(Harm::Harmful), "harmless": predicted(Harm::Harmless)
        })),
        "speed_mps": ego.speed_mps,
        "steering_deg": ego.steering_angle_rad.to_degrees(),
        "zone_depth_m": farthest_x_m.map(|x_m| (x_m - ego.front_bumper_x_m).max(0.0)),
        "n_harmful": viewed.harms.as_ref().map(|_| viewed.n_harmful()),
        "n_predicted_harmful": detections.map(|_| predicted(Harm::Harmful).len()),
    });
    write_message(to, &said, &parts)
}

/// True boxes by harm and distribution: `harmful/ood`.
fn truth(viewed: &ViewedSample) -> Value {
    let mut kinds = serde_json::Map::new();
    let harms =
        if viewed.harms.is_some() { vec![Some(Harm::Harmful), Some(Harm::Harmless)] } else { vec![None] };
    for harm in harms {
        for (is_ood, distribution) in [(false, "id"), (true, "ood")] {
            let objects = viewed.sample.objects().iter().enumerate();
            let of_kind = objects.filter(|(i, object)| {
                object.is_ood() == is_ood && viewed.harms.as_ref().map(|harms| harms[*i]) == harm
            });
            let is_named = is_ood || harm == Some(Harm::Harmful);
            let told: Vec<BoxTold> =
                of_kind.map(|(_, object)| BoxTold::of_object(object, is_named)).collect();
            let name = harm.map_or("unlabelled", Harm::name);
            kinds.insert(format!("{name}/{distribution}"), json!(told));
        }
    }
    Value::Object(kinds)
}

/// A box as the process is told it.
#[derive(Serialize)]
struct BoxTold {
    center_m: [f64; 3],
    size_m: [f64; 3],
    yaw_rad: f64,
    label: String,
}

impl BoxTold {
    fn of_object(object: &Object, is_named: bool) -> Self {
        let name = object.category.as_ref().filter(|_| is_named);
        let label = name.map(|name| name.replace('_', " ")).unwrap_or_default();
        Self { label, ..Self::of_box(&object.box_in_ego) }
    }

    fn of_detection(detection: &Detection) -> Self {
        Self { label: format!("{:.2}", detection.score), ..Self::of_box(&detection.box_in_ego) }
    }

    fn of_box(placed: &Box3<Ego>) -> Self {
        Self {
            center_m: plain(&placed.center),
            size_m: [placed.length_m, placed.width_m, placed.height_m],
            yaw_rad: placed.yaw_rad,
            label: String::new(),
        }
    }
}

fn plain<F: Frame>(point: &Point<F>) -> [f64; 3] {
    [point.x(), point.y(), point.z()]
}

/// A transform as a matrix, row by row.
fn rows<To: Frame, From: Frame>(to_from: &Transform<To, From>) -> [[f64; 4]; 4] {
    let matrix = to_from.isometry.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn recordings_from_other_files_or_another_score_have_ids_of_their_own() {
        let hash = |digit: &str| digit.repeat(64);
        let bare = RecordedFiles {
            episode_sha256: hash("a"),
            labels_sha256: None,
            detections_sha256: None,
            min_score: None,
        };
        let labelled = RecordedFiles { labels_sha256: Some(hash("b")), ..bare.clone() };
        let found =
            RecordedFiles { detections_sha256: Some(hash("c")), min_score: Some(0.3), ..labelled.clone() };
        let all = [
            RecordedFiles { episode_sha256: hash("d"), ..found.clone() },
            RecordedFiles { labels_sha256: Some(hash("d")), ..found.clone() },
            RecordedFiles { detections_sha256: Some(hash("d")), ..found.clone() },
            RecordedFiles { min_score: Some(0.2), ..found.clone() },
            bare,
            labelled,
            found,
        ];
        let ids: BTreeSet<String> = all.iter().map(|files| files.id("town-7")).collect();
        assert_eq!(ids.len(), all.len());
        assert!(all.iter().all(|files| ids.contains(&files.id("town-7"))), "the same files have the same id");
        assert!(ids.iter().all(|id| id.starts_with("town-7-") && id.len() == "town-7-".len() + ID_DIGITS));
    }
}
