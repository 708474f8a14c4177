//! The picture while it is worked on, and the rays of its pixels.

use image::RgbImage;
use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::geometry::{Camera, Ego, Pinhole, Transform, World};

/// A colour, red, green, blue, 0 to 1.
pub(super) type Colour = [f32; 3];

/// Display-referred colours, rows from the top.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<Colour>,
}

impl Picture {
    pub(super) fn of(image: &RgbImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let (channels, _) = image.as_raw().as_chunks::<3>();
        let pixels = channels.iter().map(|pixel| pixel.map(|c| f32::from(c) / 255.0)).collect();
        Self { width, height, pixels }
    }

    pub(super) fn to_image(&self) -> RgbImage {
        let bytes = self.pixels.as_flattened().iter().map(|c| (c * 255.0 + 0.5) as u8).collect();
        RgbImage::from_raw(self.width as u32, self.height as u32, bytes).expect("three bytes a pixel")
    }
}

/// Length of each pixel's ray for a depth of 1.
pub(super) fn ray_lengths(intrinsics: &Pinhole) -> Vec<f32> {
    let rows = 0..intrinsics.height_px;
    let length = |u: u32, v: u32| {
        let x = (f64::from(u) + 0.5 - intrinsics.cx_px) / intrinsics.fx_px;
        let y = (f64::from(v) + 0.5 - intrinsics.cy_px) / intrinsics.fy_px;
        (x * x + y * y + 1.0).sqrt() as f32
    };
    rows.flat_map(|v| (0..intrinsics.width_px).map(move |u| (u, v))).map(|(u, v)| length(u, v)).collect()
}

/// The rays of one picture.
#[derive(Debug, Clone)]
pub(super) struct View<'a> {
    pub intrinsics: &'a Pinhole,
    /// Length of each pixel's ray for a depth of 1.
    pub stretch: &'a [f32],
    world_from_camera: Matrix3<f32>,
    pub camera_in_world: Vector3<f64>,
    pub pose: &'a Transform<World, Camera>,
    pub camera_from_ego: Isometry3<f64>,
}

impl<'a> View<'a> {
    pub(super) fn new(
        intrinsics: &'a Pinhole,
        ego_from_camera: &Transform<Ego, Camera>,
        pose: &'a Transform<World, Camera>,
        stretch: &'a [f32],
    ) -> Self {
        let world_from_camera = pose.isometry.rotation.to_rotation_matrix().matrix().cast::<f32>();
        let camera_in_world = pose.isometry.translation.vector;
        let camera_from_ego = ego_from_camera.isometry.inverse();
        Self { intrinsics, stretch, world_from_camera, camera_in_world, pose, camera_from_ego }
    }

    pub(super) fn width(&self) -> usize {
        self.intrinsics.width_px as usize
    }

    /// The ray through a pixel's centre at depth 1, in the camera frame.
    pub(super) fn ray_in_camera(&self, u: usize, v: usize) -> Vector3<f32> {
        Vector3::new(
            ((u as f64 + 0.5 - self.intrinsics.cx_px) / self.intrinsics.fx_px) as f32,
            ((v as f64 + 0.5 - self.intrinsics.cy_px) / self.intrinsics.fy_px) as f32,
            1.0,
        )
    }

    /// The ray through a pixel's centre at depth 1, along the world's axes.
    pub(super) fn ray_in_world(&self, u: usize, v: usize) -> Vector3<f32> {
        self.world_from_camera * self.ray_in_camera(u, v)
    }

    /// A direction of the world along the camera's axes.
    pub(super) fn in_camera(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        self.world_from_camera.tr_mul(direction)
    }
}

pub(super) fn mix(a: Colour, b: Colour, share: f32) -> Colour {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * share)
}

pub(super) fn scale(colour: Colour, factor: f32) -> Colour {
    colour.map(|c| c * factor)
}
