//! Detectors as a command line names them: a network, boxes in a file, the true boxes; and who says which of them are harmful.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use burn::tensor::Device;
use fs_err as fs;

use super::Bar;
use super::eval::tell_seen;
use crate::dataset::blind::Sensor;
use crate::dataset::{Dataset, LabelledSample};
use crate::eval::judge::Judge;
use crate::eval::{EvalSample, eval_samples, json};
use crate::files::sha256_hex;
use crate::geometry::Point;
use crate::infer::{self, PredictError, Trained};
use crate::model::Classes;
use crate::object::{Detection, Harm};
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneError};

/// The true boxes in place of a detector's.
const TRUTH: &str = "truth";

/// A detector and its name in tables.
#[derive(Debug, PartialEq)]
pub struct NamedDetector {
    pub name: String,
    /// Whether the name was given, and is not the detector itself.
    pub has_own_name: bool,
    boxes: BoxesOf,
    judge: Judge,
}

/// Whose boxes.
#[derive(Debug, PartialEq)]
enum BoxesOf {
    Truth,
    File(PathBuf),
    Run { path: PathBuf, blind: Option<Sensor> },
}

impl NamedDetector {
    /// Of `[NAME=][JUDGE:]BOXES`, where boxes are of `truth`, a JSON or `[camera-blind:|lidar-blind:]RUN`.
    ///
    /// # Errors
    /// Nothing stands after the name, or what is named has nothing to be blinded or no class to keep.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let named = text.split_once('=').filter(|(name, _)| !name.is_empty() && !name.contains(['/', ':']));
        let (name, whose) = named.unwrap_or((text, text));
        let judged = whose.split_once(':').and_then(|(judge, boxes)| Some((Judge::named(judge)?, boxes)));
        let (judge, boxes) = judged.map_or((None, whose), |(judge, boxes)| (Some(judge), boxes));
        let blinded = Sensor::ALL
            .into_iter()
            .find_map(|sensor| Some((sensor, boxes.strip_prefix(sensor.name())?.strip_prefix("-blind:")?)));
        let (blind, path) = blinded.map_or((None, boxes), |(sensor, run)| (Some(sensor), run));
        if path.is_empty() {
            bail!(
                "no detector is named in `{text}`; a run's folder, a checkpoint, `small`, `truth` or a JSON of boxes is needed"
            );
        }
        let is_file = Path::new(path).extension().is_some_and(|of| of.eq_ignore_ascii_case("json"));
        if blind.is_some() && (is_file || path == TRUTH) {
            bail!("`{text}`: only a network can be blinded, neither boxes in a file nor the truth");
        }
        let (boxes, by_itself) = match path {
            TRUTH => (BoxesOf::Truth, Judge::ZoneExpected),
            file if is_file => (BoxesOf::File(file.into()), Judge::Network),
            run => (BoxesOf::Run { path: run.into(), blind }, Judge::Network),
        };
        let judge = judge.unwrap_or(by_itself);
        if boxes == BoxesOf::Truth && judge.asks_the_network() {
            bail!("`{text}`: no network looked at the true boxes; the judges of boxes alone are the zones");
        }
        Ok(Self { name: name.to_owned(), has_own_name: named.is_some(), boxes, judge })
    }

    /// # Errors
    /// The file or the network cannot be read, or lacks the sensor that it is to be blinded of.
    pub fn open(&self) -> anyhow::Result<OpenedDetector> {
        let boxes = match &self.boxes {
            BoxesOf::Truth => OpenedBoxes::Truth,
            BoxesOf::File(path) => OpenedBoxes::File {
                found: json::read_predictions(path)?,
                sha256: sha256_hex(&fs::read(path)?),
            },
            BoxesOf::Run { path, blind } => {
                let trained = Trained::find(path)?;
                let model = trained.config()?;
                let lacks = match blind {
                    Some(Sensor::Camera) => !model.use_camera,
                    Some(Sensor::Lidar) => !model.use_lidar,
                    None => false,
                };
                if let Some(sensor) = blind.filter(|_| lacks) {
                    bail!(
                        "the network has no {}, so it cannot be blinded: {}",
                        sensor.name(),
                        path.display()
                    );
                }
                let sha256 = trained.sha256()?;
                OpenedBoxes::Run { trained, blind: *blind, sha256 }
            }
        };
        Ok(OpenedDetector { boxes, judge: self.judge })
    }
}

