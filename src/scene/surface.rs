//! The ground of a town: road surface, raised pavements with kerbs, and painted marks.
//!
//! Heights over the [`Ground`]: grass at -0.05 m, road at 0, paint at +0.015 m (far enough apart for
//! the depth buffer), pavements at +0.14 m, the height of a usual kerb. On slopes all of it is cut
//! into small pieces that follow the ground.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::drape::Drape;
use super::ground::{Ground, PAVEMENT_M, Ribbon, waves_at};
use super::mesh::TriangleMesh;
use super::network::{LaneGraph, flat};
use super::occupancy::{Footprint, StripGrid};
use super::path::{Path, Vec2};
use super::relief;
use super::town_parts::{HillConfig, WaveConfig};
use crate::geometry::convex_hull;

const PAINT_M: f64 = 0.015;
/// On slopes, where road and paint are cut differently.
const PAINT_ON_SLOPES_M: f64 = 0.03;
/// Width of a crosswalk's stripes and of the gaps between.
const STRIPE_M: f64 = 0.5;
const ROAD_TILE_M: f64 = 6.0;
const PAVEMENT_TILE_M: f64 = 2.4;

/// The use of a strip of the cross-section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StripKind {
    Road,
    Parking,
    Pavement,
    Grass,
}

/// One lane of any type as its two edges.
#[derive(Debug, Clone)]
pub struct Strip {
    pub kind: StripKind,
    pub center: Path,
    pub width_m: f64,
    left: Vec<Vec2>,
    right: Vec<Vec2>,
    is_in_junction: bool,
}

impl Strip {
    pub fn is_in_junction(&self) -> bool {
        self.is_in_junction
    }

    /// Width at a station; bays are narrower at their ends.
    pub fn width_at_m(&self, s_m: f64) -> f64 {
        let n = self.left.len().min(self.right.len());
        let share = (s_m / self.center.length_m()).clamp(0.0, 1.0);
        let i = (share * (n - 1) as f64).round() as usize;
        (self.left[i] - self.right[i]).norm()
    }
}

/// The strips, the paint, and what ground they take.
#[derive(Debug, Clone)]
pub struct Surface {
    pub strips: Vec<Strip>,
    pub crosswalks: Vec<Footprint>,
    /// Painted quads.
    marks: Vec<[Vec2; 4]>,
    /// Convex fills under junctions.
    fills: Vec<Vec<Vec2>>,
    /// Driving lanes and parking.
    pub road_grid: StripGrid,
    /// Everything paved.
    pub paved_grid: StripGrid,
    pub ground: Ground,
}

/// The network's heights: the ground, and the lanes that lie on a level above it.
#[derive(Debug, Clone)]
pub struct Levels {
    mesh: xodr::Mesh,
    ground: Ground,
    above: BTreeSet<usize>,
}

impl Levels {
    /// Reads them, with waves of the land added; the ground keeps the road's height over `verge_m` beside it.
    pub fn of(network: &xodr::RoadNetwork, verge_m: f64, waves: &[WaveConfig]) -> Self {
        let mesh = network.surface_mesh();
        // Pavements and medians may be raised; the ground there is the road's edge.
        let is_level =
            |lane: &&xodr::Lane| !matches!(kind_of(lane.kind), Some(StripKind::Pavement | StripKind::Grass));
        let (mut ids, mut ribbons) = (Vec::new(), Vec::new());
        for span in &mesh.lanes {
            let Some(lane) = network.lane(span.lane).filter(is_level) else { continue };
            let ribs = &mesh.vertices[span.vertices.start as usize..span.vertices.end as usize];
            let at = |point: &xodr::Point| Vector3::new(point.x, point.y, point.z).cast::<f64>();
            ids.push(lane.id.0);
            let ribbon = Ribbon {
                left: ribs.iter().step_by(2).map(at).collect(),
                right: ribs.iter().skip(1).step_by(2).map(at).collect(),
            };
            ribbons.push(if waves.is_empty() { ribbon } else { ribbon.on_waves(waves) });
        }
        let (ground, is_above) = Ground::under(&ribbons, verge_m);
        let above = ids.into_iter().zip(is_above).filter(|(_, above)| *above).map(|(id, _)| id).collect();
        Self { mesh, ground, above }
    }

    /// Whether a lane lies above others.
    pub fn is_above(&self, lane: xodr::LaneId) -> bool {
        self.above.contains(&lane.0)
    }

    /// A report of what is left out, if anything.
    pub fn note(&self) -> Option<String> {
        let n = self.above.len();
        (n > 0).then(|| format!("{n} lanes on a level above other lanes are left out"))
    }
}

