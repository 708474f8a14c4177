//! The file of boxes as it is written: nuScenes' keys, and Python's numbers that are not JSON.

use std::collections::HashMap;
use std::fmt;

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::dataset::SampleFacts;
use crate::geometry::{Box3, BoxError, Ego, Point};
use crate::object::{Detection, Distribution, Event, Harm, Kind, LabelledObject, Object};

/// The file.
#[derive(Deserialize)]
pub struct BoxFile {
    pub results: InOrder,
    #[serde(default)]
    pub samples: HashMap<String, SampleFacts>,
}

impl BoxFile {
    pub fn parse(text: &str) -> serde_json::Result<Self> {
        serde_json::from_str(&replace_python_numbers(text))
    }
}

/// A box as the file has it; a number that is null, NaN or infinite is `None`.
#[derive(Debug, Serialize, Deserialize)]
pub struct RawBox {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_token: Option<String>,
    translation: [Option<f64>; 3],
    size: [Option<f64>; 3],
    rotation: [Option<f64>; 4],
    #[serde(default)]
    velocity: [Option<f64>; 2],
    detection_name: String,
    #[allow(clippy::option_option, reason = "missing and null are two different faults")]
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    detection_score: Option<Option<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distribution: Option<Distribution>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    num_pts: Option<i64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    id: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    category: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kind: Option<Kind>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    visible_fraction: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    event: Option<Event>,
}

/// Tells a null from a missing key.
#[allow(clippy::option_option, reason = "missing and null are two different faults")]
fn present<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<f64>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

impl RawBox {
    fn parts(&self) -> Result<(Box3<Ego>, Harm, [f64; 2]), String> {
        let [x_m, y_m, z_m] = finite("translation", self.translation)?;
        let [width_m, length_m, height_m] = finite("size", self.size)?;
        let [w, x, y, z] = finite("rotation", self.rotation)?;
        let norm = w * w + x * x + y * y + z * z;
        if norm == 0.0 {
            return Err("`rotation` is zero; a quaternion [w, x, y, z] is needed".into());
        }
        // Heading of the turned x axis, as the devkit takes it; only this is scored.
        let yaw_rad = (2.0 * (x * y + w * z) / norm).atan2(1.0 - 2.0 * (y * y + z * z) / norm);
        let center = Point::new(x_m, y_m, z_m);
        let found = Box3 { center, length_m, width_m, height_m, yaw_rad };
        found.check().map_err(|error: BoxError| error.to_string())?;
        let harm =
            Harm::ALL.into_iter().find(|harm| harm.name() == self.detection_name).ok_or_else(|| {
                format!("unknown class `{}`; the classes are harmful and harmless", self.detection_name)
            })?;
        Ok((found, harm, self.velocity.map(|part| part.unwrap_or(f64::NAN))))
    }

    /// The LiDAR points in the box; nuScenes writes -1 where they are not known.
    pub fn n_points(&self) -> Result<Option<u32>, String> {
        let known = self.num_pts.filter(|&n| n != -1);
        let count = |n| u32::try_from(n).map_err(|_| format!("`num_pts` is {n}; -1 or a count is needed"));
        known.map(count).transpose()
    }

    fn new(box_in_ego: &Box3<Ego>, velocity: [f64; 2], harm: Harm) -> Self {
        let (center, half_rad) = (box_in_ego.center, box_in_ego.yaw_rad / 2.0);
        Self {
            sample_token: None,
            translation: [center.x(), center.y(), center.z()].map(Some),
            size: [box_in_ego.width_m, box_in_ego.length_m, box_in_ego.height_m].map(Some),
            rotation: [half_rad.cos(), 0.0, 0.0, half_rad.sin()].map(Some),
            velocity: velocity.map(Some),
            detection_name: harm.name().to_owned(),
            detection_score: None,
            distribution: None,
            num_pts: None,
            id: None,
            category: None,
            kind: None,
            visible_fraction: None,
            event: None,
        }
    }
}

