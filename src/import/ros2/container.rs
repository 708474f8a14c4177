//! Which files a bag consists of, and what other containers there are, with the tool that converts each.
//!
//! Files of a folder without `metadata.yaml` are one bag where each goes on where the one before ended, else a bag each.

use std::io::Read;
use std::path::{Path, PathBuf};

use fs_err as fs;

use crate::episode::{EpisodeError, ForeignFile};
use crate::files;
use crate::files::inside;
use crate::import::ImportError;

const MCAP_MAGIC: &[u8] = b"\x89MCAP";
const ROS1_MAGIC: &[u8] = b"#ROSBAG";
const SQLITE_MAGIC: &[u8] = b"SQLite format 3";
const ZSTD_MAGIC: &[u8] = b"\x28\xb5\x2f\xfd";

/// Files of one recording go on where the one before ended, up to this.
const MOST_APART_NS: u64 = 2_000_000_000;
/// A file's span is that of its topics with the most messages.
const TOPICS_LOOKED_AT: usize = 4;

/// What stands in `metadata.yaml`, as far as a reader of MCAP files needs it.
#[derive(Debug, Clone, Default, PartialEq)]
struct BagMetadata {
    storage: String,
    compression_mode: String,
    files: Vec<String>,
}

/// The MCAP files of a bag in their order.
///
/// # Errors
/// There is none, one is missing or named outside of the bag's folder, or the bag is of another container.
pub(super) fn mcap_files(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if !files::is_dir(path)? {
        check_magic(path)?;
        return Ok(vec![path.to_owned()]);
    }
    let metadata_path = path.join("metadata.yaml");
    if !files::is_there(&metadata_path)? {
        let files = files_ending_in(path, "mcap")?;
        if files.is_empty() {
            for other in files_ending_in(path, "db3")?.into_iter().chain(files_ending_in(path, "bag")?) {
                check_magic(&other)?;
            }
            let message = "the folder is no ROS 2 bag: it has neither `metadata.yaml` nor an .mcap file";
            return Err(ImportError::at(path, message));
        }
        return Ok(files);
    }
    let text = crate::import::error::read_text(&metadata_path)?;
    let metadata = BagMetadata::parse(&text);
    if metadata.storage == "sqlite3" {
        return Err(sqlite(path));
    }
    match metadata.compression_mode.to_lowercase().as_str() {
        "" | "none" | "storage" => {}
        "file" => {
            let message = "the bag's files are compressed as a whole; `zstd -d` each of them, or `ros2 bag convert` the bag";
            return Err(ImportError::at(&metadata_path, message));
        }
        _ => {
            let message = "the bag's messages are compressed one by one; `ros2 bag convert` with `compression_mode: none`";
            return Err(ImportError::at(&metadata_path, message));
        }
    }
    if metadata.files.is_empty() {
        let message = "the bag's metadata names no files; `ros2 bag reindex -s mcap FOLDER` writes it anew";
        return Err(ImportError::at(&metadata_path, message));
    }
    // Some writers name the files by the folder in which they lay.
    let place = |name: &String| {
        let beside = path.join(Path::new(name).file_name().unwrap_or_default());
        match inside(path, name) {
            Ok(whole) if files::is_there(&whole)? => Ok(whole),
            Err(error) if !files::is_file(&beside)? => {
                Err(ImportError::at(&metadata_path, format!("relative_file_paths: {error}")))
            }
            _ => Ok(beside),
        }
    };
    let files = metadata.files.iter().map(place).collect::<Result<Vec<PathBuf>, ImportError>>()?;
    files.iter().try_for_each(|file| check_magic(file))?;
    Ok(files)
}

/// The bags under a path: itself, or where it is a folder of bags, each of them.
///
/// # Errors
/// The folder or a file's index cannot be read.
pub(super) fn bags_under(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if !files::is_dir(path)? {
        return Ok(vec![path.to_owned()]);
    }
    let own = bags_in(path)?;
    if !own.is_empty() {
        return Ok(own);
    }
    let mut bags = Vec::new();
    for entry in fs::read_dir(path)? {
        let folder = entry?.path();
        if files::is_dir(&folder)? {
            bags.extend(bags_in(&folder)?);
        }
    }
    bags.sort();
    Ok(if bags.is_empty() { vec![path.to_owned()] } else { bags })
}

/// The bags that a folder's own files are: the folder, or without metadata each of its files; none where it has none.
fn bags_in(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if files::is_there(&folder.join("metadata.yaml"))? {
        return Ok(vec![folder.to_owned()]);
    }
    let files = files_ending_in(folder, "mcap")?;
    let is_one = files.len() <= 1 || is_one_recording(&files)?;
    Ok(if is_one && !files.is_empty() { vec![folder.to_owned()] } else { files })
}

