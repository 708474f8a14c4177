//! Large things that a `town.toml` puts at places of its own: cranes, stacks of containers, ships, silos, a church.
//!
//! Part of the static scene, as buildings are. Each takes the ground of its footprint.

use rand::RngExt;

use super::looks::LandmarkLook;
use super::mesh::TriangleMesh;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::shapes::{Site, rectangle, round};
use super::town_parts::LandmarkConfig;
use crate::random::{self, Rng};

/// An ISO container of 20 and of 40 feet: length; both share width and height (ISO 668).
const CONTAINER_LENGTHS_M: [f64; 2] = [6.06, 12.19];
const CONTAINER_WIDTH_M: f64 = 2.44;
const CONTAINER_HEIGHT_M: f64 = 2.59;
/// Between neighbours in a stack.
const CONTAINER_GAP_M: f64 = 0.12;

/// Length and width.
fn size_m(look: LandmarkLook) -> [f64; 2] {
    match look {
        LandmarkLook::QuayCrane => [15.0, 7.5],
        LandmarkLook::GantryCrane => [25.0, 14.0],
        LandmarkLook::Containers => [24.8, 7.6],
        LandmarkLook::Ship => [62.0, 11.0],
        LandmarkLook::Silos => [28.0, 8.6],
        LandmarkLook::Church => [25.0, 10.0],
    }
}

/// A landmark at its place.
#[derive(Debug, Clone)]
pub struct Landmark {
    pub look: LandmarkLook,
    pub footprint: Footprint,
    /// Chooses among what it may look like.
    seed: u64,
}

/// What its parts are made of; names and colours of the materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cladding {
    Container(usize),
    CraneSteel,
    DarkSteel,
    Hull,
    White,
    Concrete,
    Masonry,
    Slate,
    Dark,
}

/// Colours of containers.
pub const CONTAINER_COLORS: [[u8; 3]; 6] =
    [[152, 62, 42], [38, 84, 132], [196, 142, 44], [64, 110, 78], [150, 152, 150], [104, 48, 40]];
const N_FINISHES: usize = CONTAINER_COLORS.len() + 8;

impl Cladding {
    fn index(self) -> usize {
        let n = CONTAINER_COLORS.len();
        match self {
            Self::Container(color) => color % n,
            Self::CraneSteel => n,
            Self::DarkSteel => n + 1,
            Self::Hull => n + 2,
            Self::White => n + 3,
            Self::Concrete => n + 4,
            Self::Masonry => n + 5,
            Self::Slate => n + 6,
            Self::Dark => n + 7,
        }
    }

    pub fn all() -> impl Iterator<Item = Self> {
        let others = [
            Self::CraneSteel,
            Self::DarkSteel,
            Self::Hull,
            Self::White,
            Self::Concrete,
            Self::Masonry,
            Self::Slate,
            Self::Dark,
        ];
        (0..CONTAINER_COLORS.len()).map(Self::Container).chain(others)
    }
}

/// Meshes of landmarks by cladding.
#[derive(Debug, Clone)]
pub struct LandmarkMeshes([TriangleMesh; N_FINISHES]);

impl Default for LandmarkMeshes {
    fn default() -> Self {
        Self(std::array::from_fn(|_| TriangleMesh::default()))
    }
}

impl LandmarkMeshes {
    pub fn of(&self, cladding: Cladding) -> &TriangleMesh {
        &self.0[cladding.index()]
    }

    fn get(&mut self, cladding: Cladding) -> &mut TriangleMesh {
        &mut self.0[cladding.index()]
    }

    /// Two different claddinges at once.
    fn pair(&mut self, a: Cladding, b: Cladding) -> [&mut TriangleMesh; 2] {
        self.0.get_disjoint_mut([a.index(), b.index()]).expect("the two claddinges differ")
    }

