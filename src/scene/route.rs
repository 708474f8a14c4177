//! A drive through the lane graph: lanes one after another as a single path.

use rand::RngExt;

use super::network::LaneGraph;
use super::path::Path;
use crate::random::Rng;

/// One lane of a route and where on the route it lies.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    pub lane: usize,
    pub start_m: f64,
    pub end_m: f64,
}

/// Lanes driven in order.
#[derive(Debug, Clone)]
pub struct Route {
    pub path: Path,
    pub spans: Vec<Span>,
}

impl Route {
    /// Starts on a lane and takes random turns until the route is `length_m` long or ends.
    ///
    /// Turns that lead on for ever are taken before those that end somewhere, and of these the longer.
    pub fn random(graph: &LaneGraph, lane: usize, length_m: f64, rng: &mut Rng) -> Self {
        let path = graph.lanes[lane].path.clone();
        let spans = vec![Span { lane, start_m: 0.0, end_m: path.length_m() }];
        let mut route = Self { path, spans };
        route.extend(graph, length_m, rng);
        route
    }

    /// Continues by random turns until the route is `length_m` long or ends.
    pub fn extend(&mut self, graph: &LaneGraph, length_m: f64, rng: &mut Rng) {
        while self.path.length_m() < length_m {
            let last = self.spans[self.spans.len() - 1].lane;
            let successors = &graph.lanes[last].successors;
            let longest_m = successors.iter().map(|&next| graph.lanes[next].reach_m).fold(0.0, f64::max);
            let choices: Vec<usize> = successors
                .iter()
                .copied()
                .filter(|&next| graph.lanes[next].reach_m >= 0.5 * longest_m)
                .collect();
            if choices.is_empty() {
                break;
            }
            self.push(graph, choices[rng.random_range(0..choices.len())]);
        }
    }

    fn push(&mut self, graph: &LaneGraph, lane: usize) {
        let start_m = self.path.length_m();
        self.path.extend(graph.lanes[lane].path.points().iter().copied());
        self.spans.push(Span { lane, start_m, end_m: self.path.length_m() });
    }

    /// Draws the turns after `from_m` anew, from the next junction on.
    pub fn turn_elsewhere(&mut self, graph: &LaneGraph, from_m: f64, rng: &mut Rng) {
        let length_m = self.path.length_m();
        let kept = self.spans.iter().position(|span| span.end_m > from_m).unwrap_or(0);
        let lanes: Vec<usize> = self.spans[..=kept].iter().map(|span| span.lane).collect();
        let mut route = Self::random(graph, lanes[0], 0.0, rng);
        lanes[1..].iter().for_each(|&lane| route.push(graph, lane));
        let last = lanes[lanes.len() - 1];
        let tail = Self::random(graph, last, length_m - route.spans[kept].start_m, rng);
        tail.spans[1..].iter().for_each(|span| route.push(graph, span.lane));
        *self = route;
    }

    /// The span at a station; the last one beyond the end.
    pub fn span_at(&self, s_m: f64) -> Span {
        *self.spans.iter().find(|span| span.end_m > s_m).unwrap_or(&self.spans[self.spans.len() - 1])
    }

    /// Spans that end after `from_m`, in order.
    pub fn spans_from(&self, from_m: f64) -> impl Iterator<Item = &Span> {
        let first = self.spans.partition_point(|span| span.end_m <= from_m);
        self.spans[first..].iter()
    }
}
