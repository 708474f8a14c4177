//! A bag as a drive: the samples that all of its topics cover, and the frame of each.

use nalgebra::{Isometry3, UnitQuaternion};

use super::bag::{Bag, BagTopic};
use super::calibration::{CameraCalibration, optical_axes};
use super::choice::choose;
use super::clouds::{Cloud, CloudHabits};
use super::mapping::MappingConfig;
use super::message::frame_name;
use super::objects;
use super::poses::{ego_from_base, odometry};
use super::timeline::{BagTimeline, MessageTrack, Stamped, Topics};
use super::{cdr::Value, images};
use crate::config::Checked;
use crate::geometry::Transform;
use crate::import::motion::Motion;
use crate::import::{Drive, DriveFacts, ImportConfig, ImportError, Notes, Odometry, RawCamera, RawFrame};

/// Clouds that are looked at to find how their points count times and rings.
const CLOUDS_TRIED: usize = 5;
/// A cab on springs moves less against the wheels, metres and degrees.
const MOST_MOVED_M: f64 = 0.1;
const MOST_TURNED_DEG: f64 = 2.0;

/// A bag that has been gone through once.
pub struct Ros2Drive {
    bag: Bag,
    mapping: Checked<MappingConfig>,
    facts: DriveFacts,
    times_ns: Vec<u64>,
    odometry: Odometry,
    timeline: BagTimeline,
    /// The clouds of the samples.
    clouds: Vec<Stamped>,
    ego_from_base: Isometry3<f64>,
    habits: CloudHabits,
    /// A sentence on where it comes from.
    calibration: Option<String>,
    tolerance_ns: u64,
}

impl Ros2Drive {
    /// Goes through a bag. `is_guessed`: the mapping is the bag's own proposal.
    ///
    /// # Errors
    /// The bag is damaged, lacks what the mapping names, or no sample has all of its parts.
    pub fn open(
        bag: Bag,
        mapping: Checked<MappingConfig>,
        is_guessed: bool,
        config: &ImportConfig,
        notes: &mut Notes,
    ) -> Result<Self, ImportError> {
        let topics = Topics::of(&bag, &mapping)?;
        let mut timeline = BagTimeline::scan(&bag, &topics, &mapping, notes)?;
        for transform in &mapping.frames.transforms {
            let [roll, pitch, yaw] = transform.rotation_rpy_deg.map(f64::to_radians);
            let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let [x, y, z] = transform.translation_m;
            let isometry = Isometry3::from_parts(nalgebra::Translation3::new(x, y, z), rotation);
            timeline.tf.add(&transform.parent, &transform.child, true, 0, isometry);
        }
        timeline.tf.finish(&mapping.frames.fixed).into_iter().for_each(|sentence| notes.tell(sentence));
        let (ego_from_base, ground) = ego_from_base(&mapping.frames, &timeline.tf);
        let of_mapping_m = Some(mapping.vehicle.wheelbase_m).filter(|length_m| *length_m > 0.0);
        let wheelbase_m = of_mapping_m.unwrap_or(config.vehicle.wheelbase_m);
        let has_turned_imu = timeline.turn_imu(&mapping, notes);
        let (odometry, pose_source) =
            odometry(&timeline, &mapping, is_guessed, wheelbase_m, &ego_from_base, notes)
                .map_err(|why| ImportError::at(bag.path(), format!("the ego's poses: {why}")))?;
        let has_objects = topics.objects.is_some();
        let mut drive = Self {
            facts: DriveFacts {
                path: bag.path().to_owned(),
                town: "ros2".into(),
                description: format!("ROS 2 bag {}", bag.path().file_name().unwrap_or_default().display()),
                wheelbase_m: of_mapping_m,
                front_bumper_x_m: Some(mapping.vehicle.front_bumper_x_m).filter(|length_m| *length_m > 0.0),
                is_labelled: has_objects,
                ground,
                compensated: mapping
                    .lidar
                    .compensated
                    .then(|| "the mapping says that the driver has compensated the clouds".into()),
                rings: None,
                methods: vec![("poses", pose_source)],
                map: crate::episode::MapDrawing::default(),
            },
            bag,
            mapping,
            times_ns: Vec::new(),
            odometry,
            timeline,
            clouds: Vec::new(),
            ego_from_base,
            habits: CloudHabits::default(),
            calibration: None,
            tolerance_ns: (config.stamp_tolerance_s * 1e9) as u64,
        };
        drive.choose_samples(notes)?;
        drive.check_objects()?;
        drive.find_habits(notes)?;
        if !drive.mapping.camera.topic.is_empty() {
            let calibration = drive.calibration(drive.times_ns[0])?;
            calibration.doubt.into_iter().for_each(|sentence| notes.tell(sentence));
            drive.calibration = Some(calibration.source);
        }
        drive.describe(has_turned_imu);
        Ok(drive)
    }

