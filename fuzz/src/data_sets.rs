//! Data sets whose manifests, hashes among them, fit what was changed: what reads several files together.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::compare::compare;
use harmzone::config::to_toml;
use harmzone::dataset::health::{examine, mend};
use harmzone::dataset::statistics::Statistics;
use harmzone::episode::{EpisodeReader, LabelManifest, Manifest, PartOf};
use harmzone::eval::json::write_predictions;
use harmzone::export::kitti::{KittiRequest, run as export_kitti};
use harmzone::export::nuscenes::{Naming, NuScenesRequest, Release, run as export_nuscenes};
use harmzone::files::{seal, sha256_hex, sha256_of, unseal};
use harmzone::generate::{CheckedConfig, GenerateConfig, merge, plan};
use harmzone::infer::{PredictionPart, join};
use harmzone::object::Detection;
use harmzone::progress::Silent;

use super::made_episode::{Made as MadeDataset, dataset, detections};
use super::mcap_files::{Part, Parts};
use super::{patched, scratch};

/// What is changed, by the first byte; edits of JSON, or another part of an MCAP file.
const KINDS: [Changed; 6] = [
    Changed::Manifest,
    Changed::LabelManifest,
    Changed::Episode,
    Changed::Labels,
    Changed::Shard,
    Changed::Boxes,
];

#[derive(Clone, Copy, PartialEq)]
enum Changed {
    Manifest,
    LabelManifest,
    Episode,
    Labels,
    /// A shard that is merged.
    Shard,
    /// A part of predictions that is joined.
    Boxes,
}

thread_local! {
    static MADE: Made = Made::make();
}

struct Made {
    of: MadeDataset,
    manifest: String,
    labels: String,
    shard: String,
    gen_toml: String,
    boxes: String,
    episode_parts: Parts,
    label_parts: Parts,
}

/// The JSON of a file without its hash.
fn json_of(path: &Path) -> String {
    unseal(&fs::read_to_string(path).expect("it was just written")).expect("it was just sealed")
}

fn read(path: &Path) -> Vec<u8> {
    fs::read(path).expect("it was just written")
}

impl Made {
    fn make() -> Self {
        let of = dataset("data_set/made");
        let config = GenerateConfig::default();
        let gen_toml = to_toml(&config);
        let name = plan(&CheckedConfig::try_from(&config).expect("the default is valid"), 1).remove(0).name;
        let mut shard = Manifest::read(&of.dataset).expect("it was just written");
        shard.config_sha256 = sha256_hex(gen_toml.as_bytes());
        shard.part = Some(PartOf { shard: "0/1".parse().expect("it is a shard"), n_episodes: 1 });
        shard.episodes[0].name = name;
        let folder = scratch::empty_folder("data_set/shard");
        shard.write(&folder).expect("a manifest can be written");
        let boxes = scratch::empty_folder("data_set/boxes");
        Self {
            manifest: json_of(&of.dataset.join(Manifest::FILE)),
            labels: json_of(&LabelManifest::folder(&of.dataset, "harm").join(LabelManifest::FILE)),
            shard: json_of(&folder.join(Manifest::FILE)),
            gen_toml,
            boxes: part_of_boxes(&of, &boxes),
            episode_parts: Parts::of(&read(&of.episode)),
            label_parts: Parts::of(&read(&of.labels)),
            of,
        }
    }
}

/// Writes a part that is the whole into a folder; returns what it says of itself.
fn part_of_boxes(of: &MadeDataset, folder: &Path) -> String {
    write_boxes(of, folder);
    let part = PredictionPart {
        part: PartOf { shard: "0/1".parse().expect("it is a shard"), n_episodes: 1 },
        generator_version: "0.1.0".into(),
        data: "data".into(),
        data_sha256: "0".repeat(64),
        split: "val".into(),
        network: "run".into(),
        network_sha256: "0".repeat(64),
        episodes: Vec::new(),
    };
    part.write(folder, &[("e", 2)]).expect("a part can be written");
    json_of(&folder.join(PredictionPart::FILE))
}

fn write_boxes(of: &MadeDataset, folder: &Path) {
    fs::copy(&of.detections, folder.join("e.mcap")).expect("the scratch folder has room");
    let found: Vec<Detection> = detections();
    let samples = ["e/0", "e/1"].map(|id| (id, found.as_slice()));
    write_predictions(&folder.join("predictions.json"), samples.into_iter()).expect("boxes can be written");
}

/// Any of [`KINDS`], then by the second byte which part of an MCAP file; from 128 on it is compared with itself, too.
pub fn data_set(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let (kind, is_compared) = (KINDS[kind % 128 % KINDS.len()], kind >= 128);
    MADE.with(|made| match kind {
        Changed::Shard => merge_shard(made, rest),
        Changed::Boxes => join_boxes(made, rest),
        _ => use_all(&changed(made, kind, rest), is_compared),
    });
}

fn merge_shard(made: &Made, edits: &[u8]) {
    let folder = scratch::empty_folder("data_set/shard");
    fs::create_dir_all(folder.join("episodes")).expect("a folder can be made");
    fs::write(folder.join("gen.toml"), &made.gen_toml).expect("the scratch folder has room");
    fs::copy(
        &made.of.episode,
        folder.join("episodes").join(made.of.episode.file_name().expect("it is a file")),
    )
    .expect("the scratch folder has room");
    write_json(&folder.join(Manifest::FILE), &patched::patched(&made.shard, edits));
    let out = scratch::place("data_set/merged");
    let _ = fs::remove_dir_all(&out);
    tell(merge(std::slice::from_ref(&folder), &out, &Silent));
    tell(examine(&folder, &Silent));
    tell(mend(&folder, &Silent));
}

