//! One sparse convolution with batch norm, and the residual block of two.

use std::sync::Arc;

use burn::module::{Module, Param};
use burn::nn::BatchNorm;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use crate::kernels::{Rulebook, sparse_conv};
use crate::model::layers::{batch_norm, kaiming, lidar_norm};

/// Sparse convolution without bias, and batch norm over the active sites.
#[derive(Module, Debug)]
pub struct SparseConvNorm {
    /// `[offset, channel_in, channel_out]`.
    weight: Param<Tensor<3>>,
    norm: BatchNorm,
}

impl SparseConvNorm {
    pub fn init(channels_in: usize, channels_out: usize, n_offsets: usize, device: &Device) -> Self {
        let shape = [n_offsets, channels_in, channels_out];
        let fan_in = Some(n_offsets * channels_in);
        Self {
            weight: kaiming().init_with(shape, fan_in, Some(n_offsets * channels_out), device),
            norm: lidar_norm(channels_out, device),
        }
    }

    /// # Shapes
    /// - x: `[input, channel_in]`
    /// - output: `[output, channel_out]`
    pub fn forward(&self, x: Tensor<2>, rulebook: &Arc<Rulebook>) -> Tensor<2> {
        batch_norm(&self.norm, sparse_conv(x, self.weight.val(), rulebook))
    }
}

/// Two submanifold convolutions and a short cut: `relu(x + norm(conv(relu(norm(conv(x))))))`.
#[derive(Module, Debug)]
pub struct SparseBlock {
    first: SparseConvNorm,
    second: SparseConvNorm,
}

impl SparseBlock {
    pub fn init(n_channels: usize, n_offsets: usize, device: &Device) -> Self {
        let conv = || SparseConvNorm::init(n_channels, n_channels, n_offsets, device);
        Self { first: conv(), second: conv() }
    }

    /// # Shapes
    /// - x and output: `[site, channel]`
    pub fn forward(&self, x: Tensor<2>, rulebook: &Arc<Rulebook>) -> Tensor<2> {
        let hidden = relu(self.first.forward(x.clone(), rulebook));
        relu(self.second.forward(hidden, rulebook) + x)
    }
}

#[cfg(test)]
mod tests {
    use super::super::sites::Sites;
    use super::*;
    use crate::device::test_device;
    use crate::model::config::SparseKernel;
    use crate::model::golden::Golden;
    use burn::tensor::Gradients;

    /// Against a dense convolution of the same voxels that is read at the active sites only.
    #[test]
    fn values_and_gradients_equal_a_dense_convolution() {
        let strided = SparseKernel { kernel: [3; 3], stride: [2; 3], padding: [1; 3] };
        let cases = [
            ("submanifold", SparseKernel::SUBMANIFOLD),
            ("submanifold_wide", SparseKernel::SUBMANIFOLD),
            ("strided", strided),
            ("strided_flat", SparseKernel { padding: [0, 1, 1], ..strided }),
            ("column", SparseKernel { kernel: [3, 1, 1], stride: [2, 1, 1], padding: [0; 3] }),
        ];
        let golden = Golden::read("sparse");
        let device = test_device().autodiff();
        for (case, geometry) in cases {
            let name = |part: &str| format!("{case}.{part}");
            let tensor = |part: &str| golden.tensor::<2>(&name(part), &device);
            let inputs = golden.sites(&name("shape"), &name("cells"));
            let outputs = if geometry == SparseKernel::SUBMANIFOLD {
                inputs.clone()
            } else {
                geometry.output_sites(&inputs)
            };
            assert_eq!(outputs, golden.sites(&name("out_shape"), &name("out_cells")), "{case}: sites");

            let rulebook = Arc::new(match geometry {
                SparseKernel::SUBMANIFOLD => SparseKernel::submanifold_rulebook(&inputs),
                strided => strided.rulebook(&inputs, &outputs),
            });
            let x = tensor("x").require_grad();
            let w = golden.tensor::<3>(&name("w"), &device).require_grad();
            let y = sparse_conv(x.clone(), w.clone(), &rulebook);
            let gradients = (y.clone() * tensor("dy")).sum().backward();
            golden.check(&name("y"), &y);
            golden.check(&name("dx"), &x.grad(&gradients).unwrap());
            golden.check(&name("dw"), &w.grad(&gradients).unwrap());
        }
    }

    impl SparseConvNorm {
        pub(in crate::model::lidar::sparse) fn weight_gradient(&self, gradients: &Gradients) -> Tensor<3> {
            self.weight.val().grad(gradients).unwrap()
        }

        pub(in crate::model::lidar::sparse) fn running_statistics(&self) -> [Tensor<1>; 2] {
            [self.norm.running_mean.value_sync().inner(), self.norm.running_var.value_sync().inner()]
        }
    }

    impl Golden {
        /// Sites from a shape (z, y, x) and rows of sample, z, y, x.
        pub(in crate::model::lidar::sparse) fn sites(&self, shape: &str, cells: &str) -> Sites {
            let shape: Vec<usize> = self.numbers(shape).iter().map(|&n| n as usize).collect();
            let rows: Vec<u16> = self.numbers(cells).iter().map(|&at| at as u16).collect();
            let rows: Vec<&[u16]> = rows.chunks(4).collect();
            let samples: Vec<Vec<[u16; 3]>> = rows
                .chunk_by(|a, b| a[0] == b[0])
                .map(|sample| sample.iter().map(|row| [row[1], row[2], row[3]]).collect())
                .collect();
            let samples: Vec<&[[u16; 3]]> = samples.iter().map(Vec::as_slice).collect();
            Sites::new([shape[0], shape[1], shape[2]], &samples)
        }
    }
}
