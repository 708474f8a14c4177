//! One Argoverse 2 log as a drive: sweeps, the nearest pictures, poses, cuboids.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Vector3};

use super::calibration::{Calibration, poses_of};
use super::feather::Table;
use super::lidar::read_sweep;
use super::map::read_map;
use crate::episode::MapDrawing;
use crate::files;
use crate::geometry::{Box3, Camera, Ego, Lidar, Point, Transform, World};
use crate::import::error::read;
use crate::import::motion::Motion;
use crate::import::tracks::Tracks;
use crate::import::{
    Distortion, Drive, DriveFacts, GroundHeight, ImportConfig, ImportError, Notes, Odometry, RawCamera,
    RawFrame, RawImage, RawObject,
};
use crate::sample::{EncodedImage, ImageFormat};

/// The camera that looks ahead.
const FRONT: &str = "ring_front_center";
/// The LiDAR whose place stands for both.
const LIDAR: &str = "up_lidar";
/// The egovehicle frame begins at the rear axle's middle, about a tire's radius over the road.
const GUESS_M: f64 = -0.33;

/// Argoverse has a pose for each stamp of a sensor; none is taken from further away.
const POSE_TOLERANCE_NS: u64 = 50_000_000;

/// A log.
pub(super) struct SensorLog {
    folder: PathBuf,
    facts: DriveFacts,
    times_ns: Vec<u64>,
    odometry: Odometry,
    calibration: Option<Calibration>,
    mount_m: [f64; 3],
    /// Cameras with pictures, the front one first, each with the times of its pictures.
    cameras: Vec<(String, Vec<u64>)>,
    /// A picture further from its sweep is none.
    picture_tolerance_ns: u64,
    annotated: Option<BTreeMap<u64, Vec<RawObject>>>,
}

impl SensorLog {
    pub(super) fn open(folder: &Path, config: &ImportConfig, notes: &mut Notes) -> Result<Self, ImportError> {
        let times_ns = stamps(&folder.join("sensors/lidar"), "feather")?;
        let calibration = Calibration::read(folder)?;
        let odometry = read_poses(&folder.join("city_SE3_egovehicle.feather"))?;
        let annotations = folder.join("annotations.feather");
        let annotated =
            if files::is_file(&annotations)? { Some(read_cuboids(&annotations, &odometry)?) } else { None };
        let mut methods = Vec::new();
        let of_lidar = calibration.as_ref().and_then(|found| found.ego_from_sensor.get(LIDAR));
        let mount_m = of_lidar.map_or(config.lidar_mount_m, |mount| mount.translation.vector.into());
        let from = if of_lidar.is_some() {
            "by the calibration"
        } else {
            "the fleet's usual place, since there is no calibration"
        };
        methods.push((
            "lidar",
            format!("two LiDARs as one cloud with the ego's axes, seen from the upper one's place {mount_m:?} m, {from}"),
        ));
        methods.push(("velocity", "of objects from their places in neighbouring sweeps".to_owned()));
        let mut wanted = vec![FRONT.to_owned()];
        wanted.extend(config.cameras.iter().cloned());
        let mut cameras = Vec::new();
        for name in wanted {
            let pictures = folder.join("sensors/cameras").join(&name);
            let is_calibrated = calibration.as_ref().is_some_and(|found| found.cameras.contains_key(&name));
            match (files::is_dir(&pictures)?, is_calibrated) {
                (true, true) => cameras.push((name, stamps(&pictures, "jpg")?)),
                (true, false) => {
                    notes.tell(format!("the pictures of `{name}` have no calibration and are left out"));
                }
                (false, _) if name == FRONT => {
                    notes.tell(format!("there are no pictures of `{name}`; a black one stands for each"));
                }
                (false, _) => {
                    return Err(ImportError::at(&pictures, "a camera that was asked for has no pictures"));
                }
            }
        }
        if cameras.iter().any(|(name, _)| name == FRONT) {
            let sentence = format!(
                "`{FRONT}`, free of distortion, mounted through the poses at its own time and at the sweep's"
            );
            methods.push(("camera", sentence));
        }
        let (map, city) = read_map(folder)?.unwrap_or((MapDrawing::default(), None));
        let facts = DriveFacts {
            path: folder.to_owned(),
            town: city.unwrap_or_else(|| "av2".to_owned()),
            description: format!(
                "Argoverse 2 log {}",
                folder.file_name().unwrap_or_default().to_string_lossy()
            ),
            wheelbase_m: None,
            front_bumper_x_m: None,
            is_labelled: annotated.is_some(),
            ground: GroundHeight::Unknown { guess_m: GUESS_M },
            compensated: Some("by Argoverse: each point at the sweep's time".to_owned()),
            rings: Some("the 64 lasers of both LiDARs by elevation, after VLP-32C's table".to_owned()),
            methods,
            map,
        };
        Ok(Self {
            folder: folder.to_owned(),
            facts,
            times_ns,
            odometry,
            calibration,
            mount_m,
            cameras,
            picture_tolerance_ns: (config.stamp_tolerance_s * 1e9) as u64,
            annotated,
        })
    }

