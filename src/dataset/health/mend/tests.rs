//! Made-up data sets that are damaged and mended.

use super::*;
use crate::dataset::health::{Severity, examine, made};
use crate::progress::Silent;

fn n_faults(path: &Path) -> usize {
    examine(path, &Silent).unwrap().count(Severity::Fault)
}

#[test]
fn what_is_torn_is_set_aside_and_the_rest_stays_a_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let before = made::write(path, 3);
    fs::write(path.join(&before.episodes[1].file), "torn").unwrap();
    fs::write(path.join("episodes/x.mcap.partial"), "").unwrap();
    assert!(n_faults(path) > 0);
    let done = mend(path, &Silent).unwrap();
    assert_eq!(done.len(), 3, "{done:?}");
    let kept = fs::read_to_string(path.join(SET_ASIDE).join(Manifest::FILE)).unwrap();
    assert!(kept.contains(&before.episodes[1].name));
    let after = Manifest::read(path).unwrap();
    assert_eq!(after.episodes, [before.episodes[0].clone(), before.episodes[2].clone()]);
    assert_eq!(n_faults(path), 0);
    let aside = path.join(SET_ASIDE).join(format!("{}.mcap", before.episodes[1].name));
    assert_eq!(fs::read_to_string(aside).unwrap(), "torn");
    assert_eq!(mend(path, &Silent).unwrap(), [""; 0]);
}

#[test]
fn a_lost_manifest_an_entry_and_a_config_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let whole = made::write(path, 3);
    fs::write(path.join(Manifest::FILE), "{}").unwrap();
    assert_eq!(mend(path, &Silent).unwrap().len(), 2);
    assert_eq!(Manifest::read(path).unwrap(), whole);
    let mut other = whole.clone();
    other.episodes[0].town = "oldtown".into();
    other.episodes.remove(2);
    other.write(path).unwrap();
    fs::write(path.join("gen.toml"), "samples = 7\n").unwrap();
    let done = mend(path, &Silent).unwrap();
    assert_eq!(Manifest::read(path).unwrap(), whole, "{done:?}");
    assert_eq!(n_faults(path), 0);
}

#[test]
fn episodes_that_are_elsewhere_and_a_config_of_others_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let whole = made::write(path, 3);
    fs::rename(path.join("episodes"), path.join("away")).unwrap();
    assert_eq!(mend(path, &Silent).unwrap(), [""; 0]);
    fs::rename(path.join("away"), path.join("episodes")).unwrap();
    assert_eq!((Manifest::read(path).unwrap(), n_faults(path)), (whole.clone(), 0));
    let config = fs::read_to_string(path.join("gen.toml")).unwrap();
    fs::write(path.join("gen.toml"), config.replacen("seed = ", "seed = 1", 1)).unwrap();
    fs::remove_file(path.join(Manifest::FILE)).unwrap();
    assert_eq!(mend(path, &Silent).unwrap(), [""; 0]);
    assert!(whole.episodes.iter().all(|entry| path.join(&entry.file).is_file()));
    fs::write(path.join("gen.toml"), config).unwrap();
    mend(path, &Silent).unwrap();
    assert_eq!(Manifest::read(path).unwrap(), whole);
}

#[test]
fn the_config_of_a_users_map_is_missed_and_written_again_while_the_map_is_what_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let map = path.join("mine.xodr");
    fs::write(&map, "roads").unwrap();
    made::write_of(path, 2, vec![map.display().to_string()]);
    let config = fs::read_to_string(path.join("gen.toml")).unwrap();
    assert!(config.contains("mine.xodr: SHA-256") && n_faults(path) == 0);
    fs::remove_file(path.join("gen.toml")).unwrap();
    assert_eq!(n_faults(path), 1);
    fs::write(&map, "other roads").unwrap();
    assert_eq!(mend(path, &Silent).unwrap(), [""; 0]);
    fs::write(&map, "roads").unwrap();
    mend(path, &Silent).unwrap();
    assert_eq!((fs::read_to_string(path.join("gen.toml")).unwrap(), n_faults(path)), (config, 0));
    // Recorded drives have none.
    fs::remove_file(path.join("gen.toml")).unwrap();
    fs::create_dir(path.join("outcomes")).unwrap();
    fs::write(path.join("outcomes/a.json"), "{}").unwrap();
    assert_eq!(n_faults(path), 0);
}

#[test]
fn pictures_that_a_run_left_unfinished_are_deleted_and_whole_ones_stay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    made::write(path, 1);
    fs::create_dir_all(path.join("aov/whole")).unwrap();
    fs::create_dir_all(path.join("aov/left.partial/cam_back")).unwrap();
    fs::write(path.join("aov/left.partial/000000.exr"), "half").unwrap();
    assert_eq!(examine(path, &Silent).unwrap().symptoms[0].first_at, "left.partial");
    let done = mend(path, &Silent).unwrap();
    assert!(done.len() == 1 && done[0].contains("left.partial"), "{done:?}");
    assert!(path.join("aov/whole").is_dir() && !path.join("aov/left.partial").exists());
}

#[test]
fn what_is_of_others_stays_behind_links_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    made::write(path, 2);
    fs::create_dir(path.join("mine")).unwrap();
    let mine = ["mine/film.partial", "mine/writer-of-novels.partial"].map(|name| path.join(name));
    mine.iter().for_each(|file| fs::write(file, "mine").unwrap());
    fs::create_dir_all(path.join("labels")).unwrap();
    std::os::unix::fs::symlink(path.join("mine"), path.join("labels/default")).unwrap();
    mend(path, &Silent).unwrap();
    assert!(mine.iter().all(|file| fs::read_to_string(file).unwrap() == "mine"));
}

#[test]
fn a_folder_that_is_no_data_set_is_left_alone() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("none");
    assert!(matches!(mend(&folder, &Silent), Err(DatasetError::Manifest(_))));
    assert!(!folder.exists());
}
