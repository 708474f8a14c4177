//! A scene as a drive: its key frames with LiDAR, cameras, annotations, and the poses between them.
//!
//! Cloud and picture of a sample have poses of their own. The ego of a sample is the one at the LiDAR's time; a camera's mounting is taken
//! through both poses, as the devkit does: `ego <- world <- ego at the camera's time <- camera`.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Isometry3;

use super::annotations::{self, Annotation};
use super::can_bus;
use super::tables::{LIDAR, Tables};
use crate::episode::MapDrawing;
use crate::files::{self, inside};
use crate::geometry::{Ego, Lidar, Point, Transform, World};
use crate::import::{
    Distortion, Drive, DriveFacts, GroundHeight, ImportConfig, ImportError, Notes, Odometry, RawCamera,
    RawFrame, RawImage, RawPoint, error,
};
use crate::nuscenes::{
    CalibratedSensorRow, PoseFault, SampleDataRow, SampleRow, SceneRow, TableRow, Token, isometry_of,
    read_cloud,
};
use crate::sample::{EncodedImage, ImageFormat};

const NS_PER_US: u64 = 1000;
/// The front camera's channel.
pub(super) const FRONT: &str = "CAM_FRONT";
/// Boxes with fewer points say nothing of a cloud.
const FEW_POINTS: i64 = 5;

/// A scene.
pub(super) struct Scene {
    tables: Arc<Tables>,
    channels: Vec<String>,
    samples: Vec<SampleFiles>,
    times_ns: Vec<u64>,
    facts: DriveFacts,
    odometry: Odometry,
}

/// The files of a sample.
struct SampleFiles {
    token: Token,
    lidar: SensorFile,
    /// In the order of the channels.
    cameras: Vec<Option<SensorFile>>,
}

/// A file with its rows, checked.
#[derive(Clone)]
struct SensorFile {
    row: SampleDataRow,
    path: PathBuf,
    world_from_ego: Transform<World, Ego>,
    ego_from_sensor: Isometry3<f64>,
    matrix: Vec<[f64; 3]>,
}

impl Scene {
    /// Looks up all rows of a scene. `channels` are the cameras', the front one first.
    ///
    /// # Errors
    /// A row that is named is missing, a file is named outside of the data set's folder, or a pose is not valid.
    pub(super) fn open(
        tables: Arc<Tables>,
        row: &SceneRow,
        channels: &[String],
        config: &ImportConfig,
        version: &Path,
    ) -> Result<Self, ImportError> {
        let samples = samples_of(&tables, row, version)?
            .into_iter()
            .map(|sample| files_of(&tables, sample, channels))
            .collect::<Result<Vec<_>, _>>()?;
        let times_ns: Vec<u64> =
            samples.iter().map(|sample| sample.lidar.row.timestamp.saturating_mul(NS_PER_US)).collect();
        let mut odometry = Odometry { poses: poses_of(&tables, row)?, ..Odometry::default() };
        can_bus::add(&mut odometry, &tables.root, &row.name, config.vehicle.steering_ratio)?;
        let log = tables.log.get(&row.log_token, &format!("scene `{}`", row.token))?;
        let town = if log.location.is_empty() { "nuscenes".to_owned() } else { log.location.clone() };
        let facts = DriveFacts {
            path: version.to_owned(),
            town,
            description: row.description.clone(),
            wheelbase_m: positive(log.wheelbase_m),
            front_bumper_x_m: positive(log.front_bumper_x_m),
            is_labelled: !tables.annotation.is_empty(),
            ground: GroundHeight::Known {
                z_m: 0.0,
                source: "nuScenes' ego frame lies on the ground under the rear axle".to_owned(),
            },
            compensated: Some(
                "nuScenes' clouds are compensated, as its paper says; their points have no stamps".to_owned(),
            ),
            rings: None,
            methods: vec![
                (
                    "camera",
                    "its mounting is taken through the poses at the LiDAR's and the picture's time"
                        .to_owned(),
                ),
                ("velocity", "from the neighbouring key frames, as nuscenes-devkit does".to_owned()),
            ],
            map: MapDrawing::default(),
        };
        Ok(Self { tables, channels: channels.to_vec(), samples, times_ns, facts, odometry })
    }

