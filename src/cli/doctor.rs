//! `harmzone doctor`: what this machine has for generating data and for the network, what is missing, and how to
//! get it; or what is wrong with a data set, and what of it can be mended.

use std::fmt;

use clap::Args;
use nalgebra::Vector3;
use serde::Serialize;

use super::{Bar, ExitStatus, print_summary, tell};
use crate::dataset::health::{self, CheckVerdict, Health, Severity, Symptom};
use crate::device::{self, DeviceName};
use crate::geometry::{Pinhole, Transform};
use crate::sim::{CameraMount, Environment, Renderer, SimError, Simulator};
use crate::store::{Access, Location};

/// A lit ball on the ground: the smallest world that shows that compiling and drawing work.
const TINY_WORLD: &str = r#"<mujoco><worldbody>
  <light directional="true" dir="0 0 -1" pos="0 0 10"/>
  <geom type="plane" size="0 0 1" group="1" contype="0" conaffinity="0"/>
  <body name="ball" pos="5 0 1"><geom type="sphere" size="1" group="2"/></body>
  <body name="ego"/>
</worldbody></mujoco>"#;

#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// A data set to examine, in place of the machine: files, frames, units, stamps, values that cannot be
    dataset: Option<Location>,
    /// Mend the data set where nothing is lost by it: delete leftovers, make dataset.json anew, set torn episodes aside
    #[arg(long, requires = "dataset")]
    fix: bool,
    /// Print the findings as JSON
    #[arg(long)]
    json: bool,
}

/// One line of the findings.
#[derive(Debug, Serialize)]
struct Finding {
    name: &'static str,
    is_ok: bool,
    /// What was found, or what is wrong with the command that mends it.
    text: String,
}

#[derive(Debug, Serialize)]
struct Findings(Vec<Finding>);

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|Finding { name, is_ok, text }| {
            writeln!(f, "{} {name:<12} {text}", if *is_ok { "ok     " } else { "MISSING" })
        })
    }
}

pub fn run(args: DoctorArgs) -> anyhow::Result<ExitStatus> {
    if let Some(dataset) = &args.dataset {
        return examine_dataset(dataset, args.fix, args.json);
    }
    let findings = examine();
    print_summary(&findings, args.json)?;
    let n_missing = findings.0.iter().filter(|finding| !finding.is_ok).count();
    anyhow::ensure!(n_missing == 0, "{n_missing} of {} findings are wrong", findings.0.len());
    Ok(ExitStatus::Done)
}

fn examine_dataset(dataset: &Location, fix: bool, as_json: bool) -> anyhow::Result<ExitStatus> {
    anyhow::ensure!(
        !fix || dataset.local().is_some(),
        "--fix mends a data set in a folder of this machine; copy it here, or make it again: {dataset}"
    );
    let place = dataset.open(Access::Read)?;
    // What is left is examined after mending, so that nothing is told as well that is not.
    let mended = if fix { health::mend(place.path(), &Bar::default())? } else { Vec::new() };
    let report = Report { mended, health: health::examine(place.path(), &Bar::default())? };
    print_summary(&report, as_json)?;
    let n_faults = report.health.count(Severity::Fault);
    if n_faults == 0 {
        return Ok(ExitStatus::Done);
    }
    tell(format!("{n_faults} faults: {dataset}"));
    Ok(ExitStatus::DoneWithLosses)
}

/// A data set's health, a line for each verdict and each symptom.
#[derive(Debug, Serialize)]
struct Report {
    /// What was mended, a sentence each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mended: Vec<String>,
    #[serde(flatten)]
    health: Health,
}

/// Verdicts as lines begin with them.
fn level(verdict: &str) -> &str {
    if verdict == Severity::Fault.name() { "FAULT" } else { verdict }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Health { n_episodes, n_samples, verdicts, symptoms } = &self.health;
        self.mended.iter().try_for_each(|sentence| writeln!(f, "mended  {sentence}"))?;
        for CheckVerdict { check, verdict, figures } in verdicts {
            writeln!(f, "{:<7} {check:<11} {figures}", level(verdict))?;
            for Symptom { severity, first_at, n_places, text, .. } in
                symptoms.iter().filter(|of| of.check == *check)
            {
                let more = if *n_places > 1 {
                    format!(" (and {} more places)", n_places - 1)
                } else {
                    String::new()
                };
                writeln!(f, "  {:<7} {first_at}: {text}{more}", level(severity.name()))?;
            }
        }
        let (n_faults, n_warnings) =
            (self.health.count(Severity::Fault), self.health.count(Severity::Warning));
        writeln!(f, "{n_episodes} episodes, {n_samples} samples: {n_faults} faults, {n_warnings} warnings")
    }
}

/// Finds out one thing about the machine.
type Examination = fn() -> Result<String, SimError>;

/// What is to be there; each needs what stands before it.
const CHECKS: [(&str, Examination); 6] = [
    ("harmzone", || Ok(env!("CARGO_PKG_VERSION").to_owned())),
    ("devices", || Ok(devices())),
    ("interpreter", || {
        Ok(format!(
            "Python {}, {}",
            Environment::interpreter().1,
            if cfg!(feature = "wheel") { "which runs the program" } else { "embedded" }
        ))
    }),
    ("environment", || Ok(Environment::find()?.venv.display().to_string())),
    ("mujoco", Environment::mujoco_version),
    ("opengl", draw),
];

/// The findings up to the first that is wrong.
fn examine() -> Findings {
    let mut findings = Vec::new();
    for (name, check) in CHECKS {
        let found = check();
        let is_ok = found.is_ok();
        findings.push(Finding { name, is_ok, text: found.unwrap_or_else(|error| error.to_string()) });
        if !is_ok {
            break;
        }
    }
    Findings(findings)
}

/// What `--device` can name here.
fn devices() -> String {
    let device = |(name, own): (DeviceName, Option<String>)| match own {
        Some(own) => format!("{name} ({own})"),
        None => name.to_string(),
    };
    device::present().into_iter().map(device).collect::<Vec<_>>().join(", ")
}

/// Draws the tiny world; tells what drew it.
fn draw() -> Result<String, SimError> {
    let mount = CameraMount {
        body: "ego".into(),
        cameras: vec![(
            Transform::looking_forward(Vector3::new(0.0, 0.0, 1.0), 0.0),
            Pinhole::from_horizontal_fov(64, 36, 70f64.to_radians()),
        )],
        n_samples: 4,
        shadow_size_px: 256,
        renderer: Renderer::Classic,
    };
    let mut simulator = Simulator::new(TINY_WORLD, &[], &mount)?;
    let [vendor, renderer, version] = simulator.gl_info()?;
    let picture = simulator.render_rgb()?;
    if picture.get_pixel(32, 18).0 == [0, 0, 0] {
        return Err(SimError::NoGl { message: "the test picture came out black".into() });
    }
    Ok(format!("{renderer} ({vendor}), OpenGL {version}"))
}
