//! Buildings: what they are, and their meshes of whole bays and floors.

use super::annexes;
use super::looks::FacadeLook;
use super::mesh::TriangleMesh;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::roofs;
use super::town_config::TownConfig;

/// One tile of a facade texture: a bay's width and a floor's height.
pub const BAY_M: f64 = 3.0;
pub(super) const FLOOR_M: f64 = 3.2;
pub(super) const GROUND_FLOOR_M: f64 = 4.0;
/// Walls reach this far below the lowest ground at a building.
const FOOTING_M: f64 = 0.3;
const EAVES_M: f64 = 0.35;
const CORNICE_M: f64 = 0.35;
const SLAB_M: f64 = 0.14;
pub const RAILING_M: f64 = 1.0;

/// How a roof stands on the walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Roof {
    Flat,
    /// The ridge runs along the street, this high above the walls.
    Gable {
        rise_m: f64,
    },
    /// The ridge runs away from the street.
    GableFront {
        rise_m: f64,
    },
    /// One slope, its high side away from the street.
    Shed {
        rise_m: f64,
    },
    /// Teeth along the street, steep on one side.
    Sawtooth {
        rise_m: f64,
    },
}

/// A slab with railings on the front of a building.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balcony {
    /// Middle of the slab.
    pub center: Vec2,
    /// Height of the slab's top over the ground floor's level.
    pub z_m: f64,
    /// The direction in which it stands out.
    pub yaw_rad: f64,
    /// Size along the wall.
    pub width_m: f64,
    /// Size from the wall outwards.
    pub depth_m: f64,
}

/// A building.
#[derive(Debug, Clone)]
pub struct Building {
    /// Yaw along the street; the front is on the side of `-width`.
    pub footprint: Footprint,
    /// Above the ground floor.
    pub n_floors: u32,
    /// Index of the wall colour, which also chooses look and trim.
    pub facade: usize,
    /// Index of the roof colour.
    pub roof_color: usize,
    pub roof: Roof,
    pub balconies: Vec<Balcony>,
    /// A lower building against its back or side.
    pub annex: Option<Footprint>,
}

/// Floors above the ground floor in a building of some height.
pub fn n_floors_of(height_m: f64) -> u32 {
    ((height_m - GROUND_FLOOR_M) / FLOOR_M).round().max(0.0) as u32
}

impl Building {
    /// Height from the ground floor's level to the eaves.
    pub fn height_m(&self) -> f64 {
        GROUND_FLOOR_M + FLOOR_M * f64::from(self.n_floors)
    }

    /// The point `along_m` from the middle along the street and `out_m` in front of the front wall.
    pub fn before(&self, along_m: f64, out_m: f64) -> Vec2 {
        self.footprint.at(along_m, -self.footprint.width_m / 2.0 - out_m)
    }

    /// Balconies on bays of the upper floors that `wants` picks, `depth_m` deep.
    pub fn add_balconies(&mut self, mut wants: impl FnMut() -> bool, depth_m: f64) {
        let n_bays = (self.footprint.length_m / BAY_M).round() as u32;
        for bay in 0..n_bays {
            // A column of balconies: facades are built floor upon floor.
            if !wants() {
                continue;
            }
            let along_m = (f64::from(bay) + 0.5) * BAY_M - self.footprint.length_m / 2.0;
            for floor in 0..self.n_floors {
                self.balconies.push(Balcony {
                    center: self.before(along_m, depth_m / 2.0),
                    z_m: GROUND_FLOOR_M + FLOOR_M * f64::from(floor) + 0.1,
                    yaw_rad: self.footprint.yaw_rad - std::f64::consts::FRAC_PI_2,
                    width_m: 0.8 * BAY_M,
                    depth_m,
                });
            }
        }
    }

    /// Level of the ground floor: the ground's at the front, where the door is.
    pub fn base_m(&self, height_m: &impl Fn(Vec2) -> f64) -> f64 {
        let half_m = self.footprint.length_m / 2.0;
        [-half_m, 0.0, half_m]
            .map(|along_m| height_m(self.before(along_m, 0.0)))
            .into_iter()
            .fold(f64::MIN, f64::max)
    }
}

/// Meshes of all buildings near something: upper and ground floors by wall colour, roofs by theirs.
#[derive(Debug, Clone, Default)]
pub struct BuildingMeshes {
    pub facades: Vec<TriangleMesh>,
    pub ground_floors: Vec<TriangleMesh>,
    /// Gables and other walls without windows, by wall colour.
    pub blank: Vec<TriangleMesh>,
    pub roofs: Vec<TriangleMesh>,
    /// Slabs, cornices and chimneys.
    pub stone: TriangleMesh,
    pub railings: TriangleMesh,
    pub doors: TriangleMesh,
}

