//! The worst of a driver's drives.

use super::drive_outcome::DriveOutcome;

/// What went wrong in a drive, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case<'a> {
    /// Place of the drive among the driver's.
    pub idx: usize,
    pub outcome: &'a DriveOutcome,
    /// The object that was hit; `None`: it braked for nothing.
    pub hit: Option<&'a str>,
    pub time_s: f64,
}

/// Of so many cases, one in this many is a false stop, where there are both.
const EACH_STOP: usize = 5;

/// At most so many cases: collisions that `truth` avoids first, the hardest first, then what it does not avoid either, then false
/// stops, the hardest first. `truth` has the same worlds in the same order; `None` where it did not drive, or is the driver.
#[must_use]
pub fn worst<'a>(outcomes: &'a [DriveOutcome], truth: Option<&[DriveOutcome]>, most: usize) -> Vec<Case<'a>> {
    let is_avoidable = |idx: usize| truth.is_none_or(|truth| truth[idx].collision.is_none());
    let mut hits: Vec<(bool, f64, Case<'a>)> = Vec::new();
    let mut stops: Vec<(f64, Case<'a>)> = Vec::new();
    for (idx, outcome) in outcomes.iter().enumerate() {
        if let Some(hit) = &outcome.collision {
            let case = Case { idx, outcome, hit: Some(&hit.object), time_s: hit.time_s };
            hits.push((!is_avoidable(idx), hit.impact_mps, case));
        }
        let falsely = outcome.hard_stops.iter().filter(|stop| stop.is_false);
        if let Some(stop) = falsely.max_by(|a, b| a.braking_mps2.total_cmp(&b.braking_mps2)) {
            stops.push((stop.braking_mps2, Case { idx, outcome, hit: None, time_s: stop.time_s }));
        }
    }
    hits.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
    stops.sort_by(|a, b| b.0.total_cmp(&a.0));
    let n_stops = stops.len().min((most / EACH_STOP).max(most.saturating_sub(hits.len())));
    let hits = hits.into_iter().map(|hit| hit.2).take(most - n_stops);
    hits.chain(stops.into_iter().map(|stop| stop.1).take(n_stops)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::HardStop;
    use super::super::test_data::drives;
    use super::*;

    #[test]
    fn what_truth_avoids_comes_first_and_false_stops_have_their_part() {
        let (_, mut outcomes) = drives("small", [Some(2.0), Some(9.0), Some(5.0), None]);
        let (_, truth) = drives("truth", [None, Some(1.0), None, None]);
        let stop = |braking_mps2, is_false| HardStop { time_s: 1.0, braking_mps2, is_false };
        outcomes[3].hard_stops = vec![stop(8.0, false), stop(4.0, true)];
        let chosen = |truth: Option<&[DriveOutcome]>, most| -> Vec<(usize, bool)> {
            worst(&outcomes, truth, most).iter().map(|case| (case.idx, case.hit.is_some())).collect()
        };
        assert_eq!(chosen(Some(&truth), 9), [(2, true), (0, true), (1, true), (3, false)]);
        assert_eq!(chosen(None, 3), [(1, true), (2, true), (0, true)]);
        // Of five cases one is a false stop; fewer hits leave it its place, too.
        assert_eq!(chosen(None, 5).len(), 4);
        let (_, hits) = drives("small", [Some(2.0); 4]);
        let many: Vec<DriveOutcome> = [hits.clone(), hits, outcomes.clone()].concat();
        let of_five = worst(&many, None, 5);
        assert_eq!(of_five.iter().filter(|case| case.hit.is_none()).count(), 1);
        assert_eq!(chosen(None, 0), []);
    }
}
