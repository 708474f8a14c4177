//! BEVFusion's feature pyramid ("generalized LSS-FPN"): from the coarsest map to the finest, each is enlarged,
//! laid beside the next finer one and mixed with it.

use burn::module::Module;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor};

use super::conv_norm::{ConvNorm, ConvNormConfig};

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
            let options = InterpolateOptions::new(InterpolateMode::Bilinear)
                .with_align_corners(false)
                .with_output_size([n_y, n_x]);
            let mixed = Tensor::cat(vec![own, interpolate(coarser, options)], 1);
            level.smooth.forward(level.lateral.forward(mixed))
        })
    }
}
