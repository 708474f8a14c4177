//! A dataset's frames at other speeds and steering angles, as figures, plots and pictures in a folder.
//!
//! ```text
//! <out>/sweep.toml                  the resolved config
//! <out>/sweeps.csv                  every curve, one line per point
//! <out>/speed.svg .png              harmful objects, agreement and mAP over the speed
//! <out>/steering.svg .png           the same over the steering angle
//! <out>/sensor_errors.svg .png      mAP over errors of both sensors
//! <out>/early.svg .png              false-harmful boxes whose object turns harmful soon
//! <out>/frame_speed.png             one frame at several speeds; frame_steering.png at several angles
//! <out>/kinds/<category>.png        the best seen object of each kind out of distribution
//! <out>/sweeps.json                 every curve; written last
//! ```

pub mod charts;
mod pictures;

use std::fmt;
use std::path::{Path, PathBuf};

use fs_err as fs;
use thiserror::Error;

use super::chart::{self, ChartError, Sheet};
use super::table::{ap, number};
use crate::config::to_toml;
use crate::dataset::Dataset;
use crate::eval::Protocol;
use crate::eval::judge::Judge;
use crate::eval::sweep::{Change, Series, SweepConfig, SweepError, Sweeps, Swept};
use crate::files::{self, seal_result, write_atomic};
use crate::text_table::text_table;
use crate::zone::ZoneError;

/// Name of the file whose presence means that all is there.
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

/// Why sweeps could not be made or reported.
#[derive(Debug, Error)]
pub enum SweepReportError {
    #[error(transparent)]
    Sweep(#[from] SweepError),
    #[error(transparent)]
    Chart(#[from] ChartError),
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

/// The result of writing.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SweepSummary {
    pub sweeps: Sweeps,
    pub n_pictures: usize,
    pub out: PathBuf,
}

/// Refuses to overwrite sweeps.
///
/// # Errors
/// [`SweepReportError::Exists`].
pub fn refuse_to_overwrite(out: &Path, force: bool) -> Result<(), SweepReportError> {
    let path = out.join(JSON_FILE);
    if !force && files::is_there(&path)? { Err(SweepReportError::Exists { path }) } else { Ok(()) }
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
    files::remove_if_there(&json)?;
    // Sweeps of other samples may have drawn what these have not.
    for name in ["early.svg", "early.png", pictures::FRAME_SPEED, pictures::FRAME_STEERING] {
        files::remove_if_there(&out.join(name))?;
    }
    let kinds = out.join(pictures::KINDS);
    if kinds.is_dir() {
        for file in fs::read_dir(&kinds)? {
            let path = file?.path();
            if path.extension().is_some_and(|of| of == "png") {
                fs::remove_file(path)?;
            }
        }
    }
    let config_text =
        format!("# harmzone {}, harmzone sweep\n{}", env!("CARGO_PKG_VERSION"), to_toml(config));
    write_atomic(&out.join(CONFIG_FILE), config_text.as_bytes())?;
    write_atomic(&out.join(CSV_FILE), sweeps.to_csv().as_bytes())?;
    save_sheet(out, "speed", charts::over(&sweeps, Change::SpeedMps))?;
    save_sheet(out, "steering", charts::over(&sweeps, Change::SteeringDeg))?;
    let sensors = [Change::SpeedFactor, Change::SteeringOffsetDeg];
    save_sheet(out, "sensor_errors", sensors.into_iter().flat_map(|of| charts::over(&sweeps, of)).collect())?;
    if let Some(early) = &sweeps.early {
        save_sheet(out, "early", vec![charts::early(early)])?;
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
    write_atomic(&json, seal_result(&sweeps.to_json()).as_bytes())?;
    Ok(SweepSummary { sweeps, n_pictures: pictures.len(), out: out.to_owned() })
}

fn save_sheet(out: &Path, name: &str, charts: Vec<chart::Chart>) -> Result<(), SweepReportError> {
    let sheet = Sheet::column(charts);
    write_atomic(&out.join(format!("{name}.svg")), chart::svg(&sheet)?.as_bytes())?;
    write_atomic(&out.join(format!("{name}.png")), &chart::png(&sheet)?)?;
    Ok(())
}

impl fmt::Display for SweepSummary {
    /// A table: for each judge how well its harmful set follows speed and steering, and mAP under the largest errors.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sweeps = &self.sweeps;
        let head = [
            format!("{} frames", sweeps.n_samples),
            "set IoU\nover speed".to_owned(),
            "set IoU\nover steering".to_owned(),
            "mAP by\nspeed factor".to_owned(),
            "mAP by\nsteering offset, deg".to_owned(),
        ];
        let judges = Judge::ALL.into_iter();
        let judges = judges.filter(|&judge| sweeps.curves.iter().any(|curve| curve.judge == judge));
        let row = |judge: Judge| {
            let mean_iou = |change| {
                let shares: Vec<f64> =
                    sweeps.points(change, judge).iter().filter_map(|point| point.set_iou).collect();
                let n = shares.len();
                number((n > 0).then(|| shares.iter().sum::<f64>() / n as f64), 3)
            };
            let errors = |change, unit: &str| {
                let points = sweeps.points(change, judge);
                let ends = [points.first(), points.last()].into_iter().flatten();
                ends.map(|point| format!("{}{unit} {}", point.value, ap(point.scores.total.mean)))
                    .collect::<Vec<_>>()
                    .join(", ")
            };
            [
                judge.name().to_owned(),
                mean_iou(Change::SpeedMps),
                mean_iou(Change::SteeringDeg),
                errors(Change::SpeedFactor, "x"),
                errors(Change::SteeringOffsetDeg, ""),
            ]
        };
        f.write_str(&text_table(std::iter::once(head).chain(judges.map(row))))?;
        writeln!(f, "plots and {} pictures: {}", self.n_pictures, self.out.display())
    }
}
