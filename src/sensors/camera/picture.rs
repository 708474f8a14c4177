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
        let bytes = self.pixels.as_flattened().iter().map(|channel| byte(*channel)).collect();
        RgbImage::from_raw(self.width as u32, self.height as u32, bytes).expect("three bytes a pixel")
    }
}

/// The rays through all pixels' centres, at depth 1 in the camera frame.
#[derive(Debug, Clone)]
pub(super) struct Rays {
    /// x of each column, and y of each row.
    across: Vec<f32>,
    pub down: Vec<f32>,
    /// Length of each pixel's ray.
    pub stretch: Vec<f32>,
}

impl Rays {
    pub(super) fn new(intrinsics: &Pinhole) -> Self {
        let slopes = |n: u32, middle_px: f64, focal_px: f64| -> Vec<f64> {
            (0..n).map(|i| (f64::from(i) + 0.5 - middle_px) / focal_px).collect()
        };
        let across = slopes(intrinsics.width_px, intrinsics.cx_px, intrinsics.fx_px);
        let down = slopes(intrinsics.height_px, intrinsics.cy_px, intrinsics.fy_px);
        let length = |x: f64, y: f64| (x * x + y * y + 1.0).sqrt() as f32;
        let stretch = down.iter().flat_map(|&y| across.iter().map(move |&x| length(x, y))).collect();
        let short = |slopes: Vec<f64>| slopes.into_iter().map(|slope| slope as f32).collect();
        Self { across: short(across), down: short(down), stretch }
    }
}

/// The rays of one picture.
#[derive(Debug, Clone)]
pub(super) struct View<'a> {
    pub intrinsics: &'a Pinhole,
    pub rays: &'a Rays,
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
        rays: &'a Rays,
    ) -> Self {
        let world_from_camera = pose.isometry.rotation.to_rotation_matrix().matrix().cast::<f32>();
        let camera_in_world = pose.isometry.translation.vector;
        let camera_from_ego = ego_from_camera.isometry.inverse();
        Self { intrinsics, rays, world_from_camera, camera_in_world, pose, camera_from_ego }
    }

    pub(super) fn width(&self) -> usize {
        self.intrinsics.width_px as usize
    }

    /// The ray through a pixel's centre at depth 1, in the camera frame.
    pub(super) fn ray_in_camera(&self, u: usize, v: usize) -> Vector3<f32> {
        Vector3::new(self.rays.across[u], self.rays.down[v], 1.0)
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

/// A display value in 8 bits; by way of i32, for which there are vector instructions.
pub(super) fn byte(channel: f32) -> u8 {
    (channel.clamp(0.0, 1.0) * 255.0 + 0.5) as i32 as u8
}

pub(super) fn mix(a: Colour, b: Colour, share: f32) -> Colour {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * share)
}

pub(super) fn scale(colour: Colour, factor: f32) -> Colour {
    colour.map(|c| c * factor)
}
