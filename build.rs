//! Compiles the protobuf messages, and lets the binary find the shared libpython it was built against.

use std::path::Path;
use std::{env, fs};

/// Each message that is a topic's schema, and the file that defines it.
const SCHEMAS: [(&str, &str); 4] = [
    ("EgoState", "harmzone/ego_state.proto"),
    ("Objects", "harmzone/objects.proto"),
    ("HarmLabels", "harmzone/harm_labels.proto"),
    ("Detections", "harmzone/detections.proto"),
];

fn main() {
    pyo3_build_config::add_libpython_rpath_link_args();
    compile_protos();
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
