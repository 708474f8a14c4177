//! Rows side by side on the OOD set, and what each gains over the first: made when all of its rows are trained, and then kept;
//! on split test, when that is asked for.

use std::path::PathBuf;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::config::{SeenRowConfig, SideBySideConfig};
use super::experiment::{Experiment, Row, read_json};
use super::found::Found;
use super::reported::is_by_todays_rules;
use super::request::ReportStamp;
use super::split_test::{SplitTest, Towns};
use harmzone::dataset::Fingerprint;
use harmzone::dataset::blind::Sensor;
use harmzone::eval::judge::Judge;
use harmzone::eval::versus::{Versus, versus};
use harmzone::eval::{EvalSample, Mode, Protocol, SCORING};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::results::{ReportedVersus, SideBySide};

/// The samples with what a row finds in them.
type Look<'a> = &'a dyn Fn(&Row, &SeenRowConfig) -> anyhow::Result<Vec<EvalSample>>;

/// Each run's row by its place, its network by its hash, the sensor that saw nothing, and who judged.
type Networks = Vec<(usize, String, Option<Sensor>, Judge)>;

/// What `scores/side-by-side-<number>.json` keeps.
#[derive(Serialize, Deserialize)]
struct Kept {
    scoring: u32,
    rows: Networks,
    tested_on: Fingerprint,
    of: Versus,
}

/// What `scores/reported-side-by-side-<networks>.json` keeps, named by the hash of its rows: made once, wherever they stand in the
/// config.
#[derive(Serialize, Deserialize)]
struct KeptReported {
    #[serde(default)]
    scoring: u32,
    rows: Networks,
    reported: ReportedVersus,
}

/// Rows side by side, to choose by and to report.
pub struct Asked<'a> {
    pub experiment: &'a Experiment<'a>,
    /// Its place in the config.
    pub number: usize,
    pub config: &'a SideBySideConfig,
    pub rows: &'a [Row],
    pub found: &'a Found,
    pub test: &'a SplitTest<'a>,
}