    /// A stack of containers on a site: `n` along, across and at most upwards.
    pub fn add_stack(&mut self, site: &Site, n: [usize; 3], is_long: bool, rng: &mut Rng) {
        let length_m = CONTAINER_LENGTHS_M[usize::from(is_long)];
        let step = [length_m, CONTAINER_WIDTH_M].map(|side_m| side_m + CONTAINER_GAP_M);
        for i in 0..n[0] {
            // A column falls or rises by one from its neighbour.
            let mut high = rng.random_range(1..=n[2]);
            for j in 0..n[1] {
                high = (high + rng.random_range(0..3)).saturating_sub(1).clamp(1, n[2]);
                let middle = |k: usize, n: usize| k as f64 - (n as f64 - 1.0) / 2.0;
                let (x, y) = (middle(i, n[0]) * step[0], middle(j, n[1]) * step[1]);
                for level in 0..high {
                    let z = (level as f64 + 0.5) * CONTAINER_HEIGHT_M;
                    let shift = 0.06 * (rng.random::<f64>() - 0.5);
                    let mesh = self.get(Cladding::Container(rng.random_range(0..CONTAINER_COLORS.len())));
                    site.add_box(
                        mesh,
                        [x + shift, y, z],
                        [length_m, CONTAINER_WIDTH_M, CONTAINER_HEIGHT_M - 0.03],
                    );
                }
            }
        }
    }

    /// Adds a landmark whose ground is at a height, over water at another.
    pub fn add(&mut self, landmark: &Landmark, ground_m: f64, water_m: f64) {
        let mut rng = random::stream(landmark.seed, "landmark", 0);
        let site = Site { footprint: landmark.footprint, base_m: ground_m };
        match landmark.look {
            LandmarkLook::QuayCrane => self.add_quay_crane(&site),
            LandmarkLook::GantryCrane => {
                self.add_gantry(&site);
                self.add_stack(&site, [2, 3, 3], true, &mut rng);
            }
            LandmarkLook::Containers => self.add_stack(&site, [2, 3, 4], true, &mut rng),
            LandmarkLook::Ship => self.add_ship(&Site { base_m: water_m, ..site }, &mut rng),
            LandmarkLook::Silos => self.add_silos(&site),
            LandmarkLook::Church => self.add_church(&site),
        }
    }

    fn add_quay_crane(&mut self, site: &Site) {
        const PORTAL_M: f64 = 15.0;
        const BOOM_M: f64 = 20.0;
        let steel = self.get(Cladding::CraneSteel);
        for x in [-6.0, 6.0] {
            for y in [-3.4, 3.4] {
                site.add_beam(steel, [x, y, 0.4], [x * 0.8, y, BOOM_M], 0.7);
            }
            site.add_beam(steel, [x * 0.86, -3.4, PORTAL_M], [x * 0.86, 3.4, PORTAL_M], 0.6);
            site.add_beam(steel, [x, -3.4, 3.2], [x * 0.86, 3.4, PORTAL_M - 2.0], 0.35);
        }
        for (y, z) in [(-3.4, PORTAL_M), (3.4, PORTAL_M), (-3.4, 3.2), (3.4, 3.2)] {
            site.add_beam(steel, [-5.6, y, z], [5.6, y, z], 0.6);
        }
        // The boom, its ties and the tower that holds them.
        for x in [-1.6, 1.6] {
            site.add_beam(steel, [x, -14.0, BOOM_M], [x, 34.0, BOOM_M], 0.8);
            site.add_beam(steel, [x * 2.6, 3.4, BOOM_M], [x * 0.4, 3.0, 33.0], 0.5);
            site.add_beam(steel, [x * 0.4, 3.0, 33.0], [x, 31.0, BOOM_M], 0.22);
            site.add_beam(steel, [x * 0.4, 3.0, 33.0], [x, 18.0, BOOM_M], 0.18);
            site.add_beam(steel, [x * 0.4, 3.0, 33.0], [x, -12.0, BOOM_M], 0.22);
        }
        for n in 0..9 {
            let y = -13.0 + 5.8 * f64::from(n);
            site.add_beam(steel, [-1.6, y, BOOM_M], [1.6, y, BOOM_M], 0.35);
        }
        let dark = self.get(Cladding::DarkSteel);
        for x in [-6.0, 6.0] {
            for y in [-3.4, 3.4] {
                site.add_box(dark, [x, y, 0.45], [3.0, 0.7, 0.9]);
            }
        }
        site.add_box(dark, [0.0, 14.0, BOOM_M - 6.0], [6.1, 2.4, 0.5]);
        for x in [-1.2, 1.2] {
            site.add_beam(dark, [x, 14.0, BOOM_M - 6.0], [x, 14.0, BOOM_M], 0.06);
        }
        let white = self.get(Cladding::White);
        site.add_box(white, [0.0, -8.0, BOOM_M + 2.0], [4.4, 8.0, 3.4]);
        site.add_box(white, [0.0, 11.0, BOOM_M - 1.8], [2.0, 2.2, 2.2]);
    }

