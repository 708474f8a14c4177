//! The sources of the project as tokens: what each file names, with `use` trees spelled out and re-exports followed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use fs_err as fs;
use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};

/// A path in code, such as `["crate", "zone", "Zone"]`.
pub type Words = Vec<String>;

/// One Rust file.
pub struct Source {
    /// From the repository's root, with `/`.
    pub name: String,
    pub raw: String,
    /// What it names outside of `#[cfg(test)]`.
    pub product: Code,
}

impl Source {
    pub fn new(name: &str, raw: &str) -> Self {
        let stream: TokenStream = raw.parse().unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut tokens = Vec::new();
        flatten(stream, &mut tokens);
        Self { name: name.to_owned(), raw: raw.to_owned(), product: Code::of(tokens) }
    }

    pub fn is_under(&self, prefixes: &[&str]) -> bool {
        prefixes.iter().any(|prefix| self.name.starts_with(prefix))
    }

    /// Where the file's module stands in its crate: `["model", "head"]`; none for the root.
    pub fn module(&self) -> Words {
        let inside = self.name.split_once("src/").map_or(self.name.as_str(), |(_, inside)| inside);
        let path = inside.trim_end_matches(".rs");
        let path = path.strip_suffix("/mod").unwrap_or(path);
        path.split('/').filter(|part| !["lib", "main"].contains(part)).map(str::to_owned).collect()
    }
}

/// What some tokens name.
pub struct Code {
    /// Identifiers and punctuation in order; literals are left out.
    pub tokens: Vec<String>,
    /// Paths of two names or more outside `use`, and all that `use` brings in.
    pub paths: Vec<Words>,
    /// Name that a `pub use` gives, and the path behind it.
    reexports: Vec<(String, Words)>,
}

impl Code {
    fn of(tokens: Vec<String>) -> Self {
        let mut code = Self { tokens: Vec::new(), paths: Vec::new(), reexports: Vec::new() };
        let mut at = 0;
        while at < tokens.len() {
            if tokens[at] == "use" {
                let is_public = at > 0 && (tokens[at - 1] == "pub" || tokens[at - 1] == ")");
                let mut found = Vec::new();
                at = read_use(&tokens, at + 1, &Vec::new(), &mut found);
                found.retain(|(_, path)| !path.is_empty()); // `impl Trait + use<'a>` names nothing
                if is_public {
                    code.reexports.extend(found);
                } else {
                    code.paths.extend(found.into_iter().map(|(_, path)| path));
                }
            } else if is_name(&tokens[at]) && (at == 0 || !["::", "."].contains(&tokens[at - 1].as_str())) {
                let mut path = vec![tokens[at].clone()];
                while tokens.get(at + 1).is_some_and(|next| next == "::")
                    && tokens.get(at + 2).is_some_and(|next| is_name(next))
                {
                    path.push(tokens[at + 2].clone());
                    at += 2;
                }
                if path.len() > 1 {
                    code.paths.push(path);
                }
                at += 1;
            } else {
                at += 1;
            }
        }
        Self { tokens, ..code }
    }

    /// Whether a path begins so: `std::fs`, `clap`; re-exports count.
    pub fn names(&self, path: &str) -> bool {
        let words: Vec<&str> = path.split("::").collect();
        let begins =
            |found: &Words| found.len() >= words.len() && found.iter().zip(&words).all(|(a, b)| a == b);
        self.paths.iter().chain(self.reexports.iter().map(|(_, path)| path)).any(begins)
    }

    /// Whether these tokens follow each other somewhere.
    pub fn holds(&self, tokens: &[&str]) -> bool {
        self.tokens.windows(tokens.len()).any(|window| window == tokens)
    }