/// Boxes that are there, or the network that makes them, and who judges them.
pub struct OpenedDetector {
    boxes: OpenedBoxes,
    judge: Judge,
}

enum OpenedBoxes {
    Truth,
    File { found: json::Boxes<Detection>, sha256: String },
    Run { trained: Trained, blind: Option<Sensor>, sha256: String },
}

impl OpenedDetector {
    /// Of the file or the network; the truth is the data set's.
    #[must_use]
    pub fn sha256(&self) -> Option<&str> {
        match &self.boxes {
            OpenedBoxes::Truth => None,
            OpenedBoxes::File { sha256, .. } | OpenedBoxes::Run { sha256, .. } => Some(sha256),
        }
    }

    /// Refuses a network that learned from the samples, one of kinds that is asked about harm, boxes of other samples, and a judge that
    /// the labels' zone has nothing for.
    ///
    /// # Errors
    /// It is one of these, or its checkpoint cannot be read.
    pub fn check(&self, dataset: &Dataset, on_training_data: bool) -> anyhow::Result<()> {
        if !self.judge.fits(dataset.zone()) {
            bail!(
                "`{}` cannot judge by zone `{}`, which has no edge to measure a distance to; the hard rules take every zone",
                self.judge.name(),
                dataset.zone().config().kind.name()
            );
        }
        let trained = match &self.boxes {
            OpenedBoxes::Truth => return Ok(()),
            OpenedBoxes::File { found, .. } => return Ok(json::check_samples(found, dataset)?),
            OpenedBoxes::Run { trained, .. } => trained,
        };
        if self.judge.asks_the_network() && trained.config()?.head.classes == Classes::Kind {
            return Err(PredictError::TellsKinds.into());
        }
        let learned = tell_seen(trained, dataset.episodes())?;
        if on_training_data { Ok(()) } else { Ok(learned?) }
    }

    /// The data set's samples with the boxes, in the data set's order.
    ///
    /// # Errors
    /// The boxes are not of the data set, the network fails, or the judge does.
    pub fn samples(self, dataset: &Dataset, device: &Device) -> anyhow::Result<Vec<EvalSample>> {
        let found = match self.boxes {
            OpenedBoxes::Truth => {
                let judged = dataset.samples().iter().map(|sample| {
                    true_boxes(sample, self.judge, dataset.zone()).map_err(|error| failed(sample, &error))
                });
                let judged: Vec<Vec<Detection>> = judged.collect::<anyhow::Result<_>>()?;
                return Ok(eval_samples(dataset.samples(), &judged));
            }
            OpenedBoxes::File { found, .. } => {
                let mut samples = json::join_dataset(found, dataset)?;
                let place: HashMap<&str, usize> =
                    dataset.samples().iter().enumerate().map(|(i, sample)| (sample.id.as_str(), i)).collect();
                samples.sort_by_key(|sample| place[sample.id.as_str()]);
                samples.into_iter().map(|sample| sample.detections).collect()
            }
            OpenedBoxes::Run { trained, blind, .. } => {
                let detector = trained.load(device)?;
                infer::detect_for(self.judge, &detector, dataset.samples(), blind, device, &Bar::default())?
            }
        };
        Ok(eval_samples(dataset.samples(), &judge_all(self.judge, &found, dataset)?))
    }
}