impl From<&Detection> for RawBox {
    fn from(detection: &Detection) -> Self {
        Self {
            detection_score: Some(Some(detection.score)),
            ..Self::new(&detection.box_in_ego, detection.velocity_in_ego_mps, detection.harm)
        }
    }
}

impl TryFrom<RawBox> for Detection {
    type Error = String;

    fn try_from(raw: RawBox) -> Result<Self, String> {
        let (box_in_ego, harm, velocity_in_ego_mps) = raw.parts()?;
        let score = raw.detection_score.ok_or("`detection_score` is missing")?;
        let score =
            score.filter(|score| score.is_finite()).ok_or("`detection_score` is not a finite number")?;
        Ok(Self { box_in_ego, velocity_in_ego_mps, harm, score, spread: None })
    }
}

impl From<&LabelledObject> for RawBox {
    fn from(LabelledObject { truth, harm }: &LabelledObject) -> Self {
        Self {
            distribution: truth.distribution,
            num_pts: truth.n_lidar_points.map(i64::from),
            id: truth.id.clone(),
            category: truth.category.clone(),
            kind: truth.kind,
            visible_fraction: truth.visible_fraction,
            event: truth.event,
            ..Self::new(&truth.box_in_ego, truth.velocity_in_ego_mps, *harm)
        }
    }
}

impl TryFrom<RawBox> for LabelledObject {
    type Error = String;

    fn try_from(raw: RawBox) -> Result<Self, String> {
        let (box_in_ego, harm, velocity_in_ego_mps) = raw.parts()?;
        let n_lidar_points = raw.n_points()?;
        let truth = Object {
            velocity_in_ego_mps,
            id: raw.id,
            category: raw.category,
            kind: raw.kind,
            distribution: raw.distribution,
            n_lidar_points,
            visible_fraction: raw.visible_fraction,
            event: raw.event,
            ..Object::new(box_in_ego)
        };
        Ok(Self { truth, harm })
    }
}

fn finite<const N: usize>(field: &str, values: [Option<f64>; N]) -> Result<[f64; N], String> {
    let mut numbers = [0.0; N];
    for (number, value) in numbers.iter_mut().zip(values) {
        *number = value.filter(|value| value.is_finite()).ok_or_else(|| {
            format!("`{field}` holds NaN, null or an infinite number; finite ones are needed")
        })?;
    }
    Ok(numbers)
}

/// A JSON object in the file's order, repeated keys kept.
pub struct InOrder(pub Vec<(String, Vec<Value>)>);

impl<'de> Deserialize<'de> for InOrder {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = InOrder;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an object of sample: list of boxes")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<InOrder, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(InOrder(entries))
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

/// The text with Python's `NaN`, `Infinity` and `-Infinity`, which are not JSON, replaced by `null`.
#[must_use]
pub fn replace_python_numbers(text: &str) -> std::borrow::Cow<'_, str> {
    const WORDS: [&str; 3] = ["-Infinity", "Infinity", "NaN"];
    if !WORDS.iter().any(|word| text.contains(word)) {
        return text.into();
    }
    let mut cleaned = String::with_capacity(text.len());
    let (mut is_in_string, mut is_escaped) = (false, false);
    let mut rest = text;
    while let Some(character) = rest.chars().next() {
        let word = WORDS.into_iter().find(|word| !is_in_string && rest.starts_with(word));
        if let Some(word) = word {
            cleaned.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        if character == '"' && !is_escaped {
            is_in_string = !is_in_string;
        }
        is_escaped = is_in_string && character == '\\' && !is_escaped;
        cleaned.push(character);
        rest = &rest[character.len_utf8()..];
    }
    cleaned.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_look_like_python_numbers_are_kept() {
        let text = r#"{"a \" NaN": NaN, "b\\": -Infinity}"#;
        assert_eq!(replace_python_numbers(text), r#"{"a \" NaN": null, "b\\": null}"#);
    }
}
