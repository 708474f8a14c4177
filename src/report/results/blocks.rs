//! The results of an experiment in blocks, for RESULTS.md, the page and a network's card.

use super::answers;
use super::reported::{development_block, reported_blocks, strict_note};
use super::seeds::{self, both_intervals, mean_of, missed_events};
use super::{
    MissedHarm, Record, ReportedRecord, ReportedVersus, Results, RivalRecord, SetRecord, SetScores,
    SideBySide, TableConfig,
};
use crate::eval::{ClassScores, Column, Confidence};
use crate::report::document::Block;
use crate::report::missed;
use crate::report::paper::{Line, PARTS, YARDSTICK};
use crate::report::provenance::quote;
use crate::report::table::{Cell, Table, ap, number};
use crate::report::versus;

/// All blocks of the results; the same results give the same blocks.
#[must_use]
pub fn blocks(results: &Results) -> Vec<Block> {
    let mut blocks = answers::blocks(results);
    blocks.extend(standing_blocks(results, results.has_reported_rows()));
    blocks.extend(data_blocks(results));
    blocks.push(Block::heading("The network that ships"));
    match &results.headline {
        Some(record) => blocks.extend(record_blocks(results, record)),
        None => blocks.push(Block::text("Not trained yet.")),
    }
    if !results.tables.is_empty() {
        blocks.push(Block::heading("Ablations"));
        blocks.push(Block::text(
            "A row is a training over configs/train.toml with the keys below, a shorter schedule than that of the network above. \
             Harmful events missed at 10 false alarms a kilometre, then mean AP (harmful / harmless). A row of several seeds shows \
             their mean and each one's mean AP, and what the first took to train; of one seed, small differences tell nothing.",
        ));
        blocks.push(Block::code(results.common.join("\n")));
    }
    for table in &results.tables {
        blocks.extend(ablation_blocks(results, table));
    }
    for of in &results.side_by_side {
        blocks.extend(side_by_side_blocks(results, of));
    }
    if !results.rivals.is_empty() {
        blocks.extend(rival_blocks(results));
    }
    blocks
}

/// The tables of rows side by side; those of split test first, where there are any.
fn side_by_side_blocks(results: &Results, of: &SideBySide) -> Vec<Block> {
    let tables = |versus| versus::tables(versus, &of.labels).into_iter().map(Block::Table);
    let mut blocks = vec![Block::heading(&of.title), Block::text(of.note.clone())];
    let Some(ReportedVersus { commit, date, fingerprint, of: reported }) = &of.reported else {
        blocks.extend(tables(&of.of));
        return blocks;
    };
    let is_other =
        |record: &ReportedRecord| !record.groups.iter().any(|towns| towns.ood.fingerprint == *fingerprint);
    let other = if results.reported.as_ref().is_some_and(is_other) {
        " These are other data than those of the network that ships."
    } else {
        ""
    };
    blocks.push(Block::text(format!("Split test: commit {commit}, {date}.{other}")));
    blocks.extend(tables(reported));
    blocks.push(Block::fold("The same on split dev: development figures", tables(&of.of).collect()));
    blocks
}

/// The headline's figures and its data, for the card of its network.
#[must_use]
pub fn headline_blocks(results: &Results, record: &Record) -> Vec<Block> {
    let hash = Block::text(format!("SHA-256 of the file: {}", record.checkpoint_sha256));
    [vec![hash], standing_blocks(results, false), record_blocks(results, record), data_blocks(results)]
        .concat()
}

/// The figures on split test, if there are any, and what all others are; some of those below may be of split test, too.
fn standing_blocks(results: &Results, is_among: bool) -> Vec<Block> {
    let reported = results.reported.as_ref();
    let blocks = reported.map(|record| reported_blocks(results, record));
    blocks.into_iter().flatten().chain([development_block(reported.is_some(), is_among)]).collect()
}

