//! The ego's frame in a bag, and its poses: from tf, from a topic, or by adding up speed and turns.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::mapping::{FrameMapping, MappingConfig};
use super::tf::TfTree;
use super::timeline::BagTimeline;
use crate::geometry::{Ego, Transform, World};
use crate::import::{GroundHeight, Notes};

/// REP 105's projection of the base frame onto the ground.
const ON_THE_GROUND: &str = "base_footprint";
/// A guess where nothing tells it: base frames lie on the ground, or at the height of the axle.
const BASE_HEIGHT_GUESS_M: f64 = 0.15;

/// The ego frame from the base frame, and how high the ground lies in it.
///
/// The ego's origin is the middle of the rear axle on the ground; where the height of the base frame is not known, it is the
/// axle's point at the height of the base frame's origin.
pub fn ego_from_base(frames: &FrameMapping, tf: &TfTree) -> (Isometry3<f64>, GroundHeight) {
    let [x, y, _] = frames.rear_axle_in_base_m;
    let at_height =
        |z: f64| Isometry3::from_parts(Translation3::new(-x, -y, z), nalgebra::UnitQuaternion::identity());
    let known = |source: String| GroundHeight::Known { z_m: 0.0, source };
    if let Some(height_m) = frames.base_height_m {
        let source = format!("frames.base_height_m: `{}` is {height_m} m over it", frames.base);
        return (at_height(height_m), known(source));
    }
    if frames.base == ON_THE_GROUND {
        return (at_height(0.0), known(format!("the frame `{ON_THE_GROUND}`")));
    }
    let stamp_ns = tf.stamps_between(ON_THE_GROUND, &frames.base).first().copied().unwrap_or(0);
    if let Ok(ground_from_base) = tf.lookup(ON_THE_GROUND, &frames.base, stamp_ns, 0)
        && tf.has(ON_THE_GROUND)
    {
        let height_m = ground_from_base.translation.z;
        let source = format!("tf: `{}` is {height_m:.3} m over `{ON_THE_GROUND}`", frames.base);
        return (at_height(height_m), known(source));
    }
    (at_height(0.0), GroundHeight::Unknown { guess_m: -BASE_HEIGHT_GUESS_M })
}

type EgoPoses = Vec<(u64, Transform<World, Ego>)>;

/// The ego's poses, and a sentence on where they come from.
///
/// # Errors
/// No tf path leads from the base frame to the fixed one, or to the frame whose poses a topic gives.
pub fn poses(
    timeline: &BagTimeline,
    mapping: &MappingConfig,
    wheelbase_m: f64,
    ego_from_base: &Isometry3<f64>,
    notes: &mut Notes,
) -> Result<(EgoPoses, String), String> {
    let base_from_ego = ego_from_base.inverse();
    let FrameMapping { base, fixed, .. } = &mapping.frames;
    let tf = &timeline.tf;
    let (poses, source) = match mapping.poses.topic.as_str() {
        "" => add_up(timeline, wheelbase_m),
        "tf" => {
            if !tf.connects(fixed, base) {
                return Err(tf.lookup(fixed, base, 0, 0).expect_err("they are not connected").to_string());
            }
            let found = tf.stamps_between(fixed, base).into_iter().filter_map(|stamp_ns| {
                // An edge on the way may begin later than the others.
                Some((stamp_ns, tf.lookup(fixed, base, stamp_ns, 0).ok()? * base_from_ego))
            });
            (found.collect(), format!("tf `{fixed}` -> `{base}`"))
        }
        topic => {
            let pose_frame = &timeline.pose_frame;
            let pose_from_base = if pose_frame.is_empty() || pose_frame == base {
                Isometry3::identity()
            } else if tf.connects(pose_frame, base) {
                let stamp_ns = tf.stamps_between(pose_frame, base).first().copied().unwrap_or(0);
                tf.lookup(pose_frame, base, stamp_ns, 0).map_err(|error| error.to_string())?
            } else {
                notes.tell(format!(
                    "topic `{topic}` gives the poses of `{pose_frame}`, which tf does not connect with `{base}`; they are taken \
                     for the same"
                ));
                Isometry3::identity()
            };
            let moved =
                timeline.poses.iter().map(|(at_ns, pose)| (*at_ns, pose * pose_from_base * base_from_ego));
            (moved.collect(), format!("topic `{topic}`"))
        }
    };
    let poses: Vec<(u64, Isometry3<f64>)> = poses;
    Ok((poses.into_iter().map(|(at_ns, pose)| (at_ns, Transform::from_isometry(pose))).collect(), source))
}

/// Poses from speed and yaw rate, or steering, from the world's origin on.
fn add_up(timeline: &BagTimeline, wheelbase_m: f64) -> (Vec<(u64, Isometry3<f64>)>, String) {
    let (turns, of_steering) = if timeline.yaw_rate_rps.is_empty() {
        (&timeline.steering_angle_rad, true)
    } else {
        (&timeline.yaw_rate_rps, false)
    };
    if timeline.speed_mps.is_empty() || turns.is_empty() {
        return (Vec::new(), "unknown; the ego is at the world's origin".into());
    }
    let mut poses: Vec<(u64, Isometry3<f64>)> = Vec::new();
    let (mut x, mut y, mut yaw, mut before_ns) = (0.0, 0.0, 0.0_f64, timeline.speed_mps[0].0);
    for &(at_ns, speed_mps) in &timeline.speed_mps {
        let after = turns.partition_point(|(turn_ns, _)| *turn_ns < at_ns).min(turns.len() - 1);
        let turn = turns[after].1;
        let yaw_rate_rps = if of_steering { speed_mps * turn.tan() / wheelbase_m } else { turn };
        let step_s = (at_ns - before_ns) as f64 * 1e-9;
        let middle = yaw + yaw_rate_rps * step_s / 2.0;
        x += speed_mps * step_s * middle.cos();
        y += speed_mps * step_s * middle.sin();
        yaw += yaw_rate_rps * step_s;
        poses.push((at_ns, Isometry3::new(Vector3::new(x, y, 0.0), Vector3::z() * yaw)));
        before_ns = at_ns;
    }
    let turns = if of_steering { "steering" } else { "yaw rate" };
    (poses, format!("speed and {turns}, added up from the first sample on"))
}