    fn add_gantry(&mut self, site: &Site) {
        let steel = self.get(Cladding::CraneSteel);
        let (half_m, side_m, high_m) = (3.6, 6.2, 12.5);
        for x in [-half_m, half_m] {
            for y in [-side_m, side_m] {
                site.add_beam(steel, [x, y, 0.8], [x * 0.7, y, high_m], 0.55);
            }
            site.add_beam(steel, [x * 0.7, -side_m - 1.0, high_m], [x * 0.7, side_m + 1.0, high_m], 0.9);
        }
        for y in [-side_m, side_m] {
            site.add_beam(steel, [-half_m - 0.8, y, 1.2], [half_m + 0.8, y, 1.2], 0.6);
            site.add_beam(steel, [-half_m * 0.7, y, high_m], [half_m * 0.7, y, high_m], 0.6);
        }
        let dark = self.get(Cladding::DarkSteel);
        for x in [-half_m - 0.3, half_m + 0.3] {
            for y in [-side_m, side_m] {
                site.add_box(dark, [x, y, 0.5], [1.5, 0.6, 1.0]);
            }
        }
        site.add_box(dark, [0.0, 1.5, high_m - 3.0], [6.1, 2.4, 0.5]);
        site.add_box(self.get(Cladding::White), [0.0, 1.5, high_m + 0.9], [3.6, 2.6, 1.8]);
    }

    fn add_ship(&mut self, site: &Site, rng: &mut Rng) {
        let deck_m = 3.4;
        // From the stern round the bow.
        let outline = [[-30.0, -5.2], [19.0, -5.2], [27.0, -3.2], [31.0, 0.0], [27.0, 3.2], [19.0, 5.2]];
        let outline: Vec<[f64; 2]> = outline.into_iter().chain([[-30.0, 5.2]]).collect();
        site.add_prism(self.get(Cladding::Hull), &outline, [-1.5, deck_m]);
        let bow = [[20.0, -5.0], [27.0, -3.1], [30.8, 0.0], [27.0, 3.1], [20.0, 5.0]];
        site.add_prism(self.get(Cladding::Hull), &bow, [deck_m, deck_m + 1.6]);
        let white = self.get(Cladding::White);
        site.add_box(white, [-23.0, 0.0, deck_m + 4.0], [9.0, 9.6, 8.0]);
        site.add_box(white, [-22.0, 0.0, deck_m + 9.3], [6.0, 10.4, 2.6]);
        let dark = self.get(Cladding::Dark);
        site.add_box(dark, [-18.95, 0.0, deck_m + 9.6], [0.2, 9.4, 1.0]);
        for level in 0..2 {
            for y in [-3.0, -1.0, 1.0, 3.0] {
                site.add_box(dark, [-18.47, y, deck_m + 2.4 + 3.0 * f64::from(level)], [0.1, 0.7, 0.7]);
            }
        }
        let steel = self.get(Cladding::DarkSteel);
        site.add_beam(steel, [-25.5, 0.0, deck_m + 8.0], [-25.5, 0.0, deck_m + 14.5], 1.6);
        site.add_beam(steel, [18.5, 0.0, deck_m], [18.5, 0.0, deck_m + 11.0], 0.5);
        site.add_box(steel, [0.0, 0.0, deck_m + 0.6], [33.0, 8.6, 1.2]);
        let cargo = Site { base_m: site.base_m + deck_m + 1.2, ..*site };
        self.add_stack(&cargo, [2, 3, 2], true, rng);
    }

    fn add_silos(&mut self, site: &Site) {
        for (n, x) in [-9.0, 0.0, 9.0].into_iter().enumerate() {
            let wall = round([x, 0.0], 4.2, 18);
            let high_m = 17.0 + n as f64;
            site.add_prism(self.get(Cladding::Concrete), &wall, [-0.3, high_m]);
            site.add_spire(self.get(Cladding::White), &wall, [high_m, high_m + 1.8], [x, 0.0]);
        }
        let steel = self.get(Cladding::DarkSteel);
        site.add_beam(steel, [-9.0, 0.0, 20.4], [9.0, 0.0, 20.4], 0.9);
        site.add_beam(steel, [-13.4, 0.0, -0.3], [-13.4, 0.0, 20.4], 0.9);
        site.add_beam(steel, [-13.4, 0.0, 20.4], [-9.0, 0.0, 20.4], 0.9);
    }

