//! What towns that a network never saw cost it, with intervals.

use super::seeds::SeedMean;
use crate::eval::versus::{Versus, VersusLine};
use crate::report::table::{Cell, Table, number};

/// Where the figures are of.
pub(super) const HEAD: [&str; 3] =
    ["towns of training, splits val and dev (development figures)", "unseen towns, split test", "difference"];

/// An estimate and its interval.
type Estimate = (f64, Option<[f64; 2]>);

/// Missed and warned events and mean AP in the towns of training and in others.
pub(super) fn table(seen: &SeedMean, unseen: &SeedMean) -> Table {
    let sets = [("ID", &seen.id, &unseen.id), ("OOD, other unfamiliar objects", &seen.ood, &unseen.ood)];
    let rows = sets.into_iter().flat_map(|(name, seen, unseen)| {
        let of = [
            ("harmful events missed, %", 100.0, 1, missed as Pick),
            ("harmful events warned of in time, %", 100.0, 1, warned),
            ("mean AP", 1.0, 3, mean),
        ];
        of.into_iter().filter_map(move |(what, factor, digits, pick)| {
            let (at, seen) = estimate(pick(seen)?)?;
            // Where none can be stopped for at the hardest braking, the line is of another one.
            let (_, unseen) = estimate(pick(unseen)?).filter(|(name, _)| *name == at)?;
            let what = if at == TOTAL { what.to_owned() } else { format!("{what}, {at}") };
            let cells = [seen, unseen, difference(unseen, seen)];
            let cells = cells.map(|of| cell(of, &|value| number(Some(factor * value), digits)));
            Some([format!("{name}: {what}").into()].into_iter().chain(cells).collect())
        })
    });
    let head = ["mean of the seeds"].into_iter().chain(HEAD);
    Table::new(head, rows.collect()).with_note(format!(
        "Intervals of {} % by a bootstrap over the episodes; that of a difference between two sets of other episodes is made of both \
         (MOVER, Zou and Donner 2008). Choices were made on val and dev, so the difference also holds what choosing flatters.",
        100.0 * unseen.id.level
    ))
}

/// Chooses a line.
type Pick = fn(&Versus) -> Option<&VersusLine>;

const TOTAL: &str = "total";

fn missed(of: &Versus) -> Option<&VersusLine> {
    of.missed.get(of.missed.len() / 2)
}

/// By the hardest braking, at as many false alarms as [`missed`].
fn warned(of: &Versus) -> Option<&VersusLine> {
    let at = &missed(of)?.name;
    of.warned.iter().rfind(|line| line.name.starts_with(&format!("{at}, ")))
}

fn mean(of: &Versus) -> Option<&VersusLine> {
    of.mean.iter().find(|line| line.name == TOTAL)
}

fn estimate(line: &VersusLine) -> Option<(&str, Estimate)> {
    let figure = line.figures.first()?;
    Some((&line.name, (figure.value?, figure.interval)))
}

/// Of estimates from different episodes, by the method of variance estimates recovery: each side of the interval is the root of the
/// summed squares of the two distances that widen it.
fn difference((one, of_one): Estimate, (other, of_other): Estimate) -> Estimate {
    let interval = of_one.zip(of_other).map(|([low, high], [other_low, other_high])| {
        let difference = one - other;
        [
            difference - (one - low).hypot(other_high - other),
            difference + (high - one).hypot(other - other_low),
        ]
    });
    (one - other, interval)
}

fn cell((value, interval): Estimate, show: &dyn Fn(f64) -> String) -> Cell {
    let below = interval.map(|[low, high]| {
        let joint = if low < 0.0 { " to " } else { "–" };
        format!("{}{joint}{}", show(low), show(high))
    });
    Cell { text: show(value), below: below.into_iter().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_wider_than_either_estimate_and_keeps_its_sides() {
        let (value, interval) = difference((0.60, Some([0.56, 0.63])), (0.70, Some([0.66, 0.73])));
        assert!((value + 0.1).abs() < 1e-12);
        let [low, high] = interval.unwrap();
        // Both fall short by up to .04 below, and by .03 above: .05 on either side.
        assert!((low + 0.15).abs() < 1e-12 && (high + 0.05).abs() < 1e-12, "{low} {high}");
        assert_eq!(difference((0.6, None), (0.7, Some([0.6, 0.8]))).1, None);
    }
}
