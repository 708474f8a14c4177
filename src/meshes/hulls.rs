//! Convex hulls of a shape, by V-HACD (Mamou 2016) as parry has it.

use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::transformation::try_convex_hull;
use parry3d::transformation::vhacd::{VHACD, VHACDParameters};
use parry3d::transformation::voxelization::FillMode;

use super::MeshPart;

/// A convex solid, in metres.
#[derive(Debug, Clone)]
pub struct Hull {
    pub points: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    pub volume_m3: f64,
}

/// Most hulls of one shape.
const MOST_HULLS: u32 = 8;
/// A closed surface that fills this share of its convex hull needs no other.
const CONVEX_SHARE: f64 = 0.9;
/// What is thinner is a box for the physics.
const THIN_M: f32 = 0.01;

/// The hulls of the parts together; a closed surface is filled, an open one is a shell.
pub(super) fn hulls(parts: &[MeshPart], is_closed: bool) -> Vec<Hull> {
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let first = points.len() as u32;
        points.extend(part.positions.iter().map(|&[x, y, z]| Vector::new(x, y, z)));
        triangles.extend(part.triangles.iter().map(|triangle| triangle.map(|corner| first + corner)));
    }
    let low = points.iter().copied().reduce(Vector::min).unwrap_or_default();
    let high = points.iter().copied().reduce(Vector::max).unwrap_or_default();
    let size = high - low;
    if size.min_element() > THIN_M {
        if is_closed && let Ok((hull_points, hull_triangles)) = try_convex_hull(&points) {
            let places = |points: &[Vector]| points.iter().map(Vector::to_array).collect::<Vec<_>>();
            let hull_points = places(&hull_points);
            let volume_m3 = volume(&hull_points, &hull_triangles);
            if volume(&places(&points), &triangles) > CONVEX_SHARE * volume_m3 {
                return vec![Hull { points: hull_points, triangles: hull_triangles, volume_m3 }];
            }
        }
        let fill_mode =
            if is_closed { FillMode::FloodFill { detect_cavities: false } } else { FillMode::SurfaceOnly };
        let parameters = VHACDParameters {
            max_convex_hulls: MOST_HULLS,
            concavity: 0.03,
            fill_mode,
            // The approximation takes a third of the time, and parry 0.31 panics in it on points that lie nearly on a hull.
            convex_hull_approximation: false,
            ..VHACDParameters::default()
        };
        let parts = VHACD::decompose(&parameters, &points, &triangles, false).compute_convex_hulls(1);
        let hulls: Vec<Hull> = parts
            .into_iter()
            .map(|(points, triangles)| {
                // Voxels reach beyond the surface by up to one of their sides.
                let points: Vec<[f32; 3]> =
                    points.iter().map(|point| point.clamp(low, high).to_array()).collect();
                let volume_m3 = volume(&points, &triangles);
                Hull { points, triangles, volume_m3 }
            })
            .filter(|hull| hull.volume_m3 > 1e-7)
            .collect();
        if !hulls.is_empty() {
            return hulls;
        }
    }
    vec![bounding_box(low, high)]
}

/// The box around all, at least as thick as the physics needs.
fn bounding_box(low: Vector, high: Vector) -> Hull {
    let high = low + (high - low).max(Vector::splat(THIN_M));
    let corner = |i: u32| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        [pick(0), pick(1), pick(2)]
    };
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let size = high - low;
    Hull {
        points: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        volume_m3: f64::from(size.x * size.y * size.z),
    }
}

/// By the divergence theorem: the sum of the tetrahedra under the faces.
fn volume(points: &[[f32; 3]], triangles: &[[u32; 3]]) -> f64 {
    let at = |corner: u32| Vector3::from(points[corner as usize]).cast::<f64>();
    let under = |&[a, b, c]: &[u32; 3]| at(a).dot(&at(b).cross(&at(c))) / 6.0;
    triangles.iter().map(under).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two boxes of 1 m³ that stand 1 m apart on a plate, as a part of one surface each.
    fn bench() -> Vec<MeshPart> {
        let solid = |low: [f32; 3], high: [f32; 3]| {
            let hull = bounding_box(Vector::from(low), Vector::from(high));
            MeshPart { positions: hull.points, triangles: hull.triangles, ..MeshPart::default() }
        };
        vec![
            solid([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
            solid([2.0, 0.0, 0.0], [3.0, 1.0, 1.0]),
            solid([0.0, 0.0, 1.0], [3.0, 1.0, 1.2]),
        ]
    }

    #[test]
    fn a_bench_is_not_filled_between_its_legs() {
        let hulls = hulls(&bench(), true);
        let total: f64 = hulls.iter().map(|hull| hull.volume_m3).sum();
        assert!(hulls.len() >= 3 && (2.4..3.0).contains(&total), "{} hulls of {total} m³", hulls.len());
        assert!((volume(&bench()[0].positions, &bench()[0].triangles) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn an_open_shape_whose_corners_nearly_meet_has_hulls() {
        let tetrahedron = MeshPart {
            positions: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
                [0.0, 0.0, 1.000_061],
            ],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4]],
            ..MeshPart::default()
        };
        let total: f64 = hulls(&[tetrahedron], false).iter().map(|hull| hull.volume_m3).sum();
        assert!((0.02..0.3).contains(&total), "{total} m³");
    }

    #[test]
    fn a_sheet_without_thickness_is_a_thin_box() {
        let sheet = MeshPart {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..MeshPart::default()
        };
        let hulls = hulls(&[sheet], false);
        assert_eq!(hulls.len(), 1);
        assert!((hulls[0].volume_m3 - f64::from(THIN_M)).abs() < 1e-6);
    }
}
