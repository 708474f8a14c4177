//! Argoverse 2's vector map as the drawing under an episode: drivable areas as triangles, borders of lanes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::episode::MapDrawing;
use crate::geometry::Point;
use crate::import::ImportError;
use crate::import::error::{listed, read_text};

#[derive(Deserialize)]
struct VectorMap {
    #[serde(default)]
    drivable_areas: BTreeMap<String, DrivableArea>,
    #[serde(default)]
    lane_segments: BTreeMap<String, LaneSegment>,
}

#[derive(Deserialize)]
struct DrivableArea {
    area_boundary: Vec<MapPoint>,
}

#[derive(Deserialize)]
struct LaneSegment {
    left_lane_boundary: Vec<MapPoint>,
    right_lane_boundary: Vec<MapPoint>,
    #[serde(default)]
    is_intersection: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
struct MapPoint {
    x: f64,
    y: f64,
    z: f64,
}

/// The drawing of a log's map, and the city in its file's name; `None` where the log comes without.
pub(super) fn read_map(log: &Path) -> Result<Option<(MapDrawing, Option<String>)>, ImportError> {
    let Some(path) = map_file(log)? else { return Ok(None) };
    let map: VectorMap = serde_json::from_str(&read_text(&path)?)
        .map_err(|error| ImportError::at(&path, format!("the vector map is not valid ({error})")))?;
    let lines = map.lane_segments.values().filter(|lane| !lane.is_intersection);
    let lines = lines.flat_map(|lane| [&lane.left_lane_boundary, &lane.right_lane_boundary]);
    let drawing = MapDrawing {
        lane_lines: lines.map(|line| line.iter().map(in_world).collect()).collect(),
        drivable_area: map.drivable_areas.values().flat_map(|area| triangles(&area.area_boundary)).collect(),
    };
    // `log_map_archive_<log>____PIT_city_57819.json`.
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let city = name.split("____").nth(1).and_then(|rest| rest.split('_').next()).map(str::to_lowercase);
    Ok(Some((drawing, city)))
}

fn map_file(log: &Path) -> std::io::Result<Option<PathBuf>> {
    let is_archive = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("log_map_archive_") && name.ends_with(".json")
    };
    Ok(listed(&log.join("map"))?.into_iter().find(is_archive))
}

fn in_world(point: &MapPoint) -> Point<crate::geometry::World> {
    Point::new(point.x, point.y, point.z)
}

/// Cuts ears off a simple polygon, counter-clockwise (Meisters, 1975). What is left of one that crosses itself is left out.
fn triangles(boundary: &[MapPoint]) -> Vec<[Point<crate::geometry::World>; 3]> {
    let mut left: Vec<MapPoint> = boundary.to_vec();
    left.dedup();
    if left.len() > 1 && left.first() == left.last() {
        left.pop();
    }
    let area: f64 = (0..left.len())
        .map(|i| {
            let (a, b) = (left[i], left[(i + 1) % left.len()]);
            a.x * b.y - b.x * a.y
        })
        .sum();
    if area < 0.0 {
        left.reverse();
    }
    let mut made = Vec::new();
    while left.len() >= 3 {
        let n = left.len();
        let is_ear = |i: &usize| {
            let (before, tip, after) = (left[(i + n - 1) % n], left[*i], left[(i + 1) % n]);
            let is_inside = |point: &MapPoint| {
                *point != before
                    && *point != tip
                    && *point != after
                    && turn(before, tip, *point) >= 0.0
                    && turn(tip, after, *point) >= 0.0
                    && turn(after, before, *point) >= 0.0
            };
            turn(before, tip, after) > 0.0 && !left.iter().any(is_inside)
        };
        let Some(ear) = (0..n).find(is_ear) else {
            // Corners in line have no ear; drop one of them and go on.
            let Some(flat) =
                (0..n).find(|i| turn(left[(i + n - 1) % n], left[*i], left[(i + 1) % n]).abs() < 1e-9)
            else {
                break;
            };
            left.remove(flat);
            continue;
        };
        made.push([left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]].map(|point| in_world(&point)));
        left.remove(ear);
    }
    made
}

/// Twice the signed area of a triangle.
fn turn(a: MapPoint, b: MapPoint, c: MapPoint) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_of(made: &[[Point<crate::geometry::World>; 3]]) -> f64 {
        let area = |[a, b, c]: &[Point<crate::geometry::World>; 3]| {
            ((b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x())) / 2.0
        };
        made.iter().map(area).sum()
    }

    #[test]
    fn an_l_is_filled_once_whichever_way_it_runs() {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0), (0.0, 0.0)];
        let mut boundary: Vec<MapPoint> = corners.iter().map(|&(x, y)| MapPoint { x, y, z: 0.0 }).collect();
        assert!((area_of(&triangles(&boundary)) - 3.0).abs() < 1e-12);
        boundary.reverse();
        assert!((area_of(&triangles(&boundary)) - 3.0).abs() < 1e-12);
    }
}
