//! The files inside the program: towns, object models and scenarios, which `build.rs` packs as one deflated stream.
//!
//! The stream holds for each file the lengths of its path and its content, little-endian u32, then both.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::LazyLock;

use flate2::read::DeflateDecoder;

/// All files by path in the source tree: `scenes/market/road.xodr`.
static FILES: LazyLock<BTreeMap<String, Vec<u8>>> = LazyLock::new(|| {
    let mut stream = Vec::new();
    let packed: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/shipped.deflate"));
    DeflateDecoder::new(packed).read_to_end(&mut stream).expect("build.rs wrote a whole stream");
    unpack(&stream).expect("build.rs wrote whole entries")
});

/// The content of a file.
pub(super) fn bytes(path: &str) -> Option<&'static [u8]> {
    FILES.get(path).map(Vec::as_slice)
}

/// The content of a file that is UTF-8 text.
pub(super) fn text(path: &str) -> Option<&'static str> {
    std::str::from_utf8(bytes(path)?).ok()
}

/// The scenarios that come with harmzone: path in the source tree and text, sorted.
pub fn shipped_scenarios() -> Vec<(&'static str, &'static str)> {
    let of_file =
        |path: &'static String| path.starts_with("scenarios/").then(|| Some((path.as_str(), text(path)?)))?;
    FILES.keys().filter_map(of_file).collect()
}

/// Names of the folders in `root` that have a file named `leaf`, sorted.
pub(super) fn folders_with(root: &str, leaf: &str) -> Vec<&'static str> {
    let folder = |path: &'static String| path.strip_prefix(root)?.strip_prefix('/')?.split_once('/');
    let has_leaf = |(folder, rest)| (rest == leaf).then_some(folder);
    let mut folders: Vec<_> = FILES.keys().filter_map(folder).filter_map(has_leaf).collect();
    folders.sort_unstable();
    folders
}

/// The entries of a stream; `None` if it ends within one.
fn unpack(mut stream: &[u8]) -> Option<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    while !stream.is_empty() {
        let path_length = u32::from_le_bytes(*stream.split_off(..4)?.first_chunk()?);
        let length = u32::from_le_bytes(*stream.split_off(..4)?.first_chunk()?);
        let path = stream.split_off(..path_length as usize)?;
        let content = stream.split_off(..length as usize)?;
        files.insert(std::str::from_utf8(path).ok()?.to_owned(), content.to_vec());
    }
    Some(files)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fs_err as fs;
    use std::path::Path;

    #[test]
    fn every_file_is_as_in_the_source_tree() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert!(FILES.len() > 300, "{}", FILES.len());
        for (path, content) in &*FILES {
            assert!(*content == fs::read(root.join(path)).unwrap(), "{path}");
        }
    }

    #[test]
    fn folders_are_those_that_hold_the_file() {
        assert!(folders_with("scenes", "road.xodr").contains(&"downtown"));
        assert!(folders_with("mjcf_assets", "road.xodr").is_empty());
    }

    #[test]
    fn a_stream_that_ends_early_is_refused() {
        let entry = b"\x01\0\0\0\x02\0\0\0axy";
        assert_eq!(unpack(entry), Some(BTreeMap::from([("a".to_owned(), b"xy".to_vec())])));
        assert_eq!(unpack(&entry[..10]), None);
        assert_eq!(unpack(&entry[..3]), None);
    }
}
