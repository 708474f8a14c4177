//! The fuzz targets as a library, and what each program of `fuzz_targets` is.

pub mod targets;

/// Makes a libFuzzer program of a target. With `HARMZONE_SEEDS_TO=FOLDER` it writes inputs to begin with, and ends.
#[macro_export]
macro_rules! fuzz {
    ($name:literal) => {
        libfuzzer_sys::fuzz_target!(
            init: {
                if let Some(folder) = std::env::var_os("HARMZONE_SEEDS_TO") {
                    $crate::targets::write_seeds($name, folder.as_ref()).expect("seeds can be written");
                    std::process::exit(0);
                }
            },
            |bytes: &[u8]| $crate::targets::run($name, bytes)
        );
    };
}
