//! The layout that Foxglove opens our files with: the camera, the scene in space, plots, and a table of the objects.
//!
//! The form is that of a file which Foxglove exports and imports: a config for each panel by its name, and how the panels divide the
//! window. Its best is a file of `harmzone view --mcap`; with episodes, labels and predictions as they are written it shows those.

use serde_json::{Map, Value, json};

use super::canvas::Color;
use super::palette;
use crate::object::Harm;

const CAMERA: &str = "Image!harmzone_camera";
const SPACE: &str = "3D!harmzone_space";
const SPEED: &str = "Plot!harmzone_speed";
const STEERING: &str = "Plot!harmzone_steering";
const ZONE: &str = "Plot!harmzone_zone";
const HARMFUL: &str = "Plot!harmzone_harmful";
const OBJECTS: &str = "Table!harmzone_objects";

/// Frames whose axes would lie over the scene.
const FRAMES: [&str; 4] = ["map", "ego", "lidar_top", "cam_front"];
/// Heights of points over the LiDAR, which is about so high over the road, metres.
const LIDAR_HEIGHT_M: f32 = 1.84;
/// The virtual camera: behind the car, looking over it, degrees and metres.
const BEHIND_DEG: f64 = 90.0;
const TILT_DEG: f64 = 62.0;
const DISTANCE_M: f64 = 34.0;
const LOOK_AHEAD_M: f64 = 9.0;

/// The layout as the text of a file.
#[must_use]
pub fn foxglove_layout() -> String {
    let mut text = serde_json::to_string_pretty(&layout()).expect("a layout is plain JSON");
    text.push('\n');
    text
}

