//! Swin Transformer: image features at several scales from attention within shifted windows
//! (Liu et al. 2021; the values of Swin-T by default).

mod block;
mod patch;
mod window;

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};

use crate::model::config::{N_STAGES, SwinConfig};

use block::SwinStage;
use patch::PatchEmbedding;

/// The whole backbone.
#[derive(Module, Debug)]
pub struct Swin {
    patch: PatchEmbedding,
    stages: Vec<SwinStage>,
    norms: Vec<LayerNorm>,
    #[module(skip)]
    out_stages: [usize; 3],
}

impl Swin {
    /// `config` has passed its check.
    pub fn init(config: &SwinConfig, device: &Device) -> Self {
        Self {
            patch: PatchEmbedding::init(config, device),
            stages: (0..N_STAGES).map(|stage| SwinStage::init(config, stage, device)).collect(),
            norms: config.out_channels().map(|n| LayerNormConfig::new(n).init(device)).into(),
            out_stages: config.out_stages,
        }
    }

    /// Stages whose maps are outputs.
    pub fn out_stages(&self) -> [usize; 3] {
        self.out_stages
    }

    /// # Shapes
    /// - image: `[batch, 3, y, x]` of any size
    /// - output: `[batch, channel, y, x]` of each output stage; rows and columns are the image's over the stage's
    ///   stride, rounded up
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::config::ModelConfig;
    use crate::model::golden::formula::{fill, gradients, tensor};
    use crate::model::golden::{Golden, values};

    /// The sizes of `SMALL` in `tests/golden/torch_swin.py`.
    fn little() -> SwinConfig {
        let [_, paper] = ModelConfig::in_little();
        paper.camera.swin.swin
    }

    #[test]
    fn a_small_net_has_the_maps_and_gradients_of_pytorch() {
        let golden = Golden::read("swin");
        let device = test_device().autodiff();
        let mut swin = Swin::init(&SwinConfig { drop_path: 0.0, ..little() }, &device);
        fill(&mut swin);
        let image = tensor("image", [2, 3, 37, 50], &device).require_grad();
        let maps = swin.forward(image.clone());
        let weighted = |(i, map): (usize, &Tensor<4>)| {
            golden.check(&format!("map{i}"), map);
            (map.clone() * tensor(&format!("d_map{i}"), map.dims(), &device)).sum()
        };
        let loss = maps.iter().enumerate().map(weighted).reduce(|a, b| a + b).unwrap();
        let found = loss.backward();
        golden.check("gradient.image", &image.grad(&found).unwrap());
        let of_weights = gradients(swin, &found);
        assert_eq!(
            of_weights.len() + 4,
            golden.n_tensors(),
            "the others are the maps and the image's gradient"
        );
        golden.check_gradients(&of_weights);
    }

    #[test]
    fn swin_t_has_the_maps_of_pytorch_and_the_published_size() {
        let golden = Golden::read("swin_t");
        let device = test_device();
        let mut swin = Swin::init(&SwinConfig::default(), &device);
        assert_eq!(swin.num_params(), 27_520_506);
        fill(&mut swin);
        let maps = swin.forward(tensor("image", [1, 3, 122, 206], &device));
        assert_eq!(maps.each_ref().map(Tensor::dims), [[1, 192, 16, 26], [1, 384, 8, 13], [1, 768, 4, 7]]);
        for (i, map) in maps.into_iter().enumerate() {
            let every_37th: Vec<f32> = values(map).into_iter().step_by(37).collect();
            golden.check_numbers(&format!("map{i}"), &every_37th, 0.0);
        }
    }
}
