//! One pass over a bag's messages: the stamps of clouds and pictures, the tf tree, poses, and what was measured.
//!
//! Clouds and pictures are looked at for their stamps alone; their places are kept, and each is read when its sample is.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::bag::{Bag, BagTopic, Place, seconds};
use super::cdr::{CdrError, Value};
use super::mapping::{FieldMapping, MappingConfig, RATE_UNITS, StampSource};
use super::message::{frame_name, isometry_of, stamp_ns};
use super::tf::TfTree;
use crate::import::{ImportError, Notes};

pub const CLOUD: &str = "sensor_msgs/PointCloud2";
pub const IMAGES: [&str; 2] = ["sensor_msgs/Image", "sensor_msgs/CompressedImage"];
pub const CAMERA_INFO: &str = "sensor_msgs/CameraInfo";
pub const TF: &str = "tf2_msgs/TFMessage";
pub const ODOMETRY: &str = "nav_msgs/Odometry";
pub const POSE: &str = "geometry_msgs/PoseStamped";
pub const POSE_WITH_COVARIANCE: &str = "geometry_msgs/PoseWithCovarianceStamped";
pub const OBJECTS: &str = "vision_msgs/Detection3DArray";
const IMU: &str = "sensor_msgs/Imu";
/// The field of an IMU that is turned into the car's axes.
const IMU_YAW_RATE: &str = "angular_velocity.z";

/// Stamps further from the recorder's times than this come from another clock.
const FAR_STAMP_NS: u64 = 1_000_000_000;

/// A message that is read later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamped {
    pub stamp_ns: u64,
    pub place: Place,
}

/// The messages of one topic in the order of their stamps.
#[derive(Debug, Clone, Default)]
pub struct MessageTrack {
    pub messages: Vec<Stamped>,
}

/// What a pass found.
#[derive(Debug, Clone, Default)]
pub struct BagTimeline {
    pub clouds: MessageTrack,
    pub pictures: MessageTrack,
    pub camera_infos: MessageTrack,
    pub objects: MessageTrack,
    pub tf: TfTree,
    /// The poses of a topic, if the mapping names one.
    pub poses: Vec<(u64, Isometry3<f64>)>,
    /// Whose poses they are; empty where messages do not say it.
    pub pose_frame: String,
    /// Messages of that topic that hold no pose.
    pub n_bad_poses: usize,
    pub speed_mps: Vec<(u64, f64)>,
    pub steering_angle_rad: Vec<(u64, f64)>,
    pub yaw_rate_rps: Vec<(u64, f64)>,
    /// Of an IMU, in its own frame, until [`Self::turn_imu`].
    imu_turns: Vec<(u64, Vector3<f64>)>,
    imu_frame: String,
}

/// The topics that a mapping names, in a bag that has them.
pub struct Topics<'a> {
    pub lidar: &'a BagTopic,
    pub camera: Option<&'a BagTopic>,
    pub camera_info: Option<&'a BagTopic>,
    pub objects: Option<&'a BagTopic>,
    poses: Option<&'a BagTopic>,
    fields: [Option<&'a BagTopic>; 3],
}

impl<'a> Topics<'a> {
    /// Looks up the topics of a mapping.
    ///
    /// # Errors
    /// The bag lacks one, or it is of another type.
    pub fn of(bag: &'a Bag, mapping: &MappingConfig) -> Result<Self, ImportError> {
        let typed = |key: &str, name: &str, types: &[&str]| -> Result<Option<&'a BagTopic>, ImportError> {
            if name.is_empty() {
                return Ok(None);
            }
            let topic = bag.topic(key, name)?;
            if !types.is_empty() && !topic.is_of(types) {
                let (found, wanted) = (&topic.type_name, types.join(" or "));
                let message = format!("{key} is `{name}`, of the type `{found}`; {wanted} is needed");
                return Err(ImportError::at(bag.path(), message));
            }
            topic.message_type().map_err(|why| ImportError::at(bag.path(), why))?;
            Ok(Some(topic))
        };
        let poses = Some(mapping.poses.topic.as_str()).filter(|name| *name != "tf").unwrap_or_default();
        let field = |key: &str, field: &FieldMapping| typed(key, &field.topic, &[]);
        Ok(Self {
            lidar: typed("lidar.topic", &mapping.lidar.topic, &[CLOUD])?.ok_or_else(|| {
                ImportError::at(bag.path(), "lidar.topic is empty; `--list` tells the topics")
            })?,
            camera: typed("camera.topic", &mapping.camera.topic, &IMAGES)?,
            camera_info: typed("camera.info_topic", &mapping.camera.info_topic, &[CAMERA_INFO])?,
            objects: typed("objects.topic", &mapping.objects.topic, &[OBJECTS])?,
            poses: typed("poses.topic", poses, &[ODOMETRY, POSE, POSE_WITH_COVARIANCE])?,
            fields: [
                field("speed.topic", &mapping.speed)?,
                field("steering.topic", &mapping.steering)?,
                field("yaw_rate.topic", &mapping.yaw_rate)?,
            ],
        })
    }
}

