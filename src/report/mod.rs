//! Scores and samples for people: text tables, pictures, and one page of all.

mod breakdown;
mod canvas;
pub mod curves;
pub mod info;
pub mod page;
mod palette;
mod plot;
pub mod sweeps;
pub mod table;
pub mod view;
pub mod zones;

pub use breakdown::breakdown;
pub use table::table;