    fn camera(
        &self,
        file: &SensorFile,
        world_from_ego: &Transform<World, Ego>,
        channel: &str,
        notes: &mut Notes,
    ) -> Result<RawCamera, ImportError> {
        let image = picture_at(&file.path, channel, notes)?;
        let &[[fx, skew, cx], [low, fy, cy], last] = file.matrix.as_slice() else {
            let message = format!(
                "calibrated_sensor `{}`: camera_intrinsic has {} rows; 3 are needed",
                file.row.calibrated_sensor_token,
                file.matrix.len()
            );
            return Err(ImportError::at(&self.tables.calibrated_sensor.path, message));
        };
        let ego_from_ego = world_from_ego.isometry.inverse() * file.world_from_ego.isometry;
        Ok(RawCamera {
            name: channel.to_ascii_lowercase(),
            time_ns: file.row.timestamp.saturating_mul(NS_PER_US),
            ego_from_camera: Transform::from_isometry(ego_from_ego * file.ego_from_sensor),
            size_px: Some([file.row.width, file.row.height]),
            k: [fx, skew, cx, low, fy, cy, last[0], last[1], last[2]],
            distortion: Distortion::None,
            image,
        })
    }
}

impl Drive for Scene {
    fn facts(&self) -> &DriveFacts {
        &self.facts
    }

    fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn sample_name(&self, sample_idx: usize) -> Option<String> {
        Some(self.samples[sample_idx].token.to_string())
    }

