//! `RESULTS.md` and the figures of a network's card, from `results.json` alone.

use std::fmt::Write as _;

use thiserror::Error;

use super::config::TableConfig;
use super::record::{Record, Results, RivalRecord, SetRecord, SetScores};
use harmzone::eval::{ClassScores, Column};
use harmzone::report::page::scores::quote;
use harmzone::report::table::paper_scores;
use harmzone::train::TrainingTime;

/// Marks in a card between which its figures stand.
const BEGIN: &str = "<!-- figures: begin -->";
const END: &str = "<!-- figures: end -->";

/// A card has no place for figures.
#[derive(Debug, Error)]
#[error("the card has no lines `{BEGIN}` and `{END}`, one after the other")]
pub struct NoMarks;

/// `RESULTS.md`; the same results give the same bytes.
#[must_use]
pub fn markdown(results: &Results) -> String {
    let mut text = String::from(
        "# Results\n\n\
         Written by `make results`, which generates, trains and scores all of it; \
         `configs/results.toml` has the rows.\n",
    );
    text += &data_text(results);
    text += "\n## The network that ships\n\n";
    match &results.headline {
        Some(record) => text += &headline_text(results, record),
        None => text += "Not trained yet.\n",
    }
    text += "\n## Ablations\n\n";
    text += &format!(
        "One training each, over `configs/train.toml` with {}, a shorter schedule than that of the network above. \
         Cells: AP of harmful / harmless / mean. One seed each: small differences tell nothing.\n",
        inline_list(&results.common)
    );
    for table in &results.tables {
        text += &table_text(results, table);
    }
    text + &rivals_text(&results.rivals)
}

/// A card with the figures of its network between its marks.
///
/// # Errors
/// There are no marks.
pub fn card(card: &str, results: &Results, record: &Record) -> Result<String, NoMarks> {
    let begin = card.find(BEGIN).ok_or(NoMarks)? + BEGIN.len();
    let end = begin + card[begin..].find(END).ok_or(NoMarks)?;
    let figures = format!(
        "SHA-256 of the file: `{}`\n\n{}{}",
        record.checkpoint_sha256,
        headline_text(results, record),
        data_text(results)
    );
    Ok(format!("{}\n{figures}{}", &card[..begin], &card[end..]))
}

fn data_text(results: &Results) -> String {
    let preset = &results.data.preset;
    let describe = |set: &SetRecord, what: &str| {
        let made =
            if set.is_of_preset { "" } else { ", made by another version or config than the commands below" };
        let Fingerprints(dataset, labels) = fingerprints(set);
        format!("{what}{made} (`dataset.json` {dataset}, labels {labels})")
    };
    let [n_train, n_val, _] = results.data.id.n_samples;
    let n_test: usize = results.data.ood.n_samples.iter().sum();
    format!(
        "\nData: {}; {}. AP is the nuScenes one: mean over centre distances of 0.5, 1, 2 and 4 m, objects within 50 m.\n\n\
         ```sh\n\
         harmzone gen --preset {preset} --out data/id && harmzone label data/id\n\
         harmzone gen --preset {preset} --ood --out data/ood && harmzone label data/ood\n\
         ```\n",
        describe(&results.data.id, &format!("{n_train} samples to train on and {n_val} to validate on")),
        describe(&results.data.ood, &format!("{n_test} samples with unfamiliar objects")),
    )
}

/// First digits of both hashes of a data set.
struct Fingerprints<'a>(&'a str, &'a str);

fn fingerprints(set: &SetRecord) -> Fingerprints<'_> {
    let short = |hash: &'_ str| hash.len().min(12);
    let (dataset, labels) = (&set.fingerprint.dataset_sha256, &set.fingerprint.labels_sha256);
    Fingerprints(&dataset[..short(dataset)], &labels[..short(labels)])
}

/// All columns of a row with the paper's figures beside, its costs and its commands.
fn headline_text(results: &Results, record: &Record) -> String {
    let mut text = String::from("| AP (the paper's) | harmful | harmless | mean |\n|---|---|---|---|\n");
    for (column, scores) in record.scores() {
        let name = match column {
            None => "ID: mAP",
            Some(Column::Total) => "OOD: mAP (total)",
            Some(Column::IdMatched) => "OOD: mAP_ID (matched FPs only)",
            Some(Column::OodAll) => "OOD: mAP_OOD (all FPs)",
            Some(Column::OodMatched) => "OOD: mAP_OOD (matched FPs only)",
        };
        let ours = [scores.harmful, scores.harmless, scores.mean];
        let cells =
            ours.iter().zip(paper_scores(column)).map(|(our, their)| format!(" {our:.3} ({their:.3}) |"));
        text += &format!("| {name} |{}\n", cells.collect::<String>());
    }
    text += &format!(
        "\n{:.2} M parameters, {:.1} MiB, seed {}, {} + {} epochs (LiDAR stage, fused stage) of {} samples; training time {}. \
         The paper's figures come from another simulator: a yardstick, not the same work.\n\n",
        record.n_parameters as f64 / 1e6,
        record.checkpoint_bytes as f64 / f64::from(1 << 20),
        record.seed,
        record.epochs[0],
        record.epochs[1],
        results.data.id.n_samples[0],
        duration(record.spent),
    );
    text + &commands(&[record])
}

