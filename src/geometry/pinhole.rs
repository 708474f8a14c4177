//! The pinhole camera: intrinsics in pixels, projection of points in the camera frame.

use super::frames::{Camera, Point};

/// Intrinsics of a rectified camera; pixel (0, 0) is the outer corner of the top left pixel.
///
/// ```
/// use harmzone::geometry::{Pinhole, Point};
///
/// let camera = Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians());
/// let straight_ahead = camera.project(&Point::new(0.0, 0.0, 10.0));
/// assert_eq!(straight_ahead, Some((400.0, 225.0)));
/// assert_eq!(camera.project(&Point::new(0.0, 0.0, -10.0)), None); // behind the camera
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    pub width_px: u32,
    pub height_px: u32,
    pub fx_px: f64,
    pub fy_px: f64,
    pub cx_px: f64,
    pub cy_px: f64,
}

impl Pinhole {
    /// Square pixels, principal point in the middle, `horizontal_fov_rad` from edge to edge.
    #[must_use]
    pub fn from_horizontal_fov(width_px: u32, height_px: u32, horizontal_fov_rad: f64) -> Self {
        let focal_px = f64::from(width_px) / 2.0 / (horizontal_fov_rad / 2.0).tan();
        Self {
            width_px,
            height_px,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: f64::from(width_px) / 2.0,
            cy_px: f64::from(height_px) / 2.0,
        }
    }

    /// Pixel `(u, v)` of a point, inside the image or not; `None` on or behind the image plane.
    #[must_use]
    pub fn project(&self, point_in_camera: &Point<Camera>) -> Option<(f64, f64)> {
        let depth_m = point_in_camera.z();
        (depth_m > 1e-6).then(|| {
            (
                self.cx_px + self.fx_px * point_in_camera.x() / depth_m,
                self.cy_px + self.fy_px * point_in_camera.y() / depth_m,
            )
        })
    }

    /// Whether a pixel lies in the image.
    #[must_use]
    pub fn contains(&self, u_px: f64, v_px: f64) -> bool {
        (0.0..f64::from(self.width_px)).contains(&u_px) && (0.0..f64::from(self.height_px)).contains(&v_px)
    }

    #[must_use]
    pub fn horizontal_fov_rad(&self) -> f64 {
        2.0 * (f64::from(self.width_px) / 2.0 / self.fx_px).atan()
    }

    #[must_use]
    pub fn vertical_fov_rad(&self) -> f64 {
        2.0 * (f64::from(self.height_px) / 2.0 / self.fy_px).atan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_the_edge_of_the_view_falls_on_the_edge_of_the_image() {
        let camera = Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians());
        let (u, v) = camera.project(&Point::new(10.0 * 35f64.to_radians().tan(), 0.0, 10.0)).unwrap();
        assert!((u - 800.0).abs() < 1e-9 && (v - 225.0).abs() < 1e-9);
        assert!((camera.horizontal_fov_rad() - 70f64.to_radians()).abs() < 1e-12);
    }

    #[test]
    fn a_point_behind_the_camera_has_no_pixel() {
        assert!(Pinhole::from_horizontal_fov(800, 450, 1.2).project(&Point::new(0.0, 0.0, -1.0)).is_none());
    }
}
