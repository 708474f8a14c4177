//! Manifests: what they hold, and what older ones meant.

use super::MadeWith;
use super::manifest::{self, EpisodeEntry, LabelManifest, Manifest, ManifestError, Split};
use crate::object::{Harm, Kind};

/// An entry of an episode that is not there.
pub(super) fn entry(name: &str) -> EpisodeEntry {
    EpisodeEntry {
        name: name.into(),
        file: format!("episodes/{name}.mcap"),
        split: Split::Val,
        seed: 7,
        town: "oldtown".into(),
        weather: "ClearNoon".into(),
        ood: false,
        n_samples: 3,
        n_objects: manifest::ObjectCounts::default(),
        sha256: "00".into(),
    }
}

#[test]
fn manifests_round_trip_and_errors_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let message = Manifest::read(folder.path()).unwrap_err().to_string();
    assert!(message.contains("dataset.json") && message.contains("harmzone gen"), "{message}");
    let mut manifest = Manifest::new("c0ffee".into(), 7, false);
    manifest.episodes.push(entry("a"));
    let made_with = |cpu: &str| MadeWith {
        cpu: cpu.to_owned(),
        ..MadeWith::here("4".into(), "llvmpipe".into(), "glibc".into())
    };
    ["x86_64 avx2", "x86_64", "x86_64 avx2"].iter().for_each(|cpu| manifest.add_made_with(made_with(cpu)));
    assert_eq!(manifest.made_with, [made_with("x86_64"), made_with("x86_64 avx2")]);
    manifest.write(folder.path()).unwrap();
    assert_eq!(Manifest::read(folder.path()).unwrap(), manifest);
    assert_eq!((manifest.of_split(Split::Val).count(), manifest.of_split(Split::Train).count()), (1, 0));

    let mut labels = LabelManifest::new("rect", "width_m = 3.5\n".into(), &manifest);
    labels.counts.ood.get_mut(Kind::Static).add(Harm::Harmful);
    fs_err::create_dir_all(LabelManifest::folder(folder.path(), "rect")).unwrap();
    labels.write(folder.path()).unwrap();
    assert_eq!(LabelManifest::read(folder.path(), "rect").unwrap(), labels);
    assert!(LabelManifest::read(folder.path(), "arc").unwrap_err().to_string().contains("[\"rect\"]"));

    fs_err::rename(LabelManifest::folder(folder.path(), "rect"), LabelManifest::folder(folder.path(), "old"))
        .unwrap();
    let told = LabelManifest::read(folder.path(), "old").unwrap_err().to_string();
    assert!(told.contains("calls itself `rect`") && told.contains("`old`"), "{told}");

    for name in ["", "..", "/a", "a/b", "a/"] {
        let mut other = manifest.clone();
        other.episodes[0].name = name.into();
        let told = other.write(folder.path()).unwrap_err().to_string();
        assert!(told.contains("not that of a file"), "{name}: {told}");
    }
    manifest.episodes[0].file = "../a.mcap".into();
    assert!(manifest.write(folder.path()).unwrap_err().to_string().contains("not inside"));
    fs_err::write(folder.path().join("dataset.json"), "{\"format_version\": 9}").unwrap();
    assert!(matches!(Manifest::read(folder.path()), Err(ManifestError::Version { found: 9, .. })));
}

#[test]
fn unfamiliar_episodes_of_version_1_are_for_development_whatever_they_were_called() {
    let folder = tempfile::tempdir().unwrap();
    let mut manifest = Manifest::new("c0ffee".into(), 7, true);
    for (name, seed, ood, split) in [
        ("made-ood", 5, true, Split::Test),
        ("log-ood", 0, true, Split::Test),
        ("log", 0, false, Split::Test),
        ("made", 6, false, Split::Val),
    ] {
        manifest.episodes.push(EpisodeEntry {
            name: name.into(),
            file: format!("episodes/{name}.mcap"),
            split,
            seed,
            town: "oldtown".into(),
            weather: "ClearNoon".into(),
            ood,
            n_samples: 3,
            n_objects: manifest::ObjectCounts::default(),
            sha256: "00".into(),
        });
    }
    for (version, split) in [(1, Split::Dev), (2, Split::Test)] {
        manifest.format_version = version;
        manifest.write(folder.path()).unwrap();
        let read = Manifest::read(folder.path()).unwrap();
        let splits: Vec<Split> = read.episodes.iter().map(|entry| entry.split).collect();
        assert_eq!(splits, [split, Split::Test, Split::Test, Split::Val], "version {version}");
        assert_eq!(read.format_version, version);
    }
    manifest.episodes.retain(|entry| entry.seed == 5);
    assert_eq!(Split::to_score(&manifest), Split::Test);
    manifest.episodes[0].split = Split::Dev;
    assert_eq!(Split::to_score(&manifest), Split::Dev);
}

#[test]
fn json_of_a_hundred_thousand_levels_is_an_error_that_names_the_path() {
    let folder = tempfile::tempdir().unwrap();
    let set = LabelManifest::folder(folder.path(), "rect");
    fs_err::create_dir_all(&set).unwrap();
    let n_levels = 100_000;
    let lists = "[".repeat(n_levels) + &"]".repeat(n_levels);
    let objects = "{\"town\":".repeat(n_levels) + "0" + &"}".repeat(n_levels);
    for deep in [lists, objects] {
        let in_keys = ["episodes", "config_sha256", "unknown"]
            .map(|key| format!("{{\"format_version\":1,\"{key}\":{deep}}}"));
        for text in in_keys.into_iter().chain([deep]) {
            fs_err::write(folder.path().join(Manifest::FILE), &text).unwrap();
            fs_err::write(set.join(LabelManifest::FILE), &text).unwrap();
            let errors = [
                (Manifest::read(folder.path()).unwrap_err(), "dataset.json"),
                (LabelManifest::read(folder.path(), "rect").unwrap_err(), "rect/labels.json"),
            ];
            for (error, file) in errors {
                assert!(matches!(error, ManifestError::Parse { .. }), "{error}");
                assert!(error.to_string().ends_with(file), "{error}");
            }
        }
    }
    // What is read as any JSON has a bound of its own.
    let deep = "[".repeat(n_levels);
    let told = serde_json::from_str::<serde_json::Value>(&deep).unwrap_err().to_string();
    assert!(told.contains("recursion limit"), "{told}");
}
