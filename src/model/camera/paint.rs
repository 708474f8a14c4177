//! What the picture shows at each LiDAR point (PointPainting, Vora et al. 2020, with features in place of classes): few
//! points tell little of a thing, the patch of the picture around them tells more.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::{Device, Int, Tensor};

use crate::model::config::CnnConfig;
use crate::model::layers::{ConvBlock, convolve_pointwise, pointwise, upsample_nearest};

/// Chance that a pixel shows an object at the start of training.
const PRIOR: f64 = 0.1;

/// A map of the picture at a quarter of its size, from which points take their features.
#[derive(Module, Debug)]
pub struct Paint {
    fine: Conv2d,
    coarse: Conv2d,
    joint: ConvBlock,
    objects: Conv2d,
}

impl Paint {
    pub fn init(config: &CnnConfig, device: &Device) -> Self {
        let [_, b, c] = config.channels;
        let n = config.paint_channels;
        let mut objects = pointwise(n, 1, device);
        let logit = (PRIOR / (1.0 - PRIOR)).ln();
        objects.bias = objects.bias.map(|bias| bias.map(|bias| bias.zeros_like().add_scalar(logit)));
        Self {
            fine: pointwise(b, n, device),
            coarse: pointwise(c, n, device),
            joint: ConvBlock::init(n, n, 1, device),
            objects,
        }
    }

    /// # Shapes
    /// - fine: `[batch, channel, y, x]` at a quarter of the picture
    /// - coarse: `[batch, channel, y, x]` at an eighth
    /// - output: `[batch, paint_channel, y, x]` at a quarter
    pub fn forward(&self, fine: Tensor<4>, coarse: Tensor<4>) -> Tensor<4> {
        let [_, _, n_y, n_x] = fine.dims();
        let coarse = upsample_nearest(convolve_pointwise(&self.coarse, coarse));
        let coarse = coarse.narrow(2, 0, n_y).narrow(3, 0, n_x);
        self.joint.forward(convolve_pointwise(&self.fine, fine) + coarse)
    }

    /// Whether each pixel shows an object, before the sigmoid: `[batch, 1, y, x]`. Training alone asks.
    pub fn objects(&self, map: Tensor<4>) -> Tensor<4> {
        convolve_pointwise(&self.objects, map)
    }
}

/// The features of points: those of their pixels, or zeros where a point is not in the picture.
///
/// # Shapes
/// - map: `[batch, channel, y, x]`
/// - pixels: `[point]`: `(batch * y + row) * x + column`, or `batch * y * x` for no pixel
/// - output: `[point, channel]`
pub fn take_pixels(map: Tensor<4>, pixels: Tensor<1, Int>) -> Tensor<2> {
    let [n_batch, n_channels, n_y, n_x] = map.dims();
    let rows = map.permute([0, 2, 3, 1]).reshape([n_batch * n_y * n_x, n_channels]);
    let nothing = Tensor::zeros([1, n_channels], &rows.device());
    Tensor::cat(vec![rows, nothing], 0).select(0, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::TensorData;

    #[test]
    fn points_take_the_features_of_their_pixels_and_give_them_the_gradients() {
        let device = Device::flex().autodiff();
        // Two pictures of one row and two columns, of two channels.
        let map = Tensor::<1>::from_floats([1., 2., 3., 4., 5., 6., 7., 8.], &device).reshape([2, 2, 1, 2]);
        let map = map.require_grad();
        let pixels = Tensor::<1, Int>::from_data(TensorData::new(vec![1i64, 2, 4, 1], [4]), &device);
        let taken = take_pixels(map.clone(), pixels);
        let values: Vec<f32> = taken.clone().into_data().try_to_vec().unwrap();
        assert_eq!(values, [2.0, 4.0, 5.0, 7.0, 0.0, 0.0, 2.0, 4.0]);
        let gradients = taken.sum().backward();
        let of_map: Vec<f32> = map.grad(&gradients).unwrap().into_data().try_to_vec().unwrap();
        assert_eq!(of_map, [0.0, 2.0, 0.0, 2.0, 1.0, 0.0, 1.0, 0.0]);
    }
}
