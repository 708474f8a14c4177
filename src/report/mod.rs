//! Scores for people: text tables and pictures.

pub mod table;

pub use table::table;
