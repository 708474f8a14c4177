//! How speed and steering join the queries, after the decoder.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::predict::Predictor;
use crate::model::config::{HeadConfig, NumericFusion};
use crate::model::layers::Mlp;

/// The numeric branch; layers that the chosen fusion does not need are absent.
#[derive(Module, Debug)]
pub struct Numeric {
    /// `[2] -> [query]` (paper) or `[2] ->` scales and shifts of the class branch (film).
    pub embed: Option<Mlp>,
    /// Fuses `[channel + 1]` back to `[channel]`: a convolution of kernel 1 (paper).
    fuse: Option<Linear>,
    #[module(skip)]
    fusion: NumericFusion,
}

impl Numeric {
    pub fn init(config: &HeadConfig, device: &Device) -> Self {
        let embed = |n_out| Some(Mlp::init(2, config.channels, n_out, device));
        let (embed, fuse) = match config.numeric_fusion {
            NumericFusion::Paper => (
                embed(config.n_queries),
                Some(LinearConfig::new(config.channels + 1, config.channels).init(device)),
            ),
            NumericFusion::Film => (embed(Predictor::n_modulations(config)), None),
            NumericFusion::None => (None, None),
        };
        Self { embed, fuse, fusion: config.numeric_fusion }
    }

    /// The paper's fusion: adds one number to the channels of each query.
    ///
    /// # Shapes
    /// - decoded, output: `[row, query, channel]`
    /// - numeric: `[row, 2]`
    pub fn before_heads(&self, decoded: Tensor<3>, numeric: Tensor<2>) -> Tensor<3> {
        match (&self.embed, &self.fuse) {
            (Some(embed), Some(fuse)) => {
                let per_query = embed.forward(numeric).unsqueeze_dim(2);
                relu(fuse.forward(Tensor::cat(vec![decoded, per_query], 2)))
            }
            _ => decoded,
        }
    }

    /// Scales and shifts of the class branch, where the fusion has them.
    ///
    /// # Shapes
    /// - numeric: `[row, 2]`
    /// - output: `[row, 1, modulation]`
    pub fn for_harm(&self, numeric: Tensor<2>) -> Option<Tensor<3>> {
        let embed = self.embed.as_ref().filter(|_| self.fusion == NumericFusion::Film)?;
        Some(embed.forward(numeric).unsqueeze_dim(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelConfig;

    #[test]
    fn the_papers_branch_is_a_number_a_query_beside_128_channels_of_200_queries_and_a_convolution() {
        let config = ModelConfig::paper().head;
        let numeric = Numeric::init(&config, &Device::flex());
        let (embed, fuse) = (numeric.embed.as_ref().unwrap(), numeric.fuse.as_ref().unwrap());
        let per_query = embed.forward(Tensor::<2>::ones([1, 2], &Device::flex()));
        assert_eq!(per_query.dims(), [1, 200]);
        assert_eq!(fuse.weight.dims(), [128 + 1, 128]);
        let decoded = Tensor::<3>::ones([1, 200, 128], &Device::flex());
        let fused = numeric.before_heads(decoded.clone(), Tensor::ones([1, 2], &Device::flex()));
        assert_eq!(fused.dims(), [1, 200, 128]);
        // Another speed, other features: the branch is not cut off.
        let other = numeric.before_heads(decoded, Tensor::zeros([1, 2], &Device::flex()));
        assert!((fused - other).abs().max().into_scalar::<f32>() > 1e-3);
    }
}
