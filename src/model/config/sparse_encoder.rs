//! Sizes of the sparse encoder, and the kernels of its convolutions.

use super::grid::CHANNELS;
use crate::config::{Check, InvalidConfig, define_config, from_to, require};

/// Kernel, stride and padding along z, y, x.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SparseKernel {
    pub kernel: [usize; 3],
    pub stride: [usize; 3],
    pub padding: [usize; 3],
}

impl SparseKernel {
    /// 3x3x3 around each site.
    pub const SUBMANIFOLD: Self = Self { kernel: [3; 3], stride: [1; 3], padding: [1; 3] };

    /// Number of offsets of the kernel.
    pub fn n_offsets(&self) -> usize {
        self.kernel.iter().product()
    }

    /// Output cells of an input grid; `None` where the kernel does not fit.
    pub fn out_shape(&self, shape: [usize; 3]) -> Option<[usize; 3]> {
        let mut out = [0; 3];
        for axis in 0..3 {
            let padded = shape[axis] + 2 * self.padding[axis];
            out[axis] = padded.checked_sub(self.kernel[axis])? / self.stride[axis] + 1;
        }
        Some(out)
    }
}

define_config! {
    /// Stages of the encoder; the default is the published one.
    #[derive(Eq)]
    pub struct SparseEncoderConfig {
        /// Channels of each stage; from one to the next, y and x (and z) are halved.
        channels: Vec<usize> = vec![16, 32, 64, 128], in CHANNELS.list(1, 8);
        /// Residual blocks of each stage.
        n_blocks: Vec<usize> = vec![2, 2, 2, 2], in from_to(0.0, 100.0).list(1, 8);
        /// Padding along z, in cells, of the stride-2 convolution between two stages; along y and x it is 1.
        z_padding: Vec<usize> = vec![1, 1, 0], in from_to(0.0, 1.0).list(0, 7);
        /// Channels of the last convolution, at each height that remains.
        channels_out: usize = 128, in CHANNELS;
    }
}

impl SparseEncoderConfig {
    /// The strided convolutions in order: between stages, then the last one along z.
    pub fn strided_kernels(&self) -> Vec<SparseKernel> {
        let last = SparseKernel { kernel: [3, 1, 1], stride: [2, 1, 1], padding: [0; 3] };
        let down = |&z: &usize| SparseKernel { kernel: [3; 3], stride: [2; 3], padding: [z, 1, 1] };
        self.z_padding.iter().map(down).chain([last]).collect()
    }

    /// Cells of the output along z, y, x, for a grid of voxels; `None` where a kernel does not fit.
    #[must_use]
    pub fn out_shape(&self, shape: [usize; 3]) -> Option<[usize; 3]> {
        self.strided_kernels().iter().try_fold(shape, |shape, geometry| geometry.out_shape(shape))
    }

    /// Checks how the lists fit each other and a grid of cells along z, y, x.
    pub(crate) fn check_with(&self, shape: [usize; 3]) -> Result<(), InvalidConfig> {
        let n_stages = self.channels.len();
        let is_one_each = self.n_blocks.len() == n_stages;
        require(is_one_each, "n_blocks", format!("{:?}", self.n_blocks), "one for each stage is needed")?;
        let found = format!("{:?}", self.z_padding);
        let is_one_each = self.z_padding.len() + 1 == n_stages;
        require(is_one_each, "z_padding", &found, "0 or 1 between any two stages is needed")?;
        let wanted = "some height must remain for each convolution: pad, or voxelize finer along z";
        require(self.out_shape(shape).is_some(), "z_padding", &found, wanted)
    }
}

impl Check for SparseEncoderConfig {}

#[cfg(test)]
mod tests {
    use super::*;

    const STRIDED: SparseKernel = SparseKernel { kernel: [3; 3], stride: [2; 3], padding: [1; 3] };

    #[test]
    fn shapes_of_the_published_encoder() {
        let down = STRIDED.out_shape([41, 1440, 720]).and_then(|shape| STRIDED.out_shape(shape)).unwrap();
        let flat = SparseKernel { padding: [0, 1, 1], ..STRIDED }.out_shape(down).unwrap();
        let last = SparseKernel { kernel: [3, 1, 1], stride: [2, 1, 1], padding: [0; 3] }.out_shape(flat);
        assert_eq!((down, flat, last), ([11, 360, 180], [5, 180, 90], Some([2, 180, 90])));
        assert_eq!(SparseKernel { padding: [0; 3], ..STRIDED }.out_shape([2, 9, 9]), None);
    }

    #[test]
    fn a_config_that_does_not_fit_names_its_field() {
        let field = |config: SparseEncoderConfig| {
            let found = config.check().and_then(|()| config.check_with([41, 64, 64]));
            found.unwrap_err().key().to_owned()
        };
        let good = SparseEncoderConfig::default;
        assert_eq!(field(SparseEncoderConfig { n_blocks: vec![2], ..good() }), "n_blocks");
        assert_eq!(field(SparseEncoderConfig { z_padding: vec![1, 1], ..good() }), "z_padding");
        assert_eq!(field(SparseEncoderConfig { channels: vec![], ..good() }), "channels");
        assert_eq!(good().check_with([8, 64, 64]).unwrap_err().key(), "z_padding");
    }
}
