//! A Swin block, and a stage of blocks.

use burn::module::Module;
use burn::nn::{Dropout, DropoutConfig, LayerNorm, LayerNormConfig};
use burn::tensor::activation::gelu;
use burn::tensor::{Device, Tensor};

use super::patch::PatchMerging;
use super::window::{WindowAttention, Windows, linear};
use crate::model::config::SwinConfig;
use crate::model::layers::Mlp;

/// Skips a residual branch for whole samples at random in training (Huang et al. 2016), and scales it up for the
/// others. Like burn's dropout it draws from the device's generator, and does nothing once the module is frozen.
#[derive(Module, Debug)]
struct DropPath {
    of_samples: Dropout,
}

impl DropPath {
    fn init(probability: f64) -> Self {
        Self { of_samples: DropoutConfig::new(probability).init() }
    }

    /// # Shapes
    /// - branch and output: `[batch, y, x, channel]`
    fn forward(&self, branch: Tensor<4>) -> Tensor<4> {
        if self.of_samples.prob == 0.0 || !branch.device().is_autodiff() {
            return branch;
        }
        let [n_batch, ..] = branch.dims();
        let kept = self.of_samples.forward(Tensor::ones([n_batch, 1, 1, 1], &branch.device()));
        branch * kept
    }
}

/// Window attention and a feed-forward net, each behind a layer norm and beside a skip connection.
#[derive(Module, Debug)]
struct SwinBlock {
    norm1: LayerNorm,
    attention: WindowAttention,
    norm2: LayerNorm,
    /// With a GELU between.
    mlp: Mlp,
    drop_path: DropPath,
}

impl SwinBlock {
    fn init(config: &SwinConfig, stage: usize, drop_path: f64, device: &Device) -> Self {
        let n_channels = config.channels(stage);
        let n_hidden = n_channels * config.mlp_ratio;
        Self {
            norm1: LayerNormConfig::new(n_channels).init(device),
            attention: WindowAttention::init(
                n_channels,
                config.n_heads[stage],
                config.window_size,
                config.qkv_bias,
                device,
            ),
            norm2: LayerNormConfig::new(n_channels).init(device),
            mlp: Mlp {
                hidden: linear(n_channels, n_hidden, true, device),
                out: linear(n_hidden, n_channels, true, device),
            },
            drop_path: DropPath::init(drop_path),
        }
    }

    fn forward(&self, x: Tensor<4>, windows: &Windows, mask: Option<&Tensor<4>>) -> Tensor<4> {
        let seen = self.attention.forward(self.norm1.forward(x.clone()), windows, mask);
        let x = x + self.drop_path.forward(seen);
        let hidden = gelu(self.mlp.hidden.forward(self.norm2.forward(x.clone())));
        x + self.drop_path.forward(self.mlp.out.forward(hidden))
    }
}

/// Blocks at one resolution, and the merging that leads to the next stage.
#[derive(Module, Debug)]
pub struct SwinStage {
    blocks: Vec<SwinBlock>,
    merge: Option<PatchMerging>,
    #[module(skip)]
    window_size: usize,
}

impl SwinStage {
    pub fn init(config: &SwinConfig, stage: usize, device: &Device) -> Self {
        let first: usize = config.depths[..stage].iter().sum();
        let drop_path = config.drop_path_of_blocks();
        Self {
            blocks: (first..first + config.depths[stage])
                .map(|block| SwinBlock::init(config, stage, drop_path[block], device))
                .collect(),
            merge: (stage + 1 < config.depths.len())
                .then(|| PatchMerging::init(config.channels(stage), device)),
            window_size: config.window_size,
        }
    }

    /// # Shapes
    /// - x and output: `[batch, y, x, channel]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let [_, n_y, n_x, _] = x.dims();
        let cuts = [false, true].map(|is_shifted| Windows::new([n_y, n_x], self.window_size, is_shifted));
        let mask = cuts[1].mask(&x.device());
        let step = |x, (i, block): (usize, &SwinBlock)| match i % 2 {
            0 => block.forward(x, &cuts[0], None),
            _ => block.forward(x, &cuts[1], mask.as_ref()),
        };
        self.blocks.iter().enumerate().fold(x, step)
    }

    /// The next stage's input: half the rows and columns, twice the channels; the last stage has none.
    pub fn merge(&self, x: Tensor<4>) -> Option<Tensor<4>> {
        self.merge.as_ref().map(|merge| merge.forward(x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drop_path_skips_whole_samples_in_training_alone() {
        let device = Device::flex().autodiff();
        device.seed(3);
        let values = |drop_path: &DropPath, device: &Device| -> Vec<f32> {
            drop_path.forward(Tensor::ones([64, 1, 2, 2], device)).into_data().try_to_vec().unwrap()
        };
        let trained = values(&DropPath::init(0.5), &device);
        let of_samples: Vec<&[f32]> = trained.chunks(4).collect();
        assert!(of_samples.iter().all(|s| *s == [0.0; 4] || *s == [2.0; 4]), "whole samples, scaled up");
        let n_kept = of_samples.iter().filter(|s| s[0] > 0.0).count();
        assert!((16..48).contains(&n_kept), "{n_kept} of 64 kept");
        assert_eq!(values(&DropPath::init(0.5), &Device::flex()), [1.0; 256]);
        assert_eq!(values(&DropPath::init(0.0), &device), [1.0; 256]);
    }
}
