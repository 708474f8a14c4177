//! `harmzone init`: a folder to work in, with commented configs and the commands of a whole experiment.

use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use clap::Args;
use serde_json::json;

use super::{ExitStatus, path_text, print};
use crate::files::{FolderLock, write_atomic};

#[derive(Debug, Args)]
pub struct InitArgs {
    /// Folder to make, or to fill where nothing of it exists
    #[arg(default_value = ".")]
    folder: PathBuf,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
    /// Print the files that were written as JSON
    #[arg(long)]
    json: bool,
}

const GEN: &str = include_str!("../../configs/gen.toml");
const ZONE: &str = include_str!("../../configs/zone.toml");
const TRAIN: &str = include_str!("../../configs/train.toml");
const EVAL: &str = include_str!("../../configs/eval.toml");
const RUN: &str = include_str!("project/run.sh");
const README: &str = include_str!("project/README.md");
const IGNORED: &str = "/data/\n/runs/\n";

/// The files of a project; every key of the configs stands at its default.
const FILES: [(&str, &str); 7] = [
    ("README.md", README),
    ("run.sh", RUN),
    ("gen.toml", GEN),
    ("zone.toml", ZONE),
    ("train.toml", TRAIN),
    ("eval.toml", EVAL),
    (".gitignore", IGNORED),
];

pub fn run(args: InitArgs) -> anyhow::Result<ExitStatus> {
    let folder = &args.folder;
    ensure!(!folder.is_file(), "a folder is wanted, and this is a file: {}", folder.display());
    let _lock = FolderLock::take(folder)?;
    let taken: Vec<&str> =
        FILES.iter().map(|(name, _)| *name).filter(|name| folder.join(name).exists()).collect();
    if !taken.is_empty() && !args.force {
        bail!("{} exist already; --force replaces them: {}", taken.join(", "), folder.display());
    }
    for (name, text) in FILES {
        let path = folder.join(name);
        write_atomic(&path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let names: Vec<&str> = FILES.iter().map(|(name, _)| *name).collect();
    if args.json {
        print(json!({"folder": path_text(folder), "files": names}))?;
    } else {
        let folder = folder.display();
        print(format!("{folder}: {}\nnext: cd {folder} && bash run.sh", names.join(", ")))?;
    }
    Ok(ExitStatus::Done)
}

#[cfg(test)]
mod tests {
    use fs_err as fs;

    use super::*;
    use crate::generate::GenerateConfig;
    use crate::train::TrainConfig;

    #[test]
    fn a_project_holds_configs_that_load_and_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("mine");
        let args = |force| InitArgs { folder: at.clone(), force, json: false };
        run(args(false)).unwrap();
        let read = |name: &str| fs::read_to_string(at.join(name)).unwrap();
        assert_eq!(toml::from_str::<GenerateConfig>(&read("gen.toml")).unwrap(), GenerateConfig::default());
        assert_eq!(toml::from_str::<TrainConfig>(&read("train.toml")).unwrap(), TrainConfig::default());
        fs::write(at.join("gen.toml"), "seed = 5\n").unwrap();
        let told = run(args(false)).unwrap_err().to_string();
        assert!(told.contains("gen.toml") && told.contains("--force"), "{told}");
        assert_eq!(read("gen.toml"), "seed = 5\n");
        let lock = FolderLock::take(&at).unwrap();
        let told = run(args(true)).unwrap_err().to_string();
        assert!(told.contains("another process writes here"), "{told}");
        drop(lock);
        run(args(true)).unwrap();
        assert_ne!(read("gen.toml"), "seed = 5\n");
    }
}
