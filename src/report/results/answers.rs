//! What an experiment answers, in a sentence each with its figures, for the top of the results.

use serde::{Deserialize, Serialize};

use super::{Results, SeedMeans, SideBySide};
use crate::eval::safety::Alarms;
use crate::eval::versus::{Versus, VersusFigure, VersusLine, column_name};
use crate::eval::{ClassScores, Column};
use crate::report::document::Block;
use crate::report::missed;
use crate::report::table::{number, percent};

/// A question put to rows side by side: does one do better than the first? The sentence that the interval over episodes and seeds
/// bears out stands at the top of the results; of one training each nothing is certain.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuestionConfig {
    /// Label of the row.
    pub row: String,
    /// Where all of the interval of its mean AP's difference lies above zero, and that of missed events not above it.
    pub better: String,
    /// Where all of it lies below zero, and that of missed events not below it.
    pub worse: String,
    /// Else.
    pub level: String,
}

/// All answers; nothing where there are none.
pub(super) fn blocks(results: &Results) -> Vec<Block> {
    let of_rows = results
        .side_by_side
        .iter()
        .flat_map(|of| of.questions.iter().filter_map(move |question| answer(of, question)));
    let texts: Vec<Block> = headline(results).into_iter().chain(of_rows).map(Block::text).collect();
    if texts.is_empty() {
        return texts;
    }
    std::iter::once(Block::heading("In short")).chain(texts).collect()
}

/// What figures are that stand alone.
fn standing(is_reported: bool) -> &'static str {
    if is_reported { "Split test." } else { "Development figures, split dev." }
}

/// What the network that ships misses, on split test where that is known; the mean of its seeds, where all of them are.
fn headline(results: &Results) -> Option<String> {
    if let Some(means) = seed_means(results) {
        return headline_of_seeds(means);
    }
    let towns = results.reported.as_ref().and_then(|record| record.groups.last());
    let (alarms, [total, unfamiliar]): (Option<&Alarms>, [Option<ClassScores>; 2]) =
        match (towns, &results.headline) {
            (Some(towns), _) => {
                (towns.ood.missed.as_ref(), [Some(towns.ood.scores.total), towns.ood.scores.ood_all])
            }
            (None, Some(record)) => {
                (record.missed.ood.as_ref(), [Some(record.ood.total), record.ood.ood_all])
            }
            (None, None) => return None,
        };
    let point = missed::middle(alarms?)?;
    let within = |of: Option<[f64; 2]>| {
        of.map_or_else(String::new, |ends| {
            format!(" ({})", ends.map(|end| number(Some(100.0 * end), 1)).join("–"))
        })
    };
    let of_unfamiliar = alarms?.groups.iter().find(|group| group.name == "ood").and_then(|group| {
        let missed = (*group.missed_per_event.get(alarms?.points.len() / 2)?)?;
        Some(format!(", {} of the {} of an unfamiliar object", percent(Some(missed)), group.n_events))
    });
    let warned = point.warned.last().map_or_else(String::new, |of| {
        format!(
            "; it warns in time of {}{} of those that can be stopped for at {} m/s²",
            percent(of.in_time),
            within(of.in_time_interval),
            of.deceleration_mps2
        )
    });
    let mean = |of: Option<ClassScores>| number(of.and_then(|of| of.mean), 3);
    Some(format!(
        "In drives with unfamiliar objects the network that ships misses {}{} of the {} harmful events at {} false alarms a kilometre{}{warned}. \
         Mean AP there is {}, of unfamiliar objects {} with all false positives but those on ignored ground. {}",
        percent(point.missed_per_event),
        within(point.missed_per_event_interval),
        point.n_events,
        point.max_false_alarms_per_km,
        of_unfamiliar.unwrap_or_default(),
        mean(total),
        mean(unfamiliar),
        standing(towns.is_some()),
    ))
}