    fn motion(&self) -> Motion<'_> {
        Motion { odometry: &self.odometry, tolerance_ns: POSE_TOLERANCE_NS, smoothing_ns: POSE_TOLERANCE_NS }
    }

    /// The picture of a camera that is nearest to a time; a black one where none is near, as cameras may begin late or drop out.
    fn camera(
        &self,
        name: &str,
        times_ns: &[u64],
        time_ns: u64,
        notes: &mut Notes,
    ) -> Result<Option<RawCamera>, ImportError> {
        let calibration = self.calibration.as_ref();
        let intrinsics = calibration.and_then(|found| found.cameras.get(name));
        let mount = calibration.and_then(|found| found.ego_from_sensor.get(name));
        let nearest = times_ns.iter().copied().min_by_key(|at_ns| at_ns.abs_diff(time_ns));
        let (Some(intrinsics), Some(mount), Some(nearest_ns)) = (intrinsics, mount, nearest) else {
            return Ok(None);
        };
        let (taken_ns, image) = if nearest_ns.abs_diff(time_ns) <= self.picture_tolerance_ns {
            let path = self.folder.join("sensors/cameras").join(name).join(format!("{nearest_ns}.jpg"));
            let encoded = EncodedImage { format: ImageFormat::Jpeg, bytes: read(&path)? };
            (nearest_ns, RawImage::Encoded(encoded))
        } else {
            notes.tell(format!(
                "no picture of `{name}` is near a sweep (stamp_tolerance_s); a black one stands for it"
            ));
            (time_ns, RawImage::Black)
        };
        let mount = Transform::<Ego, Camera>::from_isometry(*mount);
        Ok(Some(RawCamera {
            name: if name == FRONT {
                "cam_front".to_owned()
            } else {
                format!("cam_{}", name.trim_start_matches("ring_"))
            },
            time_ns: taken_ns,
            // As the devkit's motion-compensated projection has it.
            ego_from_camera: self.motion().ego_from_ego(time_ns, taken_ns) * mount,
            size_px: Some(intrinsics.size_px),
            k: intrinsics.k,
            distortion: Distortion::None,
            image,
        }))
    }
}

impl Drive for SensorLog {
    fn facts(&self) -> &DriveFacts {
        &self.facts
    }

    fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    fn sample_name(&self, sample_idx: usize) -> Option<String> {
        Some(self.times_ns[sample_idx].to_string())
    }

    fn cloud_path(&self, sample_idx: usize) -> PathBuf {
        self.folder.join("sensors/lidar").join(format!("{}.feather", self.times_ns[sample_idx]))
    }

