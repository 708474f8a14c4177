//! A mapping for a bag that nobody has described: guessed by types, names, frames and the tf tree, each guess with its reason.

use super::bag::{Bag, BagTopic};
use super::mapping::{FieldMapping, MappingConfig};
use super::tf::{TfTree, frame_name};
use super::timeline::{CAMERA_INFO, CLOUD, IMAGES, OBJECTS, ODOMETRY, POSE, POSE_WITH_COVARIANCE, TF};
use crate::import::ImportError;

const BASE_FRAMES: [&str; 7] =
    ["base_link", "base_footprint", "ego_vehicle", "vehicle", "ego", "base", "rear_axle"];
const FIXED_FRAMES: [&str; 5] = ["odom", "map", "world", "earth", "utm"];
const OTHER_CLOUDS: [&str; 9] =
    ["radar", "ground", "cluster", "object", "depth", "filter", "segment", "map", "stereo"];
const OTHER_PICTURES: [&str; 9] =
    ["depth", "dispar", "mask", "seg", "thermal", "infra", "label", "debug", "confidence"];
/// A picture's topic is that of the front camera the sooner the more of these its name holds; with their weights.
const PICTURE_WORDS: [(&str, i32); 12] = [
    ("front", 8),
    ("fwd", 8),
    ("forward", 8),
    ("rear", -8),
    ("back", -8),
    ("rect", 2),
    ("color", 2),
    ("colour", 2),
    ("rgb", 2),
    ("left", -1),
    ("right", -2),
    ("gray", -2),
];

/// Numbers that mean a speed or an angle in messages of a known type: type, field, unit, scale.
const SPEEDS: [(&str, &str, &str); 8] = [
    ("autoware_vehicle_msgs/VelocityReport", "longitudinal_velocity", "m/s"),
    ("autoware_auto_vehicle_msgs/VelocityReport", "longitudinal_velocity", "m/s"),
    ("nav_msgs/Odometry", "twist.twist.linear.x", "m/s"),
    ("geometry_msgs/TwistStamped", "twist.linear.x", "m/s"),
    ("geometry_msgs/TwistWithCovarianceStamped", "twist.twist.linear.x", "m/s"),
    ("can_msgs/WheelSpeed", "speed", "m/s"),
    ("ackermann_msgs/AckermannDriveStamped", "drive.speed", "m/s"),
    ("ackermann_msgs/AckermannDrive", "speed", "m/s"),
];
const STEERINGS: [(&str, &str, &str); 4] = [
    ("autoware_vehicle_msgs/SteeringReport", "steering_tire_angle", "rad"),
    ("autoware_auto_vehicle_msgs/SteeringReport", "steering_tire_angle", "rad"),
    ("ackermann_msgs/AckermannDriveStamped", "drive.steering_angle", "rad"),
    ("ackermann_msgs/AckermannDrive", "steering_angle", "rad"),
];
const YAW_RATES: [(&str, &str, &str); 1] = [("sensor_msgs/Imu", "angular_velocity.z", "rad/s")];
const PLAIN_NUMBERS: [&str; 4] =
    ["std_msgs/Float32", "std_msgs/Float64", "example_interfaces/Float32", "example_interfaces/Float64"];

/// A proposed mapping, and what was guessed or is missing, by table of the mapping.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Proposal {
    pub mapping: MappingConfig,
    pub reasons: Vec<(&'static str, String)>,
}

impl Proposal {
    fn say(&mut self, table: &'static str, sentence: impl Into<String>) {
        self.reasons.push((table, sentence.into()));
    }

    /// Guesses the mapping of a bag with its tf tree.
    ///
    /// # Errors
    /// A file is damaged, or the first message of a topic is not valid.
    pub fn of(bag: &Bag, tf: &TfTree) -> Result<Self, ImportError> {
        let mut proposal = Self::default();
        let lidar_frame = proposal.lidar(bag)?;
        proposal.camera(bag);
        proposal.frames(tf, &lidar_frame);
        proposal.poses(bag, tf);
        proposal.measured(bag);
        if let Some(topic) = readable(bag).find(|topic| topic.is_of(&[OBJECTS])) {
            proposal.mapping.objects.topic.clone_from(&topic.name);
            proposal.say("objects", "the first topic of annotated boxes");
        }
        proposal.say("vehicle", "a bag does not say it: measure wheelbase and bumper of the car; until then [vehicle] of ros2.toml holds");
        Ok(proposal)
    }