/// The means of the network that ships and its repeats, where those of all towns are known.
fn seed_means(results: &Results) -> Option<&SeedMeans> {
    let record = results.reported.as_ref()?;
    let is_of_all = |of: &&SeedMeans| {
        of.networks.len() > 1
            && of.networks.first() == Some(&record.checkpoint_sha256)
            && of.groups.len() == record.groups.len()
    };
    results.seed_means.as_ref().filter(is_of_all)
}

fn headline_of_seeds(means: &SeedMeans) -> Option<String> {
    let of = &means.groups.last()?.ood;
    let missed = of.missed.get(of.missed.len() / 2)?;
    // The line of the hardest stop to demand at that number of false alarms: the last that goes by its name.
    let warned = of.warned.iter().rfind(|line| line.name.starts_with(&format!("{},", missed.name)));
    let text = |line: &VersusLine, show: &dyn Fn(f64) -> String, unit: &str| -> Option<String> {
        let figure = line.figures.first()?;
        let interval = figure.interval.map(|ends| format!(" ({})", ends.map(show).join("–")));
        Some(format!("{}{unit}{}", show(figure.value?), interval.unwrap_or_default()))
    };
    let share = |line: &VersusLine| text(line, &|value| number(Some(100.0 * value), 1), " %");
    let ap_of = |column: Column| {
        let line = of.mean.iter().find(|line| line.name == column_name(column))?;
        text(line, &|value| number(Some(value), 3), "")
    };
    let in_time = warned.and_then(|line| {
        let deceleration = line.name.rsplit_once(", ")?.1;
        Some(format!(
            "; they warn in time of {} of those that can be stopped for at {deceleration}",
            share(line)?
        ))
    });
    let unfamiliar = ap_of(Column::OodAll);
    let unfamiliar = unfamiliar.map(|ap| {
        format!(", of unfamiliar objects {ap} with all false positives but those on ignored ground")
    });
    Some(format!(
        "In drives with unfamiliar objects {} trainings of the network that ships miss {} of the {} harmful events {}, in the mean \
         of their seeds{}. Mean AP there is {}{}. {}",
        means.networks.len(),
        share(missed)?,
        missed.n_truths,
        missed.name.replace("/km", " a kilometre"),
        in_time.unwrap_or_default(),
        ap_of(Column::Total)?,
        unfamiliar.unwrap_or_default(),
        standing(true),
    ))
}

/// By split test where it is known. `None` where the row is not there, or no figure of it.
fn answer(of: &SideBySide, question: &QuestionConfig) -> Option<String> {
    let versus: &Versus = of.reported.as_ref().map_or(&of.of, |reported| &reported.of);
    let place = of.labels.iter().position(|label| *label == question.row)?;
    let (first, mean) = (of.labels.first()?, versus.mean.first()?);
    let missed = versus.missed.get(versus.missed.len() / 2);
    let over = |line: &VersusLine| line.figures.get(place)?.over_first_seeds_interval;
    let more_missed = missed.and_then(over);
    // `Some` where an interval lies on one side of nought: whether the row is surely better.
    let sure = |ends: Option<[f64; 2]>, is_better_above: bool| match ends {
        Some([low, _]) if low > 0.0 => Some(is_better_above),
        Some([_, high]) if high < 0.0 => Some(!is_better_above),
        _ => None,
    };
    let word = |is_better: bool| if is_better { "better" } else { "worse" };
    let sentence = match (sure(over(mean), true), sure(more_missed, false)) {
        (Some(true), None | Some(true)) => question.better.clone(),
        (Some(false), None | Some(false)) => question.worse.clone(),
        (None, None) => question.level.clone(),
        // What leads every table is not passed over.
        (None, Some(by_missed)) => {
            format!(
                "{} By missed events alone `{}` is surely {}.",
                question.level,
                question.row,
                word(by_missed)
            )
        }
        (Some(by_ap), Some(by_missed)) => format!(
            "{} By AP `{}` is surely {}, by missed events surely {}.",
            question.level,
            question.row,
            word(by_ap),
            word(by_missed)
        ),
    };
    let aps = compared(mean, place, &|value| number(Some(value), 3))?;
    let missed = missed.and_then(|line| {
        let shares = compared(line, place, &|value| number(Some(100.0 * value), 1))?;
        Some(format!("; harmful events missed {}, %: {shares}", line.name))
    });
    Some(format!(
        "{sentence} ({}, against {first}: mean AP {aps}{}.) {}",
        question.row,
        missed.unwrap_or_default(),
        standing(of.reported.is_some())
    ))
}

