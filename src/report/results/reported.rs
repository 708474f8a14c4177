//! Figures on split test, which are for reporting alone: when they were made, by what, and in blocks.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::seeds::{self, Run, SeedMean, SeedMeans, Set, mean_of};
use super::{Record, Results, towns};
use crate::dataset::Fingerprint;
use crate::eval::safety::Alarms;
use crate::eval::{ClassScores, Column, Columns, Confidence};
use crate::report::document::Block;
use crate::report::missed;
use crate::report::paper::{Line, PARTS, STRICT, YARDSTICK};
use crate::report::table::{Table, number};

/// The headline's figures on split test, which `make results ARGS=--final` makes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReportedRecord {
    /// What the program was built from, as `git describe` tells it.
    pub commit: String,
    /// The commit's date, or the one that was given.
    pub date: String,
    pub checkpoint_sha256: String,
    /// Number of the rules of the scores.
    #[serde(default)]
    pub scoring: u32,
    /// The towns that come with harmzone; where there are maps by path, these, and all of them together.
    pub groups: Vec<ReportedGroup>,
    /// Maps that are not there, so that nothing is scored on them.
    pub absent_maps: Vec<PathBuf>,
}

/// Figures in some towns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReportedGroup {
    pub towns: Vec<String>,
    /// Without unfamiliar objects, and with them.
    pub id: ReportedSet,
    pub ood: ReportedSet,
}

/// Figures on a data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReportedSet {
    pub n_episodes: usize,
    pub n_samples: usize,
    pub fingerprint: Fingerprint,
    pub scores: Columns<ClassScores>,
    /// With neutral detections as false positives, where there may be such; unknown in what older versions wrote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strict: Option<Columns<ClassScores>>,
    /// Missed harm at fixed false alarms.
    #[serde(default)]
    pub missed: Option<Alarms>,
    /// By a bootstrap over the episodes.
    pub confidence: Option<Confidence>,
}

impl ReportedSet {
    fn lines(&self, columns: &[Option<Column>]) -> Vec<Line> {
        let line = |column: &Option<Column>| {
            let at = column.unwrap_or(Column::Total);
            let strict = self.strict.as_ref().and_then(|of| of.get(at));
            Some(Line::new(*column, self.scores.get(at)?, self.confidence.as_ref()).with_strict(strict))
        };
        columns.iter().filter_map(line).collect()
    }
}

/// What the other figures are, beside those of split test above them or among them.
pub(super) fn development_block(is_above: bool, is_among: bool) -> Block {
    let more = match (is_above, is_among) {
        (true, true) => "those of split test stand above, and below where they are called so.",
        (true, false) => "those of split test stand above.",
        (false, true) => "those of split test stand below where they are called so.",
        (false, false) => "`make results ARGS=--final` makes those of split test.",
    };
    Block::text(format!(
        "Development figures, on the splits val and dev, by which choices were made: not for reporting; {more}"
    ))
}

impl<'a> From<&'a ReportedSet> for Set<'a> {
    fn from(of: &'a ReportedSet) -> Self {
        Set { columns: &of.scores, alarms: of.missed.as_ref(), confidence: of.confidence.as_ref() }
    }
}

/// The headline and its repeats on the same data, for one group of towns.
fn of_same_data<'a>(
    results: &'a Results,
    record: &'a ReportedRecord,
    group: usize,
) -> Vec<(&'a ReportedRecord, &'a ReportedGroup)> {
    let Some(first) = record.groups.get(group) else { return Vec::new() };
    let is_same = |of: &&ReportedGroup| {
        [(&of.id, &first.id), (&of.ood, &first.ood)]
            .iter()
            .all(|(one, other)| one.fingerprint == other.fingerprint)
    };
    let all = std::iter::once(record).chain(&results.reported_repeats);
    all.filter_map(|of| Some((of, of.groups.get(group).filter(is_same)?))).collect()
}

/// Their figures side by side; `None` where there is one alone.
fn seeds_table(results: &Results, record: &ReportedRecord, group: usize) -> Option<Table> {
    let of_group = of_same_data(results, record, group);
    let records = || results.headline.iter().chain(results.repeats.iter().map(|of| &of.record));
    let name = |of: &ReportedRecord| {
        let seed = records().find(|record| record.checkpoint_sha256 == of.checkpoint_sha256);
        seed.map_or_else(|| of.checkpoint_sha256.chars().take(8).collect(), |of| format!("seed {}", of.seed))
    };
    let runs = of_group
        .iter()
        .map(|(of, towns)| Run { name: name(of), sets: [&towns.id, &towns.ood].map(Set::from) });
    let others = of_group.iter().filter(|(of, _)| of.commit != record.commit);
    let others: Vec<String> =
        others.map(|(of, _)| format!("{} by commit {}, {}", name(of), of.commit, of.date)).collect();
    let means = means_of(results, &of_group).and_then(|of| of.groups.get(group)).map(SeedMean::sets);
    let table = seeds::of_runs(&runs.collect::<Vec<_>>(), means)?;
    Some(if others.is_empty() { table } else { table.with_note(format!("{}.", others.join("; "))) })
}

