//! The worst of a driver's drives.

use super::drive_outcome::{DriveOutcome, End};

/// What went wrong in a drive, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case<'a> {
    /// Place of the drive among the driver's.
    pub idx: usize,
    pub outcome: &'a DriveOutcome,
    pub what: Wrong<'a>,
    pub time_s: f64,
}

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrong<'a> {
    /// It hit the object of this id.
    Hit(&'a str),
    /// It braked hard for nothing.
    FalseStop,
    /// It stood before nothing until the end.
    Stuck,
}

impl<'a> Wrong<'a> {
    /// The object that was hit.
    #[must_use]
    pub const fn hit(self) -> Option<&'a str> {
        if let Self::Hit(id) = self { Some(id) } else { None }
    }
}

/// Of so many cases, one in this many is a false stop and another one a drive that ended stuck, where there are such.
const EACH: usize = 5;

/// At most so many cases: collisions that `truth` avoids first, the hardest first, then what it does not avoid either; then false
/// stops, the hardest first, then drives that ended stuck, those that came least far first. `truth` has the same worlds in the same
/// order; `None` where it did not drive, or is the driver. What failed counts for nobody.
#[must_use]
pub fn worst<'a>(outcomes: &'a [DriveOutcome], truth: Option<&[DriveOutcome]>, most: usize) -> Vec<Case<'a>> {
    let avoids = |truth: &DriveOutcome| !truth.is_failed() && truth.collision.is_none();
    let is_avoidable = |idx: usize| truth.is_none_or(|truth| avoids(&truth[idx]));
    let (mut hits, mut stops, mut stuck) = (Vec::new(), Vec::new(), Vec::new());
    for (idx, outcome) in outcomes.iter().enumerate().filter(|(_, outcome)| !outcome.is_failed()) {
        let case = |what, time_s| Case { idx, outcome, what, time_s };
        if let Some(hit) = &outcome.collision {
            hits.push((!is_avoidable(idx), hit.impact_mps, case(Wrong::Hit(&hit.object), hit.time_s)));
        }
        let falsely = outcome.hard_stops.iter().filter(|stop| stop.is_false);
        if let Some(stop) = falsely.max_by(|a, b| a.braking_mps2.total_cmp(&b.braking_mps2)) {
            stops.push((stop.braking_mps2, case(Wrong::FalseStop, stop.time_s)));
        }
        if outcome.end == End::Stuck {
            stuck.push(case(Wrong::Stuck, outcome.duration_s));
        }
    }
    hits.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
    stops.sort_by(|a, b| b.0.total_cmp(&a.0));
    let share = |case: &Case<'_>| case.outcome.distance_m / case.outcome.free_m.max(1.0);
    stuck.sort_by(|a, b| share(a).total_cmp(&share(b)));
    let mut left = most;
    let mut take = |wanted: usize| {
        let n_taken = wanted.min(left);
        left -= n_taken;
        n_taken
    };
    let part = most / EACH;
    let (mut n_stops, mut n_stuck) = (take(stops.len().min(part)), take(stuck.len().min(part)));
    let n_hits = take(hits.len());
    n_stops += take(stops.len() - n_stops);
    n_stuck += take(stuck.len() - n_stuck);
    let hits = hits.into_iter().map(|hit| hit.2).take(n_hits);
    let stops = stops.into_iter().map(|stop| stop.1).take(n_stops);
    hits.chain(stops).chain(stuck.into_iter().take(n_stuck)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::HardStop;
    use super::super::test_data::drives;
    use super::*;

    #[test]
    fn what_truth_avoids_comes_first_and_false_stops_and_stuck_drives_have_their_part() {
        let (_, mut outcomes) = drives("small", [Some(2.0), Some(9.0), Some(5.0), None]);
        let (_, truth) = drives("truth", [None, Some(1.0), None, None]);
        let stop = |braking_mps2, is_false| HardStop { time_s: 1.0, braking_mps2, is_false };
        outcomes[3].hard_stops = vec![stop(8.0, false), stop(4.0, true)];
        outcomes[3].end = End::Stuck;
        let chosen = |truth: Option<&[DriveOutcome]>, most| -> Vec<(usize, char)> {
            let kind = |what| match what {
                Wrong::Hit(_) => 'h',
                Wrong::FalseStop => 'f',
                Wrong::Stuck => 's',
            };
            worst(&outcomes, truth, most).iter().map(|case| (case.idx, kind(case.what))).collect()
        };
        assert_eq!(chosen(Some(&truth), 9), [(2, 'h'), (0, 'h'), (1, 'h'), (3, 'f'), (3, 's')]);
        assert_eq!(chosen(None, 3), [(1, 'h'), (2, 'h'), (0, 'h')]);
        assert_eq!(chosen(None, 4), [(1, 'h'), (2, 'h'), (0, 'h'), (3, 'f')]);
        assert_eq!(chosen(None, 0), []);
        // What failed is nobody's case, and says nothing of what can be avoided.
        let mut failing = truth.clone();
        failing[2].end = End::Failed("it died".to_owned());
        assert_eq!(chosen(Some(&failing), 3), [(0, 'h'), (1, 'h'), (2, 'h')]);
        let mut failed = outcomes.clone();
        for outcome in &mut failed {
            outcome.end = End::Failed("it died".to_owned());
        }
        assert_eq!(worst(&failed, None, 9).len(), 0);
        // Of five cases one is a false stop and one a stuck drive, however many are hit.
        let (_, hits) = drives("small", [Some(2.0); 4]);
        let many: Vec<DriveOutcome> = [hits.clone(), hits, outcomes.clone()].concat();
        let of_five: Vec<bool> = worst(&many, None, 5).iter().map(|case| case.what.hit().is_some()).collect();
        assert_eq!(of_five, [true, true, true, false, false]);
    }
}
