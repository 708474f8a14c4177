//! Memory of a training step, estimated from the config: main tensors, their shapes, and how many of each shape
//! autodiff keeps for the backward pass.
//!
//! Counted by hand from the layers: a convolution with batch norm and ReLU keeps two tensors of its output's
//! shape (what the norm and what the next layer saw), an attention two of its weights' shape, and so on. Scratch
//! memory of single operations, the program and the dataset are not counted.

use serde::Serialize;

use super::camera::n_features;
use super::config::{CameraBackbone, LidarEncoder, ModelConfig, NumericFusion};

/// Points or voxels assumed per sample, since only the data has the number: our LiDAR's front sector gives
/// 10,000 to 30,000.
const N_POINTS: usize = 20_000;

/// Tensors of one convolution, batch norm and ReLU.
const BLOCK: usize = 2;

/// Names of Swin's stages by their stride at the published patch size.
const TOKENS: [&str; 4] = ["tokens at 1/4", "tokens at 1/8", "tokens at 1/16", "tokens at 1/32"];

/// A main tensor of a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepTensor {
    pub name: &'static str,
    /// `batch` first.
    pub shape: Vec<usize>,
    /// Bytes that a training step keeps of it and of tensors as large, in f32.
    pub kept_bytes: usize,
}

/// The main tensors of a training step in the order of the forward pass.
///
/// # Arguments
/// - `n_states`: speeds and steering angles per sample
/// - `image_px`: width and height of the camera's images
#[must_use]
pub fn step_tensors(
    config: &ModelConfig,
    n_batch: usize,
    n_states: usize,
    image_px: [u32; 2],
) -> Vec<StepTensor> {
    let mut list = List { n_batch, tensors: Vec::new() };
    if config.use_camera {
        match config.camera.backbone {
            CameraBackbone::Cnn => list.cnn(config, image_px),
            CameraBackbone::Swin => list.swin(config),
        }
    }
    if config.use_lidar {
        match config.lidar.encoder {
            LidarEncoder::Pillars => list.pillars(config),
            LidarEncoder::Voxels => list.voxels(config),
        }
    }
    let cells = [config.grid.n_cells_y(), config.grid.n_cells_x()];
    let n_cells = config.grid.n_cells();
    if config.has_fuser() {
        let channels_in = config.lidar_channels() + config.camera_channels();
        list.push("camera and LiDAR maps", &[channels_in, cells[0], cells[1]], 1);
        list.push("fused map", &[config.fuser_channels, cells[0], cells[1]], BLOCK);
    }
    if config.has_backbone() {
        let backbone = &config.lidar.voxel.backbone;
        let mut stride = 1;
        for (scale, &n_channels) in backbone.channels.iter().enumerate() {
            stride *= backbone.strides[scale];
            let name = if scale == 0 { "backbone, first scale" } else { "backbone, coarser scale" };
            let n_blocks = 1 + backbone.n_layers[scale];
            list.push(name, &[n_channels, cells[0] / stride, cells[1] / stride], BLOCK * n_blocks);
        }
        // Normed scales, and the map they are laid into.
        list.push("backbone's output", &[backbone.n_channels_out(), cells[0], cells[1]], BLOCK + 1);
    }
    let head = &config.head;
    let n_shared = if head.shared_norm { BLOCK } else { 2 };
    list.push("shared features", &[head.channels, cells[0], cells[1]], n_shared + BLOCK);
    let scale = head.heatmap_scale;
    list.push("heatmap", &[head.heatmap.n_channels(), scale * cells[0], scale * cells[1]], 12);
    // The memory in rows, placed, then keys and values, each also laid out by head.
    list.push("keys and values", &[n_cells, head.channels], 8);
    // The softmax and its inputs; if dropout acts, its mask and result too.
    let n_attention = if head.dropout > 0.0 { 4 } else { 2 };
    list.push("cross attention", &[head.n_heads, head.n_queries, n_cells], n_attention);
    list.push("decoded queries", &[head.n_queries, head.channels], 30);
    let n_states = if head.numeric_fusion == NumericFusion::None { 1 } else { n_states };
    list.push("queries of all states", &[n_states, head.n_queries, 2 * head.channels], 16);
    list.tensors
}

struct List {
    n_batch: usize,
    tensors: Vec<StepTensor>,
}

impl List {
    fn push(&mut self, name: &'static str, shape: &[usize], n_kept: usize) {
        let shape = [&[self.n_batch], shape].concat();
        let kept_bytes = 4 * n_kept * shape.iter().product::<usize>();
        self.tensors.push(StepTensor { name, shape, kept_bytes });
    }