    fn lidar(&mut self, bag: &Bag) -> Result<String, ImportError> {
        let clouds: Vec<&BagTopic> = readable(bag).filter(|topic| topic.is_of(&[CLOUD])).collect();
        let is_other = |topic: &BagTopic| holds(&topic.name, &OTHER_CLOUDS);
        let best = clouds
            .iter()
            .max_by_key(|topic| (!is_other(topic), topic.n_messages, std::cmp::Reverse(&topic.name)));
        let Some(best) = best else {
            self.say("lidar", "MISSING: the bag has no topic of sensor_msgs/PointCloud2 that can be read");
            return Ok(String::new());
        };
        let n = clouds.len();
        self.say("lidar", format!("guessed: {n} topic(s) of clouds; this one has the most messages and no name of derived clouds"));
        self.mapping.lidar.topic.clone_from(&best.name);
        first_frame(bag, best).map(Option::unwrap_or_default)
    }

    fn camera(&mut self, bag: &Bag) {
        let pictures: Vec<&BagTopic> = readable(bag).filter(|topic| topic.is_of(&IMAGES)).collect();
        let infos: Vec<&BagTopic> = readable(bag).filter(|topic| topic.is_of(&[CAMERA_INFO])).collect();
        let n_pictures = pictures.len();
        let info_of = |picture: &BagTopic| {
            // image_transport's convention: the info lies beside the picture, whose name may go on.
            let fits = |info: &&&BagTopic| {
                let (folder, _) = info.name.rsplit_once('/').unwrap_or_default();
                let rest = picture.name.strip_prefix(folder).unwrap_or_default();
                rest.starts_with('/') && (!folder.is_empty() || rest.matches('/').count() <= 2)
            };
            let nearest = infos.iter().filter(fits).max_by_key(|info| info.name.len());
            let only = infos.first().filter(|_| infos.len() == 1 && n_pictures == 1);
            nearest.or(only).copied()
        };
        let score = |topic: &BagTopic| {
            let name = topic.name.to_lowercase();
            let words: i32 =
                PICTURE_WORDS.iter().filter(|(word, _)| name.contains(word)).map(|(_, weight)| weight).sum();
            let other = if holds(&name, &OTHER_PICTURES) { -100 } else { 0 };
            words + other + if info_of(topic).is_some() { 20 } else { 0 }
        };
        let best = pictures
            .iter()
            .max_by_key(|topic| (score(topic), topic.n_messages, std::cmp::Reverse(&topic.name)));
        let Some(best) = best else {
            self.say(
                "camera",
                "MISSING: the bag has no topic of pictures that can be read; the network sees black ones",
            );
            return;
        };
        let n = pictures.len();
        self.say("camera", format!("guessed: {n} topic(s) of pictures; by name (front, rect, color) and whether it has a camera info"));
        if let Some(info) = info_of(best) {
            self.mapping.camera.topic.clone_from(&best.name);
            self.mapping.camera.info_topic.clone_from(&info.name);
            self.say("camera", "info_topic: the camera info beside the picture");
        } else {
            self.say(
                "camera",
                format!(
                    "MISSING: no camera info for `{}`; say `topic` and k, d, distortion_model by hand",
                    best.name
                ),
            );
        }
    }

    fn frames(&mut self, tf: &TfTree, lidar_frame: &str) {
        let frames = tf.frames();
        let is_near =
            |frame: &str| frames.iter().any(|found| found == frame) && tf.connects(frame, lidar_frame);
        if let Some(base) = BASE_FRAMES.iter().find(|frame| is_near(frame)) {
            self.mapping.frames.base = (*base).into();
            self.say(
                "frames",
                format!("base: guessed by its name; tf connects it with the cloud's frame `{lidar_frame}`"),
            );
        } else {
            self.mapping.frames.base =
                if lidar_frame.is_empty() { "base_link".into() } else { lidar_frame.into() };
            self.say("frames", format!(
                "base: MISSING in tf: no frame of the car is connected with the cloud's frame `{lidar_frame}`, which stands for \
                 it; add [[frames.transforms]] from base_link to it, with the LiDAR's mounting"
            ));
        }
        let base = self.mapping.frames.base.clone();
        let moves = |frame: &str| !tf.stamps_between(frame, &base).is_empty();
        let root = tf.root(&base);
        let named = FIXED_FRAMES.iter().find(|frame| is_near(frame) && moves(frame));
        if let Some(fixed) = named {
            self.mapping.frames.fixed = (*fixed).into();
            self.say("frames", "fixed: guessed by its name; the car moves in it");
        } else if root != base && moves(&root) {
            self.mapping.frames.fixed.clone_from(&root);
            self.say("frames", "fixed: the root of the tf tree; the car moves in it");
        }
        self.say("frames", "rear_axle_in_base_m: a bag does not say it; right where the base frame is at the rear axle (x forward)");
        if base != "base_footprint" && !tf.connects("base_footprint", &base) {
            self.say(
                "frames",
                "base_height_m: a bag does not say it; the ground is fitted to the clouds until it is set",
            );
        }
    }

