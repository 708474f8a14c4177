//! BEVFusion's feature pyramid ("generalized LSS-FPN"): from the coarsest map to the finest, each is enlarged,
//! laid beside the next finer one and mixed with it.

use burn::module::Module;
use burn::nn::conv::Conv2dConfig;
use burn::tensor::{Device, Tensor};

use crate::model::layers::{ConvBlock, resize_bilinear};

/// Mixes one map with the enlarged coarser one.
#[derive(Module, Debug)]
struct Level {
    lateral: ConvBlock,
    smooth: ConvBlock,
}

/// The pyramid over three maps.
#[derive(Module, Debug)]
pub struct LssFpn {
    /// Finest first.
    levels: Vec<Level>,
}

impl LssFpn {
    /// # Arguments
    /// - `channels_in`: of the maps, finest first
    /// - `channels_out`: of every mixed map
    pub fn init(channels_in: [usize; 3], channels_out: usize, device: &Device) -> Self {
        let [fine, middle, coarse] = channels_in;
        let block = |n_in, kernel_px| {
            let conv = Conv2dConfig::new([n_in, channels_out], [kernel_px; 2]).with_bias(false);
            ConvBlock::from_conv(conv, device)
        };
        let level =
            |n_own, n_coarser| Level { lateral: block(n_own + n_coarser, 1), smooth: block(channels_out, 3) };
        Self { levels: vec![level(fine, channels_out), level(middle, coarse)] }
    }

    /// # Shapes
    /// - maps: `[batch, channel, y, x]` each, finest first
    /// - output: `[batch, channels_out, y, x]`, rows and columns of the finest map
    pub fn forward(&self, maps: [Tensor<4>; 3]) -> Tensor<4> {
        let [fine, middle, coarse] = maps;
        [middle, fine].into_iter().zip(self.levels.iter().rev()).fold(coarse, |coarser, (own, level)| {
            let [_, _, n_y, n_x] = own.dims();
            let mixed = Tensor::cat(vec![own, resize_bilinear(coarser, [n_y, n_x])], 1);
            level.smooth.forward(level.lateral.forward(mixed))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::golden::Golden;
    use crate::model::golden::formula::{fill, gradients, tensor};
    use crate::model::parameters::n_trained;

    #[test]
    fn the_map_and_gradients_are_pytorchs() {
        let golden = Golden::read("lss_fpn");
        let device = test_device().autodiff();
        let mut fpn = LssFpn::init([6, 8, 10], 12, &device);
        fill(&mut fpn);
        let map = |name, dims| tensor::<4>(name, dims, &device).require_grad();
        let maps = [map("map0", [2, 6, 7, 10]), map("map1", [2, 8, 4, 5]), map("map2", [2, 10, 2, 3])];
        let out = fpn.forward(maps.clone());
        golden.check("out", &out);
        let d_out = tensor("d_out", out.dims(), &device);
        let found = (out * d_out).sum().backward();
        for (i, map) in maps.iter().enumerate() {
            golden.check(&format!("gradient.map{i}"), &map.grad(&found).unwrap());
        }
        let of_weights = gradients(fpn, &found);
        assert_eq!(of_weights.len(), 12);
        golden.check_gradients(&of_weights);
    }

    #[test]
    fn the_published_sizes_have_the_published_number_of_parameters() {
        let fpn = LssFpn::init([192, 384, 768], 256, &Device::flex().autodiff());
        assert_eq!(n_trained(&fpn), 1_591_296);
    }
}