fn data_blocks(results: &Results) -> Vec<Block> {
    let (data, preset) = (&results.data, &results.data.preset);
    let describe = |set: &SetRecord, what: &str| {
        let made =
            if set.is_of_preset { "" } else { ", made by another version or config than the commands below" };
        let of = &set.fingerprint;
        format!(
            "{what}{made} (dataset.json {}, labels {})",
            short(&of.dataset_sha256),
            short(&of.labels_sha256)
        )
    };
    let [n_train, n_val, _] = data.id.n_samples;
    let n_dev: usize = data.ood.n_samples.iter().sum();
    let mut records = results.headline.iter().chain(&results.rows);
    let of_id = if records.clone().next().is_some() && records.all(|of| of.learned_from.is_some()) {
        format!("{n_val} samples with familiar objects alone to choose by")
    } else {
        format!("{n_train} samples to train on and {n_val} to validate on")
    };
    vec![
        Block::text(format!(
            "Data: {}; {}. AP is the nuScenes one: mean over centre distances of 0.5, 1, 2 and 4 m, objects within 50 m.",
            describe(&data.id, &of_id),
            describe(&data.ood, &format!("{n_dev} samples with unfamiliar objects to choose by")),
        )),
        Block::code(format!(
            "harmzone gen --preset {preset} --out data/id && harmzone label data/id\n\
             harmzone gen --preset {preset} --ood --out data/ood && harmzone label data/ood"
        )),
    ]
}

/// A hash as it is told.
fn short(hash: &str) -> String {
    hash.chars().take(12).collect()
}

/// Missed harm and all columns of a row with the paper's figures, its costs and its commands.
fn record_blocks(results: &Results, record: &Record) -> Vec<Block> {
    let rows = record.scores().into_iter().map(|(column, scores)| {
        let strict = record.strict.as_ref().and_then(|of| column.map_or(Some(&of.id), |at| of.ood.get(at)));
        Line::new(column, &scores, None).with_strict(strict).cells()
    });
    let samples = match &record.learned_from {
        Some(of) => format!(
            "data of its own (dataset.json {}, labels {})",
            short(&of.dataset_sha256),
            short(&of.labels_sha256)
        ),
        None => format!("{} samples", results.data.id.n_samples[0]),
    };
    let note = format!(
        "{} M parameters, {:.1} MiB, seed {}, {} + {} epochs (LiDAR stage, fused stage) of {samples}; training time {}. \
         {}{YARDSTICK}",
        millions(record.n_parameters),
        record.checkpoint_bytes as f64 / f64::from(1 << 20),
        record.seed,
        record.epochs[0],
        record.epochs[1],
        duration(record.wall_and_cpu_s),
        strict_note(record.strict.is_some()),
    );
    let table = Table::new(["AP"].into_iter().chain(PARTS), rows.collect()).with_note(note);
    let MissedHarm { id, ood } = &record.missed;
    let sets: Vec<missed::NamedAlarms<'_>> =
        [("ID", id), ("OOD", ood)].into_iter().filter_map(|(name, of)| Some((name, of.as_ref()?))).collect();
    let families = ood.as_ref().and_then(|alarms| missed::by_family(("OOD", alarms)));
    let missed = missed::table(&sets).into_iter().chain(families).map(Block::Table);
    let seeds = seeds::table(results, record).map(Block::Table);
    missed.chain([Block::Table(table)]).chain(seeds).chain([Block::code(commands(&[record]))]).collect()
}

/// Columns of a table of ablations.
const N_COLUMNS: usize = 10;

