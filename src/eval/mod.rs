//! Scores a detector by the nuScenes detection protocol, in and out of distribution.
//!
//! Classes: harmful and harmless. A detection matches a truth by the distance of their centres on the
//! ground (0.5, 1, 2, 4 m); AP per class and distance, and ATE, ASE and AOE at 2 m, equal
//! nuscenes-devkit's. Out of distribution each false positive is attributed to the truth it was made
//! on, if any, which gives four columns ([`Column`]). All boxes are in the ego frame.

mod axis;
mod bootstrap;
mod breakdown;
mod curve;
mod evaluation;
mod expected;
mod faults;
mod filter;
pub mod json;
pub mod judge;
mod matching;
mod metrics;
mod neutral;
mod pairing;
mod part;
mod pretty_json;
mod protocol;
pub mod safety;
mod sample;
pub mod sweep;
pub mod versus;

/// Number of the rules by which scores are made: raised with each change of them, or of what a rival's boxes are, so that scores that were
/// kept by other rules are made anew. 2: a closed set's boxes are ranked by the sum of their kinds. 3: so are those that its own rules judge; an
/// event goes on where the filters drop its object; an alarm on a harmful object that the LiDAR did not hit is not false; a LiDAR's beams are its
/// rig's. 4: nor is such an alarm false that lies on a harmless object or ignored ground, too, and it may be the last that counts.
pub const SCORING: u32 = 4;

pub use axis::Axis;
pub use bootstrap::{Confidence, Intervals, interval, resample};
pub use breakdown::{Breakdown, Group, GroupScores};
pub use curve::Curve;
pub use evaluation::{Evaluation, evaluate, score};
pub use faults::{Fault, FaultKind, FaultPlace, list_faults};
pub use filter::Filters;
pub use matching::{PerClass, center_distance_m};
pub use metrics::{ClassScores, Column, Columns, Counts, Metrics, OutcomeCounts, TpErrors, TruthCounts};
pub use neutral::{NeutralCounts, NeutralReason};
pub use protocol::{BreakdownConfig, EvalConfig, MissingClass, Protocol, SafetyConfig};
pub use sample::{EvalSample, Mode, ScoreError, eval_samples, mean_period_s};
