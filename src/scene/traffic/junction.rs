//! Who may drive through a junction: first come, first served, as long as the ways do not conflict.

use std::collections::BTreeMap;

use crate::scene::network::LaneGraph;

/// Lanes of junctions that are taken, and by whom.
#[derive(Debug, Default)]
pub struct Junctions {
    /// Lane and agent.
    taken: BTreeMap<(usize, usize), ()>,
}

impl Junctions {
    /// Takes a junction's lane for an agent unless somebody else has it or one that conflicts with it.
    pub fn take(&mut self, graph: &LaneGraph, lane: usize, agent: usize) -> bool {
        if self.taken.contains_key(&(lane, agent)) {
            return true;
        }
        // Cars may follow each other on one lane; ways that cross wait.
        let is_free = self
            .taken
            .keys()
            .all(|&(other, by)| by == agent || !graph.lanes[lane].conflicts.contains(&other));
        if is_free {
            self.taken.insert((lane, agent), ());
        }
        is_free
    }

    /// Gives back all that an agent holds but the lanes it still needs.
    pub fn keep_only(&mut self, agent: usize, needed: &[usize]) {
        self.taken.retain(|&(lane, by), ()| by != agent || needed.contains(&lane));
    }
}