fn ablation_blocks(results: &Results, table: &TableConfig) -> Vec<Block> {
    let mut records = Vec::new();
    let rows = table.rows.iter().map(|of| {
        let mut cells: Vec<Cell> = vec![of.label.clone().into()];
        let runs = results.runs_of(&of.row);
        let Some(&record) = runs.first() else {
            cells.push("not trained yet".into());
            cells.resize(N_COLUMNS, "".into());
            return cells;
        };
        records.extend(&runs);
        let scores: Vec<Vec<ClassScores>> =
            runs.iter().map(|run| run.scores().into_iter().map(|(_, scores)| scores).collect()).collect();
        cells.push(missed_events(runs.iter().map(|run| &run.missed)));
        let intervals = if runs.len() == 1 { record.mean_intervals() } else { Vec::new() };
        let interval = |i: usize| intervals.get(i).copied().flatten();
        let cell = |i: usize| scores_cell(scores.iter().filter_map(|of| of.get(i)), interval(i));
        cells.extend((0..scores[0].len()).map(cell));
        cells.resize(N_COLUMNS - 3, "".into());
        cells.push(format!("{} M", millions(record.n_parameters)).into());
        cells.push(duration(record.wall_and_cpu_s).into());
        cells.push(runs.iter().map(|run| run.seed.to_string()).collect::<Vec<_>>().join(", ").into());
        cells
    });
    let rows = rows.collect();
    let head: [&str; N_COLUMNS] = [
        "",
        "harmful events missed, ID / OOD",
        "ID",
        "OOD total",
        "mAP_ID",
        "mAP_OOD, all FPs",
        "mAP_OOD, matched FPs",
        "parameters",
        "training: wall (CPU)",
        "seed",
    ];
    let mut blocks = vec![
        Block::heading(&table.title),
        Block::text(table.note.clone()),
        Block::Table(Table::new(head, rows)),
    ];
    if !records.is_empty() {
        let title = format!("{}: the commands", table.title);
        blocks.push(Block::fold(&title, vec![Block::code(commands(&records))]));
    }
    blocks
}

/// Mean AP, of one run with its interval, of several with each one's.
fn scores_cell<'a>(runs: impl Iterator<Item = &'a ClassScores>, interval: Option<[f64; 2]>) -> Cell {
    let runs: Vec<&ClassScores> = runs.collect();
    let mean = |part: fn(&ClassScores) -> Option<f64>| ap(mean_of(runs.iter().map(|&of| part(of))));
    let range = interval.map(|ends| ends.map(|end| ap(Some(end))).join("–"));
    let of_classes = format!("{} / {}", mean(|of| of.harmful), mean(|of| of.harmless));
    let mut below: Vec<String> = range.into_iter().chain([of_classes]).collect();
    if runs.len() > 1 {
        let each: Vec<String> = runs.iter().map(|of| ap(of.mean)).collect();
        below.push(format!("seeds {}", each.join(", ")));
    }
    Cell { text: mean(|of| of.mean), below }
}

fn rival_blocks(results: &Results) -> Vec<Block> {
    let text = "Each network's own word (`model.head.judge`: its class branch, or branch and rule together) against the zone's own rule, laid over the network's boxes with the measured speed \
                and steering angle (docs/evaluation.md, rivals). mAP with both sensors right, with the speed measured 10 % \
                too low or too high, and with the steering angle measured 2° off; of the two the lower. ID / OOD total. A \
                closed set tells kinds in place of harm; neither it nor a rule by kind sees the two sensors, the zone's rules over its boxes do. Each row's first seed alone; \
                means of several seeds stand in the tables above. Below the first figures their intervals of 95 % by a bootstrap over the clips.";
    let rows = results.rivals.iter().map(|RivalRecord { label, row, scores }| {
        let means = |of: &SetScores| [of.id.mean, of.ood.total.mean];
        let in_both = |[id, ood]: [Option<f64>; 2]| format!("{} / {}", ap(id), ap(ood));
        let cell = |of: [Option<f64>; 2]| in_both(of).into();
        let interval = |of: &Option<Confidence>, column: Column| of.as_ref()?.columns.get(column)?.mean;
        let show = |end: f64| ap(Some(end));
        let total = [&scores.confidence.id, &scores.confidence.ood].map(|of| interval(of, Column::Total));
        let right = both_intervals(total, show);
        let matched = scores.right.ood.ood_matched.and_then(|of| of.mean);
        let of_matched =
            interval(&scores.confidence.ood, Column::OodMatched).map(|ends| ends.map(show).join("–"));
        let lower = |pair: &[SetScores; 2]| {
            let [a, b] = [means(&pair[0]), means(&pair[1])];
            let least = |i: usize| a[i].into_iter().chain(b[i]).reduce(f64::min);
            cell([least(0), least(1)])
        };
        vec![
            label.as_str().into(),
            row.as_str().into(),
            missed_events([&scores.missed]),
            Cell { text: in_both(means(&scores.right)), below: right.into_iter().collect() },
            Cell { text: ap(matched), below: of_matched.into_iter().collect() },
            lower(&scores.speed_off),
            lower(&scores.steering_off),
            format!("{:.2} ms", scores.judge_ms).into(),
        ]
    });
    let alarms = results.rivals.iter().find_map(|of| of.scores.missed.ood.as_ref().and_then(missed::middle));
    let rate =
        alarms.map_or_else(String::new, |of| format!(" at {} false alarms/km", of.max_false_alarms_per_km));
    let missed = format!("harmful events missed{rate}, ID / OOD");
    let head = [
        "",
        "of row",
        missed.as_str(),
        "sensors right",
        "mAP_OOD, matched FPs",
        "speed off",
        "steering off",
        "rule",
    ];
    let times = results.network_ms.iter().map(|(row, ms)| format!("{row} {ms:.0} ms"));
    let note = format!(
        "Times are medians of a sample. The networks take, from cloud and packed image to boxes: {}.",
        times.collect::<Vec<_>>().join(", ")
    );
    let table = Table::new(head, rows.collect()).with_note(note);
    vec![Block::heading("Who decides on harm"), Block::text(text), Block::Table(table)]
}

