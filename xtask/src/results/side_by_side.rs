//! Rows side by side on the OOD set, and what each gains over the first: made when all of its rows are trained, and then kept;
//! on split test, when that is asked for.

use std::path::PathBuf;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::config::{SeenRowConfig, SideBySideConfig};
use super::experiment::{Experiment, Row};
use super::reported::test_set;
use harmzone::cli::judge_all;
use harmzone::dataset::blind::Sensor;
use harmzone::dataset::{Dataset, Fingerprint};
use harmzone::episode::Split;
use harmzone::eval::judge::Judge;
use harmzone::eval::versus::{Versus, versus};
use harmzone::eval::{EvalSample, Mode, Protocol, eval_samples};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::{self, Trained};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::results::SideBySide;

/// Each run's row by its place, its network by its hash, the sensor that saw nothing, and who judged.
type Networks = Vec<(usize, String, Option<Sensor>, Judge)>;

/// What `scores/side-by-side-<number>.json` keeps.
#[derive(Serialize, Deserialize)]
struct Kept {
    rows: Networks,
    tested_on: Fingerprint,
    of: Versus,
}

/// Rows side by side, to choose by and to report.
pub struct Asked<'a> {
    pub experiment: &'a Experiment<'a>,
    /// Its place in the config.
    pub number: usize,
    pub config: &'a SideBySideConfig,
    pub rows: &'a [Row],
}

impl Asked<'_> {
    /// The rows side by side as kept, if they are of these networks and data; none where they are not, or a row is not trained.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn read(&self) -> anyhow::Result<Option<SideBySide>> {
        let Some(networks) = self.networks()? else { return Ok(None) };
        let Some(of) = self.kept(Split::Dev, &networks)? else { return Ok(None) };
        Ok(Some(self.record(of, self.kept(Split::Test, &networks)?)))
    }

    /// As [`Self::read`]; else made and kept, on split test where that is asked for. None where a row is not trained.
    ///
    /// # Errors
    /// A row cannot be read or scored.
    pub fn read_or_make(&self) -> anyhow::Result<Option<SideBySide>> {
        let Some(networks) = self.networks()? else { return Ok(None) };
        let of = match self.kept(Split::Dev, &networks)? {
            Some(of) => of,
            None => self.make(self.experiment.scored_split(Mode::Ood)?, Split::Dev, &networks)?,
        };
        let reported = match self.kept(Split::Test, &networks)? {
            None if self.experiment.request.reported.is_some() => {
                Some(self.make(&test_set(self.experiment)?, Split::Test, &networks)?)
            }
            kept => kept,
        };
        Ok(Some(self.record(of, reported)))
    }

    /// What is kept of these networks. What an older version kept is made anew; figures on split test, only for other networks.
    fn kept(&self, split: Split, networks: &Networks) -> anyhow::Result<Option<Versus>> {
        let file = self.path(split);
        let kept = if file.is_file() {
            serde_json::from_str::<Kept>(&fs::read_to_string(&file)?).ok()
        } else {
            None
        };
        let is_of_these = |kept: &Kept| {
            kept.rows == *networks && (split == Split::Test || kept.tested_on == self.experiment.ood)
        };
        Ok(kept.filter(is_of_these).map(|kept| kept.of))
    }

    fn make(&self, data: &Dataset, split: Split, networks: &Networks) -> anyhow::Result<Versus> {
        let detectors = self.config.rows.iter().map(|seen| {
            let runs = runs_of(self.rows, &seen.row).into_iter();
            runs.map(|row| look(self.experiment, row, seen, data)).collect::<anyhow::Result<_>>()
        });
        let detectors: Vec<Vec<Vec<EvalSample>>> = detectors.collect::<anyhow::Result<_>>()?;
        let of = versus(&detectors, &Protocol::default(), Mode::Ood)?;
        let kept = Kept { rows: networks.clone(), tested_on: data.fingerprint().clone(), of };
        write_atomic(&self.path(split), serde_json::to_string_pretty(&kept)?.as_bytes())?;
        Ok(kept.of)
    }

    fn path(&self, split: Split) -> PathBuf {
        let name = if split == Split::Test { "reported-side-by-side" } else { "side-by-side" };
        self.experiment.request.out.join("scores").join(format!("{name}-{}.json", self.number))
    }

    /// The rows' networks; none where a row is not trained.
    fn networks(&self) -> anyhow::Result<Option<Networks>> {
        let mut networks = Vec::new();
        for (i, seen) in self.config.rows.iter().enumerate() {
            for row in runs_of(self.rows, &seen.row) {
                if !self.experiment.is_trained(row)? {
                    return Ok(None);
                }
                let sha256 = sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?);
                networks.push((i, sha256, seen.blind, seen.judge));
            }
        }
        Ok(Some(networks))
    }

    fn record(&self, of: Versus, reported: Option<Versus>) -> SideBySide {
        let SideBySideConfig { title, note, rows, questions } = self.config;
        SideBySide {
            title: title.clone(),
            note: note.clone(),
            labels: rows.iter().map(|seen| seen.label.clone()).collect(),
            of,
            reported,
            questions: questions.clone(),
        }
    }
}

/// A row and its repeats.
fn runs_of<'a>(rows: &'a [Row], name: &str) -> Vec<&'a Row> {
    let runs: Vec<&Row> =
        rows.iter().filter(|row| row.name == name || row.repeats.as_deref() == Some(name)).collect();
    assert!(!runs.is_empty(), "the config was checked");
    runs
}

/// What a row finds in samples with unfamiliar objects.
fn look(
    experiment: &Experiment<'_>,
    row: &Row,
    seen: &SeenRowConfig,
    data: &Dataset,
) -> anyhow::Result<Vec<EvalSample>> {
    let trained = Trained::find(&row.folder)?;
    if let Some(seen) = trained.seen()? {
        seen.check_unlearned(data.episodes())?;
    }
    let detector = trained.load(experiment.device)?;
    let &SeenRowConfig { blind, judge, .. } = seen;
    let (device, progress) = (experiment.device, experiment.progress);
    let found = infer::detect_for(judge, &detector, data.samples(), blind, device, progress)?;
    Ok(eval_samples(data.samples(), &judge_all(judge, &found, data)?))
}
