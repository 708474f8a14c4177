//! Sizes of the sparse encoder, and the kernels of its convolutions.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};

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

/// Stages of the encoder; the default is the published one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SparseEncoderConfig {
    /// Channels of each stage; from one to the next, y and x (and z) are halved.
    pub channels: Vec<usize>,
    /// Residual blocks of each stage.
    pub n_blocks: Vec<usize>,
    /// Padding along z, in cells, of the stride-2 convolution between two stages; along y and x it is 1.
    pub z_padding: Vec<usize>,
    /// Channels of the last convolution, at each height that remains.
    pub channels_out: usize,
}

impl Default for SparseEncoderConfig {
    fn default() -> Self {
        Self {
            channels: vec![16, 32, 64, 128],
            n_blocks: vec![2, 2, 2, 2],
            z_padding: vec![1, 1, 0],
            channels_out: 128,
        }
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

    /// Checks what the types cannot say, for a grid of cells along z, y, x.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self, shape: [usize; 3]) -> Result<(), ModelConfigError> {
        let n_stages = self.channels.len();
        if n_stages == 0 || self.channels.contains(&0) {
            return fail("encoder.channels", format!("{:?}", self.channels), "each stage needs at least 1");
        }
        if self.n_blocks.len() != n_stages {
            return fail("encoder.n_blocks", format!("{:?}", self.n_blocks), "there is one for each stage");
        }
        if self.z_padding.len() + 1 != n_stages || self.z_padding.iter().any(|&padding| padding > 1) {
            return fail(
                "encoder.z_padding",
                format!("{:?}", self.z_padding),
                "there is 0 or 1 between any two stages",
            );
        }
        if self.channels_out == 0 {
            return fail("encoder.channels_out", 0, "it must be at least 1");
        }
        if self.out_shape(shape).is_none() {
            return fail(
                "encoder.z_padding",
                format!("{:?}", self.z_padding),
                "some height must remain for each convolution: pad, or voxelize finer along z",
            );
        }
        Ok(())
    }
}

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
        let field = |config: SparseEncoderConfig| config.check([41, 64, 64]).unwrap_err().field;
        let good = SparseEncoderConfig::default;
        assert_eq!(field(SparseEncoderConfig { n_blocks: vec![2], ..good() }), "encoder.n_blocks");
        assert_eq!(field(SparseEncoderConfig { z_padding: vec![1, 1], ..good() }), "encoder.z_padding");
        assert_eq!(field(SparseEncoderConfig { channels: vec![], ..good() }), "encoder.channels");
        assert_eq!(good().check([8, 64, 64]).unwrap_err().field, "encoder.z_padding");
    }
}
