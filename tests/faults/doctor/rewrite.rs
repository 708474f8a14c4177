//! Episodes and labels written again with other content, so that no hash and no checksum tells of it.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::episode::{
    EpisodeMeta, EpisodeReader, EpisodeWriter, LabelManifest, LabelReader, LabelWriter, Manifest,
    SampleLabels,
};
use harmzone::files::{sha256_of, write_manifest};
use harmzone::object::Object;
use harmzone::sample::{Sample, Truth};
use mcap::records::Metadata;
use mcap::{Compression, Message, MessageStream, Summary, WriteOptions};

/// The label set of the data sets here.
pub const SET: &str = "rect";

pub fn manifest(path: &Path) -> Manifest {
    Manifest::read(path).expect("a data set")
}

pub fn change_manifest(path: &Path, change: impl FnOnce(&mut Manifest)) {
    let mut manifest = manifest(path);
    change(&mut manifest);
    manifest.write(path).expect("a writable copy");
}

/// As [`change_manifest`], for what this program would not write.
pub fn spoil_manifest(path: &Path, change: impl FnOnce(&mut Manifest)) {
    let mut manifest = manifest(path);
    change(&mut manifest);
    write_manifest(&path.join(Manifest::FILE), &manifest).expect("a writable copy");
}

pub fn change_labels(path: &Path, change: impl FnOnce(&mut LabelManifest)) {
    let mut labels = LabelManifest::read(path, SET).expect("a label set");
    change(&mut labels);
    labels.write(path).expect("a writable copy");
}

/// The file of an episode, by a number that may be higher than there are.
pub fn episode(path: &Path, i: usize) -> PathBuf {
    let episodes = manifest(path).episodes;
    path.join(&episodes[i % episodes.len()].file)
}

/// The label file of an episode, numbered likewise.
pub fn label_file(path: &Path, i: usize) -> PathBuf {
    let labels = LabelManifest::read(path, SET).expect("a label set");
    LabelManifest::folder(path, SET).join(&labels.episodes[i % labels.episodes.len()].file)
}

/// Samples as they lie in an episode, and its metadata.
pub fn read(file: &Path) -> (EpisodeMeta, Vec<Sample>) {
    let reader = EpisodeReader::open(file).expect("a whole episode");
    let samples = (0..reader.len()).map(|i| reader.whole_sample(i).expect("a whole episode"));
    (reader.meta().clone(), samples.collect())
}

/// Writes an episode with other samples or metadata, and what of it the manifest names; its labels stay as they are.
pub fn rewrite_under_labels(path: &Path, i: usize, change: impl FnOnce(&mut EpisodeMeta, &mut Vec<Sample>)) {
    let file = episode(path, i);
    let (mut meta, mut samples) = read(&file);
    let map = EpisodeReader::open(&file).and_then(|reader| reader.map()).expect("a whole episode");
    change(&mut meta, &mut samples);
    let mut writer = EpisodeWriter::create(&file, &meta, &map).expect("a writable copy");
    samples.iter().for_each(|sample| writer.write(sample).expect("samples that can be written"));
    let done = writer.finish().expect("a writable copy");
    change_manifest(path, |manifest| {
        let n = manifest.episodes.len();
        let entry = &mut manifest.episodes[i % n];
        (entry.n_samples, entry.n_objects, entry.sha256) = (done.n_samples, done.n_objects, done.sha256);
    });
}

/// The same, without labels, which would be of another episode.
pub fn rewrite(path: &Path, i: usize, change: impl FnOnce(&mut EpisodeMeta, &mut Vec<Sample>)) {
    rewrite_under_labels(path, i, change);
    let _ = fs::remove_dir_all(path.join("labels"));
}

/// Changes all samples alike.
pub fn rewrite_each(path: &Path, i: usize, change: impl Fn(&mut Sample)) {
    rewrite(path, i, |_, samples| samples.iter_mut().for_each(&change));
}

pub fn truth(sample: &mut Sample) -> &mut Truth {
    sample.truth.as_mut().expect("a simulated sample")
}

/// The object with the most points.
pub fn largest(sample: &mut Sample) -> &mut Object {
    let objects = &mut truth(sample).objects;
    objects.iter_mut().max_by_key(|object| object.n_lidar_points).expect("a sample with objects")
}

