//! Nothing is lost and nothing is silently wrong, whatever the fault: kills, signals, full and broken disks, changed bits.
//!
//! Every test here is short. The long ones print a table each and are `#[ignore]`: `make soak` runs them, `make soak ROWS=kills`
//! one of them, with `HARMZONE_FAULTS=1000` for how many.

#[path = "../made_data/mod.rs"]
mod made_data;

mod bits;
mod disk_full;
mod doctor;
mod exports;
mod folder;
mod io_errors;
mod io_others;
mod kills;
mod locks;
mod shim;
mod signals;
mod soak;
mod stages;

/// Says that something could not be tested. Past the capture of what passing tests print: else nobody would see it.
fn skipped(what: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "SKIPPED: {what}");
}

/// How many faults a long test makes.
fn n_faults(default: usize) -> usize {
    let told = std::env::var("HARMZONE_FAULTS").ok();
    told.map_or(default, |text| text.parse().expect("HARMZONE_FAULTS is a number"))
}
