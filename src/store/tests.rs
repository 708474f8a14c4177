//! Mirrors over a store in memory: what is put, in which order, what is told to a second writer, what is evicted.

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

use fs_err as fs;
use object_store::memory::InMemory;
use object_store::{GetOptions, ObjectStore, PutOptions, PutPayload};
use tempfile::TempDir;

use super::bucket::{Bucket, runtime};
use super::location::{Location, StoreUrl};
use super::mirror::{Access, Mirror};
use super::{StoreError, known};

fn url() -> StoreUrl {
    match "s3://bucket/sets/town".parse().unwrap() {
        Location::Remote(url) => url,
        Location::Local(_) => unreachable!("it is a URL"),
    }
}

/// One store, and a machine with a cache of its own for each mirror.
struct World {
    store: Arc<InMemory>,
}

impl World {
    fn new() -> Self {
        Self { store: Arc::new(InMemory::new()) }
    }

    fn open(&self, cache: &Path, access: Access) -> Result<Mirror, StoreError> {
        self.bounded(cache, access, 1 << 30)
    }

    fn bounded(&self, cache: &Path, access: Access, bound_bytes: u64) -> Result<Mirror, StoreError> {
        let store = Arc::clone(&self.store) as Arc<dyn ObjectStore>;
        Mirror::open(&url(), Bucket::of(store, &url()), cache, bound_bytes, access)
    }

    /// Puts an object as a program does that knows nothing of hashes.
    fn put_by_others(&self, name: &str, text: &'static str) {
        let path = object_store::path::Path::from(format!("sets/town/{name}"));
        runtime()
            .block_on(self.store.put_opts(&path, PutPayload::from(text), PutOptions::default()))
            .unwrap();
    }

    fn names(&self) -> Vec<String> {
        let bucket = Bucket::of(Arc::clone(&self.store) as _, &url());
        runtime().block_on(bucket.list()).unwrap().into_keys().collect()
    }
}

