//! nuScenes-style JSON of predictions and of truth, boxes in the ego frame.
//!
//! `{"meta": {..}, "results": {"<sample>": [{"translation": [x, y, z], "size": [w, l, h], "rotation":
//! [w, x, y, z], "velocity": [vx, vy], "detection_name": "harmful", "detection_score": 0.9}]}}`. Truth
//! has no score, and a prediction may have `"num_pts"`, the LiDAR points in its box. Truth may have `"distribution": "id"|"ood"`, `"num_pts"` (-1: unknown), `"id"`, `"category"`, `"kind"`,
//! `"visible_fraction"` and `"event"`; beside `results` it may have `"samples": {"<sample>": {..}}` with what [`SampleFacts`] names. Metres, m/s;
//! other keys are ignored. Python's bare `NaN` and `Infinity` are read, and refused but for velocities.

mod file;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use thiserror::Error;

use super::sample::EvalSample;
use crate::dataset::{Dataset, SampleFacts};
use crate::files;
use crate::object::{Detection, LabelledObject};
use crate::sample::Measured;
pub use file::replace_python_numbers;
use file::{BoxFile, RawBox};

/// Why a file of boxes cannot be used.
#[derive(Debug, Error)]
pub enum JsonError {
    #[error("cannot read the boxes")]
    Read(#[source] io::Error),
    #[error("cannot write the boxes")]
    Write(#[source] io::Error),
    #[error("not a file of boxes, `{{\"results\": {{\"<sample>\": [..]}}}}`: {message}: {}", path.display())]
    NotBoxes { message: String, path: PathBuf },
    #[error("the sample appears twice: sample `{sample}`: {}", path.display())]
    RepeatedSample { sample: String, path: PathBuf },
    #[error("box {index}: {message}: sample `{sample}`: {}", path.display())]
    BadBox { message: String, index: usize, sample: String, path: PathBuf },
    #[error(
        "no list of boxes for {n_missing} of the samples in {}, the first is `{sample}`; predictions and \
         truth need the same samples, an empty list where there is nothing: {}",
        other.display(), path.display()
    )]
    MissingSamples { n_missing: usize, sample: String, other: PathBuf, path: PathBuf },
}

/// The boxes of one file by sample, in the file's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Boxes<T> {
    pub path: PathBuf,
    pub samples: Vec<(String, Vec<T>)>,
    /// What the file says about samples beyond their boxes, by id.
    pub facts: HashMap<String, SampleFacts>,
    /// LiDAR points in each box of each sample, as far as the file tells, in the order of `samples`.
    pub n_points: Vec<Vec<Option<u32>>>,
}

/// The truth that a data set holds, to score any detector's boxes against.
impl From<&Dataset> for Boxes<LabelledObject> {
    fn from(dataset: &Dataset) -> Self {
        let samples = || dataset.samples().iter();
        Self {
            path: dataset.path().to_owned(),
            samples: samples().map(|sample| (sample.id.clone(), sample.objects.clone())).collect(),
            facts: samples().map(|sample| (sample.id.clone(), sample.facts.clone())).collect(),
            n_points: Vec::new(),
        }
    }
}

/// Reads predictions.
///
/// # Errors
/// [`JsonError`] names file, sample and box: not JSON, a missing key, an unknown class, a number that is
/// not finite, a size not above zero, a zero rotation, a repeated sample.
pub fn read_predictions(path: &Path) -> Result<Boxes<Detection>, JsonError> {
    read(path)
}

/// The samples of a file with their boxes as they stand there, for files that are put together.
#[derive(Debug)]
pub struct RawSamples {
    samples: Vec<(String, Vec<RawBox>)>,
    path: PathBuf,
}

