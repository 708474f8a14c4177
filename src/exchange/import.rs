//! The predictions of another tool as ours: boxes into the ego frame, names into harm.

use std::path::{Path, PathBuf};

use super::error::ExchangeError;
use super::samples::{NamedSample, NamedSamples};
use crate::episode::Split;
use crate::geometry::{Box3, Ego};
use crate::infer::Predictions;
use crate::object::{Detection, Harm};
use crate::progress::Progress;
use crate::zone::Zone;

/// A box as another tool has it, in the ego frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ForeignBox {
    pub box_in_ego: Box3<Ego>,
    /// NaN where unknown.
    pub velocity_in_ego_mps: [f64; 2],
    /// The tool's name of its class.
    pub name: String,
    pub score: f64,
}

/// A file or folder of another tool's predictions.
pub trait ReadBoxes {
    /// The boxes of a sample, in the tool's order; `None` where it has no list for the sample.
    ///
    /// # Errors
    /// A box is not valid.
    fn boxes_of(&mut self, sample: &NamedSample<'_>) -> Result<Option<Vec<ForeignBox>>, ExchangeError>;

    /// How many lists are of no sample of the split.
    fn n_unknown(&self) -> usize;

    /// The file or folder, for messages.
    fn path(&self) -> &Path;
}

/// How a box's harm is found.
#[derive(Debug)]
pub enum HarmRule {
    /// Its name is harmful or harmless.
    Names,
    /// It is named car where it is harmful and truck where it is harmless.
    CarTruck,
    /// By the danger zone at the sample's measured state, whatever its name.
    Zone(Box<Zone>),
}

/// Where predictions are imported to.
#[derive(Debug)]
pub struct ImportPredictions<'a> {
    pub data: &'a Path,
    pub split: Option<Split>,
    pub harm: HarmRule,
    pub out: &'a Path,
    pub force: bool,
}

/// What was imported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImportedPredictions {
    pub folder: PathBuf,
    pub n_samples: usize,
    pub n_boxes: usize,
    /// Lists of boxes for samples that the split does not hold.
    pub n_unknown: usize,
}

/// Writes another tool's boxes as `harmzone predict` writes a network's.
///
/// # Errors
/// Predictions are there already, a sample of the split has no list of boxes, or a box is not valid.
pub fn import_predictions(
    request: &ImportPredictions<'_>,
    reader: &mut dyn ReadBoxes,
    progress: &dyn Progress,
) -> Result<ImportedPredictions, ExchangeError> {
    let _lock = Predictions::take_folder(request.out, request.force)?;
    let samples = NamedSamples::open(request.data, request.split)?;
    let (mut found, mut names, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    samples.for_each("import", progress, |sample| {
        match reader.boxes_of(&sample)? {
            Some(boxes) => found.push(judge(boxes, &request.harm, &sample, reader.path())?),
            None => missing.push(sample.id.to_owned()),
        }
        names.push((sample.id.to_owned(), sample.measured.time_ns));
        Ok(())
    })?;
    if let Some(sample) = missing.first() {
        let (n_missing, sample, path) = (missing.len(), sample.clone(), reader.path().to_owned());
        return Err(ExchangeError::MissingSamples { n_missing, sample, path });
    }
    let set = format!("{}", reader.path().display());
    let predictions = Predictions { folder: request.out.to_owned(), set, config_toml: String::new() };
    predictions.write(samples.episodes(), &names, &found, &|_| Ok(()))?;
    Ok(ImportedPredictions {
        folder: predictions.folder,
        n_samples: found.len(),
        n_boxes: found.iter().map(Vec::len).sum(),
        n_unknown: reader.n_unknown(),
    })
}

/// Gives each box its harm.
fn judge(
    boxes: Vec<ForeignBox>,
    rule: &HarmRule,
    sample: &NamedSample<'_>,
    path: &Path,
) -> Result<Vec<Detection>, ExchangeError> {
    let zone = match rule {
        HarmRule::Zone(zone) => {
            Some(zone.at(&sample.measured.ego_state).map_err(|source| ExchangeError::Zone {
                index: 0,
                sample: sample.id.to_owned(),
                source,
            })?)
        }
        HarmRule::Names | HarmRule::CarTruck => None,
    };
    let harm_of = |index: usize, one: &ForeignBox| -> Result<Harm, ExchangeError> {
        let fail = |wanted| ExchangeError::Name {
            index,
            sample: sample.id.to_owned(),
            found: one.name.clone(),
            wanted,
            path: path.to_owned(),
        };
        if let Some(zone) = &zone {
            let verdict = zone.harm_of(&one.box_in_ego, one.velocity_in_ego_mps);
            let fail = |source| ExchangeError::Zone { index, sample: sample.id.to_owned(), source };
            return Ok(verdict.map_err(fail)?.harm);
        }
        match (rule, one.name.as_str()) {
            (HarmRule::CarTruck, "car") | (HarmRule::Names, "harmful") => Ok(Harm::Harmful),
            (HarmRule::CarTruck, "truck") | (HarmRule::Names, "harmless") => Ok(Harm::Harmless),
            (HarmRule::CarTruck, _) => Err(fail("valid is car for harmful and truck for harmless")),
            _ => Err(fail("valid is harmful or harmless; `--harm zone` asks the zone, whatever the names")),
        }
    };
    let detection = |(index, one): (usize, ForeignBox)| {
        let harm = harm_of(index, &one)?;
        let ForeignBox { box_in_ego, velocity_in_ego_mps, score, .. } = one;
        Ok(Detection { box_in_ego, velocity_in_ego_mps, harm, score, spread: None })
    };
    boxes.into_iter().enumerate().map(detection).collect()
}