/// Whether each file begins about when the one before it ended. Files without a span, empty or damaged, do not count here.
fn is_one_recording(files: &[PathBuf]) -> Result<bool, ImportError> {
    let mut spans = Vec::new();
    for file in files {
        match span_ns(file) {
            Err(EpisodeError::Io(error)) => return Err(error.into()),
            // What is wrong is told when the bag is opened.
            Err(_) => {}
            Ok(span) => spans.extend(span),
        }
    }
    spans.sort_unstable();
    Ok(spans.windows(2).all(|pair| pair[1].0.abs_diff(pair[0].1) <= MOST_APART_NS))
}

/// The first and last log time of a file.
fn span_ns(path: &Path) -> Result<Option<(u64, u64)>, EpisodeError> {
    let file = ForeignFile::open(path)?;
    let mut topics: Vec<_> = file.topics().iter().collect();
    topics.sort_by_key(|topic| std::cmp::Reverse(topic.n_messages));
    let (mut first_ns, mut last_ns) = (u64::MAX, 0);
    for topic in topics.into_iter().take(TOPICS_LOOKED_AT) {
        for place in file.places(topic.channel_id)? {
            first_ns = first_ns.min(place.log_time_ns);
            last_ns = last_ns.max(place.log_time_ns);
        }
    }
    Ok((first_ns <= last_ns).then_some((first_ns, last_ns)))
}

fn files_ending_in(folder: &Path, extension: &str) -> Result<Vec<PathBuf>, ImportError> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|found| found == extension) {
            files.push(path);
        }
    }
    // `drive_10` comes after `drive_9`.
    files.sort_by_key(|path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
        let number: u64 = stem[name.len()..].parse().unwrap_or(0);
        (name, number, stem)
    });
    Ok(files)
}

/// Refuses a file that is not MCAP, by its first bytes.
fn check_magic(path: &Path) -> Result<(), ImportError> {
    let mut file = match fs::File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(ImportError::at(path, "the bag's file is missing"));
        }
        Err(error) => return Err(error.into()),
    };
    let mut magic = Vec::new();
    file.by_ref().take(16).read_to_end(&mut magic)?;
    if magic.starts_with(MCAP_MAGIC) {
        return Ok(());
    }
    if magic.starts_with(ROS1_MAGIC) {
        let message = "this is a bag of ROS 1; `rosbags-convert --src BAG --dst NEW --dst-storage mcap` (pip install \
                       rosbags) makes a bag of ROS 2 of it";
        return Err(ImportError::at(path, message));
    }
    if magic.starts_with(SQLITE_MAGIC) {
        return Err(sqlite(path));
    }
    if magic.starts_with(ZSTD_MAGIC) {
        return Err(ImportError::at(path, "the bag's file is compressed as a whole; `zstd -d` unpacks it"));
    }
    Err(ImportError::at(path, "the file is no MCAP; a ROS 2 bag stored as mcap is needed"))
}

fn sqlite(path: &Path) -> ImportError {
    let message = "the bag is stored as sqlite3; `rosbags-convert --src BAG --dst NEW --dst-storage mcap` (pip install \
                   rosbags), or `ros2 bag convert` with `storage_id: mcap`, makes one that can be read";
    ImportError::at(path, message)
}

impl BagMetadata {
    /// Reads the three keys that matter; each occurs once in what rosbag2 and its clones write.
    fn parse(text: &str) -> Self {
        let mut metadata = Self::default();
        let mut is_in_list = false;
        for line in text.lines().map(str::trim) {
            let plain = |value: &str| value.trim().trim_matches(['"', '\'']).to_owned();
            if let Some(item) = line.strip_prefix("- ").filter(|_| is_in_list) {
                metadata.files.push(plain(item));
                continue;
            }
            is_in_list = line.starts_with("relative_file_paths:");
            if let Some(value) = line.strip_prefix("storage_identifier:") {
                metadata.storage = plain(value);
            } else if let Some(value) = line.strip_prefix("compression_mode:") {
                metadata.compression_mode = plain(value);
            } else if let Some(inline) = line.strip_prefix("relative_file_paths:") {
                let inline = inline.trim().trim_start_matches('[').trim_end_matches(']');
                metadata.files.extend(inline.split(',').map(plain).filter(|name| !name.is_empty()));
            }
        }
        metadata
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_a_split_bag_are_read_in_their_order() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n    \
            - drive_0.mcap\n    - \"drive_1.mcap\"\n  duration:\n    nanoseconds: 5\n  compression_mode: \"\"\n";
        let metadata = BagMetadata::parse(text);
        assert_eq!(metadata.files, ["drive_0.mcap", "drive_1.mcap"]);
        assert_eq!((metadata.storage.as_str(), metadata.compression_mode.as_str()), ("mcap", ""));
        assert_eq!(BagMetadata::parse("relative_file_paths: [a.mcap, 'b.mcap']").files, ["a.mcap", "b.mcap"]);
    }

