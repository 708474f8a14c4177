//! Traffic lights: which lanes each one stops and where, and what it shows at a time.
//!
//! Fixed-time plans, as OpenDRIVE holds none: the lights of a junction that are green together form a
//! phase, by the map's controllers, or where it has none or many, by the axis that their traffic
//! drives along. Phases take turns: green 14 s, yellow 3 s, all red 1.5 s; a light alone takes turns
//! with an empty phase. Where in its cycle a junction begins is drawn from the episode's seed.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use rand::RngExt;

use super::network::{LaneGraph, Rank, flat};
use super::occupancy::Footprint;
use super::path::Vec2;
use crate::random;

const GREEN_S: f64 = 14.0;
/// The usual yellow time up to 50 km/h.
const YELLOW_S: f64 = 3.0;
const ALL_RED_S: f64 = 1.5;
/// A junction's lights stand at most this far before it.
const TO_JUNCTION_M: f64 = 60.0;
/// More controllers than this are approaches, not phases.
const MAX_CONTROLLERS: usize = 3;
/// A stop line keeps this distance from the crosswalk behind it.
const CROSSWALK_GAP_M: f64 = 0.8;

/// What a light shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aspect {
    Red,
    Yellow,
    Green,
}

/// One light.
#[derive(Debug, Clone)]
pub struct Light {
    pub position: Vec2,
    /// The direction in which it shines.
    pub heading_rad: f64,
    /// Lanes of the graph that it stops, and the station of the stop line.
    pub stops: Vec<(usize, f64)>,
    group: usize,
    phase: usize,
}

/// All lights of a town.
#[derive(Debug, Clone, Default)]
pub struct Lights {
    pub lights: Vec<Light>,
    /// Number of phases of each group of lights.
    n_phases: Vec<usize>,
    /// Stop lines on each lane: station and light.
    lines: BTreeMap<usize, Vec<(f64, usize)>>,
}

/// Traffic light of the generic catalogue for vehicles, with any number of lamps.
fn is_light(signal: &xodr::Signal) -> bool {
    let kinds = ["1000001", "1000008", "1000009", "1000010", "1000011", "1000012"];
    signal.dynamic && kinds.contains(&signal.kind.as_str())
}

/// Right of way that a sign gives: German, Vienna and American codes, or the map's own words.
fn rank_of(signal: &xodr::Signal) -> Option<Rank> {
    let says = |wanted: &str| {
        let is = |semantic: &xodr::Semantic| matches!(semantic, xodr::Semantic::Priority { kind } if kind == wanted);
        signal.semantics.iter().any(is)
    };
    match signal.kind.as_str() {
        "206" | "R1-1" => Some(Rank::Stops),
        "205" | "R1-2" => Some(Rank::Yields),
        "301" | "306" => Some(Rank::HasPriority),
        _ if signal.dynamic => None,
        _ if says("stop") || says("stopLine") => Some(Rank::Stops),
        _ if says("yield") => Some(Rank::Yields),
        _ if says("priorityRoad") || says("rightOfWay") => Some(Rank::HasPriority),
        _ => None,
    }
}

