//! The kinds of files, what reads each, and what a reader gets of it.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Tensor};
use fs_err as fs;
use harmzone::config;
use harmzone::dataset::Dataset;
use harmzone::drive::load_scenarios;
use harmzone::episode::{DetectionReader, EpisodeReader, LabelReader, Manifest, check_archive};
use harmzone::eval::json::read_predictions;
use harmzone::files::sha256_hex;
use harmzone::generate::GenerateConfig;
use harmzone::infer::join;
use harmzone::model::image_weights::load_image_weights;
use harmzone::model::{Swin, SwinConfig, checkpoint};
use harmzone::outcome::DriveSummary;
use harmzone::report::scores::Scores;
use harmzone::scene::{Town, bring_in};
use harmzone::sensors::RigConfig;
use harmzone::worker::with_causes;

use super::super::folder::{copy, hashes};
use super::super::made_data::{done, fixture, text};
use super::{logs, rock};

pub type Read = Box<dyn Fn(&Path) -> Result<String, String>>;

/// A kind of file, and what reads it.
pub struct Kind {
    pub name: &'static str,
    /// The whole file, in a folder of its own copy of all that is read with it.
    pub path: PathBuf,
    /// Whether the format holds a hash or a checksum of all that it says; without one, another text can be as valid.
    pub is_hashed: bool,
    /// What it holds, as a text that differs if anything does.
    pub read: Read,
    /// The folder of files that are read with it, in a log: what can still be read may not fit the others, and the log or another of its
    /// files is named then.
    pub company: Option<PathBuf>,
}

impl Kind {
    pub fn new(
        name: &'static str,
        path: PathBuf,
        is_hashed: bool,
        read: impl Fn(&Path) -> Result<String, String> + 'static,
    ) -> Self {
        Self { name, path, is_hashed, read: Box::new(read), company: None }
    }

    /// Whether a message names the file: by its path, its name, or as what it is the file of.
    pub fn is_named_in(&self, told: &str) -> bool {
        let name = self.path.file_name().expect("a file").to_string_lossy();
        let stem = self.path.file_stem().expect("a file").to_string_lossy();
        told.contains(&*name)
            || told.contains(&format!("`{stem}`"))
            || self.company.as_ref().is_some_and(|folder| told.contains(text(folder)))
    }
}

fn said<T: Debug, E: std::error::Error>(read: Result<T, E>) -> Result<String, String> {
    read.map(|value| hashed(&value)).map_err(|error| with_causes(&error))
}

fn hashed(value: &impl Debug) -> String {
    sha256_hex(format!("{value:?}").as_bytes())
}

/// Everything that a network may learn from: all splits with their labels.
fn read_dataset(folder: &Path) -> Result<String, String> {
    let manifest = Manifest::read(folder).map_err(|error| error.to_string())?;
    let mut all = format!("{manifest:?}");
    for split in manifest.n_by_split().into_keys() {
        let dataset = Dataset::open(folder, "rect", split).map_err(|error| error.to_string())?;
        all += &hashed(&dataset.samples());
    }
    Ok(all)
}

fn read_episode(path: &Path) -> Result<String, String> {
    check_archive(path).map_err(|error| error.to_string())?;
    let reader = EpisodeReader::open(path).map_err(|error| error.to_string())?;
    let samples = reader.samples().collect::<Result<Vec<_>, _>>().map_err(|error| error.to_string())?;
    let map = reader.map().map_err(|error| error.to_string())?;
    Ok(hashed(&(reader.meta(), samples, map)))
}

fn read_checkpoint(path: &Path) -> Result<String, String> {
    let bytes = fs::read(path).map_err(|error| error.to_string())?;
    let detector = checkpoint::unpack(&bytes, path, &Device::flex()).map_err(|error| error.to_string())?;
    let seen = checkpoint::seen_in(&bytes, path).map_err(|error| error.to_string())?;
    let again = path.with_extension("again");
    checkpoint::save(&detector, seen.as_ref(), &again).map_err(|error| error.to_string())?;
    fs::read(again).map(|bytes| sha256_hex(&bytes)).map_err(|error| error.to_string())
}

/// The boxes of a part of predictions, joined with those of no others.
fn read_part(path: &Path) -> Result<String, String> {
    let out = tempfile::tempdir().expect("a temporary folder");
    let part = path.parent().expect("a folder").to_owned();
    join(&[part], out.path()).map_err(|error| with_causes(&error))?;
    Ok(hashed(&hashes(out.path())))
}

/// Weights that others' libraries wrote: the maps that a network makes with them of one picture.
fn read_image_weights(path: &Path) -> Result<String, String> {
    // That of `tests/golden/torch_swin.py`.
    let config = SwinConfig {
        embed_channels: 4,
        depths: [2, 2, 1, 1],
        n_heads: [1, 2, 2, 4],
        window_size: 3,
        mlp_ratio: 2,
        ..SwinConfig::default()
    };
    let device = Device::flex();
    let mut swin = Swin::init(&config, &device);
    // Norms that the file lacks stay ones and zeros.
    let report = load_image_weights(path, &mut swin).map_err(|error| with_causes(&error))?;
    let maps = swin.forward(Tensor::<4>::ones([1, 3, 32, 32], &device));
    Ok(hashed(&(report, maps.map(|map| map.into_data().try_to_vec::<f32>().expect("32-bit floats")))))
}

