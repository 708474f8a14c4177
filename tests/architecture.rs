//! The shape of the code: who may import whom, what may appear where, and how files and types are named.
//!
//! Reads the sources as tokens. A rule that a file must break is changed here, in the table, with its reason.

mod source_tree;

use std::collections::BTreeMap;

use source_tree::{Graph, Source, files, name_of, sources};

/// Each top module and its layer; a module imports only from lower numbers.
const LAYERS: &[(&str, u32)] = &[
    ("geometry", 0),
    ("config", 0),
    ("device", 0),
    ("files", 0),
    ("interrupt", 0),
    ("progress", 0),
    ("random", 0),
    ("history", 1),
    ("meshes", 1),
    ("store", 2),
    ("text_table", 0),
    ("worker", 1),
    ("object", 1),
    ("sample", 2), // above `object`: a sample holds objects
    ("nuscenes", 2),
    ("rays", 2),
    ("zone", 3),
    ("scene", 3),
    ("sensors", 3),
    ("sim", 4),
    ("episode", 4),
    ("generate", 5),
    ("import", 5),
    ("label", 5),
    ("dataset", 6),
    ("export", 6),
    ("kernels", 6),
    ("model", 7),
    ("compare", 7),
    ("eval", 7),
    ("infer", 8),
    ("outcome", 8),
    ("drive", 9),
    ("exchange", 9),
    ("train", 9),
    ("report", 10),
    ("serve", 11), // above `report`: it shows its tables
    ("cli", 12),
    ("python", 13),
];

/// Words that may appear only in files under the given prefixes, and why.
const CONFINED: [(&[&str], &[&str], &str); 6] = [
    (
        &["clap", "anyhow"],
        &["src/cli/", "src/main.rs", "xtask/"],
        "the library has typed errors and no flags",
    ),
    (
        &["println!", "eprintln!", "print!", "eprint!", "dbg!"],
        &[],
        "the library returns what it has to say, or tells it through `Progress`; commands use `cli::print`",
    ),
    (
        &["pyo3", "numpy"],
        &["src/sim/", "src/python/", "xtask/src/bench_gen/replay.rs"],
        "only the simulator and the wheel talk to Python",
    ),
    (&["mcap"], &["src/episode/"], "episodes are read and written in one place"),
    (&["unsafe"], &["src/kernels/"], "only measured kernels may be unsafe"),
    (&["std::fs"], &[], "fs_err names the path in its errors"),
];
/// Files that touch neither disk, clock nor environment; exceptions after.
const PURE: [&str; 9] = [
    "src/geometry/",
    "src/object.rs",
    "src/sample.rs",
    "src/sensors/",
    "src/model/",
    "src/eval/matching",
    "src/eval/metrics",
    "src/eval/pairing",
    "src/zone/",
];
/// The last is for tests alone.
const IMPURE: [&str; 3] = ["src/model/checkpoint", "src/model/image_weights", "src/model/golden"];
const IO_PATHS: [&str; 6] = ["fs_err", "std::fs", "std::net", "std::process", "std::env", "std::time"];
const IO_NAMES: [&str; 2] = ["write_atomic", "SystemTime"];

/// Modules that score, judge and report boxes of any detector: no network and no simulator behind them.
const LIGHT: [&str; 5] = ["src/compare/", "src/eval/", "src/zone/", "src/outcome/", "src/report/"];
const HEAVY: [&str; 3] = ["burn", "pyo3", "numpy"];

const VAGUE_NAMES: [&str; 8] =
    ["util", "utils", "common", "helper", "helpers", "manager", "managers", "misc"];

const MOST_LINES: usize = 400;

/// Types that may have the same name in two files, and why.
const NAMED_TWICE: [(&str, &str); 3] = [
    ("Axis", "of a breakdown, and of a chart: both are the field's word"),
    ("Group", "of a breakdown, and of a data set's statistics; each is private to its room's tables"),
    ("Series", "of a sweep, and of a chart that draws it"),
];

fn library() -> Vec<Source> {
    sources("src")
}

fn library_and_xtask() -> Vec<Source> {
    library().into_iter().chain(sources("xtask/src")).collect()
}

