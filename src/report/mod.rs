//! Scores and samples for people: text tables and pictures.

pub mod table;
pub mod view;

pub use table::table;
