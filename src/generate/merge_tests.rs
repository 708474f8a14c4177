//! Merging of made-up shards: what one run makes, or the reason why not.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::folder::CONFIG_FILE;
use super::{CheckedConfig, GenerateConfig, merge, plan};
use crate::config::to_toml;
use crate::episode::manifest::{LabelEntry, ObjectCounts};
use crate::episode::{EpisodeEntry, LabelManifest, Manifest, PartOf, Shard};
use crate::files::sha256_hex;
use crate::progress::Silent;

const N_EPISODES: u32 = 7;

struct Shards {
    root: tempfile::TempDir,
    paths: Vec<PathBuf>,
}

/// Three shards of made-up files, and in `whole` what one run would have left.
fn shards() -> Shards {
    shards_of(&GenerateConfig { seed: 5, ..GenerateConfig::default() })
}

fn shards_of(config: &GenerateConfig) -> Shards {
    let root = tempfile::tempdir().unwrap();
    let toml = to_toml(config);
    let plans = plan(&CheckedConfig::try_from(config).unwrap(), N_EPISODES);
    let write = |folder: &Path, shard: Option<Shard>| {
        let mut manifest = Manifest::new(sha256_hex(toml.as_bytes()), 5, false);
        manifest.part = shard.map(|shard| PartOf { shard, n_episodes: N_EPISODES });
        fs::create_dir_all(folder.join("episodes")).unwrap();
        fs::create_dir_all(folder.join("labels/rect")).unwrap();
        fs::write(folder.join(CONFIG_FILE), &toml).unwrap();
        let mut labels = LabelManifest::new("rect", "width_m = 3.5\n".into(), &manifest);
        for (_, plan) in (0..).zip(&plans).filter(|&(i, _)| shard.is_none_or(|shard| shard.holds(i))) {
            let (bytes, label) = (format!("drive {}", plan.name), format!("labels of {}", plan.name));
            fs::write(folder.join(plan.file()), &bytes).unwrap();
            if config.render.aov {
                let pictures = folder.join("aov").join(&plan.name);
                fs::create_dir_all(&pictures).unwrap();
                let names = (0..4).map(|i| format!("{i:06}.exr")).chain(["objects.json".to_owned()]);
                names.for_each(|name| {
                    fs::write(pictures.join(&name), format!("{} {name}", plan.name)).unwrap();
                });
            }
            let file = format!("{}.mcap", plan.name);
            fs::write(folder.join("labels/rect").join(&file), &label).unwrap();
            let sha256 = sha256_hex(bytes.as_bytes());
            let name = plan.name.clone();
            labels.counts.id.vehicle.harmful += 2;
            labels.episodes.push(LabelEntry {
                name: name.clone(),
                file,
                episode_sha256: sha256.clone(),
                sha256: sha256_hex(label.as_bytes()),
                n_samples: 4,
            });
            manifest.episodes.push(EpisodeEntry {
                name,
                file: plan.file(),
                split: plan.split,
                seed: plan.seed,
                town: plan.town.clone(),
                weather: plan.weather.name().to_owned(),
                ood: false,
                n_samples: 4,
                n_objects: ObjectCounts::default(),
                sha256,
            });
        }
        manifest.write(folder).unwrap();
        labels.write(folder).unwrap();
    };
    let paths: Vec<PathBuf> = (0..3).map(|i| root.path().join(format!("shard_{i}"))).collect();
    for (index, path) in (0..).zip(&paths) {
        write(path, Some(Shard { index, of: 3 }));
    }
    write(&root.path().join("whole"), None);
    Shards { root, paths }
}

fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.file_type().unwrap().is_dir() {
            let below = files(&entry.path());
            let name = PathBuf::from(entry.file_name());
            found.extend(below.into_iter().map(|(path, bytes)| (name.join(path), bytes)));
        } else {
            found.insert(entry.file_name().into(), fs::read(entry.path()).unwrap());
        }
    }
    found
}

fn tell(shards: &[PathBuf], out: &Path) -> String {
    merge(shards, out, &Silent).unwrap_err().to_string()
}

#[test]
fn shards_become_what_one_run_makes_in_any_order_and_again() {
    let Shards { root, mut paths } = shards();
    let out = root.path().join("out");
    paths.reverse();
    for _ in 0..2 {
        let summary = merge(&paths, &out, &Silent).unwrap();
        assert_eq!((summary.n_shards, summary.n_episodes, summary.n_samples), (3, 7, 28));
        assert_eq!(files(&out), files(&root.path().join("whole")));
    }
}

#[test]
fn further_pictures_go_along_and_missing_ones_are_told() {
    let mut config = GenerateConfig { seed: 5, ..GenerateConfig::default() };
    config.render.aov = true;
    let Shards { root, paths } = shards_of(&config);
    let out = root.path().join("out");
    merge(&paths, &out, &Silent).unwrap();
    assert_eq!(files(&out), files(&root.path().join("whole")));
    let gone = Manifest::read(&paths[1]).unwrap().episodes[0].name.clone();
    fs::remove_file(paths[1].join("aov").join(&gone).join("000002.exr")).unwrap();
    let told = tell(&paths, &root.path().join("another"));
    assert!(told.contains("further pictures") && told.contains(&gone), "{told}");
}