/// A row's figure and the first one's, with those of their runs, and their difference with its interval.
fn compared(line: &VersusLine, place: usize, show: &dyn Fn(f64) -> String) -> Option<String> {
    let (row, first) = (line.figures.get(place)?, line.figures.first()?);
    let of_runs = |of: &VersusFigure| -> Option<String> {
        let runs: Vec<String> = of.runs.iter().flatten().map(|&run| show(run)).collect();
        let runs = if runs.is_empty() { String::new() } else { format!(" (seeds {})", runs.join(", ")) };
        Some(show(of.value?) + &runs)
    };
    let signed = |of: f64| if of < 0.0 { show(of) } else { format!("+{}", show(of)) };
    let range = |ends: [f64; 2]| ends.map(signed).join(" to ");
    let interval = match (row.over_first_seeds_interval, row.over_first_interval) {
        (Some(ends), _) => Some(format!(", {} over episodes and seeds", range(ends))),
        (None, Some(ends)) => {
            Some(format!(", {} over episodes; what another seed would change is not known", range(ends)))
        }
        (None, None) => None,
    };
    Some(format!(
        "{} against {}: {}{}",
        of_runs(row)?,
        of_runs(first)?,
        signed(row.over_first?),
        interval.unwrap_or_default()
    ))
}

#[cfg(test)]
mod tests {
    use super::super::ReportedVersus;
    use super::super::blocks;
    use super::super::test_data::{test_reported, test_results, test_seed_means, test_with_repeats};
    use super::*;
    use crate::report::document::markdown;

    fn top(results: &Results) -> String {
        let text = markdown(&blocks(results));
        text.split_once("\nDevelopment figures, on the splits").map(|(top, _)| top.to_owned()).unwrap()
    }

    #[test]
    fn the_interval_chooses_the_sentence_and_the_figures_stand_beside_it() {
        let mut results = test_results();
        let of = &mut results.side_by_side[0].of;
        of.mean[0].figures[1].runs = vec![Some(0.63), Some(0.65)];
        of.mean[0].figures[1].over_first_seeds_interval = Some([0.01, 0.07]);
        of.missed[0].figures[1].over_first_seeds_interval = Some([-0.13, -0.07]);
        let text = top(&results);
        let sentence = "The camera pays. (both, against LiDAR: mean AP 0.640 (seeds 0.630, 0.650) against 0.600: +0.040, +0.010 to +0.070 over \
                        episodes and seeds; harmful events missed at 10 false alarms/km, %: 20.0 against 30.0: -10.0, -13.0 to -7.0 over \
                        episodes and seeds.) Development figures, split dev.";
        assert!(text.starts_with("## In short\n") && text.contains(sentence), "{text}");
        for (ap, missed, sentence) in [
            (Some([-0.06, -0.02]), Some([-0.1, 0.1]), "The camera does harm. (both"),
            (
                Some([-0.01, 0.06]),
                Some([-0.2, -0.1]),
                "Whether the camera pays is not certain. By missed events alone `both` is surely better. (both",
            ),
            (Some([-0.01, 0.06]), Some([-0.2, 0.1]), "Whether the camera pays is not certain. (both"),
            (None, None, "Whether the camera pays is not certain. (both"),
            (Some([0.01, 0.06]), None, "The camera pays. (both"),
            // What misses surely more is not better, whatever its AP; what misses less is not worse.
            (
                Some([0.01, 0.06]),
                Some([0.01, 0.1]),
                "Whether the camera pays is not certain. By AP `both` is surely better, by missed events surely worse. (both",
            ),
            (
                Some([-0.06, -0.01]),
                Some([-0.1, -0.01]),
                "Whether the camera pays is not certain. By AP `both` is surely worse, by missed events surely better. (both",
            ),
        ] {
            let of = &mut results.side_by_side[0].of;
            of.mean[0].figures[1].over_first_seeds_interval = ap;
            of.missed[0].figures[1].over_first_seeds_interval = missed;
            let text = top(&results);
            assert!(text.contains(sentence), "{ap:?} {missed:?}: {text}");
        }
    }

