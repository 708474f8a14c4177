//! Depth-LSS view transform (Liu et al. 2023, after Philion and Fidler 2020): the LiDAR's sparse depth image
//! and image features give a distribution over depth and a context at each feature; their outer product,
//! spread along the feature's ray, is summed into bird's-eye cells.

use std::sync::Arc;

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::tensor::{Device, Tensor};

use super::lift::lift_and_pool;
use crate::kernels::PoolPlan;
use crate::model::config::DepthLssConfig;
use crate::model::layers::{ConvBlock, pointwise};

/// From image features to the bird's-eye map.
#[derive(Module, Debug)]
pub struct DepthLss {
    depth: Vec<ConvBlock>,
    joint: Vec<ConvBlock>,
    lift: Conv2d,
    smooth: Vec<ConvBlock>,
    #[module(skip)]
    n_depth_bins: usize,
    /// Rows and columns of the pooled grid.
    #[module(skip)]
    n_pooled: [usize; 2],
}

impl DepthLss {
    /// `config` has passed its check; `channels_in` counts the channels of the image features.
    pub fn init(config: &DepthLssConfig, channels_in: usize, device: &Device) -> Self {
        let [a, b, c] = config.depth_channels;
        let [stride_b, stride_c] = config.depth_strides;
        let (hidden, out) = (config.hidden_channels, config.out_channels);
        let block = |channels, kernel_px: usize, stride: usize, has_bias| {
            let conv = Conv2dConfig::new(channels, [kernel_px; 2]).with_stride([stride; 2]);
            ConvBlock::from_conv(conv.with_bias(has_bias), device)
        };
        let smooth = |stride| block([out, out], 3, stride, false);
        Self {
            depth: vec![
                block([1, a], 1, 1, true),
                block([a, b], config.depth_kernel_px, stride_b, true),
                block([b, c], config.depth_kernel_px, stride_c, true),
            ],
            joint: vec![block([c + channels_in, hidden], 3, 1, true), block([hidden, hidden], 3, 1, true)],
            lift: pointwise(hidden, config.n_depth_bins() + out, device),
            smooth: vec![smooth(1), smooth(config.downsample), smooth(1)],
            n_depth_bins: config.n_depth_bins(),
            n_pooled: config.pooled_cells(),
        }
    }

    /// # Shapes
    /// - features: `[batch, channel, feature_y, feature_x]`
    /// - depth_image: `[batch, 1, y, x]` in metres, 0 where no LiDAR point falls
    /// - plans: [`super::frustum::pool_plan`] of each sample
    /// - output: `[batch, out_channel, cell_y, cell_x]`
    pub fn forward(&self, features: Tensor<4>, depth_image: Tensor<4>, plans: &[Arc<PoolPlan>]) -> Tensor<4> {
        self.smooth.iter().fold(self.pool(features, depth_image, plans), |x, block| block.forward(x))
    }

