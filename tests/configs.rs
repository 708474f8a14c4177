//! Every config with numbers that nobody sane would give: refused in words that name the key, or run to the end.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::sync::{Arc, LazyLock};

use harmzone::config::{Check, InvalidConfig};
use harmzone::dataset::test_data;
use harmzone::eval::judge::Judge;
use harmzone::eval::sweep::{Change, SweepConfig, Swept};
use harmzone::eval::{self, EvalConfig, Mode, Protocol};
use harmzone::generate::{self, CheckedConfig, GenerateConfig};
use harmzone::geometry::{Box3, Point};
use harmzone::model::ModelConfig;
use harmzone::sample::EgoState;
use harmzone::scene::{self, Town};
use harmzone::train::{DryRun, TrainConfig};
use harmzone::zone::{Zone, ZoneConfig, ZoneKind};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// Paths of all keys that hold numbers, lists of numbers included.
fn numeric_keys(table: &Table) -> Vec<Vec<String>> {
    let is_number = |value: &Value| value.is_integer() || value.is_float();
    let mut keys = Vec::new();
    for (key, value) in table {
        match value {
            Value::Table(inner) => {
                keys.extend(numeric_keys(inner).into_iter().map(|rest| [vec![key.clone()], rest].concat()));
            }
            Value::Array(values) if values.iter().any(is_number) => keys.push(vec![key.clone()]),
            value if is_number(value) => keys.push(vec![key.clone()]),
            _ => {}
        }
    }
    keys
}

fn set(table: &mut Table, path: &[String], value: Value) {
    let (last, tables) = path.split_last().unwrap();
    let table = tables.iter().fold(table, |table, key| table[key].as_table_mut().unwrap());
    table.insert(last.clone(), value);
}

fn number() -> impl Strategy<Value = Value> {
    let floats = [0.0, -1.0, -0.5, 0.5, 1.5, 1e-9, 1e-3, 30.0, 200.0, 1e4, 1e9, f64::NAN, f64::INFINITY];
    let whole = [0, -1, 1, 2, 3, 7, 64, 1000, 100_000, i64::MAX];
    prop_oneof![
        select(floats.to_vec()).prop_map(Value::Float),
        select(whole.to_vec()).prop_map(Value::Integer)
    ]
}

fn value() -> impl Strategy<Value = Value> {
    let list = (number(), select(vec![0, 1, 2, 3, 4, 100_000]))
        .prop_map(|(value, length)| Value::Array(vec![value; length]));
    let rising = (1.0..3000.0_f64, 2..9).prop_map(|(last, n)| {
        Value::Array((0..n).map(|i| Value::Float(last * f64::from(i) / f64::from(n))).collect())
    });
    let pair = (number(), number()).prop_map(|(a, b)| Value::Array(vec![a, b]));
    prop_oneof![3 => number(), 1 => list, 1 => rising, 1 => pair]
}

/// Up to three keys, by their place among the numeric ones, and what they are set to.
fn changes() -> impl Strategy<Value = Vec<(Index, Value)>> {
    prop::collection::vec((any::<Index>(), value()), 1..4)
}

/// Lays the changes over a config; `run` gets it where its types fit, and says what was refused.
fn try_changes<T: Check + DeserializeOwned + Serialize>(
    base: &T,
    changes: &[(Index, Value)],
    run: impl FnOnce(&T) -> Result<(), InvalidConfig>,
) {
    let mut table = Table::try_from(base).unwrap();
    let keys = numeric_keys(&table);
    let paths: Vec<&Vec<String>> = changes.iter().map(|(index, _)| index.get(&keys)).collect();
    for (path, (_, value)) in paths.iter().zip(changes) {
        set(&mut table, path, value.clone());
    }
    // A list for a number, or a negative count, is told by the TOML reader with the key's line.
    let Ok(config) = table.try_into::<T>() else { return };
    if let Err(error) = run(&config) {
        assert!(error.to_string().starts_with(error.key()) && !error.key().is_empty(), "{error}");
    }
}

fn run_zone(config: &ZoneConfig) -> Result<(), InvalidConfig> {
    for kind in ZoneKind::ALL {
        config.check()?;
        let zone = Zone::try_from(ZoneConfig { kind, ..config.clone() }).unwrap();
        for (speed_mps, steering_angle_rad) in [(0.0, 0.0), (14.0, 0.1), (40.0, -0.6), (-3.0, 0.5)] {
            let ego = EgoState {
                speed_mps,
                steering_angle_rad,
                yaw_rate_rps: 0.0,
                acceleration_mps2: 0.0,
                wheelbase_m: 2.6,
                front_bumper_x_m: 3.3,
            };
            // A zone too wide for the turn is an error of the state, in words.
            let Ok(here) = zone.at(&ego) else { continue };
            let center = Point::new(12.0, 2.0, 0.5);
            let object = Box3 { center, length_m: 4.0, width_m: 2.0, height_m: 1.0, yaw_rad: 0.3 };
            let verdict = here.harm_of(&object, [-3.0, 1.0]);
            assert!(verdict.is_err() || verdict.is_ok_and(|verdict| verdict.overlap_ratio < 1.0 + 1e-6));
        }
    }
    Ok(())
}

