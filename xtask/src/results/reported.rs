//! The headline's figures on split test, and those of its other seeds, for reporting: made once for a network, when asked for, and then
//! kept.

use std::path::{Path, PathBuf};

use burn::tensor::Device;

use super::data::{LABELS, prepare_to_report};
use super::experiment::{Experiment, Row, read_json};
use harmzone::cli::{ScoredData, provenance};
use harmzone::dataset::Dataset;
use harmzone::episode::{Manifest, Split};
use harmzone::eval::{Mode, Protocol, eval_samples, evaluate};
use harmzone::files::write_atomic;
use harmzone::infer::{self, Trained};
use harmzone::progress::Progress;
use harmzone::report::results::{Record, ReportedGroup, ReportedRecord, ReportedSet};
use harmzone::report::scores;

/// The figures of a network as kept; else made and kept, where they are asked for.
///
/// # Errors
/// A data set cannot be made or scored, or the network learned from it.
pub fn read_or_make(
    experiment: &Experiment<'_>,
    row: &Row,
    scored: &Record,
) -> anyhow::Result<Option<ReportedRecord>> {
    let request = experiment.request;
    // The headline's alone have no name of their own.
    let suffix = if row.is_headline { String::new() } else { format!("-{}", row.name) };
    let file = request.out.join("scores").join(format!("reported{suffix}.json"));
    if file.is_file() {
        let kept: ReportedRecord = read_json(&file)?;
        if kept.checkpoint_sha256 == scored.checkpoint_sha256 {
            return Ok(Some(kept));
        }
    }
    let Some(release) = &request.reported else { return Ok(None) };
    let (maps, absent_maps): (Vec<PathBuf>, Vec<PathBuf>) =
        request.config.test_maps.iter().cloned().partition(|map| map.is_file());
    for map in &absent_maps {
        tracing::warn!("the map is not there, and nothing is reported on it: {}", map.display());
    }
    let trained = Trained::find(&row.folder)?;
    let mut groups = vec![group(experiment, &trained, TOWNS, &suffix, None)?];
    if !maps.is_empty() {
        groups.push(group(experiment, &trained, MAPS, &suffix, Some(&maps))?);
    }
    let record = ReportedRecord {
        commit: release.commit.clone(),
        date: release.date.clone(),
        checkpoint_sha256: scored.checkpoint_sha256.clone(),
        groups,
        absent_maps,
    };
    write_atomic(&file, serde_json::to_string_pretty(&record)?.as_bytes())?;
    Ok(Some(record))
}

/// Split test with unfamiliar objects, in the towns that come with harmzone; made where it is not there.
///
/// # Errors
/// It cannot be made or read.
pub fn test_set(experiment: &Experiment<'_>) -> anyhow::Result<Dataset> {
    let path = experiment.request.out.join(ood_name(TOWNS));
    prepare_to_report(experiment.request, true, None, &path, experiment.progress)?;
    Ok(Dataset::open(&path, LABELS, Split::Test)?)
}

/// Sets in the towns that come with harmzone, and in maps by path.
const TOWNS: &str = "test";
const MAPS: &str = "test-maps";

fn ood_name(set: &str) -> String {
    format!("{set}-ood")
}

fn group(
    experiment: &Experiment<'_>,
    trained: &Trained,
    name: &str,
    suffix: &str,
    maps: Option<&[PathBuf]>,
) -> anyhow::Result<ReportedGroup> {
    let (device, progress) = (experiment.device, experiment.progress);
    let (request, ood_name) = (experiment.request, ood_name(name));
    let set = |name: &str, mode: Mode| {
        let path = request.out.join(name);
        prepare_to_report(request, mode == Mode::Ood, maps, &path, progress)?;
        let out = request.out.join("report").join(format!("{name}{suffix}"));
        report_on(trained, &path, mode, &out, &request.command, device, progress)
    };
    let (id, mut towns) = set(name, Mode::Id)?;
    let (ood, of_ood) = set(&ood_name, Mode::Ood)?;
    towns.extend(of_ood);
    towns.sort();
    towns.dedup();
    Ok(ReportedGroup { towns, id, ood })
}

/// The figures on a data set and its towns; all of the scoring goes to `out`.
fn report_on(
    trained: &Trained,
    path: &Path,
    mode: Mode,
    out: &Path,
    command: &str,
    device: &Device,
    progress: &dyn Progress,
) -> anyhow::Result<(ReportedSet, Vec<String>)> {
    let data = Dataset::open(path, LABELS, Split::Test)?;
    if let Some(seen) = trained.seen()? {
        seen.check_unlearned(data.episodes())?;
    }
    let found = infer::detect(&trained.load(device)?, &data.named(), device, progress)?;
    let protocol = Protocol::default();
    let evaluation = evaluate(&eval_samples(data.samples(), &found), &protocol, mode)?;
    let scored = ScoredData {
        path,
        labels: LABELS,
        split: Split::Test,
        data_version: Manifest::read(path)?.format_version,
    };
    scores::write(
        out,
        &protocol,
        &evaluation,
        &provenance(Some(trained), Some(&scored), command.to_owned())?,
    )?;
    let set = ReportedSet {
        n_episodes: data.episodes().len(),
        n_samples: data.samples().len(),
        fingerprint: data.fingerprint().clone(),
        scores: evaluation.metrics.columns,
        missed: evaluation.safety.alarms,
        confidence: evaluation.confidence,
    };
    Ok((set, data.episodes().iter().map(|entry| entry.town.clone()).collect()))
}