/// The visible meshes of the ground.
#[derive(Debug, Clone, Default)]
pub struct GroundMeshes {
    pub road: TriangleMesh,
    pub pavement: TriangleMesh,
    pub kerb: TriangleMesh,
    pub marks: TriangleMesh,
    /// Grass where it is not flat.
    pub terrain: TriangleMesh,
}

fn kind_of(kind: xodr::LaneType) -> Option<StripKind> {
    use xodr::LaneType as L;
    match kind {
        L::Sidewalk | L::Curb => Some(StripKind::Pavement),
        L::Parking => Some(StripKind::Parking),
        L::Median => Some(StripKind::Grass),
        L::Biking | L::Shoulder | L::Stop | L::Border | L::Restricted | L::RoadWorks | L::Tram => {
            Some(StripKind::Road)
        }
        drivable if drivable.is_drivable() => Some(StripKind::Road),
        _ => None,
    }
}

impl Surface {
    /// Takes strips and marks from a road network.
    pub fn new(
        network: &xodr::RoadNetwork,
        graph: &LaneGraph,
        levels: Levels,
        crosswalks: &[Footprint],
        waves: &[WaveConfig],
    ) -> Self {
        let Levels { mesh, ground, above } = levels;
        let mut strips = Vec::new();
        for span in mesh.lanes.iter().filter(|span| !above.contains(&span.lane.0)) {
            let Some(lane) = network.lane(span.lane) else { continue };
            let Some(kind) = kind_of(lane.kind) else { continue };
            let ribs = &mesh.vertices[span.vertices.start as usize..span.vertices.end as usize];
            let edge = |side: usize| ribs.iter().skip(side).step_by(2).map(|&p| flat(p)).collect::<Vec<_>>();
            let (left, right) = (edge(0), edge(1));
            let Some(center) = Path::new(left.iter().zip(&right).map(|(l, r)| (l + r) / 2.0)) else {
                continue;
            };
            let road = network.road_lane(lane.id).and_then(|at| network.road(at.road));
            strips.push(Strip {
                kind,
                center,
                width_m: f64::from(lane.width),
                left,
                right,
                is_in_junction: road.is_some_and(|road| road.junction().is_some()),
            });
        }
        let (mut road_grid, mut paved_grid) = (StripGrid::default(), StripGrid::default());
        for lane in &graph.lanes {
            road_grid.add(&lane.path.points_every(0.7), lane.width_m / 2.0);
        }
        for strip in &strips {
            let points = strip.center.points_every(0.7);
            paved_grid.add(&points, strip.width_m / 2.0);
            if matches!(strip.kind, StripKind::Road | StripKind::Parking) {
                road_grid.add(&points, strip.width_m / 2.0);
            }
        }
        let (mut marks, fills) = (marks_of(network, &ground, waves), fills_of(network, &mesh, &above));
        marks.extend(crosswalks.iter().flat_map(zebra));
        let mut surface =
            Self { strips, crosswalks: crosswalks.to_vec(), marks, fills, road_grid, paved_grid, ground };
        surface.drop_pavement_on_roads(graph);
        surface
    }

    /// Whether nothing paved lies beside a strip, outside junctions.
    pub fn is_bare(&self, strip: &Strip, side: f64) -> bool {
        let middle_m = strip.center.length_m() / 2.0;
        let beside = strip.center.beside(middle_m, side * (strip.width_m / 2.0 + 0.8));
        !strip.is_in_junction && self.paved_grid.clearance_m(beside) > 0.4
    }

    /// Raises hills and terraces away from the roads; returns the lines of the terraces' walls.
    pub fn shape_land(&mut self, hills: &[HillConfig], terrace_m: f64) -> Vec<Path> {
        let grid = self.ground.grid_mut();
        grid.map_or_else(Vec::new, |grid| relief::shape(grid, &self.paved_grid, hills, terrace_m))
    }

    /// Some maps lead pavements across junctions: a raised one would be a wall for cars.
    fn drop_pavement_on_roads(&mut self, graph: &LaneGraph) {
        let mut lanes = StripGrid::default();
        for lane in &graph.lanes {
            lanes.add(&lane.path.points_every(0.7), lane.width_m / 2.0);
        }
        self.strips.retain(|strip| {
            let crosses =
                || strip.center.points_every(1.0).iter().any(|&point| lanes.clearance_m(point) < 0.1);
            strip.kind != StripKind::Pavement || !strip.is_in_junction || !crosses()
        });
    }

    /// Height of the ground at a place, metres: of roads and grass; pavements stand [`PAVEMENT_M`] over it.
    pub fn ground_m(&self, point: Vec2) -> f64 {
        self.ground.height_m(point)
    }