    fn picture_path(&self, _sample_idx: usize, camera: &RawCamera) -> PathBuf {
        let name = camera.name.replacen("cam_", "ring_", 1);
        let name = if name == "ring_front" { FRONT.to_owned() } else { name };
        self.folder.join("sensors/cameras").join(name).join(format!("{}.jpg", camera.time_ns))
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn is_annotated(&self, sample_idx: usize) -> bool {
        self.annotated.as_ref().is_none_or(|annotated| annotated.contains_key(&self.times_ns[sample_idx]))
    }

    fn frame(&self, sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError> {
        let time_ns = self.times_ns[sample_idx];
        let points = read_sweep(&self.cloud_path(sample_idx), self.mount_m)?;
        let mut camera = None;
        let mut other_cameras = Vec::new();
        for (name, times_ns) in &self.cameras {
            let view = self.camera(name, times_ns, time_ns, notes)?;
            if name == FRONT { camera = view } else { other_cameras.extend(view) }
        }
        Ok(RawFrame {
            ego_from_lidar: Transform::<Ego, Lidar>::from_isometry(Isometry3::translation(
                self.mount_m[0],
                self.mount_m[1],
                self.mount_m[2],
            )),
            points,
            camera,
            other_cameras,
            objects: self.annotated.as_ref().and_then(|annotated| annotated.get(&time_ns).cloned()),
            ignored: Vec::new(),
        })
    }
}

/// The times in the names of a folder's files, sorted.
fn stamps(folder: &Path, suffix: &str) -> Result<Vec<u64>, ImportError> {
    let missing = |_| ImportError::at(folder, "the log's folder is missing");
    let mut times_ns = Vec::new();
    for entry in fs_err::read_dir(folder).map_err(missing)? {
        let path = entry?.path();
        if path.extension().is_some_and(|found| found == suffix) {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let told = || ImportError::at(&path, "the file's name is no time in nanoseconds");
            times_ns.push(stem.parse().map_err(|_| told())?);
        }
    }
    times_ns.sort_unstable();
    Ok(times_ns)
}

fn read_poses(path: &Path) -> Result<Odometry, ImportError> {
    let table = Table::read(path)?;
    let times_ns = table.times_ns("timestamp_ns")?;
    let pose = |pose: Isometry3<f64>| Transform::<World, Ego>::from_isometry(pose);
    let mut poses: Vec<(u64, Transform<World, Ego>)> =
        times_ns.into_iter().zip(poses_of(&table)?.into_iter().map(pose)).collect();
    poses.sort_by_key(|(time_ns, _)| *time_ns);
    poses.dedup_by_key(|(time_ns, _)| *time_ns);
    Ok(Odometry { poses, ..Odometry::default() })
}

/// The cuboids by sweep.
fn read_cuboids(path: &Path, odometry: &Odometry) -> Result<BTreeMap<u64, Vec<RawObject>>, ImportError> {
    let table = Table::read(path)?;
    let times_ns = table.times_ns("timestamp_ns")?;
    let (ids, categories, poses) = (table.texts("track_uuid")?, table.texts("category")?, poses_of(&table)?);
    let [lengths, widths, heights] =
        [table.floats("length_m")?, table.floats("width_m")?, table.floats("height_m")?];
    let mut by_time: BTreeMap<u64, Vec<RawObject>> = BTreeMap::new();
    for (i, pose) in poses.iter().enumerate() {
        let ahead = pose.rotation * Vector3::x();
        let box_in_ego = Box3 {
            center: Point::from_coords(pose.translation.vector.into()),
            length_m: lengths[i],
            width_m: widths[i],
            height_m: heights[i],
            yaw_rad: ahead.y.atan2(ahead.x),
        };
        box_in_ego.check().map_err(|error| table.fault(format!("row {i}: {error}")))?;
        let objects = by_time.entry(times_ns[i]).or_default();
        if objects.iter().any(|other| other.id == ids[i]) {
            let (id, time_ns) = (&ids[i], times_ns[i]);
            return Err(table
                .fault(format!("row {i}: the track `{id}` has two boxes at {time_ns} ns; one is needed")));
        }
        objects.push(RawObject {
            id: ids[i].clone(),
            category: categories[i].clone(),
            box_in_ego,
            velocity_in_ego_mps: [f64::NAN; 2],
        });
    }
    let motion = Motion { odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
    let mut tracks = Tracks::default();
    for (&time_ns, objects) in &by_time {
        let Some(world_from_ego) = motion.pose_at(time_ns) else { continue };
        for object in objects {
            tracks.add(&object.id, time_ns, (world_from_ego * object.box_in_ego.center).coords);
        }
    }
    for (&time_ns, objects) in &mut by_time {
        let Some(world_from_ego) = motion.pose_at(time_ns) else { continue };
        for object in objects {
            object.velocity_in_ego_mps = tracks.velocity_in_ego_mps(&object.id, time_ns, &world_from_ego);
        }
    }
    Ok(by_time)
}