    #[test]
    fn of_one_training_each_nothing_is_certain() {
        let text = top(&test_results());
        let sentence = "Whether the camera pays is not certain. (both, against LiDAR: mean AP 0.640 against 0.600: +0.040, +0.020 to +0.060 \
                        over episodes; what another seed would change is not known; harmful";
        assert!(text.contains(sentence), "{text}");
    }

    #[test]
    fn what_the_network_that_ships_misses_is_told_of_split_test_once_it_is_known() {
        let results = test_results();
        let sentence =
            "with all false positives but those on ignored ground. Development figures, split dev.";
        assert!(top(&results).contains(sentence), "{}", top(&results));
        let reported = Results { reported: Some(test_reported()), ..results };
        assert!(top(&reported).contains("on ignored ground. Split test."), "{}", top(&reported));
    }

    #[test]
    fn of_several_seeds_the_mean_leads_with_its_intervals() {
        let results = Results {
            reported: Some(test_reported()),
            seed_means: Some(test_seed_means()),
            ..test_with_repeats()
        };
        let text = top(&results);
        let sentence = "In drives with unfamiliar objects 3 trainings of the network that ships miss 55.0 % (51.0–58.0) of the 100 harmful \
                        events at 10 false alarms a kilometre, in the mean of their seeds; they warn in time of 55.0 % (51.0–58.0) of those \
                        that can be stopped for at 8 m/s². Mean AP there is 0.550 (0.510–0.580), of unfamiliar objects 0.550 (0.510–0.580) \
                        with all false positives but those on ignored ground. Split test.";
        assert!(text.contains(sentence), "{text}");
        // Means of other networks, or of one alone, are not its.
        let changes: [fn(&mut SeedMeans); 2] =
            [|of| of.networks.truncate(1), |of| of.networks[0] = "9".repeat(64)];
        for change in changes {
            let mut means = test_seed_means();
            change(&mut means);
            let results = Results { seed_means: Some(means), ..results.clone() };
            assert!(top(&results).contains("the network that ships misses"), "{}", top(&results));
        }
    }

    #[test]
    fn rows_side_by_side_on_split_test_answer_in_place_of_those_to_choose_by() {
        let mut results = test_results();
        let of = &mut results.side_by_side[0];
        let mut reported = ReportedVersus {
            commit: "4567def".into(),
            date: "2026-02-04".into(),
            fingerprint: results.data.ood.fingerprint.clone(),
            of: of.of.clone(),
        };
        reported.of.mean[0].figures[1].over_first_seeds_interval = Some([-0.03, 0.02]);
        of.reported = Some(reported);
        let text = markdown(&blocks(&results));
        assert!(text.contains("is not certain. (both") && text.contains(".) Split test."), "{text}");
        for part in [
            "Split test: commit 4567def, 2026-02-04.",
            "The same on split dev: development figures",
            "below where they are called so",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn without_figures_there_is_nothing_to_say() {
        let bare = Results { headline: None, side_by_side: Vec::new(), ..test_results() };
        assert!(!markdown(&blocks(&bare)).contains("In short"));
    }
}