    /// The pooled map before the last three convolutions, `[batch, out_channel, y, x]`.
    fn pool(&self, features: Tensor<4>, depth_image: Tensor<4>, plans: &[Arc<PoolPlan>]) -> Tensor<4> {
        let depth = self.depth.iter().fold(depth_image, |x, block| block.forward(x));
        let joint = Tensor::cat(vec![depth, features], 1);
        let lifted = self.lift.forward(self.joint.iter().fold(joint, |x, block| block.forward(x)));
        lift_and_pool(lifted, self.n_depth_bins, self.n_pooled, plans)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::device::test_device;
    use crate::geometry::{Pinhole, Transform};
    use crate::model::camera::frustum::{pool_plan, sparse_depth};
    use crate::model::camera::picture::CameraGeometry;
    use crate::model::golden::Golden;
    use crate::model::golden::formula::{fill, gradients, tensor, uniform};
    use crate::model::parameters::n_trained;
    use burn::tensor::TensorData;

    const INTRINSICS: Pinhole =
        Pinhole { width_px: 72, height_px: 40, fx_px: 50.0, fy_px: 48.0, cx_px: 35.0, cy_px: 21.0 };

    /// The sizes of `tests/golden/torch_depth_lss.py`.
    fn small() -> DepthLssConfig {
        DepthLssConfig {
            depth_min_m: 1.0,
            depth_max_m: 9.0,
            depth_step_m: 1.0,
            x_min_m: 0.0,
            x_max_m: 8.0,
            y_min_m: -6.0,
            y_max_m: 6.0,
            z_min_m: -1.0,
            z_max_m: 3.0,
            cell_size_m: 1.0,
            depth_channels: [2, 3, 4],
            hidden_channels: 6,
            out_channels: 5,
            ..DepthLssConfig::default()
        }
    }

    fn views() -> [CameraGeometry; 2] {
        let view = |yaw, pitch, position| {
            let mut pose = Transform::looking_forward(position, pitch);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
            pose.isometry.rotation = turn * pose.isometry.rotation;
            CameraGeometry { intrinsics: INTRINSICS, ego_from_camera: pose }
        };
        [view(0.0, 0.1, Vector3::new(0.5, 0.2, 1.4)), view(0.4, -0.05, Vector3::new(0.0, -0.5, 1.2))]
    }

    fn depth_image(sample: usize) -> Vec<f32> {
        let numbers = uniform(&format!("points{sample}"), 1200);
        // The script's numbers passed through f32.
        let scaled = |p: &[f64]| [(0, 9.0), (1, 7.0), (2, 2.0)].map(|(i, by)| f64::from(p[i] as f32) * by);
        let points: Vec<[f64; 4]> = numbers.chunks(3).map(scaled).map(|[x, y, z]| [x, y, z, 0.0]).collect();
        let mut image = vec![0f32; 40 * 72];
        for (pixel, depth_m) in sparse_depth(&points, &views()[sample]) {
            image[pixel as usize] = depth_m;
        }
        image
    }

    #[test]
    fn geometry_pooling_maps_and_gradients_are_pytorchs() {
        let golden = Golden::read("depth_lss");
        let device = test_device().autodiff();
        let config = small();
        let depth: Vec<f32> = (0..2).flat_map(depth_image).collect();
        let is_near = |(a, b): (&f32, f64)| (f64::from(*a) - b).abs() <= 1e-5;
        assert!(depth.iter().zip(golden.numbers("depth")).all(is_near), "depth image");
        let plans = views().map(|view| Arc::new(pool_plan(&config, [5, 9], &view)));
        let cell = |&cell: &u32| if cell == PoolPlan::OUTSIDE { -1.0 } else { f64::from(cell) };
        let cells: Vec<f64> = plans.iter().flat_map(|plan| plan.cell_of_point().iter().map(cell)).collect();
        assert_eq!(cells, golden.numbers("cells"));

        let mut view = DepthLss::init(&config, 7, &device);
        fill(&mut view);
        let features = tensor::<4>("features", [2, 7, 5, 9], &device).require_grad();
        let depth = Tensor::from_data(TensorData::new(depth, [2, 1, 40, 72]), &device);
        let pooled = view.pool(features.clone(), depth.clone(), &plans);
        assert_eq!(pooled.dims(), [2, 5, 12, 8]);
        golden.check("pooled", &pooled);
        let out = view.forward(features.clone(), depth, &plans);
        assert_eq!(out.dims(), [2, 5, config.n_cells_y(), config.n_cells_x()]);
        golden.check("out", &out);
        let d_out = tensor("d_out", out.dims(), &device);
        let found = (out * d_out).sum().backward();
        golden.check("gradient.features", &features.grad(&found).unwrap());
        let of_weights = gradients(view, &found);
        assert_eq!(of_weights.len() + 5, golden.n_tensors(), "all but five tensors are weights' gradients");
        golden.check_gradients(&of_weights);
    }

    #[test]
    fn the_published_sizes_have_the_published_numbers_of_parameters() {
        let view = DepthLss::init(&DepthLssConfig::default(), 256, &Device::flex().autodiff());
        let count = |blocks: &[ConvBlock]| blocks.iter().map(n_trained).sum::<usize>();
        assert_eq!(count(&view.depth), 57_920, "dtransform, 0.058 M");
        assert_eq!(count(&view.joint) + n_trained(&view.lift), 1_379_526, "depthnet, 1.380 M");
        assert_eq!(count(&view.smooth), 173_280, "downsample, 0.173 M");
    }
}
