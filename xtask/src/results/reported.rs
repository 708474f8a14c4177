//! The headline's figures on split test, and those of its other seeds, for reporting: made once for a network, when asked for, and then
//! kept.

use std::path::Path;

use super::config::SeenRowConfig;
use super::data::LABELS;
use super::experiment::{Experiment, Row, read_json};
use super::found::Found;
use super::split_test::{SplitTest, Towns};
use harmzone::cli::{ScoredData, provenance};
use harmzone::episode::{Manifest, Split};
use harmzone::eval::judge::Judge;
use harmzone::eval::versus::{Versus, versus};
use harmzone::eval::{EvalSample, Mode, Protocol, SCORING, evaluate};
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::infer::Trained;
use harmzone::report::results::{Record, ReportedGroup, ReportedRecord, ReportedSet, SeedMean, SeedMeans};
use harmzone::report::scores;

/// The figures of a network as kept; else made and kept, where they are asked for.
///
/// # Errors
/// A data set cannot be made or scored, or the network learned from it.
pub fn read_or_make(
    experiment: &Experiment<'_>,
    test: &SplitTest<'_>,
    row: &Row,
    scored: &Record,
) -> anyhow::Result<Option<ReportedRecord>> {
    let request = experiment.request;
    // The headline's alone have no name of their own.
    let suffix = if row.is_headline { String::new() } else { format!("-{}", row.name) };
    let file = request.out.join("scores").join(format!("reported{suffix}.json"));
    let Some(release) = &request.reported else {
        let kept: Option<ReportedRecord> = if file.is_file() { Some(read_json(&file)?) } else { None };
        return Ok(kept.filter(|of| {
            of.checkpoint_sha256 == scored.checkpoint_sha256 && is_by_todays_rules(of.scoring, &file)
        }));
    };
    if file.is_file() {
        let kept: ReportedRecord = read_json(&file)?;
        if kept.checkpoint_sha256 == scored.checkpoint_sha256 && is_of(&kept, test) {
            return Ok(Some(kept));
        }
    }
    for map in &test.absent_maps {
        tracing::warn!("the map is not there, and nothing is reported on it: {}", map.display());
    }
    let trained = Trained::find(&row.folder)?;
    let group = |towns: Towns| -> anyhow::Result<ReportedGroup> {
        let (id, mut names) = set(experiment, test, row, &trained, &suffix, towns, Mode::Id)?;
        let (ood, of_ood) = set(experiment, test, row, &trained, &suffix, towns, Mode::Ood)?;
        names.extend(of_ood);
        names.sort();
        names.dedup();
        Ok(ReportedGroup { towns: names, id, ood })
    };
    let record = ReportedRecord {
        scoring: SCORING,
        commit: release.commit.clone(),
        date: release.date.clone(),
        checkpoint_sha256: scored.checkpoint_sha256.clone(),
        groups: test.towns().into_iter().map(group).collect::<anyhow::Result<_>>()?,
        absent_maps: test.absent_maps.clone(),
    };
    write_atomic(&file, serde_json::to_string_pretty(&record)?.as_bytes())?;
    Ok(Some(record))
}

/// Whether figures were made by today's rules; where not, that they are left out is told.
pub fn is_by_todays_rules(scoring: u32, file: &Path) -> bool {
    if scoring != SCORING {
        tracing::warn!(
            "figures on split test are by rules {scoring} of scoring, today's are {SCORING}: left out; ARGS=--final makes them anew: {}",
            file.display()
        );
    }
    scoring == SCORING
}

/// Whether figures are by today's rules, of the data sets as they lie there, those that do, and of all maps that do.
fn is_of(kept: &ReportedRecord, test: &SplitTest<'_>) -> bool {
    let towns = test.towns();
    let is_same = |towns: Towns, of: &ReportedSet, mode| {
        test.kept_fingerprint(towns, mode).is_none_or(|print| print == of.fingerprint)
    };
    kept.scoring == SCORING
        && kept.absent_maps == test.absent_maps
        && kept.groups.len() == towns.len()
        && kept
            .groups
            .iter()
            .zip(towns)
            .all(|(of, towns)| is_same(towns, &of.id, Mode::Id) && is_same(towns, &of.ood, Mode::Ood))
}