impl Lights {
    /// Reads lights, and writes the right of way of signs into the graph; reports what is not understood.
    pub fn read(
        network: &xodr::RoadNetwork,
        graph: &mut LaneGraph,
        crosswalks: &[Footprint],
    ) -> (Self, Vec<String>) {
        let mut all = Self::default();
        let (mut n_idle, mut unknown) = (0, BTreeMap::<String, usize>::new());
        // Group by junction, or alone; with the controllers of each light.
        let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        let mut controllers = Vec::new();
        for (n, signal) in network.signals().iter().enumerate() {
            let lanes: Vec<usize> = signal.lanes.iter().filter_map(|&id| graph.find(id)).collect();
            if let Some(rank) = rank_of(signal) {
                set_rank(graph, &lanes, rank);
            } else if is_light(signal) {
                if lanes.is_empty() {
                    n_idle += 1;
                    continue;
                }
                let places: Vec<Vec2> = signal.applies_at.iter().map(|&point| flat(point)).collect();
                let stops =
                    lanes.iter().map(|&lane| (lane, stop_m(graph, lane, &places, crosswalks))).collect();
                let junction = lanes.iter().find_map(|&lane| junction_after(graph, lane));
                // Lights without a junction stand alone.
                let key = junction.map_or((1, n), |junction| (0, junction));
                groups.entry(key).or_default().push(all.lights.len());
                controllers.push(signal.controllers.first().map(|id| id.0));
                all.lights.push(Light {
                    position: flat(signal.position),
                    heading_rad: f64::from(signal.heading),
                    stops,
                    group: 0,
                    phase: 0,
                });
            } else if signal.dynamic {
                *unknown.entry(signal.kind.clone()).or_default() += 1;
            }
        }
        for (group, members) in groups.into_values().enumerate() {
            let phases = all.phases_of(&members, &controllers);
            for (&light, &phase) in members.iter().zip(&phases) {
                (all.lights[light].group, all.lights[light].phase) = (group, phase);
            }
            all.n_phases.push((phases.iter().max().map_or(0, |last| last + 1)).max(2));
        }
        for (light, stop) in
            all.lights.iter().enumerate().flat_map(|(i, light)| light.stops.iter().map(move |s| (i, s)))
        {
            all.lines.entry(stop.0).or_default().push((stop.1, light));
        }
        let mut notes = Vec::new();
        if n_idle > 0 {
            notes.push(format!("{n_idle} traffic lights apply to no lane that is driven"));
        }
        if !unknown.is_empty() {
            let kinds: Vec<String> = unknown.iter().map(|(kind, n)| format!("{n} of type {kind}")).collect();
            notes.push(format!("signals that change are not understood: {}", kinds.join(", ")));
        }
        (all, notes)
    }

    /// Phase of each member of a group.
    fn phases_of(&self, members: &[usize], controllers: &[Option<usize>]) -> Vec<usize> {
        let mut named: Vec<usize> = members.iter().filter_map(|&light| controllers[light]).collect();
        named.sort_unstable();
        named.dedup();
        let has_all = members.iter().all(|&light| controllers[light].is_some());
        if has_all && (2..=MAX_CONTROLLERS).contains(&named.len()) {
            let place = |light: &usize| named.iter().position(|&id| Some(id) == controllers[*light]);
            return members.iter().map(|light| place(light).unwrap_or_default()).collect();
        }
        let axis_rad = self.lights[members[0]].heading_rad;
        let turned = |light: &usize| {
            let turn = (self.lights[*light].heading_rad - axis_rad).rem_euclid(PI);
            turn.min(PI - turn)
        };
        members.iter().map(|light| usize::from(turned(light) > PI / 4.0)).collect()
    }

    /// Stop lines on a lane: station and light.
    pub fn on_lane(&self, lane: usize) -> &[(f64, usize)] {
        self.lines.get(&lane).map_or(&[], Vec::as_slice)
    }
}

/// The clock of all lights in one episode.
#[derive(Debug, Clone, Default)]
pub struct Clock {
    offsets_s: Vec<f64>,
    pub time_s: f64,
}

impl Clock {
    pub fn new(lights: &Lights, seed: u64) -> Self {
        let draw = |(group, n): (usize, &usize)| {
            cycle_s(*n) * random::stream(seed, "traffic-lights", group as u64).random::<f64>()
        };
        Self { offsets_s: lights.n_phases.iter().enumerate().map(draw).collect(), time_s: 0.0 }
    }

    /// What a light shows now.
    pub fn aspect(&self, lights: &Lights, light: usize) -> Aspect {
        let Light { group, phase, .. } = lights.lights[light];
        let n_phases = lights.n_phases[group];
        let turn_s = cycle_s(1);
        let into_s =
            (self.time_s + self.offsets_s[group] - turn_s * phase as f64).rem_euclid(cycle_s(n_phases));
        if into_s < GREEN_S {
            Aspect::Green
        } else if into_s < GREEN_S + YELLOW_S {
            Aspect::Yellow
        } else {
            Aspect::Red
        }
    }
}

