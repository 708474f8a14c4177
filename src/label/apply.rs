//! A zone applied to one sample: its corners and a label for each true object, in their order.
//!
//! Pure: errors name episode, sample and object, and nothing is read or written.

use thiserror::Error;

use crate::episode::{ObjectLabel, SampleLabels};
use crate::sample::Sample;
use crate::zone::{Zone, ZoneError};

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

/// Labels a sample; `episode` and `sample_idx` are for the errors.
///
/// # Errors
/// The ego's state or an object's box is not valid, or an id occurs twice.
pub fn label_sample(
    zone: &Zone,
    episode: &str,
    sample_idx: usize,
    sample: &Sample,
) -> Result<SampleLabels, SampleError> {
    let here = zone.at(sample.true_state()).map_err(|source| SampleError::State {
        episode: episode.to_owned(),
        sample_idx,
        source,
    })?;
    let mut labels: Vec<ObjectLabel> = Vec::with_capacity(sample.objects().len());
    for object in sample.objects() {
        let id = object.id.clone().unwrap_or_default();
        if labels.iter().any(|label| label.id == id) {
            let (episode, object) = (episode.to_owned(), id);
            return Err(SampleError::Twice { episode, sample_idx, object });
        }
        let verdict = here.harm_of_object(object).map_err(|source| SampleError::Object {
            episode: episode.to_owned(),
            sample_idx,
            object: id.clone(),
            source,
        })?;
        labels.push(ObjectLabel {
            id,
            harm: verdict.harm,
            overlap_area_m2: verdict.overlap_area_m2,
            overlap_ratio: verdict.overlap_ratio,
            time_to_collision_s: verdict.time_to_collision_s,
        });
    }
    Ok(SampleLabels {
        time_ns: sample.measured.time_ns,
        zone_name: zone.config().kind.name().to_owned(),
        zone_corners: here.corners().to_vec(),
        labels,
    })
}
