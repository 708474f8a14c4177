//! Poses that a bag does not give.

use harmzone::episode::EpisodeReader;
use harmzone::import::ros2::{FieldMapping, MappingConfig, list};
use harmzone::import::{ImportConfig, LogFormat};

use super::{data, import, made};

/// Speed and steering make the poses where nothing gives them; the car's length is the config's where the mapping has none.
#[test]
fn poses_are_added_up_with_the_configs_wheelbase() {
    let text = list(&data().join("odd")).unwrap().replace("unit = \"rad\"", "unit = \"deg\"");
    let mut mapping: MappingConfig = toml::from_str(&text).unwrap();
    mapping.frames.base_height_m = Some(0.3);
    (mapping.poses.topic, mapping.yaw_rate) = (String::new(), FieldMapping::default());
    let folder = tempfile::tempdir().unwrap();
    import(&data().join("odd"), Some(mapping), folder.path(), false).unwrap();
    let episode = EpisodeReader::open(&folder.path().join("episodes/odd.mcap")).unwrap();
    let poses = &episode.log().unwrap().methods["poses"];
    assert!(poses.starts_with("speed and steering"), "{poses}");
    let made = made("odd");
    let at = |i: usize| episode.sample(i).unwrap().measured;
    let (first, last) = (at(0), at(episode.len() - 1));
    let span_s = (last.time_ns - first.time_ns) as f64 * 1e-9;
    let turned = (first.world_from_ego.inverse() * last.world_from_ego).yaw_rad();
    let wheelbase_m = ImportConfig::shipped(LogFormat::Ros2).vehicle.wheelbase_m;
    let wanted = made.speed_mps * made.steering_rad.tan() / wheelbase_m * span_s;
    assert!(wanted.abs() > 1e-3 && (turned - wanted).abs() < 0.05 * wanted.abs(), "{turned} {wanted}");
}
