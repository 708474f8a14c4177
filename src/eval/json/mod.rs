//! nuScenes-style JSON of predictions and of truth, boxes in the ego frame.
//!
//! `{"meta": {..}, "results": {"<sample>": [{"translation": [x, y, z], "size": [w, l, h], "rotation":
//! [w, x, y, z], "velocity": [vx, vy], "detection_name": "harmful", "detection_score": 0.9}]}}`. Truth
//! has no score, may have `"distribution": "id"|"ood"`, `"num_pts"` (-1: unknown), `"id"`, `"category"`, `"kind"`,
//! `"visible_fraction"` and `"event"`; beside `results` it may have `"samples": {"<sample>": {..}}` with what [`SampleFacts`] names. Metres, m/s;
//! other keys are ignored. Python's bare `NaN` and `Infinity` are read, and refused but for velocities.

mod file;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

use super::sample::EvalSample;
use crate::dataset::{Dataset, SampleFacts};
use crate::files;
use crate::object::{Detection, LabelledObject};
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
}

/// The truth that a data set holds, to score any detector's boxes against.
impl From<&Dataset> for Boxes<LabelledObject> {
    fn from(dataset: &Dataset) -> Self {
        let samples = || dataset.samples().iter();
        Self {
            path: dataset.path().to_owned(),
            samples: samples().map(|sample| (sample.id.clone(), sample.objects.clone())).collect(),
            facts: samples().map(|sample| (sample.id.clone(), sample.facts.clone())).collect(),
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

/// Reads truth.
///
/// # Errors
/// As [`read_predictions`], and an unknown distribution.
pub fn read_truth(path: &Path) -> Result<Boxes<LabelledObject>, JsonError> {
    read(path)
}

fn read<T: TryFrom<RawBox, Error = String>>(path: &Path) -> Result<Boxes<T>, JsonError> {
    let text = fs::read_to_string(path).map_err(JsonError::Read)?;
    let file = BoxFile::parse(&text)
        .map_err(|error| JsonError::NotBoxes { message: error.to_string(), path: path.to_owned() })?;
    let mut seen = HashSet::new();
    let mut samples = Vec::with_capacity(file.results.0.len());
    for (sample, values) in file.results.0 {
        if !seen.insert(sample.clone()) {
            return Err(JsonError::RepeatedSample { sample, path: path.to_owned() });
        }
        let mut boxes = Vec::with_capacity(values.len());
        for (index, value) in values.into_iter().enumerate() {
            let raw = serde_json::from_value::<RawBox>(value).map_err(|error| error.to_string());
            let converted = raw.and_then(|raw| match &raw.sample_token {
                Some(token) if *token != sample => Err(format!("its `sample_token` is `{token}`")),
                _ => T::try_from(raw),
            });
            boxes.push(converted.map_err(|message| JsonError::BadBox {
                message,
                index,
                sample: sample.clone(),
                path: path.to_owned(),
            })?);
        }
        samples.push((sample, boxes));
    }
    Ok(Boxes { path: path.to_owned(), samples, facts: file.samples })
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
    check_present(&wanted, &found, &truth.path, &predictions.path)?;
    check_present(&found, &wanted, &predictions.path, &truth.path)?;
    let mut objects: HashMap<String, Vec<LabelledObject>> = truth.samples.into_iter().collect();
    let mut facts = truth.facts;
    let join_one = |(id, detections)| EvalSample {
        facts: facts.remove(&id).unwrap_or_default(),
        objects: objects.remove(&id).expect("both files were checked to hold the same samples"),
        id,
        detections,
    };
    Ok(predictions.samples.into_iter().map(join_one).collect())
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
    write(path, samples, BTreeMap::new())
}

/// Writes the truths of samples, with the facts that are known.
///
/// # Errors
/// [`JsonError::Write`].
pub fn write_truth(path: &Path, samples: &[EvalSample]) -> Result<(), JsonError> {
    let facts = samples.iter().map(|sample| (sample.id.as_str(), &sample.facts));
    let facts = facts.filter(|(_, facts)| **facts != SampleFacts::default()).collect();
    let boxes = samples.iter().map(|sample| (sample.id.as_str(), sample.objects.as_slice()));
    write(path, boxes, facts)
}

fn write<'a, T: 'a>(
    path: &Path,
    samples: impl Iterator<Item = (&'a str, &'a [T])>,
    facts: BTreeMap<&str, &SampleFacts>,
) -> Result<(), JsonError>
where
    RawBox: From<&'a T>,
{
    struct Results<'a>(Vec<(&'a str, Vec<RawBox>)>);
    impl Serialize for Results<'_> {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.collect_map(self.0.iter().map(|(id, boxes)| (id, boxes)))
        }
    }
    #[derive(Serialize)]
    struct File<'a> {
        meta: serde_json::Map<String, serde_json::Value>,
        results: Results<'a>,
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        samples: BTreeMap<&'a str, &'a SampleFacts>,
    }
    let results = samples.map(|(id, boxes)| (id, boxes.iter().map(RawBox::from).collect())).collect();
    let file = File { meta: serde_json::Map::new(), results: Results(results), samples: facts };
    let text = serde_json::to_vec(&file).expect("boxes hold only numbers and names");
    files::write_atomic(path, &text).map_err(JsonError::Write)
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::*;
    use crate::object::{Distribution, Harm};

    fn error_of(boxes: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.json");
        fs::write(&path, format!("{{\"results\": {{\"s1\": {boxes}}}}}")).unwrap();
        read_predictions(&path).unwrap_err().to_string()
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
                detections: vec![found(0.1, Harm::Harmful, 0.3)],
            },
            EvalSample { id: "a".into(), facts: SampleFacts::default(), objects: vec![], detections: vec![] },
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
            ("[1,2,3]", "[1,2]", "length 2"),
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
    }
}
