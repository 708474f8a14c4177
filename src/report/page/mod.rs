//! The report: one self-contained HTML file, from the scores of both data sets.
//!
//! It holds tables, charts and pictures and fetches nothing. The same scores give the same bytes. Missing
//! parts are left out, and the page names the commands that make them.

mod calibration;
mod detection;
mod drives;
mod gallery;
mod groups;
mod headline;
mod pictures;
mod provenance;
mod safety;
mod scored_data;
mod strips;
mod sweeps;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

use self::scored_data::{NoData, SideData};
use crate::episode::ManifestError;
use crate::eval::Mode;
use crate::files::{self, write_atomic};
use crate::outcome::{DriveSummary, ReadDrivesError};
use crate::report::chart::ChartError;
use crate::report::document::{Block, Section, render};
use crate::report::provenance::Provenance;
use crate::report::results::{self, ReadResultsError, Results};
use crate::report::scores::{Scores, ScoresError};
use crate::report::standing::Standing;
use crate::report::view::ViewError;

/// Name of the page if a folder is given.
pub const PAGE_FILE: &str = "report.html";
/// Default number of cards of a kind of fault and data set.
pub const DEFAULT_CARDS: usize = 12;

/// Why the report could not be made.
#[derive(Debug, Error)]
pub enum ReportError {
    #[error(transparent)]
    Scores(#[from] ScoresError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    View(#[from] ViewError),
    #[error("the scores are {found}; --{key} needs {wanted}: {}", path.display())]
    OtherMode { key: &'static str, found: &'static str, wanted: &'static str, path: PathBuf },
    #[error(transparent)]
    Chart(#[from] ChartError),
    #[error(transparent)]
    Drives(#[from] ReadDrivesError),
    #[error(transparent)]
    Results(#[from] ReadResultsError),
    #[error("a picture of sample {sample} cannot be made: {source}")]
    Picture { source: image::ImageError, sample: String },
    #[error("a picture cannot be read: {source}: {}", path.display())]
    File { source: image::ImageError, path: PathBuf },
    #[error("the file exists; --force replaces it: {}", path.display())]
    Exists { path: PathBuf },
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// One set of scores to report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScoresRequest {
    /// Folder of `harmzone eval --out`.
    pub folder: PathBuf,
    /// The data set that was scored, for pictures; `None` takes the one that the scores name, as far as it is there.
    pub data: Option<PathBuf>,
}

/// What to report, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportRequest {
    /// The file to write; in a folder, [`PAGE_FILE`].
    pub out: PathBuf,
    pub id: Option<ScoresRequest>,
    pub ood: Option<ScoresRequest>,
    /// results.json of `make results`.
    pub results: Option<PathBuf>,
    /// Folder of `harmzone drive --out`.
    pub drives: Option<PathBuf>,
    /// Cards of a kind of fault and data set.
    pub n_cards: usize,
    /// The command as it was typed.
    pub command: String,
    pub force: bool,
}

/// The result of writing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReportSummary {
    pub out: PathBuf,
    pub bytes: usize,
    pub n_cards: usize,
    /// What was left out, with the command that makes it.
    pub absent: Vec<String>,
    /// Whether the scores' own parts are all there: pictures of their faults, and where they come from. Sweeps and
    /// ablations are made separately.
    pub is_whole: bool,
}

/// The whole page, in the form of its template's input.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Page {
    title: String,
    subtitle: String,
    version: &'static str,
    /// The style sheet and the script, which the template takes as they are.
    style: &'static str,
    script: &'static str,
    sections: Vec<Section>,
}

/// Scores with the facts needed to report them.
#[derive(Debug, Clone, PartialEq)]
struct Side {
    /// Its flag.
    key: &'static str,
    name: &'static str,
    short: &'static str,
    scores: Scores,
    dataset: Result<SideData, NoData>,
}

impl Side {
    fn read(key: &'static str, request: &ScoresRequest) -> Result<Self, ReportError> {
        let (mode, name, short) = match key {
            "id" => (Mode::Id, "In distribution", "ID"),
            _ => (Mode::Ood, "Out of distribution", "OOD"),
        };
        let scores = Scores::read(&request.folder)?;
        let told = |mode| match mode {
            Mode::Id => "those of `harmzone eval` without --ood",
            Mode::Ood => "those of `harmzone eval --ood`",
        };
        let found = scores.evaluation.metrics.mode;
        if found != mode {
            let (found, wanted, path) = (told(found), told(mode), request.folder.clone());
            return Err(ReportError::OtherMode { key, found, wanted, path });
        }
        let dataset = SideData::find(request, scores.provenance.as_ref())?;
        Ok(Self { key, name, short, scores, dataset })
    }

    /// The command that makes all files of the scores.
    fn command_of_scores(&self) -> String {
        let flag = if self.key == "ood" { " --ood" } else { "" };
        format!("harmzone eval RUN --data DIR{flag} --out {} --force", self.scores.folder.display())
    }

    /// The command that names the data set of the scores.
    fn command_with_data(&self) -> String {
        format!("harmzone report OUT .. --{0} {1} --{0}-data DIR", self.key, self.scores.folder.display())
    }
}

/// Writes the report.
///
/// # Errors
/// [`ReportError`]: no scores, scores of the other kind, a data set or picture that cannot be read, a file that exists.
pub fn run(request: &ReportRequest) -> Result<ReportSummary, ReportError> {
    let is_page = request.out.extension().is_some_and(|extension| extension == "html");
    let out = if is_page { request.out.clone() } else { request.out.join(PAGE_FILE) };
    if !request.force && files::is_there(&out)? {
        return Err(ReportError::Exists { path: out });
    }
    let wanted = [("id", &request.id), ("ood", &request.ood)];
    let given = wanted.into_iter().filter_map(|(key, side)| Some((key, side.as_ref()?)));
    let sides: Vec<Side> = given.map(|(key, side)| Side::read(key, side)).collect::<Result<_, _>>()?;
    let drives = request.drives.as_deref();
    let drives =
        drives.map(|folder| Ok::<_, ReadDrivesError>((folder, DriveSummary::read(folder)?))).transpose()?;
    let page = page(&sides, drives.as_ref().map(|(folder, of)| (*folder, of)), request)?;
    let html = render(("report.html", include_str!("report.html")), &page);
    if let Some(folder) = out.parent().filter(|folder| *folder != Path::new("")) {
        fs::create_dir_all(folder)?;
    }
    write_atomic(&out, html.as_bytes())?;
    let blocks = || page.sections.iter().flat_map(|section| &section.blocks);
    let absent = blocks().filter_map(|block| match block {
        Block::Absent { what, command } => Some(format!("{what}; {command}")),
        _ => None,
    });
    let is_own = |section: &&Section| section.id == "made" || section.id == "gallery" && request.n_cards > 0;
    let mut own = page.sections.iter().filter(is_own).flat_map(|section| &section.blocks);
    let is_whole = !own.any(|block| matches!(block, Block::Absent { .. }));
    let n_cards =
        blocks().map(|block| if let Block::Gallery(gallery) = block { gallery.cards.len() } else { 0 });
    Ok(ReportSummary { bytes: html.len(), n_cards: n_cards.sum(), absent: absent.collect(), is_whole, out })
}

fn page(
    sides: &[Side],
    drives: Option<(&Path, &DriveSummary)>,
    request: &ReportRequest,
) -> Result<Page, ReportError> {
    let section = |id, title, blocks| Section { id, title, blocks };
    let counts = sides.iter().map(|side| {
        let counts = &side.scores.evaluation.metrics.counts;
        format!("{} samples {}", counts.n_samples, side.name.to_lowercase())
    });
    let is_development = |side: &Side| {
        let source = side.scores.provenance.as_ref();
        source.and_then(Provenance::standing).is_some_and(Standing::is_development)
    };
    let drives_are = |(_, drives): (_, &DriveSummary)| drives::standing(drives).is_development();
    let title = if sides.iter().any(is_development) || drives.is_some_and(drives_are) {
        "harmzone report: development figures"
    } else {
        "harmzone report"
    };
    let mut sections = Vec::new();
    if !sides.is_empty() {
        sections.push(section("headline", "Headline", headline::blocks(sides)?));
    }
    if let Some(drives) = drives {
        let blocks = drives::blocks(drives, sides, request.n_cards)?;
        sections.push(section("drives", "Closed loop", blocks));
    }
    if !sides.is_empty() {
        sections.extend([
            section("curves", "Curves", detection::blocks(sides)?),
            section("safety", "Safety", safety::blocks(sides)?),
            section("calibration", "Calibration", calibration::blocks(sides)?),
            section("sweeps", "Speed and steering", sweeps::blocks(sides)?),
            section("groups", "By group", groups::blocks(sides)?),
            section("results", "Ablations and rivals", results_blocks(request)?),
            section("gallery", "Gallery", gallery::blocks(sides, request.n_cards)?),
        ]);
    }
    sections.push(section("made", "How it was made", provenance::blocks(sides, &request.command)));
    Ok(Page {
        title: title.to_owned(),
        subtitle: counts.chain(drives.map(|(_, of)| count_drives(of))).collect::<Vec<_>>().join(", "),
        version: env!("CARGO_PKG_VERSION"),
        style: include_str!("report.css"),
        script: include_str!("report.js"),
        sections,
    })
}

fn count_drives(of: &DriveSummary) -> String {
    let n: usize = of.outcomes.iter().map(Vec::len).sum();
    format!("{n} drives of {} drivers", of.figures.len())
}

/// Ablations and rivals, as far as they were made.
fn results_blocks(request: &ReportRequest) -> Result<Vec<Block>, ReportError> {
    Ok(match &request.results {
        Some(path) => results::blocks(&Results::read(path)?),
        None => vec![Block::absent(
            "no ablations and baselines (results.json)",
            "make results, then harmzone report OUT .. --results runs/results/results.json",
        )],
    })
}