impl RawSamples {
    /// Reads the boxes of a file.
    ///
    /// # Errors
    /// The file is not there or holds no boxes.
    pub fn read(path: &Path) -> Result<Self, JsonError> {
        let text = files::read_sealed(path).map_err(JsonError::Read)?;
        let not_boxes = |error: serde_json::Error| JsonError::NotBoxes {
            message: error.to_string(),
            path: path.to_owned(),
        };
        let file = BoxFile::parse(&text).map_err(not_boxes)?;
        let raw = |values: Vec<serde_json::Value>| {
            values.into_iter().map(serde_json::from_value).collect::<serde_json::Result<Vec<RawBox>>>()
        };
        let samples =
            file.results.0.into_iter().map(|(id, values)| Ok((id, raw(values).map_err(not_boxes)?)));
        Ok(Self { samples: samples.collect::<Result<_, _>>()?, path: path.to_owned() })
    }

    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.samples.len()
    }

    /// Writes the samples of several files as one: of the files in `order` so many each time. Returns how many boxes there are.
    ///
    /// # Errors
    /// A file has fewer samples; [`JsonError::Write`].
    pub fn write_joined(files: Vec<Self>, order: &[(usize, usize)], to: &Path) -> Result<usize, JsonError> {
        let mut joined = Vec::new();
        let mut left: Vec<_> = files.into_iter().map(|file| (file.samples.into_iter(), file.path)).collect();
        for &(file, n_samples) in order {
            let (samples, path) = &mut left[file];
            if samples.len() < n_samples {
                let message = "it has fewer samples than are wanted".to_owned();
                return Err(JsonError::NotBoxes { message, path: path.clone() });
            }
            joined.extend(samples.by_ref().take(n_samples));
        }
        let n_boxes = joined.iter().map(|(_, boxes)| boxes.len()).sum();
        write(to, joined.iter().map(|(id, boxes)| (id.as_str(), boxes.as_slice())), BTreeMap::new())?;
        Ok(n_boxes)
    }
}

/// Reads truth.
///
/// # Errors
/// As [`read_predictions`], and an unknown distribution.
pub fn read_truth(path: &Path) -> Result<Boxes<LabelledObject>, JsonError> {
    read(path)
}

fn read<T: TryFrom<RawBox, Error = String>>(path: &Path) -> Result<Boxes<T>, JsonError> {
    let text = files::read_sealed(path).map_err(JsonError::Read)?;
    let file = BoxFile::parse(&text)
        .map_err(|error| JsonError::NotBoxes { message: error.to_string(), path: path.to_owned() })?;
    let mut seen = HashSet::new();
    let mut samples = Vec::with_capacity(file.results.0.len());
    let mut n_points = Vec::with_capacity(file.results.0.len());
    for (sample, values) in file.results.0 {
        if !seen.insert(sample.clone()) {
            return Err(JsonError::RepeatedSample { sample, path: path.to_owned() });
        }
        let mut boxes = Vec::with_capacity(values.len());
        let mut n_points_in = Vec::with_capacity(values.len());
        for (index, value) in values.into_iter().enumerate() {
            let raw = serde_path_to_error::deserialize::<_, RawBox>(value);
            let raw = raw.map_err(|error| error.to_string());
            let converted = raw.and_then(|raw| match &raw.sample_token {
                Some(token) if *token != sample => Err(format!("its `sample_token` is `{token}`")),
                _ => {
                    n_points_in.push(raw.n_points()?);
                    T::try_from(raw)
                }
            });
            boxes.push(converted.map_err(|message| JsonError::BadBox {
                message,
                index,
                sample: sample.clone(),
                path: path.to_owned(),
            })?);
        }
        samples.push((sample, boxes));
        n_points.push(n_points_in);
    }
    if let Some(unknown) = file.samples.keys().filter(|id| !seen.contains(id.as_str())).min() {
        let message = format!("`samples` has facts of `{unknown}`, which `results` does not name");
        return Err(JsonError::NotBoxes { message, path: path.to_owned() });
    }
    Ok(Boxes { path: path.to_owned(), samples, facts: file.samples, n_points })
}

/// Joins predictions and truth sample by sample, in the order of the predictions.
///
/// # Errors
/// [`JsonError::MissingSamples`] if one file has a sample that the other has not.
pub fn join(
    predictions: Boxes<Detection>,
    truth: Boxes<LabelledObject>,
) -> Result<Vec<EvalSample>, JsonError> {
    let found: HashSet<&str> = predictions.samples.iter().map(|(id, _)| id.as_str()).collect();
    let wanted: HashSet<&str> = truth.samples.iter().map(|(id, _)| id.as_str()).collect();
    check_same(&found, &predictions.path, &wanted, &truth.path)?;
    let mut objects: HashMap<String, Vec<LabelledObject>> = truth.samples.into_iter().collect();
    let mut facts = truth.facts;
    let join_one = |((id, detections), n_points)| EvalSample {
        facts: facts.remove(&id).unwrap_or_default(),
        objects: objects.remove(&id).expect("both files were checked to hold the same samples"),
        id,
        detections,
        n_points,
    };
    Ok(predictions.samples.into_iter().zip(predictions.n_points).map(join_one).collect())
}

