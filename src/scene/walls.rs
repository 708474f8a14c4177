//! Walls of buildings, textured bay by bay and floor by floor.
//!
//! Near the route panes and gates lie behind the wall by the depth of a reveal, so that beams and shadows find relief where
//! they do on real masonry.

use super::buildings::{BAY_M, Building, BuildingMeshes, FLOOR_M, GROUND_FLOOR_M};
use super::looks::FacadeLook;
use super::mesh::TriangleMesh;
use super::windows::{Floor, reveal_m, window};

/// Of the upper floors, those whose windows lie back: higher ones are seen by few beams and pixels.
const FLOORS_IN_SIGHT: u32 = 2;
/// Sides of a footprint in the order of its corners.
const BACK: usize = 0;
const FRONT: usize = 2;

/// A wall's ends on the ground plan, counter-clockwise round the building.
#[derive(Debug, Clone, Copy)]
struct Wall {
    from: [f64; 2],
    to: [f64; 2],
    n_bays: u32,
}

/// A wall from one level to another.
#[derive(Debug, Clone, Copy)]
struct WallPart {
    wall: Wall,
    levels_m: [f64; 2],
    /// The texture's v at its foot and top; a tile is a floor.
    tiles: [f64; 2],
}

impl Wall {
    fn part(self, levels_m: [f64; 2], tiles: [f64; 2]) -> WallPart {
        WallPart { wall: self, levels_m, tiles }
    }
}

impl WallPart {
    /// The point a number of bays along, at a share of the floor's height, some way behind the wall; with its texture
    /// coordinates.
    fn at(&self, bays: f64, share: f64, behind_m: f64) -> ([f64; 3], [f64; 2]) {
        let Wall { from, to, n_bays } = self.wall;
        let way = [to[0] - from[0], to[1] - from[1]];
        let length_m = way[0].hypot(way[1]);
        let (along, inward) = (bays / f64::from(n_bays), behind_m / length_m);
        let [low_m, top_m] = self.levels_m;
        let x = from[0] + way[0] * along - way[1] * inward;
        let y = from[1] + way[1] * along + way[0] * inward;
        let [first, last] = self.tiles;
        ([x, y, low_m + (top_m - low_m) * share], [bays, first + (last - first) * share])
    }

    fn add(&self, mesh: &mut TriangleMesh, [left, bottom, right, top]: [f64; 4], behind_m: f64) {
        let corners = [(left, bottom), (right, bottom), (right, top), (left, top)];
        mesh.add_polygon(&corners.map(|(bays, share)| self.at(bays, share, behind_m)));
    }

    /// A plane.
    fn add_flat(&self, mesh: &mut TriangleMesh) {
        self.add(mesh, [0.0, 0.0, f64::from(self.wall.n_bays), 1.0], 0.0);
    }

    /// A wall whose windows lie back, but for the bays that `is_plain` names.
    fn add_with_windows(
        &self,
        mesh: &mut TriangleMesh,
        look: FacadeLook,
        floor: Floor,
        is_plain: impl Fn(u32) -> bool,
    ) {
        let [left, bottom, right, top] = window(look, floor);
        let behind_m = reveal_m(look, floor);
        let end = f64::from(self.wall.n_bays);
        self.add(mesh, [0.0, 0.0, end, bottom], 0.0);
        self.add(mesh, [0.0, top, end, 1.0], 0.0);
        let mut wall_from = 0.0;
        for bay in (0..self.wall.n_bays).filter(|&bay| !is_plain(bay)) {
            let [left, right] = [left, right].map(|share| f64::from(bay) + share);
            self.add(mesh, [wall_from, bottom, left, top], 0.0);
            self.add(mesh, [left, bottom, right, top], behind_m);
            self.add_reveals(mesh, [left, bottom, right, top], behind_m);
            wall_from = right;
        }
        self.add(mesh, [wall_from, bottom, end, top], 0.0);
    }

    /// The four sides of a window's hole, in the colour of the frame round it.
    fn add_reveals(&self, mesh: &mut TriangleMesh, [left, bottom, right, top]: [f64; 4], behind_m: f64) {
        let corners = [(left, bottom), (right, bottom), (right, top), (left, top)];
        let frame_uv = [left - 0.02, self.tiles[0] + 0.5 * (bottom + top)];
        for k in 0..4 {
            let [(a, low), (b, high)] = [corners[k], corners[(k + 1) % 4]];
            let side = [(a, low, 0.0), (b, high, 0.0), (b, high, behind_m), (a, low, behind_m)];
            mesh.add_polygon(
                &side.map(|(bays, share, behind_m)| (self.at(bays, share, behind_m).0, frame_uv)),
            );
        }
    }
}