    /// Structs, enums and traits that are `pub` without limits.
    pub fn public_types(&self) -> impl Iterator<Item = &str> {
        let is_type = |word: &str| ["struct", "enum", "trait"].contains(&word);
        let types = self
            .tokens
            .windows(3)
            .filter(move |found| found[0] == "pub" && is_type(&found[1]) && is_name(&found[2]));
        types.map(|found| found[2].as_str())
    }
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Reads a `use` tree from its first token on, to the token after it.
fn read_use(tokens: &[String], mut at: usize, before: &Words, found: &mut Vec<(String, Words)>) -> usize {
    let mut path = before.clone();
    loop {
        match tokens.get(at).map(String::as_str) {
            Some("::") => at += 1,
            Some("{") => {
                at += 1;
                while tokens[at] != "}" {
                    at = read_use(tokens, at, &path, found);
                    at += usize::from(tokens[at] == ",");
                }
                return at + 1;
            }
            Some("as") => {
                found.push((tokens[at + 1].clone(), path));
                return at + 2;
            }
            Some("self") if !path.is_empty() => at += 1,
            Some(word) if is_name(word) || word == "*" => {
                path.push(word.to_owned());
                at += 1;
            }
            _ => {
                found.push((path.last().cloned().unwrap_or_default(), path));
                return at;
            }
        }
    }
}

/// Adds the tokens in order, but for what stands under `#[cfg(test)]`.
fn flatten(stream: TokenStream, out: &mut Vec<String>) {
    let trees: Vec<TokenTree> = stream.into_iter().collect();
    let mut at = 0;
    while at < trees.len() {
        if is_test_attribute(&trees[at..]) {
            at = end_of_item(&trees, at + 2);
            continue;
        }
        match &trees[at] {
            TokenTree::Ident(ident) => out.push(ident.to_string().trim_start_matches("r#").to_owned()),
            TokenTree::Literal(_) => out.push("\"\"".to_owned()),
            TokenTree::Punct(punct) => {
                let is_colons = |tree: &TokenTree| matches!(tree, TokenTree::Punct(p) if p.as_char() == ':');
                let joins = punct.as_char() == ':' && punct.spacing() == Spacing::Joint;
                if joins && trees.get(at + 1).is_some_and(is_colons) {
                    out.push("::".to_owned());
                    at += 1;
                } else {
                    out.push(punct.as_char().to_string());
                }
            }
            TokenTree::Group(group) => {
                let (open, close) = match group.delimiter() {
                    Delimiter::Brace => ("{", "}"),
                    Delimiter::Bracket => ("[", "]"),
                    Delimiter::Parenthesis | Delimiter::None => ("(", ")"),
                };
                out.push(open.to_owned());
                flatten(group.stream(), out);
                out.push(close.to_owned());
            }
        }
        at += 1;
    }
}

fn is_test_attribute(trees: &[TokenTree]) -> bool {
    matches!(trees, [TokenTree::Punct(hash), TokenTree::Group(group), ..]
        if hash.as_char() == '#' && group.stream().to_string().replace(' ', "") == "cfg(test)")
}

/// Index after the item that begins at `at`: after its braces or its semicolon.
fn end_of_item(trees: &[TokenTree], mut at: usize) -> usize {
    let is_semicolon = |tree: &TokenTree| matches!(tree, TokenTree::Punct(p) if p.as_char() == ';');
    let is_braces =
        |tree: &TokenTree| matches!(tree, TokenTree::Group(g) if g.delimiter() == Delimiter::Brace);
    while at < trees.len() && !is_semicolon(&trees[at]) && !is_braces(&trees[at]) {
        at += 1;
    }
    // Both, for `use a::{b, c};`.
    at += 1;
    at + usize::from(trees.get(at).is_some_and(is_semicolon))
}

/// Files below a folder of the repository with an extension, sorted; not what cargo has made there, as `make miri` lets it.
pub fn files(folder: &str, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("the repository's folders are there") {
            let path = entry.expect("a folder can be listed").path();
            if path.is_dir() {
                folders.extend(Some(path).filter(|path| !path.ends_with("target")));
            } else if path.extension().is_some_and(|found| found == extension) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The path from the repository's root.
pub fn name_of(path: &Path) -> String {
    let name = path.strip_prefix(env!("CARGO_MANIFEST_DIR")).expect("found in the repository");
    name.display().to_string()
}

pub fn sources(folder: &str) -> Vec<Source> {
    let read =
        |path: PathBuf| Source::new(&name_of(&path), &fs::read_to_string(&path).expect("a source is UTF-8"));
    files(folder, "rs").into_iter().map(read).collect()
}

/// Which file of a crate names which: whoever re-exports is passed over, for the file that defines.
pub struct Graph {
    edges: BTreeMap<String, BTreeSet<String>>,
}

impl Graph {
    pub fn of(sources: &[Source]) -> Self {
        let modules: BTreeMap<Words, &Source> = sources
            .iter()
            .filter(|source| source.name != "src/main.rs")
            .map(|source| (source.module(), source))
            .collect();
        let mut reexports: BTreeMap<Words, Words> = BTreeMap::new();
        for (module, source) in &modules {
            for (name, path) in &source.product.reexports {
                if let Some(path) = absolute(module, path, &modules) {
                    reexports.insert([module.as_slice(), std::slice::from_ref(name)].concat(), path);
                }
            }
        }
        let edges = modules.iter().map(|(module, source)| {
            let paths = source.product.paths.iter().filter_map(|path| absolute(module, path, &modules));
            let found = paths.filter_map(|path| resolve(path, &modules, &reexports));
            (source.name.clone(), found.filter(|name| *name != source.name).collect())
        });
        Self { edges: edges.collect() }
    }

    /// The files that a file names, by way of others or not, each with the file that led there.
    pub fn reached_from(&self, name: &str) -> BTreeMap<&str, &str> {
        let mut reached = BTreeMap::new();
        let mut open: Vec<&str> =
            self.edges.get_key_value(name).map(|(name, _)| name.as_str()).into_iter().collect();
        while let Some(from) = open.pop() {
            for to in self.edges.get(from).into_iter().flatten() {
                if !reached.contains_key(to.as_str()) {
                    reached.insert(to.as_str(), from);
                    open.push(to);
                }
            }
        }
        reached
    }

    /// The same graph without the way from a module to its own submodules, which are part of it.
    pub fn without_own_parts(mut self) -> Self {
        for (from, to) in &mut self.edges {
            if let Some(folder) = from.strip_suffix("mod.rs").or(from.strip_suffix(".rs")) {
                to.retain(|to| !to.starts_with(folder));
            }
        }
        self
    }

    /// Each pair of files in which the first names the second, and the second leads back to the first.
    pub fn circles(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (from, to) in &self.edges {
            let back = to.iter().filter(|to| self.reached_from(to).contains_key(from.as_str()));
            found.extend(back.map(|to| format!("{from} names {to}, which leads back")));
        }
        found
    }
}

/// The path from the crate's root, if it is one of this crate.
fn absolute(module: &Words, path: &Words, modules: &BTreeMap<Words, &Source>) -> Option<Words> {
    let n_climbs = path.iter().take_while(|word| *word == "super").count();
    match path[0].as_str() {
        "crate" => Some(path[1..].to_vec()),
        "self" => Some([module.as_slice(), &path[1..]].concat()),
        "super" => Some([&module[..module.len().checked_sub(n_climbs)?], &path[n_climbs..]].concat()),
        child => {
            let inside = [module.as_slice(), &[child.to_owned()]].concat();
            modules.contains_key(&inside).then(|| [module.as_slice(), path].concat())
        }
    }
}

/// The file that defines what a path names.
fn resolve(
    path: Words,
    modules: &BTreeMap<Words, &Source>,
    reexports: &BTreeMap<Words, Words>,
) -> Option<String> {
    let mut path = path;
    // A chain of re-exports is short; one that leads to itself ends here.
    for _ in 0..8 {
        let n_known = (0..=path.len()).rev().find(|&n| modules.contains_key(&path[..n]))?;
        let behind = path.get(..=n_known).and_then(|name| reexports.get(name));
        match behind {
            Some(behind) => path = [behind.as_slice(), &path[n_known + 1..]].concat(),
            None => return Some(modules[&path[..n_known]].name.clone()),
        }
    }
    None
}
