//! Two data sets side by side: `compare.txt`, `compare.json` with every histogram, and `compare.png`.

mod charts;
mod text;

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::chart::{self, ChartError};
use crate::compare::{CompareError, DomainGap, compare};
use crate::episode::Split;
use crate::files::{self, FolderLock, seal_result, write_atomic};
use crate::progress::Progress;

/// Names of the files, the one that says that all are there last.
pub const FILES: [&str; 3] = ["compare.png", "compare.txt", "compare.json"];

/// Why two data sets could not be set side by side.
#[derive(Debug, Error)]
pub enum CompareReportError {
    #[error(transparent)]
    Compare(#[from] CompareError),
    #[error(transparent)]
    Chart(#[from] ChartError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the file exists; --force replaces it: {}", path.display())]
    Exists { path: PathBuf },
}

/// What to compare.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompareRequest {
    pub a: PathBuf,
    pub b: PathBuf,
    /// `None` for all splits.
    pub split: Option<Split>,
    /// Where to write the files.
    pub out: Option<PathBuf>,
    pub force: bool,
}

/// Compares, and writes the files if asked to.
///
/// # Errors
/// [`CompareReportError`]: a data set that cannot be read, a file that exists, another process that writes there, a full disk.
pub fn run(request: &CompareRequest, progress: &dyn Progress) -> Result<DomainGap, CompareReportError> {
    let _lock = request.out.as_deref().map(FolderLock::take).transpose()?;
    if let Some(out) = &request.out {
        let taken = files::first_there(FILES.map(|name| out.join(name)))?;
        if let Some(path) = taken.filter(|_| !request.force) {
            return Err(CompareReportError::Exists { path });
        }
    }
    let gap = compare(&request.a, &request.b, request.split, progress)?;
    if let Some(out) = &request.out {
        write(out, &gap)?;
    }
    Ok(gap)
}

fn write(out: &Path, gap: &DomainGap) -> Result<(), CompareReportError> {
    let json = seal_result(&serde_json::to_string_pretty(gap).expect("figures always have a JSON form"));
    let contents = [chart::png(&charts::sheet(gap))?, gap.to_string().into_bytes(), json.into_bytes()];
    for (name, bytes) in FILES.iter().zip(contents) {
        write_atomic(&out.join(name), &bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    #[test]
    fn a_second_writer_is_told_before_the_work_and_a_comparison_that_fails_leaves_no_folder() {
        let home = tempfile::tempdir().unwrap();
        let (data, out) = (home.path().join("absent"), home.path().join("out"));
        let request =
            CompareRequest { a: data.clone(), b: data, split: None, out: Some(out.clone()), force: false };
        let told = || run(&request, &Silent).unwrap_err().to_string();
        assert!(told().contains("absent"));
        assert!(!out.exists());
        let _lock = FolderLock::take(&out).unwrap();
        assert!(told().contains("another process writes here"), "{}", told());
    }
}