fn top_module(source: &Source) -> String {
    source.module().into_iter().next().unwrap_or_default()
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
    for source in library().iter().filter(|source| !source.module().is_empty()) {
        let (own, name) = (top_module(source), &source.name);
        let Some(own_layer) = layer(&own) else {
            broken.push(format!("{name}: `{own}` has no layer; give it one in LAYERS"));
            continue;
        };
        let imports =
            source.product.paths.iter().filter(|path| path[0] == "crate").filter_map(|path| path.get(1));
        for import in imports.filter(|import| **import != own) {
            // Names that are no module, such as a macro of the crate, have no layer.
            if let Some(their_layer) = layer(import).filter(|&theirs| theirs >= own_layer) {
                broken.push(format!(
                    "{name}: `{own}` (layer {own_layer}) imports `{import}` (layer {their_layer})"
                ));
            }
        }
        if source.product.names("super::super") {
            broken.push(format!("{name}: climb with `crate::`, not `super::super::`"));
        }
    }
    assert_none(&broken);
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let circles =
        [library(), sources("xtask/src")].map(|sources| Graph::of(&sources).without_own_parts().circles());
    assert_none(&circles.concat());
}

#[test]
fn scores_zones_and_reports_need_neither_network_nor_simulator() {
    let all = library();
    let graph = Graph::of(&all);
    let heavy: BTreeMap<&str, &str> = all
        .iter()
        .filter_map(|source| {
            let found = HEAVY.iter().find(|word| source.product.names(word))?;
            Some((source.name.as_str(), *found))
        })
        .collect();
    let mut broken = Vec::new();
    for source in all.iter().filter(|source| source.is_under(&LIGHT)) {
        if let Some(word) = heavy.get(source.name.as_str()) {
            broken.push(format!("{}: names {word}", source.name));
        }
        let reached = graph.reached_from(&source.name);
        let far = reached.iter().find_map(|(reached, by)| Some((reached, by, heavy.get(reached)?)));
        if let Some((reached, by, word)) = far {
            broken.push(format!("{}: reaches {reached}, which names {word}, through {by}", source.name));
        }
    }
    assert_none(&broken);
}

#[test]
fn the_program_only_calls_the_command_line() {
    let main = library().into_iter().find(|source| source.name == "src/main.rs").expect("there is a main.rs");
    let calls: Vec<String> =
        main.product.paths.iter().filter(|path| path[0] == "harmzone").map(|path| path[1].clone()).collect();
    assert!(!calls.is_empty() && calls.iter().all(|call| call == "cli"), "{calls:?}");
}

#[test]
fn every_file_opens_by_saying_what_it_is() {
    let more = ["tests", "benches", "examples", "xtask/tests"].map(sources);
    let all = library_and_xtask().into_iter().chain(more.into_iter().flatten());
    let silent = all.filter(|source| !source.raw.starts_with("//! "));
    let broken: Vec<String> =
        silent.map(|source| format!("{}: the first line is not `//! ..`", source.name)).collect();
    assert_none(&broken);
}

#[test]
fn crates_printing_and_unsafe_stay_where_they_belong() {
    let mut broken = Vec::new();
    for source in library_and_xtask() {
        for (words, homes, reason) in CONFINED.iter().filter(|(_, homes, _)| !source.is_under(homes)) {
            for word in *words {
                let code = &source.product;
                let is_found = match word.strip_suffix('!') {
                    Some(call) => code.holds(&[call, "!"]),
                    None => code.names(word) || *word == "unsafe" && code.holds(&[word]),
                };
                if is_found {
                    broken.push(format!("{}: `{word}` belongs in {homes:?}: {reason}", source.name));
                }
            }
        }
    }
    assert_none(&broken);
}

#[test]
fn rules_and_tensors_touch_neither_disk_nor_clock() {
    let mut broken = Vec::new();
    for source in library().iter().filter(|source| source.is_under(&PURE) && !source.is_under(&IMPURE)) {
        let paths = IO_PATHS.iter().filter(|path| source.product.names(path));
        let names = IO_NAMES.iter().filter(|name| source.product.holds(&[name]));
        broken.extend(
            paths.chain(names).map(|word| format!("{}: `{word}` in a file that does no IO", source.name)),
        );
    }
    assert_none(&broken);
}