/// The means, if they are of these networks.
fn means_of<'a>(
    results: &'a Results,
    of_group: &[(&ReportedRecord, &ReportedGroup)],
) -> Option<&'a SeedMeans> {
    let is_same =
        |of: &&SeedMeans| of.networks.iter().eq(of_group.iter().map(|(of, _)| &of.checkpoint_sha256));
    results.seed_means.as_ref().filter(is_same)
}

/// What other towns cost: the same networks in the towns that they were trained in, and in the others. `None` where none of them
/// is known in both.
fn towns_table(results: &Results, record: &ReportedRecord, group: usize) -> Option<Table> {
    let means = means_of(results, &of_same_data(results, record, group));
    if let Some((seen, unseen)) = means.and_then(|of| Some((&of.seen, of.groups.get(group)?))) {
        return Some(towns::table(seen, unseen));
    }
    let known = || results.headline.iter().chain(results.repeats.iter().map(|of| &of.record));
    let of_group = of_same_data(results, record, group);
    let pairs = of_group.into_iter().filter_map(|(of, towns)| {
        Some((known().find(|record| record.checkpoint_sha256 == of.checkpoint_sha256)?, towns))
    });
    let pairs: Vec<(&Record, &ReportedGroup)> = pairs.collect();
    let row = |name: &str, seen: fn(&Record) -> Option<f64>, unseen: fn(&ReportedGroup) -> Option<f64>| {
        let seen = mean_of(pairs.iter().map(|(of, _)| seen(of)));
        let unseen = mean_of(pairs.iter().map(|(_, of)| unseen(of)));
        let difference = unseen.zip(seen).map(|(unseen, seen)| unseen - seen);
        [name.into()].into_iter().chain([seen, unseen, difference].map(|of| number(of, 3).into())).collect()
    };
    let id = row("ID", |of| of.id.mean, |of| of.id.scores.total.mean);
    let ood =
        row("OOD total, other unfamiliar objects", |of| of.ood.total.mean, |of| of.ood.scores.total.mean);
    let head = ["mean AP"].into_iter().chain(towns::HEAD);
    (!pairs.is_empty()).then(|| Table::new(head, vec![id, ood]))
}

/// What the strict figures are, where there are any.
pub(super) fn strict_note(is_there: bool) -> String {
    if is_there { format!("{STRICT} ") } else { String::new() }
}

