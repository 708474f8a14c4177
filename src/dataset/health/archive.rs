//! Whether a file's index is that of its messages, which the checksums of neither tell.

use std::path::Path;

use super::check::{Aspect, Remark};
use crate::episode::{ArchiveCounts, EpisodeError, ForeignFile};

/// The topic by which samples are found.
const SAMPLES: &str = "/ego/state";

/// What the index of a whole file says: the times of its samples in the order in which they lie in the file, and a remark
/// where it is not the index of the messages.
///
/// # Errors
/// The file has no index, or it cannot be read.
pub(super) fn examine(
    path: &Path,
    counts: ArchiveCounts,
) -> Result<(Vec<u64>, Option<Remark>), EpisodeError> {
    let file = ForeignFile::open(path)?;
    let (mut in_file_ns, mut n_indexed) = (Vec::new(), 0);
    for topic in file.topics() {
        let places = file.places(topic.channel_id)?;
        n_indexed += places.len();
        if topic.name == SAMPLES {
            in_file_ns = places.iter().map(|place| place.log_time_ns).collect();
        }
    }
    let n_told: u64 = file.topics().iter().map(|topic| topic.n_messages).sum();
    let is_right = n_indexed == counts.n_messages && n_told == counts.n_messages as u64;
    let remark = (!is_right).then(|| {
        let text = format!(
            "the file holds {} messages, its index finds {n_indexed} and its statistics say {n_told}; all three should be \
             one number: {}",
            counts.n_messages,
            path.display()
        );
        Remark::fault(Aspect::Checksums, "index", text)
    });
    Ok((in_file_ns, remark))
}
