//! The folder that is served: what lies in it, and that nothing outside it is read.
//!
//! Names that a reader of the page sends are looked up in lists and never become paths. What the folder itself names
//! (manifests, links) is resolved, and refused where it leads out.

use std::path::{Path, PathBuf};

use fs_err as fs;

use super::ServeError;
use crate::episode::Manifest;
use crate::report::scores::METRICS_FILE;

/// How far below the folder things are looked for.
const MOST_DEPTH: usize = 6;
/// Most entries that are looked at, so that serving `/` by mistake ends soon.
const MOST_ENTRIES: usize = 200_000;
/// Folders of a data set that hold many files and no other data, and the one where `doctor` puts what was damaged.
const NOT_SEARCHED: [&str; 4] = ["episodes", "labels", "aov", "set_aside"];
/// Folder of a recorded data set where `drive` writes a log for each episode.
const DRIVE_LOGS: &str = "predictions";
/// What `predict` writes beside its boxes; its MCAP files have the boxes too.
const PREDICTIONS_FILE: &str = "predictions.json";

/// The folder, by its real path.
#[derive(Debug, Clone)]
pub struct ServedFolder {
    path: PathBuf,
}

/// What can be shown, each list sorted.
#[derive(Debug, Default)]
pub struct Findings {
    /// Folders of data sets.
    pub datasets: Vec<PathBuf>,
    /// Folders of predictions.
    pub predictions: Vec<PathBuf>,
    /// Folders of a driver's logs, each in its data set.
    pub drive_logs: Vec<PathBuf>,
    /// Folders of scores.
    pub scores: Vec<PathBuf>,
    /// Pages of `harmzone report`.
    pub reports: Vec<PathBuf>,
    /// Whether the folder holds more than is looked through.
    pub is_cut: bool,
}

