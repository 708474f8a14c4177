//! A data set as a folder of nuScenes: 13 tables, clouds, pictures, poses, CAN bus, a map mask a log.
//!
//! nuscenes-devkit and mmdetection3d read it unmodified. Both know official scene names only, and which of them are for training:
//! so scenes get such names by their split.

mod calendar;
mod cameras;
mod can_bus;
mod files;
mod layout;
mod map_mask;
mod naming;
mod scene;
mod tables;
mod tokens;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use serde::Serialize;
use serde_json::json;

use super::{DataSource, ExportError, MARKER};
use crate::episode::{EpisodeEntry, Split};
use crate::files::NewFolder;
use crate::nuscenes::{
    AttributeRow, CategoryRow, MapRow, SceneSection, SensorRow, Token, VisibilityRow, scene_names,
};
use crate::progress::Progress;
use layout::CONTENT;
use scene::{Placement, SceneRows, VISIBILITIES};
use tables::Tables;

pub use map_mask::GlobalFrames;
pub use naming::Naming;
pub use tokens::sample_token;

/// Which folders of tables are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Release {
    /// `v1.0-trainval` and `v1.0-test`: up to 685, 150 and 144 scenes.
    Full,
    /// `v1.0-mini`: up to 8 scenes to train and 2 to validate.
    Mini,
}

impl Release {
    pub const ALL: [Self; 2] = [Self::Full, Self::Mini];

    /// The name in flags, which is also that of mmdetection3d's `--version`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "v1.0",
            Self::Mini => "v1.0-mini",
        }
    }
}

/// What to export.
#[derive(Debug)]
pub struct NuScenesRequest<'a> {
    pub dataset: &'a Path,
    pub out: &'a Path,
    /// The label set of namings that tell harm.
    pub labels: &'a str,
    pub naming: Naming,
    pub release: Release,
    pub force: bool,
}

/// What was exported.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NuScenesSummary {
    pub versions: BTreeMap<String, VersionCounts>,
    pub n_samples: usize,
    pub n_annotations: usize,
    /// Channels of cameras that the episodes lack.
    pub black_cameras: Vec<String>,
    /// Episodes without a place in the versions.
    pub left_out: Vec<String>,
}

/// Scenes of a version's sections.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VersionCounts {
    pub n_scenes: BTreeMap<&'static str, usize>,
}

impl fmt::Display for NuScenesSummary {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (version, counts) in &self.versions {
            let sections: Vec<String> =
                counts.n_scenes.iter().map(|(name, n)| format!("{n} {name}")).collect();
            writeln!(formatter, "{version:<15} scenes: {}", sections.join(", "))?;
        }
        writeln!(formatter, "samples         {}", self.n_samples)?;
        writeln!(formatter, "annotations     {}", self.n_annotations)?;
        if !self.black_cameras.is_empty() {
            writeln!(formatter, "black pictures  {}", self.black_cameras.join(", "))?;
        }
        if !self.left_out.is_empty() {
            writeln!(formatter, "left out        {}", self.left_out.join(", "))?;
        }
        Ok(())
    }
}

/// A folder of tables and the scenes in it.
struct Version {
    name: &'static str,
    sections: Vec<SceneSection>,
    /// Scene names by episode.
    scenes: BTreeMap<String, (SceneSection, String)>,
}

/// Exports a data set.
///
/// # Errors
/// Something is at `out`, labels are missing, there are more episodes than scene names, a file is damaged, or a signal asks to end.
pub fn run(request: &NuScenesRequest<'_>, progress: &dyn Progress) -> Result<NuScenesSummary, ExportError> {
    let source = DataSource::open(request.dataset, request.naming.needs_labels().then_some(request.labels))?;
    let folder = NewFolder::create(request.out, CONTENT, request.force)?;
    let versions = plan(&source, request.release)?;
    let is_used =
        |entry: &&EpisodeEntry| versions.iter().any(|version| version.scenes.contains_key(&entry.name));
    let (used, unused): (Vec<_>, Vec<_>) = source.manifest().episodes.iter().partition(is_used);
    let mut export = Export::start(&source, folder, versions)?;
    progress.start("export", used.iter().map(|entry| entry.n_samples as u64).sum());
    for entry in used {
        progress.note(&entry.name);
        export.add(&source, entry, request.naming, progress)?;
    }
    progress.finish();
    let mut summary = export.finish(request, &source)?;
    summary.left_out = unused.into_iter().map(|entry| entry.name.clone()).collect();
    Ok(summary)
}

