//! What `harmzone doctor` names: every damage of a data set by the right check, and none on whole ones; and what `--fix` mends.

mod damages;
mod rewrite;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::episode::{EpisodeEntry, EpisodeReader, Manifest};
use harmzone::files::link_or_copy;
use harmzone::label;
use harmzone::progress::Silent;
use harmzone::random::stream;
use harmzone::zone::{ZoneConfig, ZoneKind};
use rand::RngExt as _;

use self::damages::{Damage, KINDS, WARNING};
use self::rewrite::{change_manifest, episode, manifest, rewrite_each};
use super::folder::{copy, hashes, is_mcap};
use super::made_data::{done, fixture, generate, harmzone, text};
use super::{n_faults, skipped};

/// What the doctor says of a data set.
struct Said {
    code: Option<i32>,
    /// The checks that find a fault, and those that warn.
    faults: BTreeSet<String>,
    warnings: BTreeSet<String>,
    /// Whether every check says that all is well, and there is no symptom.
    is_all_well: bool,
    all: String,
}

fn examine(path: &Path) -> Said {
    let output = harmzone(&["doctor", text(path), "--json"]);
    let all = String::from_utf8_lossy(&[output.stdout.clone(), output.stderr].concat()).into_owned();
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let verdicts = json["verdicts"].as_array().cloned().unwrap_or_default();
    let of = |wanted: &str| -> BTreeSet<String> {
        let is_wanted = verdicts.iter().filter(|verdict| verdict["verdict"] == wanted);
        is_wanted.map(|verdict| verdict["check"].as_str().unwrap_or_default().to_owned()).collect()
    };
    let has_no_symptom = json["symptoms"].as_array().is_some_and(Vec::is_empty);
    Said {
        code: output.status.code(),
        faults: of("fault"),
        warnings: of("warning"),
        is_all_well: has_no_symptom && !verdicts.is_empty() && of("ok").len() == verdicts.len(),
        all,
    }
}

/// Damages so many copies of a whole data set, kind by kind; prints a table and returns what was not named.
fn damage(n_damages: usize) -> Vec<String> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let mut rows: Vec<(&Damage, usize, usize)> = KINDS.iter().map(|kind| (kind, 0, 0)).collect();
    let mut silent = Vec::new();
    for i in 0..n_damages {
        let (kind, n, n_named) = &mut rows[i % KINDS.len()];
        let (name, check, damage) = **kind;
        let path = home.path().join(i.to_string());
        copy(&fixture().id, &path);
        damage(&path, (i / KINDS.len()) as u64);
        let said = examine(&path);
        let code = if said.faults.is_empty() { 0 } else { 3 };
        let by = if WARNING.contains(&check) { &said.warnings } else { &said.faults };
        let is_named = said.code == Some(code) && by.contains(check);
        *n += 1;
        *n_named += usize::from(is_named);
        if !is_named {
            silent.push(format!(
                "{name}, {i}: exit {:?}, {:?} and {:?} in place of {check}\n{}",
                said.code, said.faults, said.warnings, said.all
            ));
        }
        fs::remove_dir_all(&path).expect("a writable folder");
    }
    println!("{:<38} {:<10} {:>3} {:>6}", "damage", "check", "n", "named");
    for ((name, check, _), n, n_named) in &rows {
        println!("{name:<38} {check:<10} {n:>3} {n_named:>6}");
    }
    silent
}

/// A data set of some of another's episodes, with labels by a zone under a name.
fn part_of(from: &Path, to: &Path, is_kept: impl Fn(usize) -> bool, zone: ZoneKind) {
    let mut whole = manifest(from);
    let entries = std::mem::take(&mut whole.episodes).into_iter().enumerate();
    whole.episodes =
        entries.filter(|(i, _)| is_kept(*i)).map(|(_, entry)| entry).collect::<Vec<EpisodeEntry>>();
    for file in whole.episodes.iter().map(|entry| entry.file.as_str()).chain(["gen.toml"]) {
        link_or_copy(&from.join(file), &to.join(file)).expect("a writable folder");
    }
    whole.write(to).expect("a writable folder");
    let config = ZoneConfig { kind: zone, ..ZoneConfig::default() };
    label::run(to, &config, zone.name(), false, &Silent).expect("episodes that can be labelled");
}

