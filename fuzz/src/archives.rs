//! Episodes, and what lies beside them: labels, predictions, logs of drives.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::episode::merged::{MergeSources, MergedLook, write_merged};
use harmzone::episode::{CommandReader, DetectionReader, EpisodeReader, LabelReader};
use harmzone::model::{Input, ModelConfig};
use harmzone::progress::Silent;
use harmzone::zone::{Zone, ZoneConfig, ZoneKind};
use mcap::Compression;

use super::made_episode::{Made, dataset};
use super::mcap_files::{Part, Parts};
use super::scratch;

/// Samples that are read of a file.
const MOST_SAMPLES: usize = 4;

/// Whole files of this thread, taken apart.
struct Templates {
    made: Made,
    episodes: [Parts; 2],
    sidecars: [Parts; 3],
}

thread_local! {
    static TEMPLATES: Templates = Templates::make();
}

impl Templates {
    fn make() -> Self {
        let made = dataset("archives");
        let parts = |path: &PathBuf| Parts::of(&fs::read(path).expect("it was just written"));
        let episodes = [&made.episode, &made.log_episode].map(parts);
        let sidecars = [&made.labels, &made.detections, &made.drive_log].map(parts);
        Self { made, episodes, sidecars }
    }
}

/// Bytes with a first byte: 0 for a whole file, else which part of one is replaced.
fn file_of(template: &Parts, kind: usize, bytes: &[u8]) -> Vec<u8> {
    match kind {
        0 => bytes.to_vec(),
        1 => template.with(Part::Metadata(bytes)),
        n if ((n - 2) / template.n_channels()).is_multiple_of(2) => {
            template.with(Part::Messages((n - 2) % template.n_channels(), bytes))
        }
        n => template.with(Part::Schema((n - 2) % template.n_channels(), bytes)),
    }
}

/// The inputs that give a template back.
fn seeds_of(template: &Parts) -> Vec<(usize, Vec<u8>)> {
    let mut seeds = vec![(0, template.with(Part::Nothing)), (1, template.metadata_lines().into_bytes())];
    seeds.extend(
        [Compression::Zstd, Compression::Lz4].map(|by| (0, template.packed(Part::Nothing, Some(by)))),
    );
    seeds.extend((0..template.n_channels()).filter_map(|i| Some((i + 2, template.message(i)?.to_vec()))));
    seeds
}

/// An episode: read whole, labelled, made ready for a network, and joined for a viewer.
pub fn episode(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let file = TEMPLATES.with(|templates| file_of(&templates.episodes[kind / 128], kind % 128, rest));
    read_episode(&scratch::write("episode/input.mcap", &file));
}

fn read_episode(path: &Path) {
    let episode = match EpisodeReader::open(path) {
        Ok(episode) => episode,
        Err(error) => return scratch::tell(&error),
    };
    let _ = episode.map();
    let of_kind = |kind| Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() });
    let zones = ZoneKind::ALL.map(|kind| of_kind(kind).expect("the default is valid"));
    let config = ModelConfig::default();
    for i in 0..episode.len().min(MOST_SAMPLES) {
        let _ = (episode.views(i), episode.clouds(i), episode.sweeps(i), episode.whole_sample(i));
        let sample = match episode.sample(i) {
            Ok(sample) => sample,
            Err(error) => {
                scratch::tell(&error);
                continue;
            }
        };
        for zone in zones.iter().filter_map(|zone| zone.at(sample.true_state()).ok()) {
            for object in sample.objects() {
                let _ = (zone.harm_of_object(object), zone.edge_distance_m(&object.box_in_ego));
            }
        }
        let _ = Input::prepare(&sample.measured, &config, false, true);
    }
    if episode.len() <= MOST_SAMPLES {
        let sources = MergeSources { episode: &episode, labels: None, detections: None };
        let _ = write_merged(&scratch::place("episode/merged.mcap"), sources, &LOOK, &Silent);
    }
}

const LOOK: MergedLook = MergedLook {
    harmful: [200, 0, 0],
    harmless: [0, 0, 200],
    unlabelled: [90, 90, 90],
    predicted_harmful: [255, 90, 0],
    predicted_harmless: [0, 90, 255],
    zone: [0, 200, 0],
    ink: [0, 0, 0],
    text: [255, 255, 255],
    min_score: 0.0,
};

/// Labels (first byte below 85), predictions, or a drive's log; read and joined with the episode.
pub fn sidecar(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let of = (kind / 85).min(2);
    TEMPLATES.with(|templates| {
        let file = file_of(&templates.sidecars[of], kind - 85 * of, rest);
        let path = scratch::write("sidecar/input.mcap", &file);
        let episode = EpisodeReader::open(&templates.made.episode).expect("it was made by a writer");
        let join = |labels: Option<&LabelReader>, detections: Option<&DetectionReader>| {
            let sources = MergeSources { episode: &episode, labels, detections };
            let _ = write_merged(&scratch::place("sidecar/merged.mcap"), sources, &LOOK, &Silent);
        };
        match of {
            0 => {
                let _ = LabelReader::open(&path).map(|labels| join(Some(&labels), None));
            }
            1 => {
                let _ = DetectionReader::open(&path).map(|found| join(None, Some(&found)));
            }
            _ => {
                let _ = (CommandReader::open(&path), DetectionReader::open(&path));
            }
        }
    });
}

/// Inputs to begin with, for `episode`.
pub fn episode_seeds() -> Vec<Vec<u8>> {
    TEMPLATES.with(|templates| {
        let of = |(i, template): (usize, &Parts)| {
            seeds_of(template)
                .into_iter()
                .map(move |(kind, bytes)| [&[(kind + 128 * i) as u8], &bytes[..]].concat())
        };
        templates.episodes.iter().enumerate().flat_map(of).collect()
    })
}

/// Inputs to begin with, for `sidecar`.
pub fn sidecar_seeds() -> Vec<Vec<u8>> {
    TEMPLATES.with(|templates| {
        let of = |(i, template): (usize, &Parts)| {
            seeds_of(template)
                .into_iter()
                .map(move |(kind, bytes)| [&[(kind + 85 * i) as u8], &bytes[..]].concat())
        };
        templates.sidecars.iter().enumerate().flat_map(of).collect()
    })
}
