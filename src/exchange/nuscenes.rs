//! Results as nuScenes' devkit takes them: boxes in the global frame, by sample token.
//!
//! `{"meta": {..}, "results": {"<sample token>": [{"sample_token", "translation", "size", "rotation", "velocity",
//! "detection_name", "detection_score", "attribute_name"}]}}`. Tokens are those of `harmzone export nuscenes`, or the log's own where
//! the data set was imported from nuScenes.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use fs_err as fs;
use nalgebra::Vector3;
use serde::Deserialize;

use super::error::ExchangeError;
use super::export::WriteBoxes;
use super::import::{ForeignBox, ReadBoxes};
use super::samples::NamedSample;
use crate::eval::json::replace_python_numbers;
use crate::export::DataSource;
use crate::export::nuscenes::{GlobalFrames, Naming, sample_token};
use crate::files::{self, write_atomic};
use crate::geometry::{Box3, Ego, Point, Transform, World};
use crate::nuscenes::{Token, default_attribute, detection_class, isometry_of};
use crate::object::Detection;

/// The devkit refuses more boxes in a sample.
const MAX_BOXES: usize = 500;

/// A results file to be written.
pub struct ResultsWriter {
    path: PathBuf,
    naming: Naming,
    frames: GlobalFrames,
    text: String,
}

/// A results file that was read.
pub struct ResultsReader {
    path: PathBuf,
    frames: GlobalFrames,
    boxes: HashMap<Token, Vec<RawResult>>,
}

#[derive(Deserialize)]
struct ResultsFile {
    results: BTreeMap<String, Vec<RawResult>>,
}

/// A box as the file has it. Keys that are not needed are ignored.
#[derive(Deserialize)]
struct RawResult {
    translation: [f64; 3],
    size: [f64; 3],
    rotation: [f64; 4],
    #[serde(default)]
    velocity: [Option<f64>; 2],
    detection_name: String,
    detection_score: f64,
}

/// The token of a sample.
fn token_of(sample: &NamedSample<'_>) -> Token {
    sample_token(sample.log, &sample.episode.name, sample.sample_idx, sample.measured.time_ns)
}

/// The ego's pose in the global frame of an export.
fn global_from_ego(frames: &GlobalFrames, sample: &NamedSample<'_>) -> Transform<World, Ego> {
    frames.global_from_world(&sample.episode.name) * sample.measured.world_from_ego
}

impl ResultsWriter {
    /// Starts a file for predictions on a data set; `naming` gives harm a name: [`Naming::Harm`], or
    /// [`Naming::HarmAsCarTruck`] for the devkit's own evaluation.
    ///
    /// # Errors
    /// The file exists and may not be replaced, or the data set cannot be read.
    pub fn create(path: &Path, data: &Path, naming: Naming, force: bool) -> Result<Self, ExchangeError> {
        if !force && files::is_there(path)? {
            return Err(ExchangeError::Exists { path: path.to_owned() });
        }
        let frames = GlobalFrames::of(&DataSource::open(data, None)?)?;
        Ok(Self { path: path.to_owned(), naming, frames, text: String::new() })
    }
}

impl WriteBoxes for ResultsWriter {
    fn add(&mut self, sample: &NamedSample<'_>, found: &[Detection]) -> Result<(), ExchangeError> {
        if found.len() > MAX_BOXES {
            let message = format!(
                "{} boxes in sample `{}`; nuScenes takes {MAX_BOXES} at most",
                found.len(),
                sample.id
            );
            return Err(ExchangeError::Foreign { message, path: self.path.clone() });
        }
        let (token, global_from_ego) = (token_of(sample), global_from_ego(&self.frames, sample));
        let boxes = found.iter().map(|detection| text_of(detection, &token, &global_from_ego, self.naming));
        let separator = if self.text.is_empty() { "" } else { ",\n" };
        let boxes = boxes.collect::<Vec<_>>().join(",\n");
        write!(self.text, "{separator}\"{token}\": [{boxes}]").expect("writing to a string cannot fail");
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), ExchangeError> {
        const META: &str = r#"{"use_camera": true, "use_lidar": true, "use_radar": false, "use_map": false, "use_external": false}"#;
        let text = format!("{{\"meta\": {META}, \"results\": {{\n{}\n}}}}\n", self.text);
        Ok(write_atomic(&self.path, text.as_bytes())?)
    }
}

/// A box as the file holds it. By hand, since Python's `NaN` of an unknown velocity is no JSON.
fn text_of(
    detection: &Detection,
    token: &Token,
    global_from_ego: &Transform<World, Ego>,
    naming: Naming,
) -> String {
    let Detection { box_in_ego, velocity_in_ego_mps, harm, score, .. } = detection;
    let center = *global_from_ego * box_in_ego.center;
    let turn = Transform::<Ego, Ego>::from_xyz_yaw(0.0, 0.0, 0.0, box_in_ego.yaw_rad).isometry.rotation;
    let rotation = global_from_ego.isometry.rotation * turn;
    let [vx, vy] = *velocity_in_ego_mps;
    let velocity = global_from_ego.rotate(&Vector3::new(vx, vy, 0.0));
    let category = naming.of_harm(*harm);
    let name = detection_class(category).unwrap_or(category);
    let attribute = default_attribute(name, *velocity_in_ego_mps);
    format!(
        "{{\"sample_token\": \"{token}\", \"translation\": [{}, {}, {}], \"size\": [{}, {}, {}], \"rotation\": [{}, {}, {}, {}], \
         \"velocity\": [{}, {}], \"detection_name\": \"{name}\", \"detection_score\": {score}, \"attribute_name\": \"{attribute}\"}}",
        center.x(),
        center.y(),
        center.z(),
        box_in_ego.width_m,
        box_in_ego.length_m,
        box_in_ego.height_m,
        rotation.w,
        rotation.i,
        rotation.j,
        rotation.k,
        velocity.x,
        velocity.y,
    )
}