    /// Keeps the clouds that poses and pictures cover.
    fn choose_samples(&mut self, notes: &mut Notes) -> Result<(), ImportError> {
        let poses = &self.odometry.poses;
        let poses_ns = poses.first().zip(poses.last()).map(|(first, last)| (first.0, last.0));
        self.clouds = choose(&self.timeline, poses_ns, &self.mapping, self.tolerance_ns, notes)
            .map_err(|why| self.told(why))?;
        self.times_ns = self.clouds.iter().map(|cloud| cloud.stamp_ns).collect();
        Ok(())
    }

    /// Some cloud must have boxes near it, if boxes are asked for; those of key frames alone will do.
    fn check_objects(&self) -> Result<(), ImportError> {
        let name = &self.mapping.objects.topic;
        let has_boxes = |time_ns: &u64| self.objects_at(*time_ns).is_some();
        if name.is_empty() || self.times_ns.iter().any(has_boxes) {
            return Ok(());
        }
        let topic = self.bag.topic("objects.topic", name)?;
        self.nearest(&self.timeline.objects, topic, self.times_ns[0]).map(|_| ())
    }

    /// The message of boxes of a cloud: the nearest of those that have no nearer cloud. What moves is elsewhere in other clouds.
    fn objects_at(&self, time_ns: u64) -> Option<Stamped> {
        let messages = &self.timeline.objects.messages;
        let first = messages.partition_point(|of| of.stamp_ns.saturating_add(self.tolerance_ns) < time_ns);
        let near = messages[first..]
            .iter()
            .take_while(|of| of.stamp_ns <= time_ns.saturating_add(self.tolerance_ns));
        let is_own = |of: &Stamped| {
            self.timeline.clouds.nearest(of.stamp_ns).is_some_and(|cloud| cloud.stamp_ns == time_ns)
        };
        let own = near.filter(|of| is_own(of));
        own.copied().min_by_key(|of| of.stamp_ns.abs_diff(time_ns))
    }

