//! BEVFusion's feature pyramid ("generalized LSS-FPN"): from the coarsest map to the finest, each is enlarged,
//! laid beside the next finer one and mixed with it.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use crate::model::layers::{ConvNorm, ConvNormConfig, resize_bilinear};

/// Mixes one map with the enlarged coarser one.
#[derive(Module, Debug)]
struct Level {
    lateral: ConvNorm,
    smooth: ConvNorm,
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
        let level = |n_own, n_coarser| Level {
            lateral: ConvNormConfig::new(n_own + n_coarser, channels_out).with_kernel(1).init(device),
            smooth: ConvNormConfig::new(channels_out, channels_out).init(device),
        };
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
    use crate::model::golden::formula::{
        assert_equal, assert_gradients_equal, fill, golden, gradients, n_parameters, tensor, values,
    };

    #[test]
    fn the_map_and_gradients_are_pytorchs() {
        let expected = golden(include_bytes!("../../../tests/golden/lss_fpn.safetensors"));
        let device = test_device().autodiff();
        let mut fpn = LssFpn::init([6, 8, 10], 12, &device);
        fill(&mut fpn);
        let map = |name, dims| tensor::<4>(name, dims, &device).require_grad();
        let maps = [map("map0", [2, 6, 7, 10]), map("map1", [2, 8, 4, 5]), map("map2", [2, 10, 2, 3])];
        let out = fpn.forward(maps.clone());
        assert_equal("output", &values(out.clone()), &expected["out"]);
        let d_out = tensor("d_out", out.dims(), &device);
        let found = (out * d_out).sum().backward();
        for (i, map) in maps.iter().enumerate() {
            let d_map = values(map.grad(&found).expect("every map has a gradient"));
            assert_equal(&format!("map {i}"), &d_map, &expected[&format!("gradient.map{i}")]);
        }
        let of_weights = gradients(fpn, &found);
        assert_eq!(of_weights.len(), 12);
        assert_gradients_equal(&of_weights, &expected);
    }

    #[test]
    fn the_published_sizes_have_the_published_number_of_parameters() {
        let fpn = LssFpn::init([192, 384, 768], 256, &Device::flex());
        assert_eq!(n_parameters(&fpn), 1_591_296);
    }
}