fn table_text(results: &Results, table: &TableConfig) -> String {
    let mut text = format!("\n### {}\n\n{}\n\n", table.title, table.note);
    text += "| | ID | OOD total | mAP_ID | mAP_OOD, all FPs | mAP_OOD, matched FPs | parameters | training: wall (CPU) | seed |\n";
    text += "|---|---|---|---|---|---|---|---|---|\n";
    let mut records = Vec::new();
    for of in &table.rows {
        let Some(record) = results.row(&of.row) else {
            writeln!(text, "| {} | not trained yet | | | | | | | |", of.label).expect(WRITES);
            continue;
        };
        let cells: Vec<String> = record.scores().iter().map(|(_, scores)| cell(scores)).collect();
        writeln!(
            text,
            "| {} | {} | {:.2} M | {} | {} |",
            of.label,
            cells.join(" | "),
            record.n_parameters as f64 / 1e6,
            duration(record.spent),
            record.seed
        )
        .expect(WRITES);
        records.push(record);
    }
    if records.is_empty() { text } else { text + "\n" + &commands(&records) }
}

/// The table of rivals; nothing where none is done.
fn rivals_text(rivals: &[RivalRecord]) -> String {
    if rivals.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "\n## Who decides on harm\n\n\
         The network's class branch against the zone's own rule, laid over the network's boxes with the measured speed and \
         steering angle (`docs/evaluation.md`, rivals). mAP with both sensors right, with the speed measured 10 % too low or \
         too high, and with the steering angle measured 2° off; of the two the lower. ID / OOD total. \
         A closed set tells kinds in place of harm and sees neither sensor. Times: medians of a sample, cloud and packed image \
         to boxes.\n\n\
         | | of row | sensors right | mAP_OOD, matched FPs | speed off | steering off | network | rule |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for RivalRecord { label, row, scores } in rivals {
        let mean = |of: &SetScores| [of.id.mean, of.ood.total.mean];
        let cell = |[id, ood]: [f64; 2]| format!("{id:.3} / {ood:.3}");
        let lower = |pair: &[SetScores; 2]| {
            let [a, b] = [mean(&pair[0]), mean(&pair[1])];
            cell([a[0].min(b[0]), a[1].min(b[1])])
        };
        let matched =
            scores.right.ood.ood_matched.map_or_else(|| "-".to_owned(), |ap| format!("{:.3}", ap.mean));
        writeln!(
            text,
            "| {label} | `{row}` | {} | {matched} | {} | {} | {:.0} ms | {:.2} ms |",
            cell(mean(&scores.right)),
            lower(&scores.speed_off),
            lower(&scores.steering_off),
            scores.network_ms,
            scores.judge_ms,
        )
        .expect(WRITES);
    }
    text
}

const WRITES: &str = "writing to a string cannot fail";

fn cell(scores: &ClassScores) -> String {
    format!("{:.3} / {:.3} / **{:.3}**", scores.harmful, scores.harmless, scores.mean)
}

fn duration(spent: Option<TrainingTime>) -> String {
    let minutes = |seconds: f64| (seconds / 60.0).round() as u64;
    match spent {
        Some(spent) if spent.wall_s < 120.0 => format!("{:.0} s (CPU {:.0} s)", spent.wall_s, spent.cpu_s),
        Some(spent) => format!("{} min (CPU {} min)", minutes(spent.wall_s), minutes(spent.cpu_s)),
        None => "not kept".to_owned(),
    }
}

/// What trains and scores rows again.
fn commands(records: &[&Record]) -> String {
    let mut text = String::from("```sh\n");
    for record in records {
        let name = &record.name;
        let mut line = format!("harmzone train data/id --out runs/{name}");
        if record.profile != "small" {
            line += &format!(" --model {}", record.profile);
        }
        for key in &record.set {
            line += &format!(" --set {}", quote([key]));
        }
        writeln!(text, "{line}").expect(WRITES);
        writeln!(
            text,
            "harmzone eval runs/{name} --data data/id; harmzone eval runs/{name} --data data/ood --ood"
        )
        .expect(WRITES);
    }
    text + "```\n"
}

