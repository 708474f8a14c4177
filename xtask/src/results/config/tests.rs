//! What the shipped experiments hold, and what a config that does not fit is told.

use super::*;
use harmzone::model::NumericFusion;

fn ablations() -> ResultsConfig {
    toml::from_str(include_str!("../../../../configs/ablations.toml")).unwrap()
}

#[test]
fn what_ships_stands_beside_its_rivals_and_is_judged_by_all() {
    let config = ResultsConfig::default();
    let trainings = config.trainings().unwrap();
    assert_eq!(trainings.len(), 1, "nothing is trained but the headline, where it is not given");
    assert_eq!(trainings[0].1, TrainConfig::default());
    let given: Vec<&str> = config.given.iter().map(|of| of.name.as_str()).collect();
    assert_eq!(given, ["lidar", "kinds", "camera"]);
    let beside = |name: &str| config.side_by_side.iter().any(|of| of.rows.iter().any(|row| row.row == name));
    assert!(given.iter().all(|name| beside(name)));
    // Network and rule together is its own word.
    let judged = |judge| config.rivals.iter().any(|rival| rival.row == "small" && rival.judge == judge);
    assert!(Judge::ALL.into_iter().all(|judge| judged(judge) != (judge == Judge::Both)));
}

#[test]
fn a_given_run_has_a_name_of_its_own_and_is_asked_what_it_can_tell() {
    let wrong = |change: fn(&mut ResultsConfig)| {
        let mut config = ResultsConfig::default();
        change(&mut config);
        format!("{:#}", config.trainings().unwrap_err())
    };
    let message = wrong(|config| config.given[1].name = "lidar".into());
    assert!(message.contains("given `lidar`") && message.contains("each name once"), "{message}");
    let message = wrong(|config| config.given[0].name = "small".into());
    assert!(message.contains("given `small`"), "{message}");
    let message = wrong(|config| config.given[0].runs.clear());
    assert!(message.contains("given `lidar` has no run"), "{message}");
    let message = wrong(|config| config.side_by_side[0].rows[0].row = "radar".into());
    assert!(message.contains("names row `radar`; there are: small, lidar, kinds, camera"), "{message}");
    // Once they are read.
    let config = ResultsConfig::default();
    let small = TrainConfig::default();
    let mut kinds = small.clone();
    kinds.model.head.classes = Classes::Kind;
    let mut lidar = small.clone();
    lidar.model.use_camera = false;
    let known = [("small", &small), ("lidar", &lidar), ("kinds", &kinds)];
    config.check_side_by_side(&known).unwrap();
    let mut asked = config.clone();
    asked.side_by_side[1].rows[0].judge = Judge::Network;
    let message = asked.check_side_by_side(&known).unwrap_err().to_string();
    assert!(message.contains("asks row `kinds` for harm"), "{message}");
    let mut blinded = config;
    blinded.side_by_side[0].rows[0].blind = Some(Sensor::Camera);
    let message = blinded.check_side_by_side(&known).unwrap_err().to_string();
    assert!(message.contains("blinds a sensor of row `lidar`"), "{message}");
}

#[test]
fn the_rows_are_the_ablations_and_see_each_sample_equally_often() {
    let config = ablations();
    let trainings = config.trainings().unwrap();
    assert_eq!(trainings[0].1, TrainConfig::default(), "the headline is what `harmzone train` does");
    let of = |name: &str| &trainings.iter().find(|(n, _)| n == name).unwrap().1;
    let base = of("fused");
    assert!(base.model.use_lidar && base.model.use_camera && base.lidar_stage.epochs == 0);
    assert_eq!(base.model.head.numeric_fusion, NumericFusion::Film);
    assert!(!of("lidar").model.use_camera && !of("camera").model.use_lidar);
    assert_eq!(of("numeric-none").model.head.numeric_fusion, NumericFusion::None);
    assert_eq!(of("numeric-paper").model.head.numeric_fusion, NumericFusion::Paper);
    assert!(of("two-stages").lidar_stage.epochs > 0 && of("two-stages").fused_stage.epochs > 0);
    let bare = &of("unaugmented").augment;
    assert_eq!(
        (bare.mirror, bare.max_pasted, bare.n_redrawn_states, bare.disturbed_share),
        (false, 0, 0, 0.0)
    );
    let epochs = |config: &TrainConfig| config.lidar_stage.epochs + config.fused_stage.epochs;
    assert!(trainings[1..].iter().all(|(_, config)| epochs(config) == epochs(base)));
    // Every row stands in a table.
    let placed = |name: &str| config.tables.iter().flat_map(|table| &table.rows).any(|of| of.row == name);
    assert!(config.rows.iter().all(|row| placed(&row.name)));
    // Repeats differ from their rows in the seed alone.
    for (row, (name, repeat)) in config.repeats().unwrap() {
        let closed_set = config.closed_set_training().unwrap();
        let once = trainings.iter().chain(&closed_set).find(|(name, _)| *name == row).unwrap();
        assert_eq!(TrainConfig { seed: once.1.seed, ..repeat.clone() }, once.1);
        assert_eq!(name, repeat_name(&row, repeat.seed));
    }
    // Every judge is told of one network, which is no other than a table's.
    let judged = |judge| config.rivals.iter().any(|rival| rival.row == "fused" && rival.judge == judge);
    assert!(Judge::ALL.into_iter().all(judged));
}

