//! Files of results, JSON and CSV: drawn as a report, or as curves of a training.

use std::path::{Path, PathBuf};

use harmzone::eval::judge::Judge;
use harmzone::eval::safety::{Early, EarlyShare};
use harmzone::eval::sweep::{Change, SweepCurve, SweepPoint, Sweeps};
use harmzone::eval::{ClassScores, Columns, EvalSample, Evaluation, Mode, Protocol, evaluate};
use harmzone::history::{SCORES_FILE, STEPS_FILE};
use harmzone::object::{Distribution, Harm, Kind, LabelledObject};
use harmzone::outcome::{DriveOutcome, DriveSummary, Origin, Who, compare};
use harmzone::report::page::{self, ReportRequest, ScoresRequest};
use harmzone::report::results::test_data::test_results;
use harmzone::report::{curves, provenance::Provenance, scores};
use serde::Serialize;

use super::made_episode::{detections, object};
use super::{patched, scratch};

/// The files that `results` takes, by the first byte.
pub const RESULTS: [&str; 8] = [
    scores::METRICS_FILE,
    scores::PROVENANCE_FILE,
    scores::FAULTS_FILE,
    scores::SWEEPS_FILE,
    "results.json",
    DriveSummary::FILE,
    STEPS_FILE,
    SCORES_FILE,
];

thread_local! {
    static MADE: Made = Made::make();
}

/// What the program wrote.
struct Made {
    evaluation: Evaluation,
    protocol: Protocol,
    /// Of [`RESULTS`].
    texts: [String; 8],
}

impl Made {
    fn make() -> Self {
        let protocol = Protocol::default();
        let evaluation =
            evaluate(&samples(), &protocol, Mode::Ood).expect("samples that were made can be scored");
        let folder = scratch::empty_folder("results/made");
        write_scores(&folder, &protocol, &evaluation);
        let read = |name: &str| fs_err::read_to_string(folder.join(name)).expect("it was just written");
        let unsealed = |name: &str| harmzone::files::unseal(&read(name)).expect("it was just sealed");
        let texts = [
            unsealed(scores::METRICS_FILE),
            unsealed(scores::PROVENANCE_FILE),
            unsealed(scores::FAULTS_FILE),
            json(&sweeps()),
            json(&test_results()),
            json(&drives()),
            STEPS.to_owned(),
            SCORES.to_owned(),
        ];
        Self { evaluation, protocol, texts }
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("results have a JSON form")
}

const STEPS: &str = "n_done,stage,epoch,learning_rate,heatmap,harm,boxes,picture,gradient_norm\n\
    1,lidar,0,2.000e-4,9.10213,8.47234,2.78232,0.23195,246.331\n\
    2,lidar,0,2.000e-4,4.42987,5.26291,4.02679,0.25264,43.730\n\
    3,fused,0,2.002e-4,5.98477,6.51176,3.02498,0.27490,59.249\n";
const SCORES: &str =
    "n_done,stage,epoch,harmful,harmless,mean\n2,lidar,0,0.1967,0.3983,0.2975\n3,fused,0,0.2,,0.2\n";

/// Two streets with a truth that is found, one that is missed, and boxes on nothing.
fn samples() -> Vec<EvalSample> {
    let truth =
        |id: &str, x_m, harm| LabelledObject { truth: object(id, Kind::Static, Distribution::Id, x_m), harm };
    let sample = |i: usize| {
        let truths = vec![truth("a", 12.0, Harm::Harmful), truth("b", 40.0, Harm::Harmless)];
        EvalSample::new(format!("street/{i}"), Default::default(), truths, detections())
    };
    (0..3).map(sample).collect()
}

fn sweeps() -> Sweeps {
    let scores = ClassScores::new(Some(0.7), Some(0.4));
    let point = |value| SweepPoint {
        value,
        scores: Columns { total: scores, id_matched: Some(scores), ood_all: Some(scores), ood_matched: None },
        n_truths: 9,
        n_located: 8,
        n_harmful: 4,
        n_called_harmful: 5,
        n_both: 3,
        set_iou: Some(0.5),
        agreement: Some(0.75),
    };
    let curve = |(change, judge)| SweepCurve {
        change,
        judge,
        truth_moves: change == Change::SpeedMps,
        points: vec![point(0.0), point(7.0), point(14.0)],
    };
    let within =
        EarlyShare { n_later: 3, n_boxes: 10, n_turned: 4, share: Some(0.4), share_of_harmless: Some(0.1) };
    let pairs = Change::ALL.into_iter().flat_map(|change| Judge::ALL.map(|judge| (change, judge)));
    Sweeps {
        n_samples: 3,
        curves: pairs.map(curve).collect(),
        early: Some(Early { n_false_harmful: 10, within: vec![within] }),
    }
}

const OUTCOME: &str = r#"{"episode": "e", "family": "", "seed": 1, "town": "downtown", "weather": "ClearNoon", "end": "collision",
"duration_s": 11.25, "distance_m": 62.3, "free_m": 77.6, "collision": {"time_s": 11.25, "object": "hay_bale-1", "category": "hay_bale",
"kind": "static", "distribution": "ood", "event": "lies", "spot": "lane", "is_background": false, "impact_mps": 14.7, "ego_mps": 6.0,
"energy_j": 432.1, "set_off_s": 1.9, "is_sudden": false, "was_harmful": true}, "struck_by": [], "hard_stops": [{"time_s": 3.0,
"braking_mps2": 6.0, "is_false": true}], "first_brake_ttc_s": 1.5, "hardest_mps2": 1.8, "rms_jerk_mps3": 1.1, "n_samples": 38,
"entry": null}"#;

