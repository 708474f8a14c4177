//! All that `harmzone eval` finds out: the headline metrics, their confidence, breakdowns, and safety.

use serde::{Deserialize, Serialize};

use super::bootstrap::{self, Confidence};
use super::breakdown::{self, Breakdown};
use super::metrics::{self, Metrics};
use super::protocol::Protocol;
use super::safety::{self, Safety};
use super::{EvalSample, Mode, ScoreError, check, pretty_json};

/// The content of `metrics.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    #[serde(flatten)]
    pub metrics: Metrics,
    /// `None` if no resample was asked for, or there is but one episode.
    pub confidence: Option<Confidence>,
    /// One for each axis of which something is known.
    pub breakdowns: Vec<Breakdown>,
    pub safety: Safety,
}

impl Evaluation {
    /// The file's text; the same figures give the same bytes.
    #[must_use]
    pub fn to_json(&self) -> String {
        pretty_json::to_string(self)
    }
}

/// Scores detections against truths, with everything that the facts of samples and truths allow.
///
/// # Errors
/// As [`super::score`].
pub fn evaluate(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<Evaluation, ScoreError> {
    check(samples, protocol, mode)?;
    let (kept, filters) = metrics::filtered(samples, protocol.config());
    let matching = metrics::matched(&kept, protocol.config());
    Ok(Evaluation {
        confidence: bootstrap::intervals(&kept, &matching, protocol, mode),
        breakdowns: breakdown::break_down(&kept, &matching, protocol),
        safety: safety::measure(&kept, &matching, protocol),
        metrics: metrics::measure(&kept, &matching, filters, protocol, mode),
    })
}
