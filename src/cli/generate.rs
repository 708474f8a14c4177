//! `harmzone gen`: drives a town and writes a data set of episodes.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;

use super::engine::EngineArgs;
use super::world::WorldArgs;
use super::{Bar, ExitStatus, number, one_of, print_summary, tell};
use crate::config;
use crate::episode::Shard;
use crate::generate::{self, Extent, LidarEngine, RendererName, RunOptions, preset};
use crate::scene::{OwnModels, SceneSplit, bring_in};
use crate::sensors::RigConfig;
use crate::store::{Access, Location};
use crate::text_table::text_table;
use crate::worker::{Engine, Program};

#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// Folder or URL of the data set; the same command again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: Location,
    #[command(flatten)]
    world: WorldArgs,
    /// What the episodes are for: `dev`, to train, to validate and, with --ood, to choose by; or `test`, to report, in
    /// towns and with unfamiliar objects of their own [default: dev]
    #[arg(long, value_parser = one_of(SceneSplit::ALL, SceneSplit::name))]
    split: Option<SceneSplit>,
    /// Samples in each episode, 0.3 s apart [default: 40]
    #[arg(long, value_name = "N", value_parser = number(1..=u32::MAX))]
    samples: Option<u32>,
    /// Folder of own meshes (OBJ, STL, GLB; models.toml in it says what the files do not), placed among the unfamiliar
    /// objects of --ood
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// Go on without meshes of --models that cannot be used
    #[arg(long, requires = "models")]
    skip_bad: bool,
    /// Sensor rig in place of the config's: `front`, `surround` (nuScenes' six cameras and the LiDAR's whole turn), or a TOML
    /// with tables `[cameras.cam_..]` and `[lidars.lidar_..]`; `--set rig...` goes over it
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Renderer of the camera image; `filament` is physically based and needs mujoco-studio and Vulkan
    /// [default: classic]
    #[arg(long, value_parser = one_of(RendererName::ALL, RendererName::name))]
    renderer: Option<RendererName>,
    /// What casts the LiDAR's rays; `mujoco` knows every kind of geom and takes much longer [default: bvh]
    #[arg(long, value_name = "ENGINE", value_parser = one_of(LidarEngine::ALL, LidarEngine::name))]
    lidar_engine: Option<LidarEngine>,
    /// Also write depth, instance and category of each pixel as EXR files under aov/
    #[arg(long)]
    aov: bool,
    /// Make one of N parts, I from 0: every N-th episode, in a folder of its own, which `harmzone merge` joins with the others
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Worker processes of this machine [default: one for each core]
    #[arg(long, value_name = "N", value_parser = number(1..=usize::MAX))]
    jobs: Option<usize>,
    #[command(flatten)]
    engine: EngineArgs,
    /// Config (TOML); configs/gen.toml holds the defaults. It goes over the preset, --set over it, other flags over both
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. render.jpeg_quality=95
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Replace the episodes that another config made in the folder
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: GenerateArgs) -> anyhow::Result<ExitStatus> {
    let cluster = args.engine.cluster()?;
    if cluster.is_some() && args.jobs.is_some() {
        anyhow::bail!(
            "--jobs is for this machine; --engine ray takes --in-flight, and Ray says how much is done at once"
        );
    }
    let (mut config, n_episodes) =
        preset::load(args.world.preset, args.split, args.world.ood, args.config.as_deref(), &args.overrides)?;
    args.world.apply(&mut config);
    if let Some(name) = &args.rig {
        config.rig = RigConfig::named_or_read(name).with_context(|| {
            format!("the rig `{name}` is neither `front`, `surround` nor a TOML file of a rig")
        })?;
        let of_rig: Vec<String> =
            args.overrides.iter().filter(|text| text.trim_start().starts_with("rig.")).cloned().collect();
        config = config::with_overrides(&config, &of_rig)?;
    }
    config.render.renderer = args.renderer.unwrap_or(config.render.renderer);
    config.lidar_engine = args.lidar_engine.unwrap_or(config.lidar_engine);
    config.render.aov |= args.aov;
    config.samples = args.samples.unwrap_or(config.samples);
    let own_models = match &args.models {
        None if !config.scene.own_models.is_empty() => {
            anyhow::bail!("`scene.own_models` is set by --models DIR: give the folder of the meshes")
        }
        None if config.scene.ood && !config.scene.shipped_kinds => {
            anyhow::bail!("`scene.shipped_kinds = false` places your own objects alone: give --models DIR")
        }
        None => None,
        Some(_) if !config.scene.ood => anyhow::bail!("--models places unfamiliar objects: give --ood, too"),
        Some(folder) => {
            let models =
                bring_in(folder, args.skip_bad).with_context(|| format!("--models {}", folder.display()))?;
            tell(table_of(&models));
            config.scene.own_models = models.sha256();
            Some(models)
        }
    };
    let has_losses = own_models.as_ref().is_some_and(|models| !models.bad.is_empty());
    let all_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = RunOptions {
        program: Program::this()?,
        engine: cluster.unwrap_or(Engine::Local { jobs: args.jobs.unwrap_or(all_cores) }),
        force: args.force,
        silence: args.engine.silence(),
        own_models,
    };
    let out = args.out.open(Access::Write)?;
    let extent = Extent { n_episodes: args.world.episodes.unwrap_or(n_episodes), shard: args.shard };
    let summary = generate::run(&config, extent, out.path(), &options, &Bar::default())?;
    print_summary(&summary, args.json)?;
    let has_losses = has_losses || !summary.lost.is_empty();
    Ok(if has_losses { ExitStatus::DoneWithLosses } else { ExitStatus::Done })
}

/// What became of each mesh, and what was guessed.
fn table_of(models: &OwnModels) -> String {
    let header =
        ["model", "category", "l x w x h m", "kg", "triangles", "hulls", "closed"].map(str::to_owned);
    let mut rows = vec![header.to_vec()];
    let mut notes = String::new();
    for model in &models.models {
        let [length_m, width_m, height_m] = model.size_m;
        let [before, after] = model.n_triangles;
        rows.push(vec![
            model.name.clone(),
            model.category.clone(),
            format!("{length_m:.2} x {width_m:.2} x {height_m:.2}"),
            format!("{:.1}", model.mass_kg),
            if before == after { before.to_string() } else { format!("{before} -> {after}") },
            model.n_hulls.to_string(),
            if model.is_watertight { "yes" } else { "no" }.to_owned(),
        ]);
        for note in &model.notes {
            notes += &format!("  {}: {note}\n", model.name);
        }
    }
    for mesh in &models.bad {
        notes += &format!("left out: {}: {}\n", mesh.path.display(), mesh.reason);
    }
    text_table(rows) + notes.trim_end()
}