    /// A file of messages at these times, seconds.
    fn write_mcap(path: &Path, times_s: [u64; 2]) {
        let mut writer = mcap::WriteOptions::new().create(fs::File::create(path).unwrap()).unwrap();
        let schema = writer.add_schema("car_msgs/msg/State", "ros2msg", b"float64 speed\n").unwrap();
        let metadata = std::collections::BTreeMap::new();
        let channel_id = writer.add_channel(schema, "/state", "cdr", &metadata).unwrap();
        for time_s in times_s {
            let log_time = time_s * 1_000_000_000;
            let header =
                mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &[0; 12]).unwrap();
        }
        writer.finish().unwrap();
    }

    #[test]
    fn files_without_metadata_are_one_bag_where_each_goes_on_after_the_one_before() {
        let home = tempfile::tempdir().unwrap();
        let bags = |name: &str, spans_s: &[[u64; 2]]| {
            let folder = home.path().join(name);
            fs::create_dir(&folder).unwrap();
            for (i, span_s) in spans_s.iter().enumerate() {
                write_mcap(&folder.join(format!("part_{i}.mcap")), *span_s);
            }
            let found = bags_under(&folder).unwrap();
            (folder, found)
        };
        let (folder, split) = bags("split", &[[100, 110], [111, 120], [120, 130]]);
        assert_eq!(split, [folder]);
        let (folder, apart) = bags("apart", &[[100, 110], [3600, 3610]]);
        assert_eq!(apart, [0, 1].map(|i| folder.join(format!("part_{i}.mcap"))));
        let (folder, at_once) = bags("at_once", &[[100, 110], [101, 109]]);
        assert_eq!(at_once, [0, 1].map(|i| folder.join(format!("part_{i}.mcap"))));
        // A folder of such folders: the one bag, and the files of the others.
        assert_eq!(bags_under(home.path()).unwrap().len(), 5);
        let many: Vec<[u64; 2]> = (0..11).map(|i| [100 + i, 101 + i]).collect();
        let (folder, _) = bags("many", &many);
        assert!(mcap_files(&folder).unwrap()[10].ends_with("part_10.mcap"));
    }

    #[test]
    fn other_containers_are_named_with_what_converts_them() {
        let folder = tempfile::tempdir().unwrap();
        let told = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            mcap_files(&path).unwrap_err().to_string()
        };
        assert!(told("a.bag", b"#ROSBAG V2.0\n").contains("rosbags-convert"));
        assert!(told("a.db3", b"SQLite format 3\0").contains("storage_id: mcap"));
        assert!(told("a.mcap.zstd", b"\x28\xb5\x2f\xfd..").contains("zstd -d"));
        assert!(told("a.txt", b"hello").contains("no MCAP"));
    }

    #[test]
    fn a_bag_names_files_in_its_own_folder_alone() {
        let home = tempfile::tempdir().unwrap();
        let bag = home.path().join("bag");
        fs::create_dir(&bag).unwrap();
        let outside = home.path().join("outside.mcap");
        for file in [&home.path().join("x.mcap"), &bag.join("x.mcap"), &outside] {
            fs::write(file, MCAP_MAGIC).unwrap();
        }
        let files_of = |name: &str| {
            let text = format!("storage_identifier: mcap\nrelative_file_paths:\n  - {name}\n");
            fs::write(bag.join("metadata.yaml"), text).unwrap();
            mcap_files(&bag)
        };
        for name in ["../outside.mcap", "a/../../outside.mcap", &outside.display().to_string()] {
            let told = files_of(name).unwrap_err().to_string();
            let holds = |word: &str| told.contains(word);
            assert!(holds(name) && holds("without `..`") && holds("bag/metadata.yaml"), "{told}");
        }
        // Of a bag that was moved the files lie in its folder, whatever its metadata calls them.
        let moved = home.path().join("x.mcap").display().to_string();
        for name in ["x.mcap", "./x.mcap", "old_folder/x.mcap", "../bag/x.mcap", &moved] {
            assert_eq!(files_of(name).unwrap(), [bag.join("x.mcap")], "{name}");
        }
        // A link is the user's own.
        fs_err::os::unix::fs::symlink(home.path().join("x.mcap"), bag.join("link.mcap")).unwrap();
        assert_eq!(files_of("link.mcap").unwrap(), [bag.join("link.mcap")]);
    }
}
