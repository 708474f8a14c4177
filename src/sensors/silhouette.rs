//! How many pixels an object would cover if nothing stood before it.

use nalgebra::Point3;

use crate::geometry::{Camera, Pinhole, Point};

/// Parts nearer to the image plane than this are cut away.
const NEAR_M: f64 = 0.05;

/// Pixels whose centre lies inside the projection of any of the triangles, inside the image.
///
/// Triangles are in the camera frame; their winding does not matter. Without triangles the result is zero.
pub fn silhouette_px<'a>(
    triangles: impl IntoIterator<Item = &'a [Point3<f64>; 3]>,
    intrinsics: &Pinhole,
) -> u32 {
    let polygons: Vec<Polygon> = triangles
        .into_iter()
        .map(|triangle| project(triangle, intrinsics))
        .filter(|polygon| polygon.points().len() >= 3)
        .collect();
    let points = polygons.iter().flat_map(Polygon::points);
    let Some([low, high]) = bounds(points, intrinsics) else { return 0 };
    let width = high[0] - low[0];
    let mut covered = vec![false; width * (high[1] - low[1])];
    for polygon in polygons.iter().map(Polygon::points) {
        // Most triangles are small: only the rows that they reach are looked at.
        let (top, bottom) =
            polygon.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(top, bottom), point| {
                (top.min(point[1]), bottom.max(point[1]))
            });
        // Both cut to whole numbers, which for negative ones is upwards: those lie outside anyway.
        for row in low[1].max(top as usize)..high[1].min((bottom + 1.0) as usize) {
            let Some((from, to)) = span(polygon, row as f64 + 0.5) else { continue };
            // Pixel centres lie at half numbers.
            let first = ((from - 0.5).ceil().max(low[0] as f64)) as usize;
            let end = ((to - 0.5).ceil().min(high[0] as f64)).max(0.0) as usize;
            if first < end {
                let start = (row - low[1]) * width;
                covered[start + first - low[0]..start + end - low[0]].fill(true);
            }
        }
    }
    covered.iter().map(|&is_covered| u32::from(is_covered)).sum()
}

/// A triangle that a plane may have cut, in pixels.
#[derive(Default)]
struct Polygon {
    corners: [[f64; 2]; 4],
    n: usize,
}

impl Polygon {
    fn points(&self) -> &[[f64; 2]] {
        &self.corners[..self.n]
    }
}

/// The triangle's part before the near plane, in pixels.
fn project(triangle: &[Point3<f64>; 3], intrinsics: &Pinhole) -> Polygon {
    let mut polygon = Polygon::default();
    for i in 0..3 {
        let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
        let mut push = |point: Point3<f64>| {
            if let Some((u, v)) = intrinsics.project(&Point::<Camera>::from_coords(point)) {
                polygon.corners[polygon.n] = [u, v];
                polygon.n += 1;
            }
        };
        if a.z >= NEAR_M {
            push(a);
        }
        if (a.z >= NEAR_M) != (b.z >= NEAR_M) {
            push(a + (b - a) * ((NEAR_M - a.z) / (b.z - a.z)));
        }
    }
    polygon
}

/// First and end column and row of the points' box inside the image, if there is any.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 2]>, intrinsics: &Pinhole) -> Option<[[usize; 2]; 2]> {
    let size = [f64::from(intrinsics.width_px), f64::from(intrinsics.height_px)];
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for point in points {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let low = [0, 1].map(|axis| low[axis].floor().clamp(0.0, size[axis]) as usize);
    let high = [0, 1].map(|axis| high[axis].ceil().clamp(0.0, size[axis]) as usize);
    (low[0] < high[0] && low[1] < high[1]).then_some([low, high])
}

/// Where the line at height `v` enters and leaves a convex polygon.
fn span(polygon: &[[f64; 2]], v: f64) -> Option<(f64, f64)> {
    let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        if (a[1] <= v) != (b[1] <= v) {
            let u = a[0] + (b[0] - a[0]) * (v - a[1]) / (b[1] - a[1]);
            (from, to) = (from.min(u), to.max(u));
        }
    }
    (from < to).then_some((from, to))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 2 m facing the camera at 10 m: 2 / 10 * 80 px = 16 px a side.
    fn square(x_m: f64) -> [[Point3<f64>; 3]; 2] {
        let corner = |dx: f64, dy: f64| Point3::new(x_m + dx, dy, 10.0);
        let (a, b, c, d) = (corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0));
        [[a, b, c], [a, c, d]]
    }

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(160, 80, std::f64::consts::FRAC_PI_2)
    }

    #[test]
    fn a_square_covers_its_projected_area_and_overlaps_count_once() {
        assert_eq!(silhouette_px(&square(0.0), &camera()), 256);
        let twice: Vec<_> = square(0.0).into_iter().chain(square(0.0)).collect();
        assert_eq!(silhouette_px(&twice, &camera()), 256);
    }

    #[test]
    fn only_the_part_inside_the_image_counts() {
        // The image's edge is 10 m to the side at 10 m, so half of the square is inside.
        assert_eq!(silhouette_px(&square(10.0), &camera()), 128);
        assert_eq!(silhouette_px(&square(30.0), &camera()), 0);
    }

    #[test]
    fn what_reaches_behind_the_camera_is_cut_and_does_not_wrap() {
        let ground =
            [Point3::new(-50.0, 1.0, -10.0), Point3::new(50.0, 1.0, -10.0), Point3::new(0.0, 1.0, 90.0)];
        let covered = silhouette_px(&[ground], &camera());
        assert!(covered > 0 && covered < 160 * 40, "only below the horizon: {covered}");
    }
}
