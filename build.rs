//! Lets the binary find the shared libpython it was built against.

fn main() {
    pyo3_build_config::add_libpython_rpath_link_args();
}
