//! The TransFusion head's sizes and choices.

use serde::{Deserialize, Serialize};

use super::grid::{CHANNELS, GridConfig};
use crate::config::{InvalidConfig, below, define_config, from_to, require};

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

/// The meaning of a peak of the heatmap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Heatmap {
    /// One channel: any object. A query may report both classes.
    Agnostic,
    /// A channel for harmful and one for harmless, as the paper's class-specific heatmap. A query reports
    /// only the class of its channel.
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

/// The nets that predict boxes and harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prediction {
    /// One net for the box; the class branch sees the query's position and that box too.
    Placed,
    /// Published: a net for each of centre, height, size, rotation, velocity and class.
    Separate,
}

/// The classes of the class branch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Classes {
    /// Harmful and harmless.
    Harm,
    /// Vehicle, pedestrian and static: a closed set, which does not know harm; for a baseline.
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

/// Who decides on the harm of the boxes that the network finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadJudge {
    /// The class branch.
    Network,
    /// The class branch and the expected verdict of the zone `rect` over the spreads of box, measured speed and steering: the
    /// mean of their log odds.
    Both,
}

define_config! {
    /// The head.
    #[derive(Copy)]
    pub struct HeadConfig {
        /// Channels of the queries. Default 96; the paper's 128.
        channels: usize = 96, in CHANNELS;
        /// Number of queries. Default 64; the paper's 200.
        n_queries: usize = 64, in from_to(1.0, 10_000.0);
        /// Attention heads; a divisor of `channels`. Default 4; the paper's 8.
        n_heads: usize = 4, in CHANNELS;
        /// Hidden channels of the decoder's feed-forward net. Default 128; the paper's 256.
        ffn_channels: usize = 128, in from_to(1.0, 4096.0);
        /// Share of activations dropped in the decoder in training. Default 0; the paper's 0.1.
        dropout: f64 = 0.0, in below(0.0, 1.0);
        /// Batch norm and ReLU after the first convolution. Default true; published: false.
        shared_norm: bool = true;
        /// What a peak of the heatmap means.
        heatmap: Heatmap = Heatmap::Agnostic;
        /// Heatmap cells along each side of a feature cell: 1 or 2. At 2 objects that stand closer than two
        /// feature cells have peaks of their own. Default 2; published: 1.
        heatmap_scale: usize = 2, in from_to(1.0, 2.0);
        /// Side of the square in which a peak is the highest cell, 3 or 1, for each class of the heatmap (an agnostic
        /// heatmap uses the first). The published head has 1 for its small classes, pedestrian and
        /// cone; harmful and harmless hold every size, so both profiles have 3.
        peak_kernels: [usize; 2] = [3, 3], in from_to(1.0, 3.0).list(2, 2);
        /// Whether the map's outermost cells can be peaks (of a 3x3 kernel). Default true; published: false.
        border_peaks: bool = true;
        /// The heatmap's value to this power, times the class's probability, is a box's score. Default 1/4; published: 1. Less
        /// leaves the ranking more to the class, which has seen the whole object.
        heatmap_power: f64 = 0.25, in from_to(0.0, 1.0);
        /// How positions of queries and cells become channels.
        positions: PositionEncoding = PositionEncoding::Shared;
        /// The nets that predict boxes and harm.
        prediction: Prediction = Prediction::Placed;
        /// Side of the square of pillars that each query looks at, in pillars: odd, or 0 for none. Pillars alone have it.
        look_pillars: usize = 0, in from_to(0.0, 15.0);
        /// Whether each number of a box comes with a spread, which the class branch sees too. Boxes of separate nets have none.
        spread: bool = true;
        /// Hidden channels of each of the separate nets. The paper's 64.
        prediction_channels: usize = 64, in CHANNELS;
        /// How speed and steering join.
        numeric_fusion: NumericFusion = NumericFusion::Film;
        /// Classes; default `harm`.
        classes: Classes = Classes::Harm;
        /// Who decides on harm: the class branch alone, or `both`, it and the expected verdict of the zone `rect` with its default sizes. A
        /// training on labels of another zone takes `network`, and says so. Training does not depend on it. Default both; the paper's network.
        judge: HeadJudge = HeadJudge::Both;
    }
}

impl HeadConfig {
    /// Channels of the net that makes the heatmap: one for each class and place in a feature cell.
    #[must_use]
    pub fn n_heatmap_outputs(&self) -> usize {
        self.heatmap.n_channels() * self.heatmap_scale * self.heatmap_scale
    }

    /// What a peak of the heatmap counts in a score; with a power of 1 the very same number. A cell that is no peak has 0 and
    /// keeps it.
    #[must_use]
    pub fn raise_peak(&self, peak: f32) -> f32 {
        if self.heatmap_power == 1.0 || peak == 0.0 { peak } else { peak.powf(self.heatmap_power as f32) }
    }

    /// Checks how the sizes fit each other and the grid.
    pub(super) fn check_with(&self, grid: &GridConfig) -> Result<(), InvalidConfig> {
        let is_odd = self.look_pillars == 0 || self.look_pillars % 2 == 1;
        require(is_odd, "look_pillars", self.look_pillars, "0 or an odd number is needed")?;
        let divides = self.channels.is_multiple_of(self.n_heads);
        require(divides, "n_heads", self.n_heads, "it must divide head.channels")?;
        let fits = self.n_queries <= grid.n_cells();
        require(fits, "n_queries", self.n_queries, "it must be at most the number of cells")?;
        let [a, b] = self.peak_kernels;
        require(a != 2 && b != 2, "peak_kernels", format!("[{a}, {b}]"), "each must be 1 or 3")?;
        let is_told = self.classes == Classes::Harm || self.heatmap == Heatmap::Agnostic;
        let wanted = "its heatmap must be agnostic: per_class is harmful and harmless";
        require(is_told, "classes", "kind", wanted)
    }
}
