//! `harmzone migrate`: manifests of older formats, written anew in today's.

use std::fmt;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::{ExitStatus, print_summary};
use crate::episode::Manifest;
use crate::episode::manifest::{LabelManifest, label_sets};
use crate::files::FolderLock;
use crate::store::{Access, Location};

#[derive(Debug, Args)]
pub struct MigrateArgs {
    /// Folder or URL of a data set
    dataset: Location,
    /// Tell what would be written, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// One manifest, and its format before and after.
#[derive(Debug, Serialize)]
struct Migrated {
    file: PathBuf,
    from: u32,
    to: u32,
}

#[derive(Debug, Serialize)]
struct Summary {
    is_dry_run: bool,
    files: Vec<Migrated>,
}

pub fn run(args: MigrateArgs) -> anyhow::Result<ExitStatus> {
    let place = args.dataset.open(if args.dry_run { Access::Read } else { Access::Write })?;
    let folder = place.path();
    // Before the lock, whose taking makes a folder.
    Manifest::read(folder)?;
    let _lock = (!args.dry_run).then(|| FolderLock::take(folder)).transpose()?;
    // And of the label sets, into which `label` may be writing.
    let sets = if args.dry_run { Vec::new() } else { label_sets(folder)? };
    let of_sets = sets.iter().map(|set| FolderLock::take(&LabelManifest::folder(folder, set)));
    let _locks = of_sets.collect::<Result<Vec<_>, _>>()?;
    let mut manifest = Manifest::read(folder)?;
    let mut files = Vec::new();
    // Labels first: while they are of the older format, so is the data set.
    for set in label_sets(folder)? {
        let mut labels = LabelManifest::read(folder, &set)?;
        let (from, to) = (labels.format_version, LabelManifest::VERSION);
        files.push(Migrated {
            file: LabelManifest::folder(folder, &set).join(LabelManifest::FILE),
            from,
            to,
        });
        if from != to && !args.dry_run {
            labels.format_version = to;
            labels.write(folder)?;
        }
    }
    let (from, to) = (manifest.format_version, Manifest::VERSION);
    files.push(Migrated { file: folder.join(Manifest::FILE), from, to });
    if from != to && !args.dry_run {
        manifest.format_version = to;
        manifest.write(folder)?;
    }
    place.push()?;
    print_summary(&Summary { is_dry_run: args.dry_run, files }, args.json)?;
    Ok(ExitStatus::Done)
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Migrated { file, from, to } in &self.files {
            let what = match (from == to, self.is_dry_run) {
                (true, _) => "as it is   ",
                (false, true) => "to be done ",
                (false, false) => "written    ",
            };
            writeln!(f, "{what} version {from} -> {to}  {}", file.display())?;
        }
        Ok(())
    }
}
