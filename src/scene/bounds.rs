//! Axis-aligned bounds of meshes.

use nalgebra::Point3;

/// Lowest and highest corner.
pub type Bounds = [Point3<f64>; 2];

/// Bounds of points; `None` without any.
pub(super) fn bounds_of(points: impl Iterator<Item = Point3<f32>>) -> Option<Bounds> {
    points.map(Point3::cast::<f64>).fold(None, |bounds, point| {
        let [low, high] = bounds.unwrap_or([point; 2]);
        Some([low.inf(&point), high.sup(&point)])
    })
}

/// Bounds of what is lower than a height, if that covers any ground.
pub(super) fn bounds_below(triangles: &[[Point3<f32>; 3]], limit_m: f64) -> Option<Bounds> {
    let limit = limit_m as f32;
    let edges = triangles.iter().flat_map(|triangle| [0, 1, 2].map(|i| (triangle[i], triangle[(i + 1) % 3])));
    let below = edges.flat_map(|(a, b)| {
        let is_cut = (a.z <= limit) != (b.z <= limit);
        let cut = is_cut.then(|| a + (b - a) * ((limit - a.z) / (b.z - a.z)));
        (a.z <= limit).then_some(a).into_iter().chain(cut)
    });
    bounds_of(below).filter(|[low, high]| low.x < high.x && low.y < high.y)
}
