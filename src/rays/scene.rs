//! A world's visible surfaces, ready for rays: what stands once, what moves as parts whose poses are set.

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::frustum::{Directions, Frustum, RAYS, Turn};
use super::packet::{First, Triangles, turn_rays};
use super::solid::Solid;
use super::tree::{Bounds, Stack, Tree};
use super::visible::{Visible, VisibleGeom};

/// Marks the numbers of things that are geoms; all others are triangles.
const IS_GEOM: u32 = 1 << 31;

/// The visible world, with all bodies at given poses.
#[derive(Debug, Clone)]
pub struct RayScene {
    pub(super) visible: Visible,
    /// Geom and face of each triangle.
    triangles: Vec<(u32, u32)>,
    /// All triangles of bodies that stand, in the world's frame.
    standing: Triangles,
    /// Bodies that move and round geoms.
    parts: Vec<Part>,
    planes: Vec<u32>,
    /// Parts by their boxes in the world.
    top: Tree,
    world_from_body: Vec<Isometry3<f64>>,
    pub(super) places: Vec<Place>,
}

/// Where a geom is in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub world_from_geom: Matrix3<f64>,
    pub position: Vector3<f64>,
}

#[derive(Debug, Clone)]
struct Part {
    body: usize,
    /// In the frame of the body.
    bounds: [Vector3<f64>; 2],
    surface: Surface,
}

#[derive(Debug, Clone)]
enum Surface {
    /// In the frame of the body.
    Triangles(Triangles),
    /// A round geom by its index.
    Round(u32),
}

/// The frame of a part or of a plane, as rays need it.
pub(super) struct Seat {
    turn: Turn,
    /// Where the rays come from.
    origin: [f32; 3],
}

/// Where packets of rays come from.
pub(super) struct Source {
    /// In the world.
    origin: [f32; 3],
    parts: Vec<Seat>,
    planes: Vec<Seat>,
}

impl RayScene {
    /// All bodies at the given poses, by body id; those that do not move stay there.
    ///
    /// # Panics
    /// If a geom's body or mesh, or a mesh's vertex, is not there.
    #[must_use]
    pub fn new(visible: Visible, world_from_body: &[Isometry3<f64>]) -> Self {
        let mut scene = Self {
            triangles: Vec::new(),
            standing: Triangles::default(),
            parts: Vec::new(),
            planes: Vec::new(),
            top: Tree::default(),
            world_from_body: Vec::new(),
            places: Vec::new(),
            visible,
        };
        let mut of_world = Vec::new();
        let mut of_bodies: Vec<Vec<usize>> = vec![Vec::new(); world_from_body.len()];
        for (index, geom) in scene.visible.geoms.iter().enumerate() {
            match &geom.solid {
                Solid::Plane { .. } => scene.planes.push(index as u32),
                Solid::Mesh(_) | Solid::Box { .. } if scene.visible.moves[geom.body] => {
                    of_bodies[geom.body].push(index);
                }
                Solid::Mesh(_) | Solid::Box { .. } => of_world.push(index),
                _ => scene.parts.extend(scene.part(&[index], Surface::Round(index as u32))),
            }
        }
        let world_from_geom = |geom: usize| {
            let geom = &scene.visible.geoms[geom];
            world_from_body[geom.body] * geom.body_from_geom
        };
        let mut triangles = Vec::new();
        scene.standing = gather(&scene.visible, &of_world, world_from_geom, &mut triangles);
        for geoms in of_bodies.into_iter().filter(|geoms| !geoms.is_empty()) {
            let body_from_geom = |geom: usize| scene.visible.geoms[geom].body_from_geom;
            let surface = gather(&scene.visible, &geoms, body_from_geom, &mut triangles);
            scene.parts.extend(scene.part(&geoms, Surface::Triangles(surface)));
        }
        scene.triangles = triangles;
        scene.set_poses(world_from_body);
        scene
    }

    /// `None` where the geoms are empty.
    fn part(&self, geoms: &[usize], surface: Surface) -> Option<Part> {
        let body = self.visible.geoms[geoms[0]].body;
        let extents = geoms.iter().filter_map(|&geom| {
            Some(turned_bounds(&self.visible.geoms[geom].body_from_geom, &self.visible.extent(geom)?))
        });
        let bounds = extents.reduce(|[low, high], [l, h]| [low.inf(&l), high.sup(&h)])?;
        Some(Part { body, bounds, surface })
    }

    /// Moves the bodies that move.
    ///
    /// # Panics
    /// If there are fewer poses than bodies.
    pub fn set_poses(&mut self, world_from_body: &[Isometry3<f64>]) {
        self.world_from_body = world_from_body.to_vec();
        let place = |geom: &VisibleGeom| {
            let pose = world_from_body[geom.body] * geom.body_from_geom;
            let world_from_geom = *pose.rotation.to_rotation_matrix().matrix();
            Place { world_from_geom, position: pose.translation.vector }
        };
        self.places = self.visible.geoms.iter().map(place).collect();
        let bounds_in_world = |part: &Part| -> Bounds {
            turned_bounds(&world_from_body[part.body], &part.bounds).map(|corner| corner.cast::<f32>().into())
        };
        let boxes: Vec<Bounds> = self.parts.iter().map(bounds_in_world).collect();
        self.top = Tree::new(&boxes, 1, &mut |members| members[0]);
    }

    /// Index of the geom that a thing belongs to, and its face.
    pub(super) fn geom_of(&self, thing: u32) -> (usize, usize) {
        if thing & IS_GEOM != 0 {
            return ((thing & !IS_GEOM) as usize, 0);
        }
        let (geom, face) = self.triangles[thing as usize];
        (geom as usize, face as usize)
    }

