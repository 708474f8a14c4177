//! One sample of a drive: the frame that an importer read, brought into the form of episodes.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::cloud::CloudMaker;
use super::config::CheckedImport;
use super::intensity::Scale;
use super::motion::{MAX_GAP_NS, Motion, signed_s};
use super::objects::{look_at_cloud, truth_of};
use super::pictures::{doubt, is_changed, view_of, virtual_view};
use super::state::StateMaker;
use super::{Drive, ImportError, Notes, RawCamera, RawFrame, RawImage};
use crate::geometry::{Ego, Transform, World};
use crate::sample::{CameraView, Measured, Sample, Truth};

/// Boxes within this distance should hold points, if there are so many.
const NEAR_M: f64 = 25.0;
const MIN_NEAR: usize = 3;

/// Boxes near the ego, and how many of them hold no point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct NearBoxes {
    n_near: usize,
    n_empty: usize,
}

impl NearBoxes {
    pub(super) fn add(&mut self, other: Self) {
        self.n_near += other.n_near;
        self.n_empty += other.n_empty;
    }

    /// A sentence where too many hold none.
    pub(super) fn doubt(self) -> Option<String> {
        let Self { n_near, n_empty } = self;
        (n_near >= MIN_NEAR && 2 * n_empty > n_near).then(|| {
            format!(
                "{n_empty} of {n_near} boxes within {NEAR_M} m hold no point; most should: the cloud's axes, unit or mounting, or the \
                 boxes' frame may be wrong"
            )
        })
    }
}

/// Makes the samples of a drive.
pub(super) struct SampleMaker<'a> {
    drive: &'a dyn Drive,
    config: &'a CheckedImport,
    motion: &'a Motion<'a>,
    /// In the importer's ego frame.
    ground_z_m: f64,
    states: StateMaker<'a>,
    clouds: CloudMaker<'a>,
    /// How the front picture came about.
    picture: Picture,
    boxes: NearBoxes,
    /// Of the last frame, until somebody asks for it.
    cloud_sha256: Option<String>,
}

/// Where the front picture comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Picture {
    Virtual,
    /// All so far are black ones with the log's calibration.
    Black,
    AsItIs,
    Changed,
}

impl<'a> SampleMaker<'a> {
    pub(super) fn new(
        drive: &'a dyn Drive,
        config: &'a CheckedImport,
        motion: &'a Motion<'a>,
        ground_z_m: f64,
    ) -> Self {
        let facts = drive.facts();
        Self {
            drive,
            config,
            motion,
            ground_z_m,
            states: StateMaker::new(motion, facts, config),
            clouds: CloudMaker::new(config, motion, facts.compensated.is_some()),
            picture: Picture::Virtual,
            boxes: NearBoxes::default(),
            cloud_sha256: Some(String::new()),
        }
    }

    /// The hash of the last sample's points as the log has them; once.
    pub(super) fn take_cloud_sha256(&mut self) -> Option<String> {
        self.cloud_sha256.take()
    }

    /// A sample and the views of further cameras; `None` where a drive with annotations has none.
    pub(super) fn sample(
        &mut self,
        sample_idx: usize,
        notes: &mut Notes,
    ) -> Result<Option<(Sample, Vec<CameraView>)>, ImportError> {
        let facts = self.drive.facts();
        let fail = |message: String| ImportError::at(&facts.path, message);
        let of_cloud = |message: String| ImportError::at(&self.drive.cloud_path(sample_idx), message);
        let time_ns = self.drive.times_ns()[sample_idx];
        let mut frame = self.drive.frame(sample_idx, notes)?;
        if frame.objects.is_none() && facts.is_labelled {
            return Ok(None);
        }
        let world_from_ego = self.world_from_ego(time_ns).map_err(fail)?;
        // Before the shift to the ground, since the poses are of the importer's ego frame.
        if let Some(sha256) = &mut self.cloud_sha256 {
            *sha256 = frame.cloud_sha256();
        }
        let points = std::mem::take(&mut frame.points);
        let (ego_from_lidar, points) =
            self.clouds.cloud(frame.ego_from_lidar, points, time_ns, notes).map_err(of_cloud)?;
        frame.ego_from_lidar = ego_from_lidar;
        self.lower_to_ground(&mut frame);
        let ego_from_lidar = frame.ego_from_lidar;
        let truth = match frame.objects.filter(|_| facts.is_labelled) {
            None => None,
            Some(objects) => {
                let mut truth = truth_of(objects, frame.ignored, self.config, &facts.path)?;
                look_at_cloud(&mut truth, &ego_from_lidar, &points);
                self.watch_boxes(&truth);
                Some(truth)
            }
        };
        let front = match &frame.camera {
            None => virtual_view(),
            Some(camera) => {
                self.picture = match &camera.image {
                    RawImage::Black if self.picture == Picture::Virtual => Picture::Black,
                    RawImage::Black => self.picture,
                    _ if is_changed(camera) => Picture::Changed,
                    _ => Picture::AsItIs,
                };
                self.view(camera, sample_idx, notes)?
            }
        };
        let views = frame.other_cameras.iter().map(|camera| self.view(camera, sample_idx, notes));
        let views = views.collect::<Result<Vec<CameraView>, ImportError>>()?;
        let measured = Measured {
            time_ns,
            ego_state: self.states.state_at(time_ns),
            world_from_ego,
            ego_from_lidar,
            ego_from_camera: front.ego_from_camera,
            intrinsics: front.intrinsics,
            image: front.image,
            points,
        };
        Ok(Some((Sample { measured, truth }, views)))
    }

