//! The layering of `src/`: who may import whom, and what may appear where.
//!
//! Reads the sources as text, with comments and string literals blanked. A rule that a file must
//! break is changed here, in the table, with its reason.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use fs_err as fs;

/// Each top module and its layer; a module imports only from lower numbers.
const LAYERS: [(&str, u32); 24] = [
    ("geometry", 0),
    ("config", 0),
    ("device", 0),
    ("files", 0),
    ("progress", 0),
    ("random", 0),
    ("history", 1),
    ("text_table", 0),
    ("object", 1),
    ("sample", 2), // above `object`: a sample holds objects
    ("zone", 3),
    ("scene", 3),
    ("sensors", 3),
    ("sim", 4),
    ("episode", 4),
    ("generate", 5),
    ("label", 5),
    ("dataset", 6),
    ("kernels", 6),
    ("model", 7),
    ("eval", 7),
    ("infer", 8),
    ("train", 9),
    ("report", 10),
];
const CLI_LAYER: u32 = 11;

/// Words that may appear only in files under the given prefixes (relative to `src/`), and why.
const CONFINED: [(&[&str], &[&str], &str); 6] = [
    (&["clap", "anyhow"], &["cli/", "main.rs"], "the library has typed errors and no flags"),
    (
        &["println!", "eprintln!", "print!", "eprint!", "dbg!"],
        &[],
        "the library returns what it has to say, or tells it through `Progress`; commands use `cli::print`",
    ),
    (&["pyo3", "numpy"], &["sim/"], "only the simulator talks to Python"),
    (&["mcap"], &["episode/"], "episodes are read and written in one place"),
    (&["unsafe"], &["kernels/"], "only measured kernels may be unsafe"),
    (&["std::fs"], &[], "fs_err names the path in its errors"),
];

/// Files (prefixes relative to `src/`) that touch neither disk, clock nor environment; exceptions after.
const PURE: [&str; 8] =
    ["geometry/", "object.rs", "sample.rs", "sensors/", "model/", "eval/matching", "eval/metrics", "zone/"];
const IMPURE: [&str; 3] = ["model/checkpoint", "model/image_weights", "model/golden"]; // the last is for tests alone
const IO_WORDS: [&str; 8] =
    ["fs_err", "std::fs", "std::net", "std::process", "std::env", "std::time", "write_atomic", "SystemTime"];

const VAGUE_NAMES: [&str; 8] =
    ["util", "utils", "common", "helper", "helpers", "manager", "managers", "misc"];

struct Source {
    /// Relative to `src/`, with `/`.
    name: String,
    raw: String,
    /// `raw` without comments and string contents.
    code: String,
}

impl Source {
    /// The code before the tests at the foot of the file.
    fn product(&self) -> &str {
        let cut = self.code.match_indices("#[cfg(test)]").find_map(|(at, attribute)| {
            let next = self.code[at + attribute.len()..].trim_start();
            next.starts_with("mod ").then_some(at)
        });
        &self.code[..cut.unwrap_or(self.code.len())]
    }

    /// The top module: `geometry` for `geometry/boxes.rs`, `config` for `config.rs`.
    fn module(&self) -> &str {
        self.name.split(['/', '.']).next().expect("a split has a first part")
    }

    fn is_under(&self, prefixes: &[&str]) -> bool {
        prefixes.iter().any(|prefix| self.name.starts_with(prefix))
    }
}

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files: Vec<PathBuf> = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("src is there") {
            let path = entry.expect("src can be listed").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    let read = |path: PathBuf| {
        let raw = fs::read_to_string(&path).expect("a source is UTF-8");
        let name = path.strip_prefix(&root).expect("found under src").display().to_string();
        Source { name, code: blanked(&raw), raw }
    };
    files.into_iter().map(read).collect()
}

