//! Reads an episode: what the car measured at each sample, and what was truly there.
//!
//! `cargo run --release --example read_episode [EPISODE.mcap]`; without a file it makes a small one first.

use std::path::PathBuf;

use harmzone::episode::EpisodeReader;
use harmzone::sample::Sample;

mod made_episode;

fn main() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = std::env::args_os().nth(1).map(PathBuf::from);
    let path = path.map_or_else(|| made_episode::write(folder.path()), Ok)?;

    // This reads the index. Samples are read when asked for.
    let episode = EpisodeReader::open(&path)?;
    let meta = episode.meta();
    println!("{}: {} samples in {}, {}", meta.name, episode.len(), meta.town, meta.weather);

    for sample in episode.samples() {
        let Sample { measured, truth } = sample?;
        let picture = measured.image.decode()?;
        println!(
            "{:.1} s: {:.1} m/s, {} LiDAR points, a picture of {}x{}",
            measured.time_ns as f64 * 1e-9,
            measured.ego_state.speed_mps,
            measured.points.len(),
            picture.width(),
            picture.height(),
        );
        for object in truth.map(|truth| truth.objects).unwrap_or_default() {
            let center = object.box_in_ego.center;
            println!(
                "  {} at x {:.1} m, y {:.1} m",
                object.id.as_deref().unwrap_or("?"),
                center.x(),
                center.y()
            );
        }
    }
    Ok(())
}
