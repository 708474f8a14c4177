//! `harmzone man`: the manual, made of the commands' own help.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use clap::Args;
use clap_mangen::Man;

use super::{ExitStatus, print};
use crate::config::nearest;
use crate::files::{FolderLock, write_atomic};

#[derive(Debug, Args)]
pub struct ManArgs {
    /// Command whose page is printed, such as `gen` or `import kitti` [default: the program's own page]
    command: Vec<String>,
    /// Folder for all pages, in place of printing one: harmzone.1, harmzone-gen.1, ..
    #[arg(long, value_name = "DIR", conflicts_with = "command")]
    out: Option<PathBuf>,
    /// Print one Markdown page of all commands, as docs/reference/commands.md
    #[arg(long, conflicts_with_all = ["command", "out"])]
    markdown: bool,
    /// Replace pages that are there
    #[arg(long, requires = "out")]
    force: bool,
}

pub fn run(args: ManArgs) -> anyhow::Result<ExitStatus> {
    if args.markdown {
        print(markdown())?;
    } else if let Some(out) = &args.out {
        let pages = pages()?;
        ensure!(!out.is_file(), "a folder is wanted, and this is a file: {}", out.display());
        let _lock = FolderLock::take(out)?;
        let taken = pages.iter().map(|(name, _)| out.join(name)).find(|path| path.exists());
        if let Some(taken) = taken.filter(|_| !args.force) {
            return Err(anyhow!("the page exists; --force replaces it: {}", taken.display()));
        }
        write(&pages, out)?;
        print(format!("{} pages: {}", pages.len(), out.display()))?;
    } else {
        print(page(&find(&args.command)?)?)?;
    }
    Ok(ExitStatus::Done)
}

/// The command of some words, under its whole name.
fn find(words: &[String]) -> anyhow::Result<clap::Command> {
    let mut found = super::visible();
    for word in words {
        let names: Vec<&str> = found.get_subcommands().map(clap::Command::get_name).collect();
        let inner = found.find_subcommand(word).cloned();
        found = inner.with_context(|| match nearest(word, names.iter().copied()) {
            Some(near) => format!("no command `{word}`; did you mean `{near}`?"),
            None => format!("no command `{word}`; there are: {}", names.join(", ")),
        })?;
    }
    Ok(found)
}

fn page(command: &clap::Command) -> anyhow::Result<String> {
    let mut page = Vec::new();
    Man::new(command.clone())
        .date("")
        .source(concat!("harmzone ", env!("CARGO_PKG_VERSION")))
        .render(&mut page)?;
    Ok(String::from_utf8(page)?)
}

/// Names and texts of all pages.
fn pages() -> anyhow::Result<Vec<(String, String)>> {
    fn collect(command: &clap::Command, into: &mut Vec<(String, String)>) -> anyhow::Result<()> {
        let name = command.get_display_name().unwrap_or_else(|| command.get_name());
        into.push((format!("{name}.1"), page(command)?));
        for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
            collect(inner, into)?;
        }
        Ok(())
    }
    let mut pages = Vec::new();
    collect(&super::visible(), &mut pages)?;
    Ok(pages)
}

fn write(pages: &[(String, String)], out: &Path) -> anyhow::Result<()> {
    for (name, text) in pages {
        write_atomic(&out.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// All commands on one Markdown page: their help, under headings.
pub fn markdown() -> String {
    fn collect(command: &clap::Command, words: &str, into: &mut String) {
        let level = "#".repeat(words.split(' ').count());
        let help = command.clone().render_help().to_string();
        let heading = if words == "harmzone" { "Commands" } else { words };
        *into += &format!("{level} {heading}\n\n```text\n{}\n```\n\n", help.trim_end());
        for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
            collect(inner, &format!("{words} {}", inner.get_name()), into);
        }
    }
    let mut out = String::new();
    collect(&super::visible(), "harmzone", &mut out);
    out.trim_end().to_owned() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page() {
        let pages = pages().unwrap();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        for name in ["harmzone.1", "harmzone-gen.1", "harmzone-import-kitti.1"] {
            assert!(names.contains(&name), "{names:?}");
        }
        assert!(names.iter().all(|name| !name.contains("worker")), "{names:?}");
        assert!(pages.iter().all(|(_, text)| text.contains(".SH NAME") && text.contains(".SH SYNOPSIS")));
    }

    #[test]
    fn an_unknown_command_is_told_the_nearest() {
        let told = find(&["labels".to_owned()]).unwrap_err().to_string();
        assert!(told.contains("did you mean `label`"), "{told}");
    }
}
