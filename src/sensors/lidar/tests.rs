//! What a wall returns: its range, its intensity, and how weather takes both away.

use nalgebra::Vector3;

use super::*;
use crate::sensors::{IntensityConfig, Rig, RigConfig, Weather, WeatherOverride};

/// A sensor without flaws of its own.
fn quiet() -> RigLidarConfig {
    RigLidarConfig {
        max_range_m: 100.0,
        range_noise_m: 0.0,
        ring_bias_m: 0.0,
        dropout: 0.0,
        dropout_spread: 0.0,
        attenuation_per_m: 0.0,
        // Whole numbers of 255 x.
        intensity: IntensityConfig { scale: 2.55, spread: 0.0, ..IntensityConfig::default() },
        ..RigLidarConfig::default()
    }
}

fn wall(range_m: f64, reflectivity: f64) -> Hit {
    Hit { range_m, cos_incidence: 1.0, reflectivity, is_paved: false, finish: Finish::Matt, leaves_m: 0.0 }
}

/// `n` equal rays on one hit.
fn shots(config: &RigLidarConfig, state: &WeatherState, hit: Hit, n: usize) -> Vec<LidarReturn> {
    let pattern = Pattern { directions: vec![Vector3::x(); n], rings: vec![0; n] };
    Receiver::new(config, 1, state, 7).returns(&pattern, &vec![hit; n], Turn::Sample(0))
}

fn fog_of(mor_m: f64) -> WeatherState {
    let by = WeatherOverride { mor_m: Some(mor_m), ..WeatherOverride::default() };
    Weather::FogNoon.state().replace_by(&by).unwrap()
}

fn clear() -> WeatherState {
    Weather::ClearNoon.state()
}

#[test]
fn half_the_reflectivity_at_sixty_degrees_gives_a_quarter_of_the_intensity() {
    let hit = Hit { cos_incidence: 0.5, ..wall(10.0, 0.5) };
    let found = shots(&quiet(), &clear(), hit, 1)[0].point;
    // 63.75 * exp(-2 * 10 m * 3.0 / 20 km) * 0.9976 = 63.4: clear air, and the peak of a pulse whose spot of 30 mm lies
    // over 52 mm of ranges (`surface::peak_kept`).
    assert_eq!((found.x_m, found.intensity, found.ring), (10.0, 63.0, 0));
}

#[test]
fn a_wall_returns_its_distance_within_the_noise() {
    let config = RigLidarConfig { range_noise_m: 0.02, dropout: 0.1, ..quiet() };
    let n = 20_000;
    let found = shots(&config, &clear(), wall(20.0, 0.5), n);
    assert!((found.len() as f64 / n as f64 - 0.9).abs() < 0.01, "{}", found.len());
    let errors = found.iter().map(|r| f64::from(r.point.x_m) - 20.0);
    let mean_m = errors.clone().sum::<f64>() / found.len() as f64;
    let spread_m = (errors.map(|e| e * e).sum::<f64>() / found.len() as f64).sqrt();
    assert!(mean_m.abs() < 0.001 && (spread_m - 0.02).abs() < 0.001, "{mean_m} {spread_m}");
}

#[test]
fn mean_intensity_on_a_wall_falls_with_range_as_the_formula_says() {
    let config = RigLidarConfig { range_noise_m: 0.02, attenuation_per_m: 0.004, ..quiet() };
    for state in [clear(), fog_of(300.0)] {
        for range_m in [5.0, 20.0, 40.0, 60.0] {
            let found = shots(&config, &state, wall(range_m, 0.6), 2000);
            let targets: Vec<_> = found.iter().filter(|r| r.reflector == Reflector::Target).collect();
            let mean =
                targets.iter().map(|r| f64::from(r.point.intensity)).sum::<f64>() / targets.len() as f64;
            let alpha = 20f64.ln() / state.mor_m + 0.004;
            let wanted = 255.0 * 0.6 * (-2.0 * alpha * range_m).exp();
            assert!((mean - wanted).abs() < 0.6, "{range_m} m: {mean} against {wanted}");
        }
    }
}

#[test]
fn what_is_out_of_range_does_not_return() {
    for range_m in [100.5, f64::INFINITY] {
        assert!(shots(&quiet(), &clear(), wall(range_m, 1.0), 10).is_empty());
    }
}