impl Asked<'_> {
    /// The rows side by side as kept, if they are of these networks and data; none where they are not, or a row is not trained.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn read(&self) -> anyhow::Result<Option<SideBySide>> {
        let Some(networks) = self.networks()? else { return Ok(None) };
        let Some(of) = self.kept(&networks)? else { return Ok(None) };
        let reported = self.kept_reported(&networks)?.map(|kept| kept.reported);
        Ok(Some(self.record(of, reported)))
    }

    /// As [`Self::read`]; else made and kept, on split test where that is asked for. None where a row is not trained.
    ///
    /// # Errors
    /// A row cannot be read or scored.
    pub fn read_or_make(&self) -> anyhow::Result<Option<SideBySide>> {
        let Some(networks) = self.networks()? else { return Ok(None) };
        let of = match self.kept(&networks)? {
            Some(of) => of,
            None => self.make(&networks)?,
        };
        let reported = match (self.kept_reported(&networks)?, &self.experiment.request.reported) {
            (Some(kept), Some(_)) if self.is_of_test(&kept) => Some(kept.reported),
            (_, Some(stamp)) => Some(self.make_reported(networks, stamp)?),
            (kept, None) => kept.map(|kept| kept.reported),
        };
        Ok(Some(self.record(of, reported)))
    }

    /// What an older version kept is made anew.
    fn kept(&self, networks: &Networks) -> anyhow::Result<Option<Versus>> {
        let file = self.file();
        let kept = if file.is_file() {
            serde_json::from_str::<Kept>(&fs::read_to_string(&file)?).ok()
        } else {
            None
        };
        let kept = kept.filter(|kept| {
            kept.scoring == SCORING && kept.rows == *networks && kept.tested_on == self.experiment.ood
        });
        Ok(kept.map(|kept| kept.of))
    }

    fn kept_reported(&self, networks: &Networks) -> anyhow::Result<Option<KeptReported>> {
        let file = self.reported_file(networks)?;
        let kept: Option<KeptReported> = if file.is_file() { Some(read_json(&file)?) } else { None };
        Ok(kept.filter(|kept| is_by_todays_rules(kept.scoring, &file)))
    }

    fn make(&self, networks: &Networks) -> anyhow::Result<Versus> {
        let data = self.experiment.scored_split(Mode::Ood)?;
        let of = self.score(&|row, seen| self.found.look(self.experiment, row, seen, data, None))?;
        let kept =
            Kept { scoring: SCORING, rows: networks.clone(), tested_on: self.experiment.ood.clone(), of };
        write_atomic(&self.file(), serde_json::to_string_pretty(&kept)?.as_bytes())?;
        Ok(kept.of)
    }

    fn make_reported(&self, networks: Networks, stamp: &ReportStamp) -> anyhow::Result<ReportedVersus> {
        let file = self.reported_file(&networks)?;
        let ReportStamp { commit, date } = stamp.clone();
        let towns = self.towns();
        let of = self.score(&|row, seen| self.test.look(row, seen, towns, Mode::Ood))?;
        let fingerprint = self.test.fingerprint(towns, Mode::Ood)?;
        let reported = ReportedVersus { commit, date, fingerprint, of };
        let kept = KeptReported { scoring: SCORING, rows: networks, reported };
        write_atomic(&file, serde_json::to_string_pretty(&kept)?.as_bytes())?;
        Ok(kept.reported)
    }

    /// All towns of split test together.
    fn towns(&self) -> Towns {
        *self.test.towns().last().expect("there is one group at least")
    }

    /// Whether figures are by today's rules, and of the data sets as they lie there, if they do.
    fn is_of_test(&self, kept: &KeptReported) -> bool {
        let print = self.test.kept_fingerprint(self.towns(), Mode::Ood);
        kept.scoring == SCORING && print.is_none_or(|print| print == kept.reported.fingerprint)
    }

    /// By what each row finds in the same samples with unfamiliar objects.
    fn score(&self, look: Look<'_>) -> anyhow::Result<Versus> {
        let detectors = self.config.rows.iter().map(|seen| {
            let runs = runs_of(self.rows, &seen.row).into_iter();
            runs.map(|row| look(row, seen)).collect::<anyhow::Result<_>>()
        });
        let detectors: Vec<Vec<Vec<EvalSample>>> = detectors.collect::<anyhow::Result<_>>()?;
        Ok(versus(&detectors, &Protocol::default(), Mode::Ood)?)
    }

    fn file(&self) -> PathBuf {
        self.experiment.request.out.join("scores").join(format!("side-by-side-{}.json", self.number))
    }

    fn reported_file(&self, networks: &Networks) -> anyhow::Result<PathBuf> {
        let hash = sha256_hex(&serde_json::to_vec(networks)?);
        let name = format!("reported-side-by-side-{}.json", &hash[..12]);
        Ok(self.experiment.request.out.join("scores").join(name))
    }

    /// The rows' networks; none where a row is not trained, or a run that is to be given is not there.
    fn networks(&self) -> anyhow::Result<Option<Networks>> {
        let mut networks = Vec::new();
        for (i, seen) in self.config.rows.iter().enumerate() {
            let runs = runs_of(self.rows, &seen.row);
            if runs.is_empty() {
                return Ok(None);
            }
            for row in runs {
                if !self.experiment.is_trained(row)? {
                    return Ok(None);
                }
                let sha256 = sha256_hex(&fs::read(row.folder.join(CHECKPOINT))?);
                networks.push((i, sha256, seen.blind, seen.judge));
            }
        }
        Ok(Some(networks))
    }

    fn record(&self, of: Versus, reported: Option<ReportedVersus>) -> SideBySide {
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

/// A row and its repeats; none of a run that is to be given and is not there.
fn runs_of<'a>(rows: &'a [Row], name: &str) -> Vec<&'a Row> {
    rows.iter().filter(|row| row.name == name || row.repeats.as_deref() == Some(name)).collect()
}
