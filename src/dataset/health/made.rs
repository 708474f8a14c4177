//! A data set as `gen` names and lists it, of made-up samples; for tests.

use std::path::Path;

use fs_err as fs;

use crate::config::to_toml;
use crate::dataset::{count_points, test_data};
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, Manifest, MapDrawing};
use crate::files::sha256_hex;
use crate::generate::{CheckedConfig, GenerateConfig, plan};
use crate::geometry::{Box3, Ego};
use crate::object::Object;
use crate::progress::Silent;
use crate::sample::{Sample, Truth};
use crate::scene::{map_hashes, town_name};
use crate::zone::ZoneConfig;

/// Samples of each episode.
pub(super) const N_SAMPLES: usize = 3;

/// Writes so many labelled episodes with what `gen` writes beside them, every second one for validation.
pub(super) fn write(folder: &Path, n_episodes: u32) -> Manifest {
    write_of(folder, n_episodes, GenerateConfig::default().towns)
}

/// The same, of other towns.
pub(super) fn write_of(folder: &Path, n_episodes: u32, towns: Vec<String>) -> Manifest {
    let config =
        GenerateConfig { towns, samples: N_SAMPLES as u32, val_every: 2.0, ..GenerateConfig::default() };
    let toml = to_toml(&config);
    let with_maps = toml.clone() + &map_hashes(config.towns.iter()).expect("the maps can be read");
    fs::write(folder.join("gen.toml"), &with_maps).expect("the folder can be written");
    fs::create_dir(folder.join("episodes")).expect("the folder can be written");
    let checked = CheckedConfig::try_from(&config).expect("the default config is valid");
    let made = test_data::dataset(N_SAMPLES * n_episodes as usize);
    let mut samples = made.samples().iter();
    let mut manifest = Manifest::new(sha256_hex(with_maps.as_bytes()), config.seed, false);
    for plan in plan(&checked, n_episodes) {
        let meta = EpisodeMeta {
            name: plan.name.clone(),
            seed: plan.seed,
            town: town_name(&plan.town),
            weather: plan.weather.name().to_owned(),
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
            ..test_data::episode_meta("", &toml)
        };
        let path = folder.join(plan.file());
        let mut writer =
            EpisodeWriter::create(&path, &meta, &MapDrawing::default()).expect("the folder can be written");
        for (i, made) in samples.by_ref().take(N_SAMPLES).enumerate() {
            let mut measured = made.measured.clone();
            measured.time_ns = 1_735_689_600_000_000_000 + i as u64 * 300_000_000;
            (measured.ego_state.speed_mps, measured.ego_state.steering_angle_rad) = (0.0, 0.0);
            let mut objects: Vec<Object> = made.objects.iter().map(|object| object.truth.clone()).collect();
            let boxes: Vec<Box3<Ego>> = objects.iter().map(|object| object.box_in_ego).collect();
            for (object, n_points) in objects.iter_mut().zip(count_points(&measured, &boxes)) {
                (object.n_lidar_points, object.visible_px) = (Some(n_points), Some(20));
            }
            let truth = Truth { objects, ..Truth::default() };
            writer.write(&Sample { measured, truth: Some(truth) }).expect("the samples are valid");
        }
        let done = writer.finish().expect("the folder can be written");
        manifest.episodes.push(EpisodeEntry {
            name: plan.name.clone(),
            file: plan.file(),
            split: plan.split,
            seed: plan.seed,
            town: meta.town,
            weather: meta.weather,
            ood: false,
            n_samples: done.n_samples,
            n_objects: done.n_objects,
            sha256: done.sha256,
        });
    }
    manifest.write(folder).expect("the folder can be written");
    crate::label::run(folder, &ZoneConfig::default(), "rect", false, &Silent)
        .expect("the episodes can be labelled");
    manifest
}
