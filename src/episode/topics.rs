//! The topics of each kind of file, and the message that each topic carries.

use std::marker::PhantomData;

use foxglove::messages as fox;

use super::messages::{TopicMessage, wire};

/// A topic that carries messages of one type; another type does not compile.
pub struct Topic<M> {
    pub name: &'static str,
    message: PhantomData<fn() -> M>,
}

/// A topic as a file declares it, with its schema's full name and binary `FileDescriptorSet`.
pub struct TopicSpec {
    pub name: &'static str,
    pub schema: fn() -> (String, Vec<u8>),
}

impl<M: TopicMessage> Topic<M> {
    pub const fn new(name: &'static str) -> Self {
        Self { name, message: PhantomData }
    }

    pub const fn spec(&self) -> TopicSpec {
        TopicSpec { name: self.name, schema: M::schema }
    }
}

/// The topics of a kind of file, in the order in which a writer declares them, which the file's bytes keep.
macro_rules! topics {
    ($all:ident: $($name:ident = $text:literal of $message:ty),* $(,)?) => {
        $(pub const $name: Topic<$message> = Topic::new($text);)*
        pub const $all: &[TopicSpec] = &[$($name.spec()),*];
    };
}

topics! { OF_MEASURED:
    MAP = "/map" of fox::SceneUpdate,
    TF = "/tf" of fox::FrameTransforms,
    EGO_POSE = "/ego/pose" of fox::PoseInFrame,
    EGO_STATE = "/ego/state" of wire::EgoState,
    IMAGE = "/cam_front/image_rect_compressed" of fox::CompressedImage,
    CAMERA_INFO = "/cam_front/camera_info" of fox::CameraCalibration,
    LIDAR = "/lidar_top" of fox::PointCloud,
}
topics! { OF_TRUTH:
    OBJECTS = "/truth/objects" of wire::Objects,
    MARKERS = "/truth/markers" of fox::SceneUpdate,
    IGNORED = "/truth/ignored" of wire::IgnoredRegions,
}
topics! { OF_LABELS:
    HARM_ZONE = "/harm/zone" of fox::SceneUpdate,
    HARM_OBJECTS = "/harm/objects" of fox::SceneUpdate,
    HARM_ANNOTATIONS = "/cam_front/harm_annotations" of fox::ImageAnnotations,
    HARM_LABELS = "/harm/labels" of wire::HarmLabels,
}
topics! { OF_DETECTIONS:
    DETECTIONS = "/detections" of wire::Detections,
    DETECTION_MARKERS = "/detections/markers" of fox::SceneUpdate,
}
topics! { OF_COMMANDS:
    COMMANDS = "/drive/command" of wire::DriveCommand,
}
topics! { OF_VIEW:
    VIEW_EGO = "/view/ego" of fox::SceneUpdate,
    VIEW_NUMBERS = "/view/numbers" of wire::ViewNumbers,
}
topics! { OF_VIEW_TRUTH:
    VIEW_BOXES = "/view/boxes" of fox::SceneUpdate,
    VIEW_TRUTH_ANNOTATIONS = "/view/truth_annotations" of fox::ImageAnnotations,
    VIEW_OBJECTS = "/view/objects" of wire::ViewObjects,
}
topics! { OF_VIEW_LABELS:
    VIEW_ZONE = "/view/zone" of fox::SceneUpdate,
}
topics! { OF_VIEW_DETECTIONS:
    VIEW_DETECTIONS = "/view/detections" of fox::SceneUpdate,
    VIEW_DETECTION_ANNOTATIONS = "/view/detection_annotations" of fox::ImageAnnotations,
}

/// The drawings in episodes, labels and predictions, in whose place a file for viewers has drawings of its own.
pub const DRAWINGS: &[&str] =
    &[MARKERS.name, HARM_ZONE.name, HARM_OBJECTS.name, HARM_ANNOTATIONS.name, DETECTION_MARKERS.name];

/// The topics that a reader of episodes needs, with one message per sample.
pub const EACH_SAMPLE: &[TopicSpec] =
    &[TF.spec(), EGO_STATE.spec(), IMAGE.spec(), CAMERA_INFO.spec(), LIDAR.spec()];

/// The end of the topics of cameras' pictures.
const IMAGE_SUFFIX: &str = "/image_rect_compressed";

/// The topics of a camera: its pictures and its calibration.
#[must_use]
pub fn of_camera(name: &str) -> [String; 2] {
    [format!("/{name}{IMAGE_SUFFIX}"), format!("/{name}/camera_info")]
}

/// The end of the topics of clouds between samples.
const SWEEPS_SUFFIX: &str = "/sweeps";

/// The topic of a LiDAR's clouds.
#[must_use]
pub fn of_lidar(name: &str) -> String {
    format!("/{name}")
}

/// The topic of a LiDAR's clouds between samples.
#[must_use]
pub fn of_sweeps(name: &str) -> String {
    format!("/{name}{SWEEPS_SUFFIX}")
}

/// The LiDAR whose clouds a topic carries: its name begins with `lidar_`.
#[must_use]
pub fn lidar_of(topic: &str) -> Option<&str> {
    topic.strip_prefix('/').filter(|name| name.starts_with("lidar_") && !name.contains('/'))
}

/// The LiDAR whose clouds between samples a topic carries.
#[must_use]
pub fn lidar_of_sweeps(topic: &str) -> Option<&str> {
    lidar_of(topic.strip_suffix(SWEEPS_SUFFIX)?)
}

/// The camera whose pictures a topic carries.
#[must_use]
pub fn camera_of(topic: &str) -> Option<&str> {
    topic.strip_prefix('/')?.strip_suffix(IMAGE_SUFFIX)
}
