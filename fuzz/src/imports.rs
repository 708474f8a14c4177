//! Logs of real cars, imported whole: one file of a made log is replaced by the input.

use std::path::Path;

use fs_err as fs;
use harmzone::config::load;
use harmzone::episode::{EpisodeReader, Manifest, Split};
use harmzone::import::nuscenes::NuScenesLog;
use harmzone::import::ros2::{MappingConfig, Ros2Log, list};
use harmzone::import::{
    GroundSource, ImportConfig, ImportError, ImportOptions, Log, LogFormat, open_av2, open_kitti, run,
};
use harmzone::progress::Silent;

use super::made_logs::{self, LogFolder};
use super::mcap_files::{Part, Parts};
use super::scratch;

const PLAIN: &[u8] = include_bytes!("../../tests/data/ros2/plain/plain.mcap");
const PLAIN_MAPPING: &str = include_str!("../../tests/data/ros2/plain_mapping.toml");
const PLAIN_METADATA: &[u8] = include_bytes!("../../tests/data/ros2/plain/metadata.yaml");

thread_local! {
    static NUSCENES: LogFolder = made_logs::nuscenes();
    static KITTI: [LogFolder; 4] = made_logs::kitti();
    static AV2: LogFolder = made_logs::av2();
    static BAG: Parts = Parts::of(PLAIN);
}

/// Imports what can be opened; what was written must be readable.
fn import<L: Log>(
    format: LogFormat,
    is_fitted: bool,
    open: impl FnOnce(&ImportConfig) -> Result<L, ImportError>,
) {
    let mut config = ImportConfig::shipped(format);
    if is_fitted {
        config.ground = GroundSource::Fit;
    }
    let log = match open(&config) {
        Ok(log) => log,
        Err(error) => return scratch::tell(&error),
    };
    let out = scratch::empty_folder(&format!("{}/out", format.name()));
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: true, force: false };
    match run(&log, format, &config, &out, &options, &Silent) {
        Ok(summary) => {
            scratch::tell(&format!("{} samples, left out: {:?}", summary.n_samples, summary.skipped))
        }
        Err(error) => return scratch::tell(&error),
    }
    let manifest = Manifest::read(&out).expect("an import writes a manifest");
    for entry in &manifest.episodes {
        let episode = EpisodeReader::open_entry(&out, entry).expect("an import writes what can be read");
        for sample in episode.samples() {
            sample.expect("an import writes what can be read");
        }
    }
}

/// Puts the input in place of the log's file of this index, and the file back afterwards.
fn with_replaced(log: &LogFolder, file_idx: usize, bytes: &[u8], work: impl FnOnce(&Path)) {
    let path = &log.files[file_idx % log.files.len()];
    let before = fs::read(path).expect("the made log is there");
    fs::write(path, bytes).expect("the scratch folder has room");
    work(&log.root);
    fs::write(path, before).expect("the scratch folder has room");
}

/// A log of nuScenes; the first byte chooses the file, from 128 on with the ground fitted.
pub fn nuscenes(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    NUSCENES.with(|log| {
        with_replaced(log, kind % 128, rest, |root| {
            import(LogFormat::Nuscenes, kind >= 128, |config| NuScenesLog::open(root, config));
        });
    });
}

/// A log of KITTI; the first byte chooses layout (its upper two bits) and file.
pub fn kitti(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    KITTI.with(|logs| {
        with_replaced(&logs[kind / 64], kind % 64, rest, |root| {
            import(LogFormat::Kitti, false, |config| open_kitti(root, config));
        });
    });
}

/// A log of Argoverse 2; the first byte chooses the file.
pub fn av2(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    AV2.with(|log| {
        with_replaced(log, kind, rest, |root| import(LogFormat::Av2, false, |config| open_av2(root, config)));
    });
}

/// A bag of ROS 2. The first byte: 0 the bag, 1 its metadata, 2 the mapping, then messages of a channel, then schemas; from 128 on
/// with the mapping that is proposed, and listed.
pub fn ros2(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let folder = scratch::empty_folder("ros2/bag");
    let mut mapping = PLAIN_MAPPING.as_bytes();
    let bag = BAG.with(|bag| match kind % 128 {
        0 => rest.to_vec(),
        1 => {
            scratch::write("ros2/bag/metadata.yaml", rest);
            bag.with(Part::Nothing)
        }
        2 => {
            mapping = rest;
            bag.with(Part::Nothing)
        }
        n if (n - 3) / bag.n_channels() % 2 == 0 => {
            bag.with(Part::Messages((n - 3) % bag.n_channels(), rest))
        }
        n => bag.with(Part::Schema((n - 3) % bag.n_channels(), rest)),
    });
    scratch::write("ros2/bag/plain.mcap", &bag);
    if kind >= 128 {
        let _ = list(&folder);
    }
    let mapping = scratch::write("ros2/mapping.toml", mapping);
    let mapping = if kind < 128 { load::<MappingConfig>(Some(&mapping), &[]).ok() } else { None };
    import(LogFormat::Ros2, false, |config| Ros2Log::open(&folder, mapping, config));
}

fn seeds_of(log: &LogFolder, first: usize) -> Vec<Vec<u8>> {
    let seed =
        |(i, path)| [&[(first + i) as u8], &fs::read(path).expect("the made log is there")[..]].concat();
    log.files.iter().enumerate().map(seed).collect()
}

/// Inputs to begin with.
pub fn nuscenes_seeds() -> Vec<Vec<u8>> {
    NUSCENES.with(|log| seeds_of(log, 0))
}

/// Inputs to begin with.
pub fn kitti_seeds() -> Vec<Vec<u8>> {
    KITTI.with(|logs| logs.iter().enumerate().flat_map(|(i, log)| seeds_of(log, 64 * i)).collect())
}

/// Inputs to begin with.
pub fn av2_seeds() -> Vec<Vec<u8>> {
    AV2.with(|log| seeds_of(log, 0))
}

/// Inputs to begin with.
pub fn ros2_seeds() -> Vec<Vec<u8>> {
    BAG.with(|bag| {
        let n = bag.n_channels();
        let mut seeds = vec![
            (0, bag.with(Part::Nothing)),
            (1, PLAIN_METADATA.to_vec()),
            (2, PLAIN_MAPPING.as_bytes().to_vec()),
        ];
        seeds.extend((0..n).filter_map(|i| Some((3 + i, bag.message(i)?.to_vec()))));
        seeds.extend((0..n).filter_map(|i| Some((3 + n + i, bag.schema(i)?.to_vec()))));
        let both = |(kind, bytes): (usize, Vec<u8>)| {
            [0, 128].map(|plus| [&[(kind + plus) as u8], &bytes[..]].concat())
        };
        seeds.into_iter().flat_map(both).collect()
    })
}