/// Gives episodes official scene names. `v1.0-trainval` has the splits train and val, `v1.0-test` the split test, or dev where there is
/// no test; where nothing is for one of both, the other's take its place, since mmdetection3d's converter wants both folders.
fn plan(source: &DataSource, release: Release) -> Result<Vec<Version>, ExportError> {
    let has = |split: Split| source.manifest().of_split(split).next().is_some();
    let of_test = if has(Split::Dev) && !has(Split::Test) { Split::Dev } else { Split::Test };
    let [for_val, for_test] = match (has(Split::Val), has(of_test)) {
        (true, false) => [Split::Val; 2],
        (false, _) => [of_test; 2],
        (true, true) => [Split::Val, of_test],
    };
    let full = [
        ("v1.0-trainval", vec![(SceneSection::Train, Split::Train), (SceneSection::Val, for_val)]),
        ("v1.0-test", vec![(SceneSection::Test, for_test)]),
    ];
    let mini =
        [("v1.0-mini", vec![(SceneSection::MiniTrain, Split::Train), (SceneSection::MiniVal, for_val)])];
    let folders = match release {
        Release::Full => full.to_vec(),
        Release::Mini => mini.to_vec(),
    };
    let name_scenes = |(name, sections): (&'static str, Vec<(SceneSection, Split)>)| {
        let mut scenes = BTreeMap::new();
        for &(section, split) in &sections {
            let (names, n_found) = (scene_names(section), source.manifest().of_split(split).count());
            if n_found > names.len() {
                let message = format!(
                    "{n_found} episodes of split {} and only {} scene names of `{}`; {}",
                    split.name(),
                    names.len(),
                    section.name(),
                    if release == Release::Mini {
                        "`--version v1.0` has more"
                    } else {
                        "export a part of them"
                    }
                );
                return Err(ExportError::Unfit { message, path: source.path().to_owned() });
            }
            scenes.extend(assign(source, split, names).map(|(episode, name)| (episode, (section, name))));
        }
        Ok(Version { name, sections: sections.into_iter().map(|(section, _)| section).collect(), scenes })
    };
    folders.into_iter().map(name_scenes).collect()
}

/// A name for each episode of a split: its own where that is one of them, as of an imported scene, else the next.
fn assign(source: &DataSource, split: Split, names: Vec<String>) -> impl Iterator<Item = (String, String)> {
    let episodes: Vec<&str> = source.manifest().of_split(split).map(|entry| entry.name.as_str()).collect();
    let (kept, free): (Vec<String>, Vec<String>) =
        names.into_iter().partition(|name| episodes.contains(&name.as_str()));
    let mut free = free.into_iter();
    let name = |episode: &str| {
        let own = kept.iter().find(|name| *name == episode).cloned();
        own.or_else(|| free.next()).map(|name| (episode.to_owned(), name))
    };
    episodes.into_iter().filter_map(name).collect::<Vec<_>>().into_iter()
}

/// An export that is being written.
struct Export {
    folder: NewFolder,
    frames: GlobalFrames,
    versions: Vec<(Version, Tables)>,
    /// Each episode's log, which has a mask of its own.
    logs: Vec<(String, Token)>,
    /// Beginnings and ends of the scenes so far.
    times_us: Vec<(u64, u64)>,
    channels: BTreeSet<String>,
    black_channels: BTreeSet<String>,
    categories: BTreeSet<&'static str>,
    n_samples: usize,
    n_annotations: usize,
}

impl Export {
    fn start(source: &DataSource, folder: NewFolder, versions: Vec<Version>) -> Result<Self, ExportError> {
        for inside in ["maps", "can_bus", "samples/LIDAR_TOP", "sweeps/LIDAR_TOP"] {
            folder.make(inside)?;
        }
        let start = |version: Version| {
            let tables = Tables::create(&folder, version.name)?;
            Ok((version, tables))
        };
        let versions: Vec<_> = versions.into_iter().map(start).collect::<std::io::Result<_>>()?;
        Ok(Self {
            frames: GlobalFrames::of(source)?,
            folder,
            versions,
            logs: Vec::new(),
            times_us: Vec::new(),
            channels: BTreeSet::new(),
            black_channels: BTreeSet::new(),
            categories: BTreeSet::new(),
            n_samples: 0,
            n_annotations: 0,
        })
    }

    fn add(
        &mut self,
        source: &DataSource,
        entry: &EpisodeEntry,
        naming: Naming,
        progress: &dyn Progress,
    ) -> Result<(), ExportError> {
        let episode = source.episode(entry)?;
        if episode.reader.is_empty() {
            let message = format!("episode `{}` holds no sample; a scene has one at least", entry.name);
            return Err(ExportError::Unfit { message, path: episode.reader.path().to_owned() });
        }
        let place = Placement {
            global_from_world: self.frames.global_from_world(&entry.name),
            delay_us: self.delay_us(episode.reader.times_ns()),
        };
        let mut rows = scene::write(&episode, &place, naming, &self.folder, progress)?;
        let of_cameras = episode.reader.cameras().iter().map(|camera| cameras::channel_of(camera));
        self.channels.extend(of_cameras.chain([files::LIDAR.to_owned(), cameras::front()]));
        let missing = cameras::missing(episode.reader.cameras());
        self.black_channels.extend(missing.iter().map(|camera| camera.channel.to_owned()));
        self.categories.extend(&rows.categories);
        let mut mask = std::io::Cursor::new(Vec::new());
        let drawn = self.frames.mask(&entry.name, &episode.reader.map()?);
        drawn.write_to(&mut mask, image::ImageFormat::Png).expect("a mask has a PNG form");
        self.folder.write(&mask_file(&entry.name), mask.get_ref())?;
        self.logs.push((entry.name.clone(), rows.log.token.clone()));
        for (version, tables) in &mut self.versions {
            if let Some((_, name)) = version.scenes.get(&entry.name) {
                rows.scene.name.clone_from(name);
                add_rows(tables, &rows)?;
                rows.can.write(&self.folder, name)?;
            }
        }
        self.n_samples += rows.samples.len();
        self.n_annotations += rows.annotations.len();
        Ok(())
    }