#[test]
fn a_weak_target_is_detected_as_often_as_its_power_says() {
    // Half of the threshold's power: reflectivity 0.05 at the sure range.
    let n = 20_000;
    let state = WeatherState { mor_m: 1e9, ..clear() };
    let share = shots(&quiet(), &state, wall(99.99, 0.05), n).len() as f64 / n as f64;
    assert!((share - 0.5).abs() < 0.02, "{share}");
}

#[test]
fn in_fog_returns_beyond_fifty_metres_fall_by_the_two_way_transmission() {
    let (fog, n) = (fog_of(50.0), 1_000_000);
    for range_m in [50.5, 55.0] {
        // As strong as the threshold in clear air, so that only the fog loses points.
        let target = wall(range_m, 1e-5 * range_m * range_m);
        let clear_air = WeatherState { mor_m: 1e9, ..clear() };
        let before = shots(&quiet(), &clear_air, target, n / 100).len() * 100;
        let pattern = Pattern { directions: vec![Vector3::x(); n], rings: vec![0; n] };
        let receiver = Receiver::new(&quiet(), 1, &fog, 7);
        let targets_only = Receiver { soft_returns: None, ..receiver };
        let after = targets_only.returns(&pattern, &vec![target; n], Turn::Sample(0)).len();
        let ratio = after as f64 / before as f64;
        let transmission = (-2.0 * 20f64.ln() / 50.0 * range_m).exp();
        assert!((ratio / transmission - 1.0).abs() < 0.1, "{range_m} m: {ratio} against {transmission}");
    }
}

#[test]
fn in_fog_soft_returns_take_the_place_of_far_targets_and_lie_near_the_sensor() {
    let found = shots(&quiet(), &fog_of(50.0), wall(50.0, 0.25), 20_000);
    let soft: Vec<_> = found.iter().filter(|r| r.reflector == Reflector::Fog).collect();
    assert!(soft.len() > 1000 && soft.len() > 10 * (found.len() - soft.len()), "{}", soft.len());
    assert!(soft.iter().all(|r| (1.0..12.0).contains(&r.point.x_m)));
    let near = shots(&quiet(), &fog_of(50.0), wall(8.0, 0.25), 1000);
    assert!(near.len() == 1000 && near.iter().all(|r| r.reflector == Reflector::Target));
    assert!(shots(&quiet(), &clear(), wall(f64::INFINITY, 0.25), 1000).is_empty());
}

#[test]
fn hard_rain_scatters_into_the_open_and_widens_the_range_noise() {
    let rain = Weather::HardRainNoon.state();
    let open = shots(&quiet(), &rain, wall(f64::INFINITY, 0.0), 20_000);
    assert!(open.iter().all(|r| r.reflector == Reflector::Rain && r.point.x_m < 12.0));
    assert!((0.01..0.3).contains(&(open.len() as f64 / 20_000.0)), "{}", open.len());
    let spread_m = |state: &WeatherState| {
        let found = shots(&quiet(), state, wall(40.0, 0.25), 5000);
        let targets: Vec<_> = found.iter().filter(|r| r.reflector == Reflector::Target).collect();
        let square: f64 = targets.iter().map(|r| (f64::from(r.point.x_m) - 40.0).powi(2)).sum();
        (square / targets.len() as f64).sqrt()
    };
    assert!(spread_m(&rain) > 0.01 && spread_m(&clear()) < 1e-5);
}

#[test]
fn a_wet_road_returns_less_than_a_dry_one_and_a_wet_wall_as_much() {
    // From the height of the default rig.
    let road = |range_m: f64| Hit {
        range_m,
        cos_incidence: 1.84 / range_m,
        reflectivity: 0.2,
        is_paved: true,
        finish: Finish::Rough,
        leaves_m: 0.0,
    };
    let count = |state: &WeatherState, hit| shots(&quiet(), state, hit, 5000).len();
    let (dry, wet) = (clear(), Weather::WetNoon.state());
    let by = WeatherOverride { wetness: Some(1.0), ..WeatherOverride::default() };
    let flooded = wet.replace_by(&by).unwrap();
    assert!(count(&wet, road(35.0)) < 4 * count(&dry, road(35.0)) / 5);
    // Half of the returns are left at 54 m on dry ground, 38 m on wet ground and 24 m under water.
    for (state, half_m) in [(&dry, 54.0), (&wet, 38.4), (&flooded, 24.4)] {
        let share = |range_m| count(state, road(range_m)) as f64 / 5000.0;
        assert!((share(half_m) - 0.5).abs() < 0.05, "{half_m} m: {}", share(half_m));
        assert!(share(0.75 * half_m) == 1.0 && share(1.5 * half_m) < 0.2);
    }
    assert_eq!(count(&wet, wall(20.0, 0.2)), count(&dry, wall(20.0, 0.2)));
}