fn run_generate(config: &GenerateConfig) -> Result<(), InvalidConfig> {
    static TOWN: LazyLock<Arc<Town>> = LazyLock::new(|| Arc::new(Town::load("oldtown").unwrap()));
    config.check()?;
    let checked = CheckedConfig::try_from(config).unwrap();
    assert_eq!(generate::plan(&checked, 3).len(), 3);
    // A town without a place to start is an error in words.
    let _ = scene::populate(&TOWN, &checked.raw.scene, 1).map_err(|error| error.to_string());
    Ok(())
}

fn run_eval(config: &EvalConfig) -> Result<(), InvalidConfig> {
    let protocol = Protocol::try_from(config.clone())?;
    let dataset = test_data::dataset(3);
    let found = vec![Vec::new(); 3];
    let samples = eval::eval_samples(dataset.samples(), &found);
    eval::evaluate(&samples, &protocol, Mode::Id).unwrap();
    Ok(())
}

fn run_sweep(config: &SweepConfig) -> Result<(), InvalidConfig> {
    config.check()?;
    let dataset = test_data::dataset(2);
    let frames = dataset.first_episodes(config.n_episodes);
    let of_change = |change: Change| change.values(config).iter().map(move |&value| (change, value));
    let values: Vec<(Change, f64)> = Change::ALL.into_iter().flat_map(of_change).collect();
    let found = vec![vec![Vec::new(); 1 + values.len()]; frames.len()];
    let swept = Swept::new(&dataset, frames, values, found, Judge::Network);
    let protocol = Protocol::try_from(EvalConfig { n_resamples: 0, ..EvalConfig::default() }).unwrap();
    // A state in which the ego cannot drive on is an error in words.
    let _ = swept.measure(&config.judges, &protocol).map_err(|error| error.to_string());
    Ok(())
}

fn run_train(config: &TrainConfig) -> Result<(), InvalidConfig> {
    config.check()?;
    let told = DryRun::new(config, 10, [160, 90]).to_string();
    assert!(told.contains("parameters"), "{told}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(256) })]

    #[test]
    fn any_zone_config_is_refused_or_labels(changes in changes()) {
        try_changes(&ZoneConfig::default(), &changes, run_zone);
    }

    #[test]
    fn any_eval_config_is_refused_or_scores(changes in changes()) {
        try_changes(&EvalConfig::default(), &changes, run_eval);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) })]

    #[test]
    fn any_generate_config_is_refused_or_fills_a_town(changes in changes()) {
        let mut config = GenerateConfig::default();
        config.scene.ood = true;
        try_changes(&config, &changes, run_generate);
    }

    #[test]
    fn any_sweep_config_is_refused_or_sweeps(changes in changes()) {
        try_changes(&SweepConfig::default(), &changes, run_sweep);
    }

    #[test]
    fn any_training_config_is_refused_or_can_be_looked_ahead_at(changes in changes()) {
        try_changes(&TrainConfig::default(), &changes, run_train);
    }
}

#[test]
fn spacing_of_zero_is_refused_in_place_of_an_endless_loop() {
    let mut config = GenerateConfig::default();
    (config.scene.ood, config.scene.ood_spacing_m) = (true, [0.0, 0.0]);
    assert_eq!(
        CheckedConfig::try_from(&config).unwrap_err().to_string(),
        "scene.ood_spacing_m is [0.0, 0.0]; two numbers from 1 to 1000, ascending, are needed"
    );
}

/// The scene's keys at both ends of their bounds, all together: the most and the least that a town may be asked for.
#[test]
fn the_ends_of_the_scenes_bounds_fill_a_town() {
    for (route_length_m, reach_m, density, ood_spacing_m) in
        [(10.0, 1.0, 0.0, [1000.0, 1000.0]), (10_000.0, 1000.0, 20.0, [1.0, 1.0])]
    {
        let mut config = GenerateConfig::default();
        let scene = &mut config.scene;
        scene.ood = true;
        (scene.route_length_m, scene.reach_m, scene.ood_spacing_m) = (route_length_m, reach_m, ood_spacing_m);
        (scene.prop_density, scene.parked_density) = (density, density);
        (scene.traffic_density, scene.pedestrian_density) = (density, density);
        run_generate(&config).unwrap();
    }
}

#[test]
fn both_profiles_pass_and_the_model_alone_is_checked_too() {
    for model in [ModelConfig::default(), ModelConfig::paper()] {
        model.check().unwrap();
    }
    TrainConfig::paper().check().unwrap();
    let mut model = ModelConfig::default();
    model.head.n_heads = 5;
    let message = "head.n_heads is 5; it must divide head.channels";
    assert_eq!(model.check().unwrap_err().to_string(), message);
    let config = TrainConfig { model, ..TrainConfig::default() };
    assert_eq!(config.check().unwrap_err().to_string(), format!("model.{message}"));
}
