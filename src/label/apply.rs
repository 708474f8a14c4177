//! A zone applied to one sample: its corners and a label for each true object, in their order.
//!
//! Pure: errors name episode, sample and object, and nothing is read or written.

use thiserror::Error;

use super::zone::{Verdict, Zone, ZoneError};
use crate::geometry::Point2;
use crate::sample::Sample;

/// Why a sample could not be labelled.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SampleError {
    #[error("sample {sample_idx} of episode `{episode}` has no zone: {source}")]
    State { episode: String, sample_idx: usize, source: ZoneError },
    #[error("object `{object}` in sample {sample_idx} of episode `{episode}` cannot be labelled: {source}")]
    Object { episode: String, sample_idx: usize, object: String, source: ZoneError },
    #[error(
        "object `{object}` stands twice in sample {sample_idx} of episode `{episode}`; ids must be unique"
    )]
    Twice { episode: String, sample_idx: usize, object: String },
}

/// The labels of one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleLabels {
    /// Corners of the zone in the ego frame, counter-clockwise from the near right one.
    pub zone: Vec<Point2>,
    /// One for each true object, in the sample's order.
    pub labels: Vec<ObjectLabel>,
}

/// One object's label.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectLabel {
    pub id: String,
    pub verdict: Verdict,
}

/// Labels a sample; `episode` and `sample_idx` serve the errors.
///
/// # Errors
/// The ego's state or an object's box cannot be, or an id stands twice.
pub fn label_sample(
    zone: &Zone,
    episode: &str,
    sample_idx: usize,
    sample: &Sample,
) -> Result<SampleLabels, SampleError> {
    let rect = zone.rect(&sample.measured.ego_state).map_err(|source| SampleError::State {
        episode: episode.to_owned(),
        sample_idx,
        source,
    })?;
    let mut labels: Vec<ObjectLabel> = Vec::with_capacity(sample.truth.objects.len());
    for object in &sample.truth.objects {
        if labels.iter().any(|label| label.id == object.id) {
            let (episode, object) = (episode.to_owned(), object.id.clone());
            return Err(SampleError::Twice { episode, sample_idx, object });
        }
        let verdict = rect.harm_of(&object.box_in_ego).map_err(|source| SampleError::Object {
            episode: episode.to_owned(),
            sample_idx,
            object: object.id.clone(),
            source,
        })?;
        labels.push(ObjectLabel { id: object.id.clone(), verdict });
    }
    Ok(SampleLabels { zone: rect.corners().to_vec(), labels })
}