/// All kinds, each in its own folder below `home`.
pub fn kinds(home: &Path) -> Vec<Kind> {
    let made = fixture();
    let data = home.join("data");
    copy(&made.id, &data);
    let path = |name: &str| home.join(name);
    let episode = Manifest::read(&data).expect("a data set").episodes[0].clone();
    let split = episode.split.name();
    done(&["predict", "small", "--data", text(&data), "--split", split, "--out", text(&path("boxes"))]);
    done(&["predict", "small", "--data", text(&data), "--shard", "0/1", "--out", text(&path("part"))]);
    let boxes = path("boxes").join(format!("{}.mcap", episode.name));
    done(&["eval", "small", "--data", text(&data), "--out", text(&path("scores"))]);
    let drive = "drive blind --episodes 1 --town downtown --set seconds=1.0 --seed 3";
    done(&[drive.split(' ').collect::<Vec<_>>(), vec!["--out", text(&path("drive"))]].concat());
    let copied = |from: &Path, name: &str| {
        fs::create_dir_all(path(name).parent().expect("a folder")).expect("a writable folder");
        fs::copy(from, path(name)).expect("a readable file");
        path(name)
    };
    let sources = Path::new(env!("CARGO_MANIFEST_DIR"));
    copied(&sources.join("tests/data/formats/results/1/scores/sweeps.json"), "scores/sweeps.json");
    let of_rock = |file: &'static str, bytes: Vec<u8>| {
        let path = path(&format!("{file} alone")).join(file);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a writable folder");
        fs::write(&path, bytes).expect("a writable folder");
        let read = |path: &Path| {
            said(bring_in(path.parent().expect("a folder"), false).map(|models| models.sha256()))
        };
        Kind::new(file, path, false, read)
    };
    let of_data = |name: &'static str, file: String| {
        let (path, folder) = (data.join(file), data.clone());
        Kind::new(name, path, true, move |_| read_dataset(&folder))
    };
    let of_weights = |name: &'static str, file: &str| {
        let path = copied(&sources.join("tests/golden").join(file), &format!("weights/{file}"));
        Kind::new(name, path, false, read_image_weights)
    };
    let map = copied(&sources.join("tests/data/crossroads.xodr"), "town/r.xodr");
    let rig = path("alone/rig.toml");
    fs::create_dir_all(path("alone")).expect("a writable folder");
    fs::write(&rig, config::to_toml(&RigConfig::default())).expect("a writable folder");
    let mut kinds = vec![
        of_data("episode", episode.file.clone()),
        of_data("labels", format!("labels/rect/{}.mcap", episode.name)),
        of_data("dataset.json", Manifest::FILE.to_owned()),
        of_data("labels.json", "labels/rect/labels.json".to_owned()),
        Kind::new("episode, alone", copied(&data.join(&episode.file), "alone/e.mcap"), true, read_episode),
        Kind::new(
            "labels, alone",
            copied(&data.join(format!("labels/rect/{}.mcap", episode.name)), "alone/l.mcap"),
            true,
            |path| {
                said(LabelReader::open(path).map(|reader| (reader.meta().clone(), reader.samples().to_vec())))
            },
        ),
        Kind::new("boxes, MCAP", boxes, true, |path| {
            said(DetectionReader::open(path).map(|reader| (reader.meta().clone(), reader.samples().to_vec())))
        }),
        Kind::new("predictions.json", path("boxes/predictions.json"), true, |path| {
            said(read_predictions(path).map(|boxes| boxes.samples))
        }),
        Kind::new("metrics.json", path("scores/metrics.json"), true, |path| {
            said(Scores::read(path.parent().expect("a folder")).map(|scores| scores.evaluation))
        }),
        Kind::new("source.json", path("scores/source.json"), true, |path| {
            said(Scores::read(path.parent().expect("a folder")).map(|scores| scores.provenance))
        }),
        Kind::new("faults.json", path("scores/faults.json"), true, |path| {
            said(Scores::read(path.parent().expect("a folder")).map(|scores| scores.faults))
        }),
        Kind::new("sweeps.json", path("scores/sweeps.json"), true, |path| {
            said(Scores::read(path.parent().expect("a folder")).map(|scores| scores.sweeps))
        }),
        Kind::new("part.json", path("part/part.json"), true, read_part),
        Kind::new("predictions.json, part", path("part/predictions.json"), true, read_part),
        Kind::new("drive.json", path("drive/drive.json"), true, |path| {
            said(DriveSummary::read(path.parent().expect("a folder")))
        }),
        Kind::new(
            "checkpoint",
            copied(&made.run.join("model.safetensors"), "alone/m.safetensors"),
            true,
            read_checkpoint,
        ),
        Kind::new(
            "road.xodr",
            copied(&sources.join("tests/data/crossroads.xodr"), "road/r.xodr"),
            false,
            |path| said(Town::load(text(path))),
        ),
        Kind::new("gen.toml", copied(&data.join("gen.toml"), "alone/gen.toml"), false, |path| {
            said(config::load::<GenerateConfig>(Some(path), &[]))
        }),
        Kind::new(
            "town.toml",
            copied(&sources.join("scenes/default_town.toml"), "town/town.toml"),
            false,
            move |_| said(Town::load(text(&map))),
        ),
        Kind::new("rig.toml", rig, false, |path| said(config::load::<RigConfig>(Some(path), &[]))),
        Kind::new(
            "scenario",
            copied(&sources.join("scenarios/backs_out_1.toml"), "alone/one.toml"),
            false,
            |path| said(load_scenarios(path)),
        ),
        of_weights("weights, timm", "swin_weights_timm.safetensors"),
        of_weights("weights, mmdet", "swin_weights_mmdet.pth"),
        of_rock("rock.obj", rock::obj()),
        of_rock("rock.stl", rock::stl()),
        of_rock("rock.glb", rock::glb()),
    ];
    kinds.extend(logs::kinds(&data, home));
    kinds
}