#[test]
fn what_is_missing_is_told_with_the_command_that_makes_it() {
    let Shards { root, paths } = shards();
    let out = root.path().join("out");
    let told = tell(&paths[..2], &out);
    assert!(
        told.contains("2 of 7 episodes are missing") && told.contains("--episodes 7 --shard 2/3"),
        "{told}"
    );
    let mut manifest = Manifest::read(&paths[1]).unwrap();
    let gone = manifest.episodes.remove(1).name;
    manifest.write(&paths[1]).unwrap();
    let told = tell(&paths, &out);
    assert!(told.contains(&gone) && told.contains("--shard 1/3 --out"), "{told}");
    assert!(!out.exists());
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let Shards { root, paths } = shards();
    let out = root.path().join("out");
    let told = tell(&[paths[0].clone(), paths[1].clone(), paths[0].clone()], &out);
    assert!(told.contains("shard 0/3 is given twice"), "{told}");
    assert!(tell(&[root.path().join("whole")], &out).contains("a whole data set"));
    // Labels of another zone, of some shards only, a file of other bytes, an episode of elsewhere, another config.
    let mut labels = LabelManifest::read(&paths[1], "rect").unwrap();
    labels.zone_toml = "width_m = 4.0\n".into();
    labels.write(&paths[1]).unwrap();
    assert!(tell(&paths, &out).contains("width_m = 4.0"));
    fs::remove_file(paths[1].join("labels/rect/labels.json")).unwrap();
    assert!(tell(&paths, &out).contains("harmzone label"));
    fs::remove_dir_all(paths[0].join("labels")).unwrap();
    fs::remove_dir_all(paths[2].join("labels")).unwrap();
    let manifest = Manifest::read(&paths[2]).unwrap();
    let torn = paths[2].join(&manifest.episodes[0].file);
    fs::write(&torn, "cut").unwrap();
    assert!(tell(&paths, &out).contains("not as it was written"));
    assert!(!out.join(Manifest::FILE).exists(), "an unfinished merge is no data set");
    fs::write(&torn, format!("drive {}", manifest.episodes[0].name)).unwrap();
    assert!(merge(&paths, &out, &Silent).unwrap().label_sets.is_empty());
    let mut other = manifest.clone();
    other.episodes[0].name = "elsewhere".into();
    other.write(&paths[2]).unwrap();
    assert!(tell(&paths, &out).contains("`elsewhere`"));
    manifest.write(&paths[2]).unwrap();
    fs::write(paths[2].join(CONFIG_FILE), "seed = 6\n").unwrap();
    assert!(tell(&paths, &out).contains("not as it was written"));
    assert!(tell(&paths[..1], &paths[0]).contains("missing"));
}

#[test]
fn the_commands_that_label_name_the_zone_of_the_set() {
    let Shards { root, paths } = shards();
    let out = root.path().join("out");
    for path in &paths {
        let mut labels = LabelManifest::read(path, "rect").unwrap();
        labels.zone_toml = "width_m = 4.0\n".into();
        if *path == paths[1] {
            labels.episodes[0].episode_sha256 = "0".repeat(64);
        }
        labels.write(path).unwrap();
    }
    let command = format!("harmzone label {} --labels rect --set width_m=4.0", paths[1].display());
    assert!(tell(&paths, &out).contains(&format!("{command} --force")));
    fs::remove_file(paths[1].join("labels/rect/labels.json")).unwrap();
    assert!(tell(&paths, &out).ends_with(&command));
}

#[test]
fn a_larger_data_set_of_the_same_config_is_not_cut_to_the_merge() {
    let Shards { root, paths } = shards();
    let out = root.path().join("out");
    merge(&paths, &out, &Silent).unwrap();
    let mut larger = Manifest::read(&out).unwrap();
    let (name, file) = ("one-more".to_owned(), "episodes/one-more.mcap".to_owned());
    larger.episodes.push(EpisodeEntry { name, file, ..larger.episodes[0].clone() });
    larger.write(&out).unwrap();
    let told = tell(&paths, &out);
    assert!(told.contains("of 8 episodes, and this merge has 7") && told.ends_with("out"), "{told}");
    assert_eq!(Manifest::read(&out).unwrap(), larger);
}

#[test]
fn a_folder_with_other_things_is_left_alone() {
    let Shards { root, paths } = shards();
    let out = root.path().join("out");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("thesis.txt"), "words").unwrap();
    assert!(tell(&paths, &out).contains("other things"));
    assert!(tell(&paths, &paths[0]).contains("other things"), "a shard does not become the whole");
    assert_eq!(files(&out).len(), 1);
}