fn join_boxes(made: &Made, edits: &[u8]) {
    let folder = scratch::empty_folder("data_set/boxes");
    write_boxes(&made.of, &folder);
    write_json(&folder.join(PredictionPart::FILE), &patched::patched(&made.boxes, edits));
    let out = scratch::empty_folder("data_set/joined");
    tell(join(&[folder], &out));
}

/// The data set with what was changed, and manifests of these hashes.
fn changed(made: &Made, kind: Changed, rest: &[u8]) -> PathBuf {
    let folder = scratch::empty_folder("data_set/changed");
    let labels_folder = LabelManifest::folder(&folder, "harm");
    for inside in [folder.join("episodes"), labels_folder.clone()] {
        fs::create_dir_all(inside).expect("a folder can be made");
    }
    let place = |path: &Path| folder.join(path.strip_prefix(&made.of.dataset).expect("it lies within"));
    let (episode, labels) = (place(&made.of.episode), place(&made.of.labels));
    let file = |is_changed: bool, path: &Path, parts: &Parts| match rest.split_first() {
        Some((&part, bytes)) if is_changed => parts.with(part_of(parts, usize::from(part), bytes)),
        _ => read(path),
    };
    let write = |path: &Path, bytes: &[u8]| fs::write(path, bytes).expect("the scratch folder has room");
    write(&episode, &file(kind == Changed::Episode, &made.of.episode, &made.episode_parts));
    write(&labels, &file(kind == Changed::Labels, &made.of.labels, &made.label_parts));
    let edits = |wanted: Changed| if kind == wanted { rest } else { &[] };
    let hash = |path: &Path| sha256_of(path).expect("it was just written");
    let (old, new) = (hash(&made.of.episode), hash(&episode));
    let n_samples = EpisodeReader::open(&episode).map_or(2, |episode| episode.len());
    let fit = |text: String| {
        let text =
            text.replace(&old, &new).replace("\"n_samples\": 2", &format!("\"n_samples\": {n_samples}"));
        text.replace(&hash(&made.of.labels), &hash(&labels))
    };
    write_json(
        &folder.join(Manifest::FILE),
        &fit(patched::patched(&made.manifest, edits(Changed::Manifest))),
    );
    let of_labels = patched::patched(&made.labels, edits(Changed::LabelManifest));
    write_json(&labels_folder.join(LabelManifest::FILE), &fit(of_labels));
    folder
}

/// As for the target `episode`, without a whole file.
fn part_of<'a>(parts: &Parts, number: usize, bytes: &'a [u8]) -> Part<'a> {
    match number {
        0 => Part::Metadata(bytes),
        n => Part::Messages((n - 1) % parts.n_channels(), bytes),
    }
}

/// A JSON object with its hash, where it is one.
fn write_json(path: &Path, text: &str) {
    let text = if text.trim_end().ends_with('}') { seal(text) } else { text.to_owned() };
    fs::write(path, text).expect("the scratch folder has room");
}

fn tell<T, E: std::fmt::Display>(result: Result<T, E>) -> Option<T> {
    result.map_err(|error| scratch::tell(&error)).ok()
}

/// What a command may be given a data set for; `mend` comes last, since it changes it.
fn use_all(folder: &Path, is_compared: bool) {
    if let Some(manifest) = tell(Manifest::read(folder)) {
        tell(Statistics::of(folder, &manifest, Some("harm"), &Silent));
    }
    if is_compared {
        tell(compare(folder, folder, None, &Silent));
    }
    tell(examine(folder, &Silent));
    let (labels, naming, force) = ("harm", Naming::Kinds, true);
    let out = scratch::place("data_set/kitti");
    tell(export_kitti(&KittiRequest { dataset: folder, out: &out, labels, naming, force }, &Silent));
    let out = scratch::place("data_set/nuscenes");
    let release = Release::Mini;
    let request = NuScenesRequest { dataset: folder, out: &out, labels, naming, release, force };
    tell(export_nuscenes(&request, &Silent));
    tell(mend(folder, &Silent));
}

/// Inputs to begin with.
pub fn seeds() -> Vec<Vec<u8>> {
    MADE.with(|made| {
        let mut seeds = Vec::new();
        for (kind, changed) in KINDS.into_iter().enumerate() {
            let kind = kind as u8;
            let parts = match changed {
                Changed::Episode => &made.episode_parts,
                Changed::Labels => &made.label_parts,
                _ => {
                    seeds.extend(patched::seeds().into_iter().map(|edits| [&[kind], &edits[..]].concat()));
                    continue;
                }
            };
            seeds.push([&[kind, 0], parts.metadata_lines().as_bytes()].concat());
            let messages = (0..parts.n_channels()).filter_map(|i| Some((i, parts.message(i)?)));
            seeds.extend(messages.map(|(i, bytes)| [&[kind, i as u8 + 1], bytes].concat()));
        }
        seeds
    })
}
