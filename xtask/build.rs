//! Lets the program find the shared libpython that the library was built against.

fn main() {
    pyo3_build_config::add_libpython_rpath_link_args();
}