    fn poses(&mut self, bag: &Bag, tf: &TfTree) {
        let frames = &self.mapping.frames;
        if !tf.stamps_between(&frames.fixed, &frames.base).is_empty() {
            self.mapping.poses.topic = "tf".into();
            self.say("poses", "tf knows how the base frame moves in the fixed one");
            return;
        }
        let types = [ODOMETRY, POSE_WITH_COVARIANCE, POSE];
        let found = types.iter().find_map(|name| readable(bag).find(|topic| topic.is_of(&[name])));
        if let Some(topic) = found {
            self.mapping.poses.topic.clone_from(&topic.name);
            self.say("poses", "guessed by its type; tf does not tell how the car moves");
        } else {
            self.mapping.poses.topic = String::new();
            self.say("poses", "MISSING: neither tf nor a topic tells them; speed and yaw rate are added up if they are there");
        }
    }

    fn measured(&mut self, bag: &Bag) {
        let find = |types: &[(&str, &str, &str)], words: &[&str], unit: &str| -> (FieldMapping, String) {
            for (type_name, field, unit) in types {
                if let Some(topic) = readable(bag).find(|topic| topic.is_of(&[type_name])) {
                    let has_field = topic
                        .message_type()
                        .is_ok_and(|found| found.number_paths().iter().any(|path| path == field));
                    if has_field {
                        let is_command = if type_name.starts_with("ackermann") {
                            "; it may be a command, not a measurement"
                        } else {
                            ""
                        };
                        let mapping = field_of(&topic.name, field, unit);
                        return (mapping, format!("guessed by its type {type_name}{is_command}"));
                    }
                }
            }
            let plain = readable(bag).find(|topic| topic.is_of(&PLAIN_NUMBERS) && holds(&topic.name, words));
            if let Some(topic) = plain {
                let sentence = "guessed by its name; check its unit and sign";
                return (field_of(&topic.name, "data", unit), sentence.into());
            }
            let others: Vec<String> = readable(bag)
                .filter_map(|topic| {
                    let paths = topic.message_type().ok()?.number_paths();
                    let is_meant = |path: &String| {
                        let is_other = path.starts_with("header.") || holds(path, &["angular", "covariance"]);
                        !is_other && (holds(path, words) || holds(&topic.name, words))
                    };
                    let path = paths.into_iter().find(is_meant)?;
                    Some(format!("`{}` with field = \"{path}\"", topic.name))
                })
                .take(3)
                .collect();
            let hint =
                if others.is_empty() { String::new() } else { format!("; perhaps {}", others.join(", or ")) };
            (FieldMapping::default(), format!("not found{hint}"))
        };
        let (speed, why) = find(&SPEEDS, &["speed", "velocity"], "m/s");
        self.mapping.speed = speed;
        self.say("speed", format!("{why}{}", if why.starts_with("not") { "; from the poses" } else { "" }));
        let (steering, why) = find(&STEERINGS, &["steer", "wheel_angle"], "rad");
        self.mapping.steering = steering;
        self.say(
            "steering",
            format!("{why}{}", if why.starts_with("not") { "; from the poses" } else { "" }),
        );
        let (yaw_rate, why) = find(&YAW_RATES, &["yaw_rate", "yawrate"], "rad/s");
        self.mapping.yaw_rate = yaw_rate;
        self.say(
            "yaw_rate",
            if why.starts_with("not") { why } else { format!("{why}; right where the IMU's z points up") },
        );
    }
}

fn field_of(topic: &str, field: &str, unit: &str) -> FieldMapping {
    FieldMapping { topic: topic.into(), field: field.into(), unit: unit.into(), ..FieldMapping::default() }
}

/// Topics with messages of known fields.
fn readable(bag: &Bag) -> impl Iterator<Item = &BagTopic> {
    bag.topics().filter(|topic| topic.n_messages > 0 && topic.message_type().is_ok())
}

fn holds(name: &str, words: &[&str]) -> bool {
    let name = name.to_lowercase();
    words.iter().any(|word| name.contains(word))
}

/// The frame of a topic's first message; `None` where its messages have no header.
///
/// # Errors
/// The file is damaged, or the message is not valid.
pub fn first_frame(bag: &Bag, topic: &BagTopic) -> Result<Option<String>, ImportError> {
    let Some(&first) = bag.places(topic)?.first() else { return Ok(None) };
    bag.read(topic, first, |value| {
        Ok(value.text("header.frame_id").ok().map(|frame| frame_name(frame).to_owned()))
    })
}

/// The tf tree of a bag.
///
/// # Errors
/// The file is damaged, or a message is not valid.
pub fn tf_tree(bag: &Bag) -> Result<TfTree, ImportError> {
    let topics: Vec<&BagTopic> =
        bag.topics().filter(|topic| topic.is_of(&[TF]) && topic.message_type().is_ok()).collect();
    let mut tree = TfTree::default();
    bag.visit(&topics, |topic, _, value| {
        tree.add_message(value, topic.name.ends_with("tf_static"), None).map(drop)
    })?;
    // Told when the bag is imported.
    let _ = tree.finish("");
    Ok(tree)
}
