//! What a checkpoint gives back, and what is refused.

use super::*;
use crate::model::{DropsLeftOut, HeadJudge};

#[test]
fn a_checkpoint_gives_back_the_same_bytes_and_config() {
    let folder = tempfile::tempdir().unwrap();
    let device = Device::flex();
    let mut config = ModelConfig::default();
    config.head.n_queries = 7;
    let (first, second) = (folder.path().join("a.safetensors"), folder.path().join("b.safetensors"));
    let seen = SeenEpisodes { learned: ["ab".to_owned()].into(), watched: ["cd".to_owned()].into() };
    save(&Detector::init(&config, 0, &device), Some(&seen), &first).unwrap();
    let loaded = load(&first, &device).unwrap();
    assert_eq!(loaded.config(), &config);
    save(&loaded, None, &second).unwrap();
    let seen_in = |path: &Path| seen_in(&fs::read(path).unwrap(), path).unwrap();
    assert_eq!((seen_in(&first), seen_in(&second)), (Some(seen.clone()), None));
    save(&loaded, Some(&seen), &second).unwrap();
    assert_eq!(fs::read(&first).unwrap(), fs::read(&second).unwrap());
}

#[test]
fn operating_scores_are_kept_beside_the_same_weights_and_replaced_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    save(&Detector::init(&ModelConfig::default(), 0, &Device::flex()), None, &path).unwrap();
    let before = fs::read(&path).unwrap();
    assert_eq!(operating_score_in(&before, &path).unwrap(), None);
    let of = |score| OperatingScore {
        score,
        max_false_alarms_per_km: 10.0,
        false_alarms_per_km: 9.5,
        missed_per_event: Some(0.25),
        driven_km: 3.5,
        n_samples: 600,
        sample_period_s: Some(0.3),
    };
    let chosen = |score| OperatingScores { warning: of(score), braking: of(2.0 * score) };
    let seen = SeenEpisodes { learned: ["ab".to_owned()].into(), watched: ["cd".to_owned()].into() };
    let first = with_operating_scores(&before, &chosen(0.3), Some(&seen), &path).unwrap();
    let second = with_operating_scores(&first, &chosen(0.4), None, &path).unwrap();
    assert_eq!(operating_score_in(&second, &path).unwrap(), Some(of(0.4)));
    assert_eq!(braking_score_in(&second, &path).unwrap(), Some(of(0.8)));
    assert_eq!(seen_in(&second, &path).unwrap(), Some(seen));
    assert_eq!(config_in(&second, &path).unwrap(), ModelConfig::default());
    let weights = |bytes: &[u8]| {
        let n_header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        bytes[8 + n_header..].to_vec()
    };
    assert!(weights(&before) == weights(&second));
    assert!(with_operating_scores(b"something else", &chosen(0.3), None, &path).is_err());
}

#[test]
fn a_score_that_no_box_reaches_is_refused() {
    let path = Path::new("model.safetensors");
    let before = pack(&Detector::init(&ModelConfig::default(), 0, &Device::flex()), None).unwrap();
    for (score, is_one) in [(0.0, true), (1.0, true), (-0.1, false), (5.0, false)] {
        let of = OperatingScore {
            score,
            max_false_alarms_per_km: 10.0,
            false_alarms_per_km: 9.5,
            missed_per_event: None,
            driven_km: 3.5,
            n_samples: 600,
            sample_period_s: None,
        };
        let chosen = OperatingScores { warning: of.clone(), braking: of };
        let bytes = with_operating_scores(&before, &chosen, None, path).unwrap();
        for read in [operating_score_in, braking_score_in] {
            let read = read(&bytes, path);
            assert_eq!(read.is_ok(), is_one);
            assert!(is_one || read.unwrap_err().to_string().contains("from 0 to 1"));
        }
    }
}

