//! Which clouds of a bag become samples: those within the time of poses and pictures that have a picture near them.

use super::bag::seconds;
use super::mapping::MappingConfig;
use super::timeline::{BagTimeline, Stamped};
use crate::import::Notes;

/// Chooses the clouds, and tells how many are left out. `poses_ns`: the first and last pose, if there are poses.
///
/// # Errors
/// A sentence: no cloud is left.
pub fn choose(
    timeline: &BagTimeline,
    poses_ns: Option<(u64, u64)>,
    mapping: &MappingConfig,
    tolerance_ns: u64,
    notes: &mut Notes,
) -> Result<Vec<Stamped>, String> {
    let clouds = &timeline.clouds;
    let mut spans: Vec<(&str, u64, u64)> = Vec::new();
    spans.extend(poses_ns.map(|(first_ns, last_ns)| ("poses", first_ns, last_ns)));
    let camera = mapping.camera.topic.as_str();
    let pictures = &timeline.pictures.messages;
    if let (Some(first), Some(last)) = (pictures.first(), pictures.last()) {
        spans.push(("pictures", first.stamp_ns, last.stamp_ns));
    } else if !camera.is_empty() {
        return Err(format!("topic `{camera}` holds no picture"));
    }
    let mut kept = clouds.messages.clone();
    for (what, first_ns, last_ns) in spans {
        let n_before = kept.len();
        let span = first_ns.saturating_sub(tolerance_ns)..=last_ns.saturating_add(tolerance_ns);
        kept.retain(|cloud| span.contains(&cloud.stamp_ns));
        let n_out = n_before - kept.len();
        if kept.is_empty() {
            return Err(format!(
                "no cloud lies within the time of the {what}: clouds are at {}, {what} at {} to {}; where stamps are of \
                 different clocks, `stamps = \"log\"` takes the recorder's",
                clouds.span(),
                seconds(first_ns),
                seconds(last_ns)
            ));
        }
        if n_out > 0 {
            notes.tell(format!(
                "{n_out} of {} clouds lie outside the time of the {what} and are left out",
                clouds.messages.len()
            ));
        }
    }
    let Some(&first) = kept.first() else {
        return Err(format!("topic `{}` holds no cloud", mapping.lidar.topic));
    };
    if camera.is_empty() {
        return Ok(kept);
    }
    // A camera may be slower than the LiDAR, or lose pictures.
    let n_before = kept.len();
    kept.retain(|cloud| timeline.pictures.near(camera, cloud.stamp_ns, tolerance_ns).is_ok());
    if kept.is_empty() {
        let first = timeline.pictures.near(camera, first.stamp_ns, tolerance_ns);
        return Err(format!("no cloud has a picture near it: {}", first.expect_err("no cloud has one")));
    }
    let n_out = n_before - kept.len();
    if n_out > 0 {
        notes.tell(format!(
            "{n_out} of {n_before} clouds have no picture of `{camera}` within {:.0} ms (stamp_tolerance_s) and are left out",
            tolerance_ns as f64 * 1e-6
        ));
    }
    Ok(kept)
}
