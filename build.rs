//! Compiles the protobuf messages, packs towns, object models and scenarios for `src/scene/shipped.rs`, and lets the
//! binary find the shared libpython it was built against.

#![allow(clippy::disallowed_methods, reason = "a build script has no fs_err")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

use flate2::Compression;
use flate2::write::DeflateEncoder;

/// Each message that is a topic's schema, and the file that defines it.
const SCHEMAS: [(&str, &str); 8] = [
    ("EgoState", "harmzone/ego_state.proto"),
    ("Objects", "harmzone/objects.proto"),
    ("IgnoredRegions", "harmzone/ignored_regions.proto"),
    ("HarmLabels", "harmzone/harm_labels.proto"),
    ("Detections", "harmzone/detections.proto"),
    ("DriveCommand", "harmzone/drive_command.proto"),
    ("ViewNumbers", "harmzone/view.proto"),
    ("ViewObjects", "harmzone/view.proto"),
];

fn main() {
    if env::var_os("CARGO_FEATURE_EMBED").is_some() {
        pyo3_build_config::add_libpython_rpath_link_args();
    }
    compile_protos();
    pack_shipped();
}

/// Makes `harmzone.rs` with the Rust types, and for each schema its whole `FileDescriptorSet`.
fn compile_protos() {
    println!("cargo::rerun-if-changed=proto");
    let out_dir = env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let files = SCHEMAS.map(|(_, file)| file);
    let all = protox::compile(files, ["proto"]).expect("the protos in proto/ compile");
    prost_build::Config::new().compile_fds(all).expect("prost makes Rust of the protos");
    for (name, file) in SCHEMAS {
        let mut compiler = protox::Compiler::new(["proto"]).expect("proto/ is a folder");
        compiler.include_imports(true).include_source_info(false);
        compiler.open_file(file).expect("the protos in proto/ compile");
        let path = Path::new(&out_dir).join(format!("{name}.desc"));
        fs::write(path, compiler.encode_file_descriptor_set()).expect("OUT_DIR can be written");
    }
}

/// Makes `shipped.deflate` of what the program reads in `scenes/` and `mjcf_assets/`.
fn pack_shipped() {
    let mut files = Vec::new();
    for (folder, leaf) in [("scenes", "road.xodr"), ("mjcf_assets", "model.xml")] {
        println!("cargo::rerun-if-changed={folder}");
        collect_files(Path::new(folder), &mut files);
        for entry in fs::read_dir(folder).expect("the source tree can be read") {
            let path = entry.expect("the source tree can be read").path();
            let is_cache = path.ends_with("__pycache__");
            assert!(
                !path.is_dir() || is_cache || path.join(leaf).is_file(),
                "there is no {leaf} in the folder {}",
                path.display()
            );
        }
    }
    println!("cargo::rerun-if-changed=scenarios");
    collect_files(Path::new("scenarios"), &mut files);
    files.sort();
    let mut packed = DeflateEncoder::new(Vec::new(), Compression::best());
    for file in files {
        let path = file.to_str().expect("paths in the source tree are UTF-8").as_bytes();
        let content = fs::read(&file).expect("the source tree can be read");
        for length in [path.len(), content.len()] {
            let length = u32::try_from(length).expect("no file is so large");
            packed.write_all(&length.to_le_bytes()).expect("a Vec can be written");
        }
        packed.write_all(path).and_then(|()| packed.write_all(&content)).expect("a Vec can be written");
    }
    let path = Path::new(&env::var("OUT_DIR").expect("cargo sets OUT_DIR")).join("shipped.deflate");
    fs::write(path, packed.finish().expect("a Vec can be written")).expect("OUT_DIR can be written");
}

/// Adds the files below a folder that are of the kinds the program reads.
fn collect_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the source tree can be read") {
        let path = entry.expect("the source tree can be read").path();
        let extension = path.extension().and_then(|extension| extension.to_str());
        if path.is_dir() {
            collect_files(&path, files);
        } else if matches!(extension, Some("xodr" | "toml" | "xml" | "obj" | "png")) {
            files.push(path);
        }
    }
}