fn millions(n: usize) -> String {
    number(Some(n as f64 / 1e6), 2)
}

fn duration(wall_and_cpu_s: Option<[f64; 2]>) -> String {
    let minutes = |seconds: f64| (seconds / 60.0).round() as u64;
    match wall_and_cpu_s {
        Some([wall_s, cpu_s]) if wall_s < 120.0 => format!("{wall_s:.0} s (CPU {cpu_s:.0} s)"),
        Some([wall_s, cpu_s]) => format!("{} min (CPU {} min)", minutes(wall_s), minutes(cpu_s)),
        None => "not kept".to_owned(),
    }
}

/// The commands that train and score rows again.
fn commands(records: &[&Record]) -> String {
    let of_record = |record: &&Record| {
        let run = format!("runs/{}", record.name);
        let mut train: Vec<String> =
            ["harmzone", "train", "data/id", "--out", &run].map(str::to_owned).into();
        if record.profile != "small" {
            train.extend(["--model".to_owned(), record.profile.clone()]);
        }
        train.extend(record.set.iter().flat_map(|key| ["--set".to_owned(), key.clone()]));
        let train = match record.learned_from {
            Some(_) => format!("# trained on data of its own: {}", quote(&train[5..])),
            None => quote(&train),
        };
        format!("{train}\nharmzone eval {run} --data data/id; harmzone eval {run} --data data/ood --ood")
    };
    records.iter().map(of_record).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use crate::dataset::Fingerprint;
    use crate::report::document::markdown;
    use crate::report::results::Results;
    use crate::report::results::test_data::test_results;

    #[test]
    fn the_document() {
        insta::assert_snapshot!(markdown(&super::blocks(&test_results())));
    }

    #[test]
    fn a_headline_that_learned_elsewhere_says_so_and_not_how_it_was_trained_here() {
        let mut results = test_results();
        let headline = results.headline.as_mut().unwrap();
        let elsewhere = Fingerprint { dataset_sha256: "1".repeat(64), labels_sha256: "2".repeat(64) };
        headline.learned_from = Some(elsewhere);
        let text = markdown(&super::blocks(&results));
        assert!(
            text.contains("of data of its own (dataset.json 111111111111, labels 222222222222)"),
            "{text}"
        );
        assert!(
            text.contains("# trained on data of its own") && !text.contains("train data/id --out runs/small")
        );
        assert!(text.contains("harmzone eval runs/small --data data/id"), "{text}");
    }

    #[test]
    fn nothing_done_yet_is_a_document_too() {
        let results = Results { headline: None, rows: Vec::new(), rivals: Vec::new(), ..test_results() };
        let text = markdown(&super::blocks(&results));
        assert!(text.contains("Not trained yet.") && text.contains("| not trained yet |"), "{text}");
        assert!(!text.contains("Who decides on harm"));
        let text = markdown(&super::blocks(&Results { tables: Vec::new(), ..results }));
        assert!(!text.contains("Ablations") && text.contains("Side by side"), "{text}");
    }
}
