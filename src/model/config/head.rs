//! The TransFusion head's sizes and choices.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};
use super::grid::GridConfig;

/// How speed and steering reach the prediction heads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NumericFusion {
    /// The paper's: a feed-forward net to `[1, query]`, concatenated with the decoder's output
    /// and fused by a 1x1 convolution.
    Paper,
    /// A feed-forward net to a scale and a shift for each channel of the class branch.
    Film,
    /// Ablation: the network does not see speed and steering.
    None,
}

/// What a peak of the heatmap stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Heatmap {
    /// One channel: any object. A query may report both classes.
    Agnostic,
    /// A channel for harmful and one for harmless, as the paper's class-specific heatmap. A query reports
    /// the class of its channel alone.
    PerClass,
}

impl Heatmap {
    /// Number of heatmap channels.
    #[must_use]
    pub fn n_channels(self) -> usize {
        match self {
            Self::Agnostic => 1,
            Self::PerClass => 2,
        }
    }
}

/// How positions of queries and cells become channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PositionEncoding {
    /// One net for both, from metres, without batch norm.
    Shared,
    /// Published: one net for queries and one for cells, from cell units, with batch norm.
    Separate,
}

/// What predicts boxes and harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prediction {
    /// One net for the box; the class branch sees the query's position and that box too.
    Placed,
    /// Published: a net for each of centre, height, size, rotation, velocity and class.
    Separate,
}

/// What the class branch tells apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Classes {
    /// Harmful and harmless.
    Harm,
    /// Vehicle, pedestrian and static: a closed set, which knows nothing of harm; for a baseline.
    Kind,
}

impl Classes {
    /// Number of classes.
    #[must_use]
    pub fn n(self) -> usize {
        match self {
            Self::Harm => 2,
            Self::Kind => 3,
        }
    }
}

/// The head.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HeadConfig {
    /// Channels of the queries. Default 64; the paper's 128.
    pub channels: usize,
    /// Default 64; the paper's 200.
    pub n_queries: usize,
    /// Attention heads; a divisor of `channels`. Default 4; the paper's 8.
    pub n_heads: usize,
    /// Hidden channels of the decoder's feed-forward net. Default 128; the paper's 256.
    pub ffn_channels: usize,
    /// Share of activations dropped in the decoder in training. Default 0; the paper's 0.1.
    pub dropout: f64,
    /// Batch norm and ReLU after the first convolution. Default true; published: false.
    pub shared_norm: bool,
    pub heatmap: Heatmap,
    /// Heatmap cells along each side of a feature cell: 1 or 2. At 2 objects that stand closer than two
    /// feature cells have peaks of their own. Default 2; published: 1.
    pub heatmap_scale: usize,
    /// Side of the square in which a peak is the highest cell, 3 or 1, for each class of the heatmap (an agnostic
    /// heatmap uses the first). The published head has 1 for its small classes, pedestrian and
    /// cone; harmful and harmless hold every size, so both profiles have 3.
    pub peak_kernels: [usize; 2],
    /// Whether the map's outermost cells can be peaks (of a 3x3 kernel). Default true; published: false.
    pub border_peaks: bool,
    pub positions: PositionEncoding,
    pub prediction: Prediction,
    /// Hidden channels of each of the separate nets. The paper's 64.
    pub prediction_channels: usize,
    pub numeric_fusion: NumericFusion,
    /// Default `harm`.
    pub classes: Classes,
}

impl Default for HeadConfig {
    fn default() -> Self {
        Self {
            channels: 64,
            n_queries: 64,
            n_heads: 4,
            ffn_channels: 128,
            dropout: 0.0,
            shared_norm: true,
            heatmap: Heatmap::Agnostic,
            heatmap_scale: 2,
            peak_kernels: [3, 3],
            border_peaks: true,
            positions: PositionEncoding::Shared,
            prediction: Prediction::Placed,
            prediction_channels: 64,
            numeric_fusion: NumericFusion::Film,
            classes: Classes::Harm,
        }
    }
}

impl HeadConfig {
    /// Channels of the net that makes the heatmap: each class for each place in a feature cell.
    #[must_use]
    pub fn n_heatmap_outputs(&self) -> usize {
        self.heatmap.n_channels() * self.heatmap_scale * self.heatmap_scale
    }

    pub(super) fn check(&self, grid: &GridConfig) -> Result<(), ModelConfigError> {
        if self.n_heads == 0 || self.channels == 0 || !self.channels.is_multiple_of(self.n_heads) {
            return fail("head.n_heads", self.n_heads, "it must divide head.channels");
        }
        if self.n_queries == 0 || self.n_queries > grid.n_cells() {
            return fail("head.n_queries", self.n_queries, "it must lie between 1 and the number of cells");
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return fail("head.dropout", self.dropout, "it must lie in 0..1");
        }
        if self.peak_kernels.iter().any(|kernel| ![1, 3].contains(kernel)) {
            return fail("head.peak_kernels", format!("{:?}", self.peak_kernels), "each must be 1 or 3");
        }
        if self.classes == Classes::Kind && self.heatmap == Heatmap::PerClass {
            return fail(
                "head.classes",
                "kind",
                "its heatmap must be agnostic: per_class is harmful and harmless",
            );
        }
        if ![1, 2].contains(&self.heatmap_scale) {
            return fail("head.heatmap_scale", self.heatmap_scale, "it must be 1 or 2");
        }
        for (field, count) in
            [("head.ffn_channels", self.ffn_channels), ("head.prediction_channels", self.prediction_channels)]
        {
            if count == 0 {
                return fail(field, count, "it must be at least 1");
            }
        }
        Ok(())
    }
}
