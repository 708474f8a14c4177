//! The object set: single frames, `training/{velodyne,image_2,calib,label_2}`, and `testing` without labels.

use std::path::{Path, PathBuf};

use super::calib::Calibration;
use super::label::read_object_labels;
use super::rig::{FRONT, Rig, picture_path};
use super::scan::{Stamps, read_scan};
use crate::episode::MapDrawing;
use crate::import::{Drive, DriveFacts, Frame, ImportError, Notes, Odometry};

/// The stamps are made up, since the set has none: seconds from 26 September 2011, when KITTI's first drives were recorded.
const FIRST_NS: u64 = 1_316_995_200_000_000_000;

/// One frame of the set.
pub(super) struct ObjectDrive {
    facts: DriveFacts,
    times_ns: [u64; 1],
    odometry: Odometry,
    folder: PathBuf,
    stem: String,
    rig: Rig,
    calibration: Calibration,
}

impl ObjectDrive {
    /// `folder` is `training` or `testing`.
    pub(super) fn open(folder: &Path, stem: &str, rig: &Rig) -> Result<Self, ImportError> {
        let calibration = Calibration::read(&folder.join("calib").join(format!("{stem}.txt")))?;
        let is_labelled = folder.join("label_2").is_dir();
        let number: u64 =
            stem.bytes().filter(u8::is_ascii_digit).fold(0, |n, digit| n * 10 + u64::from(digit - b'0'));
        let methods = vec![
            ("time", "made up: the set has no stamps".to_owned()),
            (
                "camera",
                "the left colour camera, rectified by KITTI, with its baseline to camera 0".to_owned(),
            ),
            ("velocity", "of objects unknown: single frames".to_owned()),
        ];
        Ok(Self {
            facts: DriveFacts {
                path: folder.to_owned(),
                town: "karlsruhe".to_owned(),
                description: format!("KITTI object set, frame {stem}"),
                wheelbase_m: None,
                front_bumper_x_m: None,
                is_labelled,
                ground: Rig::ground(),
                compensated: Some("not compensated: the set has neither stamps nor poses".to_owned()),
                rings: Some("from the order of the points: KITTI stores beam by beam".to_owned()),
                methods,
                map: MapDrawing::default(),
            },
            times_ns: [FIRST_NS + number * 1_000_000_000],
            odometry: Odometry::default(),
            folder: folder.to_owned(),
            stem: stem.to_owned(),
            rig: rig.clone(),
            calibration,
        })
    }
}

impl Drive for ObjectDrive {
    fn facts(&self) -> &DriveFacts {
        &self.facts
    }

    fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    fn sample_name(&self, _sample_idx: usize) -> Option<String> {
        Some(self.stem.clone())
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn frame(&self, _sample_idx: usize, _notes: &mut Notes) -> Result<Frame, ImportError> {
        let file =
            |folder: &str, suffix: &str| self.folder.join(folder).join(format!("{}.{suffix}", self.stem));
        let view = |number: usize| {
            let picture = picture_path(&self.folder.join(format!("image_{number}")), &self.stem);
            self.rig.camera(number, &self.calibration, &picture, self.times_ns[0])
        };
        let points = read_scan(&file("velodyne", "bin"), Stamps::None)?;
        let (mut objects, mut ignored) = (None, Vec::new());
        if self.facts.is_labelled {
            let ego_from_rect = self.rig.ego_from_rect(&self.calibration);
            let rows = read_object_labels(&file("label_2", "txt"))?;
            ignored.extend(rows.iter().filter(|row| row.is_region()).map(|row| row.region()));
            let boxes = rows.iter().filter(|row| !row.is_region());
            objects = Some(boxes.map(|row| row.object(&ego_from_rect, [f64::NAN; 2])).collect());
        }
        Ok(Frame {
            ego_from_lidar: self.rig.ego_from_lidar(),
            points,
            camera: Some(view(FRONT)?),
            other_cameras: self
                .rig
                .other_cameras
                .iter()
                .map(|&number| view(number))
                .collect::<Result<_, _>>()?,
            objects,
            ignored,
        })
    }
}
