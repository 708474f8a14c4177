//! What people look at: drawings of samples, tables and reports of scores.

pub mod view;
