//! All that is waited for, measured in one run: a table of measured, wanted and least bearable values.
//!
//! Whatever can disturb another measurement runs in a process of its own. What is raced is raced in turns.

mod boxes;
mod generation;
mod gpu;
mod machine;
mod network;
mod scores;
mod table;

use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::tensor::Device;
use clap::ValueEnum;

pub use self::table::{Report, Verdict};

use self::machine::Machine;
use harmzone::progress::Progress;

/// A part of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// `gen` against bare MuJoCo calls in ClearNoon
    Gen,
    /// The same over all weathers
    Weathers,
    /// Samples a second of two processes
    Jobs,
    /// Rays a second and core
    Lidar,
    /// Training steps against PyTorch
    Training,
    /// Inference against PyTorch
    Inference,
    /// `label` against shapely
    Label,
    /// `eval` against nuscenes-devkit
    Eval,
    /// Minutes that the training of `small` takes
    Small,
    /// Pictures and training on a GPU, where there is one
    Gpu,
}

/// What is measured, and on what.
pub struct Options<'a> {
    pub parts: &'a [Part],
    /// The labelled data set that networks race on; made where it is missing.
    pub data: &'a Path,
    /// Folder for the data and the run of a whole training; without it the time is computed.
    pub train_in: Option<&'a Path>,
    /// Device of that training.
    pub device: &'a Device,
}

/// Measures.
///
/// # Errors
/// Something fails that could be measured here, or two programs disagree.
pub fn run(options: &Options<'_>, progress: &dyn Progress) -> anyhow::Result<Report> {
    let begin = Instant::now();
    let machine = Machine::here();
    let wants = |part| options.parts.contains(&part);
    let root = source_tree();
    if [Part::Training, Part::Inference, Part::Small, Part::Gpu].into_iter().any(wants) {
        network::prepare(options.data, progress)?;
    }
    let mut lines = generation::clear_noon(wants(Part::Gen), wants(Part::Lidar))?;
    if wants(Part::Weathers) {
        let after_gen = usize::from(wants(Part::Gen));
        lines.insert(after_gen, generation::all_weathers()?);
    }
    if wants(Part::Jobs) {
        lines.push(generation::two_jobs()?);
    }
    if wants(Part::Training) || wants(Part::Inference) {
        lines.extend(network::race(&root, options.data, wants(Part::Training), wants(Part::Inference))?);
    }
    if wants(Part::Label) || wants(Part::Eval) {
        lines.extend(scores::race(&root, wants(Part::Label), wants(Part::Eval), progress)?);
    }
    if wants(Part::Small) {
        lines.push(match options.train_in {
            Some(work) => network::train_small(work, options.device, progress)?,
            None => network::compute_training(options.data)?,
        });
    }
    if wants(Part::Gpu) {
        lines.extend(gpu::lines(&machine, options.data)?);
    }
    Ok(Report { version: env!("CARGO_PKG_VERSION"), machine, lines, seconds: begin.elapsed().as_secs_f64() })
}

/// The folder with `scripts/` and the virtual environments.
fn source_tree() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(Path::to_path_buf).unwrap_or_default()
}
