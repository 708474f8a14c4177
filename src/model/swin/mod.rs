//! Swin Transformer: image features at several scales from attention within shifted windows
//! (Liu et al. 2021; the values of Swin-T by default).

mod block;
mod config;
mod patch;
mod window;

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};

use block::Stage;
pub use config::{N_STAGES, SwinConfig};
use patch::PatchEmbedding;

/// The whole backbone.
#[derive(Module, Debug)]
pub struct Swin {
    patch: PatchEmbedding,
    stages: Vec<Stage>,
    norms: Vec<LayerNorm>,
    #[module(skip)]
    out_stages: [usize; 3],
}

impl Swin {
    /// `config` is one that passes its check.
    pub fn init(config: &SwinConfig, device: &Device) -> Self {
        Self {
            patch: PatchEmbedding::init(config, device),
            stages: (0..N_STAGES).map(|stage| Stage::init(config, stage, device)).collect(),
            norms: config.out_channels().map(|n| LayerNormConfig::new(n).init(device)).into(),
            out_stages: config.out_stages,
        }
    }

    /// Stages whose maps come out.
    pub(super) fn out_stages(&self) -> [usize; 3] {
        self.out_stages
    }

    /// # Shapes
    /// - image: `[batch, 3, y, x]` of any size
    /// - output: of each stage that comes out `[batch, channel, y, x]`, rows and columns the image's over the
    ///   stage's stride, rounded up
    pub fn forward(&self, image: Tensor<4>) -> [Tensor<4>; 3] {
        let mut maps = Vec::with_capacity(self.out_stages.len());
        let mut x = Some(self.patch.forward(image));
        for (stage_idx, stage) in self.stages.iter().enumerate().take(self.out_stages[2] + 1) {
            let map = stage.forward(x.expect("every stage but the last merges"));
            if self.out_stages.contains(&stage_idx) {
                maps.push(self.norms[maps.len()].forward(map.clone()).permute([0, 3, 1, 2]));
            }
            x = if stage_idx < self.out_stages[2] { stage.merge(map) } else { None };
        }
        maps.try_into().expect("one map for each stage that comes out")
    }
}
