//! Made-up results for tests, here and in the developers' program.

use super::{
    DataRecord, JudgeScores, MissedHarm, QuestionConfig, Record, Repeat, ReportedGroup, ReportedRecord,
    ReportedSet, Results, RivalRecord, RowOf, SeedMean, SeedMeans, SetConfidence, SetRecord, SetScores,
    SideBySide, TableConfig,
};
use crate::dataset::Fingerprint;
use crate::eval::safety::{Alarms, MissedGroup, OperatingPoint, Warned};
use crate::eval::versus::{Versus, VersusFigure, VersusLine};
use crate::eval::{ClassScores, Columns, Confidence, Intervals, SCORING};

/// Made-up results: a headline, one row that is done and one that is not, and a rival.
#[must_use]
pub fn test_results() -> Results {
    let fingerprint = |c: &str| Fingerprint { dataset_sha256: c.repeat(64), labels_sha256: "e".repeat(64) };
    let set =
        |c: &str, n_samples, is_of_preset| SetRecord { n_samples, fingerprint: fingerprint(c), is_of_preset };
    let ap = |harmful: f64| ClassScores::new(Some(harmful), Some(0.5));
    let columns = |total: f64| Columns {
        total: ap(total),
        id_matched: Some(ap(0.7)),
        ood_all: Some(ap(0.6)),
        ood_matched: Some(ap(0.55)),
    };
    let record = |name: &str, set: &[&str], wall_and_cpu_s| Record {
        name: name.into(),
        profile: "small".into(),
        set: set.iter().map(|&key| key.to_owned()).collect(),
        seed: 3,
        epochs: [5, 1],
        n_parameters: 712_345,
        wall_and_cpu_s,
        checkpoint_sha256: "c".repeat(64),
        checkpoint_bytes: 2_909_276,
        trained_on: fingerprint("a"),
        tested_on: fingerprint("b"),
        learned_from: None,
        id: ap(0.9),
        ood: columns(0.8),
        strict: None,
        missed: MissedHarm { id: Some(test_alarms()), ood: Some(test_alarms()) },
        confidence: SetConfidence { id: None, ood: Some(test_confidence()) },
    };
    let both = |id: f64, total: f64| SetScores { id: ap(id), ood: columns(total) };
    let rival = RivalRecord {
        label: "zone over the network's boxes".into(),
        row: "fused".into(),
        scores: JudgeScores {
            judge: "zone".into(),
            judge_ms: 0.0312,
            right: both(0.9, 0.8),
            missed: MissedHarm::default(),
            confidence: SetConfidence { id: None, ood: Some(test_confidence()) },
            // The lower one of each set, whichever side it is on.
            speed_off: [both(0.8, 0.7), both(0.82, 0.6)],
            steering_off: [both(0.7, 0.5), both(0.6, 0.4)],
        },
    };
    let place = |label: &str, row: &str| RowOf { label: label.into(), row: row.into() };
    let keys = ["lidar_stage.epochs=3", "model.lidar.pillars.bev_channels=[16, 16]"];
    Results {
        version: "0.1.0".into(),
        made_by: "make results, from configs/results.toml".into(),
        data: DataRecord {
            preset: "small".into(),
            id: set("a", [3000, 600, 0], true),
            ood: set("b", [0, 0, 600], false),
        },
        reported: None,
        reported_repeats: Vec::new(),
        seed_means: None,
        common: vec!["lidar_stage.epochs=3".into(), "fused_stage.epochs=1".into()],
        headline: Some(record("small", &["lidar_stage.epochs=5"], Some([3600.4, 7000.0]))),
        rows: vec![record("fused", &keys, Some([90.0, 99.0]))],
        repeats: Vec::new(),
        tables: vec![TableConfig {
            title: "Sensors".into(),
            note: "What each sensor brings.".into(),
            rows: vec![place("camera", "camera"), place("LiDAR and camera", "fused")],
        }],
        side_by_side: vec![SideBySide {
            title: "Side by side".into(),
            note: "On the same samples.".into(),
            labels: vec!["LiDAR".into(), "both".into()],
            of: test_versus(),
            reported: None,
            questions: vec![QuestionConfig {
                row: "both".into(),
                better: "The camera pays.".into(),
                worse: "The camera does harm.".into(),
                level: "Whether the camera pays is not certain.".into(),
            }],
        }],
        rivals: vec![rival],
        network_ms: [("fused".to_owned(), 151.4)].into(),
    }
}

/// The same with two repeats of the headline and one of the row that is done.
#[must_use]
pub fn test_with_repeats() -> Results {
    let results = test_results();
    let repeated = |of: &Record, seed: u64, total: f64| {
        let mut record = Record { seed, checkpoint_sha256: seed.to_string().repeat(64), ..of.clone() };
        record.name = format!("{}-seed-{seed}", of.name);
        record.ood.total = ClassScores::new(Some(total), Some(0.5));
        Repeat { row: of.name.clone(), record }
    };
    let headline = results.headline.as_ref();
    let repeats = headline.into_iter().flat_map(|of| [repeated(of, 4, 0.6), repeated(of, 5, 0.7)]);
    let repeats = repeats.chain([repeated(&results.rows[0], 4, 0.9)]).collect();
    Results { repeats, ..results }
}