    fn pillars(&mut self, config: &ModelConfig) {
        let pillars = &config.lidar.pillars;
        let cells = [config.grid.n_cells_y(), config.grid.n_cells_x()];
        let n_parts = if config.paint_channels() > 0 { BLOCK + 2 } else { BLOCK };
        self.push("points", &[N_POINTS, pillars.channels], n_parts);
        self.push("points by pillar", &[N_POINTS / 4, pillars.max_points, pillars.channels], 2);
        self.push("pillar map", &[pillars.channels, 2 * cells[0], 2 * cells[1]], 2);
        let [fine, coarse] = pillars.bev_channels;
        self.push("LiDAR map, fine", &[fine, cells[0], cells[1]], 3 * BLOCK + 2);
        self.push("LiDAR map, coarse", &[coarse, cells[0] / 2, cells[1] / 2], 3 * BLOCK);
    }

    fn voxels(&mut self, config: &ModelConfig) {
        let encoder = &config.lidar.voxel.encoder;
        for (stage, &n_channels) in encoder.channels.iter().enumerate() {
            let name = ["voxels", "voxels at 1/2", "voxels at 1/4", "voxels at 1/8"].get(stage);
            // A residual block keeps two convolutions and a sum. Coarser voxels join few neighbours at first.
            let n_kept = BLOCK + encoder.n_blocks[stage] * (2 * BLOCK + 1);
            self.push(name.unwrap_or(&"coarser voxels"), &[N_POINTS, n_channels], n_kept);
        }
        let [n_channels, n_y, n_x] = config.lidar.voxel.encoded_shape();
        self.push("LiDAR map", &[n_channels, n_y, n_x], 2);
    }

    fn cnn(&mut self, config: &ModelConfig, [width_px, height_px]: [u32; 2]) {
        let cnn = &config.camera.cnn;
        let height =
            (f64::from(height_px) * cnn.image_width_px as f64 / f64::from(width_px)).round() as usize;
        let [a, b, c] = cnn.channels;
        let half = |n: usize| n.div_ceil(2);
        let (y, x) = (half(height), half(cnn.image_width_px));
        self.push("image", &[3, height, cnn.image_width_px], 1);
        self.push("image features at 1/2", &[a, y, x], BLOCK);
        self.push("image features at 1/4", &[b, half(y), half(x)], 2 * BLOCK);
        let features = [n_features(height), n_features(cnn.image_width_px)];
        self.push("image features at 1/8", &[c, features[0], features[1]], 4 * BLOCK);
        let n_painted = config.paint_channels();
        if n_painted > 0 {
            // Both parts and their sum, and the rows that points are taken from.
            self.push("picture's map for points", &[n_painted, half(y), half(x)], BLOCK + 4);
        }
        let n_points = cnn.n_depth_bins * features[0] * features[1];
        self.push("lifted features", &[n_points, cnn.lift_channels], 3);
        let cells = [config.grid.n_cells_y(), config.grid.n_cells_x()];
        self.push("camera map", &[cnn.lift_channels, cells[0], cells[1]], BLOCK + 1);
    }

    fn swin(&mut self, config: &ModelConfig) {
        let camera = &config.camera.swin;
        let (height_px, width_px) = (camera.image_height_px, camera.image_width_px);
        self.push("image", &[3, height_px, width_px], 1);
        for (stage, name) in TOKENS.into_iter().enumerate() {
            let stride = camera.swin.stride_px(stage);
            let (y, x) = (height_px.div_ceil(stride), width_px.div_ceil(stride));
            let n_channels = camera.swin.channels(stage);
            // A block keeps some 12 tensors of its channels (norms, windows, query, key, value, sums), the
            // feed-forward net's hidden ones before and behind its activation, and attention thrice.
            let per_block = 12 + 3 * camera.swin.mlp_ratio;
            let window = camera.swin.window_size * camera.swin.window_size;
            let attention = (3 * camera.swin.n_heads[stage] * window).div_ceil(n_channels);
            self.push(name, &[y * x, n_channels], camera.swin.depths[stage] * (per_block + attention));
        }
        let [n_y, n_x] = camera.n_features();
        self.push("image features", &[camera.fpn_channels, n_y, n_x], 4 * BLOCK);
        let lift = &camera.depth_lss;
        self.push("depth image", &[lift.depth_channels[0], height_px, width_px], BLOCK);
        self.push("lifting net", &[lift.hidden_channels, n_y, n_x], 2 * BLOCK + 2);
        self.push("depths of features", &[lift.n_depth_bins(), n_y, n_x], 4);
        let [y, x] = lift.pooled_cells();
        self.push("pooled cells", &[lift.out_channels, y, x], 1 + BLOCK);
        self.push("camera map", &[lift.out_channels, lift.n_cells_y(), lift.n_cells_x()], 2 * BLOCK);
    }
}