/// The text with comments, and what strings and characters hold, turned into spaces; lines are kept.
fn blanked(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let starts = |at: usize, what: &str| what.chars().enumerate().all(|(i, c)| chars.get(at + i) == Some(&c));
    let mut code = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let end = if starts(at, "//") {
            (at..chars.len()).find(|&i| chars[i] == '\n').unwrap_or(chars.len())
        } else if starts(at, "/*") {
            (at + 2..chars.len()).find(|&i| starts(i, "*/")).map_or(chars.len(), |i| i + 2)
        } else if let Some(hashes) = raw_string_hashes(&chars, at) {
            let close = format!("\"{}", "#".repeat(hashes));
            let body = at + 1 + hashes + 1;
            (body..chars.len()).find(|&i| starts(i, &close)).map_or(chars.len(), |i| i + close.len())
        } else if chars[at] == '"' {
            closing(&chars, at, '"')
        } else if chars[at] == '\'' && (chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\''))
        {
            closing(&chars, at, '\'')
        } else {
            at
        };
        if end == at {
            code.push(chars[at]);
            at += 1;
        } else {
            code.extend(chars[at..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
            at = end;
        }
    }
    code
}

/// Index after the closing quote of the literal that opens at `at`.
fn closing(chars: &[char], at: usize, quote: char) -> usize {
    let mut i = at + 1;
    while i < chars.len() && chars[i] != quote {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    (i + 1).min(chars.len())
}

/// Number of `#` of a raw string that opens at `at`; `None` where none opens.
fn raw_string_hashes(chars: &[char], at: usize) -> Option<usize> {
    let begins = chars[at] == 'r' && (at == 0 || !is_word(chars[at - 1]) || chars[at - 1] == 'b');
    let hashes = chars[at + 1..].iter().take_while(|&&c| c == '#').count();
    (begins && chars.get(at + 1 + hashes) == Some(&'"')).then_some(hashes)
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Byte positions where `word` stands by itself, not as part of a longer name.
fn places(code: &str, word: &str) -> Vec<usize> {
    code.match_indices(word)
        .filter(|(at, _)| {
            let before = code[..*at].chars().next_back();
            let after = code[at + word.len()..].chars().next();
            !(before.is_some_and(is_word) || word.ends_with(is_word) && after.is_some_and(is_word))
        })
        .map(|(at, _)| at)
        .collect()
}

/// Whether a crate is named: `name::..` from the root, or `use name`.
fn names_crate(code: &str, name: &str) -> bool {
    places(code, name).into_iter().any(|at| {
        let before = code[..at].trim_end();
        let after = &code[at + name.len()..];
        let is_root = !before.ends_with("::") || before.ends_with("(::");
        (is_root && after.starts_with("::")) || (before.ends_with("use") && after.starts_with([';', ' ']))
    })
}

/// Top modules named through `crate::`, `crate::{a, b::c}` included.
fn imports(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for at in places(code, "crate::") {
        let rest = &code[at + "crate::".len()..];
        if let Some(group) = rest.strip_prefix('{') {
            let mut depth = 1;
            let mut part = String::new();
            for c in group.chars() {
                match c {
                    '{' => depth += 1,
                    '}' => depth -= 1,
                    ',' if depth == 1 => found.push(first_word(&std::mem::take(&mut part))),
                    _ if depth == 1 => part.push(c),
                    _ => {}
                }
                if depth == 0 {
                    break;
                }
            }
            found.push(first_word(&part));
        } else {
            found.push(first_word(rest));
        }
    }
    found.retain(|module| !module.is_empty());
    found
}

fn first_word(text: &str) -> String {
    text.trim_start().chars().take_while(|&c| is_word(c)).collect()
}

fn layer(module: &str) -> Option<u32> {
    LAYERS.iter().find(|(name, _)| *name == module).map(|(_, layer)| *layer)
}

fn assert_none(broken: &[String]) {
    assert!(broken.is_empty(), "\n{}\n", broken.join("\n"));
}

#[test]
fn each_module_imports_only_from_lower_layers() {
    let mut broken = Vec::new();
    for source in sources() {
        let own = source.module().to_owned();
        if own == "lib" || own == "main" {
            continue;
        }
        let Some(own_layer) = layer(&own).or((own == "cli").then_some(CLI_LAYER)) else {
            broken.push(format!("src/{}: `{own}` has no layer; give it one in LAYERS", source.name));
            continue;
        };
        for import in imports(&source.code) {
            let import_layer = layer(&import).or((import == "cli").then_some(CLI_LAYER));
            // Names that are no module, such as a macro of the crate, have no layer.
            if import != own && import_layer.is_some_and(|theirs| theirs >= own_layer) {
                broken.push(format!(
                    "src/{}: `{own}` (layer {own_layer}) imports `{import}` (layer {})",
                    source.name,
                    import_layer.unwrap_or_default()
                ));
            }
        }
        if source.product().contains("super::super::") {
            broken.push(format!("src/{}: climb with `crate::`, not `super::super::`", source.name));
        }
    }
    assert_none(&broken);
}

#[test]
fn the_program_only_calls_the_command_line() {
    let main = sources().into_iter().find(|source| source.name == "main.rs").expect("there is a main.rs");
    let calls: Vec<&str> = main.code.split("harmzone::").skip(1).collect();
    assert!(!calls.is_empty() && calls.iter().all(|call| call.starts_with("cli::")), "{calls:?}");
}

#[test]
fn every_file_opens_by_saying_what_it_is() {
    let silent = |source: &Source| !source.raw.lines().next().unwrap_or("").starts_with("//! ");
    let broken: Vec<String> = sources()
        .iter()
        .filter(|source| silent(source))
        .map(|source| format!("src/{}: the first line is not `//! ..`", source.name))
        .collect();
    assert_none(&broken);
}

#[test]
fn crates_printing_and_unsafe_stay_where_they_belong() {
    let mut broken = Vec::new();
    for source in sources() {
        for (words, homes, reason) in CONFINED {
            if source.is_under(homes) {
                continue;
            }
            for word in words {
                let is_syntax = word.ends_with('!') || word.contains("::") || *word == "unsafe";
                let code = source.product();
                let found = if is_syntax { !places(code, word).is_empty() } else { names_crate(code, word) };
                if found {
                    broken.push(format!("src/{}: `{word}` belongs in {homes:?}: {reason}", source.name));
                }
            }
        }
    }
    assert_none(&broken);
}

#[test]
fn rules_and_tensors_touch_neither_disk_nor_clock() {
    let mut broken = Vec::new();
    for source in sources().iter().filter(|source| source.is_under(&PURE) && !source.is_under(&IMPURE)) {
        for word in IO_WORDS.iter().filter(|word| !places(source.product(), word).is_empty()) {
            broken.push(format!("src/{}: `{word}` in a file that does no IO", source.name));
        }
    }
    assert_none(&broken);
}

#[test]
fn the_network_never_sees_the_truth() {
    let mut broken = Vec::new();
    for source in sources().iter().filter(|source| source.is_under(&["model/"])) {
        for word in ["Truth", "ObjectTruth", "LabelledObject"] {
            if !places(source.product(), word).is_empty() {
                broken.push(format!("src/{}: `{word}`; inputs are built from `&Measured`", source.name));
            }
        }
    }
    assert_none(&broken);
}

#[test]
fn no_module_has_a_vague_name() {
    let is_vague = |source: &Source| source.name.split(['/', '.']).any(|part| VAGUE_NAMES.contains(&part));
    let broken: Vec<String> = sources()
        .iter()
        .filter(|source| is_vague(source))
        .map(|source| format!("src/{}: name the file after its one idea", source.name))
        .collect();
    assert_none(&broken);
}

#[test]
fn the_reader_of_sources_sees_code_and_only_code() {
    let text = "use crate::{sim::World, eval};\n// crate::train\nlet s = \"crate::model \\\" //\"; let r = r#\"crate::cli\"#;\nlet c = '\"'; crate::label::run(); fn f<'a>() {}\n";
    assert_eq!(imports(&blanked(text)), ["sim", "eval", "label"]);
    assert!(names_crate("pub use mcap::Writer;", "mcap") && !names_crate("episode::mcap::x", "mcap"));
    assert!(places("unsafe_code", "unsafe").is_empty() && places("eprintln!()", "println!").is_empty());
}
