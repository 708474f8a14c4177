//! Networks from elsewhere: checkpoints of ours, and weights of an image backbone in the files of other libraries.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use flate2::Crc;
use fs_err as fs;
use harmzone::config::{to_toml, with_overrides};
use harmzone::dataset::SeenEpisodes;
use harmzone::device::DeviceName;
use harmzone::model::image_weights::load_image_weights;
use harmzone::model::{Detector, ModelConfig, OperatingScore, OperatingScores, Swin, SwinConfig, checkpoint};

use super::scratch;

/// A network that takes milliseconds to make.
const TINY: [&str; 12] = [
    "grid.cell_size_m=6.4",
    "lidar.pillars.channels=4",
    "lidar.pillars.bev_channels=[4,4]",
    "fuser_channels=4",
    "head.n_queries=4",
    "head.channels=8",
    "head.n_heads=2",
    "head.ffn_channels=8",
    "camera.cnn.image_width_px=64",
    "camera.cnn.n_depth_bins=4",
    "camera.cnn.channels=[4,4,4]",
    "camera.cnn.lift_channels=4",
];

/// Weights that a checkpoint may need; more than any config of it should be made of so little.
const MOST_BYTES: usize = 1 << 20;

/// Where others' values lie in a file of [`zipped`].
const N_STORAGES: usize = 40;
const STORAGE_BYTES: usize = 1024;

thread_local! {
    static CHECKPOINT: Vec<u8> = tiny_checkpoint();
    static SWIN: RefCell<Swin> = RefCell::new(small_swin());
}

fn tiny_config() -> ModelConfig {
    let fitting = TINY.iter().map(|text| (*text).to_owned());
    // A key that a later version renames is left out, and the network is a little larger.
    fitting.fold(ModelConfig::default(), |config, text| with_overrides(&config, &[text]).unwrap_or(config))
}

fn tiny_checkpoint() -> Vec<u8> {
    let device = DeviceName::Cpu.open().expect("there is a CPU");
    let path = scratch::place("checkpoint/made.safetensors");
    let seen = SeenEpisodes { learned: ["ab".to_owned()].into(), watched: ["cd".to_owned()].into() };
    checkpoint::save(&Detector::init(&tiny_config(), 0, &device), Some(&seen), &path)
        .expect("it can be written");
    let bytes = fs::read(&path).expect("it was just written");
    checkpoint::with_operating_scores(&bytes, &scores(), Some(&seen), &path).expect("it is a checkpoint")
}

fn scores() -> OperatingScores {
    let warning = OperatingScore {
        score: 0.3,
        max_false_alarms_per_km: 10.0,
        false_alarms_per_km: 9.5,
        missed_per_event: Some(0.25),
        driven_km: 3.5,
        n_samples: 600,
        sample_period_s: None,
    };
    let braking = OperatingScore { score: 0.6, max_false_alarms_per_km: 2.0, ..warning.clone() };
    OperatingScores { warning, braking }
}

/// The JSON header of a safetensors file, and what follows it.
fn halves(file: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u64::from_le_bytes(file.get(..8)?.try_into().ok()?);
    file.get(8..)?.split_at_checked(usize::try_from(length).ok()?)
}

fn joined(header: &[u8], data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header, data].concat()
}

/// A checkpoint: its bytes (first byte modulo 3 is 0), its header, or the config in it.
pub fn checkpoint(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let file = CHECKPOINT.with(|made| {
        let (header, data) = halves(made).expect("it is safetensors");
        match kind % 3 {
            0 => rest.to_vec(),
            1 => joined(rest, data),
            _ => {
                let mut header: serde_json::Value =
                    serde_json::from_slice(header).expect("it is safetensors");
                header["__metadata__"]["harmzone.model"] = String::from_utf8_lossy(rest).into();
                joined(header.to_string().as_bytes(), data)
            }
        }
    });
    let path = Path::new("model.safetensors");
    let _ = (checkpoint::seen_in(&file, path), checkpoint::operating_score_in(&file, path));
    let _ = checkpoint::braking_score_in(&file, path);
    let _ = checkpoint::with_operating_scores(&file, &scores(), None, path);
    if file.len() < MOST_BYTES {
        let device = DeviceName::Cpu.open().expect("there is a CPU");
        if let Err(error) = checkpoint::unpack(&file, path, &device) {
            scratch::tell(&error);
        }
    }
}

/// Inputs to begin with.
pub fn checkpoint_seeds() -> Vec<Vec<u8>> {
    CHECKPOINT.with(|made| {
        let (header, _) = halves(made).expect("it is safetensors");
        let config = to_toml(&tiny_config());
        vec![
            [&[0], &made[..]].concat(),
            [&[1], header].concat(),
            [&[2], config.as_bytes()].concat(),
            [&[2], to_toml(&ModelConfig::default()).as_bytes()].concat(),
            [&[2], to_toml(&ModelConfig::paper()).as_bytes()].concat(),
        ]
    })
}

/// The backbone of `tests/golden/swin_weights_*`.
fn small_swin() -> Swin {
    let config = SwinConfig {
        embed_channels: 4,
        depths: [2, 2, 1, 1],
        n_heads: [1, 2, 2, 4],
        window_size: 3,
        mlp_ratio: 2,
        ..SwinConfig::default()
    };
    Swin::init(&config, &DeviceName::Cpu.open().expect("there is a CPU"))
}

/// Weights of an image backbone: a file (first byte even), or the pickle in a zip file as `torch.save` writes it.
pub fn image_weights(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    let path: PathBuf = if kind % 2 == 0 {
        scratch::write("image_weights/input.pth", rest)
    } else {
        scratch::write("image_weights/input.pth", &zipped(rest))
    };
    SWIN.with_borrow_mut(|swin| match load_image_weights(&path, swin) {
        Ok(report) => scratch::tell(&report),
        Err(error) => scratch::tell(&error),
    });
}

/// A zip file without compression, whose checksums hold: the pickle, and storages of zeros.
fn zipped(pickle: &[u8]) -> Vec<u8> {
    let mut entries =
        vec![("archive/data.pkl".to_owned(), pickle.to_vec()), ("archive/version".into(), b"3\n".to_vec())];
    entries.push(("archive/byteorder".into(), b"little".to_vec()));
    entries.extend((0..N_STORAGES).map(|i| (format!("archive/data/{i}"), vec![0; STORAGE_BYTES])));
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in &entries {
        let mut crc = Crc::new();
        crc.update(data);
        let mut facts = vec![10, 0, 0, 0, 0, 0, 0, 0, 33, 0];
        facts.extend(crc.sum().to_le_bytes());
        facts.extend([data.len() as u32; 2].iter().flat_map(|n| n.to_le_bytes()));
        facts.extend((name.len() as u16).to_le_bytes());
        facts.extend([0, 0]);
        directory.extend(b"PK\x01\x02\x0a\x00");
        directory.extend(&facts);
        directory.extend([0; 10]);
        directory.extend((file.len() as u32).to_le_bytes());
        directory.extend(name.as_bytes());
        file.extend(b"PK\x03\x04");
        file.extend(&facts);
        file.extend(name.as_bytes());
        file.extend(data);
    }
    let begin = file.len() as u32;
    let n = entries.len() as u16;
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend([n; 2].iter().flat_map(|n| n.to_le_bytes()));
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(begin.to_le_bytes());
    file.extend([0, 0]);
    file
}
