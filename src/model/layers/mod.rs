//! The blocks that all parts of the network share: convolutions with their norms, resampling, linear layers.

mod conv;
mod linear;
mod norm;
mod resample;

pub use conv::{ConvBlock, convolve, convolve_pointwise, kaiming, plain_conv, pointwise};
pub use linear::{Mlp, NormedMlp, linear_over_channels, xavier};
pub use norm::{NormStatistics, batch_norm, batch_norm_relu, lidar_norm};
pub use resample::{resize_bilinear, upsample_nearest};
