//! Labels the objects of an episode by a zone of one's own config, beside a rule in three lines of code.
//!
//! `cargo run --release --example own_zone [EPISODE.mcap [ZONE.toml]]`; without files it makes a small episode and takes
//! the time to collision. `harmzone label` writes the labels of a whole data set.

use std::path::{Path, PathBuf};

use harmzone::config;
use harmzone::episode::EpisodeReader;
use harmzone::geometry::{Box3, Ego};
use harmzone::object::Harm;
use harmzone::sample::EgoState;
use harmzone::zone::{TtcConfig, Zone, ZoneConfig, ZoneKind};

mod made_episode;

/// A rule that no config tells: whatever is closer than one can brake at 6 m/s², to whichever side.
fn harm_within_braking_distance(box_in_ego: &Box3<Ego>, ego: &EgoState) -> Harm {
    let braking_m = ego.speed_mps.powi(2) / (2.0 * 6.0);
    let distance_m = box_in_ego.center.x().hypot(box_in_ego.center.y()) - ego.front_bumper_x_m;
    if distance_m < braking_m { Harm::Harmful } else { Harm::Harmless }
}

fn main() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let mut args = std::env::args_os().skip(1).map(PathBuf::from);
    let episode = args.next().map_or_else(|| made_episode::write(folder.path()), Ok)?;
    let default =
        ZoneConfig { kind: ZoneKind::Ttc, ttc: TtcConfig { horizon_s: 2.0 }, ..ZoneConfig::default() };
    let zone: ZoneConfig = config::load_over(&default, args.next().as_deref(), &[])?;
    // What a file says is checked here, once.
    let zone = Zone::try_from(zone)?;

    println!("{:20} {:16} {:>7}   by the zone   by braking distance", "sample", "object", "x, m");
    for (sample_idx, sample) in EpisodeReader::open(Path::new(&episode))?.samples().enumerate() {
        let sample = sample?;
        let ego = &sample.measured.ego_state;
        let here = zone.at(ego)?;
        for object in sample.objects() {
            let verdict = here.harm_of(&object.box_in_ego, object.velocity_in_ego_mps)?;
            let braking = harm_within_braking_distance(&object.box_in_ego, ego);
            println!(
                "{sample_idx:<20} {:16} {:7.1}   {:11}   {}",
                object.id.as_deref().unwrap_or("?"),
                object.box_in_ego.center.x(),
                verdict.harm.name(),
                braking.name()
            );
        }
    }
    Ok(())
}
