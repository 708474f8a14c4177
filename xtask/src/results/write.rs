//! The files of an experiment: `results.json`, and what is written from it alone.

use std::path::Path;

use anyhow::{Context, ensure};
use fs_err as fs;

use super::page;
use harmzone::eval::Column;
use harmzone::files::{sha256_hex, write_atomic};
use harmzone::model::checkpoint::CHECKPOINT;
use harmzone::report::document::{Block, markdown};
use harmzone::report::results::{Record, Results, blocks, headline_blocks};

/// Names of the files in the experiment's folder.
const JSON_FILE: &str = "results.json";
const CSV_FILE: &str = "results.csv";
const TEXT_FILE: &str = "RESULTS.md";

/// Marks in a card between which its figures stand.
const BEGIN: &str = "<!-- figures: begin -->";
const END: &str = "<!-- figures: end -->";

/// Writes everything again from `results.json`, the page also from the scores kept for it.
pub fn rewrite(out: &Path, card: Option<&Path>) -> anyhow::Result<()> {
    write(&Results::read(&out.join(JSON_FILE))?, out, card)
}

/// Writes all files; the card only if its network is the headline's.
pub fn write(results: &Results, out: &Path, card: Option<&Path>) -> anyhow::Result<()> {
    let json = out.join(JSON_FILE);
    write_atomic(&json, results.to_json().as_bytes())?;
    write_atomic(&out.join(CSV_FILE), to_csv(results)?.as_bytes())?;
    write_atomic(&out.join(TEXT_FILE), to_text(results).as_bytes())?;
    page::write(results, &json, out)?;
    let (Some(path), Some(headline)) = (card, &results.headline) else { return Ok(()) };
    let network = path.with_extension("safetensors");
    ensure!(
        sha256_hex(&fs::read(&network)?) == headline.checkpoint_sha256,
        "the card's network is not the headline's; copy {CHECKPOINT} of the headline's run there first: {}",
        network.display()
    );
    let text = fill_card(&fs::read_to_string(path)?, results, headline)
        .with_context(|| format!("cannot write the card: {}", path.display()))?;
    Ok(write_atomic(path, text.as_bytes())?)
}

/// `RESULTS.md`.
fn to_text(results: &Results) -> String {
    let written = format!("Written by {}.", results.made_by);
    let blocks = [vec![Block::text(written)], blocks(results)].concat();
    let title = if results.has_reported() { "Results" } else { "Results: development figures" };
    format!("# {title}\n\n{}", markdown(&blocks))
}

/// A card with the figures of its network between its marks.
fn fill_card(card: &str, results: &Results, record: &Record) -> anyhow::Result<String> {
    let parts = card.split_once(BEGIN).and_then(|(before, rest)| Some((before, rest.split_once(END)?.1)));
    let (before, after) =
        parts.with_context(|| format!("the card has no lines `{BEGIN}` and `{END}`, one after the other"))?;
    let figures = markdown(&headline_blocks(results, record));
    Ok(format!("{before}{BEGIN}\n{figures}{END}{after}"))
}

/// Short names of the groups of figures, as columns of `results.csv` begin.
fn key(column: Option<Column>) -> &'static str {
    match column {
        None => "id",
        Some(Column::Total) => "ood_total",
        Some(Column::IdMatched) => "ood_id_matched",
        Some(Column::OodAll) => "ood_all",
        Some(Column::OodMatched) => "ood_matched",
    }
}

/// `results.csv`: a line a row, the headline's first; times in seconds.
fn to_csv(results: &Results) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let groups = [None].into_iter().chain(Column::ALL.map(Some));
    let names = groups
        .flat_map(|group| ["harmful", "harmless", "mean"].map(|class| format!("{}_{class}", key(group))));
    let start = ["name", "seed", "n_parameters", "wall_s", "cpu_s"].map(str::to_owned);
    writer.write_record(start.into_iter().chain(names))?;
    let repeats = results.repeats.iter().map(|repeat| &repeat.record);
    for record in results.headline.iter().chain(&results.rows).chain(repeats) {
        let times =
            record.wall_and_cpu_s.map_or([const { String::new() }; 2], |of| of.map(|s| s.to_string()));
        let start = [record.name.clone(), record.seed.to_string(), record.n_parameters.to_string()];
        let scores = record.scores().into_iter().flat_map(|(_, of)| [of.harmful, of.harmless, of.mean]);
        let scores = scores.map(|ap| ap.map_or_else(String::new, |ap| format!("{ap:.4}")));
        writer.write_record(start.into_iter().chain(times).chain(scores))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmzone::report::results::test_data::test_results;

    #[test]
    fn the_csv_has_a_line_for_each_row_that_is_done() {
        let text = to_csv(&test_results()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[0].starts_with("name,seed,n_parameters,wall_s,cpu_s,id_harmful,id_harmless,id_mean,"));
        assert!(lines[1].starts_with("small,3,712345,3600.4,7000,0.9000,0.5000,0.7000,"), "{text}");
        assert!(lines.iter().all(|line| line.matches(',').count() == 19));
    }

    #[test]
    fn a_card_keeps_what_stands_around_its_figures_and_is_stable() {
        let results = test_results();
        let record = results.headline.as_ref().unwrap();
        let empty = format!("# Card\n\n{BEGIN}\nold\n{END}\nafter\n");
        let once = fill_card(&empty, &results, record).unwrap();
        assert!(
            once.starts_with("# Card\n\n<!--") && once.ends_with("-->\nafter\n") && !once.contains("old")
        );
        assert!(once.contains(&record.checkpoint_sha256) && once.contains("**0.900** (paper 0.795)"));
        assert_eq!(fill_card(&once, &results, record).unwrap(), once);
        assert!(fill_card("# Card\n", &results, record).is_err());
    }
}
