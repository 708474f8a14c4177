//! Lets the programs find the shared libpython that harmzone was built against.

fn main() {
    pyo3_build_config::add_libpython_rpath_link_args();
}
