//! The lane graph: driving lanes as polylines in travel direction, with successors and limits.
//!
//! Lanes that lead only into dead ends are left out, so that following successors never ends,
//! as long as the map has a single loop; a map without one keeps all its lanes. Towns are taken as
//! flat: heights are dropped.

use std::collections::BTreeMap;

use super::path::{Path, Vec2};

/// Speed limit where the map gives none: 50 km/h, the usual one in towns.
const DEFAULT_LIMIT_MPS: f64 = 50.0 / 3.6;
/// Lanes of a junction conflict where their centre lines come closer than a car and some room.
const CONFLICT_M: f64 = 2.6;
/// The highest speed the simulation drives at, whatever a map allows.
const MAX_LIMIT_MPS: f64 = 20.0;

/// One driving lane.
#[derive(Debug, Clone)]
pub struct GraphLane {
    pub path: Path,
    pub width_m: f64,
    pub limit_mps: f64,
    pub successors: Vec<usize>,
    pub predecessors: Vec<usize>,
    /// Number of the junction that the lane crosses.
    pub junction: Option<usize>,
    /// Lanes of the same junction that cannot be driven at the same time.
    pub conflicts: Vec<usize>,
}

/// All driving lanes of a town.
#[derive(Debug, Clone)]
pub struct LaneGraph {
    pub lanes: Vec<GraphLane>,
}

/// A point of the map on the ground plane.
pub(super) fn flat(point: xodr::Point) -> Vec2 {
    Vec2::new(f64::from(point.x), f64::from(point.y))
}

impl LaneGraph {
    /// Builds the graph from a road network.
    #[must_use]
    pub fn new(network: &xodr::RoadNetwork) -> Self {
        let mut junctions: BTreeMap<String, usize> = BTreeMap::new();
        let mut index_of: BTreeMap<usize, usize> = BTreeMap::new();
        let mut lanes = Vec::new();
        let usable = |lane: &&xodr::Lane| lane.kind.is_drivable() && lane.layer == xodr::Layer::Permanent;
        for lane in network.lanes().iter().filter(usable) {
            let mut points: Vec<Vec2> = lane.center.points().iter().map(|&point| flat(point)).collect();
            if lane.direction == xodr::Direction::Backward {
                points.reverse();
            }
            let Some(path) = Path::new(points) else { continue };
            let limit_mps = match network.speed_limit_at(lane.id, lane.center.length() / 2.0) {
                Some(xodr::SpeedLimit::Max(limit)) if limit > 1.0 => f64::from(limit).min(MAX_LIMIT_MPS),
                _ => DEFAULT_LIMIT_MPS,
            };
            let road = network.road_lane(lane.id).and_then(|at| network.road(at.road));
            let n_junctions = junctions.len();
            let junction = road
                .and_then(xodr::Road::junction)
                .map(|id| *junctions.entry(id.to_owned()).or_insert(n_junctions));
            index_of.insert(lane.id.0, lanes.len());
            let width_m = f64::from(lane.width);
            lanes.push((
                lane.id,
                GraphLane {
                    path,
                    width_m,
                    limit_mps,
                    successors: Vec::new(),
                    predecessors: Vec::new(),
                    junction,
                    conflicts: Vec::new(),
                },
            ));
        }
        for (id, lane) in &mut lanes {
            let end = lane.path.at(lane.path.length_m());
            lane.successors =
                network.successors(*id).filter_map(|next| index_of.get(&next.id.0).copied()).collect();
            lane.successors.dedup();
            let _ = end;
        }
        let mut graph = Self { lanes: lanes.into_iter().map(|(_, lane)| lane).collect() };
        graph.drop_broken_links();
        graph.drop_dead_ends();
        graph.link_back();
        graph.find_conflicts();
        graph
    }

    /// A successor that does not begin where the lane ends would make cars jump.
    fn drop_broken_links(&mut self) {
        let starts: Vec<Vec2> = self.lanes.iter().map(|lane| lane.path.at(0.0)).collect();
        for lane in &mut self.lanes {
            let end = lane.path.at(lane.path.length_m());
            lane.successors.retain(|&next| (starts[next] - end).norm() < 1.5);
        }
    }

    fn drop_dead_ends(&mut self) {
        let mut is_kept = vec![true; self.lanes.len()];
        loop {
            let ends = |i: usize| !self.lanes[i].successors.iter().any(|&next| is_kept[next]);
            let dead: Vec<usize> = (0..self.lanes.len()).filter(|&i| is_kept[i] && ends(i)).collect();
            if dead.is_empty() {
                break;
            }
            dead.iter().for_each(|&i| is_kept[i] = false);
        }
        if !is_kept.contains(&true) {
            return;
        }
        let mut new_index = vec![None; self.lanes.len()];
        let kept = is_kept.iter().enumerate().filter(|(_, kept)| **kept);
        for (n, (i, _)) in kept.enumerate() {
            new_index[i] = Some(n);
        }
        let lanes = std::mem::take(&mut self.lanes);
        self.lanes = lanes.into_iter().zip(is_kept).filter(|(_, kept)| *kept).map(|(lane, _)| lane).collect();
        for lane in &mut self.lanes {
            lane.successors = lane.successors.iter().filter_map(|&next| new_index[next]).collect();
        }
    }

    fn link_back(&mut self) {
        for i in 0..self.lanes.len() {
            for next in self.lanes[i].successors.clone() {
                self.lanes[next].predecessors.push(i);
            }
        }
    }

    fn find_conflicts(&mut self) {
        let sampled: Vec<Vec<Vec2>> = self.lanes.iter().map(|lane| lane.path.sampled(1.0)).collect();
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
        GraphLane {
            path: Path::new([Vec2::new(from.0, from.1), Vec2::new(to.0, to.1)]).unwrap(),
            width_m: 3.5,
            limit_mps: 10.0,
            successors,
            predecessors: Vec::new(),
            junction: Some(0),
            conflicts: Vec::new(),
        }
    }

    #[test]
    fn lanes_that_lead_into_a_dead_end_are_left_out() {
        let square = [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)];
        let mut lanes: Vec<GraphLane> =
            (0..4).map(|i| lane(square[i], square[(i + 1) % 4], vec![(i + 1) % 4])).collect();
        lanes.push(lane((9.0, 0.0), (30.0, 0.0), vec![]));
        lanes[0].successors.push(4);
        let mut graph = LaneGraph { lanes };
        graph.drop_dead_ends();
        assert_eq!(graph.lanes.len(), 4);
        assert_eq!(graph.lanes[0].successors, [1]);
    }

    #[test]
    fn crossing_lanes_of_a_junction_conflict_and_parallel_ones_do_not() {
        let lanes = vec![
            lane((0.0, 0.0), (20.0, 0.0), vec![]),
            lane((10.0, -9.0), (10.0, 9.0), vec![]),
            lane((20.0, 3.5), (0.0, 3.5), vec![]),
        ];
        let mut graph = LaneGraph { lanes };
        graph.find_conflicts();
        assert_eq!(graph.lanes[0].conflicts, [1]);
        assert_eq!(graph.lanes[1].conflicts, [0, 2]);
    }
}
