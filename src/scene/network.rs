//! The lane graph: driving lanes as polylines in travel direction, with successors and limits.
//!
//! Lanes are addressed on the plane; heights are the ground's. Every lane that can be driven is kept;
//! [`GraphLane::reach_m`] says which lead on for ever and which end somewhere. A lane end
//! without a link that meets the start of a lane without one is joined to it.

use std::collections::{BTreeMap, BTreeSet};

use super::path::{Path, Vec2};

/// Speed limit where the map gives none: 50 km/h, the usual one in towns.
const DEFAULT_LIMIT_MPS: f64 = 50.0 / 3.6;
/// Lanes of a junction conflict where their centre lines come closer than a car and some room.
const CONFLICT_M: f64 = 2.6;
/// The end of one lane and the start of another are the same place if closer than this.
const JOIN_M: f64 = 0.3;
/// Nobody in the simulation drives faster, whatever a map allows.
const MAX_LIMIT_MPS: f64 = 80.0 / 3.6;

/// One driving lane.
#[derive(Debug, Clone)]
pub struct GraphLane {
    pub path: Path,
    pub width_m: f64,
    pub limit_mps: f64,
    pub successors: Vec<usize>,
    pub predecessors: Vec<usize>,
    /// Neighbours that run the same way, and may be changed to.
    pub left: Option<usize>,
    pub right: Option<usize>,
    /// The longest way from its start; infinite where it leads into a loop.
    pub reach_m: f64,
    /// How much right of way it has at its end, against others of the same junction.
    pub rank: Rank,
    /// Number of the junction that the lane crosses.
    pub junction: Option<usize>,
    /// Lanes of the same junction that cannot be driven at the same time.
    pub conflicts: Vec<usize>,
}

impl GraphLane {
    /// A lane that is linked to nothing, as wide and fast as usual.
    pub fn new(path: Path) -> Self {
        Self {
            path,
            width_m: 3.5,
            limit_mps: DEFAULT_LIMIT_MPS,
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: None,
            right: None,
            reach_m: f64::INFINITY,
            rank: Rank::Equal,
            junction: None,
            conflicts: Vec::new(),
        }
    }
}

/// Right of way of a lane through a junction, lowest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Rank {
    /// Must stop, then yield.
    Stops,
    Yields,
    /// First come, first served.
    #[default]
    Equal,
    HasPriority,
}

/// All driving lanes of a town.
#[derive(Debug, Clone, Default)]
pub struct LaneGraph {
    pub lanes: Vec<GraphLane>,
    /// Whether traffic keeps to the left.
    pub keeps_left: bool,
    /// Lane of the graph by the map's number.
    pub(super) index_of: BTreeMap<usize, usize>,
}

/// A point of the map on the ground plane.
pub(super) fn flat(point: xodr::Point) -> Vec2 {
    Vec2::new(f64::from(point.x), f64::from(point.y))
}

impl LaneGraph {
    /// Builds the graph from a road network, without the lanes that `is_left_out` names; also reports
    /// which parts of the network are not driven.
    pub fn read(
        network: &xodr::RoadNetwork,
        is_left_out: impl Fn(xodr::LaneId) -> bool,
    ) -> (Self, Vec<String>) {
        let mut graph = Self::default();
        let mut junctions: BTreeMap<String, usize> = BTreeMap::new();
        let (mut ids, mut n_left, mut n_right) = (Vec::new(), 0, 0);
        let usable = |lane: &&xodr::Lane| {
            lane.kind.is_drivable() && lane.layer == xodr::Layer::Permanent && !is_left_out(lane.id)
        };
        for lane in network.lanes().iter().filter(usable) {
            let mut points: Vec<Vec2> = lane.center.points().iter().map(|&point| flat(point)).collect();
            let is_backward = lane.direction == xodr::Direction::Backward;
            if is_backward {
                points.reverse();
            }
            let Some(path) = Path::new(points) else { continue };
            let limit_mps = match network.speed_limit_at(lane.id, lane.center.length() / 2.0) {
                Some(xodr::SpeedLimit::Max(limit)) if limit > 1.0 => f64::from(limit).min(MAX_LIMIT_MPS),
                _ => DEFAULT_LIMIT_MPS,
            };
            let at = network.road_lane(lane.id);
            // With traffic on the right, lanes of negative number run along their road.
            match at.map(|at| (at.od_id < 0) == is_backward) {
                Some(true) => n_left += 1,
                _ => n_right += 1,
            }
            let n_junctions = junctions.len();
            let junction = at
                .and_then(|at| network.road(at.road))
                .and_then(xodr::Road::junction)
                .map(|id| *junctions.entry(id.to_owned()).or_insert(n_junctions));
            graph.index_of.insert(lane.id.0, graph.lanes.len());
            ids.push(lane.id);
            graph.lanes.push(GraphLane {
                width_m: f64::from(lane.width),
                limit_mps,
                junction,
                ..GraphLane::new(path)
            });
        }
        graph.keeps_left = n_left > n_right;
        for (i, &id) in ids.iter().enumerate() {
            let mut next: Vec<usize> =
                network.successors(id).filter_map(|lane| graph.find(lane.id)).collect();
            next.dedup();
            graph.lanes[i].successors = next;
            let neighbours = network.lane(id).map(|lane| lane.neighbors.clone()).unwrap_or_default();
            for other in neighbours {
                if let Some(other) = graph.find(other) {
                    graph.set_beside(i, other);
                }
            }
        }
        let mut notes = Vec::new();
        let mut note = |n: usize, text: &str| {
            if n > 0 {
                notes.push(format!("{n} {text}"));
            }
        };
        note(graph.drop_broken_links(), "links between lanes that do not meet are not driven");
        note(graph.join_ends(), "lanes without a link are joined to the lane that begins where they end");
        graph.link_back();
        graph.measure_reach();
        let ends = graph.lanes.iter().filter(|lane| lane.successors.is_empty()).count();
        note(ends, "driving lanes lead nowhere: traffic ends there");
        graph.find_conflicts();
        graph.rank_by_priority(network, &ids);
        (graph, notes)
    }

