//! The tracklets of KITTI's raw recordings: boxes in the Velodyne's frame, bottom centre, by frame.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use roxmltree::{Document, Node};

use super::sequence::Annotated;
use crate::geometry::{Box3, Point};
use crate::import::error::read_text;
use crate::import::{ImportError, RawObject};

/// `truncation` of objects that the picture does not show: outside and behind.
const UNSEEN: [i64; 2] = [2, 3];

/// Reads `tracklet_labels.xml`.
pub(super) fn read_tracklets(
    path: &Path,
    ego_from_velo: &Isometry3<f64>,
    n_frames: usize,
) -> Result<BTreeMap<usize, Annotated>, ImportError> {
    let fail = |message: String| ImportError::at(path, message);
    let text = read_text(path)?;
    // Boost writes a DOCTYPE.
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..roxmltree::ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options)
        .map_err(|error| fail(format!("the tracklets are no valid XML ({error})")))?;
    let tracklets = document.descendants().find(|node| node.has_tag_name("tracklets"));
    let tracklets = tracklets.ok_or_else(|| fail("there is no element `tracklets`".to_owned()))?;
    let mut annotated: BTreeMap<usize, Annotated> = BTreeMap::new();
    for (track_idx, track) in tracklets.children().filter(|node| node.has_tag_name("item")).enumerate() {
        let value = |node: Node<'_, '_>, name: &str| -> Result<f64, ImportError> {
            let number =
                text_of(node, name).and_then(|text| text.parse().ok()).filter(|n: &f64| n.is_finite());
            number.ok_or_else(|| fail(format!("tracklet {track_idx} has no finite `{name}`")))
        };
        let category = text_of(track, "objectType").unwrap_or_default();
        // The set's names: `Person (sitting)` is the object set's `Person_sitting`.
        let category = if category == "Person (sitting)" { "Person_sitting" } else { category };
        let [height_m, width_m, length_m] = [value(track, "h")?, value(track, "w")?, value(track, "l")?];
        let first = value(track, "first_frame")? as usize;
        let poses = track.children().find(|node| node.has_tag_name("poses"));
        let items =
            poses.into_iter().flat_map(|poses| poses.children().filter(|node| node.has_tag_name("item")));
        for (i, pose) in items.enumerate() {
            let frame_idx = first + i;
            if frame_idx >= n_frames {
                return Err(fail(format!(
                    "tracklet {track_idx} is in frame {frame_idx}; the drive has {n_frames}"
                )));
            }
            let truncation = text_of(pose, "truncation").and_then(|text| text.parse().ok()).unwrap_or(0);
            if UNSEEN.contains(&truncation) {
                continue;
            }
            let bottom = Point3::new(value(pose, "tx")?, value(pose, "ty")?, value(pose, "tz")?);
            let yaw = value(pose, "rz")?;
            let center = ego_from_velo * (bottom + Vector3::new(0.0, 0.0, height_m / 2.0));
            let ahead = ego_from_velo * Vector3::new(yaw.cos(), yaw.sin(), 0.0);
            let box_in_ego = Box3 {
                center: Point::from_coords(center),
                length_m,
                width_m,
                height_m,
                yaw_rad: ahead.y.atan2(ahead.x),
            };
            annotated.entry(frame_idx).or_default().objects.push(RawObject {
                id: track_idx.to_string(),
                category: category.to_owned(),
                box_in_ego,
                velocity_in_ego_mps: [f64::NAN; 2],
            });
        }
    }
    Ok(annotated)
}

fn text_of<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.children().find(|child| child.has_tag_name(name))?.text().map(str::trim)
}

#[cfg(test)]
mod tests {
    use super::*;

    const XML: &str = r#"<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>
<!DOCTYPE boost_serialization>
<boost_serialization signature="serialization::archive" version="9">
<tracklets class_id="0" tracking_level="0" version="0"><count>1</count><item_version>1</item_version>
<item class_id="1"><objectType>Person (sitting)</objectType><h>1.2</h><w>0.6</w><l>0.8</l><first_frame>3</first_frame>
<poses class_id="2"><count>2</count>
<item><tx>10</tx><ty>2</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.5</rz><truncation>0</truncation></item>
<item><tx>9</tx><ty>2</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>0.5</rz><truncation>2</truncation></item>
</poses></item></tracklets></boost_serialization>"#;

    #[test]
    fn a_tracklet_is_found_in_its_frames_where_the_picture_shows_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tracklet_labels.xml");
        fs_err::write(&path, XML).unwrap();
        let mount = Isometry3::translation(0.76, 0.0, 1.73);
        let annotated = read_tracklets(&path, &mount, 10).unwrap();
        assert_eq!(annotated.keys().collect::<Vec<_>>(), [&3]);
        let object = &annotated[&3].objects[0];
        assert_eq!(object.category, "Person_sitting");
        let center = object.box_in_ego.center;
        assert!((center.x() - 10.76).abs() < 1e-9 && (center.z() - 0.63).abs() < 1e-9, "{center:?}");
        assert!(read_tracklets(&path, &mount, 3).unwrap_err().to_string().contains("frame 3"));
        fs_err::write(&path, &XML[..300]).unwrap();
        assert!(read_tracklets(&path, &mount, 10).unwrap_err().to_string().contains("no valid XML"));
    }
}
