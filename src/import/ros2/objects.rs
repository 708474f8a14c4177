//! Annotated boxes of a bag: `vision_msgs/Detection3DArray`.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};

use super::cdr::{CdrError, Value};
use super::message::{frame_name, isometry_of};
use crate::geometry::{Box3, Point};
use crate::import::RawObject;

/// The objects of a message of this time, and a sentence where ids are of no use; `ego_from` gives the pose of a frame then.
///
/// An id that several boxes of the message have is none.
///
/// # Errors
/// A field is missing, or a box's frame has no pose.
pub fn objects(
    message: &Value,
    stamp_ns: u64,
    ego_from: impl Fn(&str) -> Result<Isometry3<f64>, String>,
) -> Result<(Vec<RawObject>, Option<String>), String> {
    let tell = |error: CdrError| error.to_string();
    let whole_frame = frame_name(message.text("header.frame_id").map_err(tell)?);
    let mut objects = Vec::new();
    let detections = message.list("detections").map_err(tell)?;
    let mut n_named: BTreeMap<&str, usize> = BTreeMap::new();
    for name in detections.iter().filter_map(name_of) {
        *n_named.entry(name).or_insert(0) += 1;
    }
    let told = n_named.values().any(|n| *n > 1).then(|| {
        "messages of boxes give several boxes one id; such boxes are taken as without id, each of its message alone".to_owned()
    });
    for (idx, detection) in detections.iter().enumerate() {
        let own_frame = detection.text("header.frame_id").map(frame_name).unwrap_or_default();
        let frame = if own_frame.is_empty() { whole_frame } else { own_frame };
        let pose = isometry_of(detection, "bbox.center.position", "bbox.center.orientation").map_err(tell)?;
        let pose = pose
            .ok_or_else(|| format!("box {idx} has a pose that is none: a NaN or a rotation of length 0"))?;
        let ego_from_box = ego_from(frame)? * pose;
        let [length_m, width_m, height_m] =
            detection.numbers_at("bbox.size", ["x", "y", "z"]).map_err(tell)?;
        let [x_m, y_m, z_m] = ego_from_box.translation.vector.into();
        let ahead = ego_from_box.rotation * Vector3::x();
        let box_in_ego = Box3 {
            center: Point::new(x_m, y_m, z_m),
            length_m,
            width_m,
            height_m,
            yaw_rad: ahead.y.atan2(ahead.x),
        };
        box_in_ego.check().map_err(|error| format!("box {idx}: {error}"))?;
        objects.push(RawObject {
            id: id_of(name_of(detection).filter(|name| n_named[name] == 1), stamp_ns, idx),
            category: category_of(detection).map_err(tell)?,
            box_in_ego,
            velocity_in_ego_mps: [f64::NAN; 2],
        });
    }
    Ok((objects, told))
}

/// The tracker's name of the object, else its message's time and place there: no other message's box is known to be the same thing.
fn id_of(name: Option<&str>, stamp_ns: u64, idx: usize) -> String {
    name.map_or_else(|| format!("{stamp_ns}-{idx}"), str::to_owned)
}

/// The tracker's name of an object, where it gives one.
fn name_of<'a>(detection: &Value<'a>) -> Option<&'a str> {
    let named = ["id", "tracking_id"].iter().find_map(|field| detection.text(field).ok());
    named.filter(|id| !id.is_empty())
}

/// The class of the likeliest hypothesis; versions of vision_msgs differ in where it stands.
fn category_of(detection: &Value) -> Result<String, CdrError> {
    let mut best: Option<(f64, String)> = None;
    for result in detection.list("results")? {
        let (score, name) = match result.at("hypothesis") {
            Ok(hypothesis) => (hypothesis.number("score")?, hypothesis.text("class_id")?),
            Err(_) => (result.number("score")?, result.text("id")?),
        };
        if best.as_ref().is_none_or(|(highest, _)| score > *highest) {
            best = Some((score, name.to_owned()));
        }
    }
    Ok(best.map_or_else(|| "unknown".to_owned(), |(_, name)| name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_without_a_name_is_the_same_as_none_of_another_message() {
        let named = |id| Value::Struct(vec![("id", Value::Text(id))]);
        assert_eq!(id_of(name_of(&named("car-7")), 5, 0), "car-7");
        let unnamed = [5, 6].map(|stamp_ns| id_of(name_of(&named("")), stamp_ns, 1));
        assert_eq!(unnamed, ["5-1", "6-1"]);
    }
}
