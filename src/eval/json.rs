//! nuScenes-style JSON of predictions and of truth, boxes in the ego frame.
//!
//! `{"meta": {..}, "results": {"<sample>": [{"translation": [x, y, z], "size": [w, l, h], "rotation":
//! [w, x, y, z], "velocity": [vx, vy], "detection_name": "harmful", "detection_score": 0.9}]}}`. Truth
//! has no score, may have `"distribution": "id"|"ood"`, `"num_pts"` (-1: unknown) and what [`TruthFacts`] names;
//! beside `results` it may have `"samples": {"<sample>": {..}}` with what [`SampleFacts`] names. Metres, m/s;
//! other keys are ignored. Python's bare `NaN` and `Infinity` are read, and refused but for velocities.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;

use crate::files;
use crate::geometry::{Box3, BoxError, Ego, Point};
use crate::object::{Distribution, Harm};

use super::{EvalDetection, EvalSample, EvalTruth, SampleFacts, TruthFacts};

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
    /// What the file tells of samples beyond their boxes; of samples that it does not name, nothing.
    pub facts: HashMap<String, SampleFacts>,
}

/// Reads predictions.
///
/// # Errors
/// [`JsonError`] names file, sample and box: no JSON, a missing key, an unknown class, a number that is
/// not finite, a size not above zero, a zero rotation, a repeated sample.
pub fn read_predictions(path: &Path) -> Result<Boxes<EvalDetection>, JsonError> {
    read(path, |raw| {
        let (box_in_ego, harm, velocity_in_ego_mps) = raw.parts()?;
        let score = raw.detection_score.ok_or("`detection_score` is missing")?;
        let score =
            score.filter(|score| score.is_finite()).ok_or("`detection_score` is not a finite number")?;
        Ok(EvalDetection { box_in_ego, velocity_in_ego_mps, harm, score })
    })
}

/// Reads truth.
///
/// # Errors
/// As [`read_predictions`], and an unknown distribution.
pub fn read_truth(path: &Path) -> Result<Boxes<EvalTruth>, JsonError> {
    read(path, |raw| {
        let (box_in_ego, harm, velocity_in_ego_mps) = raw.parts()?;
        let n_lidar_points = match raw.num_pts {
            None | Some(-1) => None,
            Some(n) => {
                Some(u32::try_from(n).map_err(|_| format!("`num_pts` is {n}; -1 or a count is needed"))?)
            }
        };
        let (distribution, facts) = (raw.distribution, raw.facts);
        Ok(EvalTruth { box_in_ego, velocity_in_ego_mps, harm, distribution, n_lidar_points, facts })
    })
}

