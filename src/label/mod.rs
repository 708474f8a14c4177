//! Harm labels: each annotated object of an episode is harmful or harmless by a danger zone; compares zones
//! too.

mod apply;
mod compare;
mod counts;
mod run;

pub use apply::SampleError;
pub use compare::{MOVING_MPS, ZoneComparison, ZoneCounts, compare};
pub use counts::{LabelSummary, count_of};
pub use run::{LabelError, run};
