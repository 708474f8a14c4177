//! One look of a model that changes its shape.

use std::sync::Arc;

use nalgebra::Point3;

/// What is seen of a model while it has this look.
#[derive(Debug, Clone)]
pub struct Shape {
    /// `<body>` children as MJCF text.
    pub(super) geoms_xml: String,
    pub triangles: Arc<Vec<[Point3<f32>; 3]>>,
}