/// Joins predictions with the truth of a data set, whose clouds tell what lies in the predicted boxes.
///
/// # Errors
/// As [`join`].
pub fn join_dataset(predictions: Boxes<Detection>, dataset: &Dataset) -> Result<Vec<EvalSample>, JsonError> {
    let samples = join(predictions, dataset.into())?;
    let measured: HashMap<&str, &Measured> = dataset.named().into_iter().collect();
    let with_points = |sample: EvalSample| match measured.get(sample.id.as_str()) {
        Some(measured) => sample.with_points_of(measured),
        None => sample,
    };
    Ok(samples.into_iter().map(with_points).collect())
}

/// Whether predictions are of a data set's samples, all of them and no others.
///
/// # Errors
/// [`JsonError::MissingSamples`] if one has a sample that the other has not.
pub fn check_samples(predictions: &Boxes<Detection>, dataset: &Dataset) -> Result<(), JsonError> {
    let found: HashSet<&str> = predictions.samples.iter().map(|(id, _)| id.as_str()).collect();
    let wanted: HashSet<&str> = dataset.samples().iter().map(|sample| sample.id.as_str()).collect();
    check_same(&found, &predictions.path, &wanted, dataset.path())
}

fn check_same(
    found: &HashSet<&str>,
    path: &Path,
    wanted: &HashSet<&str>,
    of_wanted: &Path,
) -> Result<(), JsonError> {
    check_present(wanted, found, of_wanted, path)?;
    check_present(found, wanted, path, of_wanted)
}

fn check_present(
    wanted: &HashSet<&str>,
    found: &HashSet<&str>,
    other: &Path,
    path: &Path,
) -> Result<(), JsonError> {
    let missing: BTreeSet<&&str> = wanted.difference(found).collect();
    missing.first().map_or(Ok(()), |sample| {
        Err(JsonError::MissingSamples {
            n_missing: missing.len(),
            sample: (**sample).to_owned(),
            other: other.to_owned(),
            path: path.to_owned(),
        })
    })
}

/// Writes the detections of samples; a velocity that is NaN becomes null.
///
/// # Errors
/// [`JsonError::Write`].
pub fn write_predictions<'a>(
    path: &Path,
    samples: impl Iterator<Item = (&'a str, &'a [Detection])>,
) -> Result<(), JsonError> {
    let boxes = samples.map(|(id, found)| (id, found.iter().map(RawBox::from).collect::<Vec<_>>()));
    write(path, boxes, BTreeMap::new())
}

/// Writes the truths of samples, with the facts that are known.
///
/// # Errors
/// [`JsonError::Write`].
pub fn write_truth(path: &Path, samples: &[EvalSample]) -> Result<(), JsonError> {
    let facts = samples.iter().map(|sample| (sample.id.as_str(), &sample.facts));
    let facts = facts.filter(|(_, facts)| **facts != SampleFacts::default()).collect();
    let boxes = samples
        .iter()
        .map(|sample| (sample.id.as_str(), sample.objects.iter().map(RawBox::from).collect::<Vec<_>>()));
    write(path, boxes, facts)
}

fn write<'a, B: AsRef<[RawBox]>>(
    path: &Path,
    samples: impl Iterator<Item = (&'a str, B)>,
    facts: BTreeMap<&str, &SampleFacts>,
) -> Result<(), JsonError> {
    struct Results<'a, B>(Vec<(&'a str, B)>);
    impl<B: AsRef<[RawBox]>> Serialize for Results<'_, B> {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.collect_map(self.0.iter().map(|(id, boxes)| (id, boxes.as_ref())))
        }
    }
    #[derive(Serialize)]
    #[serde(bound = "B: AsRef<[RawBox]>")]
    struct File<'a, B> {
        meta: serde_json::Map<String, serde_json::Value>,
        results: Results<'a, B>,
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        samples: BTreeMap<&'a str, &'a SampleFacts>,
    }
    let file = File { meta: serde_json::Map::new(), results: Results(samples.collect()), samples: facts };
    let text = serde_json::to_string(&file).expect("boxes hold only numbers and names");
    files::write_atomic(path, files::seal_result(&text).as_bytes()).map_err(JsonError::Write)
}