impl ServedFolder {
    /// Takes a folder.
    ///
    /// # Errors
    /// There is none at the path.
    pub fn open(path: &Path) -> Result<Self, ServeError> {
        if !path.is_dir() {
            let found = if path.exists() { "a file is" } else { "nothing is" };
            return Err(ServeError::NoFolder { found, path: path.to_owned() });
        }
        let real = fs::canonicalize(path)?;
        Ok(Self { path: real })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The real path of a file or folder, if it lies in this folder.
    ///
    /// # Errors
    /// Nothing is there, or a link leads out.
    pub fn inside(&self, path: &Path) -> Result<PathBuf, ServeError> {
        let real = fs::canonicalize(path)?;
        if real.starts_with(&self.path) {
            Ok(real)
        } else {
            Err(ServeError::Outside { folder: self.path.clone(), path: path.to_owned() })
        }
    }

    /// Refuses files that lead out; those that are not there are fine.
    ///
    /// # Errors
    /// As [`Self::inside`].
    pub fn check_files(&self, folder: &Path, names: &[&str]) -> Result<(), ServeError> {
        let mut files = names.iter().map(|name| folder.join(name)).filter(|path| path.exists());
        files.try_for_each(|path| self.inside(&path).map(drop))
    }

    /// What a thing in the folder is called on the page: its path from here, or this folder's name.
    #[must_use]
    pub fn name_of(&self, path: &Path) -> String {
        let rest = path.strip_prefix(&self.path).unwrap_or(path);
        let named = if rest.as_os_str().is_empty() {
            self.path.file_name().unwrap_or_default()
        } else {
            rest.as_os_str()
        };
        named.to_string_lossy().into_owned()
    }

    /// Looks for data sets, predictions, logs of drives, scores and reports. Links are not followed, hidden folders not searched.
    ///
    /// # Errors
    /// The folder cannot be read; folders below that cannot be read are left out.
    pub fn search(&self) -> Result<Findings, ServeError> {
        let mut found = Findings::default();
        let mut n_seen = 0;
        let mut waiting = vec![(self.path.clone(), 0, false)];
        while let Some((folder, depth, may_be_logs)) = waiting.pop() {
            let entries = match fs::read_dir(&folder) {
                Ok(entries) => entries,
                Err(error) if depth == 0 => return Err(error.into()),
                Err(error) => {
                    tracing::warn!("left out: {error}");
                    continue;
                }
            };
            let is_dataset = folder.join(Manifest::FILE).exists();
            let (mut has_logs, mut has_list) = (false, false);
            for entry in entries.filter_map(Result::ok) {
                n_seen += 1;
                if n_seen > MOST_ENTRIES {
                    found.is_cut = true;
                    waiting.clear();
                    break;
                }
                let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
                let Ok(kind) = entry.file_type() else { continue };
                if kind.is_dir() {
                    let is_skipped =
                        name.starts_with('.') || is_dataset && NOT_SEARCHED.contains(&name.as_str());
                    if !is_skipped && depth < MOST_DEPTH {
                        waiting.push((path, depth + 1, is_dataset && name == DRIVE_LOGS));
                    }
                } else if name == Manifest::FILE {
                    // Also as a link: it is resolved, and refused if it leads out, where it is read.
                    found.datasets.push(folder.clone());
                } else if name == PREDICTIONS_FILE {
                    found.predictions.push(folder.clone());
                    has_list = true;
                } else if name == METRICS_FILE {
                    found.scores.push(folder.clone());
                } else if kind.is_file() && path.extension().is_some_and(|extension| extension == "html") {
                    found.reports.push(path);
                } else if path.extension().is_some_and(|extension| extension == "mcap") {
                    has_logs = true;
                }
            }
            if may_be_logs && has_logs && !has_list {
                found.drive_logs.push(folder);
            }
        }
        let Findings { datasets, predictions, drive_logs, scores, reports, .. } = &mut found;
        for list in [datasets, predictions, drive_logs, scores, reports] {
            list.sort();
        }
        Ok(found)
    }
}

impl Findings {
    /// Whether there is nothing to show.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.datasets.is_empty() && self.scores.is_empty() && self.reports.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn what_is_below_is_found_and_what_leads_out_is_refused() {
        let outside = tempfile::tempdir().unwrap();
        fs::write(outside.path().join("secret.html"), b"secret").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let make = |file: &str| {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"{}").unwrap();
        };
        let files = ["a/dataset.json", "a/episodes/dataset.json", "a/predictions/small/predictions.json"];
        files.into_iter().chain(["s/metrics.json", "report.html", ".hidden/metrics.json"]).for_each(make);
        // What `doctor` put aside, and logs of drives: not elsewhere than in a data set, and not what `predict` wrote.
        let logs = ["b/predictions/x.mcap", "c/predictions/x.mcap", "b/found/x.mcap"];
        let predicted = ["d/predictions/predictions.json", "d/predictions/x.mcap"];
        let sets = ["a/set_aside/dataset.json", "b/dataset.json", "d/dataset.json"];
        logs.into_iter().chain(predicted).chain(sets).for_each(make);
        symlink(outside.path(), folder.path().join("out")).unwrap();
        symlink(outside.path().join("secret.html"), folder.path().join("secret.html")).unwrap();
        symlink(folder.path().join("report.html"), folder.path().join("again.html")).unwrap();

        let served = ServedFolder::open(folder.path()).unwrap();
        let found = served.search().unwrap();
        let names = |paths: &[PathBuf]| paths.iter().map(|path| served.name_of(path)).collect::<Vec<_>>();
        assert_eq!(names(&found.datasets), ["a", "b", "d"]);
        assert_eq!(names(&found.predictions), ["a/predictions/small", "d/predictions"]);
        assert_eq!(names(&found.drive_logs), ["b/predictions"]);
        assert_eq!(
            (names(&found.scores), names(&found.reports)),
            (vec!["s".into()], vec!["report.html".into()])
        );
        assert!(!found.is_cut && !found.is_empty());

        assert!(served.inside(&folder.path().join("again.html")).is_ok(), "a link that stays inside");
        for leads_out in ["secret.html", "out/secret.html", "out", "../"] {
            let told = served.inside(&folder.path().join(leads_out)).unwrap_err().to_string();
            assert!(told.contains("leads out of"), "{told}");
        }
        assert!(served.check_files(folder.path(), &["report.html", "absent"]).is_ok());
        assert!(served.check_files(folder.path(), &["report.html", "secret.html"]).is_err());
        assert!(ServedFolder::open(&folder.path().join("report.html")).is_err());
    }
}
