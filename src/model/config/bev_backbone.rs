//! Sizes of the bird's-eye backbone and its neck.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};

/// How a coarse scale is brought to the first scale's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Upsample {
    /// The published way: a transposed convolution, its kernel as large as its stride.
    Transpose,
    /// A 1x1 convolution whose cells are repeated: fewer weights, faster on a CPU.
    Nearest,
}

/// Scales of the backbone; the default is the published one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BevBackboneConfig {
    /// Channels of each scale.
    pub channels: Vec<usize>,
    /// Stride of each scale's first convolution, 1 or 2.
    pub strides: Vec<usize>,
    /// Convolutions of each scale that follow its first one.
    pub n_layers: Vec<usize>,
    /// Channels that each scale hands on.
    pub channels_out: Vec<usize>,
    pub upsample: Upsample,
}

impl Default for BevBackboneConfig {
    fn default() -> Self {
        Self {
            channels: vec![128, 256],
            strides: vec![1, 2],
            n_layers: vec![5, 5],
            channels_out: vec![256, 256],
            upsample: Upsample::Transpose,
        }
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

    /// Checks what the types cannot say, for a map of cells along y and x.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self, shape: [usize; 2]) -> Result<(), ModelConfigError> {
        let lists = [
            ("backbone.channels", &self.channels, 1),
            ("backbone.strides", &self.strides, 1),
            ("backbone.n_layers", &self.n_layers, 0),
            ("backbone.channels_out", &self.channels_out, 1),
        ];
        for (field, list, least) in lists {
            if list.is_empty() || list.len() != self.channels.len() || list.iter().any(|&n| n < least) {
                return fail(
                    field,
                    format!("{list:?}"),
                    "there is one for each scale, at least 1 (layers: 0)",
                );
            }
        }
        if self.strides.iter().any(|&stride| stride > 2) {
            return fail("backbone.strides", format!("{:?}", self.strides), "a stride is 1 or 2");
        }
        let total: usize = self.strides.iter().product();
        if shape.iter().any(|&n| n == 0 || !n.is_multiple_of(total)) {
            return fail(
                "backbone.strides",
                format!("{:?} for a map of {shape:?} cells", self.strides),
                "their product must divide the map",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_that_does_not_fit_names_its_field() {
        let good = BevBackboneConfig::default;
        assert_eq!(good().check([180, 90]), Ok(()));
        assert_eq!(good().check([180, 91]).unwrap_err().field, "backbone.strides");
        let wrong = BevBackboneConfig { strides: vec![1, 3], ..good() };
        assert_eq!(wrong.check([180, 90]).unwrap_err().field, "backbone.strides");
        let wrong = BevBackboneConfig { channels_out: vec![256], ..good() };
        assert_eq!(wrong.check([180, 90]).unwrap_err().field, "backbone.channels_out");
        assert!(BevBackboneConfig { channels: vec![], ..good() }.check([180, 90]).is_err());
    }
}