/// Two drivers of three drives each; one of them collides once and ends stuck once.
fn drives() -> DriveSummary {
    let outcome = |i: usize, hits: bool| {
        let mut outcome: DriveOutcome = serde_json::from_str(OUTCOME).expect("it is one");
        outcome.episode = format!("e{i}");
        if !hits {
            outcome.collision = None;
            let end = if i == 2 { "\"stuck\"" } else { "\"time\"" };
            outcome.end = serde_json::from_str(end).expect("it is one");
        }
        outcome
    };
    let of = |who: &str, hits: usize| -> (Who, Vec<DriveOutcome>) {
        let outcomes: Vec<DriveOutcome> = (0..3).map(|i| outcome(i, i < hits)).collect();
        (who.parse().expect("it is a driver"), outcomes)
    };
    let drives = [of("blind", 3), of("truth", 0), of("small", 1)];
    let origin = |i: usize| Origin {
        who: drives[i].0.clone(),
        sha256: "0".repeat(64),
        min_score: None,
        seen_from: None,
        generator_version: "0.1.0".into(),
        driving: harmzone::outcome::DRIVING,
        device: "cpu".into(),
        cpus: vec!["x86_64".into()],
    };
    DriveSummary {
        generator_version: "0.1.0".into(),
        config_sha256: "0".repeat(64),
        split: harmzone::episode::Split::Dev,
        ood: true,
        seed: 1,
        labels: "harm".into(),
        origins: (0..3).map(origin).collect(),
        figures: compare(&drives),
        outcomes: drives.iter().map(|(_, outcomes)| outcomes.clone()).collect(),
    }
}

fn write_scores(folder: &Path, protocol: &Protocol, evaluation: &Evaluation) {
    let provenance = Provenance { version: "0.1.0".into(), ..Provenance::default() };
    scores::write(folder, protocol, evaluation, &provenance).expect("scores can be written");
}

/// One of [`RESULTS`], drawn as a report or as curves of a training: from 128 on, the other bytes are edits of a valid one.
pub fn results(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let name = RESULTS[kind % RESULTS.len()];
    let folder = scratch::empty_folder("results/scores");
    let made = MADE.with(|made| {
        write_scores(&folder, &made.protocol, &made.evaluation);
        made.texts[kind % RESULTS.len()].clone()
    });
    let is_table = name.ends_with("csv");
    let path = match kind {
        128.. if !is_table => {
            scratch::write(&format!("results/scores/{name}"), patched::patched(&made, rest).as_bytes())
        }
        _ => scratch::write(&format!("results/scores/{name}"), rest),
    };
    if is_table {
        if name == SCORES_FILE {
            scratch::write(&format!("results/scores/{STEPS_FILE}"), STEPS.as_bytes());
        }
        let _ = curves::run(&folder).map_err(|error| scratch::tell(&error));
        return;
    }
    let given = |wanted: &str| (name == wanted).then(|| path.clone());
    let report = page::run(&ReportRequest {
        out: folder.join("report.html"),
        id: None,
        ood: Some(ScoresRequest { folder: folder.clone(), data: None::<PathBuf> }),
        results: given("results.json"),
        drives: given(DriveSummary::FILE).map(|_| folder.clone()),
        n_cards: 1,
        command: "harmzone report".into(),
        force: true,
    });
    if let Err(error) = report {
        scratch::tell(&error);
    }
}

/// Inputs to begin with: each file whole, and edited.
pub fn seeds() -> Vec<Vec<u8>> {
    let texts = MADE.with(|made| made.texts.clone());
    let with = |kind: usize, bytes: &[u8]| [&[kind as u8], bytes].concat();
    let whole = texts.iter().enumerate().map(|(i, text)| with(i, text.as_bytes()));
    let edited =
        (0..RESULTS.len() - 2).flat_map(|i| patched::seeds().into_iter().map(move |edits| (i, edits)));
    whole.chain(edited.map(|(i, edits)| with(128 + i, &edits))).collect()
}
