//! Sizes of the bird's-eye backbone and its neck.

use serde::{Deserialize, Serialize};

use super::grid::CHANNELS;
use crate::config::{Check, InvalidConfig, define_config, from_to, require};

/// How a coarse scale is brought to the first scale's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Upsample {
    /// The published way: a transposed convolution, its kernel as large as its stride.
    Transpose,
    /// A 1x1 convolution whose cells are repeated: fewer weights, faster on a CPU.
    Nearest,
}

define_config! {
    /// Scales of the backbone; the default is the published one.
    #[derive(Eq)]
    pub struct BevBackboneConfig {
        /// Channels of each scale.
        channels: Vec<usize> = vec![128, 256], in CHANNELS.list(1, 8);
        /// Stride of each scale's first convolution, 1 or 2.
        strides: Vec<usize> = vec![1, 2], in from_to(1.0, 2.0).list(1, 8);
        /// Convolutions of each scale that follow its first one.
        n_layers: Vec<usize> = vec![5, 5], in from_to(0.0, 100.0).list(1, 8);
        /// Channels that each scale hands on.
        channels_out: Vec<usize> = vec![256, 256], in CHANNELS.list(1, 8);
        /// How a coarse scale comes to the size of the finest.
        upsample: Upsample = Upsample::Transpose;
    }
}

impl BevBackboneConfig {
    /// Cells of the input along y and x for one cell of the output.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.strides.first().copied().unwrap_or(1)
    }

    /// Channels of the output, all scales together.
    #[must_use]
    pub fn n_channels_out(&self) -> usize {
        self.channels_out.iter().sum()
    }

    /// Checks how the lists fit each other and a map of cells along y and x.
    pub(super) fn check_with(&self, shape: [usize; 2]) -> Result<(), InvalidConfig> {
        let lists =
            [("strides", &self.strides), ("n_layers", &self.n_layers), ("channels_out", &self.channels_out)];
        for (key, list) in lists {
            let is_one_each = list.len() == self.channels.len();
            require(is_one_each, key, format!("{list:?}"), "one for each scale is needed")?;
        }
        let total: usize = self.strides.iter().product();
        let divides = shape.iter().all(|&n| n > 0 && n.is_multiple_of(total));
        let found = format!("{:?} for a map of {shape:?} cells", self.strides);
        require(divides, "strides", found, "their product must divide the map")
    }
}

impl Check for BevBackboneConfig {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_that_does_not_fit_names_its_field() {
        let field = |config: BevBackboneConfig, shape| {
            let found = config.check().and_then(|()| config.check_with(shape));
            found.err().map(|error| error.key().to_owned())
        };
        let good = BevBackboneConfig::default;
        assert_eq!(field(good(), [180, 90]), None);
        assert_eq!(field(good(), [180, 91]).unwrap(), "strides");
        let wrong = BevBackboneConfig { strides: vec![1, 3], ..good() };
        assert_eq!(field(wrong, [180, 90]).unwrap(), "strides");
        let wrong = BevBackboneConfig { channels_out: vec![256], ..good() };
        assert_eq!(field(wrong, [180, 90]).unwrap(), "channels_out");
        assert!(field(BevBackboneConfig { channels: vec![], ..good() }, [180, 90]).is_some());
    }
}
