//! Reads an MCAP from its first byte to its last, against every checksum in it.

use std::io::Read as _;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::error::{EpisodeError, MAX_CHUNK_BYTES};
use crate::store;

/// What a whole file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArchiveCounts {
    pub n_bytes: u64,
    pub n_records: usize,
    pub n_messages: usize,
}

/// Checks a file as a whole: the checksums of its chunks leave out the records between them, that of all data does not.
///
/// # Errors
/// The file is cut short, damaged or no MCAP.
pub fn check_archive(path: &Path) -> Result<ArchiveCounts, EpisodeError> {
    read_whole(path, |_| {})
}

/// As [`check_archive`]; hands over each record, and for a chunk those inside it once its CRC holds.
pub(super) fn read_whole(
    path: &Path,
    mut take: impl FnMut(&Record<'_>),
) -> Result<ArchiveCounts, EpisodeError> {
    let damaged = |source| EpisodeError::Damaged { source, path: path.to_owned() };
    let mut file = store::open_file(path)?;
    let n_bytes = file.metadata()?.len();
    let options = LinearReaderOptions::default()
        .with_check_finishes_after_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(MAX_CHUNK_BYTES as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut counts = ArchiveCounts { n_bytes, n_records: 0, n_messages: 0 };
    while let Some(event) = reader.next_event() {
        match event.map_err(damaged)? {
            LinearReadEvent::ReadRequest(n_wanted) => {
                let n_read = file.read(reader.insert(n_wanted))?;
                reader.notify_read(n_read);
            }
            LinearReadEvent::Record { opcode, data } => {
                counts.n_records += 1;
                let record = mcap::parse_record(opcode, data).map_err(damaged)?;
                counts.n_messages += usize::from(matches!(record, Record::Message { .. }));
                take(&record);
            }
        }
    }
    Ok(counts)
}

/// Whether chunks lie in each other, by their offsets and lengths: one that the index names twice would give its messages twice, and
/// take the memory for each.
pub(super) fn overlap(chunks: impl Iterator<Item = [u64; 2]>) -> bool {
    let mut places: Vec<[u64; 2]> =
        chunks.map(|[begin, length]| [begin, begin.saturating_add(length)]).collect();
    places.sort_unstable();
    places.windows(2).any(|pair| pair[1][0] < pair[0][1])
}

#[cfg(test)]
mod tests {
    use rustix::fs::{CWD, Mode, mkfifoat};

    use super::*;
    use crate::episode::EpisodeReader;

    #[test]
    fn a_pipe_in_place_of_an_episode_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        mkfifoat(CWD, &path, Mode::RUSR | Mode::WUSR).unwrap();
        for error in [check_archive(&path).unwrap_err(), EpisodeReader::open(&path).err().unwrap()] {
            let told = error.to_string();
            assert!(told.contains("this is no file: a pipe") && told.ends_with("a.mcap"), "{told}");
        }
    }

    #[test]
    fn a_chunk_that_is_named_twice_is_found() {
        let of = |chunks: &[[u64; 2]]| overlap(chunks.iter().copied());
        assert!(!of(&[[70, 30], [8, 62]]));
        assert!(of(&[[8, 62], [70, 30], [8, 62]]) && of(&[[8, 63], [70, 30]]));
    }
}