#[test]
fn beams_end_some_way_among_leaves_and_none_before_them() {
    let leaves = Hit { finish: Finish::Leafy, leaves_m: 0.6, ..wall(10.0, 0.5) };
    let found = shots(&quiet(), &clear(), leaves, 5000);
    assert_eq!(found.len(), 5000);
    let ways_m: Vec<f64> = found.iter().map(|r| f64::from(r.point.x_m) - 10.0).collect();
    assert!(ways_m.iter().all(|way_m| (-1e-5..0.601).contains(way_m)));
    // Mean of 1 / 4 m, cut at 0.6 m: 0.25 - 0.6 * 0.0907 / 0.9093 = 0.190.
    let mean_m = ways_m.iter().sum::<f64>() / 5000.0;
    assert!((mean_m - 0.190).abs() < 0.008, "{mean_m}");
    // The same beams on a wall have the same noise.
    let noisy = RigLidarConfig { range_noise_m: 0.02, ..quiet() };
    let [a, b] = [wall(10.0, 0.5), leaves].map(|hit| shots(&noisy, &clear(), hit, 20));
    assert_eq!([a.len(), b.len()], [20; 2]);
    for (i, way_m) in ways_m.iter().take(20).enumerate() {
        let farther_m = f64::from(b[i].point.x_m - a[i].point.x_m);
        assert!((farther_m - way_m).abs() < 1e-5, "{i}: {farther_m} of {way_m}");
    }
}

#[test]
fn rings_differ_in_offset_and_dropout_as_stated() {
    let config = RigLidarConfig { ring_bias_m: 0.05, dropout: 0.2, dropout_spread: 0.5, ..quiet() };
    let n = 4000;
    let rings: Vec<u16> = (0..32).flat_map(|ring| std::iter::repeat_n(ring, n)).collect();
    let pattern = Pattern { directions: vec![Vector3::x(); rings.len()], rings };
    let found = Receiver::new(&config, 32, &clear(), 9).returns(
        &pattern,
        &vec![wall(20.0, 1.0); 32 * n],
        Turn::Sample(0),
    );
    let of_ring = |ring: u16| found.iter().filter(move |r| r.point.ring == ring);
    let offsets: Vec<f64> =
        (0..32).map(|ring| f64::from(of_ring(ring).next().unwrap().point.x_m) - 20.0).collect();
    let spread_m = (offsets.iter().map(|o| o * o).sum::<f64>() / 32.0).sqrt();
    assert!((0.03..0.08).contains(&spread_m), "{spread_m}");
    let lost: Vec<f64> = (0..32).map(|ring| 1.0 - of_ring(ring).count() as f64 / n as f64).collect();
    assert!(lost.iter().all(|share| (0.08..0.32).contains(share)), "{lost:?}");
    let most = lost.iter().copied().fold(0.0, f64::max);
    let least = lost.iter().copied().fold(1.0, f64::min);
    assert!(most - least > 0.12, "{lost:?}");
}

#[test]
fn every_preset_fires_its_beams_from_the_lowest_to_the_highest() {
    for (name, n_beams, low_deg, high_deg) in [
        ("hdl32e", 32, -30.667, 10.667),
        ("vlp16", 16, -15.0, 15.0),
        ("hdl64e", 64, -24.85, 4.9),
        ("os1-128", 128, -21.82, 20.95),
    ] {
        let config: RigConfig = toml::from_str(&format!("[lidars.lidar_top]\npreset = \"{name}\"")).unwrap();
        let rig = Rig::try_from(&config).unwrap();
        assert_eq!(rig.top().n_rings, n_beams, "{name}");
        let elevation = |ring: u16| {
            let ray = rig.top().pattern.rings.iter().position(|&r| r == ring).unwrap();
            rig.top().pattern.directions[ray].z.asin().to_degrees()
        };
        assert!((elevation(0) - low_deg).abs() < 1e-3, "{name}");
        assert!((elevation(n_beams as u16 - 1) - high_deg).abs() < 1e-3, "{name}");
    }
}