    /// Shifts a frame so that the ego's z = 0 is the ground.
    fn lower_to_ground(&self, frame: &mut RawFrame) {
        let lift = self.on_ground_from_ego();
        frame.ego_from_lidar = lift * frame.ego_from_lidar;
        for camera in frame.camera.iter_mut().chain(&mut frame.other_cameras) {
            camera.ego_from_camera = lift * camera.ego_from_camera;
        }
        for object in frame.objects.iter_mut().flatten() {
            object.box_in_ego.center = lift * object.box_in_ego.center;
        }
    }

    fn on_ground_from_ego(&self) -> Transform<Ego, Ego> {
        Transform::from_xyz_yaw(0.0, 0.0, -self.ground_z_m, 0.0)
    }

    /// The pose of the shifted ego frame. An error is a sentence.
    fn world_from_ego(&self, time_ns: u64) -> Result<Transform<World, Ego>, String> {
        if !self.motion.has_poses() {
            return Ok(Transform::from_isometry(Isometry3::identity()));
        }
        let Some(pose) = self.motion.pose_at(time_ns) else {
            if let Some(hole_ns) = self.motion.hole_ns(time_ns) {
                return Err(format!(
                    "the poses have a hole of {:.3} s around the sample at {time_ns} ns; up to {:.1} s is bridged",
                    hole_ns as f64 * 1e-9,
                    MAX_GAP_NS as f64 * 1e-9
                ));
            }
            let nearest = self.motion.nearest_pose_ns(time_ns).unwrap_or_default();
            return Err(format!(
                "no pose belongs to the sample at {time_ns} ns: the nearest is at {nearest} ns, and at most {} s between them is needed \
                 (stamp_tolerance_s)",
                self.config.stamp_tolerance_s
            ));
        };
        Ok(pose * self.on_ground_from_ego().inverse())
    }

    fn view(
        &self,
        camera: &RawCamera,
        sample_idx: usize,
        notes: &mut Notes,
    ) -> Result<CameraView, ImportError> {
        let fail = |message: String| ImportError::at(&self.drive.picture_path(sample_idx, camera), message);
        let (name, time_ns) = (&camera.name, self.drive.times_ns()[sample_idx]);
        let (apart_s, most_s) = (signed_s(time_ns, camera.time_ns), self.config.stamp_tolerance_s);
        if apart_s.abs() > most_s {
            return Err(fail(format!(
                "the picture of `{name}` was taken at {} ns, {apart_s:.3} s from the sample at {time_ns} ns; at most {most_s} s is \
                 needed (stamp_tolerance_s)",
                camera.time_ns
            )));
        }
        let view = view_of(camera, self.config.jpeg_quality).map_err(fail)?;
        if let Some(sentence) = doubt(&view) {
            notes.tell(sentence);
        }
        Ok(view)
    }

    /// Counts the boxes near the ego that hold no point.
    fn watch_boxes(&mut self, truth: &Truth) {
        for object in &truth.objects {
            let center = object.box_in_ego.center;
            if center.x().hypot(center.y()) < NEAR_M {
                self.boxes.n_near += 1;
                self.boxes.n_empty += usize::from(!object.is_hit());
            }
        }
    }

    /// The boxes near the ego in all samples so far.
    pub(super) fn boxes(&self) -> NearBoxes {
        self.boxes
    }

    /// Samples whose speed is assumed.
    pub(super) fn n_assumed(&self) -> usize {
        self.states.n_assumed
    }

    /// What was found out on the way.
    pub(super) fn tell_methods(&self, methods: &mut BTreeMap<String, String>) {
        let facts = self.drive.facts();
        for (part, sentence) in &self.states.methods {
            methods.insert((*part).to_owned(), sentence.clone());
        }
        let rings = match &facts.rings {
            _ if self.clouds.has_ringed => "computed from the points' elevation".to_owned(),
            Some(sentence) => sentence.clone(),
            None => "the log's".to_owned(),
        };
        let motion = match &facts.compensated {
            _ if self.clouds.has_moved => "each point moved by the poses to the sample's time".to_owned(),
            Some(sentence) => sentence.clone(),
            None if !self.config.compensate_motion => "not compensated, as the config has it".to_owned(),
            None => "not compensated: the points have no stamps, or there are no poses".to_owned(),
        };
        let intensity = self.clouds.scale.map_or("unknown", Scale::sentence);
        let axes = if self.clouds.has_turned {
            "turned by quarter turns about z, so that x points ahead"
        } else {
            "the log's"
        };
        let camera = match self.picture {
            Picture::Virtual => {
                "none: a black picture of a virtual camera (70 degrees, 800 x 450, at x 1.5 m, z 1.6 m) stands for it"
            }
            Picture::Black => "no picture: a black one with the log's calibration stands for each",
            Picture::AsItIs => "the log's picture, byte by byte",
            Picture::Changed => "rectified or packed as JPEG",
        };
        let parts = [
            ("rings", rings.as_str()),
            ("motion", motion.as_str()),
            ("intensity", intensity),
            ("lidar_axes", axes),
        ];
        for (part, sentence) in parts {
            methods.insert(part.to_owned(), sentence.to_owned());
        }
        let told = methods.entry("camera".to_owned()).or_default();
        *told = if told.is_empty() { camera.to_owned() } else { format!("{told}; {camera}") };
    }
}
