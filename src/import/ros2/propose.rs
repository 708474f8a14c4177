//! A mapping for a bag that nobody has described: guessed by types, names, frames and the tf tree, each guess with its reason.

use super::bag::{Bag, BagTopic};
use super::mapping::MappingConfig;
use super::measured;
use super::tf::TfTree;
use super::timeline::{CAMERA_INFO, CLOUD, IMAGES, OBJECTS, ODOMETRY, POSE, POSE_WITH_COVARIANCE, TF};
use super::words::{has_word, holds};
use crate::import::ImportError;

const BASE_FRAMES: [&str; 7] =
    ["base_link", "base_footprint", "ego_vehicle", "vehicle", "ego", "base", "rear_axle"];
const FIXED_FRAMES: [&str; 5] = ["odom", "map", "world", "earth", "utm"];
const OTHER_CLOUDS: [&str; 18] = [
    "radar",
    "ground",
    "cluster",
    "object",
    "depth",
    "filter",
    "segment",
    "map",
    "stereo",
    // What odometries make of a cloud: freed from motion, or already in the world's frame.
    "registered",
    "deskew",
    "undistort",
    "unskew",
    "compensated",
    "corrected",
    "aligned",
    "world",
    "global",
];
/// Of LiDARs with about as many messages, the one that sees all round.
const BEST_LIDARS: [&str; 6] = ["top", "roof", "center", "centre", "concat", "concatenated"];
/// Parts of the names of topics of annotations, beside the word `gt`.
const TRUTH_NAMES: [&str; 4] = ["truth", "label", "annotation", "annotated"];
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

/// A proposed mapping, and what was guessed or is missing, by table of the mapping.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Proposal {
    pub mapping: MappingConfig,
    pub reasons: Vec<(&'static str, String)>,
    /// What an import tells that goes by this proposal.
    pub notes: Vec<String>,
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
        proposal.measured(bag)?;
        proposal.objects(bag);
        proposal.say("vehicle", "a bag does not say it: measure wheelbase and bumper of the car; until then [vehicle] of ros2.toml holds");
        Ok(proposal)
    }

    fn lidar(&mut self, bag: &Bag) -> Result<String, ImportError> {
        let clouds: Vec<&BagTopic> = bag.readable().filter(|topic| topic.is_of(&[CLOUD])).collect();
        let is_other = |topic: &BagTopic| holds(&topic.name, &OTHER_CLOUDS);
        let raw = clouds.iter().filter(|topic| !is_other(topic));
        let most = raw.map(|topic| topic.n_messages).max().unwrap_or(0);
        // Drivers of one rate lose some messages each.
        let is_best =
            |topic: &BagTopic| topic.n_messages * 10 >= most * 9 && has_word(&topic.name, &BEST_LIDARS);
        let best = clouds.iter().max_by_key(|topic| {
            (!is_other(topic), is_best(topic), topic.n_messages, std::cmp::Reverse(&topic.name))
        });
        let Some(best) = best else {
            self.say("lidar", "MISSING: the bag has no topic of sensor_msgs/PointCloud2 that can be read");
            return Ok(String::new());
        };
        let others: Vec<String> = clouds
            .iter()
            .filter(|topic| topic.name != best.name && !is_other(topic))
            .map(|topic| format!("`{}`", topic.name))
            .collect();
        let n = clouds.len();
        self.say("lidar", format!(
            "guessed: {n} topic(s) of clouds; by name (top, roof, center, concat; none of derived clouds) and number of messages"
        ));
        if !others.is_empty() {
            let sentence = format!(
                "the clouds are those of `{}`; not taken: {} (lidar.topic)",
                best.name,
                others.join(", ")
            );
            self.say("lidar", sentence.clone());
            self.notes.push(sentence);
        }
        self.mapping.lidar.topic.clone_from(&best.name);
        bag.first_frame(best).map(Option::unwrap_or_default)
    }

    fn camera(&mut self, bag: &Bag) {
        let pictures: Vec<&BagTopic> = bag.readable().filter(|topic| topic.is_of(&IMAGES)).collect();
        let infos: Vec<&BagTopic> = bag.readable().filter(|topic| topic.is_of(&[CAMERA_INFO])).collect();
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
        let found = types.iter().find_map(|name| bag.readable().find(|topic| topic.is_of(&[name])));
        if let Some(topic) = found {
            self.mapping.poses.topic.clone_from(&topic.name);
            self.say("poses", "guessed by its type; tf does not tell how the car moves");
        } else {
            self.mapping.poses.topic = String::new();
            self.say("poses", "MISSING: neither tf nor a topic tells them; speed and yaw rate are added up if they are there");
        }
    }

    fn measured(&mut self, bag: &Bag) -> Result<(), ImportError> {
        let has_poses = !self.mapping.poses.topic.is_empty();
        let or_poses =
            |why: String| if has_poses && why.starts_with("not") { why + "; from the poses" } else { why };
        let (speed, why) = measured::speed(bag, has_poses)?;
        self.mapping.speed = speed;
        self.say_measured("speed", or_poses(why));
        let (steering, why) = measured::steering(bag, has_poses)?;
        self.mapping.steering = steering;
        self.say_measured("steering", or_poses(why));
        let (yaw_rate, why) = measured::yaw_rate(bag, has_poses)?;
        self.mapping.yaw_rate = yaw_rate;
        let is_imu = why.contains("sensor_msgs/Imu");
        let axes = if is_imu { "; turned into the car's axes where tf connects the IMU's frame" } else { "" };
        self.say_measured("yaw_rate", why + axes);
        Ok(())
    }

    /// What was passed over is told by an import, too.
    fn say_measured(&mut self, table: &'static str, why: String) {
        if why.contains("passed over") {
            self.notes.push(format!("mapping [{table}]: {why}"));
        }
        self.say(table, why);
    }

    fn objects(&mut self, bag: &Bag) {
        let topics: Vec<&BagTopic> = bag.readable().filter(|topic| topic.is_of(&[OBJECTS])).collect();
        let is_truth = |name: &str| has_word(name, &["gt"]) || holds(name, &TRUTH_NAMES);
        let best = topics.iter().find(|topic| is_truth(&topic.name)).or(topics.first());
        let Some(best) = best else { return };
        self.mapping.objects.topic.clone_from(&best.name);
        let why = if is_truth(&best.name) { "by its name" } else { "the first topic of boxes" };
        self.say("objects", format!("guessed: {why}; it must be annotations, not what a detector found"));
        self.notes.push(format!("taken as annotations: topic `{}` (objects.topic)", best.name));
    }
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
