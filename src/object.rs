//! Objects around the ego: what is really there, what a detector reports, and whether it harms.

use serde::{Deserialize, Serialize};

use crate::geometry::{Box3, Ego};

/// The three kinds of the paper's statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Vehicle,
    Pedestrian,
    Static,
}

impl Kind {
    /// All three, in channel order.
    pub const ALL: [Self; 3] = [Self::Vehicle, Self::Pedestrian, Self::Static];

    /// The kind's channel.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::Vehicle => 0,
            Self::Pedestrian => 1,
            Self::Static => 2,
        }
    }
}

/// Whether training data may hold such an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// In distribution: seen in training.
    Id,
    /// Out of distribution: one of the kinds that no training set holds.
    Ood,
}

/// What an object out of distribution does in its episode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// Nothing of the kind.
    #[default]
    None,
    /// It lies on the road.
    Lies,
    /// It falls from a balcony.
    Falls,
    /// It rolls or tumbles across the road.
    Rolls,
    /// It is thrown before the ego.
    Thrown,
}

/// The two classes of the detector, in the order of its channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Harm {
    Harmful,
    Harmless,
}

impl Harm {
    /// Both classes, in channel order.
    pub const ALL: [Self; 2] = [Self::Harmful, Self::Harmless];

    /// The class's name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Harmful => "harmful",
            Self::Harmless => "harmless",
        }
    }

    /// The class's channel: 0 harmful, 1 harmless.
    #[must_use]
    pub fn index(self) -> usize {
        match self {
            Self::Harmful => 0,
            Self::Harmless => 1,
        }
    }
}

/// One object of the world as it truly is at a sample's time.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectTruth {
    /// Unique and stable within the episode.
    pub id: String,
    /// The model's family: `car`, `child`, `hay_bale`, ...
    pub category: String,
    pub kind: Kind,
    pub distribution: Distribution,
    pub box_in_ego: Box3<Ego>,
    /// Velocity over ground, expressed in the ego frame: x, y.
    pub velocity_in_ego_mps: [f64; 2],
    pub n_lidar_points: u32,
    pub visible_px: u32,
    /// Visible pixels over the pixels of the whole silhouette inside the image, 0 to 1.
    pub visible_fraction: f32,
    pub event: Event,
}

/// Lowest score that a reported box may have.
pub const MIN_SCORE: f32 = 0.01;

/// One box that a detector reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    pub box_in_ego: Box3<Ego>,
    pub velocity_in_ego_mps: [f64; 2],
    pub harm: Harm,
    /// Confidence, 0 to 1.
    pub score: f32,
}

/// A true object with its label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledObject {
    pub truth: ObjectTruth,
    pub harm: Harm,
}
