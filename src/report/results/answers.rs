//! What an experiment answers, in a sentence each with its figures, for the top of the results.

use serde::{Deserialize, Serialize};

use super::{Results, SideBySide};
use crate::eval::ClassScores;
use crate::eval::safety::Alarms;
use crate::eval::versus::{VersusFigure, VersusLine};
use crate::report::document::Block;
use crate::report::missed;
use crate::report::table::{ap, number, percent};

/// A question put to a side-by-side: does a row do better than the first one? By mean AP on all of the samples; the
/// sentence that its interval bears out stands at the top of the results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuestionConfig {
    /// Label of the row.
    pub row: String,
    /// Where its mean AP is surely higher.
    pub better: String,
    /// Where it is surely lower.
    pub worse: String,
    /// Where the interval of the difference holds zero, or there is none.
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

/// What the network that ships misses, on split test where that is known.
fn headline(results: &Results) -> Option<String> {
    let reported = results.reported.as_ref().and_then(|record| record.groups.first());
    let (alarms, total, split): (Option<&Alarms>, ClassScores, &str) = match (reported, &results.headline) {
        (Some(towns), _) => (towns.ood.missed.as_ref(), towns.ood.scores.total, "test"),
        (None, Some(record)) => (record.missed.ood.as_ref(), record.ood.total, "dev"),
        (None, None) => return None,
    };
    let point = missed::middle(alarms?)?;
    let within = |of: Option<[f64; 2]>| {
        of.map_or_else(String::new, |ends| {
            format!(" ({})", ends.map(|end| number(Some(100.0 * end), 1)).join("–"))
        })
    };
    let warned = point.warned.last().map_or_else(String::new, |of| {
        format!(
            ", and warns in time of {}{} of those that can be stopped for at {} m/s²",
            percent(of.in_time),
            within(of.in_time_interval),
            of.deceleration_mps2
        )
    });
    Some(format!(
        "The network that ships misses {}{} of the harmful events among unfamiliar objects at {} false alarms a kilometre{warned}; \
         its mean AP there is {} (split {split}).",
        percent(point.missed_per_event),
        within(point.missed_per_event_interval),
        point.max_false_alarms_per_km,
        ap(total.mean),
    ))
}

/// By split test where it is known. `None` where the row is not there, or no figure of it.
fn answer(of: &SideBySide, question: &QuestionConfig) -> Option<String> {
    let (versus, split) = of.reported.as_ref().map_or((&of.of, "dev"), |reported| (reported, "test"));
    let place = of.labels.iter().position(|label| *label == question.row)?;
    let (first, mean) = (of.labels.first()?, versus.mean.first()?);
    let sentence = match mean.figures.get(place)?.over_first_interval {
        Some([low, _]) if low > 0.0 => &question.better,
        Some([_, high]) if high < 0.0 => &question.worse,
        _ => &question.level,
    };
    let share = |value: f64| number(Some(100.0 * value), 1);
    let aps = compared(mean, place, &|value| ap(Some(value)))?;
    let missed = versus.missed.get(versus.missed.len() / 2);
    let missed = missed.and_then(|line| {
        Some(format!("; harmful events missed {}, %: {}", line.name, compared(line, place, &share)?))
    });
    Some(format!(
        "{sentence} ({}, against {first}: mean AP {aps}{}; split {split}.)",
        question.row,
        missed.unwrap_or_default()
    ))
}

/// A row's figure and the first one's, and their difference with its interval.
fn compared(line: &VersusLine, place: usize, show: &dyn Fn(f64) -> String) -> Option<String> {
    let (VersusFigure { value: Some(value), over_first, over_first_interval, .. }, first) =
        (line.figures.get(place)?, line.figures.first()?.value?)
    else {
        return None;
    };
    let signed = |of: f64| if of < 0.0 { show(of) } else { format!("+{}", show(of)) };
    let difference = over_first.map(signed).unwrap_or_default();
    let interval = over_first_interval.map(|ends| format!(", {}", ends.map(signed).join(" to ")));
    Some(format!("{} against {}: {difference}{}", show(*value), show(first), interval.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::super::blocks;
    use super::super::test_data::{test_reported, test_results};
    use super::*;
    use crate::report::document::markdown;

    fn top(results: &Results) -> String {
        let text = markdown(&blocks(results));
        text.split_once("Development figures").map(|(top, _)| top.to_owned()).unwrap()
    }

    #[test]
    fn the_interval_chooses_the_sentence_and_the_figures_stand_beside_it() {
        let mut results = test_results();
        let text = top(&results);
        let sentence = "The camera pays. (both, against LiDAR: mean AP 0.640 against 0.600: +0.040, +0.020 to +0.060; harmful events \
                        missed at 10 false alarms/km, %: 20.0 against 30.0: -10.0, -12.0 to -8.0; split dev.)";
        assert!(text.starts_with("## In short\n") && text.contains(sentence), "{text}");
        for (interval, sentence) in [
            (Some([-0.06, -0.02]), "The camera does harm. (both"),
            (Some([-0.01, 0.06]), "Whether the camera pays is not certain. (both"),
            (None, "Whether the camera pays is not certain. (both"),
        ] {
            results.side_by_side[0].of.mean[0].figures[1].over_first_interval = interval;
            let text = top(&results);
            assert!(text.contains(sentence), "{interval:?}: {text}");
        }
    }

    #[test]
    fn what_the_network_that_ships_misses_is_told_of_split_test_once_it_is_known() {
        let results = test_results();
        assert!(top(&results).contains("(split dev)"), "{}", top(&results));
        let reported = Results { reported: Some(test_reported()), ..results };
        assert!(markdown(&blocks(&reported)).contains("(split test)"));
    }

    #[test]
    fn rows_side_by_side_on_split_test_answer_in_place_of_those_to_choose_by() {
        let mut results = test_results();
        let of = &mut results.side_by_side[0];
        let mut reported = of.of.clone();
        reported.mean[0].figures[1].over_first_interval = Some([-0.03, 0.02]);
        of.reported = Some(reported);
        let text = markdown(&blocks(&results));
        assert!(text.contains("is not certain. (both") && text.contains("; split test.)"), "{text}");
        assert!(text.contains("The same on split dev: development figures"), "{text}");
    }

    #[test]
    fn without_figures_there_is_nothing_to_say() {
        let bare = Results { headline: None, side_by_side: Vec::new(), ..test_results() };
        assert!(!markdown(&blocks(&bare)).contains("In short"));
    }
}
