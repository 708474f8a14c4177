//! Where the cameras are mounted, and how they draw.

use crate::geometry::{Camera, Ego, Pinhole, Transform};

/// Renderer of the colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Renderer {
    /// OpenGL, on any machine.
    #[default]
    Classic,
    /// Physically based; needs the wheel `mujoco-studio` and Vulkan, and several times as long.
    Filament,
}

/// Cameras fixed to a body, and how they draw.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraMount {
    /// The body that carries them; the ego frame is that body's frame.
    pub body: String,
    /// Pose and intrinsics of each camera, at least one.
    pub cameras: Vec<(Transform<Ego, Camera>, Pinhole)>,
    /// Samples a pixel: 0 or 4 are usual.
    pub n_samples: u32,
    /// Side of the shadow map.
    pub shadow_size_px: u32,
    pub renderer: Renderer,
}
