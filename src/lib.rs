//! harmzone: makes driving episodes, labels objects by a danger zone, trains and scores a fused detector.
//!
//! The modules are layered; each imports only from layers below its own (`tests/architecture.rs`
//! checks it). `ARCHITECTURE.md` has the map.

pub mod config;
pub mod device;
pub mod files;
pub mod geometry;
pub mod history;
pub mod progress;
pub mod random;
pub mod text_table;

pub mod object;
pub mod sample;
pub mod zone;

pub mod scene;
pub mod sensors;

pub mod episode;
#[allow(clippy::disallowed_methods, reason = "the one module that speaks to Python")]
pub mod sim;

pub mod generate;
pub mod label;

pub mod dataset;
#[allow(unsafe_code, reason = "vector instructions; every block states its bounds")]
pub mod kernels;

pub mod eval;
pub mod infer;
pub mod model;
pub mod train;

pub mod report;

pub mod cli;
