//! Junctions by reservation: who may drive in, so that paths that cross are never driven at once.

use super::network::LaneGraph;
use super::route::{Route, Span};

/// Lanes of junctions that are taken: by which driver.
#[derive(Debug, Clone, Default)]
pub struct Reservations {
    held: Vec<(usize, usize)>,
}

/// The next junction on a route.
#[derive(Debug, Clone)]
pub struct Crossing {
    pub lanes: Vec<usize>,
    pub entry_m: f64,
    pub exit_m: f64,
}

/// The first junction that is not left at `rear_m`.
#[must_use]
pub fn next_crossing(graph: &LaneGraph, route: &Route, rear_m: f64) -> Option<Crossing> {
    let junction_of = |span: &Span| graph.lanes[span.lane].junction;
    let mut spans = route.spans_from(rear_m).skip_while(|span| junction_of(span).is_none()).peekable();
    let first = *spans.peek()?;
    let run: Vec<&Span> = spans.take_while(|span| junction_of(span) == junction_of(first)).collect();
    Some(Crossing {
        lanes: run.iter().map(|span| span.lane).collect(),
        entry_m: first.start_m,
        exit_m: run[run.len() - 1].end_m,
    })
}

impl Reservations {
    /// Frees the lanes that a driver holds and no longer needs.
    pub fn keep_only(&mut self, driver: usize, lanes: &[usize]) {
        self.held.retain(|(holder, lane)| *holder != driver || lanes.contains(lane));
    }

    #[must_use]
    pub fn holds(&self, driver: usize, lanes: &[usize]) -> bool {
        lanes.iter().all(|lane| self.held.contains(&(driver, *lane)))
    }

    /// Takes the lanes if nobody else holds one that conflicts.
    pub fn try_take(&mut self, graph: &LaneGraph, driver: usize, lanes: &[usize]) -> bool {
        let is_blocked = self.held.iter().any(|(holder, held)| {
            *holder != driver && lanes.iter().any(|&lane| graph.lanes[lane].conflicts.contains(held))
        });
        if !is_blocked {
            self.take(driver, lanes);
        }
        !is_blocked
    }

    /// Takes the lanes for one who is already inside.
    pub fn take(&mut self, driver: usize, lanes: &[usize]) {
        for &lane in lanes {
            if !self.held.contains(&(driver, lane)) {
                self.held.push((driver, lane));
            }
        }
    }
}
