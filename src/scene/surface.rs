//! The ground of a town: road surface, raised pavements with kerbs, and painted marks.
//!
//! Heights: grass at -0.05 m, fill under junctions at -0.02 m, road at 0, paint at +0.015 m (far
//! enough apart for the depth buffer), pavements at +0.14 m, the height of a usual kerb.

use super::crosswalks;
use super::mesh::TriangleMesh;
use super::network::{LaneGraph, flat};
use super::occupancy::StripGrid;
use super::path::{Path, Vec2};

/// Height of pavements over the road.
pub const PAVEMENT_M: f64 = 0.14;
/// Height of the grass plane.
pub const GRASS_M: f64 = -0.05;
const PAINT_M: f64 = 0.015;
const ROAD_TILE_M: f64 = 6.0;
const PAVEMENT_TILE_M: f64 = 2.4;

/// What a strip of the cross-section is for.
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
    /// Width at a station; bays are narrower at their ends.
    #[must_use]
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
    /// Painted quads.
    marks: Vec<[Vec2; 4]>,
    /// Convex fills under junctions.
    fills: Vec<Vec<Vec2>>,
    /// Driving lanes and parking.
    pub road_grid: StripGrid,
    /// Everything paved.
    pub paved_grid: StripGrid,
}

/// The visible meshes of the ground.
#[derive(Debug, Clone, Default)]
pub struct GroundMeshes {
    pub road: TriangleMesh,
    pub pavement: TriangleMesh,
    pub kerb: TriangleMesh,
    pub marks: TriangleMesh,
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
    /// Reads strips and marks off a road network.
    #[must_use]
    pub fn new(network: &xodr::RoadNetwork, graph: &LaneGraph) -> Self {
        let mesh = network.surface_mesh();
        let mut strips = Vec::new();
        for span in &mesh.lanes {
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
            road_grid.add(&lane.path.sampled(0.7), lane.width_m / 2.0);
        }
        for strip in &strips {
            let points = strip.center.sampled(0.7);
            paved_grid.add(&points, strip.width_m / 2.0);
            if matches!(strip.kind, StripKind::Road | StripKind::Parking) {
                road_grid.add(&points, strip.width_m / 2.0);
            }
        }
        let mut surface =
            Self { strips, marks: marks_of(network), fills: fills_of(network), road_grid, paved_grid };
        surface.drop_pavement_on_roads(graph);
        surface
    }

    /// Some maps lead pavements across junctions: a raised one would be a wall for cars.
    fn drop_pavement_on_roads(&mut self, graph: &LaneGraph) {
        let mut lanes = StripGrid::default();
        for lane in &graph.lanes {
            lanes.add(&lane.path.sampled(0.7), lane.width_m / 2.0);
        }
        self.strips.retain(|strip| {
            let crosses = || strip.center.sampled(1.0).iter().any(|&point| lanes.clearance_m(point) < 0.1);
            strip.kind != StripKind::Pavement || !strip.is_in_junction || !crosses()
        });
    }

    /// The visible ground; parts of which `is_near` says no are left out.
    #[must_use]
    pub fn meshes(&self, is_near: impl Fn(Vec2) -> bool) -> GroundMeshes {
        let mut meshes = GroundMeshes::default();
        for strip in &self.strips {
            for i in 1..strip.left.len().min(strip.right.len()) {
                let quad = [strip.right[i - 1], strip.right[i], strip.left[i], strip.left[i - 1]];
                if !is_near(quad[0]) {
                    continue;
                }
                let corners = quad.map(|point| [point.x, point.y]);
                match strip.kind {
                    // One flat fill stands for all the lanes that cross each other there.
                    StripKind::Road if strip.is_in_junction => {}
                    StripKind::Road | StripKind::Parking => meshes.road.add_flat(&corners, 0.0, ROAD_TILE_M),
                    StripKind::Grass => {}
                    StripKind::Pavement => {
                        meshes.pavement.add_flat(&corners, PAVEMENT_M, PAVEMENT_TILE_M);
                        add_kerb(&mut meshes.kerb, quad[0], quad[1]);
                        add_kerb(&mut meshes.kerb, quad[2], quad[3]);
                    }
                }
            }
        }
        for fill in self.fills.iter().filter(|fill| fill.first().is_some_and(|&point| is_near(point))) {
            let corners: Vec<[f64; 2]> = fill.iter().map(|point| [point.x, point.y]).collect();
            meshes.road.add_flat(&corners, 0.0, ROAD_TILE_M);
        }
        for mark in self.marks.iter().filter(|mark| is_near(mark[0])) {
            meshes.marks.add_flat(&mark.map(|point| [point.x, point.y]), PAINT_M, 1.0);
        }
        meshes
    }

    /// Lane lines as quads, for drawing the map.
    #[must_use]
    pub fn marks(&self) -> &[[Vec2; 4]] {
        &self.marks
    }

    /// Edges of the road and parking strips, left then right, for drawing the drivable area.
    pub fn road_edges(&self) -> impl Iterator<Item = (&[Vec2], &[Vec2])> {
        let is_road = |strip: &&Strip| matches!(strip.kind, StripKind::Road | StripKind::Parking);
        self.strips.iter().filter(is_road).map(|strip| (strip.left.as_slice(), strip.right.as_slice()))
    }
}

/// A wall from the pavement's edge down into the ground, facing right of `from -> to`.
fn add_kerb(kerb: &mut TriangleMesh, from: Vec2, to: Vec2) {
    let length_m = (to - from).norm();
    kerb.add_polygon(&[
        ([from.x, from.y, GRASS_M - 0.01], [0.0, 0.0]),
        ([to.x, to.y, GRASS_M - 0.01], [length_m, 0.0]),
        ([to.x, to.y, PAVEMENT_M], [length_m, 0.2]),
        ([from.x, from.y, PAVEMENT_M], [0.0, 0.2]),
    ]);
}

fn marks_of(network: &xodr::RoadNetwork) -> Vec<[Vec2; 4]> {
    let lines = network.road_marks().iter().flat_map(|mark| &mark.lines);
    let pieces = lines.flat_map(|line| &line.pieces).map(|piece| piece.map(flat));
    pieces.chain(crosswalks::bars(network)).collect()
}

/// The convex hull of each junction's driving lanes, so that no grass shows between its lanes.
fn fills_of(network: &xodr::RoadNetwork) -> Vec<Vec<Vec2>> {
    let mesh = network.surface_mesh();
    let mut corners: std::collections::BTreeMap<&str, Vec<Vec2>> = std::collections::BTreeMap::new();
    for span in &mesh.lanes {
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

/// Counter-clockwise convex hull (Andrew's monotone chain).
fn convex_hull(mut points: Vec<Vec2>) -> Vec<Vec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |ordered: &mut dyn Iterator<Item = Vec2>| {
        let mut hull: Vec<Vec2> = Vec::new();
        for point in ordered {
            while let [.., a, b] = hull[..] {
                if (b - a).perp(&(point - b)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
        hull
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_leaves_out_its_middle() {
        let points = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0)];
        let hull = convex_hull(points.iter().map(|&(x, y)| Vec2::new(x, y)).collect());
        assert_eq!(hull.len(), 4);
        assert!(!hull.contains(&Vec2::new(1.0, 1.0)));
    }
}