    fn motion(&self) -> Motion<'_> {
        let (odometry, tolerance_ns) = (&self.odometry, self.tolerance_ns);
        Motion { odometry, tolerance_ns, smoothing_ns: tolerance_ns }
    }

    /// Where a frame of a message of another time is at a cloud's: one that is fixed to the car was elsewhere then.
    fn ego_from(&self, frame: &str, cloud_ns: u64, message_ns: u64) -> Result<Isometry3<f64>, String> {
        let base_from_frame = self.base_from(frame, cloud_ns)?;
        let is_fixed = self.base_from(frame, message_ns).is_ok_and(|then| then == base_from_frame);
        let moved = if is_fixed {
            self.motion().ego_from_ego(cloud_ns, message_ns).isometry
        } else {
            Isometry3::identity()
        };
        Ok(moved * self.ego_from_base * base_from_frame)
    }

    /// Looks at the first cloud with points.
    fn find_habits(&mut self, notes: &mut Notes) -> Result<(), ImportError> {
        let topic = self.bag.topic("lidar.topic", &self.mapping.lidar.topic)?;
        for cloud in self.clouds.iter().take(CLOUDS_TRIED) {
            let found = self.bag.read(topic, cloud.place, |message| {
                let cloud_of = Cloud::of(message, &self.mapping.lidar)?;
                let frame = frame_of(message, &self.mapping.lidar.frame)?;
                let base_from_lidar = self.base_from(&frame, cloud.stamp_ns)?;
                let habits =
                    || cloud_of.habits(&self.mapping.lidar, base_from_lidar.rotation, cloud.stamp_ns);
                Ok((!cloud_of.is_empty()).then(habits).map(|habits| (frame, habits)))
            });
            // A cloud that cannot be read is told when its sample is read.
            if let Ok(Some((frame, (habits, told)))) = found {
                self.habits = habits;
                told.into_iter().for_each(|sentence| notes.tell(sentence));
                return self.check_mounting(&frame);
            }
        }
        Ok(())
    }

    /// Refuses clouds whose frame is not fixed to the car, such as those that an odometry has moved into the world's frame: what a
    /// LiDAR saw where in its turn, and from where, is lost in them.
    fn check_mounting(&self, frame: &str) -> Result<(), ImportError> {
        let last = self.times_ns.len() - 1;
        let times_ns = (0..=4).map(|i| self.times_ns[last * i / 4]);
        let mut poses = times_ns.filter_map(|time_ns| self.base_from(frame, time_ns).ok());
        let Some(first) = poses.next() else { return Ok(()) };
        for then in poses {
            let moved = first.inverse() * then;
            let (moved_m, turned_deg) =
                (moved.translation.vector.norm(), moved.rotation.angle().to_degrees());
            if moved_m > MOST_MOVED_M || turned_deg > MOST_TURNED_DEG {
                let (topic, base) = (&self.mapping.lidar.topic, &self.mapping.frames.base);
                return Err(self.told(format!(
                    "the clouds of topic `{topic}` are in the frame `{frame}`, which moves against the car's `{base}`, by {moved_m:.2} m \
                     and {turned_deg:.1} degrees; clouds in the frame of a LiDAR that is fixed to the car are needed (lidar.topic)"
                )));
            }
        }
        Ok(())
    }

    fn describe(&mut self, has_turned_imu: bool) {
        if let Some(yaw_rate) = self.odometry.yaw_rate_rps.as_mut().filter(|_| has_turned_imu) {
            let base = &self.mapping.frames.base;
            yaw_rate.source = format!("{}, turned by tf into the axes of `{base}`", yaw_rate.source);
        }
        let Self { mapping, calibration, habits, .. } = self;
        if !mapping.objects.topic.is_empty() {
            self.facts.methods.push(("objects", format!("topic `{}`", mapping.objects.topic)));
        }
        self.facts.methods.push(("lidar", format!("topic `{}`", mapping.lidar.topic)));
        if let Some(calibration) = calibration {
            let camera = format!("topic `{}`, {calibration}", mapping.camera.topic);
            self.facts.methods.push(("camera", camera));
        }
        if let Some(habit) = habits.time {
            let (unit_s, origin) = (habit.unit_s, habit.origin.tell());
            self.facts
                .methods
                .push(("point_times", format!("in units of {unit_s} s, counted from {origin}")));
        }
        self.facts.rings = habits
            .rings
            .filter(|rings| rings.is_turned())
            .map(|_| "the cloud's own rings, which count from above, counted from below".to_owned());
    }

    fn base_from(&self, frame: &str, time_ns: u64) -> Result<Isometry3<f64>, String> {
        let base = &self.mapping.frames.base;
        self.timeline
            .tf
            .lookup(base, frame, time_ns, self.tolerance_ns)
            .map_err(|error| format!("{error}; [[frames.transforms]] of the mapping can add what is missing"))
    }

    fn told(&self, why: String) -> ImportError {
        ImportError::at(self.bag.path(), why)
    }

    /// The message of a topic nearest to a cloud.
    fn nearest(&self, track: &MessageTrack, topic: &BagTopic, time_ns: u64) -> Result<Stamped, ImportError> {
        track.near(&topic.name, time_ns, self.tolerance_ns).map_err(|why| self.told(why))
    }

    /// What is known of the camera at a time: its info need not come with each picture.
    fn calibration(&self, time_ns: u64) -> Result<CameraCalibration, ImportError> {
        let mapping = &self.mapping.camera;
        if mapping.info_topic.is_empty() {
            return CameraCalibration::from_mapping(mapping).map_err(|why| self.told(why));
        }
        let topic = self.bag.topic("camera.info_topic", &mapping.info_topic)?;
        let Some(nearest) = self.timeline.camera_infos.nearest(time_ns) else {
            return Err(self.told(format!("topic `{}` holds no camera info", topic.name)));
        };
        self.bag.read(topic, nearest.place, |info| CameraCalibration::of(info, mapping.is_rectified()))
    }

    fn camera(&self, time_ns: u64, notes: &mut Notes) -> Result<Option<RawCamera>, ImportError> {
        let mapping = &self.mapping.camera;
        if mapping.topic.is_empty() {
            return Ok(None);
        }
        let topic = self.bag.topic("camera.topic", &mapping.topic)?;
        let picture = self.nearest(&self.timeline.pictures, topic, time_ns)?;
        let calibration = self.calibration(picture.stamp_ns)?;
        let is_compressed = topic.type_name.ends_with("CompressedImage");
        let (frame, image) = self.bag.read(topic, picture.place, |message: &Value| {
            let image = if is_compressed { images::compressed(message)? } else { images::unpacked(message)? };
            Ok((frame_of(message, &mapping.frame)?, image))
        })?;
        let base_from_frame = self.base_from(&frame, time_ns).map_err(|why| self.told(why))?;
        let (base_from_camera, told) =
            optical_axes(base_from_frame, mapping.axes, &frame).map_err(|why| self.told(why))?;
        told.into_iter().for_each(|sentence| notes.tell(sentence));
        let rectified_axes = calibration.rectified_from_camera.inverse();
        Ok(Some(RawCamera {
            name: "cam_front".into(),
            time_ns: picture.stamp_ns,
            ego_from_camera: Transform::from_isometry(
                self.motion().ego_from_ego(time_ns, picture.stamp_ns).isometry
                    * self.ego_from_base
                    * base_from_camera
                    * rectified_axes,
            ),
            size_px: calibration.size_px,
            k: calibration.k,
            distortion: calibration.distortion,
            image,
        }))
    }
}

