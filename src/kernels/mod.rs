//! Own CPU operations plugged into burn.

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::Tensor;

/// 3x3 convolution, padding 1.
#[must_use]
pub fn conv3x3(x: Tensor<4>, w: Tensor<4>, stride: usize) -> Tensor<4> {
    conv2d(x, w, None, ConvOptions::new([stride, stride], [1, 1], [1, 1], 1))
}