    pub(super) fn source(&self, origin: &Vector3<f64>) -> Source {
        let seat = |pose: &Isometry3<f64>| Seat::new(pose, origin);
        let parts = self.parts.iter().map(|part| seat(&self.world_from_body[part.body]));
        let planes = self.planes.iter().map(|&geom| {
            let geom = &self.visible.geoms[geom as usize];
            seat(&(self.world_from_body[geom.body] * geom.body_from_geom))
        });
        Source { origin: origin.cast::<f32>().into(), parts: parts.collect(), planes: planes.collect() }
    }

    /// Notes what the rays of a packet meet first, of which the first `n` differ.
    #[inline(always)]
    pub(super) fn cast_packet(
        &self,
        source: &Source,
        rays: &Directions,
        n: usize,
        stacks: &mut [Stack; 2],
        first: &mut First,
    ) {
        let frustum = Frustum::new(source.origin, rays, n);
        for (&geom, seat) in self.planes.iter().zip(&source.planes) {
            self.cast_plane(geom, seat, rays, first);
        }
        let [stack, inner] = stacks;
        self.standing.cast(source.origin, rays, &frustum, stack, first);
        let mut search = self.top.search(&frustum, stack);
        while let Some(part) = search.next(first.t_max * frustum.reach) {
            let seat = &source.parts[part as usize];
            let rays = turn_rays(&seat.turn, rays);
            match &self.parts[part as usize].surface {
                Surface::Triangles(triangles) => {
                    let frustum = frustum.turn(&seat.turn, seat.origin);
                    triangles.cast(seat.origin, &rays, &frustum, inner, first);
                }
                Surface::Round(geom) => self.cast_round(*geom, seat, &rays, first),
            }
        }
    }

    #[inline(always)]
    fn cast_plane(&self, geom: u32, seat: &Seat, rays: &Directions, first: &mut First) {
        let Solid::Plane { half } = self.visible.geoms[geom as usize].solid else { return };
        let half = half.map(|half| if half > 0.0 { half as f32 } else { f32::INFINITY });
        let [x, y, z] = turn_rays(&seat.turn, rays);
        let origin = seat.origin;
        let (mut t, mut is_met) = ([0.0; RAYS], [false; RAYS]);
        for ray in 0..RAYS {
            t[ray] = -origin[2] / z[ray];
            let at = [origin[0] + t[ray] * x[ray], origin[1] + t[ray] * y[ray]];
            is_met[ray] = (z[ray] < 0.0) & (at[0].abs() <= half[0]) & (at[1].abs() <= half[1]);
        }
        first.note(IS_GEOM | geom, &t, &is_met);
    }

    fn cast_round(&self, geom: u32, seat: &Seat, rays: &Directions, first: &mut First) {
        let VisibleGeomFrame { solid, geom_from_body } = self.frame(geom);
        let origin = geom_from_body.transform_point(&Vector3::from(seat.origin).cast::<f64>().into()).coords;
        let mut t = [f32::INFINITY; RAYS];
        for (ray, t) in t.iter_mut().enumerate() {
            let direction = Vector3::new(rays[0][ray], rays[1][ray], rays[2][ray]).cast::<f64>();
            if let Some((met, _)) = solid.meet(&origin, &(geom_from_body.rotation * direction)) {
                *t = met as f32;
            }
        }
        first.note(IS_GEOM | geom, &t, &t.map(f32::is_finite));
    }

    fn frame(&self, geom: u32) -> VisibleGeomFrame<'_> {
        let geom = &self.visible.geoms[geom as usize];
        VisibleGeomFrame { solid: &geom.solid, geom_from_body: geom.body_from_geom.inverse() }
    }
}

struct VisibleGeomFrame<'a> {
    solid: &'a Solid,
    geom_from_body: Isometry3<f64>,
}

impl Seat {
    fn new(world_from_frame: &Isometry3<f64>, origin: &Vector3<f64>) -> Self {
        let turn: Matrix3<f32> = world_from_frame.rotation.inverse().to_rotation_matrix().matrix().cast();
        let origin = world_from_frame.inverse_transform_point(&(*origin).into()).coords;
        Self {
            turn: [0, 1, 2].map(|row| [0, 1, 2].map(|column| turn[(row, column)])),
            origin: origin.cast().into(),
        }
    }
}

/// All triangles of geoms in one frame; notes each one's geom and face.
fn gather(
    visible: &Visible,
    geoms: &[usize],
    frame_from_geom: impl Fn(usize) -> Isometry3<f64>,
    noted: &mut Vec<(u32, u32)>,
) -> Triangles {
    let start = noted.len() as u32;
    let mut corners = Vec::new();
    for &geom in geoms {
        let pose = frame_from_geom(geom);
        for (face, triangle) in visible.triangles(geom).into_iter().enumerate() {
            noted.push((geom as u32, face as u32));
            corners.push(triangle.map(|at| (pose * nalgebra::Point3::from(at)).coords.cast::<f32>().into()));
        }
    }
    Triangles::new(&corners, start)
}

/// The box around a box that is turned and moved.
fn turned_bounds(pose: &Isometry3<f64>, [low, high]: &[Vector3<f64>; 2]) -> [Vector3<f64>; 2] {
    let center = pose.transform_point(&((low + high) / 2.0).into()).coords;
    let half = pose.rotation.to_rotation_matrix().matrix().abs() * ((high - low) / 2.0);
    [center - half, center + half]
}