fn inline_list(keys: &[String]) -> String {
    if keys.is_empty() {
        return "no change".to_owned();
    }
    keys.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::ResultsConfig;
    use crate::results::record::{DataRecord, JudgeScores};
    use harmzone::dataset::Fingerprint;
    use harmzone::eval::Columns;
    use harmzone::eval::judge::Judge;

    fn results() -> Results {
        let fingerprint =
            |c: &str| Fingerprint { dataset_sha256: c.repeat(64), labels_sha256: "e".repeat(64) };
        let set = |c: &str, n_samples, is_of_preset| SetRecord {
            n_samples,
            fingerprint: fingerprint(c),
            is_of_preset,
        };
        let ap = |harmful: f64| ClassScores { harmful, harmless: 0.5, mean: f64::midpoint(harmful, 0.5) };
        let record = |name: &str, set: &[&str], spent| Record {
            name: name.into(),
            profile: "small".into(),
            set: set.iter().map(|&key| key.to_owned()).collect(),
            seed: 3,
            epochs: [5, 1],
            n_parameters: 712_345,
            spent,
            checkpoint_sha256: "c".repeat(64),
            checkpoint_bytes: 2_909_276,
            trained_on: fingerprint("a"),
            tested_on: fingerprint("b"),
            id: ap(0.9),
            ood: Columns {
                total: ap(0.8),
                id_matched: Some(ap(0.7)),
                ood_all: Some(ap(0.6)),
                ood_matched: Some(ap(0.55)),
            },
        };
        let both = |id: f64, total: f64| SetScores {
            id: ap(id),
            ood: Columns {
                total: ap(total),
                id_matched: Some(ap(0.7)),
                ood_all: Some(ap(0.6)),
                ood_matched: Some(ap(0.55)),
            },
        };
        let rival = RivalRecord {
            label: "zone over the network's boxes".into(),
            row: "fused".into(),
            scores: JudgeScores {
                judge: Judge::Zone.name().into(),
                network_ms: 151.4,
                judge_ms: 0.0312,
                right: both(0.9, 0.8),
                // The lower one of each set, whichever side it is on.
                speed_off: [both(0.8, 0.7), both(0.82, 0.6)],
                steering_off: [both(0.7, 0.5), both(0.6, 0.4)],
            },
        };
        let hour = TrainingTime { wall_s: 3600.4, cpu_s: 7000.0, n_calls: 2 };
        let config = ResultsConfig::default();
        Results {
            version: "0.1.0".into(),
            data: DataRecord {
                preset: "small".into(),
                id: set("a", [3000, 600, 0], true),
                ood: set("b", [0, 0, 600], false),
            },
            common: config.common,
            headline: Some(record("small", &["lidar_stage.epochs=5"], Some(hour))),
            rows: vec![
                record(
                    "fused",
                    &["lidar_stage.epochs=3", "model.lidar.pillars.bev_channels=[16, 16]"],
                    Some(TrainingTime { wall_s: 90.0, cpu_s: 99.0, n_calls: 1 }),
                ),
                record("lidar", &["model.use_camera=false"], None),
            ],
            tables: config.tables,
            rivals: vec![rival],
        }
    }

    #[test]
    fn the_document() {
        insta::assert_snapshot!(markdown(&results()));
    }

    #[test]
    fn the_csv() {
        insta::assert_snapshot!(results().to_csv());
    }

    #[test]
    fn json_gives_back_the_same_document() {
        let again: Results = serde_json::from_str(&results().to_json()).unwrap();
        assert_eq!(again, results());
    }

    #[test]
    fn nothing_done_yet_is_a_document_too() {
        let text = markdown(&Results { headline: None, rows: Vec::new(), ..results() });
        assert!(text.contains("Not trained yet.") && text.contains("| not trained yet |"));
    }

    #[test]
    fn a_card_keeps_what_stands_around_its_figures_and_is_stable() {
        let results = results();
        let record = results.headline.as_ref().unwrap();
        let empty = format!("# Card\n\n{BEGIN}\nold\n{END}\nafter\n");
        let once = card(&empty, &results, record).unwrap();
        assert!(
            once.starts_with("# Card\n\n<!--") && once.ends_with("-->\nafter\n") && !once.contains("old")
        );
        assert!(once.contains(&record.checkpoint_sha256) && once.contains("0.900 (0.795)"));
        assert_eq!(card(&once, &results, record).unwrap(), once);
        assert!(card("# Card\n", &results, record).is_err());
    }
}
