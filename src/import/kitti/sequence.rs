//! A drive of the tracking set or of the raw recordings: frames of one folder each, poses, objects by frame.

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::Isometry3;

use super::calib::Calibration;
use super::oxts::{Packet, odometry_of};
use super::rig::{FRONT, Rig, picture_path};
use super::scan::{Stamps, read_scan};
use crate::episode::MapDrawing;
use crate::import::motion::Motion;
use crate::import::tracks::Tracks;
use crate::import::{Drive, DriveFacts, ImportError, Notes, Odometry, RawCamera, RawFrame, RawObject};
use crate::sample::IgnoredRegion;

/// What is annotated in a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Annotated {
    pub(super) objects: Vec<RawObject>,
    pub(super) ignored: Vec<IgnoredRegion>,
}

/// What the two layouts find in their own ways.
pub(super) struct Parts {
    /// The drive's folder or the set's, for messages.
    pub(super) path: PathBuf,
    pub(super) description: String,
    /// Names of the frames without suffix, and their times.
    pub(super) frames: Vec<(String, u64)>,
    pub(super) clouds: PathBuf,
    /// The folder of a camera's pictures, by its number.
    pub(super) pictures: fn(&Parts, usize) -> PathBuf,
    /// When the front picture of each frame was taken.
    pub(super) picture_times_ns: Vec<u64>,
    pub(super) calibration: Calibration,
    pub(super) packets: Vec<(u64, Packet)>,
    /// By the frame's index; `None` where nothing is annotated.
    pub(super) annotated: Option<BTreeMap<usize, Annotated>>,
    pub(super) methods: Vec<(&'static str, String)>,
}

/// A sequence.
pub(super) struct SequenceDrive {
    facts: DriveFacts,
    times_ns: Vec<u64>,
    odometry: Odometry,
    parts: Parts,
    rig: Rig,
}

impl SequenceDrive {
    /// Makes the odometry and the objects' velocities.
    pub(super) fn new(mut parts: Parts, rig: &Rig) -> Self {
        let times_ns: Vec<u64> = parts.frames.iter().map(|(_, time_ns)| *time_ns).collect();
        let odometry = match parts.calibration.velo_from_imu {
            Some(velo_from_imu) => {
                let ego_from_imu: Isometry3<f64> = rig.ego_from_velo(&parts.calibration) * velo_from_imu;
                odometry_of(&parts.packets, &ego_from_imu.inverse())
            }
            None => Odometry::default(),
        };
        if let Some(annotated) = &mut parts.annotated {
            fill_velocities(annotated, &times_ns, &odometry);
        }
        let mut methods = std::mem::take(&mut parts.methods);
        methods.push((
            "camera",
            "the left colour camera, rectified by KITTI, with its baseline to camera 0".to_owned(),
        ));
        methods.push(rig.axes());
        methods.extend(Rig::rectified_camera(&parts.calibration));
        methods.push(("velocity", "of objects from their places in neighbouring frames".to_owned()));
        let facts = DriveFacts {
            path: parts.path.clone(),
            town: "karlsruhe".to_owned(),
            description: parts.description.clone(),
            wheelbase_m: None,
            front_bumper_x_m: None,
            is_labelled: parts.annotated.is_some(),
            ground: Rig::ground(),
            compensated: None,
            rings: Some("from the order of the points: KITTI stores beam by beam".to_owned()),
            methods,
            map: MapDrawing::default(),
        };
        Self { facts, times_ns, odometry, parts, rig: rig.clone() }
    }
}

fn fill_velocities(annotated: &mut BTreeMap<usize, Annotated>, times_ns: &[u64], odometry: &Odometry) {
    let motion = Motion { odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
    let mut tracks = Tracks::default();
    let pose = |frame_idx: usize| times_ns.get(frame_idx).and_then(|time_ns| motion.pose_at(*time_ns));
    for (&frame_idx, of_frame) in annotated.iter() {
        let Some(world_from_ego) = pose(frame_idx) else { continue };
        for object in &of_frame.objects {
            tracks.add(&object.id, times_ns[frame_idx], (world_from_ego * object.box_in_ego.center).coords);
        }
    }
    for (&frame_idx, of_frame) in annotated.iter_mut() {
        let Some(world_from_ego) = pose(frame_idx) else { continue };
        for object in &mut of_frame.objects {
            object.velocity_in_ego_mps =
                tracks.velocity_in_ego_mps(&object.id, times_ns[frame_idx], &world_from_ego);
        }
    }
}

impl Drive for SequenceDrive {
    fn facts(&self) -> &DriveFacts {
        &self.facts
    }

    fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    fn sample_name(&self, sample_idx: usize) -> Option<String> {
        Some(self.parts.frames[sample_idx].0.clone())
    }

    fn cloud_path(&self, sample_idx: usize) -> PathBuf {
        self.parts.clouds.join(format!("{}.bin", self.parts.frames[sample_idx].0))
    }

    fn picture_path(&self, sample_idx: usize, _camera: &RawCamera) -> PathBuf {
        picture_path(&(self.parts.pictures)(&self.parts, FRONT), &self.parts.frames[sample_idx].0)
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn frame(&self, sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError> {
        let (parts, rig) = (&self.parts, &self.rig);
        let stem = &parts.frames[sample_idx].0;
        let time_ns = parts.picture_times_ns[sample_idx];
        let view = |number: usize, notes: &mut Notes| {
            let picture = picture_path(&(parts.pictures)(parts, number), stem);
            rig.camera(number, &parts.calibration, &picture, time_ns, notes)
        };
        let points = read_scan(&parts.clouds.join(format!("{stem}.bin")), Stamps::ByAzimuth, notes)?;
        let annotated = parts.annotated.as_ref();
        // A frame without rows has no objects: the sets annotate every frame.
        let of_frame = annotated.map(|annotated| annotated.get(&sample_idx).cloned().unwrap_or_default());
        let (objects, ignored) = match of_frame {
            Some(of_frame) => (Some(of_frame.objects), of_frame.ignored),
            None => (None, Vec::new()),
        };
        Ok(RawFrame {
            ego_from_lidar: rig.ego_from_lidar(&parts.calibration),
            points,
            camera: Some(view(FRONT, notes)?),
            other_cameras: rig
                .other_cameras
                .iter()
                .map(|&number| view(number, notes))
                .collect::<Result<_, _>>()?,
            objects,
            ignored,
        })
    }
}
