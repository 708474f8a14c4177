//! What a GPU of this machine does: pictures by EGL, training by CUDA. Nothing is wanted of it yet.

use std::path::Path;

use anyhow::Context;

use super::generation::bench_gen;
use super::machine::Machine;
use super::network::bench_model;
use super::table::{Line, Outcome, Value};
use harmzone::device;

/// Software that draws on the CPU.
const ON_CPU: [&str; 3] = ["llvmpipe", "softpipe", "swrast"];

/// Its lines; empty without a GPU.
///
/// # Errors
/// What is there fails.
pub fn lines(machine: &Machine, data: &Path) -> anyhow::Result<Vec<Line>> {
    if machine.gpus.is_empty() {
        let empty = Outcome::Empty("this machine has none".to_owned());
        return Ok(vec![line("GPU: pictures, training", empty, String::new())]);
    }
    let mut lines = vec![pictures()?];
    if device::built().contains(&"cuda") {
        let told = bench_model(data, "cuda:0")?;
        for stage in &told.training {
            let value = Outcome::Measured(Value::single(stage.step.mean_ms));
            lines.push(line(
                &format!("training step on the GPU, {} stage", stage.stage),
                value,
                String::new(),
            ));
        }
    } else {
        let needed = "`make bench FEATURES=cuda` builds the backend; minutes";
        lines.push(line("training step on the GPU", Outcome::Absent(needed.to_owned()), String::new()));
    }
    Ok(lines)
}

fn line(what: &str, outcome: Outcome, note: String) -> Line {
    Line { what: what.to_owned(), unit: "ms", goal: None, outcome, note }
}

/// Picture and segmentation of a sample.
fn pictures() -> anyhow::Result<Line> {
    let flags = ["--episodes", "1", "--run-samples", "0", "--set", "samples=16"].map(str::to_owned);
    let told = bench_gen(&flags)?;
    let episode = told.episodes.first().context("`xtask bench-gen` told no episode")?;
    let what = "picture and segmentation on the GPU";
    if ON_CPU.iter().any(|name| told.renderer.contains(name)) {
        let empty = Outcome::Empty(format!("EGL draws with {}", told.renderer));
        return Ok(line(what, empty, String::new()));
    }
    Ok(line(what, Outcome::Measured(Value::single(episode.pictures_ms)), told.renderer))
}
