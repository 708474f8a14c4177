//! The experiment's page: `report.html` of the headline's scores on both sets and of the tables.

use std::path::{Path, PathBuf};

use harmzone::eval::{EvalConfig, Mode};
use harmzone::report::page::{self, DEFAULT_CARDS, PAGE_FILE, ReportRequest, ScoresRequest};
use harmzone::report::provenance::quote;
use harmzone::report::results::{Record, Results};
use harmzone::report::scores::Scores;

/// Where the headline's scores of a kind are, in the experiment's folder.
pub fn folder(out: &Path, mode: Mode) -> PathBuf {
    out.join("report").join(if mode == Mode::Id { "id" } else { "ood" })
}

/// Whether all that the page shows is there, of this network and its data.
pub fn is_complete(out: &Path, record: &Record) -> bool {
    [(Mode::Id, &record.trained_on), (Mode::Ood, &record.tested_on)].into_iter().all(|(mode, data)| {
        // What cannot be read is made anew.
        let Ok(kept) = Scores::read(&folder(out, mode)) else { return false };
        let is_of_these = kept.provenance.is_some_and(|of| {
            of.checkpoint_sha256.as_ref() == Some(&record.checkpoint_sha256)
                && of.fingerprint.as_ref() == Some(data)
        });
        // But for the network's own score to warn from.
        let found = &kept.evaluation.metrics.config;
        let operating_score = found.operating_score;
        let is_of_today = *found == EvalConfig { operating_score, ..EvalConfig::default() };
        let is_whole =
            !kept.evaluation.safety.near.is_empty() && kept.faults.is_some() && kept.sweeps.is_some();
        is_of_these && is_of_today && is_whole
    })
}

/// Writes the page from what is kept and from the results' file, where the headline is scored for it.
pub fn write(results: &Results, file: &Path, out: &Path) -> anyhow::Result<()> {
    if !results.headline.as_ref().is_some_and(|record| is_complete(out, record)) {
        return Ok(());
    }
    let [id, ood] = [Mode::Id, Mode::Ood].map(|mode| folder(out, mode));
    let page = out.join(PAGE_FILE);
    let [page_name, id_name, ood_name, tables_name] =
        [&page, &id, &ood, file].map(|path: &Path| path.display().to_string());
    let words =
        ["harmzone", "report", &page_name, "--id", &id_name, "--ood", &ood_name, "--results", &tables_name];
    let command = quote(words);
    page::run(&ReportRequest {
        out: page,
        id: Some(ScoresRequest { folder: id, data: None }),
        ood: Some(ScoresRequest { folder: ood, data: None }),
        results: Some(file.to_owned()),
        drives: None,
        n_cards: DEFAULT_CARDS,
        command,
        force: true,
    })?;
    Ok(())
}