    fn add_church(&mut self, site: &Site) {
        const WALL_M: f64 = 7.0;
        const TOWER_M: f64 = 16.5;
        let (nave, tower) = ([3.0, 0.0], [-9.2, 0.0]);
        let masonry = self.get(Cladding::Masonry);
        site.add_prism(masonry, &rectangle(nave, [18.0, 8.8]), [-3.0, WALL_M]);
        site.add_prism(masonry, &rectangle(tower, [5.6, 5.6]), [-3.0, TOWER_M]);
        // Buttresses along the nave.
        for x in [-4.0, 0.5, 5.0, 9.5] {
            for side in [-1.0, 1.0] {
                site.add_box(masonry, [x, side * 4.7, 1.2], [0.7, 0.8, 8.4]);
            }
        }
        let roofs = self.pair(Cladding::Slate, Cladding::Masonry);
        site.add_gable(roofs, nave, [18.0, 8.8], [WALL_M, WALL_M + 5.8]);
        let eaves = rectangle(tower, [6.2, 6.2]);
        site.add_spire(self.get(Cladding::Slate), &eaves, [TOWER_M, TOWER_M + 9.0], tower);
        let dark = self.get(Cladding::Dark);
        for x in [-1.8, 2.8, 7.3] {
            for side in [-1.0, 1.0] {
                site.add_box(dark, [x, side * 4.38, 3.7], [1.0, 0.1, 3.2]);
            }
        }
        site.add_box(dark, [-12.0, 0.0, 1.4], [0.1, 1.6, 2.8]);
        // Louvres of the belfry on all four sides.
        for (x, y, size_m) in [
            (-12.0, 0.0, [0.1, 1.2, 2.4]),
            (-6.4, 0.0, [0.1, 1.2, 2.4]),
            (-9.2, -2.8, [1.2, 0.1, 2.4]),
            (-9.2, 2.8, [1.2, 0.1, 2.4]),
        ] {
            site.add_box(dark, [x, y, TOWER_M - 2.4], size_m);
        }
    }
}

/// The landmarks of a config, in its order.
pub fn place(configs: &[LandmarkConfig]) -> Vec<Landmark> {
    let landmark = |(seed, config): (usize, &LandmarkConfig)| {
        let [length_m, width_m] = size_m(config.look);
        let center = Vec2::new(config.center_m[0], config.center_m[1]);
        let yaw_rad = config.yaw_deg.to_radians();
        Landmark {
            look: config.look,
            footprint: Footprint { center, yaw_rad, length_m, width_m },
            seed: seed as u64,
        }
    };
    configs.iter().enumerate().map(landmark).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Landmark> {
        let looks = [
            LandmarkLook::QuayCrane,
            LandmarkLook::GantryCrane,
            LandmarkLook::Containers,
            LandmarkLook::Ship,
            LandmarkLook::Silos,
            LandmarkLook::Church,
        ];
        place(&looks.map(|look| LandmarkConfig { look, center_m: [10.0, 20.0], yaw_deg: 30.0 }))
    }

    #[test]
    fn landmarks_stand_on_their_footprints_up_to_the_height_of_a_car() {
        for landmark in all() {
            let mut meshes = LandmarkMeshes::default();
            meshes.add(&landmark, 5.0, 3.0);
            let mut n = 0;
            let triangles = Cladding::all().flat_map(|cladding| meshes.of(cladding).corners());
            for corner in triangles.flatten().filter(|corner| corner.z < 7.0) {
                let at = Vec2::new(f64::from(corner.x), f64::from(corner.y));
                assert!(landmark.footprint.grow(0.6).contains(at), "{:?}: {corner}", landmark.look);
                n += 1;
            }
            assert!(n > 20, "{:?}: {n}", landmark.look);
        }
    }

    #[test]
    fn the_same_place_in_the_config_gives_the_same_stack() {
        let of = |landmark: &Landmark| {
            let mut meshes = LandmarkMeshes::default();
            meshes.add(landmark, 0.0, 0.0);
            Cladding::all().map(|cladding| meshes.of(cladding).n_triangles()).collect::<Vec<_>>()
        };
        let (first, second) = (all(), all());
        assert_eq!(of(&first[2]), of(&second[2]));
        assert_ne!(of(&first[2]), of(&Landmark { seed: 77, ..first[2].clone() }));
    }
}
