//! A dataset's frames at other speeds and steering angles, as figures, plots and pictures in a folder.
//!
//! ```text
//! <out>/sweep.toml                  the resolved config
//! <out>/sweeps.csv                  every curve, a line a point
//! <out>/speed.svg .png              harmful objects, agreement and mAP over the speed
//! <out>/steering.svg .png           the same over the steering angle
//! <out>/sensor_errors.svg .png      mAP over errors of both sensors
//! <out>/early.svg .png              false-harmful boxes whose object turns harmful soon
//! <out>/frame_speed.png             one frame at several speeds; frame_steering.png at several angles
//! <out>/kinds/<category>.png        the best seen object of each kind out of distribution
//! <out>/sweeps.json                 every curve; there when all is
//! ```

mod figures;
mod pictures;

use std::fmt;
use std::path::{Path, PathBuf};

use fs_err as fs;
use thiserror::Error;

use super::plot::{self, Lines, PlotError};
use crate::config::to_toml;
use crate::dataset::Dataset;
use crate::eval::Protocol;
use crate::eval::judge::Judge;
use crate::eval::sweep::{Change, Series, SweepConfig, SweepError, Sweeps, Swept};
use crate::files::write_atomic;
use crate::zone::ZoneError;

/// Name of the file whose presence says that all is there.
pub const JSON_FILE: &str = "sweeps.json";
const CSV_FILE: &str = "sweeps.csv";
const CONFIG_FILE: &str = "sweep.toml";

/// What was swept, and where its figures go.
#[derive(Clone, Copy)]
pub struct SweepRequest<'a> {
    pub swept: &'a Swept<'a>,
    /// Frames to draw at several states.
    pub series: &'a [Series<'a>],
    pub dataset: &'a Dataset,
    pub config: &'a SweepConfig,
    pub protocol: &'a Protocol,
    pub out: &'a Path,
}

/// Why sweeps could not be made or told.
#[derive(Debug, Error)]
pub enum SweepReportError {
    #[error(transparent)]
    Sweep(#[from] SweepError),
    #[error(transparent)]
    Plot(#[from] PlotError),
    #[error("sample {sample}: {source}")]
    Zone { sample: String, source: ZoneError },
    #[error("the image of sample {sample} cannot be unpacked: {source}")]
    Image { sample: String, source: image::ImageError },
    #[error("the picture cannot be packed: {source}: {}", path.display())]
    Pack { source: image::ImageError, path: PathBuf },
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("sweeps exist already; give --force to replace them: {}", path.display())]
    Exists { path: PathBuf },
}

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepSummary {
    pub sweeps: Sweeps,
    pub n_pictures: usize,
    pub out: PathBuf,
}

/// Refuses to write over sweeps.
///
/// # Errors
/// [`SweepReportError::Exists`].
pub fn refuse_to_overwrite(out: &Path, force: bool) -> Result<(), SweepReportError> {
    let path = out.join(JSON_FILE);
    if path.exists() && !force { Err(SweepReportError::Exists { path }) } else { Ok(()) }
}

/// Scores what was swept, and writes all figures and pictures.
///
/// # Errors
/// [`SweepReportError`].
pub fn run(request: &SweepRequest<'_>) -> Result<SweepSummary, SweepReportError> {
    let SweepRequest { swept, series, dataset, config, protocol, out } = *request;
    let sweeps = swept.measure(&config.judges, protocol)?;
    fs::create_dir_all(out)?;
    let json = out.join(JSON_FILE);
    if json.exists() {
        fs::remove_file(&json)?;
    }
    let config_text =
        format!("# harmzone {}, harmzone sweep\n{}", env!("CARGO_PKG_VERSION"), to_toml(config));
    write_atomic(&out.join(CONFIG_FILE), config_text.as_bytes())?;
    write_atomic(&out.join(CSV_FILE), sweeps.to_csv().as_bytes())?;
    save_plot(out, "speed", &figures::over_states(&sweeps, Change::SpeedMps))?;
    save_plot(out, "steering", &figures::over_states(&sweeps, Change::SteeringDeg))?;
    save_plot(out, "sensor_errors", &figures::sensor_errors(&sweeps))?;
    if let Some(early) = &sweeps.early {
        save_plot(out, "early", &figures::early(early))?;
    }
    let pictures = pictures::draw_all(swept, dataset.zone(), config, series)?;
    for (name, picture) in &pictures {
        let path = out.join(name);
        fs::create_dir_all(path.parent().unwrap_or(out))?;
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|source| SweepReportError::Pack { source, path: path.clone() })?;
        write_atomic(&path, bytes.get_ref())?;
    }
    write_atomic(&json, sweeps.to_json().as_bytes())?;
    Ok(SweepSummary { sweeps, n_pictures: pictures.len(), out: out.to_owned() })
}

fn save_plot(out: &Path, name: &str, figure: &Lines) -> Result<(), SweepReportError> {
    write_atomic(&out.join(format!("{name}.svg")), plot::svg(figure)?.as_bytes())?;
    write_atomic(&out.join(format!("{name}.png")), &plot::png(figure)?)?;
    Ok(())
}

impl fmt::Display for SweepSummary {
    /// A table: for each judge how well its harmful set follows speed and steering, and mAP under the largest errors.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sweeps = &self.sweeps;
        writeln!(
            f,
            "{:<16} {:>12} {:>14} {:>22} {:>25}",
            "", "set IoU over", "set IoU over", "mAP, speed", "mAP, steering"
        )?;
        writeln!(
            f,
            "{:<16} {:>12} {:>14} {:>22} {:>25}",
            format!("{} frames", sweeps.n_samples),
            "speed",
            "steering",
            "factor",
            "offset, deg"
        )?;
        for judge in Judge::ALL {
            if !sweeps.curves.iter().any(|curve| curve.judge == judge) {
                continue;
            }
            let mean_iou = |change| {
                let shares: Vec<f64> =
                    sweeps.points(change, judge).iter().filter_map(|point| point.set_iou).collect();
                let n = shares.len();
                if n == 0 { "-".to_owned() } else { format!("{:.3}", shares.iter().sum::<f64>() / n as f64) }
            };
            let errors = |change, unit: &str| {
                let points = sweeps.points(change, judge);
                let ends = [points.first(), points.last()].into_iter().flatten();
                ends.map(|point| format!("{}{unit} {:.3}", point.value, point.scores.total.mean))
                    .collect::<Vec<_>>()
                    .join(", ")
            };
            writeln!(
                f,
                "{:<16} {:>12} {:>14} {:>22} {:>25}",
                judge.name(),
                mean_iou(Change::SpeedMps),
                mean_iou(Change::SteeringDeg),
                errors(Change::SpeedFactor, "x"),
                errors(Change::SteeringOffsetDeg, ""),
            )?;
        }
        writeln!(f, "plots and {} pictures: {}", self.n_pictures, self.out.display())
    }
}
