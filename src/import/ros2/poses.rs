//! The ego's frame in a bag, and its poses: from tf, from a topic, or by adding up speed and turns.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::mapping::{FieldMapping, FrameMapping, MappingConfig};
use super::tf::TfTree;
use super::timeline::BagTimeline;
use crate::geometry::Transform;
use crate::import::motion::Motion;
use crate::import::odometry::yaw_rate_ratio;
use crate::import::{GroundHeight, Notes, Odometry, Series};

/// REP 105's projection of the base frame onto the ground.
const ON_THE_GROUND: &str = "base_footprint";
/// A guess where nothing tells it: base frames lie on the ground, or at the height of the axle.
const BASE_HEIGHT_GUESS_M: f64 = 0.15;
/// How a guessed yaw rate is compared with the poses: the import's own defaults.
const TOLERANCE_NS: u64 = 50_000_000;
const SMOOTHING_NS: u64 = 500_000_000;

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

type BasePoses = Vec<(u64, Isometry3<f64>)>;

/// The ego's poses and measured series, and a sentence on where the poses come from.
///
/// Of a mapping that is guessed, a yaw rate that turns the other way than the poses is dropped.
///
/// # Errors
/// No tf path leads from the base frame to the fixed one, or to the frame whose poses a topic gives.
pub fn odometry(
    timeline: &BagTimeline,
    mapping: &MappingConfig,
    is_guessed: bool,
    wheelbase_m: f64,
    ego_from_base: &Isometry3<f64>,
    notes: &mut Notes,
) -> Result<(Odometry, String), String> {
    let own = own_poses(timeline, mapping, ego_from_base, notes)?;
    let has_own = own.is_some();
    let (poses, source) = own.unwrap_or_else(|| add_up(timeline, wheelbase_m));
    let series = |values: &[(u64, f64)], field: &FieldMapping| {
        let source = format!("measured: `{}` of topic `{}`", field.field, field.topic);
        (!values.is_empty()).then(|| Series { source, values: values.to_vec() })
    };
    let mut odometry = Odometry {
        poses: poses.into_iter().map(|(at_ns, pose)| (at_ns, Transform::from_isometry(pose))).collect(),
        speed_mps: series(&timeline.speed_mps, &mapping.speed),
        steering_angle_rad: series(&timeline.steering_angle_rad, &mapping.steering),
        yaw_rate_rps: series(&timeline.yaw_rate_rps, &mapping.yaw_rate),
        acceleration_mps2: None,
    };
    if is_guessed && !has_own && odometry.speed_mps.is_some() {
        let FieldMapping { topic, field, .. } = &mapping.speed;
        notes.tell(format!(
            "the speed is guessed to be `{field}` of topic `{topic}`, and no poses are there to check it by: is it in m/s, ahead \
             along the car's x?"
        ));
    }
    if is_guessed && has_own && turns_the_other_way(&odometry) {
        notes.tell(format!(
            "the yaw rate was guessed to be `{}` of topic `{}`, which turns the other way than the poses; that of the poses is taken",
            mapping.yaw_rate.field, mapping.yaw_rate.topic
        ));
        odometry.yaw_rate_rps = None;
    }
    Ok((odometry, source))
}

fn turns_the_other_way(odometry: &Odometry) -> bool {
    let motion = Motion { odometry, tolerance_ns: TOLERANCE_NS, smoothing_ns: SMOOTHING_NS };
    let times_ns: Vec<u64> = odometry.poses.iter().map(|(at_ns, _)| *at_ns).collect();
    yaw_rate_ratio(&motion, &times_ns).is_some_and(|ratio| ratio < 0.0)
}

/// What tf or a topic tells of the ego's poses, with a sentence on where they come from; `None` where it tells none.
fn own_poses(
    timeline: &BagTimeline,
    mapping: &MappingConfig,
    ego_from_base: &Isometry3<f64>,
    notes: &mut Notes,
) -> Result<Option<(BasePoses, String)>, String> {
    let base_from_ego = ego_from_base.inverse();
    let FrameMapping { base, fixed, .. } = &mapping.frames;
    let tf = &timeline.tf;
    let (poses, source): (BasePoses, String) = match mapping.poses.topic.as_str() {
        "" => return Ok(None),
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
            let (n_bad, n_good) = (timeline.n_bad_poses, timeline.poses.len());
            if n_bad > 0 {
                notes.tell(format!(
                    "{n_bad} of {} messages of topic `{topic}` hold no pose, but a rotation of length 0 or a NaN; they are left out",
                    n_bad + n_good
                ));
            }
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
    if poses.is_empty() {
        notes.tell(format!(
            "{source} tells no pose of any time; poses.topic may name what does, else speed and yaw rate, or steering, are added up"
        ));
        return Ok(None);
    }
    Ok(Some((poses, source)))
}

/// Poses from speed and yaw rate, or steering, from the world's origin on.
fn add_up(timeline: &BagTimeline, wheelbase_m: f64) -> (BasePoses, String) {
    let (turns, of_steering) = if timeline.yaw_rate_rps.is_empty() {
        (&timeline.steering_angle_rad, true)
    } else {
        (&timeline.yaw_rate_rps, false)
    };
    if timeline.speed_mps.is_empty() || turns.is_empty() {
        return (Vec::new(), "unknown; the ego is at the world's origin".into());
    }
    let mut poses = BasePoses::new();
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
