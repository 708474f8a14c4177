//! MCAP files with one part replaced, whole in every other way: fuzzers seldom hit lengths, offsets and checksums.

use std::io::Cursor;
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::{Channel, Compression, WriteOptions};

/// A file taken apart.
pub struct Parts {
    /// By number, ascending.
    channels: Vec<Arc<Channel<'static>>>,
    messages: Vec<(MessageHeader, Vec<u8>)>,
    metadata: Vec<mcap::records::Metadata>,
}

/// What is replaced, in the channel of this index.
#[derive(Clone, Copy)]
pub enum Part<'a> {
    Nothing,
    /// Each of its messages.
    Messages(usize, &'a [u8]),
    /// The text of its schema.
    Schema(usize, &'a [u8]),
    /// The values of the metadata records: lines of `key=value`.
    Metadata(&'a [u8]),
}

impl Parts {
    pub fn of(file: &[u8]) -> Self {
        let summary = mcap::Summary::read(file).expect("it was just written").expect("it has a summary");
        let mut channels: Vec<_> = summary.channels.values().cloned().collect();
        channels.sort_by_key(|channel| channel.id);
        let message = |message: mcap::Message<'_>| {
            let mcap::Message { channel, sequence, log_time, publish_time, data } = message;
            (MessageHeader { channel_id: channel.id, sequence, log_time, publish_time }, data.into_owned())
        };
        let messages = mcap::MessageStream::new(file).expect("it was just written");
        let messages = messages.map(|one| message(one.expect("it was just written"))).collect();
        let metadata = summary.metadata_indexes.iter().map(|index| mcap::read::metadata(file, index));
        let metadata = metadata.collect::<Result<_, _>>().expect("it was just written");
        Self { channels, messages, metadata }
    }

    pub fn n_channels(&self) -> usize {
        self.channels.len()
    }

    /// The first message of a channel, for seeds.
    pub fn message(&self, channel_idx: usize) -> Option<&[u8]> {
        let id = self.channels.get(channel_idx)?.id;
        let of_channel = self.messages.iter().find(|(header, _)| header.channel_id == id);
        of_channel.map(|(_, data)| data.as_slice())
    }

    /// The schema of a channel, for seeds.
    pub fn schema(&self, channel_idx: usize) -> Option<&[u8]> {
        Some(&self.channels.get(channel_idx)?.schema.as_ref()?.data)
    }

    /// The metadata as [`Part::Metadata`] takes it, for seeds.
    pub fn metadata_lines(&self) -> String {
        let values = self.metadata.iter().flat_map(|record| &record.metadata);
        values.map(|(key, value)| format!("{key}={}\n", value.replace('\n', "\u{1}"))).collect()
    }

    /// The whole file, unpacked and without checksums, with one part replaced.
    pub fn with(&self, part: Part<'_>) -> Vec<u8> {
        self.packed(part, None)
    }

    /// The same, packed.
    pub fn packed(&self, part: Part<'_>, by: Option<Compression>) -> Vec<u8> {
        let options = WriteOptions::new()
            .compression(by)
            .calculate_chunk_crcs(false)
            .calculate_data_section_crc(false)
            .calculate_summary_section_crc(false);
        let mut writer = options.create(Cursor::new(Vec::new())).expect("memory can be written");
        let mut ids = Vec::new();
        for (idx, channel) in self.channels.iter().enumerate() {
            let (name, encoding, text) = channel.schema.as_ref().map_or(("", "", &[][..]), |schema| {
                (schema.name.as_str(), schema.encoding.as_str(), schema.data.as_ref())
            });
            let text = match part {
                Part::Schema(changed, bytes) if changed == idx => bytes,
                _ => text,
            };
            let schema = writer.add_schema(name, encoding, text).expect("few schemas fit");
            let id = writer.add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata);
            ids.push((channel.id, id.expect("few channels fit"), idx));
        }
        for (header, data) in &self.messages {
            let Some((_, id, idx)) = ids.iter().find(|(old, ..)| *old == header.channel_id) else { continue };
            let data = match part {
                Part::Messages(changed, bytes) if changed == *idx => bytes,
                _ => data,
            };
            let header = MessageHeader { channel_id: *id, ..*header };
            writer.write_to_known_channel(&header, data).expect("the channel is there");
        }
        for record in &self.metadata {
            let mut record = record.clone();
            if let Part::Metadata(lines) = part {
                for line in String::from_utf8_lossy(lines).lines() {
                    let Some((key, value)) = line.split_once('=') else { continue };
                    if let Some(old) = record.metadata.get_mut(key) {
                        *old = value.replace('\u{1}', "\n");
                    }
                }
            }
            writer.write_metadata(&record).expect("memory can be written");
        }
        writer.finish().expect("memory can be written");
        writer.into_inner().into_inner()
    }
}