/// Writes an episode's messages again as MCAP, changed as no writer of episodes would, and its hash into the manifest.
pub fn rewrite_raw(path: &Path, i: usize, change: impl FnOnce(&mut Vec<Message<'static>>)) {
    let file = episode(path, i);
    let bytes = fs::read(&file).expect("a readable file");
    let stream = MessageStream::new(&bytes).expect("an MCAP");
    let mut messages: Vec<Message<'static>> = stream.collect::<Result<_, _>>().expect("an MCAP");
    let summary = Summary::read(&bytes).expect("an MCAP").expect("an index");
    let metadata: Vec<Metadata> = summary
        .metadata_indexes
        .iter()
        .map(|index| mcap::read::metadata(&bytes, index).expect("a record"))
        .collect();
    change(&mut messages);
    let options =
        WriteOptions::new().compression(Some(Compression::Zstd)).profile("").library("harmzone test");
    let mut writer = options.create(Cursor::new(Vec::<u8>::new())).expect("memory can be written");
    let mut before = None;
    for message in &messages {
        // A chunk holds one sample.
        if before.is_some_and(|time_ns| time_ns != message.log_time) {
            writer.flush().expect("memory can be written");
        }
        before = Some(message.log_time);
        writer.write(message).expect("memory can be written");
    }
    metadata.iter().for_each(|record| writer.write_metadata(record).expect("memory can be written"));
    writer.finish().expect("memory can be written");
    fs::write(&file, writer.into_inner().into_inner()).expect("a writable copy");
    name_hash(path, i);
}

/// Names the hash of an episode's file, whatever it is now, in the manifest; its labels, which would be of another, are deleted.
pub fn name_hash(path: &Path, i: usize) {
    let sha256 = sha256_of(&episode(path, i)).expect("a readable file");
    change_manifest(path, |manifest| {
        let n = manifest.episodes.len();
        manifest.episodes[i % n].sha256 = sha256;
    });
    let _ = fs::remove_dir_all(path.join("labels"));
}

/// Changes some bytes of the first message of a topic that holds them.
pub fn replace(messages: &mut [Message<'static>], topic: &str, from: &[u8], to: &[u8]) {
    for message in messages.iter_mut().filter(|message| message.channel.topic == topic) {
        let at = message.data.windows(from.len()).position(|found| found == from);
        if let Some(at) = at {
            message.data.to_mut()[at..at + to.len()].copy_from_slice(to);
            return;
        }
    }
    panic!("{topic} does not hold these bytes");
}

/// The stamps with which messages of a topic begin (`google.protobuf.Timestamp`: its first field, the seconds, is a varint) are a
/// hundred seconds later.
pub fn shift_stamps(messages: &mut [Message<'static>], topic: &str) {
    for message in messages.iter_mut().filter(|message| message.channel.topic == topic) {
        let bytes = message.data.to_mut();
        assert_eq!((bytes[0], bytes[2]), (0x0a, 0x08), "{topic} begins with its stamp");
        let mut carried = 100;
        // Seven bits a byte, the lowest first.
        for byte in &mut bytes[3..] {
            let sum = u16::from(*byte & 0x7f) + carried;
            *byte = *byte & 0x80 | (sum & 0x7f) as u8;
            carried = sum >> 7;
            if carried == 0 {
                break;
            }
        }
    }
}

/// Exchanges the first message of a topic with the last, of which the times in the file stay.
pub fn exchange(messages: &mut [Message<'static>], topic: &str) {
    let is_of_topic = |message: &Message<'_>| message.channel.topic == topic;
    let first = messages.iter().position(is_of_topic).expect("the topic is there");
    let last = messages.iter().rposition(is_of_topic).expect("the topic is there");
    assert_ne!(messages[first].data, messages[last].data, "{topic}");
    let (before, after) = messages.split_at_mut(last);
    std::mem::swap(&mut before[first].data, &mut after[0].data);
}

/// Writes an episode's labels changed, and the file's hash into the set's manifest.
pub fn rewrite_labels(path: &Path, i: usize, change: impl FnOnce(&mut Vec<SampleLabels>)) {
    let (_, samples) = read(&episode(path, i));
    let file = label_file(path, i);
    let (meta, mut labels) = {
        let reader = LabelReader::open(&file).expect("whole labels");
        (reader.meta().clone(), reader.samples().to_vec())
    };
    change(&mut labels);
    let mut writer = LabelWriter::create(&file, &meta).expect("a writable copy");
    for (labels, sample) in labels.iter().zip(&samples) {
        writer.write(labels, sample).expect("labels that can be written");
    }
    writer.finish().expect("a writable copy");
    change_labels(path, |labels| {
        let n = labels.episodes.len();
        labels.episodes[i % n].sha256 = sha256_of(&file).expect("a readable file");
    });
}