fn cycle_s(n_phases: usize) -> f64 {
    n_phases as f64 * (GREEN_S + YELLOW_S + ALL_RED_S)
}

/// Where to stop on a lane: at the light's place, or before a crosswalk there; at the start of a lane
/// that already crosses the junction.
fn stop_m(graph: &LaneGraph, lane: usize, places: &[Vec2], crosswalks: &[Footprint]) -> f64 {
    let (path, junction) = (&graph.lanes[lane].path, graph.lanes[lane].junction);
    if junction.is_some() {
        return 0.0;
    }
    let length_m = path.length_m();
    let near = places.iter().map(|&place| path.project(place, 0.0, length_m));
    let nearest = near.min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let mut station_m = nearest.map_or(length_m, |(station_m, _)| station_m);
    let is_on = |station_m: f64| {
        crosswalks.iter().any(|walk| walk.grow(CROSSWALK_GAP_M).contains(path.at(station_m)))
    };
    // The light may stand at the crosswalk's far side.
    let reach_m = (station_m - 6.0).max(0.0);
    let mut back_m = station_m;
    while back_m > reach_m {
        back_m -= 0.25;
        if is_on(back_m) {
            station_m = back_m - 0.25;
        }
    }
    station_m.max(0.0)
}

/// The junction that a lane crosses or leads to soon.
fn junction_after(graph: &LaneGraph, lane: usize) -> Option<usize> {
    let (mut at, mut left_m) = (lane, TO_JUNCTION_M);
    loop {
        if let Some(junction) = graph.lanes[at].junction {
            return Some(junction);
        }
        if at != lane {
            left_m -= graph.lanes[at].path.length_m();
        }
        at = *graph.lanes[at].successors.first()?;
        if left_m < 0.0 {
            return None;
        }
    }
}

/// Ranks the ways through a junction by the sign on the lane before them.
fn set_rank(graph: &mut LaneGraph, lanes: &[usize], rank: Rank) {
    for &lane in lanes {
        let inside = if graph.lanes[lane].junction.is_some() {
            vec![lane]
        } else {
            graph.lanes[lane].successors.clone()
        };
        for way in inside {
            if graph.lanes[way].junction.is_some() {
                graph.lanes[way].rank = rank;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn town(headings_deg: &[f64]) -> Lights {
        let light = |heading: &f64| Light {
            position: Vec2::zeros(),
            heading_rad: heading.to_radians(),
            stops: Vec::new(),
            group: 0,
            phase: 0,
        };
        Lights { lights: headings_deg.iter().map(light).collect(), n_phases: vec![2], lines: BTreeMap::new() }
    }

    #[test]
    fn opposing_approaches_share_a_phase_where_the_map_has_no_controllers() {
        let lights = town(&[10.0, 185.0, 95.0, -80.0]);
        assert_eq!(lights.phases_of(&[0, 1, 2, 3], &[None; 4]), [0, 0, 1, 1]);
        let named = [Some(7), Some(9), Some(7), Some(9)];
        assert_eq!(lights.phases_of(&[0, 1, 2, 3], &named), [0, 1, 0, 1]);
    }

    #[test]
    fn crossing_phases_are_never_open_at_once_and_each_gets_its_turn() {
        let mut lights = town(&[0.0, 90.0]);
        lights.lights[1].phase = 1;
        let mut clock = Clock::new(&lights, 3);
        let mut seen = [[0; 3]; 2];
        for _ in 0..740 {
            clock.time_s += 0.05;
            let now = [0, 1].map(|light| clock.aspect(&lights, light));
            assert!(now.contains(&Aspect::Red), "{now:?}");
            for (seen, aspect) in seen.iter_mut().zip(now) {
                seen[aspect as usize] += 1;
            }
        }
        // One cycle of 37 s: 14 s green, 3 s yellow each.
        assert!(
            seen.iter().all(|[_, yellow, green]| (59..=61).contains(yellow) && (279..=281).contains(green))
        );
    }
}