    /// The visible ground, without the parts for which `is_near` is false.
    pub fn meshes(&self, is_near: impl Fn(Vec2) -> bool) -> GroundMeshes {
        let mut meshes = GroundMeshes::default();
        let drape = Drape { ground: &self.ground };
        for strip in &self.strips {
            for i in 1..strip.left.len().min(strip.right.len()) {
                let quad = [strip.right[i - 1], strip.right[i], strip.left[i], strip.left[i - 1]];
                if !is_near(quad[0]) {
                    continue;
                }
                match strip.kind {
                    // One flat fill stands for all the lanes that cross each other there.
                    StripKind::Road if strip.is_in_junction => {}
                    StripKind::Road | StripKind::Parking => {
                        drape.add(&mut meshes.road, quad, 0.0, ROAD_TILE_M);
                    }
                    StripKind::Grass => {}
                    StripKind::Pavement => {
                        drape.add(&mut meshes.pavement, quad, PAVEMENT_M, PAVEMENT_TILE_M);
                        drape.add_kerb(&mut meshes.kerb, quad[0], quad[1]);
                        drape.add_kerb(&mut meshes.kerb, quad[2], quad[3]);
                    }
                }
            }
        }
        for fill in self.fills.iter().filter(|fill| fill.first().is_some_and(|&point| is_near(point))) {
            drape.add_convex(&mut meshes.road, fill, ROAD_TILE_M);
        }
        let paint_m = if self.ground.is_flat() { PAINT_M } else { PAINT_ON_SLOPES_M };
        for mark in self.marks.iter().filter(|mark| is_near(mark[0])) {
            drape.add(&mut meshes.marks, *mark, paint_m, 1.0);
        }
        self.add_terrain(&mut meshes.terrain, is_near);
        meshes
    }

    /// Lane lines as quads, for drawing the map.
    pub fn marks(&self) -> &[[Vec2; 4]] {
        &self.marks
    }

    /// Edges of the road and parking strips, left then right, for drawing the drivable area.
    pub fn road_edges(&self) -> impl Iterator<Item = (&[Vec2], &[Vec2])> {
        let is_road = |strip: &&Strip| matches!(strip.kind, StripKind::Road | StripKind::Parking);
        self.strips.iter().filter(is_road).map(|strip| (strip.left.as_slice(), strip.right.as_slice()))
    }
}

/// Painted quads, without paint on other levels than the ground.
fn marks_of(network: &xodr::RoadNetwork, ground: &Ground, waves: &[WaveConfig]) -> Vec<[Vec2; 4]> {
    let lines = network.road_marks().iter().flat_map(|mark| &mark.lines);
    lines
        .flat_map(|line| &line.pieces)
        .filter(|piece| {
            let at = flat(piece[0]);
            let over_m = f64::from(piece[0].z) + waves_at(waves, at) - ground.base_m() - ground.height_m(at);
            ground.is_flat() || over_m < 2.0
        })
        .map(|piece| piece.map(flat))
        .collect()
}

/// The stripes of a crosswalk, along the road.
fn zebra(walk: &Footprint) -> Vec<[Vec2; 4]> {
    let n = ((walk.width_m / (2.0 * STRIPE_M)).floor() as usize).max(1);
    let half_m = walk.length_m / 2.0;
    (0..n)
        .map(|i| {
            let left_m = (i as f64 - (n as f64 - 1.0) / 2.0) * 2.0 * STRIPE_M;
            let (low_m, high_m) = (left_m - STRIPE_M / 2.0, left_m + STRIPE_M / 2.0);
            [(-half_m, low_m), (half_m, low_m), (half_m, high_m), (-half_m, high_m)]
                .map(|(x, y)| walk.at(x, y))
        })
        .collect()
}

/// The convex hull of each junction's driving lanes, so that no grass shows between its lanes.
fn fills_of(network: &xodr::RoadNetwork, mesh: &xodr::Mesh, above: &BTreeSet<usize>) -> Vec<Vec<Vec2>> {
    let mut corners: std::collections::BTreeMap<&str, Vec<Vec2>> = std::collections::BTreeMap::new();
    for span in mesh.lanes.iter().filter(|span| !above.contains(&span.lane.0)) {
        let road = network.road_lane(span.lane).and_then(|at| network.road(at.road));
        let (Some(junction), Some(lane)) = (road.and_then(xodr::Road::junction), network.lane(span.lane))
        else {
            continue;
        };
        if lane.kind.is_drivable() {
            let ribs = &mesh.vertices[span.vertices.start as usize..span.vertices.end as usize];
            corners.entry(junction).or_default().extend(ribs.iter().map(|&point| flat(point)));
        }
    }
    corners.into_values().map(convex_hull).filter(|hull| hull.len() >= 3).collect()
}
