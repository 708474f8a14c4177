//! Checkpoints that would take any amount of memory or run a command: refused with their path.

use std::io::Write as _;
use std::path::Path;

use fs_err as fs;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;
use crate::device::test_device;
use crate::model::config::ModelConfig;

/// Writes a checkpoint of these entries, each with its name, how it is packed and its bytes.
fn write(path: &Path, entries: &[(&str, CompressionMethod, &[u8])]) {
    let mut archive = ZipWriter::new(fs::File::create(path).unwrap());
    for (name, method, bytes) in entries {
        let options = SimpleFileOptions::default().compression_method(*method);
        archive.start_file(format!("weights/{name}"), options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap();
}

/// Why a file is not loaded, with its path.
fn told(path: &Path) -> String {
    let [_, paper] = ModelConfig::in_little();
    let mut swin = Swin::init(&paper.camera.swin.swin, &test_device());
    let error = load_image_weights(path, &mut swin).unwrap_err().to_string();
    assert!(error.contains(&path.display().to_string()), "{error}");
    error
}

#[test]
fn a_compressed_entry_that_unpacks_to_much_more_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.pth");
    let packed = CompressionMethod::Deflated;
    // So many `None`s, each of which becomes an object.
    write(&path, &[("data.pkl", packed, &vec![b'N'; (4 << 20) + 1])]);
    assert!(fs::metadata(&path).unwrap().len() < 100_000);
    let error = told(&path);
    assert!(error.contains("data.pkl") && error.contains("4194305 bytes; up to 4194304"), "{error}");
    let empty = ("data.pkl", packed, &b"\x80\x02}."[..]);
    write(&path, &[empty, ("data/0", packed, &vec![0; (64 << 20) + 1])]);
    let error = told(&path);
    assert!(error.contains("data/0") && error.contains("up to 67108864"), "{error}");
    // What is compressed and stays within bounds is read.
    write(&path, &[empty, ("data/0", packed, &vec![0; 1 << 20])]);
    assert!(told(&path).contains("hold no Swin Transformer"));
}

/// A TAR file may say that any number of zeros lies in it.
#[test]
fn a_tar_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.tar");
    let mut head = vec![0; 512];
    head[257..262].copy_from_slice(b"ustar");
    fs::write(&path, head).unwrap();
    assert!(told(&path).contains("a TAR file"));
}

#[test]
fn a_pickle_that_calls_the_system_runs_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, made) = (folder.path().join("weights.pth"), folder.path().join("made"));
    let text =
        |text: &str| [&b"X"[..], &u32::try_from(text.len()).unwrap().to_le_bytes(), text.as_bytes()].concat();
    let command = text(&format!("touch {}", made.display()));
    for module in ["os", "posix"] {
        // What Python writes of an object whose `__reduce__` is `(os.system, (command,))`, alone and in the place of a weight.
        let call = [format!("c{module}\nsystem\n").as_bytes(), &command, b"\x85R"].concat();
        let alone = [&b"\x80\x02"[..], &call, b"."].concat();
        let weight = [&b"\x80\x02}"[..], &text("weight"), &call, b"s."].concat();
        for pickle in [alone, weight] {
            write(&path, &[("data.pkl", CompressionMethod::Stored, &pickle)]);
            told(&path);
            fs::write(&path, &pickle).unwrap();
            told(&path);
            assert!(!made.exists(), "{module}");
        }
    }
}