    fn frame(&self, sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError> {
        let files = &self.samples[sample_idx];
        let world_from_ego = files.lidar.world_from_ego;
        let path = &files.lidar.path;
        let cloud =
            read_cloud(&error::read(path)?).map_err(|fault| ImportError::at(path, fault.to_string()))?;
        let ego_from_lidar = Transform::from_isometry(files.lidar.ego_from_sensor);
        let points: Vec<RawPoint> = cloud.into_iter().map(raw_point).collect();
        let cameras = files.cameras.iter().zip(&self.channels).map(|(file, channel)| {
            file.as_ref().map(|file| self.camera(file, &world_from_ego, channel, notes)).transpose()
        });
        let mut cameras = cameras.collect::<Result<Vec<_>, _>>()?.into_iter();
        let camera = cameras.next().flatten();
        let annotations = annotations::of_sample(&self.tables, &files.token, &world_from_ego)?;
        compare_counts(&annotations, &points, &ego_from_lidar, notes);
        let objects = annotations.into_iter().map(|annotation| annotation.object).collect();
        Ok(RawFrame {
            ego_from_lidar,
            points,
            camera,
            other_cameras: cameras.flatten().collect(),
            objects: self.facts.is_labelled.then_some(objects),
            ignored: Vec::new(),
        })
    }
}

/// A picture; a black one where not even the channel's folder is there, as clouds can be had without pictures.
fn picture_at(path: &Path, channel: &str, notes: &mut Notes) -> Result<RawImage, ImportError> {
    if let Some(folder) = path.parent()
        && !files::is_dir(folder)?
    {
        notes.tell(format!(
            "there are no pictures of {channel} ({} is missing); a black one stands for each",
            folder.display()
        ));
        return Ok(RawImage::Black);
    }
    let bytes = error::read(path)?;
    let format = match bytes.as_slice() {
        [0xff, 0xd8, ..] => ImageFormat::Jpeg,
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        _ => {
            let message = "the picture is neither JPEG nor PNG; one of the two is needed";
            return Err(ImportError::at(path, message));
        }
    };
    Ok(RawImage::Encoded(EncodedImage { format, bytes }))
}

/// A point in the log's own axes; the pipeline turns them.
fn raw_point([x_m, y_m, z_m, intensity, ring]: [f32; 5]) -> RawPoint {
    let ring = (ring.fract() == 0.0 && (0.0..65536.0).contains(&ring)).then_some(ring as u16);
    RawPoint { x_m, y_m, z_m, intensity, ring, time_offset_s: None }
}

/// A length that a log may say; what is none is not taken.
fn positive(length_m: Option<f64>) -> Option<f64> {
    length_m.filter(|length_m| length_m.is_finite() && *length_m > 0.0)
}

/// Tells boxes that are nearly empty where the log counts points: the sign of swapped axes or a wrong pose.
fn compare_counts(
    annotations: &[Annotation],
    points: &[RawPoint],
    ego_from_lidar: &Transform<Ego, Lidar>,
    notes: &mut Notes,
) {
    let place = |point: &RawPoint| *ego_from_lidar * Point::from_coords(point.position_m().into());
    let in_ego: Vec<Point<Ego>> = points.iter().map(place).collect();
    let hit = || annotations.iter().filter(|annotation| annotation.n_lidar_points >= FEW_POINTS);
    let n_said: i64 = hit().map(|annotation| annotation.n_lidar_points).sum();
    let count = |annotation: &Annotation| {
        let bounds = &annotation.object.box_in_ego;
        in_ego.iter().filter(|point| bounds.contains(point, 0.0)).count() as i64
    };
    let n_found: i64 = hit().map(count).sum();
    if 2 * n_found < n_said {
        notes.tell(
            "boxes hold less than half of the LiDAR points that `num_lidar_pts` says; the cloud's axes, the mounting or a pose is wrong",
        );
    }
}

/// The samples of a scene, from the first along `next` to the last.
fn samples_of<'a>(
    tables: &'a Tables,
    scene: &SceneRow,
    version: &Path,
) -> Result<Vec<&'a SampleRow>, ImportError> {
    let fail = |message: String| {
        Err(ImportError::at(&version.join("scene.json"), format!("scene `{}`: {message}", scene.name)))
    };
    let mut samples: Vec<&SampleRow> = Vec::new();
    let (mut token, mut seen) = (&scene.first_sample_token, HashSet::new());
    while !token.is_none() {
        let named_by = samples
            .last()
            .map_or_else(|| format!("scene `{}`", scene.name), |last| format!("sample `{}`", last.token));
        let sample = tables.sample.get(token, &named_by)?;
        if !seen.insert(token) || sample.scene_token != scene.token {
            return fail(format!(
                "its chain of samples leads to `{token}`, which is there twice or of another scene"
            ));
        }
        samples.push(sample);
        token = &sample.next;
    }
    if samples.len() != scene.nbr_samples {
        return fail(format!(
            "its chain has {} samples; nbr_samples says {}",
            samples.len(),
            scene.nbr_samples
        ));
    }
    Ok(samples)
}

fn files_of(tables: &Tables, sample: &SampleRow, channels: &[String]) -> Result<SampleFiles, ImportError> {
    let rows = tables.key_frames.get(&sample.token).map_or(&[][..], Vec::as_slice);
    let files = rows.iter().map(|row| Ok((channel_of(tables, row)?, file_of(tables, row)?)));
    let files = files.collect::<Result<Vec<(&str, SensorFile)>, ImportError>>()?;
    let find = |channel: &str| files.iter().find(|(of, _)| *of == channel).map(|(_, file)| file.clone());
    let Some(lidar) = find(LIDAR) else {
        let message = format!("sample `{}` has no key frame of {LIDAR}", sample.token);
        return Err(ImportError::at(&tables.sample_data_path, message));
    };
    let cameras = channels.iter().map(|channel| find(channel)).collect();
    Ok(SampleFiles { token: sample.token.clone(), lidar, cameras })
}

fn channel_of<'a>(tables: &'a Tables, row: &SampleDataRow) -> Result<&'a str, ImportError> {
    let named_by = format!("sample_data `{}`", row.token);
    let calibration = tables.calibrated_sensor.get(&row.calibrated_sensor_token, &named_by)?;
    Ok(&tables.sensor.get(&calibration.sensor_token, &named_by)?.channel)
}