/// The frame that a mapping names, else the one that a message names.
fn frame_of(message: &Value, of_mapping: &str) -> Result<String, String> {
    let named = message.text("header.frame_id").map_err(|error| error.to_string())?;
    Ok(frame_name(if of_mapping.is_empty() { named } else { of_mapping }).to_owned())
}

impl Drive for Ros2Drive {
    fn facts(&self) -> &DriveFacts {
        &self.facts
    }

    fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    fn is_annotated(&self, sample_idx: usize) -> bool {
        self.mapping.objects.topic.is_empty() || self.objects_at(self.times_ns[sample_idx]).is_some()
    }

    fn frame(&self, sample_idx: usize, notes: &mut Notes) -> Result<RawFrame, ImportError> {
        let Stamped { stamp_ns, place } = self.clouds[sample_idx];
        let topic = self.bag.topic("lidar.topic", &self.mapping.lidar.topic)?;
        let (frame, points) = self.bag.read(topic, place, |message| {
            let cloud = Cloud::of(message, &self.mapping.lidar)?;
            if cloud.is_empty() {
                return Err("the cloud is empty; points are needed".into());
            }
            let frame = frame_of(message, &self.mapping.lidar.frame)?;
            Ok((frame, cloud.points(&self.habits, stamp_ns)))
        })?;
        let base_from_lidar = self.base_from(&frame, stamp_ns).map_err(|why| self.told(why))?;
        let name = &self.mapping.objects.topic;
        let objects = match self.objects_at(stamp_ns).filter(|_| !name.is_empty()) {
            None => None,
            Some(Stamped { stamp_ns: message_ns, place }) => {
                let topic = self.bag.topic("objects.topic", name)?;
                let (objects, told) = self.bag.read(topic, place, |message| {
                    objects::objects(message, message_ns, |frame| self.ego_from(frame, stamp_ns, message_ns))
                })?;
                told.into_iter().for_each(|sentence| notes.tell(sentence));
                Some(objects)
            }
        };
        // A sample without boxes in a drive that has some is left out.
        let is_wanted = name.is_empty() || objects.is_some();
        let camera = if is_wanted { self.camera(stamp_ns, notes)? } else { None };
        Ok(RawFrame {
            ego_from_lidar: Transform::from_isometry(self.ego_from_base * base_from_lidar),
            points,
            camera,
            other_cameras: Vec::new(),
            objects,
            ignored: Vec::new(),
        })
    }
}