/// The boxes that an evaluation asks for, as of a detector that sees all of them and nothing else. What of an object is solid,
/// and how high it hangs, it knows too, as the labels do.
fn true_boxes(sample: &LabelledSample, judge: Judge, zone: &Zone) -> Result<Vec<Detection>, ZoneError> {
    let mut judged = Vec::new();
    for truth in sample.objects.iter().map(|object| &object.truth).filter(|truth| truth.is_hit()) {
        let mut stands = truth.solid_in_ego();
        if let Some(clearance_m) = truth.clearance_m {
            let center = stands.center;
            stands.center = Point::new(center.x(), center.y(), clearance_m + stands.height_m / 2.0);
        }
        let found = Detection {
            box_in_ego: stands,
            velocity_in_ego_mps: truth.velocity_in_ego_mps,
            harm: Harm::Harmless,
            score: 1.0,
            spread: None,
        };
        let of_object = judge.judge(&[found], &sample.measured.ego_state, zone)?;
        judged.extend(of_object.into_iter().map(|of| Detection { box_in_ego: truth.box_in_ego, ..of }));
    }
    judged.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(judged)
}

fn failed(sample: &LabelledSample, error: &ZoneError) -> anyhow::Error {
    anyhow!("sample {}: {error}", sample.id)
}

/// Decides on the harm of each sample's detections, at its measured state.
///
/// # Errors
/// Names the sample whose state or boxes are not valid.
pub fn judge_all(
    judge: Judge,
    found: &[Vec<Detection>],
    dataset: &Dataset,
) -> anyhow::Result<Vec<Vec<Detection>>> {
    judge_all_at(judge, found, dataset, |state| *state)
}

/// The same at states that are measured otherwise.
///
/// # Errors
/// As [`judge_all`].
pub fn judge_all_at(
    judge: Judge,
    found: &[Vec<Detection>],
    dataset: &Dataset,
    measure: impl Fn(&EgoState) -> EgoState,
) -> anyhow::Result<Vec<Vec<Detection>>> {
    let judged = dataset.samples().iter().zip(found).map(|(sample, found)| {
        let state = measure(&sample.measured.ego_state);
        judge.judge(found, &state, dataset.zone()).map_err(|error| failed(sample, &error))
    });
    judged.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detector_has_a_name_a_judge_and_may_be_blind() {
        let parsed = |text: &str| {
            let NamedDetector { name, has_own_name, boxes, judge } = NamedDetector::parse(text).unwrap();
            assert_eq!(has_own_name, name != text);
            (name, boxes, judge)
        };
        let run = |path: &str, blind| BoxesOf::Run { path: path.into(), blind };
        let network = |name: &str, boxes| (name.to_owned(), boxes, Judge::Network);
        assert_eq!(parsed("small"), network("small", run("small", None)));
        assert_eq!(parsed("mine=runs/a"), network("mine", run("runs/a", None)));
        assert_eq!(parsed("runs/lr=3"), network("runs/lr=3", run("runs/lr=3", None)));
        let blind = run("runs/lr=3", Some(Sensor::Camera));
        assert_eq!(parsed("dark=camera-blind:runs/lr=3"), network("dark", blind));
        assert_eq!(parsed("lidar-blind:small").1, run("small", Some(Sensor::Lidar)));
        assert_eq!(parsed("boxes.json"), network("boxes.json", BoxesOf::File("boxes.json".into())));
        assert_eq!(parsed("truth"), ("truth".to_owned(), BoxesOf::Truth, Judge::ZoneExpected));
        assert_eq!(parsed("rule=zone:truth"), ("rule".to_owned(), BoxesOf::Truth, Judge::Zone));
        let judged = (parsed("zone-soft:camera-blind:small").1, parsed("zone-soft:camera-blind:small").2);
        assert_eq!(judged, (run("small", Some(Sensor::Camera)), Judge::ZoneSoft));
        assert_eq!(parsed("zone:boxes.json").1, BoxesOf::File("boxes.json".into()));
    }

    #[test]
    fn what_is_no_detector_is_refused() {
        for (wrong, told) in [
            ("a=", "`a=`"),
            ("a=camera-blind:", "no detector"),
            ("zone:", "no detector"),
            ("camera-blind:boxes.json", "only a network"),
            ("zone:lidar-blind:truth", "only a network"),
            ("network:truth", "no network looked"),
            ("both:truth", "no network looked"),
        ] {
            let message = NamedDetector::parse(wrong).unwrap_err().to_string();
            assert!(message.contains(told), "{message}");
        }
    }
}