    /// Whole hours by which an episode must be put off so that no two scenes overlap in time: simulated ones all begin at the same
    /// time, and tools sort scenes and samples by theirs.
    fn delay_us(&mut self, times_ns: &[u64]) -> u64 {
        const HOUR_US: u64 = 3_600_000_000;
        let [begin_us, end_us] =
            [times_ns.first(), times_ns.last()].map(|time| time.copied().unwrap_or_default() / 1000);
        let is_free = self.times_us.iter().all(|&(begin, end)| end < begin_us || end_us < begin);
        let busy_until_us = self.times_us.iter().map(|&(_, end)| end).max().unwrap_or_default();
        let delay_us = if is_free {
            0
        } else {
            (busy_until_us + 1 - begin_us.min(busy_until_us)).div_ceil(HOUR_US) * HOUR_US
        };
        self.times_us.push((begin_us + delay_us, end_us + delay_us));
        delay_us
    }

    /// Writes what all scenes share, and gives the folder its name.
    fn finish(
        mut self,
        request: &NuScenesRequest<'_>,
        source: &DataSource,
    ) -> Result<NuScenesSummary, ExportError> {
        if !self.black_channels.is_empty() {
            self.folder.write(scene::BLACK, &cameras::black_picture())?;
        }
        self.channels.extend(self.black_channels.iter().cloned());
        for (version, tables) in &mut self.versions {
            add_shared_rows(tables, &self.channels, &self.categories)?;
            for (episode, log) in self.logs.iter().filter(|(episode, _)| version.scenes.contains_key(episode))
            {
                let (token, filename) = (Token::of("map", episode), mask_file(episode));
                let log_tokens = vec![log.clone()];
                tables.add(&MapRow { token, log_tokens, category: "semantic_prior".into(), filename })?;
            }
        }
        let mut versions = BTreeMap::new();
        for (version, tables) in self.versions {
            tables.finish()?;
            let count =
                |section: SceneSection| version.scenes.values().filter(|(of, _)| *of == section).count();
            let n_scenes = version.sections.iter().map(|&section| (section.name(), count(section))).collect();
            versions.insert(version.name.to_owned(), VersionCounts { n_scenes });
        }
        let marker = json!({
            "format": "nuscenes",
            "generator_version": env!("CARGO_PKG_VERSION"),
            "dataset_config_sha256": source.manifest().config_sha256,
            "labels": request.naming.needs_labels().then_some(request.labels),
            "categories": request.naming.name(),
            "version": request.release.name(),
        });
        let marker = serde_json::to_vec_pretty(&marker).expect("a marker has a JSON form");
        self.folder.write(MARKER, &marker)?;
        self.folder.finish()?;
        Ok(NuScenesSummary {
            versions,
            n_samples: self.n_samples,
            n_annotations: self.n_annotations,
            black_cameras: self.black_channels.into_iter().collect(),
            left_out: Vec::new(),
        })
    }
}

fn mask_file(episode: &str) -> String {
    format!("maps/{}.png", Token::of("map", episode))
}

fn add_rows(tables: &mut Tables, rows: &SceneRows) -> std::io::Result<()> {
    tables.add(&rows.log)?;
    tables.add(&rows.scene)?;
    tables.add_all(&rows.samples)?;
    tables.add_all(&rows.data)?;
    tables.add_all(&rows.poses)?;
    tables.add_all(&rows.calibrations)?;
    tables.add_all(&rows.annotations)?;
    tables.add_all(&rows.instances)
}

/// Categories, attributes, visibilities and sensors.
fn add_shared_rows(
    tables: &mut Tables,
    channels: &BTreeSet<String>,
    categories: &BTreeSet<&'static str>,
) -> std::io::Result<()> {
    let description = String::new;
    for &name in categories {
        let token = Token::of("category", name);
        tables.add(&CategoryRow { token, name: name.to_owned(), description: description() })?;
    }
    for name in crate::nuscenes::ATTRIBUTES {
        let token = Token::of("attribute", name);
        tables.add(&AttributeRow { token, name: name.to_owned(), description: description() })?;
    }
    for (_, token, level) in VISIBILITIES {
        let description = format!("visible share of the whole object is {} %", &level[1..]);
        tables.add(&VisibilityRow { token: Token::from(token), level: level.to_owned(), description })?;
    }
    for channel in channels {
        let modality = if channel == files::LIDAR { "lidar" } else { "camera" };
        let token = Token::of("sensor", channel);
        tables.add(&SensorRow { token, channel: channel.clone(), modality: modality.to_owned() })?;
    }
    Ok(())
}
