//! A ROS 2 bag: a folder with `metadata.yaml` and one or more MCAP files, or one such file; topics, types and messages.
//!
//! Messages are read by the files' indexes, a chunk at a time. Bags in other containers are refused with the tool that
//! converts them.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::cdr::{self, CdrError, Value};
use super::container;
use super::message::frame_name;
use super::schema::{MessageType, short_name};
use crate::episode::{EpisodeError, ForeignFile, ForeignMessage, ForeignTopic, MessagePlace, tell_damage};
use crate::import::ImportError;

/// Chunks that are kept unpacked: a sample's cloud and picture, and the next ones, mostly lie in as many.
const CHUNKS_KEPT: usize = 3;

/// A bag of which only the indexes have been read.
pub struct Bag {
    path: PathBuf,
    files: Vec<ForeignFile>,
    topics: BTreeMap<String, BagTopic>,
    recent: RefCell<Vec<(ChunkKey, Rc<Vec<ForeignMessage>>)>>,
    /// By topic, once asked for.
    places: RefCell<BTreeMap<String, Rc<Vec<Place>>>>,
}

/// File, chunk and channel.
type ChunkKey = (usize, usize, u16);

/// A topic over all files of a bag.
pub struct BagTopic {
    pub name: String,
    /// `sensor_msgs/PointCloud2`.
    pub type_name: String,
    pub n_messages: u64,
    /// The type's fields, or why they are not known.
    fields: Result<MessageType, String>,
    /// File and channel.
    channels: Vec<(usize, u16)>,
}

/// Where a message of a bag lies; in the order of log times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    pub log_time_ns: u64,
    file_idx: usize,
    channel_id: u16,
    at: MessagePlace,
}

impl BagTopic {
    fn new(topic: &ForeignTopic) -> Self {
        let type_name = topic.schema.as_ref().map(|schema| short_name(&schema.name)).unwrap_or_default();
        Self {
            name: topic.name.clone(),
            fields: fields_of(topic, &type_name),
            type_name,
            n_messages: 0,
            channels: Vec::new(),
        }
    }

    /// The type's fields, or why they are not known.
    pub fn message_type(&self) -> Result<&MessageType, String> {
        self.fields.as_ref().map_err(|why| format!("topic `{}` cannot be read: {why}", self.name))
    }

    /// Whether the type's name is one of these.
    #[must_use]
    pub fn is_of(&self, type_names: &[&str]) -> bool {
        type_names.contains(&self.type_name.as_str())
    }
}

fn fields_of(topic: &ForeignTopic, type_name: &str) -> Result<MessageType, String> {
    let Some(schema) = &topic.schema else {
        return Err("the file has no schema for it; `mcap recover` or `ros2 bag convert` may add one".into());
    };
    if topic.message_encoding != "cdr" {
        let found = &topic.message_encoding;
        return Err(format!("its messages are packed as `{found}`; `cdr` is needed, as ROS 2 writes it"));
    }
    if schema.encoding != "ros2msg" && !schema.data.is_empty() {
        let found = &schema.encoding;
        return Err(format!("its schema is written in `{found}`; `ros2msg` is needed"));
    }
    let text = std::str::from_utf8(&schema.data).map_err(|_| "its schema text is not UTF-8")?;
    MessageType::parse(type_name, text).map_err(|error| error.to_string())
}

impl Bag {
    /// Reads the indexes.
    ///
    /// # Errors
    /// A file is missing, cut short or has no index, or the bag is of another container, which the error names with the
    /// tool that converts it.
    pub fn open(path: &Path) -> Result<Self, ImportError> {
        let mut bag = Self {
            path: path.to_owned(),
            files: Vec::new(),
            topics: BTreeMap::new(),
            recent: RefCell::new(Vec::new()),
            places: RefCell::new(BTreeMap::new()),
        };
        for path in container::mcap_files(path)? {
            let file = ForeignFile::open(&path).map_err(|error| tell_file(error, &path))?;
            bag.add(file)?;
        }
        Ok(bag)
    }

