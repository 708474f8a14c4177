//! What a run writes down as it goes: a row for each step and a row for each validation.

use std::path::{Path, PathBuf};

use fs_err as fs;

use crate::files;

/// Rows of a CSV file, cut back to the step that a run goes on from. The first column counts steps.
pub struct Log {
    path: PathBuf,
    header: &'static str,
    rows: Vec<String>,
}

impl Log {
    /// Takes up the rows of the first `n_done` steps.
    ///
    /// # Errors
    /// The file is there and cannot be read.
    pub fn open(path: &Path, header: &'static str, n_done: usize) -> std::io::Result<Self> {
        let mut rows = Vec::new();
        if path.exists() {
            let is_done = |row: &&str| {
                row.split(',').next().and_then(|n| n.parse::<usize>().ok()).is_some_and(|n| n <= n_done)
            };
            rows = fs::read_to_string(path)?.lines().skip(1).filter(is_done).map(ToOwned::to_owned).collect();
        }
        Ok(Self { path: path.to_owned(), header, rows })
    }

    pub fn push(&mut self, row: String) {
        self.rows.push(row);
    }

    /// Writes all rows, whole or not at all; without a row there is no file.
    ///
    /// # Errors
    /// Any IO error.
    pub fn save(&self) -> std::io::Result<()> {
        if self.rows.is_empty() {
            return Ok(());
        }
        files::write_atomic(&self.path, format!("{}\n{}\n", self.header, self.rows.join("\n")).as_bytes())
    }
}
