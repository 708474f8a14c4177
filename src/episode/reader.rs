//! Reads an episode back, sample by sample, and refuses values that no consumer could use.

use std::path::Path;

use super::archive_reader::Archive;
use super::error::{EpisodeError, MessageFault};
use super::{EpisodeMeta, convert, objects, topics};
use crate::sample::{Measured, Sample, Truth};

/// An episode of which the index has been read; samples are read when asked for.
///
/// No file stays open in between, so that a data set may hold thousands.
///
/// ```
/// # use harmzone::episode::{EpisodeMeta, EpisodeWriter, MapDrawing};
/// # use harmzone::geometry::{Pinhole, Transform};
/// # use harmzone::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Sample, Truth};
/// use harmzone::episode::EpisodeReader;
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("oldtown-ClearNoon-7.mcap");
/// # let text = String::new;
/// # let meta = EpisodeMeta {
/// #     name: "oldtown-ClearNoon-7".into(), seed: 7, town: "oldtown".into(), weather: "ClearNoon".into(), ood: false,
/// #     generator_version: text(), config_toml: text(), rig_toml: text(), n_samples: 1,
/// # };
/// # let measured = Measured {
/// #     time_ns: 1_700_000_000_000_000_000,
/// #     ego_state: EgoState {
/// #         speed_mps: 8.0, steering_angle_rad: 0.0, yaw_rate_rps: 0.0, acceleration_mps2: 0.0, wheelbase_m: 2.7,
/// #         front_bumper_x_m: 3.6,
/// #     },
/// #     world_from_ego: Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0),
/// #     ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.0),
/// #     ego_from_camera: Transform::from_xyz_yaw(1.5, 0.0, 1.6, 0.0),
/// #     intrinsics: Pinhole::from_horizontal_fov(800, 450, 1.2),
/// #     image: EncodedImage { format: ImageFormat::Png, bytes: Vec::new() },
/// #     points: vec![LidarPoint { x_m: 10.0, y_m: 0.0, z_m: -1.0, intensity: 20.0, ring: 3 }],
/// # };
/// # let mut writer = EpisodeWriter::create(&path, &meta, &MapDrawing::default())?;
/// # writer.write(&Sample { measured, truth: Truth::default() })?;
/// # writer.finish()?;
/// let episode = EpisodeReader::open(&path)?;
/// assert_eq!(episode.meta().town, "oldtown");
/// for sample in episode.samples() {
///     let sample = sample?;
///     let n_points = sample.measured.points.len();
///     println!("{} m/s, {n_points} LiDAR points", sample.measured.ego_state.speed_mps);
///     println!("{} objects around", sample.truth.objects.len());
/// }
/// let third = episode.sample(2);
/// assert_eq!(third.unwrap_err().to_string().split(": ").next(), Some("there is no sample 2; the file has 1"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct EpisodeReader {
    archive: Archive,
    meta: EpisodeMeta,
    times_ns: Vec<u64>,
}

impl EpisodeReader {
    /// Opens an episode and checks its topics, schemas and counts.
    ///
    /// # Errors
    /// A truncated or damaged file, an MCAP that is not an episode, missing metadata, or topics that
    /// do not hold one message per sample.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let archive = Archive::open(path, topics::EACH_SAMPLE)?;
        let meta =
            EpisodeMeta::from_record(&archive.metadata(EpisodeMeta::RECORD)?, EpisodeMeta::RECORD, path)?;
        for topic in topics::EACH_SAMPLE {
            archive.check_count(topic.name, meta.n_samples)?;
        }
        let times_ns = archive.times(topics::EGO_STATE)?;
        archive.check_count(topics::EGO_STATE.name, times_ns.len())?;
        Ok(Self { archive, meta, times_ns })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.archive.path
    }

    #[must_use]
    pub fn meta(&self) -> &EpisodeMeta {
        &self.meta
    }

    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.times_ns.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times_ns.is_empty()
    }

    /// Times of the samples, in order.
    #[must_use]
    pub fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    /// Reads one sample.
    ///
    /// # Errors
    /// No such sample, damage, or a value that is not usable: the error names episode, sample,
    /// object and field.
    pub fn sample(&self, sample_idx: usize) -> Result<Sample, EpisodeError> {
        let Some(&time_ns) = self.times_ns.get(sample_idx) else {
            let (n_samples, path) = (self.len(), self.path().to_owned());
            return Err(EpisodeError::NoSample { sample_idx, n_samples, path });
        };
        let messages = self.archive.sample(sample_idx, time_ns)?;
        let tf = messages.one(topics::TF)?;
        let state = messages.one(topics::EGO_STATE)?;
        let image = messages.one(topics::IMAGE)?;
        let camera = messages.one(topics::CAMERA_INFO)?;
        let cloud = messages.one(topics::LIDAR)?;
        let truth = messages.one(topics::OBJECTS)?;
        let build = || -> Result<Sample, MessageFault> {
            let measured = Measured {
                time_ns,
                ego_state: convert::state_of(&state)?,
                world_from_ego: convert::transform_of(&tf)?,
                ego_from_lidar: convert::transform_of(&tf)?,
                ego_from_camera: convert::transform_of(&tf)?,
                intrinsics: convert::camera_of(&camera)?,
                image: convert::image_of(image)?,
                points: convert::points_of(&cloud)?,
            };
            let objects = truth.objects.into_iter().map(objects::object_of).collect::<Result<_, _>>()?;
            Ok(Sample { measured, truth: Truth { objects } })
        };
        build().map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))
    }

    /// All samples in order.
    pub fn samples(&self) -> impl Iterator<Item = Result<Sample, EpisodeError>> + '_ {
        (0..self.len()).map(|sample_idx| self.sample(sample_idx))
    }
}
