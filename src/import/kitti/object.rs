//! The object set: single frames, `training/{velodyne,image_2,calib,label_2}`, and `testing` without labels.

use std::path::{Path, PathBuf};

use super::calib::Calibration;
use super::exported::{ExportedState, read_rings};
use super::label::read_object_labels;
use super::rig::{FRONT, Mounting, Rig, picture_path};
use super::scan::{Stamps, read_scan};
use crate::episode::MapDrawing;
use crate::files;
use crate::import::{Drive, DriveFacts, GroundHeight, ImportError, Notes, Odometry, RawCamera, RawFrame};

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
    /// Whether it was exported by this program.
    is_ours: bool,
}

impl ObjectDrive {
    /// `folder` is `training` or `testing`.
    pub(super) fn open(folder: &Path, stem: &str, rig: &Rig) -> Result<Self, ImportError> {
        let calibration = Calibration::read(&folder.join("calib").join(format!("{stem}.txt")))?;
        let state = ExportedState::read(folder, stem)?;
        let labels = folder.join("label_2");
        // An export of ours has a file for each frame that somebody annotated.
        let is_labelled = if state.is_some() {
            files::is_file(&labels.join(format!("{stem}.txt")))?
        } else {
            files::is_dir(&labels)?
        };
        let digits = stem.bytes().filter(u8::is_ascii_digit).map(|digit| u64::from(digit - b'0'));
        let number = digits.fold(0_u64, |n, digit| n.saturating_mul(10).saturating_add(digit));
        let made_up_ns = FIRST_NS.saturating_add(number.saturating_mul(1_000_000_000));
        let mut methods = vec![("velocity", "of objects unknown: single frames".to_owned())];
        methods.extend(Rig::rectified_camera(&calibration));
        let mut rig = rig.clone();
        if let Some(state) = &state {
            rig.mounting = Mounting::Stated(state.ego_from_lidar());
        } else {
            methods.push(("time", "made up: the set has no stamps".to_owned()));
            methods.push((
                "camera",
                "the left colour camera, rectified by KITTI, with its baseline to camera 0".to_owned(),
            ));
        }
        methods.push(rig.axes());
        let rings = if state.is_some() {
            "as exported, from ring"
        } else {
            "from the order of the points: KITTI stores beam by beam"
        };
        Ok(Self {
            facts: DriveFacts {
                path: folder.to_owned(),
                town: if state.is_some() { "kitti" } else { "karlsruhe" }.to_owned(),
                description: format!("KITTI object set, frame {stem}"),
                wheelbase_m: state.as_ref().map(|state| state.wheelbase_m),
                front_bumper_x_m: state.as_ref().map(|state| state.front_bumper_x_m),
                is_labelled,
                ground: if state.is_some() { exported_ground() } else { Rig::ground() },
                compensated: Some("not compensated: the set has neither stamps nor poses".to_owned()),
                rings: Some(rings.to_owned()),
                methods,
                map: MapDrawing::default(),
            },
            times_ns: [state.as_ref().map_or(made_up_ns, |state| state.time_ns)],
            odometry: state.as_ref().map(ExportedState::odometry).unwrap_or_default(),
            folder: folder.to_owned(),
            stem: stem.to_owned(),
            rig,
            calibration,
            is_ours: state.is_some(),
        })
    }
}

fn exported_ground() -> GroundHeight {
    GroundHeight::Known { z_m: 0.0, source: "the exported episode's, z = 0 of its ego frame".to_owned() }
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

    fn cloud_path(&self, _sample_idx: usize) -> PathBuf {
        self.folder.join("velodyne").join(format!("{}.bin", self.stem))
    }

    fn picture_path(&self, _sample_idx: usize, _camera: &RawCamera) -> PathBuf {
        picture_path(&self.folder.join(format!("image_{FRONT}")), &self.stem)
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn frame(&self, _sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError> {
        let file =
            |folder: &str, suffix: &str| self.folder.join(folder).join(format!("{}.{suffix}", self.stem));
        let view = |number: usize, notes: &mut Notes| {
            let picture = picture_path(&self.folder.join(format!("image_{number}")), &self.stem);
            self.rig.camera(number, &self.calibration, &picture, self.times_ns[0], notes)
        };
        // An export of ours has its rings beside.
        let mut of_cloud = Notes::default();
        let mut points = read_scan(&file("velodyne", "bin"), Stamps::None, &mut of_cloud)?;
        if self.is_ours {
            read_rings(&self.folder, &self.stem, &mut points)?;
        } else {
            of_cloud.sentences().for_each(|sentence| notes.tell(sentence));
        }
        let (mut objects, mut ignored) = (None, Vec::new());
        if self.facts.is_labelled {
            let ego_from_rect = self.rig.ego_from_rect(&self.calibration);
            let rows = read_object_labels(&file("label_2", "txt"))?;
            ignored.extend(rows.iter().filter(|row| row.is_region()).map(super::label::LabelRow::region));
            let boxes = rows.iter().filter(|row| !row.is_region());
            objects = Some(boxes.map(|row| row.object(&ego_from_rect, [f64::NAN; 2])).collect());
        }
        Ok(RawFrame {
            ego_from_lidar: self.rig.ego_from_lidar(&self.calibration),
            points,
            camera: Some(view(FRONT, notes)?),
            other_cameras: self
                .rig
                .other_cameras
                .iter()
                .map(|&number| view(number, notes))
                .collect::<Result<_, _>>()?,
            objects,
            ignored,
        })
    }
}