/// As the network ships: who judges is its own affair.
fn as_it_is(row: &Row) -> SeenRowConfig {
    SeenRowConfig { label: String::new(), row: row.name.clone(), blind: None, judge: Judge::Network }
}

/// The figures on data sets and their towns; all of the scoring goes to `report/`.
fn set(
    experiment: &Experiment<'_>,
    test: &SplitTest<'_>,
    row: &Row,
    trained: &Trained,
    suffix: &str,
    towns: Towns,
    mode: Mode,
) -> anyhow::Result<(ReportedSet, Vec<String>)> {
    let request = experiment.request;
    let samples = test.look(row, &as_it_is(row), towns, mode)?;
    // At the score that the network warns from, as on the splits that choices are made by.
    let protocol = Protocol::try_from(trained.eval_config()?)?;
    let evaluation = evaluate(&samples, &protocol, mode)?;
    let paths = test.paths(towns, mode);
    let scored = match &paths[..] {
        [path] => Some(ScoredData {
            path,
            labels: LABELS,
            split: Split::Test,
            data_version: Manifest::read(path)?.format_version,
        }),
        _ => None,
    };
    let out = request.out.join("report").join(format!("{}{suffix}", test.name(towns, mode)));
    let provenance = provenance(Some(trained), scored.as_ref(), request.command.clone())?;
    scores::write(&out, &protocol, &evaluation, &provenance)?;
    let (names, n_episodes, n_samples) = test.extent(towns, mode)?;
    let set = ReportedSet {
        n_episodes,
        n_samples,
        fingerprint: test.fingerprint(towns, mode)?,
        scores: evaluation.metrics.columns,
        strict: evaluation.metrics.strict,
        missed: evaluation.safety.alarms,
        confidence: evaluation.confidence,
    };
    Ok((set, names))
}

/// The means of the headline's runs with their intervals, on the splits that choices are made by and on split test: as kept, else made
/// and kept, where split test is asked for.
///
/// # Errors
/// A run cannot be read or scored.
pub fn read_or_make_means(
    experiment: &Experiment<'_>,
    test: &SplitTest<'_>,
    found: &Found,
    runs: &[&Row],
    records: &[ReportedRecord],
) -> anyhow::Result<Option<SeedMeans>> {
    if records.is_empty() {
        return Ok(None);
    }
    // Records hold the hashes of the networks and of the data.
    let key = sha256_hex(&serde_json::to_vec(&(records, &experiment.id, &experiment.ood))?);
    let file = experiment.request.out.join("scores").join(format!("reported-means-{}.json", &key[..12]));
    if file.is_file() {
        return Ok(Some(read_json(&file)?));
    }
    if experiment.request.reported.is_none() {
        return Ok(None);
    }
    let mean = |look: &dyn Fn(&Row, Mode) -> anyhow::Result<Vec<EvalSample>>| -> anyhow::Result<SeedMean> {
        let of = |mode: Mode| -> anyhow::Result<Versus> {
            let runs = runs.iter().map(|row| look(row, mode)).collect::<anyhow::Result<Vec<_>>>()?;
            Ok(versus(&[runs], &Protocol::default(), mode)?)
        };
        Ok(SeedMean { id: of(Mode::Id)?, ood: of(Mode::Ood)? })
    };
    let seen =
        mean(&|row, mode| found.look(experiment, row, &as_it_is(row), experiment.scored_split(mode)?, None))?;
    let of_towns = |towns: Towns| mean(&|row, mode| test.look(row, &as_it_is(row), towns, mode));
    let means = SeedMeans {
        networks: records.iter().map(|of| of.checkpoint_sha256.clone()).collect(),
        seen,
        groups: test.towns().into_iter().map(of_towns).collect::<anyhow::Result<_>>()?,
    };
    write_atomic(&file, serde_json::to_string_pretty(&means)?.as_bytes())?;
    Ok(Some(means))
}