impl ResultsReader {
    /// Reads a file of results on a data set.
    ///
    /// # Errors
    /// No such file, not JSON of this form, or the data set cannot be read.
    pub fn open(path: &Path, data: &Path) -> Result<Self, ExchangeError> {
        let frames = GlobalFrames::of(&DataSource::open(data, None)?)?;
        let text = fs::read_to_string(path)?;
        let file: ResultsFile = serde_json::from_str(&replace_python_numbers(&text)).map_err(|error| {
            let message =
                format!("not results of nuScenes, `{{\"results\": {{\"<sample token>\": [..]}}}}`: {error}");
            ExchangeError::Foreign { message, path: path.to_owned() }
        })?;
        let boxes = file.results.into_iter().map(|(token, boxes)| (Token::from(token.as_str()), boxes));
        Ok(Self { path: path.to_owned(), frames, boxes: boxes.collect() })
    }
}

impl ReadBoxes for ResultsReader {
    fn boxes_of(&mut self, sample: &NamedSample<'_>) -> Result<Option<Vec<ForeignBox>>, ExchangeError> {
        let Some(boxes) = self.boxes.remove(&token_of(sample)) else { return Ok(None) };
        let ego_from_global = global_from_ego(&self.frames, sample).inverse();
        let read = |(index, raw): (usize, RawResult)| {
            raw.in_ego(&ego_from_global).map_err(|message| ExchangeError::BadBox {
                message,
                index,
                sample: sample.id.to_owned(),
                path: self.path.clone(),
            })
        };
        boxes.into_iter().enumerate().map(read).collect::<Result<_, _>>().map(Some)
    }

    fn n_unknown(&self) -> usize {
        self.boxes.len()
    }

    fn path(&self) -> &Path {
        &self.path
    }
}

impl RawResult {
    fn in_ego(self, ego_from_global: &Transform<Ego, World>) -> Result<ForeignBox, String> {
        let global_from_box =
            isometry_of(self.translation, self.rotation).map_err(|fault| fault.to_string())?;
        let ego_from_box = ego_from_global.isometry * global_from_box;
        let [width_m, length_m, height_m] = self.size;
        let center = Point::from_coords(ego_from_box.translation.vector.into());
        let yaw_rad = Transform::<Ego, Ego>::from_isometry(ego_from_box).yaw_rad();
        let box_in_ego = Box3 { center, length_m, width_m, height_m, yaw_rad };
        box_in_ego.check().map_err(|fault| fault.to_string())?;
        if !self.detection_score.is_finite() {
            return Err(format!("`detection_score` is {}; a finite number is needed", self.detection_score));
        }
        let [vx, vy] = self.velocity.map(|part| part.unwrap_or(f64::NAN));
        let velocity = ego_from_global.rotate(&Vector3::new(vx, vy, 0.0));
        let velocity_in_ego_mps = [velocity.x, velocity.y];
        Ok(ForeignBox {
            box_in_ego,
            velocity_in_ego_mps,
            name: self.detection_name,
            score: self.detection_score,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::Harm;

    #[test]
    fn a_box_survives_the_global_frame() {
        let global_from_ego = Transform::<World, Ego>::from_xyz_yaw(812.0, 1433.5, 2.0, 2.1);
        let detection = Detection {
            box_in_ego: Box3 {
                center: Point::new(12.0, -3.0, 0.8),
                length_m: 4.2,
                width_m: 1.8,
                height_m: 1.5,
                yaw_rad: -0.7,
            },
            velocity_in_ego_mps: [5.0, -1.0],
            harm: Harm::Harmful,
            score: 0.25,
            spread: None,
        };
        let write =
            |detection| text_of(detection, &Token::from("t"), &global_from_ego, Naming::HarmAsCarTruck);
        let text = write(&detection);
        assert!(text.contains("\"car\"") && text.contains("\"vehicle.moving\""), "{text}");
        let raw: RawResult = serde_json::from_str(&text).unwrap();
        let back = raw.in_ego(&global_from_ego.inverse()).unwrap();
        let offset = back.box_in_ego.center.coords - detection.box_in_ego.center.coords;
        assert!(offset.norm() < 1e-9 && (back.box_in_ego.yaw_rad + 0.7).abs() < 1e-12);
        assert!((back.velocity_in_ego_mps[0] - 5.0).abs() < 1e-12 && back.score == 0.25);
        let unknown = write(&Detection { velocity_in_ego_mps: [f64::NAN; 2], ..detection });
        assert!(
            unknown.contains("\"velocity\": [NaN, NaN]") && unknown.contains("\"attribute_name\": \"\""),
            "{unknown}"
        );
        let raw: RawResult = serde_json::from_str(&replace_python_numbers(&unknown)).unwrap();
        assert!(raw.in_ego(&global_from_ego.inverse()).unwrap().velocity_in_ego_mps[0].is_nan());
    }
}
