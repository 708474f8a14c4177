//! MCAP files of some kilobytes that unpack to hundreds of megabytes: refused before they take the memory.

use std::collections::BTreeMap;
use std::path::Path;

use fs_err as fs;
use mcap::Compression;
use mcap::records::MessageHeader;

use super::archive_reader::Archive;
use super::error::MAX_CHUNK_BYTES;
use super::*;

const MESSAGE_BYTES: usize = 1 << 20;

/// Writes chunks of messages that hold zeros, of 1 MiB each.
fn write_zeros(path: &Path, compression: Compression, chunks: &[usize]) {
    let options = mcap::WriteOptions::new().compression(Some(compression)).chunk_size(None);
    let mut writer = options.compression_threads(0).create(fs::File::create(path).unwrap()).unwrap();
    let schema = writer.add_schema("car_msgs/msg/Zeros", "ros2msg", b"uint8[] zeros").unwrap();
    let channel_id = writer.add_channel(schema, "/zeros", "cdr", &BTreeMap::new()).unwrap();
    let (mut log_time, zeros) = (0, vec![0; MESSAGE_BYTES]);
    for n_messages in chunks {
        for _ in 0..*n_messages {
            log_time += 1;
            let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &zeros).unwrap();
        }
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
}

fn assert_told(error: &EpisodeError, path: &Path) {
    let told = error.to_string();
    let bound = format!("up to {MAX_CHUNK_BYTES} are read");
    assert!(told.contains(&bound) && told.contains(&path.display().to_string()), "{told}");
}

#[test]
fn a_chunk_that_unpacks_to_more_than_a_sample_takes_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.mcap");
    let n_too_many = MAX_CHUNK_BYTES as usize / MESSAGE_BYTES;
    for compression in [Compression::Zstd, Compression::Lz4] {
        write_zeros(&path, compression, &[n_too_many]);
        assert!(fs::metadata(&path).unwrap().len() < MAX_CHUNK_BYTES / 100);
        let file = ForeignFile::open(&path).unwrap();
        let channel_id = file.topics()[0].channel_id;
        assert_told(&file.chunk(0, &[channel_id]).unwrap_err(), &path);
        assert_told(&check_archive(&path).unwrap_err(), &path);
        write_zeros(&path, compression, &[3]);
        let file = ForeignFile::open(&path).unwrap();
        assert_eq!(file.chunk(0, &[channel_id]).unwrap().len(), 3);
        assert_eq!(check_archive(&path).unwrap().n_messages, 3);
    }
}

#[test]
fn many_chunks_that_belong_to_one_read_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bombs.mcap");
    let half = MAX_CHUNK_BYTES as usize / MESSAGE_BYTES / 2;
    write_zeros(&path, Compression::Zstd, &[half, half]);
    assert_eq!(check_archive(&path).unwrap().n_messages, 2 * half);
    let archive = Archive::open(&path, &[]).unwrap();
    let channel_ids: Vec<u16> = archive.summary.channels.keys().copied().collect();
    assert_eq!(archive.between(1, 1, &channel_ids).unwrap().len(), 1);
    assert_told(&archive.between(0, u64::MAX, &channel_ids).err().unwrap(), &path);
}
