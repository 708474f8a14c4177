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

pub const TF: Topic<fox::FrameTransforms> = Topic::new("/tf");
pub const EGO_POSE: Topic<fox::PoseInFrame> = Topic::new("/ego/pose");
pub const EGO_STATE: Topic<wire::EgoState> = Topic::new("/ego/state");
pub const IMAGE: Topic<fox::CompressedImage> = Topic::new("/cam_front/image_rect_compressed");
pub const CAMERA_INFO: Topic<fox::CameraCalibration> = Topic::new("/cam_front/camera_info");
pub const LIDAR: Topic<fox::PointCloud> = Topic::new("/lidar_top");
pub const OBJECTS: Topic<wire::Objects> = Topic::new("/truth/objects");
pub const MARKERS: Topic<fox::SceneUpdate> = Topic::new("/truth/markers");
pub const MAP: Topic<fox::SceneUpdate> = Topic::new("/map");

pub const HARM_ZONE: Topic<fox::SceneUpdate> = Topic::new("/harm/zone");
pub const HARM_OBJECTS: Topic<fox::SceneUpdate> = Topic::new("/harm/objects");
pub const HARM_ANNOTATIONS: Topic<fox::ImageAnnotations> = Topic::new("/cam_front/harm_annotations");
pub const HARM_LABELS: Topic<wire::HarmLabels> = Topic::new("/harm/labels");

pub const DETECTIONS: Topic<wire::Detections> = Topic::new("/detections");
pub const DETECTION_MARKERS: Topic<fox::SceneUpdate> = Topic::new("/detections/markers");

// A writer declares a file's topics in this order, which the file's bytes keep.
pub const OF_EPISODE: [TopicSpec; 9] = [
    MAP.spec(),
    TF.spec(),
    EGO_POSE.spec(),
    EGO_STATE.spec(),
    IMAGE.spec(),
    CAMERA_INFO.spec(),
    LIDAR.spec(),
    OBJECTS.spec(),
    MARKERS.spec(),
];
pub const OF_LABELS: [TopicSpec; 4] =
    [HARM_ZONE.spec(), HARM_OBJECTS.spec(), HARM_ANNOTATIONS.spec(), HARM_LABELS.spec()];
pub const OF_DETECTIONS: [TopicSpec; 2] = [DETECTIONS.spec(), DETECTION_MARKERS.spec()];

/// What a reader of episodes needs, one message a sample.
pub const EACH_SAMPLE: [TopicSpec; 6] =
    [TF.spec(), EGO_STATE.spec(), IMAGE.spec(), CAMERA_INFO.spec(), LIDAR.spec(), OBJECTS.spec()];