#[test]
fn what_does_not_fit_is_named() {
    let wrong = |change: fn(&mut ResultsConfig)| {
        let mut config = ablations();
        change(&mut config);
        format!("{:#}", config.trainings().unwrap_err())
    };
    let message = wrong(|config| config.preset = "huge".into());
    assert!(message.contains("huge") && message.contains("small"), "{message}");
    let message = wrong(|config| config.tables[0].rows[0].row = "radar".into());
    assert!(message.contains("radar") && message.contains("lidar"), "{message}");
    let message = wrong(|config| config.closed_set.as_mut().unwrap().set.clear());
    assert!(message.contains("kinds") && message.contains("classes=kind"), "{message}");
    let message = wrong(|config| config.closed_set.as_mut().unwrap().name = "fused".into());
    assert!(message.contains("each name once"), "{message}");
    let message = wrong(|config| config.rivals[0].row = "radar".into());
    assert!(message.contains("rivals") && message.contains("radar"), "{message}");
    let message = wrong(|config| config.side_by_side[0].rows[0].row = "radar".into());
    assert!(message.contains("side_by_side") && message.contains("radar"), "{message}");
    let message = wrong(|config| config.side_by_side[0].rows[0].blind = Some(Sensor::Camera));
    assert!(message.contains("blinds") && message.contains("lidar"), "{message}");
    let seeds = |values: &[u64], row: &str| {
        let seeds = Some(SeedsConfig { values: values.to_vec(), rows: vec![row.to_owned()] });
        let config = ResultsConfig { seeds, ..ablations() };
        format!("{:#}", config.trainings().unwrap_err())
    };
    assert!(seeds(&[1], "radar").contains("radar") && seeds(&[1], "radar").contains("lidar"));
    assert!(seeds(&[1], "small").contains("seeds names row"), "the headline's runs are given");
    assert!(seeds(&[0], "lidar").contains("twice from seed 0") && seeds(&[2, 2], "lidar").contains("twice"));
    let message = wrong(|config| config.side_by_side[0].rows[0].row = "kinds".into());
    assert!(message.contains("asks row `kinds` for harm") && message.contains("zone-expected"), "{message}");
    let message = wrong(|config| config.rows[0].set.push("model.head.classes=kind".into()));
    assert!(message.contains("row `fused` tells kinds"), "{message}");
    let message = wrong(|config| config.side_by_side[0].rows.truncate(1));
    assert!(message.contains("two are needed"), "{message}");
    let message = wrong(|config| config.side_by_side[0].questions[0].row = "LiDAR".into());
    assert!(
        message.contains("asks what `LiDAR` is") && message.contains("camera, LiDAR and black pictures"),
        "{message}"
    );
    let message = wrong(|config| config.rows[0].name = "a/b".into());
    assert!(message.contains("a/b"), "{message}");
    let message = wrong(|config| config.rows[1].name = config.rows[0].name.clone());
    assert!(message.contains("each name once"), "{message}");
    let message = wrong(|config| config.rows[0].set.push("model.use_radar=true".into()));
    assert!(message.contains("use_radar") && message.contains("fused"), "{message}");
    let message = wrong(|config| config.rows[0].set.push("model.head.dropout=nan".into()));
    assert!(message.contains("fused") && message.contains("model.head.dropout is nan"), "{message}");
    let message = wrong(|config| {
        config.rows[0].set.extend(["lidar_stage.epochs=2".into(), "fused_stage.epochs=0".into()]);
    });
    assert!(message.contains("fused_stage.epochs"), "{message}");
}