#[cfg(test)]
mod tests {
    use fs_err as fs;

    use super::super::matching::tests::{found, truth};
    use super::*;
    use crate::object::{Distribution, Harm};

    fn error_of(boxes: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.json");
        fs::write(&path, format!("{{\"results\": {{\"s1\": {boxes}}}}}")).unwrap();
        read_predictions(&path).unwrap_err().to_string()
    }

    /// Facts that tell what the truth leaves out.
    fn facts_of_a_log() -> SampleFacts {
        let text = r#"{"labelled": {"kinds": ["vehicle"], "max_range_m": 60.0, "in_camera_view": true, "sizes": {"vehicle":
            {"length_m": [2.0, 12.0], "width_m": [1.0, 3.0], "height_m": [1.0, 4.0]}}},
            "ignored": [{"image": {"left_px": 3.0, "top_px": 2.0, "right_px": 40.5, "bottom_px": 30.0}},
            {"ground": {"corners_in_ego_m": [{"x_m": 9.0, "y_m": 1.0}, {"x_m": 9.0, "y_m": 2.0}, {"x_m": 8.0, "y_m": 2.0}]}}],
            "camera": {"translation": [1.5, 0.0, 1.6], "rotation": [0.5, -0.5, 0.5, -0.5], "width_px": 800,
            "height_px": 450, "fx_px": 571.0, "fy_px": 571.0, "cx_px": 400.0, "cy_px": 225.0}}"#;
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut object = truth(3.25, Harm::Harmless, Distribution::Ood);
        (object.truth.id, object.truth.velocity_in_ego_mps) = (Some("car-1".into()), [1.0, 0.5]);
        let samples = [
            EvalSample {
                id: "b".into(),
                facts: SampleFacts { town: Some("oldtown".into()), ..SampleFacts::default() },
                objects: vec![object],
                detections: vec![found(0.1, Harm::Harmful, 0.3), found(0.2, Harm::Harmful, 0.3)],
                n_points: vec![None, None],
            },
            EvalSample::new("a", facts_of_a_log(), vec![], vec![]),
        ];
        let (predictions, truths) = (folder.path().join("p.json"), folder.path().join("t.json"));
        let boxes = samples.iter().map(|sample| (sample.id.as_str(), sample.detections.as_slice()));
        write_predictions(&predictions, boxes).unwrap();
        write_truth(&truths, &samples).unwrap();
        let read = join(read_predictions(&predictions).unwrap(), read_truth(&truths).unwrap()).unwrap();
        assert_eq!(read, samples);
    }

    #[test]
    fn errors_name_sample_box_and_what_is_wrong() {
        let good = r#"{"translation":[1,2,3],"size":[1,1,1],"rotation":[1,0,0,0],"detection_name":"harmful","detection_score":0.5}"#;
        for (from, to, expected) in [
            ("[1,2,3]", "[1,NaN,3]", "`translation` holds NaN"),
            ("[1,2,3]", "[1,2]", "translation: invalid length 2"),
            ("0.5}", "\"0.5\"}", "detection_score: invalid type: string"),
            ("[1,1,1]", "[1,0,1]", "length_m is 0"),
            ("[1,1,1]", "[1,-Infinity,1]", "`size` holds NaN"),
            ("[1,0,0,0]", "[0,0,0,0]", "`rotation` is zero"),
            ("harmful", "car", "unknown class `car`"),
            ("0.5", "NaN", "`detection_score` is not a finite number"),
            (r#","detection_score":0.5"#, "", "`detection_score` is missing"),
            (r#""size":[1,1,1],"#, "", "missing field `size`"),
        ] {
            let message = error_of(&format!("[{good}, {}]", good.replacen(from, to, 1)));
            assert!(message.contains(expected), "{message}");
            assert!(message.contains("box 1: ") && message.contains("sample `s1`"), "{message}");
        }
    }

    #[test]
    fn a_repeated_sample_and_a_list_of_results_are_refused() {
        assert!(error_of(r#"[], "s1": []"#).contains("appears twice"));
        assert!(error_of("3").contains("not a file of boxes"));
        let facts = |of: &str| error_of(&format!("[]}}, \"samples\": {{{of}}}, \"meta\": {{"));
        assert!(facts(r#""s2": {}"#).contains("facts of `s2`"));
        assert!(facts(r#""s1": {"speed": 1}"#).contains("unknown field `speed`"));
    }
}