fn machine() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn make(mirror: &Mirror, name: &str, text: &str) {
    let path = mirror.root.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

#[test]
fn what_one_machine_pushes_another_reads() {
    let (world, here, there) = (World::new(), machine(), machine());
    let made = world.open(here.path(), Access::Write).unwrap();
    make(&made, "episodes/a.mcap", "drive");
    make(&made, "dataset.json", "{}");
    make(&made, "episodes/b.mcap.partial", "half");
    made.push().unwrap();
    assert_eq!(world.names(), ["dataset.json", "episodes/a.mcap"]);

    let read = world.open(there.path(), Access::Read).unwrap();
    assert_eq!(read.root.file_name().unwrap(), "town");
    assert_eq!(fs::read_to_string(read.root.join("dataset.json")).unwrap(), "{}");
    let episode = read.root.join("episodes/a.mcap");
    assert!(!episode.exists(), "it comes when it is read");
    let sha256 = crate::files::sha256_hex(b"drive");
    assert!(read.has("episodes/a.mcap", &sha256).unwrap() && !episode.exists());
    assert_eq!(read.bring("episodes/a.mcap").unwrap(), Some(()));
    assert_eq!(fs::read_to_string(&episode).unwrap(), "drive");
    assert_eq!(read.bring("episodes/z.mcap").unwrap(), None);
    drop(read);
    // A copy that is current stays.
    world.open(there.path(), Access::Read).unwrap();
    assert!(episode.exists());
}

#[test]
fn a_large_file_goes_up_in_parts_and_arrives_whole() {
    let (world, here, there) = (World::new(), machine(), machine());
    let made = world.open(here.path(), Access::Write).unwrap();
    let name = "episodes/large.mcap";
    let large = made.root.join(name);
    fs::create_dir_all(large.parent().unwrap()).unwrap();
    let ends = |at: u64| [b"part".as_slice(), &at.to_le_bytes()].concat();
    let mut file = fs::File::create(&large).unwrap();
    // Holes between, so that nothing of its 70 MiB but a mark in each part is written.
    for at in (0..70_u64).step_by(10) {
        file.seek(SeekFrom::Start(at << 20)).unwrap();
        file.write_all(&ends(at)).unwrap();
    }
    file.set_len((70 << 20) + 1).unwrap();
    made.push_file(name).unwrap();
    // What lies there already is not sent again, and another content does not replace it.
    made.push_file(name).unwrap();
    let sha256 = crate::files::sha256_of(&large).unwrap();

    let read = world.open(there.path(), Access::Read).unwrap();
    assert!(read.has(name, &sha256).unwrap());
    read.bring(name).unwrap();
    assert_eq!(crate::files::sha256_of(&read.root.join(name)).unwrap(), sha256);
    drop(read);
    let other = world.open(there.path(), Access::Write).unwrap();
    drop(made);
    let second = world.open(here.path(), Access::Write).unwrap();
    make(&second, "episodes/new.mcap", "small");
    second.push_file("episodes/new.mcap").unwrap();
    fs::copy(&large, other.root.join("episodes/new.mcap")).unwrap();
    assert!(matches!(other.push_file("episodes/new.mcap"), Err(StoreError::Taken { .. })));
}

#[test]
fn a_second_writer_is_told_and_overwrites_nothing() {
    let (world, here, there) = (World::new(), machine(), machine());
    let first = world.open(here.path(), Access::Write).unwrap();
    let second = world.open(there.path(), Access::Write).unwrap();
    make(&first, "dataset.json", "first");
    first.push().unwrap();
    make(&second, "dataset.json", "second");
    assert!(matches!(second.push(), Err(StoreError::Taken { .. })));
    drop(second);
    let second = world.open(there.path(), Access::Write).unwrap();
    make(&first, "dataset.json", "first, and more");
    first.push().unwrap();
    make(&second, "dataset.json", "second");
    assert!(matches!(second.push(), Err(StoreError::Changed { .. })));
    let reader = machine();
    let found = world.open(reader.path(), Access::Read).unwrap();
    assert_eq!(fs::read_to_string(found.root.join("dataset.json")).unwrap(), "first, and more");
}

#[test]
fn an_equal_episode_is_fine_and_another_one_is_not_replaced() {
    let (world, here, there) = (World::new(), machine(), machine());
    let [first, second] = [&here, &there].map(|cache| world.open(cache.path(), Access::Write).unwrap());
    make(&first, "episodes/a.mcap", "drive");
    first.push_file("episodes/a.mcap").unwrap();
    make(&second, "episodes/a.mcap", "drive");
    second.push_file("episodes/a.mcap").unwrap();
    make(&second, "episodes/a.mcap", "other");
    assert!(matches!(second.push_file("episodes/a.mcap"), Err(StoreError::Taken { .. })));
}

#[test]
fn an_episode_of_an_earlier_call_may_be_replaced() {
    let (world, here, there) = (World::new(), machine(), machine());
    let first = world.open(here.path(), Access::Write).unwrap();
    make(&first, "episodes/a.mcap", "drive");
    first.push_file("episodes/a.mcap").unwrap();
    let second = world.open(there.path(), Access::Write).unwrap();
    make(&second, "episodes/a.mcap", "other");
    second.push_file("episodes/a.mcap").unwrap();
    make(&second, "episodes/a.mcap", "once more");
    assert!(matches!(second.push_file("episodes/a.mcap"), Err(StoreError::Taken { .. })));
}

#[test]
fn nothing_of_another_config_is_left_where_a_push_of_a_new_one_fails() {
    for changed in ["train.toml", "data.json"] {
        let (world, here) = (World::new(), machine());
        let mirror = world.open(here.path(), Access::Write).unwrap();
        for name in ["train.toml", "data.json", "state/step-1/position.json", "model.safetensors"] {
            make(&mirror, name, "first");
        }
        mirror.push().unwrap();
        for name in ["state/step-1/position.json", "model.safetensors"] {
            fs::remove_file(mirror.root.join(name)).unwrap();
        }
        make(&mirror, changed, "second");
        make(&mirror, "state/step-2/position.json", "second");
        world.put_by_others(changed, "third");
        assert!(matches!(mirror.push(), Err(StoreError::Changed { .. })));
        assert_eq!(world.names(), ["data.json", "train.toml"]);
    }
}

#[test]
fn one_process_of_a_machine_writes() {
    let (world, here) = (World::new(), machine());
    let writer = world.open(here.path(), Access::Write).unwrap();
    make(&writer, "dataset.json", "{}");
    writer.push().unwrap();
    for access in [Access::Read, Access::Write] {
        assert!(matches!(world.open(here.path(), access), Err(StoreError::InUse { .. })));
    }
    drop(writer);
    let _reader = world.open(here.path(), Access::Read).unwrap();
    world.open(here.path(), Access::Read).unwrap();
}

#[test]
fn what_was_not_put_is_gone_and_what_was_removed_is_removed() {
    let (world, here) = (World::new(), machine());
    let run = world.open(here.path(), Access::Write).unwrap();
    for step in ["1", "2"] {
        make(&run, &format!("state/step-{step}/model.safetensors"), step);
        make(&run, &format!("state/step-{step}/position.json"), step);
        if step == "2" {
            fs::remove_dir_all(run.root.join("state/step-1")).unwrap();
        }
        run.push().unwrap();
    }
    assert_eq!(world.names(), ["state/step-2/model.safetensors", "state/step-2/position.json"]);
    make(&run, "log.csv", "of a killed command");
    drop(run);
    let run = world.open(here.path(), Access::Write).unwrap();
    assert!(!run.root.join("log.csv").exists());
    drop(run);
    let elsewhere = machine();
    let reader = world.open(elsewhere.path(), Access::Read).unwrap();
    assert!(known::walk(&reader.root).unwrap().is_empty(), "a reader has no use for states");
}

#[test]
fn fetched_files_stay_within_the_bound_and_what_was_made_here_stays() {
    let (world, here, there) = (World::new(), machine(), machine());
    let made = world.open(here.path(), Access::Write).unwrap();
    let names = ["a", "b", "c", "d"].map(|name| format!("episodes/{name}.mcap"));
    names.iter().for_each(|name| make(&made, name, "0123456789"));
    made.push().unwrap();
    let other = world.bounded(there.path(), Access::Write, 25).unwrap();
    make(&other, "episodes/own.mcap", "not put yet, and longer than all the others");
    for name in &names {
        other.bring(name).unwrap();
        assert!(other.root.join(name).exists());
        other.note_use(name);
    }
    let left: Vec<bool> = names.iter().map(|name| other.root.join(name).exists()).collect();
    assert_eq!(left, [false, false, true, true]);
    assert!(other.root.join("episodes/own.mcap").exists());
    other.bring(&names[0]).unwrap();
    assert_eq!(fs::read_to_string(other.root.join(&names[0])).unwrap(), "0123456789", "it comes again");
}

#[test]
fn an_object_that_is_not_what_was_put_is_refused_and_leaves_no_file() {
    let (world, here, there) = (World::new(), machine(), machine());
    let made = world.open(here.path(), Access::Write).unwrap();
    make(&made, "episodes/a.mcap", "drive");
    made.push().unwrap();
    let path = object_store::path::Path::from("sets/town/episodes/a.mcap");
    let whole = runtime().block_on(world.store.get_opts(&path, GetOptions::default())).unwrap().attributes;
    let options = PutOptions { attributes: whole, ..PutOptions::default() };
    runtime().block_on(world.store.put_opts(&path, PutPayload::from("dr"), options)).unwrap();
    let read = world.open(there.path(), Access::Read).unwrap();
    assert!(matches!(read.bring("episodes/a.mcap"), Err(StoreError::Torn { .. })));
    assert!(known::walk(&read.root).unwrap().is_empty());
}

#[test]
fn objects_of_other_programs_are_read_and_asked_for_their_hash_by_their_bytes() {
    let (world, here) = (World::new(), machine());
    world.put_by_others("dataset.json", "{}");
    world.put_by_others("episodes/a.mcap", "drive");
    let read = world.open(here.path(), Access::Read).unwrap();
    assert!(read.root.join("dataset.json").exists());
    assert!(read.has("episodes/a.mcap", &crate::files::sha256_hex(b"drive")).unwrap());
    assert!(!read.has("episodes/a.mcap", &crate::files::sha256_hex(b"other")).unwrap());
}

#[test]
fn labels_made_anew_are_untold_before_they_change() {
    let (world, here) = (World::new(), machine());
    let made = world.open(here.path(), Access::Write).unwrap();
    make(&made, "labels/rect/a.mcap", "old");
    make(&made, "labels/rect/labels.json", "old");
    made.push().unwrap();
    // The disk fails before the new set is told: nobody may find old words about new labels.
    make(&made, "labels/rect/a.mcap", "new labels");
    fs::remove_file(made.root.join("labels/rect/labels.json")).unwrap();
    made.push().unwrap();
    assert_eq!(world.names(), ["labels/rect/a.mcap"]);
    make(&made, "labels/rect/labels.json", "new");
    made.push().unwrap();
    assert_eq!(world.names().len(), 2);
}

#[test]
fn nothing_to_read_is_told() {
    let told = World::new().open(machine().path(), Access::Read).err().unwrap();
    assert!(told.to_string().ends_with("s3://bucket/sets/town"), "{told}");
}
