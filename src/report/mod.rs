//! Scores and samples for people: text tables, charts, pictures, and one page of all. Nothing here runs a network.

mod canvas;
pub mod chart;
pub mod clips;
pub mod compare;
pub mod curves;
pub mod document;
mod foxglove_layout;
pub mod info;
pub mod missed;
pub mod page;
mod palette;
mod paper;
pub mod provenance;
pub mod results;
pub mod score_tables;
pub mod scores;
pub mod standing;
pub mod sweeps;
pub mod table;
pub mod versus;
pub mod view;
pub mod zones;

pub use foxglove_layout::foxglove_layout;