    /// The graph's lane for a lane of the map.
    pub fn find(&self, id: xodr::LaneId) -> Option<usize> {
        self.index_of.get(&id.0).copied()
    }

    /// Sign of an offset towards the kerb's side, seen along the way: -1 where traffic keeps right.
    pub fn kerb_sign(&self) -> f64 {
        if self.keeps_left { 1.0 } else { -1.0 }
    }

    fn set_beside(&mut self, lane: usize, other: usize) {
        let middle_m = self.lanes[lane].path.length_m() / 2.0;
        let path = &self.lanes[other].path;
        let (station_m, _) = path.project(self.lanes[lane].path.at(middle_m), 0.0, path.length_m());
        let offset = path.at(station_m) - self.lanes[lane].path.at(middle_m);
        let is_left = self.lanes[lane].path.direction(middle_m).perp(&offset) > 0.0;
        let side = if is_left { &mut self.lanes[lane].left } else { &mut self.lanes[lane].right };
        *side = Some(other);
    }

    /// A successor that does not begin where the lane ends would make cars jump; returns how many did.
    fn drop_broken_links(&mut self) -> usize {
        let starts: Vec<Vec2> = self.lanes.iter().map(|lane| lane.path.at(0.0)).collect();
        let mut n_dropped = 0;
        for lane in &mut self.lanes {
            let end = lane.path.at(lane.path.length_m());
            let n_before = lane.successors.len();
            lane.successors.retain(|&next| (starts[next] - end).norm() < 1.5);
            n_dropped += n_before - lane.successors.len();
        }
        n_dropped
    }

    /// Links ends to starts that meet in place and heading where the map links neither.
    fn join_ends(&mut self) -> usize {
        let is_entered: BTreeSet<usize> =
            self.lanes.iter().flat_map(|lane| lane.successors.clone()).collect();
        let mut n_joined = 0;
        for i in 0..self.lanes.len() {
            if !self.lanes[i].successors.is_empty() {
                continue;
            }
            let (path, length_m) = (&self.lanes[i].path, self.lanes[i].path.length_m());
            let (end, direction) = (path.at(length_m), path.direction(length_m));
            let next = (0..self.lanes.len()).find(|next| {
                let other = &self.lanes[*next].path;
                let meets =
                    (other.at(0.0) - end).norm() < JOIN_M && other.direction(0.0).dot(&direction) > 0.9;
                meets && !is_entered.contains(next)
            });
            if let Some(next) = next {
                self.lanes[i].successors.push(next);
                n_joined += 1;
            }
        }
        n_joined
    }

    /// Fills [`GraphLane::reach_m`]: the lanes left after all dead ends are removed, one after the other,
    /// lead on for ever.
    fn measure_reach(&mut self) {
        for lane in &mut self.lanes {
            lane.reach_m = f64::INFINITY;
        }
        let mut is_open: Vec<usize> = self.lanes.iter().map(|lane| lane.successors.len()).collect();
        let mut dead: Vec<usize> = (0..self.lanes.len()).filter(|&i| is_open[i] == 0).collect();
        while let Some(i) = dead.pop() {
            let beyond_m =
                self.lanes[i].successors.iter().map(|&next| self.lanes[next].reach_m).fold(0.0, f64::max);
            self.lanes[i].reach_m = self.lanes[i].path.length_m() + beyond_m;
            for before in self.lanes[i].predecessors.clone() {
                is_open[before] -= 1;
                if is_open[before] == 0 {
                    dead.push(before);
                }
            }
        }
    }

