//! What a model is in the world: object or background, how it stands beside a street, how it rolls.

use serde::Deserialize;

/// Where a model's x axis points beside a street.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Faces {
    /// Over the kerb.
    #[default]
    Street,
    /// Towards the oncoming drivers.
    Traffic,
}

/// What a model is to a detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Annotated wherever it is seen or hit.
    #[default]
    Object,
    /// Seen and hit, but never annotated: bushes; and what stops a car, such as rubbish bags, whose ground is ignored.
    Background,
}

/// Whether things of a category grow on the ground beside pavements, and give way.
pub(super) fn is_plant(category: &str) -> bool {
    matches!(category, "bush" | "hedge")
}

/// The axis about which a model is round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RollAxis {
    Y,
    Z,
}