    fn add(&mut self, file: ForeignFile) -> Result<(), ImportError> {
        let file_idx = self.files.len();
        for topic in file.topics() {
            let new = BagTopic::new(topic);
            let known = self.topics.entry(topic.name.clone()).or_insert_with(|| BagTopic::new(topic));
            if new.type_name != known.type_name {
                let (name, one, other) = (&topic.name, &known.type_name, &new.type_name);
                let message =
                    format!("topic `{name}` is of the type `{one}` and of `{other}`; one type is needed");
                return Err(ImportError::at(file.path(), message));
            }
            if new.fields != known.fields {
                // Nobody may need the topic.
                known.fields = Err(format!(
                    "its type `{}` has other fields in {} than in files of the bag before it; import the files one at a time",
                    known.type_name,
                    file.path().display()
                ));
            }
            known.n_messages += topic.n_messages;
            known.channels.push((file_idx, topic.channel_id));
        }
        self.files.push(file);
        Ok(())
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topics by name.
    pub fn topics(&self) -> impl Iterator<Item = &BagTopic> {
        self.topics.values()
    }

    /// Topics with messages of known fields.
    pub fn readable(&self) -> impl Iterator<Item = &BagTopic> {
        self.topics().filter(|topic| topic.n_messages > 0 && topic.message_type().is_ok())
    }

    /// The topic of a name that a mapping's key gives.
    ///
    /// # Errors
    /// There is none; the error names those that there are.
    pub fn topic(&self, key: &str, name: &str) -> Result<&BagTopic, ImportError> {
        self.topics.get(name).ok_or_else(|| {
            let found: Vec<String> = self.topics.keys().map(|name| format!("`{name}`")).collect();
            let message = format!("{key} is `{name}`, which the bag lacks; it has {}", found.join(", "));
            ImportError::at(&self.path, message)
        })
    }

    /// Where the messages of a topic lie, in the order of log times.
    ///
    /// # Errors
    /// A file or its index is damaged.
    pub fn places(&self, topic: &BagTopic) -> Result<Rc<Vec<Place>>, ImportError> {
        if let Some(known) = self.places.borrow().get(&topic.name) {
            return Ok(Rc::clone(known));
        }
        let mut places = Vec::new();
        for &(file_idx, channel_id) in &topic.channels {
            let file = &self.files[file_idx];
            let found = file.places(channel_id).map_err(|error| tell_file(error, file.path()))?;
            places.extend(found.into_iter().map(|at| Place {
                log_time_ns: at.log_time_ns,
                file_idx,
                channel_id,
                at,
            }));
        }
        places.sort_unstable();
        let places = Rc::new(places);
        self.places.borrow_mut().insert(topic.name.clone(), Rc::clone(&places));
        Ok(places)
    }

    /// The frame of a topic's first message; `None` where its messages have no header.
    ///
    /// # Errors
    /// The file is damaged, or the message is not valid.
    pub fn first_frame(&self, topic: &BagTopic) -> Result<Option<String>, ImportError> {
        let Some(&first) = self.places(topic)?.first() else { return Ok(None) };
        self.read(topic, first, |value| {
            Ok(value.text("header.frame_id").ok().map(|frame| frame_name(frame).to_owned()))
        })
    }

    /// Reads and decodes the message at a place.
    ///
    /// # Errors
    /// The file is damaged, or the message or what is made of it is not valid.
    pub fn read<T>(
        &self,
        topic: &BagTopic,
        place: Place,
        take: impl FnOnce(&Value) -> Result<T, String>,
    ) -> Result<T, ImportError> {
        let key = (place.file_idx, place.at.chunk_idx, place.channel_id);
        let messages = self.chunk(key)?;
        let fail = |why: String| self.tell_message(topic, place.file_idx, place.log_time_ns, &why);
        let message = messages.get(place.at.ordinal);
        let message = message.ok_or_else(|| fail("the index names a message that is not there".into()))?;
        let message_type = topic.message_type().map_err(|why| ImportError::at(&self.path, why))?;
        let value = cdr::decode(message_type, &message.bytes).map_err(|error| fail(error.to_string()))?;
        take(&value).map_err(fail)
    }

    fn chunk(&self, key: ChunkKey) -> Result<Rc<Vec<ForeignMessage>>, ImportError> {
        let mut recent = self.recent.borrow_mut();
        if let Some((_, messages)) = recent.iter().find(|(kept, _)| *kept == key) {
            return Ok(Rc::clone(messages));
        }
        let (file_idx, chunk_idx, channel_id) = key;
        let file = &self.files[file_idx];
        let messages = file.chunk(chunk_idx, &[channel_id]).map_err(|error| tell_file(error, file.path()))?;
        let messages = Rc::new(messages);
        if recent.len() == CHUNKS_KEPT {
            recent.remove(0);
        }
        recent.push((key, Rc::clone(&messages)));
        Ok(messages)
    }

    /// Goes once through all messages of some topics, chunk by chunk; each with its place.
    ///
    /// # Errors
    /// The file is damaged, a topic's type is not known, or a message is not valid.
    pub fn visit(
        &self,
        topics: &[&BagTopic],
        mut take: impl FnMut(&BagTopic, Place, &Value) -> Result<(), CdrError>,
    ) -> Result<(), ImportError> {
        for (file_idx, file) in self.files.iter().enumerate() {
            let of_channel: BTreeMap<u16, &BagTopic> = topics
                .iter()
                .flat_map(|topic| topic.channels.iter().map(move |channel| (channel, *topic)))
                .filter(|((of_file, _), _)| *of_file == file_idx)
                .map(|((_, channel_id), topic)| (*channel_id, topic))
                .collect();
            let ids: Vec<u16> = of_channel.keys().copied().collect();
            for chunk_idx in (0..file.n_chunks()).filter(|&idx| file.chunk_holds(idx, &ids)) {
                let mut n_met: BTreeMap<u16, usize> = BTreeMap::new();
                let messages = file.chunk(chunk_idx, &ids).map_err(|error| tell_file(error, file.path()))?;
                for ForeignMessage { channel_id, log_time_ns, bytes } in messages {
                    let topic = of_channel[&channel_id];
                    let ordinal = n_met.entry(channel_id).or_insert(0);
                    let at = MessagePlace { log_time_ns, chunk_idx, ordinal: *ordinal };
                    *ordinal += 1;
                    let message_type =
                        topic.message_type().map_err(|why| ImportError::at(&self.path, why))?;
                    let place = Place { log_time_ns, file_idx, channel_id, at };
                    cdr::decode(message_type, &bytes).and_then(|value| take(topic, place, &value)).map_err(
                        |error| self.tell_message(topic, file_idx, log_time_ns, &error.to_string()),
                    )?;
                }
            }
        }
        Ok(())
    }

    fn tell_message(&self, topic: &BagTopic, file_idx: usize, log_time_ns: u64, why: &str) -> ImportError {
        let (name, seconds) = (&topic.name, seconds(log_time_ns));
        ImportError::at(self.files[file_idx].path(), format!("topic `{name}`, message of {seconds}: {why}"))
    }
}

/// A stamp as people read it: seconds with nine decimals.
#[must_use]
pub fn seconds(time_ns: u64) -> String {
    format!("{}.{:09} s", time_ns / 1_000_000_000, time_ns % 1_000_000_000)
}

/// What is wrong with a file of a bag, and what mends it.
fn tell_file(error: EpisodeError, path: &Path) -> ImportError {
    let recover = "`mcap recover FILE -o WHOLE` keeps what is whole and writes an index";
    match error {
        EpisodeError::Damaged { source, .. } => ImportError::at(
            path,
            format!("the bag's file is cut short, damaged or no MCAP ({}); {recover}", tell_damage(&source)),
        ),
        EpisodeError::NoIndex { .. } => {
            ImportError::at(path, format!("the bag's file has no index; {recover}"))
        }
        EpisodeError::Io(error) if error.kind() == std::io::ErrorKind::NotFound => {
            ImportError::at(path, "the bag's file is missing")
        }
        other => other.into(),
    }
}

#[cfg(test)]
mod tests {
    use fs_err as fs;
    use mcap::records::MessageHeader;

    use super::*;

    /// A file of one message on `/state`, whose type has these fields.
    fn write_file(path: &Path, fields: &str) {
        let mut writer = mcap::WriteOptions::new().create(fs::File::create(path).unwrap()).unwrap();
        let schema = writer.add_schema("car_msgs/msg/State", "ros2msg", fields.as_bytes()).unwrap();
        let channel_id = writer.add_channel(schema, "/state", "cdr", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &[0; 20]).unwrap();
        writer.finish().unwrap();
    }

    #[test]
    fn a_type_of_one_name_and_other_fields_is_read_by_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name);
        write_file(&file("a.mcap"), "float64 speed # m/s\nfloat64 steering\n");
        write_file(&file("b.mcap"), "float64 speed\n\nfloat64 steering\n");
        let open = || Bag::open(folder.path()).unwrap();
        assert_eq!(open().topic("speed", "/state").unwrap().n_messages, 2);
        open().topic("speed", "/state").unwrap().message_type().unwrap();
        write_file(&file("c.mcap"), "float64 steering\nfloat64 speed\n");
        let bag = open();
        let told = bag.topic("speed", "/state").unwrap().message_type().unwrap_err();
        assert!(told.contains("other fields") && told.contains("c.mcap"), "{told}");
    }
}
