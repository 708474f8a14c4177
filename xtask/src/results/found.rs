//! What networks found, kept while an experiment runs: who judges boxes does not change them.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::Context;

use super::config::SeenRowConfig;
use super::experiment::{Experiment, Row};
use harmzone::cli::judge_all;
use harmzone::config::to_toml;
use harmzone::dataset::blind::Sensor;
use harmzone::dataset::{Dataset, Fingerprint};
use harmzone::eval::judge::Judge;
use harmzone::eval::{EvalSample, eval_samples};
use harmzone::infer::{self, Predictions, Trained};
use harmzone::model::HeadJudge;
use harmzone::object::Detection;
use harmzone::zone::{Zone, ZoneConfig};

/// What networks have found: several judges may ask for the same boxes.
#[derive(Default)]
pub struct Found(RefCell<Vec<(FoundIn, Rc<Boxes>)>>);

/// By sample.
type Boxes = Vec<Vec<Detection>>;

/// What boxes depend on; a rule that judges them later does not matter.
#[derive(PartialEq)]
struct FoundIn {
    data: Fingerprint,
    run: PathBuf,
    blind: Option<Sensor>,
}

impl Found {
    /// The samples of a data set with what [`Self::of`] tells, judged by whom the row names: the network's own word may be more than
    /// that of its class branch.
    ///
    /// # Errors
    /// As [`Self::of`]; the rule cannot judge them.
    pub fn look(
        &self,
        experiment: &Experiment<'_>,
        row: &Row,
        seen: &SeenRowConfig,
        data: &Dataset,
        keep_in: Option<&Path>,
    ) -> anyhow::Result<Vec<EvalSample>> {
        let found = self.of(experiment, row, seen, data, keep_in)?;
        let own = (seen.judge == Judge::Network).then_some(row.config.model.head.judge);
        let judged = match own {
            Some(HeadJudge::Both) => judge_by_default_zone(Judge::Both, &found, data)?,
            Some(HeadJudge::Network) | None => judge_all(seen.judge, &found, data)?,
        };
        Ok(eval_samples(data.samples(), &judged))
    }

    /// What a row's network finds in the samples, with the harm of its class branch alone, one sensor blinded where the row says so; written as predictions below a folder
    /// where one is named.
    ///
    /// # Errors
    /// The run cannot be read, learned from the samples, or cannot run on them; the predictions cannot be written.
    fn of(
        &self,
        experiment: &Experiment<'_>,
        row: &Row,
        seen: &SeenRowConfig,
        data: &Dataset,
        keep_in: Option<&Path>,
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
        let judge = if seen.judge == Judge::Network { Judge::Both } else { seen.judge };
        let found =
            Rc::new(infer::detect_for(judge, &detector, data.samples(), seen.blind, device, progress)?);
        if let Some(folder) = keep_in {
            let sha256 = trained.sha256()?;
            let blinded = place.blind.map_or_else(String::new, |sensor| format!("-no-{}", sensor.name()));
            let name = format!("boxes-{}{blinded}", &sha256[..8]);
            let predictions = Predictions {
                folder: folder.join(name),
                set: row.name.clone(),
                config_toml: to_toml(&trained.config()?),
            };
            let samples = data.samples().iter().map(|sample| (sample.id.clone(), sample.measured.time_ns));
            predictions.write(data.episodes(), &samples.collect::<Vec<_>>(), &found, &|_| Ok(()))?;
        }
        self.0.borrow_mut().push((place, Rc::clone(&found)));
        Ok(found)
    }
}

/// As a network judges its own boxes, which knows the default zone alone.
fn judge_by_default_zone(
    judge: Judge,
    found: &[Vec<Detection>],
    data: &Dataset,
) -> anyhow::Result<Vec<Vec<Detection>>> {
    let zone = Zone::try_from(ZoneConfig::default())?;
    let judged = data.samples().iter().zip(found).map(|(sample, found)| {
        judge
            .judge(found, &sample.measured.ego_state, &zone)
            .with_context(|| format!("the zone cannot judge sample {}", sample.id))
    });
    judged.collect()
}