#[test]
fn the_network_never_sees_the_truth() {
    let mut broken = Vec::new();
    for source in library().iter().filter(|source| source.is_under(&["src/model/"])) {
        for word in ["Truth", "Object", "LabelledObject"] {
            if source.product.holds(&[word]) {
                broken.push(format!("{}: `{word}`; inputs are built from `&Measured`", source.name));
            }
        }
    }
    assert_none(&broken);
}

#[test]
fn no_module_has_a_vague_name() {
    let is_vague = |source: &Source| source.name.split(['/', '.']).any(|part| VAGUE_NAMES.contains(&part));
    let all = library_and_xtask().into_iter().chain(sources("tests"));
    let broken: Vec<String> = all
        .filter(is_vague)
        .map(|source| format!("{}: name the file after its one idea", source.name))
        .collect();
    assert_none(&broken);
}

#[test]
fn no_file_is_longer_than_a_reader_can_hold() {
    let rust = ["src", "xtask", "tests", "examples", "benches"].map(|folder| files(folder, "rs"));
    let python = ["python", "xtask"].map(|folder| files(folder, "py"));
    let mut broken = Vec::new();
    for path in rust.into_iter().chain(python).flatten() {
        let n_lines = fs_err::read_to_string(&path).expect("a source is UTF-8").lines().count();
        if n_lines > MOST_LINES {
            broken.push(format!("{}: {n_lines} lines, at most {MOST_LINES}", name_of(&path)));
        }
    }
    assert_none(&broken);
}

#[test]
fn a_types_name_occurs_once() {
    let mut files_of: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for source in library() {
        for name in source.product.public_types() {
            files_of.entry(name.to_owned()).or_default().push(source.name.clone());
        }
    }
    let is_allowed = |name: &str| NAMED_TWICE.iter().any(|(allowed, _)| *allowed == name);
    let twice = files_of.iter().filter(|(name, files)| files.len() > 1 && !is_allowed(name));
    assert_none(&twice.map(|(name, files)| format!("`{name}` in {}", files.join(", "))).collect::<Vec<_>>());
}

fn of(name: &str, text: &str) -> Source {
    Source::new(name, text)
}

#[test]
fn the_reader_of_sources_sees_code_and_only_code() {
    let source = of(
        "src/a.rs",
        "use crate::{sim::World, eval::{self, json as j}};\n// crate::train\nlet s = \"crate::model \\\" //\";\n\
         let r = r#\"crate::cli\"#; let c = '\"'; crate::label::run(); fn f<'a>() {} vec![super::x::Y];\n\
         #[cfg(test)] use crate::{kernels, train}; #[cfg(test)] mod tests { use crate::report::page; }",
    );
    let told = |code: &source_tree::Code| code.paths.iter().map(|path| path.join("::")).collect::<Vec<_>>();
    let product =
        ["crate::sim::World", "crate::eval", "crate::eval::json", "crate::label::run", "super::x::Y"];
    assert_eq!(told(&source.product), product);
    assert!(source.product.names("crate::eval") && !source.product.names("eval"));
    let source =
        of("src/a.rs", "pub use mcap::Writer; #[allow(unsafe_code)] pub struct A; pub(super) struct B;");
    assert!(source.product.names("mcap") && !source.product.holds(&["unsafe"]));
    assert_eq!(source.product.public_types().collect::<Vec<_>>(), ["A"]);
}

#[test]
fn a_circle_is_found_through_re_exports_and_only_there() {
    let graph = |b: &str| {
        Graph::of(&[
            of("src/lib.rs", "pub mod room;"),
            of("src/room/mod.rs", "mod a; mod b; mod c; pub use a::A; pub use b::B;"),
            of("src/room/a.rs", "use super::B; pub struct A;"),
            of("src/room/b.rs", b),
            of("src/room/c.rs", "use super::{A, B};"),
        ])
    };
    assert!(graph("pub struct B;").circles().is_empty());
    let told = graph("pub struct B(crate::room::A);").circles();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[0].contains("src/room/a.rs names src/room/b.rs"), "{told:?}");
    let reached = graph("pub struct B;");
    assert!(reached.reached_from("src/room/c.rs").keys().eq(["src/room/a.rs", "src/room/b.rs"].iter()));
}