#[test]
fn weights_that_are_no_numbers_are_named() {
    let path = Path::new("model.safetensors");
    let bytes = pack(&Detector::init(&ModelConfig::in_little()[0], 0, &Device::flex()), None).unwrap();
    let metadata = serde_json::to_value(metadata_in(&bytes).unwrap()).unwrap();
    let views = sorted_views(&bytes).unwrap();
    let damaged = |name: &str, number: f32| {
        let view = &views.iter().find(|(found, _)| found == name).unwrap().1;
        let at = view.data().as_ptr() as usize - bytes.as_ptr() as usize;
        let mut damaged = bytes.clone();
        damaged[at..at + 4].copy_from_slice(&number.to_le_bytes());
        // With a hash that is right.
        let damaged = with_metadata(&damaged, metadata.clone()).unwrap();
        unpack(&damaged, path, &Device::flex()).map_err(|error| error.to_string())
    };
    let variance = views.iter().find(|(name, _)| name.ends_with("running_var")).unwrap().0.clone();
    let (weights, _) = &views[0];
    assert!(damaged(weights, -3.0).is_ok());
    for (name, number) in [(weights, f32::NAN), (weights, f32::INFINITY), (&variance, -0.5)] {
        let told = damaged(name, number).unwrap_err();
        assert!(told.contains(name.as_str()) && told.contains(&number.to_string()), "{told}");
    }
    let halves: Vec<u8> = views[0].1.data().as_chunks::<4>().0.iter().flat_map(|_| [0, 60]).collect();
    let mut others = views.clone();
    others[0].1 =
        safetensors::tensor::TensorView::new(safetensors::Dtype::F16, views[0].1.shape().to_vec(), &halves)
            .unwrap();
    let packed = safetensors::serialize(others, None).unwrap();
    let told = unpack(&with_metadata(&packed, metadata.clone()).unwrap(), path, &Device::flex());
    let told = told.map_err(|error| error.to_string()).unwrap_err();
    assert!(told.contains("F16"), "{told}");
}

#[test]
fn a_file_that_is_no_checkpoint_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    fs::write(&path, b"something else").unwrap();
    assert!(matches!(load(&path, &Device::flex()), Err(CheckpointError::Foreign { .. })));
}

#[test]
fn what_a_checkpoint_does_not_name_its_network_does_not_have() {
    let old = crate::config::to_toml(&ModelConfig::default());
    let old: Vec<&str> = old
        .lines()
        .filter(|line| !BEFORE_KEYS.iter().any(|(path, _)| line.starts_with(path[path.len() - 1])))
        .collect();
    let read = read_model(&old.join("\n")).unwrap();
    assert!(!read.lidar.pillars.ground && !read.head.spread && read.camera.cnn.paint_channels == 0);
    assert_eq!((read.head.look_pillars, read.head.heatmap_power), (0, 1.0));
    assert_eq!(read.head.judge, HeadJudge::Network);
    assert_eq!(read.lidar.drops.left_out, DropsLeftOut::Never);
    let mut without: toml::Table = crate::config::to_toml(&ModelConfig::default()).parse().unwrap();
    assert!(without["lidar"].as_table_mut().unwrap().remove("drops").is_some());
    let read = read_model(&without.to_string()).unwrap();
    assert_eq!(read.lidar.drops.left_out, DropsLeftOut::Never, "of a table that is not there");
    let whole = crate::config::to_toml(&ModelConfig::default());
    assert_eq!(read_model(&whole).unwrap(), ModelConfig::default());
}

#[test]
fn weights_of_another_config_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let device = Device::flex();
    save(&Detector::init(&ModelConfig::default(), 0, &device), None, &path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let from = "fuser_channels = 96";
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    let mut changed = bytes.clone();
    changed[at..at + from.len()].copy_from_slice(b"fuser_channels = 32");
    fs::write(&path, &changed).unwrap();
    // Who changes bytes by hand is told so; a checkpoint from before the hash is told what does not fit.
    let damaged = load(&path, &device).unwrap_err().to_string();
    assert!(damaged.contains("damaged"), "{damaged}");
    let at = changed.windows(HASH_KEY.len()).position(|window| window == HASH_KEY.as_bytes()).unwrap();
    changed[at] = b'H';
    fs::write(&path, changed).unwrap();
    assert!(matches!(load(&path, &device), Err(CheckpointError::Weights { .. })));
}