fn test_confidence() -> Confidence {
    let ends = Some([0.1, 0.3]);
    let intervals = Intervals { harmful: ends, harmless: ends, mean: ends };
    Confidence {
        level: 0.95,
        n_resamples: 200,
        n_episodes: 108,
        columns: Columns { total: intervals, id_matched: None, ood_all: None, ood_matched: None },
    }
}

/// Made-up figures on split test.
#[must_use]
pub fn test_reported() -> ReportedRecord {
    let ap = |harmful: f64| ClassScores::new(Some(harmful), Some(0.5));
    let set = |others: Option<f64>| ReportedSet {
        n_episodes: 108,
        n_samples: 2592,
        fingerprint: Fingerprint { dataset_sha256: "d".repeat(64), labels_sha256: "e".repeat(64) },
        scores: Columns {
            total: ap(0.2),
            id_matched: others.map(ap),
            ood_all: others.map(ap),
            ood_matched: others.map(ap),
        },
        strict: None,
        missed: others.map(|_| test_alarms()),
        confidence: Some(test_confidence()),
    };
    ReportedRecord {
        commit: "0123abc".into(),
        date: "2026-02-03".into(),
        checkpoint_sha256: "c".repeat(64),
        scoring: SCORING,
        groups: vec![ReportedGroup {
            towns: vec!["harbour".into(), "hillside".into()],
            id: set(None),
            ood: set(Some(0.3)),
        }],
        absent_maps: vec!["maps/Town02.xodr".into()],
    }
}

/// Means of the headline and of its repeats of [`test_with_repeats`].
#[must_use]
pub fn test_seed_means() -> SeedMeans {
    let mean = |value: f64| {
        let figure = VersusFigure {
            value: Some(value),
            interval: Some([value - 0.04, value + 0.03]),
            over_first: Some(0.0),
            over_first_interval: Some([0.0; 2]),
            over_first_seeds_interval: None,
            runs: Vec::new(),
        };
        let line =
            |name: &str| VersusLine { name: name.into(), n_truths: 100, figures: vec![figure.clone()] };
        Versus {
            missed: vec![line("at 1 false alarms/km"), line("at 10 false alarms/km")],
            warned: vec![line("at 10 false alarms/km, 6 m/s²"), line("at 10 false alarms/km, 8 m/s²")],
            harmful: vec![line("total")],
            mean: vec![line("total"), line("out of distribution, all FPs")],
            ..test_versus()
        }
    };
    SeedMeans {
        networks: ["c", "4", "5"].map(|c| c.repeat(64)).to_vec(),
        seen: SeedMean { id: mean(0.7), ood: mean(0.6) },
        groups: vec![SeedMean { id: mean(0.6), ood: mean(0.55) }],
    }
}

/// Made-up figures of two detectors.
fn test_versus() -> Versus {
    let figure = |value: f64, over: f64| VersusFigure {
        value: Some(value),
        interval: Some([value - 0.1, value + 0.1]),
        over_first: Some(over),
        over_first_interval: Some([over - 0.02, over + 0.02]),
        over_first_seeds_interval: None,
        runs: Vec::new(),
    };
    let line = |name: &str, n_truths, figures: Vec<VersusFigure>| VersusLine {
        name: name.into(),
        n_truths,
        figures,
    };
    Versus {
        level: 0.95,
        n_resamples: 1000,
        n_episodes: 100,
        n_samples: 600,
        missed: vec![line("at 10 false alarms/km", 171, vec![figure(0.3, 0.0), figure(0.2, -0.1)])],
        warned: vec![line("at 10 false alarms/km, 8 m/s²", 92, vec![figure(0.5, 0.0), figure(0.55, 0.05)])],
        harmful: vec![line("total", 253, vec![figure(0.7, 0.0), figure(0.75, 0.05)])],
        mean: vec![
            line("total", 2200, vec![figure(0.6, 0.0), figure(0.64, 0.04)]),
            line("samples in fog", 800, vec![figure(0.5, 0.0), figure(0.49, -0.01)]),
        ],
    }
}

/// Made-up figures at two points.
#[must_use]
pub fn test_alarms() -> Alarms {
    let point = |per_km: f64, missed: f64| OperatingPoint {
        max_false_alarms_per_km: per_km,
        score: Some(0.4),
        n_false_alarms: 3,
        n_false_on_harmless: 1,
        false_alarms_per_km: per_km,
        false_alarms_per_h: None,
        n_harmful: 40,
        missed_per_sample: Some(missed + 0.1),
        missed_per_sample_interval: None,
        n_events: 20,
        missed_per_event: Some(missed),
        missed_per_event_interval: Some([missed - 0.05, missed + 0.05]),
        warned: vec![Warned {
            deceleration_mps2: 8.0,
            n_stoppable: 10,
            n_in_time: 6,
            in_time: Some(0.6),
            in_time_interval: None,
        }],
    };
    let group = |name: &str| MissedGroup {
        name: name.to_owned(),
        n_harmful: 8,
        n_events: 4,
        missed_per_sample: vec![Some(0.5), None],
        missed_per_event: vec![Some(0.25), None],
        missed_per_sample_intervals: vec![Some([0.25, 0.75]), None],
        missed_per_event_intervals: vec![Some([0.125, 0.5]), None],
    };
    Alarms {
        driven_km: 2.0,
        driven_h: 0.1,
        points: vec![point(1.0, 0.3), point(10.0, 0.2)],
        groups: vec![group("ood"), group("hay_bale")],
    }
}
