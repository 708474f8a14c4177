//! Harm labels: each annotated object of an episode, harmful or harmless by a danger zone.

pub mod apply;
pub mod counts;
pub mod zone;