/// Examines so many whole data sets, parts of these in turn; prints a line and returns what is said of them.
fn examine_whole(sources: &[PathBuf], n_sets: usize) -> Vec<String> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let mut wrong = Vec::new();
    for i in 0..n_sets {
        let (source, path) = (&sources[i % sources.len()], home.path().join(i.to_string()));
        let mut rng = stream(i as u64, "whole", 0);
        let first = i % manifest(source).episodes.len();
        let others = rng.random::<u64>();
        let zone = ZoneKind::ALL[i % ZoneKind::ALL.len()];
        part_of(source, &path, |k| k == first || others >> (k % 64) & 1 == 1, zone);
        let reader = EpisodeReader::open(&episode(&path, i)).expect("a whole episode");
        if i % 5 == 4 && reader.cameras().is_empty() {
            // Written again as it is, without labels.
            rewrite_each(&path, i, |_| ());
        }
        let said = examine(&path);
        if said.code != Some(0) || !said.is_all_well {
            wrong.push(format!(
                "{} of {}: exit {:?}\n{}",
                path.display(),
                source.display(),
                said.code,
                said.all
            ));
        }
        fs::remove_dir_all(&path).expect("a writable folder");
    }
    println!("{n_sets} whole data sets: {} with a fault or a warning", wrong.len());
    wrong
}

fn assert_none(wrong: &[String]) {
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong[..wrong.len().min(5)].join("\n"));
}

#[test]
fn every_kind_of_damage_is_named() {
    assert_none(&damage(KINDS.len()));
}

#[test]
fn nothing_is_said_of_whole_sets() {
    assert_none(&examine_whole(&[fixture().id.clone(), fixture().ood.clone()], 5));
}

#[test]
#[ignore = "minutes: make soak ROWS=doctor"]
fn long_doctor() {
    let n = n_faults(100);
    let home = tempfile::tempdir().expect("a temporary folder");
    let made = |name: &str, more: &[&str]| {
        let path = home.path().join(name);
        let words = [
            "gen",
            "--town",
            "all",
            "--weather",
            "all",
            "--seed",
            "21",
            "--samples",
            "3",
            "--episodes",
            "12",
        ];
        done(&[words.as_slice(), &["--out", text(&path)], more].concat());
        path
    };
    let sources = [made("id", &[]), made("ood", &["--ood"]), made("surround", &["--rig", "surround"])];
    assert_none(&[damage(n), examine_whole(&sources, n)].concat());
}

/// What the doctor prints with `--fix`, and its exit code.
fn mend(path: &Path) -> (String, Option<i32>) {
    let output = harmzone(&["doctor", text(path), "--fix"]);
    (String::from_utf8_lossy(&output.stdout).into_owned(), output.status.code())
}

#[test]
fn what_is_mended_is_whole_and_gen_makes_again_what_was_set_aside() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let path = home.path().join("set");
    copy(&fixture().id, &path);
    let whole = manifest(&path);
    let torn = episode(&path, 0);
    fs::write(&torn, b"torn").expect("a writable copy");
    fs::write(path.join("episodes/left.mcap.7.partial"), b"").expect("a writable copy");
    fs::remove_file(path.join(Manifest::FILE)).expect("a writable copy");
    let (told, code) = mend(&path);
    assert!(
        told.contains("mended  made dataset.json anew") && told.contains("left.mcap.7.partial"),
        "{told}"
    );
    assert_eq!(code, Some(0), "{told}");
    let kept = manifest(&path).episodes;
    assert_eq!(kept, whole.episodes[1..]);
    assert_eq!(examine(&path).code, Some(0));
    let name = torn.file_name().expect("a file");
    assert_eq!(fs::read(path.join("set_aside").join(name)).expect("it was kept"), b"torn");
    generate(&path, "2", &["--episodes", "2"]);
    assert_eq!(manifest(&path), whole);
    let said = examine(&path);
    assert_eq!(said.code, Some(0), "{}", said.all);
}

#[test]
fn facts_of_entries_and_the_config_are_mended_and_another_folder_is_left_alone() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let path = home.path().join("set");
    copy(&fixture().id, &path);
    let whole = manifest(&path);
    let config = fs::read(path.join("gen.toml")).expect("a config");
    change_manifest(&path, |of| of.episodes[1].town = "elsewhere".to_owned());
    fs::write(path.join("gen.toml"), b"seed = 99\n").expect("a writable copy");
    assert_eq!(examine(&path).code, Some(3));
    let (told, code) = mend(&path);
    assert_eq!(code, Some(0), "{told}");
    assert_eq!((manifest(&path), fs::read(path.join("gen.toml")).expect("a config")), (whole, config));
    let none = home.path().join("none");
    assert_eq!((mend(&none).1, none.exists()), (Some(1), false));
    let url = harmzone(&["doctor", "s3://bucket/set", "--fix"]);
    let said = String::from_utf8_lossy(&url.stderr).into_owned();
    assert!(url.status.code() == Some(1) && said.contains("--fix mends"), "{said}");
}

#[test]
fn every_file_of_a_data_set_passes_the_mcap_programs_own_doctor() {
    let examine = |file: &Path| std::process::Command::new("mcap").arg("doctor").arg(file).output();
    let folder = &fixture().id;
    for name in hashes(folder).into_keys().filter(|name| is_mcap(name)) {
        let Ok(output) = examine(&folder.join(&name)) else {
            skipped("no program `mcap` in PATH (https://mcap.dev/guides/cli)");
            return;
        };
        let told = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        assert!(output.status.success(), "{name}: {told}");
    }
}