/// Builds the meshes of the buildings that `is_near` keeps, on a ground of some height; those that `is_close` keeps have
/// windows that lie back in their walls.
pub fn meshes(
    buildings: &[Building],
    config: &TownConfig,
    height_m: impl Fn(Vec2) -> f64,
    is_near: impl Fn(Vec2) -> bool,
    is_close: impl Fn(Vec2) -> bool,
) -> BuildingMeshes {
    let empty = |n: usize| vec![TriangleMesh::default(); n];
    let mut meshes = BuildingMeshes {
        facades: empty(config.wall_colors.len()),
        ground_floors: empty(config.wall_colors.len()),
        blank: empty(config.wall_colors.len()),
        roofs: empty(config.roof_colors.len()),
        stone: TriangleMesh::default(),
        railings: TriangleMesh::default(),
        doors: TriangleMesh::default(),
    };
    for building in buildings.iter().filter(|building| is_near(building.footprint.center)) {
        let base_m = building.base_m(&height_m);
        let lowest_m = lowest_of(&building.footprint, base_m, &height_m);
        let look = config.facades[building.facade % config.facades.len()];
        meshes.add_walls(building, [lowest_m, base_m], look, is_close(building.before(0.0, 0.0)));
        if look == FacadeLook::House {
            meshes.add_door(building, base_m);
        }
        meshes.add_roof(building, base_m + building.height_m());
        if let Some(annex) = &building.annex {
            let levels_m = [lowest_of(annex, base_m, &height_m), base_m];
            let surfaces = [&mut meshes.roofs[building.roof_color], &mut meshes.blank[building.facade]];
            annexes::add(surfaces, annex, levels_m);
        }
        for balcony in &building.balconies {
            meshes.add_balcony(balcony, base_m);
        }
    }
    meshes
}

/// Where a building's walls end in the ground.
fn lowest_of(footprint: &Footprint, base_m: f64, height_m: &impl Fn(Vec2) -> f64) -> f64 {
    let corners = footprint.corners().map(|at| height_m(Vec2::new(at.x_m, at.y_m)));
    corners.into_iter().fold(base_m, f64::min) - FOOTING_M
}

impl BuildingMeshes {
    fn add_door(&mut self, building: &Building, base_m: f64) {
        let (half_m, top_m) = (0.55, base_m + 2.3);
        let [left, right] = [-half_m, half_m].map(|along_m| building.before(along_m, 0.03));
        self.doors.add_polygon(&[
            ([left.x, left.y, base_m], [0.0, 0.0]),
            ([right.x, right.y, base_m], [1.0, 0.0]),
            ([right.x, right.y, top_m], [1.0, 1.0]),
            ([left.x, left.y, top_m], [0.0, 1.0]),
        ]);
        // A canopy over it, and a step before it.
        let (out, step) = (building.before(0.0, 0.5), building.before(0.0, 0.45));
        self.stone.add_box([out.x, out.y, top_m + 0.15], building.footprint.yaw_rad, [1.9, 1.0, 0.1]);
        self.stone.add_box([step.x, step.y, base_m - 0.1], building.footprint.yaw_rad, [1.5, 0.9, 0.3]);
    }

    fn add_roof(&mut self, building: &Building, top_m: f64) {
        let footprint = match building.roof {
            Roof::GableFront { .. } => &turned(&building.footprint),
            _ => &building.footprint,
        };
        let roof = &mut self.roofs[building.roof_color];
        if let Roof::Shed { rise_m } | Roof::Sawtooth { rise_m } = building.roof {
            let is_shed = matches!(building.roof, Roof::Shed { .. });
            let walls = &mut self.blank[building.facade];
            roofs::add([roof, walls], footprint, [top_m, rise_m], is_shed);
            return;
        }
        let (Roof::Gable { rise_m } | Roof::GableFront { rise_m }) = building.roof else {
            let corners = footprint.corners().map(|corner| [corner.x_m, corner.y_m]);
            roof.add_flat(&corners, top_m, 4.0);
            // A cornice along the top; its underside is seen from the street.
            let (sin, cos) = footprint.yaw_rad.sin_cos();
            let center = footprint.center - Vec2::new(-sin, cos) * (footprint.width_m / 2.0 + 0.08);
            let size = [footprint.length_m, 0.3, CORNICE_M];
            self.stone.add_box([center.x, center.y, top_m - CORNICE_M / 2.0 + 0.05], footprint.yaw_rad, size);
            return;
        };
        let (sin, cos) = footprint.yaw_rad.sin_cos();
        let (half_x, half_y) = (footprint.length_m / 2.0, footprint.width_m / 2.0);
        let at = |x: f64, y: f64, z: f64| {
            [footprint.center.x + x * cos - y * sin, footprint.center.y + x * sin + y * cos, z]
        };
        // Eaves hang over and so lie a little lower than the walls' tops.
        let drop_m = rise_m * EAVES_M / half_y;
        let (out_x, out_y) = (half_x + EAVES_M * 0.6, half_y + EAVES_M);
        let (eaves_m, ridge_m) = (top_m - drop_m + 0.02, top_m + rise_m + 0.02);
        let (n_along, n_up) = (2.0 * out_x / 3.0, rise_m.hypot(half_y) / 3.0);
        for side in [-1.0, 1.0] {
            roof.add_polygon(&[
                (at(side * -out_x, side * -out_y, eaves_m), [0.0, 0.0]),
                (at(side * out_x, side * -out_y, eaves_m), [n_along, 0.0]),
                (at(side * out_x, 0.0, ridge_m), [n_along, n_up]),
                (at(side * -out_x, 0.0, ridge_m), [0.0, n_up]),
            ]);
            // The underside of the eaves.
            roof.add_polygon(&[
                (at(side * out_x, side * -out_y, eaves_m - 0.01), [0.0, 0.0]),
                (at(side * -out_x, side * -out_y, eaves_m - 0.01), [n_along, 0.0]),
                (at(side * -out_x, side * -half_y, top_m - 0.01), [n_along, 0.1]),
                (at(side * out_x, side * -half_y, top_m - 0.01), [0.0, 0.1]),
            ]);
            self.blank[building.facade].add_polygon(&[
                (at(side * half_x, side * -half_y, top_m), [0.0, 0.0]),
                (at(side * half_x, side * half_y, top_m), [2.0 * half_y / BAY_M, 0.0]),
                (at(side * half_x, 0.0, top_m + rise_m), [half_y / BAY_M, rise_m / BAY_M]),
            ]);
        }
        if footprint.length_m < 25.0 {
            let chimney = at(half_x * 0.55, half_y * 0.25, top_m + rise_m * 0.9);
            self.stone.add_box(chimney, footprint.yaw_rad, [0.6, 0.6, 1.6]);
        }
    }

