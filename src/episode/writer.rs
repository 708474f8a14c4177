//! Writes an episode: every topic of `docs/episode_format.md`, one chunk a sample.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use foxglove::messages as fox;
use fs_err as fs;

use super::archive::ArchiveWriter;
use super::convert;
use super::drawing::{self, MapDrawing};
use super::error::{EpisodeError, Fault};
use super::manifest::ObjectCounts;
use super::messages::{fox_parts, fox_time, wire};
use super::{EpisodeMeta, topics};
use crate::files::sha256_hex;
use crate::geometry::{Camera, Frame, Lidar, World};
use crate::sample::Sample;

/// What a finished episode holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FinishedEpisode {
    pub path: PathBuf,
    pub n_samples: usize,
    /// Annotated boxes, each sample counted anew.
    pub n_objects: ObjectCounts,
    /// Content hash of the file.
    pub sha256: String,
}

/// An episode being written under a partial name; dropped unfinished, it leaves nothing.
pub struct EpisodeWriter {
    archive: ArchiveWriter,
    meta: EpisodeMeta,
    map: MapDrawing,
    channels: Channels,
    n_objects: ObjectCounts,
    n_samples: usize,
    last_ns: Option<u64>,
}

struct Channels {
    map: u16,
    tf: u16,
    pose: u16,
    state: u16,
    image: u16,
    camera: u16,
    lidar: u16,
    objects: u16,
    markers: u16,
}

impl EpisodeWriter {
    /// Starts an episode; the folder must exist, and a file of that name is replaced on finish.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &EpisodeMeta, map: &MapDrawing) -> Result<Self, EpisodeError> {
        let mut archive = ArchiveWriter::create(path)?;
        let channels = Channels {
            map: archive.channel::<fox::SceneUpdate>(topics::MAP)?,
            tf: archive.channel::<fox::FrameTransforms>(topics::TF)?,
            pose: archive.channel::<fox::PoseInFrame>(topics::EGO_POSE)?,
            state: archive.channel::<wire::EgoState>(topics::EGO_STATE)?,
            image: archive.channel::<fox::CompressedImage>(topics::IMAGE)?,
            camera: archive.channel::<fox::CameraCalibration>(topics::CAMERA_INFO)?,
            lidar: archive.channel::<fox::PointCloud>(topics::LIDAR)?,
            objects: archive.channel::<wire::Objects>(topics::OBJECTS)?,
            markers: archive.channel::<fox::SceneUpdate>(topics::MARKERS)?,
        };
        Ok(Self {
            archive,
            meta: meta.clone(),
            map: map.clone(),
            channels,
            n_objects: ObjectCounts::default(),
            n_samples: 0,
            last_ns: None,
        })
    }

    /// Adds a sample; its time must be after the one before.
    ///
    /// # Errors
    /// A number that is not finite, a box without size, two objects of one id, a time that does not
    /// advance, or the disk.
    pub fn write(&mut self, sample: &Sample) -> Result<(), EpisodeError> {
        convert::check_sample(sample).and_then(|()| check_ids(sample)).map_err(|fault| {
            EpisodeError::Invalid {
                episode: self.meta.name.clone(),
                sample_idx: self.n_samples,
                fault: Box::new(fault),
                path: self.archive.path.clone(),
            }
        })?;
        self.write_unchecked(sample)
    }

    pub(super) fn write_unchecked(&mut self, sample: &Sample) -> Result<(), EpisodeError> {
        let (measured, objects) = (&sample.measured, &sample.truth.objects);
        let (time_ns, idx) = (measured.time_ns, self.n_samples);
        super::check_time_order(&mut self.last_ns, time_ns, idx, &self.archive.path)?;
        let (archive, ids) = (&mut self.archive, &self.channels);
        if idx == 0 {
            archive.message(ids.map, idx, time_ns, &drawing::map_update(time_ns, &self.map))?;
        }
        let transforms = fox::FrameTransforms {
            transforms: vec![
                convert::transform_message(time_ns, &measured.world_from_ego),
                convert::transform_message(time_ns, &measured.ego_from_lidar),
                convert::transform_message(time_ns, &measured.ego_from_camera),
            ],
        };
        archive.message(ids.tf, idx, time_ns, &transforms)?;
        let (position, orientation) = fox_parts(&measured.world_from_ego);
        let pose = fox::PoseInFrame {
            timestamp: Some(fox_time(time_ns)),
            frame_id: World::NAME.to_owned(),
            pose: Some(fox::Pose { position: Some(position), orientation: Some(orientation) }),
        };
        archive.message(ids.pose, idx, time_ns, &pose)?;
        archive.message(ids.state, idx, time_ns, &convert::state_message(time_ns, &measured.ego_state))?;
        let image = convert::image_message(time_ns, Camera::NAME, &measured.image);
        archive.message(ids.image, idx, time_ns, &image)?;
        let camera = convert::camera_message(time_ns, Camera::NAME, &measured.intrinsics);
        archive.message(ids.camera, idx, time_ns, &camera)?;
        let cloud = convert::cloud_message(time_ns, Lidar::NAME, &measured.points);
        archive.message(ids.lidar, idx, time_ns, &cloud)?;
        archive.message(ids.objects, idx, time_ns, &convert::objects_message(time_ns, objects))?;
        archive.message(ids.markers, idx, time_ns, &drawing::truth_markers(time_ns, objects))?;
        archive.end_chunk()?;
        for object in objects {
            *self.n_objects.get_mut(object.distribution).get_mut(object.kind) += 1;
        }
        self.n_samples += 1;
        Ok(())
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// No sample was written, or the disk.
    pub fn finish(mut self) -> Result<FinishedEpisode, EpisodeError> {
        let path = self.archive.path.clone();
        if self.n_samples == 0 {
            return Err(EpisodeError::Empty { path });
        }
        let meta = EpisodeMeta { n_samples: self.n_samples, ..self.meta };
        self.archive.metadata(EpisodeMeta::RECORD, meta.to_record())?;
        let scene = [
            ("name", meta.name.clone()),
            ("description", format!("{} in {}, seed {}", meta.weather, meta.town, meta.seed)),
            ("location", meta.town.clone()),
            ("vehicle", "harmzone ego".to_owned()),
        ];
        let scene = scene.map(|(key, value)| (key.to_owned(), value)).into_iter().collect::<BTreeMap<_, _>>();
        self.archive.metadata("scene-info", scene)?;
        self.archive.finish()?;
        let sha256 = sha256_hex(&fs::read(&path)?);
        Ok(FinishedEpisode { path, n_samples: self.n_samples, n_objects: self.n_objects, sha256 })
    }
}

#[cfg(test)]
impl EpisodeWriter {
    /// One message too many on one topic.
    pub(super) fn extra_objects_for_test(&mut self, time_ns: u64) {
        let message = convert::objects_message(time_ns, &[]);
        self.archive.message(self.channels.objects, 1, time_ns, &message).expect("a test's disk has room");
    }
}

fn check_ids(sample: &Sample) -> Result<(), Fault> {
    let mut ids: Vec<&str> = sample.truth.objects.iter().map(|object| object.id.as_str()).collect();
    ids.sort_unstable();
    match ids.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(Fault::new("id", "there twice", "each object needs its own").of(pair[0])),
        None => Ok(()),
    }
}