impl BagTimeline {
    /// Goes once through the bag.
    ///
    /// # Errors
    /// A file is damaged, or a message or field is not as its mapping says.
    pub fn scan(
        bag: &Bag,
        topics: &Topics,
        mapping: &MappingConfig,
        notes: &mut Notes,
    ) -> Result<Self, ImportError> {
        let mut timeline = Self::default();
        let tf: Vec<&BagTopic> = bag.topics().filter(|topic| topic.is_of(&[TF])).collect();
        let single = [topics.camera, topics.camera_info, topics.objects, topics.poses]
            .into_iter()
            .chain(topics.fields)
            .flatten();
        let mut wanted: Vec<&BagTopic> = vec![topics.lidar];
        wanted.extend(single.chain(tf));
        wanted.sort_by_key(|topic| &topic.name);
        wanted.dedup_by_key(|topic| &topic.name);
        let is = |topic: Option<&BagTopic>, name: &str| topic.is_some_and(|topic| topic.name == name);
        let (mut n_invalid, mut n_far) = (0, 0);
        bag.visit(&wanted, |topic, place, value| {
            if topic.is_of(&[TF]) {
                let is_static = topic.name.ends_with("tf_static");
                let log_time_ns = (mapping.stamps == StampSource::Log).then_some(place.log_time_ns);
                n_invalid += timeline.tf.add_message(value, is_static, log_time_ns)?;
                return Ok(());
            }
            let stamp_ns = stamp_of(value, place, mapping.stamps)?;
            n_far += usize::from(stamp_ns.abs_diff(place.log_time_ns) > FAR_STAMP_NS);
            let name = topic.name.as_str();
            if name == topics.lidar.name {
                timeline.clouds.add(stamp_ns, place);
            }
            if is(topics.camera, name) {
                let offset_ns = (mapping.camera.time_offset_s * 1e9) as i64;
                timeline.pictures.add(stamp_ns.saturating_add_signed(offset_ns), place);
            }
            if is(topics.camera_info, name) {
                timeline.camera_infos.add(stamp_ns, place);
            }
            if is(topics.objects, name) {
                timeline.objects.add(stamp_ns, place);
            }
            if is(topics.poses, name) {
                timeline.add_pose(topic, stamp_ns, value)?;
            }
            if name == mapping.yaw_rate.topic && is_turned(topic, &mapping.yaw_rate) {
                timeline.add_turn(stamp_ns, value)?;
            }
            let series = [
                (&mapping.speed, &super::mapping::SPEED_UNITS[..], &mut timeline.speed_mps),
                (&mapping.steering, &super::mapping::ANGLE_UNITS[..], &mut timeline.steering_angle_rad),
                (&mapping.yaw_rate, &super::mapping::RATE_UNITS[..], &mut timeline.yaw_rate_rps),
            ];
            for (field, units, values) in series.into_iter().filter(|(field, ..)| field.topic == name) {
                values.push((stamp_ns, field.to_si(value.number(&field.field)?, units)));
            }
            Ok(())
        })?;
        if n_invalid > 0 {
            notes.tell(format!(
                "{n_invalid} tf messages hold a rotation of length 0 or a NaN; they are left out"
            ));
        }
        if n_far > 0 {
            notes.tell(format!(
                "{n_far} messages have a header stamp more than 1 s from the recorder's time; where sensors have different \
                 clocks, `stamps = \"log\"` takes the recorder's"
            ));
        }
        timeline.sort(topics, notes);
        Ok(timeline)
    }

    fn add_pose(&mut self, topic: &BagTopic, stamp_ns: u64, value: &Value) -> Result<(), CdrError> {
        let pose = if topic.is_of(&[POSE]) { "pose" } else { "pose.pose" };
        let (position, orientation) = (format!("{pose}.position"), format!("{pose}.orientation"));
        if let Some(isometry) = isometry_of(value, &position, &orientation)? {
            self.poses.push((stamp_ns, isometry));
        } else {
            self.n_bad_poses += 1;
        }
        if topic.is_of(&[ODOMETRY]) && self.pose_frame.is_empty() {
            frame_name(value.text("child_frame_id")?).clone_into(&mut self.pose_frame);
        }
        Ok(())
    }

    fn add_turn(&mut self, stamp_ns: u64, value: &Value) -> Result<(), CdrError> {
        let turn = Vector3::from(value.numbers_at("angular_velocity", ["x", "y", "z"])?);
        if turn.iter().all(|part| part.is_finite()) {
            self.imu_turns.push((stamp_ns, turn));
        }
        if self.imu_frame.is_empty() {
            frame_name(value.text("header.frame_id")?).clone_into(&mut self.imu_frame);
        }
        Ok(())
    }

