//! Casts of a sensor's beams: the search in f32, then range and angle of what was found in f64.

use nalgebra::{Isometry3, Vector3};

use super::beams::Beams;
use super::frustum::{Directions, RAYS};
use super::packet::{First, NOTHING};
use super::scene::{Place, RayScene, Source};
use super::solid::{Meeting, Solid, meet_triangle};
use super::tree::Stack;

/// Hits of the f32 search may lie this much farther than their exact place, metres.
const REACH_MARGIN_M: f64 = 0.01;

/// What rays hit, ray by ray.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RayHits {
    /// Infinite where nothing is hit.
    pub range_m: Vec<f64>,
    /// -1 where nothing is hit.
    pub geom: Vec<i32>,
    /// Cosine of the angle between ray and surface normal, 0 to 1.
    pub cos_incidence: Vec<f64>,
}

impl RayScene {
    /// What the beams of a sensor at this pose hit first, beam by beam.
    #[must_use]
    pub fn cast(&self, world_from_sensor: &Isometry3<f64>, beams: &Beams, max_range_m: f64) -> RayHits {
        let origin = world_from_sensor.translation.vector;
        let turn = world_from_sensor.rotation.to_rotation_matrix();
        let directions: Vec<Vector3<f64>> =
            beams.directions.iter().map(|direction| turn * direction).collect();
        let things = pulp::Arch::new().dispatch(CastBeams {
            scene: self,
            source: &self.source(&origin),
            beams,
            directions: &directions,
            max_range_m,
        });
        let n = directions.len();
        let mut hits =
            RayHits { range_m: vec![f64::INFINITY; n], geom: vec![-1; n], cos_incidence: vec![0.0; n] };
        for (ray, (direction, thing)) in directions.iter().zip(things).enumerate() {
            let Some((geom, (t, normal))) = self.meet(thing, &origin, direction) else { continue };
            let length = direction.norm();
            if t * length <= max_range_m {
                hits.range_m[ray] = t * length;
                hits.geom[ray] = geom;
                hits.cos_incidence[ray] = (normal.dot(direction) / (normal.norm() * length)).abs().min(1.0);
            }
        }
        hits
    }

    /// Where exactly a ray meets a thing that the search has found, with the geom's id and the normal in the world.
    fn meet(&self, thing: u32, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(i32, Meeting)> {
        if thing == NOTHING {
            return None;
        }
        let (geom, face) = self.geom_of(thing);
        let Place { world_from_geom, position } = self.places[geom];
        let geom = &self.visible.geoms[geom];
        let origin = world_from_geom.tr_mul(&(origin - position));
        let direction = world_from_geom.tr_mul(direction);
        let (t, normal) = match geom.solid {
            Solid::Mesh(mesh) => meet_triangle(self.visible.face(mesh, face), &origin, &direction),
            Solid::Box { .. } => geom.solid.meet(&origin, &direction).or_else(|| {
                meet_triangle(self.visible.triangles(self.geom_of(thing).0)[face], &origin, &direction)
            }),
            _ => geom.solid.meet(&origin, &direction),
        }?;
        Some((geom.id, (t, world_from_geom * normal)))
    }
}

/// The things that beams meet first, beam by beam.
struct CastBeams<'a> {
    scene: &'a RayScene,
    source: &'a Source,
    beams: &'a Beams,
    /// In the world.
    directions: &'a [Vector3<f64>],
    max_range_m: f64,
}

impl pulp::WithSimd for CastBeams<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Vec<u32> {
        let mut things = vec![NOTHING; self.directions.len()];
        let mut stacks = [Stack::new(), Stack::new()];
        for packet in &self.beams.packets {
            let members = &self.beams.order[packet.clone()];
            let mut rays: Directions = [[0.0; RAYS]; 3];
            for lane in 0..RAYS {
                // The last one fills the rest.
                let direction = &self.directions[members[lane.min(members.len() - 1)] as usize];
                for axis in 0..3 {
                    rays[axis][lane] = direction[axis] as f32;
                }
            }
            let shortest =
                members.iter().map(|&ray| self.directions[ray as usize].norm()).fold(f64::INFINITY, f64::min);
            let t_max = (self.max_range_m + REACH_MARGIN_M) / shortest;
            let mut first = First::new(t_max as f32);
            self.scene.cast_packet(self.source, &rays, members.len(), &mut stacks, &mut first);
            for (&ray, thing) in members.iter().zip(first.thing) {
                things[ray as usize] = thing;
            }
        }
        things
    }
}

#[cfg(test)]
mod tests {
    use pulp::WithSimd;

    use super::*;
    use crate::rays::{Visible, VisibleGeom, VisibleMesh};

    #[test]
    fn every_instruction_set_finds_the_same() {
        let vertex = |i: u32| [0.7, 1.3, 2.1].map(|step| (f64::from(i) * step).sin() as f32 * 9.0);
        let mesh = VisibleMesh {
            vertices: (0..300).map(vertex).collect(),
            faces: (0..900).map(|i| [i % 300, i * 7 % 300, i * 13 % 300]).collect(),
        };
        let geom =
            VisibleGeom { id: 1, body: 0, body_from_geom: Isometry3::identity(), solid: Solid::Mesh(0) };
        let visible = Visible { geoms: vec![geom], meshes: vec![mesh], moves: vec![true] };
        let scene = RayScene::new(visible, &[Isometry3::identity()]);
        let ray = |i: i32| {
            Vector3::new((f64::from(i) * 0.1).cos(), (f64::from(i) * 0.1).sin(), f64::from(i % 7) * 0.1)
        };
        let beams = Beams::new(&(0..500).map(ray).collect::<Vec<_>>());
        let source = scene.source(&Vector3::zeros());
        let cast = || CastBeams {
            scene: &scene,
            source: &source,
            beams: &beams,
            directions: &beams.directions,
            max_range_m: 50.0,
        };
        let plain = cast().with_simd(pulp::Scalar);
        assert_eq!(pulp::Arch::new().dispatch(cast()), plain);
        assert!(plain.iter().filter(|&&thing| thing != NOTHING).count() > 100);
    }
}