fn file_of(tables: &Tables, row: &SampleDataRow) -> Result<SensorFile, ImportError> {
    let named_by = format!("sample_data `{}`", row.token);
    let calibration = tables.calibrated_sensor.get(&row.calibrated_sensor_token, &named_by)?;
    let pose = tables.ego_pose.get(&row.ego_pose_token, &named_by)?;
    let mount = isometry_of(calibration.translation, calibration.rotation);
    let mount = mount.map_err(|fault| {
        broken::<CalibratedSensorRow>(&calibration.token, &fault, &tables.calibrated_sensor.path)
    })?;
    let world_from_ego = isometry_of(pose.translation, pose.rotation);
    let world_from_ego = world_from_ego
        .map_err(|fault| broken::<crate::nuscenes::EgoPoseRow>(&pose.token, &fault, &tables.ego_pose.path))?;
    Ok(SensorFile {
        path: path_of(&tables.root, row, &tables.sample_data_path)?,
        row: row.clone(),
        world_from_ego: Transform::from_isometry(world_from_ego),
        ego_from_sensor: mount,
        matrix: calibration.camera_intrinsic.clone(),
    })
}

/// Where the file of a row lies; `table` holds the row.
fn path_of(root: &Path, row: &SampleDataRow, table: &Path) -> Result<PathBuf, ImportError> {
    inside(root, &row.filename)
        .map_err(|error| ImportError::at(table, format!("sample_data `{}`: filename: {error}", row.token)))
}

fn broken<R: TableRow>(token: &Token, fault: &PoseFault, path: &Path) -> ImportError {
    ImportError::at(path, format!("{} `{token}`: {fault}", R::TABLE))
}

/// Nanoseconds, and where the ego is then.
type TimedPose = (u64, Transform<World, Ego>);

/// The poses at the LiDAR's files of a scene, also between its key frames.
fn poses_of(tables: &Tables, scene: &SceneRow) -> Result<Vec<TimedPose>, ImportError> {
    let files = tables.lidar_poses.get(&scene.token).map_or(&[][..], Vec::as_slice);
    let mut poses = Vec::with_capacity(files.len());
    for (time_us, token) in files {
        let row = tables.ego_pose.get(token, &format!("a file of scene `{}`", scene.name))?;
        let pose = isometry_of(row.translation, row.rotation);
        let pose = pose
            .map_err(|fault| broken::<crate::nuscenes::EgoPoseRow>(token, &fault, &tables.ego_pose.path))?;
        poses.push((time_us.saturating_mul(NS_PER_US), Transform::from_isometry(pose)));
    }
    poses.sort_by_key(|(time_ns, _)| *time_ns);
    poses.dedup_by_key(|(time_ns, _)| *time_ns);
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_names_files_in_the_data_sets_folder_alone() {
        let row = |filename: &str| -> SampleDataRow {
            serde_json::from_value(serde_json::json!({
                "token": "d1", "sample_token": "", "ego_pose_token": "", "calibrated_sensor_token": "", "timestamp": 0,
                "fileformat": "jpg", "is_key_frame": true, "height": 0, "width": 0, "filename": filename, "prev": "",
                "next": "",
            }))
            .unwrap()
        };
        let (root, table) =
            (Path::new("/sets/nuscenes"), Path::new("/sets/nuscenes/v1.0-mini/sample_data.json"));
        let path = path_of(root, &row("samples/CAM_FRONT/a.jpg"), table).unwrap();
        assert_eq!(path, root.join("samples/CAM_FRONT/a.jpg"));
        for name in ["../../etc/passwd", "samples/../../../etc/passwd", "/etc/passwd", ""] {
            let told = path_of(root, &row(name), table).unwrap_err().to_string();
            let holds = |word: &str| told.contains(word);
            assert!(holds(&format!("`{name}`")) && holds("`d1`") && holds("sample_data.json"), "{told}");
        }
    }
}