impl BuildingMeshes {
    /// The four walls of a building from the lowest ground at it to its eaves; its ground floor is level with `base_m`.
    pub(super) fn add_walls(
        &mut self,
        building: &Building,
        [lowest_m, base_m]: [f64; 2],
        look: FacadeLook,
        is_close: bool,
    ) {
        let has_gates = matches!(look, FacadeLook::Metal | FacadeLook::Warehouse);
        let corners = building.footprint.corners().map(|corner| [corner.x_m, corner.y_m]);
        let (low_m, top_m) = (base_m + GROUND_FLOOR_M, base_m + building.height_m());
        let [facades, ground_floors, blank] = [&mut self.facades, &mut self.ground_floors, &mut self.blank]
            .map(|meshes| &mut meshes[building.facade]);
        for i in 0..4 {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            let n_bays = ((to[0] - from[0]).hypot(to[1] - from[1]) / BAY_M).round().max(1.0) as u32;
            let wall = Wall { from, to, n_bays };
            let n_floors = f64::from(building.n_floors);
            if has_gates && i != FRONT {
                wall.part([lowest_m, top_m], [0.0, n_floors + 1.0]).add_flat(facades);
                continue;
            }
            // Below the ground floor stones go on; elsewhere the lowest part of its tile: a plain plinth.
            if look == FacadeLook::Rubble {
                wall.part([lowest_m, base_m], [(lowest_m - base_m) / FLOOR_M, 0.0]).add_flat(blank);
            } else {
                wall.part([lowest_m, base_m], [0.0, 0.02]).add_flat(ground_floors);
            }
            let ground_floor = wall.part([base_m, low_m], [0.0, 1.0]);
            let n_deep = if is_close && i != BACK { building.n_floors.min(FLOORS_IN_SIGHT) } else { 0 };
            if is_close && i != BACK {
                let has_door = |bay: u32| look == FacadeLook::House && i == FRONT && 2 * bay + 1 == n_bays;
                ground_floor.add_with_windows(ground_floors, look, Floor::Ground, has_door);
            } else {
                ground_floor.add_flat(ground_floors);
            }
            let foot_m = |floor: u32| low_m + FLOOR_M * f64::from(floor);
            for floor in 0..n_deep {
                let tiles = [f64::from(floor), f64::from(floor + 1)];
                let part = wall.part([foot_m(floor), foot_m(floor + 1)], tiles);
                part.add_with_windows(facades, look, Floor::Upper, |_| false);
            }
            if building.n_floors > n_deep {
                wall.part([foot_m(n_deep), top_m], [f64::from(n_deep), n_floors]).add_flat(facades);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::super::buildings::Roof;
    use super::super::occupancy::Footprint;
    use super::super::path::Vec2;
    use super::*;

    const WALL: WallPart = WallPart {
        wall: Wall { from: [2.0, 5.0], to: [8.0, 5.0], n_bays: 2 },
        levels_m: [1.0, 4.2],
        tiles: [0.0, 1.0],
    };

    fn area_and_normals(mesh: &TriangleMesh) -> (f64, Vec<Vector3<f32>>) {
        let cross = |[a, b, c]: [Point3<f32>; 3]| (b - a).cross(&(c - a));
        let normals: Vec<_> = mesh.corners().into_iter().map(cross).collect();
        (normals.iter().map(|normal| f64::from(normal.norm()) / 2.0).sum(), normals)
    }

    #[test]
    fn windows_lie_behind_the_wall_and_the_wall_has_no_gap() {
        let (mut flat, mut deep) = (TriangleMesh::default(), TriangleMesh::default());
        WALL.add_flat(&mut flat);
        WALL.add_with_windows(&mut deep, FacadeLook::Stone, Floor::Upper, |_| false);
        assert!((area_and_normals(&flat).0 - 6.0 * 3.2).abs() < 1e-4);
        // Two windows of 0.28 x 0.6 of a bay of 3 m and a floor of 3.2 m, 0.24 m deep.
        let reveals_m2 = 2.0 * 2.0 * (0.28 * 3.0 + 0.6 * 3.2) * 0.24;
        let (area_m2, normals) = area_and_normals(&deep);
        assert!((area_m2 - 6.0 * 3.2 - reveals_m2).abs() < 1e-4, "{area_m2}");
        // Seen from before the wall, nothing is turned away, and all of the front is there.
        assert!(normals.iter().all(|normal| normal.y <= 1e-5), "{normals:?}");
        let front_m2: f64 = normals.iter().map(|normal| -f64::from(normal.y) / 2.0).sum();
        assert!((front_m2 - 6.0 * 3.2).abs() < 1e-4);
        let depths = deep.corners().into_iter().flatten().map(|at| at.y);
        assert!((depths.fold(f32::MIN, f32::max) - 5.24).abs() < 1e-5);
        // Reveals face the middle of their window.
        let reveals = deep.corners().into_iter().filter(|[a, b, c]| (b - a).cross(&(c - a)).y.abs() < 1e-6);
        for [a, b, c] in reveals {
            let window = if a.x < 5.0 { Point3::new(3.5, a.y, 2.6) } else { Point3::new(6.5, a.y, 2.6) };
            let to_middle = window - nalgebra::center(&a, &nalgebra::center(&b, &c));
            assert!((b - a).cross(&(c - a)).dot(&to_middle) > 0.0, "{a} {b} {c}");
        }
    }

    #[test]
    fn a_house_near_the_route_has_deep_windows_below_and_not_at_its_back() {
        let building = Building {
            footprint: Footprint { center: Vec2::zeros(), yaw_rad: 0.0, length_m: 12.0, width_m: 9.0 },
            n_floors: 4,
            facade: 0,
            roof_color: 0,
            roof: Roof::Flat,
            balconies: Vec::new(),
            annex: None,
        };
        let walls = |is_close: bool| {
            let mut meshes = BuildingMeshes {
                facades: vec![TriangleMesh::default()],
                ground_floors: vec![TriangleMesh::default()],
                blank: vec![TriangleMesh::default()],
                ..BuildingMeshes::default()
            };
            meshes.add_walls(&building, [-0.5, 0.0], FacadeLook::Stone, is_close);
            [meshes.ground_floors, meshes.facades].map(|mut meshes| meshes.remove(0).corners())
        };
        let top_m =
            |corners: &[[Point3<f32>; 3]]| corners.iter().flatten().map(|at| at.z).fold(0.0, f32::max);
        let ([near_ground, near], [far_ground, far]) = (walls(true), walls(false));
        assert!(
            (top_m(&near) - top_m(&far)).abs() < 1e-5
                && (f64::from(top_m(&near)) - building.height_m()).abs() < 1e-4
        );
        // The front is at -4.5, the back at 4.5, the ends at -6 and 6.
        let lies_back = |corners: &[[Point3<f32>; 3]]| -> Vec<Point3<f32>> {
            let is_inside = |at: &Point3<f32>| at.x.abs() < 5.99 && at.y.abs() < 4.49;
            corners.iter().flatten().copied().filter(is_inside).collect()
        };
        assert!(lies_back(&far).is_empty() && lies_back(&far_ground).is_empty());
        let (deep, shops) = (lies_back(&near), lies_back(&near_ground));
        assert!(!shops.is_empty() && deep.iter().all(|at| at.y < 0.0 || at.x.abs() > 5.0), "{deep:?}");
        // Two floors of four.
        let highest_m = deep.iter().map(|at| f64::from(at.z)).fold(0.0, f64::max);
        let floors_m = GROUND_FLOOR_M + f64::from(FLOORS_IN_SIGHT) * FLOOR_M;
        assert!(highest_m > floors_m - FLOOR_M && highest_m < floors_m, "{highest_m}");
    }

    #[test]
    fn a_plain_bay_stays_a_plane() {
        let mut mesh = TriangleMesh::default();
        WALL.add_with_windows(&mut mesh, FacadeLook::House, Floor::Ground, |bay| bay == 0);
        assert!(mesh.corners().into_iter().flatten().all(|at| at.x > 5.0 || at.y == 5.0));
        assert!(mesh.corners().into_iter().flatten().any(|at| at.y > 5.1));
    }
}