    /// Makes the yaw rate of an IMU that about the base frame's z, where tf tells how it is mounted. Returns whether it does.
    pub fn turn_imu(&mut self, mapping: &MappingConfig, notes: &mut Notes) -> bool {
        if self.imu_turns.is_empty() {
            return false;
        }
        let (base, frame) = (&mapping.frames.base, &self.imu_frame);
        let stamp_ns = self.tf.stamps_between(base, frame).first().copied().unwrap_or(0);
        let found = self.tf.lookup(base, frame, stamp_ns, 0);
        let base_from_imu =
            found.as_ref().map_or_else(|_| UnitQuaternion::identity(), |found| found.rotation);
        if found.is_err() {
            notes.tell(format!(
                "tf does not connect the IMU's frame `{frame}` with `{base}`; its z axis is taken to point up"
            ));
        }
        let about_z = |(at_ns, turn): &(u64, Vector3<f64>)| {
            (*at_ns, mapping.yaw_rate.to_si((base_from_imu * turn).z, &RATE_UNITS))
        };
        self.yaw_rate_rps = self.imu_turns.iter().map(about_z).collect();
        found.is_ok()
    }

    fn sort(&mut self, topics: &Topics, notes: &mut Notes) {
        self.clouds.sort(&topics.lidar.name, notes);
        self.camera_infos.messages.sort();
        for (topic, track) in [(topics.camera, &mut self.pictures), (topics.objects, &mut self.objects)] {
            if let Some(topic) = topic {
                track.sort(&topic.name, notes);
            }
        }
        self.poses.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        self.poses.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        for series in [&mut self.speed_mps, &mut self.steering_angle_rad, &mut self.yaw_rate_rps] {
            series.retain(|(_, value)| value.is_finite());
            series.sort_by_key(|(stamp_ns, _)| *stamp_ns);
            series.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        }
        self.imu_turns.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        self.imu_turns.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
    }
}

/// Whether a yaw rate is an IMU's, whose axes need not be the car's. Who gives it a negative scale has turned it already.
fn is_turned(topic: &BagTopic, yaw_rate: &FieldMapping) -> bool {
    topic.is_of(&[IMU]) && yaw_rate.field == IMU_YAW_RATE && yaw_rate.scale > 0.0
}

/// A message's time by the mapping's choice; what has no stamp, or the stamp 0, has the recorder's.
fn stamp_of(value: &Value, place: Place, source: StampSource) -> Result<u64, CdrError> {
    if source == StampSource::Log || value.at("header.stamp").is_err() {
        return Ok(place.log_time_ns);
    }
    Ok(match stamp_ns(value, "header.stamp")? {
        0 => place.log_time_ns,
        stamp_ns => stamp_ns,
    })
}

impl MessageTrack {
    fn add(&mut self, stamp_ns: u64, place: Place) {
        self.messages.push(Stamped { stamp_ns, place });
    }

    fn sort(&mut self, topic: &str, notes: &mut Notes) {
        let n_late = self.messages.windows(2).filter(|pair| pair[1].stamp_ns < pair[0].stamp_ns).count();
        if n_late > 0 {
            notes.tell(format!(
                "topic `{topic}`: {n_late} messages have a stamp before that of the message before them; they are taken in \
                 the order of stamps"
            ));
        }
        self.messages.sort_by_key(|message| message.stamp_ns);
        let n_before = self.messages.len();
        self.messages.dedup_by_key(|message| message.stamp_ns);
        let n_double = n_before - self.messages.len();
        if n_double > 0 {
            notes.tell(format!(
                "topic `{topic}`: {n_double} messages have the stamp of another; they are left out"
            ));
        }
    }

    /// The message nearest to a time.
    #[must_use]
    pub fn nearest(&self, time_ns: u64) -> Option<Stamped> {
        let after = self.messages.partition_point(|message| message.stamp_ns < time_ns);
        let around = &self.messages[after.saturating_sub(1)..(after + 1).min(self.messages.len())];
        around.iter().copied().min_by_key(|message| message.stamp_ns.abs_diff(time_ns))
    }

    /// The message of `topic` nearest to a cloud.
    ///
    /// # Errors
    /// A sentence: there is none within the tolerance.
    pub fn near(&self, topic: &str, time_ns: u64, tolerance_ns: u64) -> Result<Stamped, String> {
        let found = self.nearest(time_ns).ok_or_else(|| format!("topic `{topic}` holds no message"))?;
        let apart_ns = found.stamp_ns.abs_diff(time_ns);
        if apart_ns <= tolerance_ns {
            return Ok(found);
        }
        let [apart_ms, most_ms] = [apart_ns, tolerance_ns].map(|span_ns| span_ns as f64 * 1e-6);
        Err(format!(
            "the cloud is of {} and the nearest message of `{topic}` of {}, {apart_ms:.0} ms apart; at most {most_ms:.0} ms \
             are allowed (stamp_tolerance_s)",
            seconds(time_ns),
            seconds(found.stamp_ns)
        ))
    }

    /// First and last stamp as people read them.
    #[must_use]
    pub fn span(&self) -> String {
        match self.messages.as_slice() {
            [] => "no messages".into(),
            [only] => format!("one at {}", seconds(only.stamp_ns)),
            [first, .., last] => format!("{} to {}", seconds(first.stamp_ns), seconds(last.stamp_ns)),
        }
    }
}