/// Joins predictions and truth sample by sample, in the order of the predictions.
///
/// # Errors
/// [`JsonError::MissingSamples`] if one file has a sample that the other has not.
pub fn join(
    predictions: Boxes<EvalDetection>,
    truth: Boxes<EvalTruth>,
) -> Result<Vec<EvalSample>, JsonError> {
    let found: HashSet<&str> = predictions.samples.iter().map(|(id, _)| id.as_str()).collect();
    let wanted: HashSet<&str> = truth.samples.iter().map(|(id, _)| id.as_str()).collect();
    check_present(&wanted, &found, &truth.path, &predictions.path)?;
    check_present(&found, &wanted, &predictions.path, &truth.path)?;
    let mut truths: HashMap<String, Vec<EvalTruth>> = truth.samples.into_iter().collect();
    let mut facts = truth.facts;
    Ok(predictions
        .samples
        .into_iter()
        .map(|(id, detections)| {
            let truths = truths.remove(&id).expect("both files were checked to hold the same samples");
            EvalSample { facts: facts.remove(&id).unwrap_or_default(), id, truths, detections }
        })
        .collect())
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
pub fn write_predictions(path: &Path, samples: &[EvalSample]) -> Result<(), JsonError> {
    write(path, samples, false, |sample| sample.detections.iter().map(RawBox::from).collect())
}

/// Writes the truths of samples, with the facts that are known.
///
/// # Errors
/// [`JsonError::Write`].
pub fn write_truth(path: &Path, samples: &[EvalSample]) -> Result<(), JsonError> {
    write(path, samples, true, |sample| sample.truths.iter().map(RawBox::from).collect())
}

/// A box as the file has it; a number that is null, NaN or infinite is `None`.
#[derive(Debug, Serialize, Deserialize)]
struct RawBox {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sample_token: Option<String>,
    translation: [Option<f64>; 3],
    size: [Option<f64>; 3],
    rotation: [Option<f64>; 4],
    #[serde(default)]
    velocity: [Option<f64>; 2],
    detection_name: String,
    #[allow(clippy::option_option, reason = "missing and null are two different faults")]
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    detection_score: Option<Option<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distribution: Option<Distribution>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    num_pts: Option<i64>,
    #[serde(flatten)]
    facts: TruthFacts,
}

/// Tells a null from a missing key.
#[allow(clippy::option_option, reason = "missing and null are two different faults")]
fn present<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<f64>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

impl RawBox {
    fn parts(&self) -> Result<(Box3<Ego>, Harm, [f64; 2]), String> {
        let [x_m, y_m, z_m] = finite("translation", self.translation)?;
        let [width_m, length_m, height_m] = finite("size", self.size)?;
        let [w, x, y, z] = finite("rotation", self.rotation)?;
        let norm = w * w + x * x + y * y + z * z;
        if norm == 0.0 {
            return Err("`rotation` is zero; a quaternion [w, x, y, z] is needed".into());
        }
        // Heading of the turned x axis, as the devkit takes it; only this is scored.
        let yaw_rad = (2.0 * (x * y + w * z) / norm).atan2(1.0 - 2.0 * (y * y + z * z) / norm);
        let center = Point::new(x_m, y_m, z_m);
        let found = Box3 { center, length_m, width_m, height_m, yaw_rad };
        found.check().map_err(|error: BoxError| error.to_string())?;
        let harm =
            Harm::ALL.into_iter().find(|harm| harm.name() == self.detection_name).ok_or_else(|| {
                format!("unknown class `{}`; the classes are harmful and harmless", self.detection_name)
            })?;
        Ok((found, harm, self.velocity.map(|part| part.unwrap_or(f64::NAN))))
    }

    fn new(box_in_ego: &Box3<Ego>, velocity: [f64; 2], harm: Harm) -> Self {
        let (center, half_rad) = (box_in_ego.center, box_in_ego.yaw_rad / 2.0);
        Self {
            sample_token: None,
            translation: [center.x(), center.y(), center.z()].map(Some),
            size: [box_in_ego.width_m, box_in_ego.length_m, box_in_ego.height_m].map(Some),
            rotation: [half_rad.cos(), 0.0, 0.0, half_rad.sin()].map(Some),
            velocity: velocity.map(Some),
            detection_name: harm.name().to_owned(),
            detection_score: None,
            distribution: None,
            num_pts: None,
            facts: TruthFacts::default(),
        }
    }
}

impl From<&EvalDetection> for RawBox {
    fn from(detection: &EvalDetection) -> Self {
        Self {
            detection_score: Some(Some(detection.score)),
            ..Self::new(&detection.box_in_ego, detection.velocity_in_ego_mps, detection.harm)
        }
    }
}

impl From<&EvalTruth> for RawBox {
    fn from(truth: &EvalTruth) -> Self {
        Self {
            distribution: truth.distribution,
            num_pts: truth.n_lidar_points.map(i64::from),
            facts: truth.facts.clone(),
            ..Self::new(&truth.box_in_ego, truth.velocity_in_ego_mps, truth.harm)
        }
    }
}

fn finite<const N: usize>(field: &str, values: [Option<f64>; N]) -> Result<[f64; N], String> {
    let mut numbers = [0.0; N];
    for (number, value) in numbers.iter_mut().zip(values) {
        *number = value.filter(|value| value.is_finite()).ok_or_else(|| {
            format!("`{field}` holds NaN, null or an infinite number; finite ones are needed")
        })?;
    }
    Ok(numbers)
}

fn read<T>(path: &Path, convert: impl Fn(RawBox) -> Result<T, String>) -> Result<Boxes<T>, JsonError> {
    let text = fs::read_to_string(path).map_err(JsonError::Read)?;
    let file: RawFile = serde_json::from_str(&without_python_numbers(&text))
        .map_err(|error| JsonError::NotBoxes { message: error.to_string(), path: path.to_owned() })?;
    let mut seen = HashSet::new();
    let mut samples = Vec::with_capacity(file.results.0.len());
    for (sample, values) in file.results.0 {
        if !seen.insert(sample.clone()) {
            return Err(JsonError::RepeatedSample { sample, path: path.to_owned() });
        }
        let mut boxes = Vec::with_capacity(values.len());
        for (index, value) in values.into_iter().enumerate() {
            let converted = serde_json::from_value::<RawBox>(value).map_err(|error| error.to_string());
            let converted = converted.and_then(|raw| match &raw.sample_token {
                Some(token) if *token != sample => Err(format!("its `sample_token` is `{token}`")),
                _ => convert(raw),
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

#[derive(Deserialize)]
struct RawFile {
    results: InOrder,
    #[serde(default)]
    samples: HashMap<String, SampleFacts>,
}

/// A JSON object in the file's order, repeated keys kept.
struct InOrder(Vec<(String, Vec<Value>)>);

impl<'de> Deserialize<'de> for InOrder {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = InOrder;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an object of sample: list of boxes")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<InOrder, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(InOrder(entries))
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

/// The text with Python's `NaN`, `Infinity` and `-Infinity`, which are no JSON, made `null`.
fn without_python_numbers(text: &str) -> std::borrow::Cow<'_, str> {
    const WORDS: [&str; 3] = ["-Infinity", "Infinity", "NaN"];
    if !WORDS.iter().any(|word| text.contains(word)) {
        return text.into();
    }
    let mut cleaned = String::with_capacity(text.len());
    let (mut is_in_string, mut is_escaped) = (false, false);
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        let word = WORDS.into_iter().find(|word| !is_in_string && rest.starts_with(word));
        if let Some(word) = word {
            cleaned.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        if character == '"' && !is_escaped {
            is_in_string = !is_in_string;
        }
        is_escaped = is_in_string && character == '\\' && !is_escaped;
        cleaned.push(character);
        rest = &rest[character.len_utf8()..];
    }
    cleaned.into()
}

fn write(
    path: &Path,
    samples: &[EvalSample],
    with_facts: bool,
    boxes: impl Fn(&EvalSample) -> Vec<RawBox>,
) -> Result<(), JsonError> {
    struct Results<'a, F>(&'a [EvalSample], F);
    impl<F: Fn(&EvalSample) -> Vec<RawBox>> Serialize for Results<'_, F> {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.collect_map(self.0.iter().map(|sample| (&sample.id, (self.1)(sample))))
        }
    }
    #[derive(Serialize)]
    struct File<'a, R> {
        meta: serde_json::Map<String, Value>,
        results: R,
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        samples: BTreeMap<&'a str, &'a SampleFacts>,
    }
    let facts = samples.iter().filter(|_| with_facts).map(|sample| (sample.id.as_str(), &sample.facts));
    let samples_facts = facts.filter(|(_, facts)| **facts != SampleFacts::default()).collect();
    let file =
        File { meta: serde_json::Map::new(), results: Results(samples, boxes), samples: samples_facts };
    let text = serde_json::to_vec(&file).expect("boxes hold only numbers and names");
    files::write_atomic(path, &text).map_err(JsonError::Write)
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::*;

    fn error_of(boxes: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.json");
        fs::write(&path, format!("{{\"results\": {{\"s1\": {boxes}}}}}")).unwrap();
        read_predictions(&path).unwrap_err().to_string()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let samples = [
            EvalSample {
                id: "b".into(),
                facts: SampleFacts { town: Some("oldtown".into()), ..SampleFacts::default() },
                truths: vec![EvalTruth {
                    facts: TruthFacts { id: Some("car-1".into()), ..TruthFacts::default() },
                    ..truth(3.25, Harm::Harmless, Distribution::Ood)
                }],
                detections: vec![found(0.1, Harm::Harmful, 0.3)],
            },
            EvalSample { id: "a".into(), facts: SampleFacts::default(), truths: vec![], detections: vec![] },
        ];
        let (predictions, truths) = (folder.path().join("p.json"), folder.path().join("t.json"));
        write_predictions(&predictions, &samples).unwrap();
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

    #[test]
    fn names_that_look_like_python_numbers_are_kept() {
        let text = r#"{"a \" NaN": NaN, "b\\": -Infinity}"#;
        assert_eq!(without_python_numbers(text), r#"{"a \" NaN": null, "b\\": null}"#);
    }
}