    fn add_balcony(&mut self, balcony: &Balcony, base_m: f64) {
        let (sin, cos) = balcony.yaw_rad.sin_cos();
        let (x, y, top_m) = (balcony.center.x, balcony.center.y, base_m + balcony.z_m);
        let size = [balcony.depth_m, balcony.width_m, SLAB_M];
        self.stone.add_box([x, y, top_m - SLAB_M / 2.0], balcony.yaw_rad, size);
        let at = |along: f64, across: f64, z: f64| {
            [x + along * cos - across * sin, y + along * sin + across * cos, z]
        };
        let (out_m, half_m) = (balcony.depth_m / 2.0 - 0.04, balcony.width_m / 2.0 - 0.04);
        // Left, front and right; seen from outside and, through the bars, from inside.
        let posts = [(-out_m, half_m), (out_m, half_m), (out_m, -half_m), (-out_m, -half_m)];
        for pair in posts.windows(2) {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            let n_bars = (x1 - x0).hypot(y1 - y0);
            let rail = [
                (at(x1, y1, top_m), [0.0, 0.0]),
                (at(x0, y0, top_m), [n_bars, 0.0]),
                (at(x0, y0, top_m + RAILING_M), [n_bars, 1.0]),
                (at(x1, y1, top_m + RAILING_M), [0.0, 1.0]),
            ];
            self.railings.add_polygon(&rail);
            let inside = [rail[1], rail[0], rail[3], rail[2]];
            self.railings.add_polygon(&inside);
        }
    }
}

/// The same rectangle, its length across the street.
fn turned(footprint: &Footprint) -> Footprint {
    Footprint {
        yaw_rad: footprint.yaw_rad + std::f64::consts::FRAC_PI_2,
        length_m: footprint.width_m,
        width_m: footprint.length_m,
        ..*footprint
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn house() -> Building {
        Building {
            footprint: Footprint {
                center: Vec2::new(10.0, 20.0),
                yaw_rad: 0.0,
                length_m: 12.0,
                width_m: 8.0,
            },
            n_floors: 2,
            facade: 0,
            roof_color: 0,
            roof: Roof::Gable { rise_m: 3.0 },
            balconies: Vec::new(),
            annex: None,
        }
    }

    #[test]
    fn balconies_stand_out_of_the_front_wall_on_each_upper_floor() {
        let mut house = house();
        let mut picks = [true, false, false, true].into_iter();
        house.add_balconies(|| picks.next().unwrap(), 1.0);
        assert_eq!(house.balconies.len(), 4);
        for balcony in &house.balconies {
            assert!((balcony.center.y - 15.5).abs() < 1e-12, "{balcony:?}");
            assert!((balcony.yaw_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        }
        assert!((house.balconies[0].center.x - 5.5).abs() < 1e-12);
        assert!((house.balconies[1].z_m - house.balconies[0].z_m - FLOOR_M).abs() < 1e-12);
    }

    #[test]
    fn the_ground_floor_is_level_with_the_highest_ground_at_the_front() {
        let base_m = house().base_m(&|at: Vec2| 0.1 * at.x + at.y);
        assert!((base_m - (1.6 + 16.0)).abs() < 1e-12, "{base_m}");
    }
}