/// The figures on split test, a table a group.
pub(super) fn reported_blocks(results: &Results, record: &ReportedRecord) -> Vec<Block> {
    let mut blocks = vec![
        Block::heading("Split test"),
        Block::text(format!(
            "For reporting: towns and unfamiliar objects that no other split has. Commit {}, {}; network {}.",
            record.commit, record.date, record.checkpoint_sha256
        )),
    ];
    for (i, group) in record.groups.iter().enumerate() {
        if record.groups.len() > 1 {
            blocks.push(Block::text(format!("In {}:", group.towns.join(", "))));
        }
        let sets = [("ID", &group.id), ("OOD", &group.ood)];
        let sets: Vec<missed::NamedAlarms<'_>> =
            sets.into_iter().filter_map(|(name, set)| Some((name, set.missed.as_ref()?))).collect();
        let families = sets.iter().filter_map(|&set| missed::by_family(set));
        blocks.extend(missed::table(&sets).into_iter().chain(families).map(Block::Table));
        let lines = [group.id.lines(&[None]), group.ood.lines(&Column::ALL.map(Some))].concat();
        let level = group.id.confidence.as_ref().map_or(95.0, |of| 100.0 * of.level);
        let note = format!(
            "Towns: {}. ID: {} clips, {} samples; OOD: {} clips, {} samples. Intervals of {level} % by a bootstrap over the \
             clips. {}{YARDSTICK}",
            group.towns.join(", "),
            group.id.n_episodes,
            group.id.n_samples,
            group.ood.n_episodes,
            group.ood.n_samples,
            strict_note([&group.id.strict, &group.ood.strict].into_iter().any(Option::is_some)),
        );
        let rows = lines.iter().map(Line::cells).collect();
        blocks.push(Block::Table(Table::new(["AP"].into_iter().chain(PARTS), rows).with_note(note)));
        blocks.extend(
            seeds_table(results, record, i)
                .into_iter()
                .chain(towns_table(results, record, i))
                .map(Block::Table),
        );
    }
    if !record.absent_maps.is_empty() {
        let absent: Vec<String> = record.absent_maps.iter().map(|path| path.display().to_string()).collect();
        blocks.push(Block::text(format!("Not scored, since the maps are not there: {}.", absent.join(", "))));
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{test_reported, test_results, test_seed_means, test_with_repeats};
    use super::super::{ReportedRecord, Results, SetScores, blocks, headline_blocks};
    use crate::report::document::markdown;

    #[test]
    fn reported_figures_stand_first_with_commit_and_date() {
        let results = Results { reported: Some(test_reported()), ..test_results() };
        let text = markdown(&blocks(&results));
        let place = |part: &str| text.find(part).unwrap_or_else(|| panic!("no `{part}` in {text}"));
        let others = "\nDevelopment figures, on the splits";
        assert!(place("## Split test") < place(others), "{text}");
        for part in ["0123abc", "2026-02-03", "Towns: harbour, hillside.", "0.100–0.300", "maps/Town02.xodr"]
        {
            assert!(place(part) < place(others));
        }
        for row in [
            "| ID | 0.700 | 0.350 | -0.350 |",
            "| OOD total, other unfamiliar objects | 0.650 | 0.350 | -0.300 |",
        ] {
            assert!(text.contains(row), "{row}: {text}");
        }
        let card = markdown(&headline_blocks(&results, results.headline.as_ref().unwrap()));
        assert!(card.contains("## Split test"), "{card}");
    }

    #[test]
    fn strict_figures_stand_above_the_papers_where_they_are_known() {
        let mut reported = test_reported();
        let set = &mut reported.groups[0].ood;
        let mut strict = set.scores.clone();
        strict.total.mean = Some(0.125);
        set.strict = Some(strict.clone());
        let mut results = Results { reported: Some(reported), ..test_results() };
        let headline = results.headline.as_mut().unwrap();
        headline.strict = Some(SetScores { id: headline.id, ood: strict });
        let text = markdown(&blocks(&results));
        assert_eq!(text.matches("strict 0.125, paper 0.719").count(), 2, "{text}");
        assert!(text.matches("Strict: with neutral detections as false positives.").count() == 2, "{text}");
        let without = markdown(&blocks(&test_results()));
        assert!(!without.contains("trict"), "{without}");
    }

    #[test]
    fn without_them_every_figure_is_called_one_of_development() {
        let text = markdown(&blocks(&test_results()));
        assert!(!text.contains("Split test") && text.starts_with("## In short\n"), "{text}");
        let (short, rest) = text.split_once("\nDevelopment figures, on the splits").unwrap();
        let answers = short.lines().skip(1).filter(|line| !line.is_empty());
        assert!(
            answers.clone().count() == 2
                && answers.into_iter().all(|line| line.ends_with("Development figures, split dev."))
        );
        assert!(rest.contains("makes those of split test"), "{rest}");
    }

    #[test]
    fn figures_on_split_test_are_told_seed_by_seed() {
        let of =
            |seed: u64| ReportedRecord { checkpoint_sha256: seed.to_string().repeat(64), ..test_reported() };
        let results = Results {
            reported: Some(test_reported()),
            reported_repeats: vec![of(4), of(5)],
            ..test_with_repeats()
        };
        let text = markdown(&blocks(&results));
        let (before, _) = text.split_once("\nDevelopment figures, on the splits").unwrap();
        assert!(before.contains("| seed 3 | seed 4 | seed 5 | mean | standard deviation |"), "{before}");
        assert!(
            before.contains(
                "**0.350** (0.100–0.300) | **0.350** (0.100–0.300) | **0.350** (0.100–0.300) | 0.350 | 0.000 |"
            ),
            "{before}"
        );
        // Seeds 3, 4 and 5 in the towns of training: .65, .55 and .6.
        assert!(text.contains("other unfamiliar objects | 0.600 | 0.350 | -0.250 |"), "{text}");
        // Of a seed on other data nothing is said.
        let mut results = results;
        results.reported_repeats[0].groups[0].ood.fingerprint = results.data.id.fingerprint.clone();
        let text = markdown(&blocks(&results));
        assert!(text.contains("other unfamiliar objects | 0.625 | 0.350 | -0.275 |"), "{text}");
        let alone = Results { reported: Some(test_reported()), ..test_results() };
        assert!(!markdown(&blocks(&alone)).contains("standard deviation"));
    }
    #[test]
    fn means_and_differences_have_intervals_if_they_are_of_these_seeds() {
        let of =
            |seed: u64| ReportedRecord { checkpoint_sha256: seed.to_string().repeat(64), ..test_reported() };
        let mut results = Results {
            reported: Some(test_reported()),
            reported_repeats: vec![of(4), of(5)],
            seed_means: Some(test_seed_means()),
            ..test_with_repeats()
        };
        let text = markdown(&blocks(&results));
        for part in [
            // The mean is that of the seeds' own figures, its interval that of the means.
            "**0.350** (0.100–0.300) | **0.350** (0.560–0.630) | 0.000 |",
            "| OOD: mAP_OOD (all FPs) | 0.400 | 0.400 | 0.400 | **0.400** (0.510–0.580) | 0.000 |",
            "| ID: mean AP | **0.700** (0.660–0.730) | **0.600** (0.560–0.630) | **-0.100** (-0.150 to -0.050) |",
            "missed, %, at 10 false alarms/km | **70.0** (66.0–73.0) | **60.0** (56.0–63.0) | **-10.0**",
            "warned of in time, %, at 10 false alarms/km, 8 m/s² | **70.0**",
            "MOVER",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        results.seed_means.as_mut().unwrap().networks.pop();
        let text = markdown(&blocks(&results));
        assert!(!text.contains("MOVER") && text.contains("| ID | 0.700 | 0.350 | -0.350 |"), "{text}");
    }
}
