//! Harm labels: each annotated object of an episode, harmful or harmless by a danger zone.

mod apply;
mod counts;
mod run;

pub use apply::{SampleError, label_sample};
pub use counts::{Summary, count_of};
pub use run::{LabelError, run};