    fn link_back(&mut self) {
        for i in 0..self.lanes.len() {
            for next in self.lanes[i].successors.clone() {
                self.lanes[next].predecessors.push(i);
            }
        }
    }

    /// Right of way from `<priority>` of junctions: a lane that yields to nobody has priority over those
    /// that yield to it.
    fn rank_by_priority(&mut self, network: &xodr::RoadNetwork, ids: &[xodr::LaneId]) {
        let road_of = |i: usize| network.road_lane(ids[i]).map(|at| at.road);
        let (high, low): (BTreeSet<usize>, BTreeSet<usize>) =
            network.priorities().iter().map(|priority| (priority.high.0, priority.low.0)).unzip();
        for i in 0..self.lanes.len() {
            let Some(road) = road_of(i) else { continue };
            self.lanes[i].rank = match (high.contains(&road.0), low.contains(&road.0)) {
                (true, false) => Rank::HasPriority,
                (false, true) => Rank::Yields,
                _ => Rank::Equal,
            };
        }
    }

    fn find_conflicts(&mut self) {
        let sampled: Vec<Vec<Vec2>> = self.lanes.iter().map(|lane| lane.path.points_every(1.0)).collect();
        for a in 0..self.lanes.len() {
            for b in a + 1..self.lanes.len() {
                let (lane_a, lane_b) = (&self.lanes[a], &self.lanes[b]);
                let same_junction = lane_a.junction.is_some() && lane_a.junction == lane_b.junction;
                let same_origin = lane_a.predecessors.iter().any(|i| lane_b.predecessors.contains(i));
                if !same_junction || same_origin {
                    continue;
                }
                let is_near = |p: &Vec2| sampled[b].iter().any(|q| (p - q).norm() < CONFLICT_M);
                if sampled[a].iter().any(is_near) {
                    self.lanes[a].conflicts.push(b);
                    self.lanes[b].conflicts.push(a);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lane(from: (f64, f64), to: (f64, f64), successors: Vec<usize>) -> GraphLane {
        let path = Path::new([Vec2::new(from.0, from.1), Vec2::new(to.0, to.1)]).unwrap();
        GraphLane { successors, junction: Some(0), ..GraphLane::new(path) }
    }

    #[test]
    fn only_a_loop_leads_on_for_ever() {
        let square = [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)];
        let mut lanes: Vec<GraphLane> =
            (0..4).map(|i| lane(square[i], square[(i + 1) % 4], vec![(i + 1) % 4])).collect();
        lanes.push(lane((9.0, 0.0), (30.0, 0.0), vec![5]));
        lanes.push(lane((30.0, 0.0), (35.0, 0.0), vec![]));
        lanes[0].successors.push(4);
        let mut graph = LaneGraph { lanes, ..LaneGraph::default() };
        graph.link_back();
        graph.measure_reach();
        let reach: Vec<f64> = graph.lanes.iter().map(|lane| lane.reach_m).collect();
        assert!(reach[..4].iter().all(|reach_m| reach_m.is_infinite()));
        assert_eq!(reach[4..], [26.0, 5.0]);
    }

    #[test]
    fn an_end_is_joined_to_the_start_it_meets_and_not_to_a_corner() {
        let mut lanes = vec![
            lane((0.0, 0.0), (20.0, 0.0), vec![]),
            lane((20.1, 0.0), (40.0, 0.0), vec![]),
            lane((40.0, 0.0), (40.0, 20.0), vec![]),
        ];
        lanes[2].junction = None;
        let mut graph = LaneGraph { lanes, ..LaneGraph::default() };
        assert_eq!(graph.join_ends(), 1);
        assert_eq!(graph.lanes[0].successors, [1]);
        assert!(graph.lanes[1].successors.is_empty());
    }

    #[test]
    fn crossing_lanes_of_a_junction_conflict_and_parallel_ones_do_not() {
        let lanes = vec![
            lane((0.0, 0.0), (20.0, 0.0), vec![]),
            lane((10.0, -9.0), (10.0, 9.0), vec![]),
            lane((20.0, 3.5), (0.0, 3.5), vec![]),
        ];
        let mut graph = LaneGraph { lanes, ..LaneGraph::default() };
        graph.find_conflicts();
        assert_eq!(graph.lanes[0].conflicts, [1]);
        assert_eq!(graph.lanes[1].conflicts, [0, 2]);
    }
}