fn layout() -> Value {
    let plots = split("column", split("row", SPEED, STEERING, 50), split("row", ZONE, HARMFUL, 50), 50);
    json!({
        "configById": {
            CAMERA: camera(),
            SPACE: space(),
            SPEED: plot("Speed", &[("speed_mps", "speed, m/s", palette::TEXT)]),
            STEERING: plot("Steering", &[("steering_deg", "steering, degrees to the left", palette::TEXT)]),
            ZONE: plot("Danger zone", &[("zone_depth_m", "zone beyond the bumper, m", palette::ZONE)]),
            HARMFUL: plot("Harmful objects", &[
                ("n_harmful", "harmful", palette::truth(Harm::Harmful)),
                ("n_predicted_harmful", "predicted harmful", palette::predicted(Harm::Harmful)),
            ]),
            OBJECTS: { "topicPath": "/view/objects.objects", "foxglovePanelTitle": "Objects" },
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": split("row", split("column", CAMERA, plots, 56), split("column", SPACE, OBJECTS, 70), 48),
    })
}

/// Two parts of the window, panels or splits; the first takes so many percent of it.
fn split(direction: &str, first: impl Into<Value>, second: impl Into<Value>, percent: u32) -> Value {
    json!({
        "direction": direction, "first": first.into(), "second": second.into(), "splitPercentage": percent
    })
}

fn camera() -> Value {
    json!({
        "foxglovePanelTitle": "Camera",
        "imageMode": {
            "imageTopic": "/cam_front/image_rect_compressed",
            "calibrationTopic": "/cam_front/camera_info",
            "annotations": {
                "/view/truth_annotations": { "visible": true },
                "/view/detection_annotations": { "visible": true },
                "/cam_front/harm_annotations": { "visible": true },
            },
        },
        "scene": { "backgroundColor": hex(palette::PANEL) },
        // What lies in space is in the annotations.
        "topics": {
            "/lidar_top": { "visible": false }, "/map": { "visible": false }, "/view/boxes": { "visible": false },
            "/view/zone": { "visible": false }, "/view/detections": { "visible": false },
            "/view/ego": { "visible": false }, "/truth/markers": { "visible": false },
            "/harm/zone": { "visible": false }, "/harm/objects": { "visible": false },
            "/detections/markers": { "visible": false },
        },
        "transforms": {},
        "layers": {},
    })
}

fn space() -> Value {
    let frames: Map<String, Value> =
        FRAMES.iter().map(|frame| (format!("frame:{frame}"), json!({ "visible": false }))).collect();
    let (low_m, high_m) = palette::HEIGHT_RANGE_M;
    json!({
        "foxglovePanelTitle": "Space",
        "cameraState": {
            "perspective": true, "distance": DISTANCE_M, "phi": TILT_DEG, "thetaOffset": BEHIND_DEG,
            "target": [0, 0, 0], "targetOffset": [LOOK_AHEAD_M, 0, 0], "targetOrientation": [0, 0, 0, 1],
            "fovy": 45, "near": 0.5, "far": 5000,
        },
        "followMode": "follow-pose",
        "followTf": "ego",
        "scene": { "backgroundColor": hex(palette::PANEL), "enableStats": false },
        "transforms": frames,
        "topics": {
            "/lidar_top": {
                "visible": true, "colorMode": "gradient", "colorField": "z",
                "gradient": [hex_with_alpha(palette::height(0.0)), hex_with_alpha(palette::height(1.0))],
                "minValue": low_m - LIDAR_HEIGHT_M, "maxValue": high_m - LIDAR_HEIGHT_M,
                "pointSize": 2.5, "pointShape": "circle", "decayTime": 0,
            },
            "/map": { "visible": true, "showOutlines": false },
            "/view/ego": { "visible": true, "showOutlines": false },
            "/view/boxes": { "visible": true, "showOutlines": false },
            "/view/zone": { "visible": true, "showOutlines": false },
            "/view/detections": { "visible": true, "showOutlines": false },
            // Of episodes, labels and predictions as they are; a file of `view` has none of these.
            "/harm/zone": { "visible": true },
            "/harm/objects": { "visible": true },
            "/detections/markers": { "visible": true },
            // The same boxes as `/harm/objects`, which would flicker through each other.
            "/truth/markers": { "visible": false },
        },
        "layers": {
            "harmzone_grid": {
                "instanceId": "harmzone_grid", "layerId": "foxglove.Grid", "label": "Grid of 10 m", "visible": true,
                "frameId": "ego", "size": 120, "divisions": 12, "lineWidth": 1,
                "color": hex(palette::RING) + "80", "position": [0, 0, 0], "rotation": [0, 0, 0], "order": 1,
            },
        },
        "publish": {},
    })
}

/// A plot of fields of `/view/numbers`: each with its label and colour.
fn plot(title: &str, fields: &[(&str, &str, Color)]) -> Value {
    let paths: Vec<Value> = fields
        .iter()
        .map(|(field, label, color)| {
            json!({
                "value": format!("/view/numbers.{field}"), "enabled": true, "timestampMethod": "receiveTime",
                "label": label, "color": hex(*color), "showLine": true, "lineSize": 2,
            })
        })
        .collect();
    json!({
        "foxglovePanelTitle": title, "paths": paths, "xAxisVal": "timestamp", "isSynced": true, "showLegend": true,
        "legendDisplay": "floating", "showPlotValuesInLegend": true, "showXAxisLabels": true, "showYAxisLabels": true,
        "sidebarDimension": 240,
    })
}

fn hex(color: Color) -> String {
    let [red, green, blue] = color.rgb;
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn hex_with_alpha(color: Color) -> String {
    hex(color) + "ff"
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use fs_err as fs;

    use super::*;

    #[test]
    fn the_copy_in_the_docs_is_the_layout() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/foxglove_layout.json");
        let copy = fs::read_to_string(path).unwrap();
        assert!(
            copy == foxglove_layout(),
            "write it anew: harmzone foxglove-layout --out docs/foxglove_layout.json --force"
        );
    }

    /// Names of panels in a part of the window.
    fn panels(part: &Value, found: &mut BTreeSet<String>) {
        match part {
            Value::String(name) => assert!(found.insert(name.clone()), "{name} is shown twice"),
            _ => ["first", "second"].iter().for_each(|side| panels(&part[side], found)),
        }
    }

    #[test]
    fn every_panel_has_a_config_and_a_place() {
        let layout = layout();
        let mut shown = BTreeSet::new();
        panels(&layout["layout"], &mut shown);
        let configured: BTreeSet<String> =
            layout["configById"].as_object().unwrap().keys().cloned().collect();
        assert_eq!(shown, configured);
    }
}
