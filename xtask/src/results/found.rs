//! What networks found, kept while an experiment runs: who judges boxes does not change them.

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

use super::config::SeenRowConfig;
use super::experiment::{Experiment, Row};
use harmzone::dataset::blind::Sensor;
use harmzone::dataset::{Dataset, Fingerprint};
use harmzone::infer::{self, Trained};
use harmzone::object::Detection;

/// What networks have found: several judges may ask for the same boxes.
#[derive(Default)]
pub struct Found(RefCell<Vec<(FoundIn, Rc<Boxes>)>>);

/// By sample.
type Boxes = Vec<Vec<Detection>>;

/// What boxes depend on; who judges them does not matter.
#[derive(PartialEq)]
struct FoundIn {
    data: Fingerprint,
    run: PathBuf,
    blind: Option<Sensor>,
}

impl Found {
    /// What a row's network finds in the samples, one sensor blinded where the row says so.
    ///
    /// # Errors
    /// The run cannot be read, learned from the samples, or cannot run on them.
    pub fn of(
        &self,
        experiment: &Experiment<'_>,
        row: &Row,
        seen: &SeenRowConfig,
        data: &Dataset,
    ) -> anyhow::Result<Rc<Boxes>> {
        let place = FoundIn { data: data.fingerprint().clone(), run: row.folder.clone(), blind: seen.blind };
        if let Some((_, found)) = self.0.borrow().iter().find(|(other, _)| *other == place) {
            return Ok(Rc::clone(found));
        }
        let trained = Trained::find(&row.folder)?;
        if let Some(learned) = trained.seen()? {
            learned.check_unlearned(data.episodes())?;
        }
        let detector = trained.load(experiment.device)?;
        let (device, progress) = (experiment.device, experiment.progress);
        let found =
            Rc::new(infer::detect_for(seen.judge, &detector, data.samples(), seen.blind, device, progress)?);
        self.0.borrow_mut().push((place, Rc::clone(&found)));
        Ok(found)
    }
}
