//! The names of the topics.

pub const TF: &str = "/tf";
pub const EGO_POSE: &str = "/ego/pose";
pub const EGO_STATE: &str = "/ego/state";
pub const IMAGE: &str = "/cam_front/image_rect_compressed";
pub const CAMERA_INFO: &str = "/cam_front/camera_info";
pub const LIDAR: &str = "/lidar_top";
pub const OBJECTS: &str = "/truth/objects";
pub const MARKERS: &str = "/truth/markers";
pub const MAP: &str = "/map";

pub const HARM_ZONE: &str = "/harm/zone";
pub const HARM_OBJECTS: &str = "/harm/objects";
pub const HARM_ANNOTATIONS: &str = "/cam_front/harm_annotations";
pub const HARM_LABELS: &str = "/harm/labels";

pub const DETECTIONS: &str = "/detections";
pub const DETECTION_MARKERS: &str = "/detections/markers";

/// What a reader of episodes wants, one message a sample.
pub const EACH_SAMPLE: [&str; 6] = [TF, EGO_STATE, IMAGE, CAMERA_INFO, LIDAR, OBJECTS];
