//! Which numbers of a bag are guessed to be the car's speed, steering angle and yaw rate: by type, name, frame and content.

use super::bag::{Bag, BagTopic};
use super::mapping::FieldMapping;
use super::words::{has_word, holds};
use crate::import::ImportError;

/// Numbers that mean a speed or an angle in messages of a known type: type, field, unit.
type KnownNumber = (&'static str, &'static str, &'static str);

const SPEEDS: [KnownNumber; 8] = [
    ("autoware_vehicle_msgs/VelocityReport", "longitudinal_velocity", "m/s"),
    ("autoware_auto_vehicle_msgs/VelocityReport", "longitudinal_velocity", "m/s"),
    ("nav_msgs/Odometry", "twist.twist.linear.x", "m/s"),
    ("geometry_msgs/TwistStamped", "twist.linear.x", "m/s"),
    ("geometry_msgs/TwistWithCovarianceStamped", "twist.twist.linear.x", "m/s"),
    ("can_msgs/WheelSpeed", "speed", "m/s"),
    ("ackermann_msgs/AckermannDriveStamped", "drive.speed", "m/s"),
    ("ackermann_msgs/AckermannDrive", "speed", "m/s"),
];
const STEERINGS: [KnownNumber; 4] = [
    ("autoware_vehicle_msgs/SteeringReport", "steering_tire_angle", "rad"),
    ("autoware_auto_vehicle_msgs/SteeringReport", "steering_tire_angle", "rad"),
    ("ackermann_msgs/AckermannDriveStamped", "drive.steering_angle", "rad"),
    ("ackermann_msgs/AckermannDrive", "steering_angle", "rad"),
];
const YAW_RATES: [KnownNumber; 2] = [
    ("sensor_msgs/Imu", "angular_velocity.z", "rad/s"),
    ("nav_msgs/Odometry", "twist.twist.angular.z", "rad/s"),
];
const PLAIN_NUMBERS: [&str; 4] =
    ["std_msgs/Float32", "std_msgs/Float64", "example_interfaces/Float32", "example_interfaces/Float64"];
/// Types that hold a velocity in any axes, measured or wanted.
const TWISTS: [&str; 2] = ["geometry_msgs/TwistStamped", "geometry_msgs/TwistWithCovarianceStamped"];
/// Words of topics and frames whose twists are of a receiver, in east and north, or commands.
const OTHER_TWISTS: [&str; 7] = ["gnss", "gps", "fix", "ublox", "navsat", "cmd", "command"];
/// Messages that are looked at, spread over the bag, to see whether a number is filled in.
const MESSAGES_LOOKED_AT: usize = 20;

/// A guessed field, empty where there is none, and a sentence.
pub type GuessedField = (FieldMapping, String);

/// The speed. With `has_poses` a number that is 0 throughout is passed over, since the poses tell the speed.
///
/// # Errors
/// The disk fails.
pub fn speed(bag: &Bag, has_poses: bool) -> Result<GuessedField, ImportError> {
    find(bag, &SPEEDS, &["speed", "velocity"], "m/s", has_poses)
}

/// The steering angle, as [`speed`].
///
/// # Errors
/// The disk fails.
pub fn steering(bag: &Bag, has_poses: bool) -> Result<GuessedField, ImportError> {
    find(bag, &STEERINGS, &["steer", "wheel_angle"], "rad", has_poses)
}

/// The yaw rate, as [`speed`].
///
/// # Errors
/// The disk fails.
pub fn yaw_rate(bag: &Bag, has_poses: bool) -> Result<GuessedField, ImportError> {
    find(bag, &YAW_RATES, &["yaw_rate", "yawrate"], "rad/s", has_poses)
}

fn find(
    bag: &Bag,
    types: &[KnownNumber],
    words: &[&str],
    unit: &str,
    has_poses: bool,
) -> Result<GuessedField, ImportError> {
    let (mut others, mut passed_over) = (Vec::new(), String::new());
    let mut pass_over = |topic: &BagTopic, why: String| {
        passed_over.push_str(&format!("; passed over: {why}"));
        others.push(topic.name.clone());
    };
    let mut found: Option<GuessedField> = None;
    'types: for &(type_name, field, unit) in types {
        for topic in bag.readable().filter(|topic| topic.is_of(&[type_name]) && has_number(topic, field)) {
            if TWISTS.contains(&type_name) && is_other_twist(bag, topic)? {
                let name = &topic.name;
                pass_over(topic, format!("`{name}`, by name or frame of a receiver or a command"));
            } else if has_poses && is_unfilled(bag, topic, field)? {
                pass_over(topic, format!("`{field}` of `{}`, which is 0 throughout", topic.name));
            } else {
                let is_command = type_name.starts_with("ackermann");
                let doubt = if is_command { "; it may be a command, not a measurement" } else { "" };
                let why = format!("guessed by its type {type_name}{doubt}");
                found = Some((field_of(&topic.name, field, unit), why));
                break 'types;
            }
        }
    }
    if found.is_none() {
        for topic in bag.readable().filter(|topic| topic.is_of(&PLAIN_NUMBERS) && holds(&topic.name, words)) {
            if has_poses && is_unfilled(bag, topic, "data")? {
                pass_over(topic, format!("`{}`, which is 0 throughout", topic.name));
                continue;
            }
            let why = "guessed by its name; check its unit and sign".to_owned();
            found = Some((field_of(&topic.name, "data", unit), why));
            break;
        }
    }
    if let Some((field, why)) = found {
        return Ok((field, why + &passed_over));
    }
    let perhaps: Vec<String> = bag
        .readable()
        .filter(|topic| !others.contains(&topic.name))
        .filter_map(|topic| {
            let paths = topic.message_type().ok()?.number_paths();
            let is_meant = |path: &String| {
                let is_other = path.starts_with("header.") || holds(path, &["angular", "covariance"]);
                !is_other && (holds(path, words) || holds(&topic.name, words))
            };
            let path = paths.into_iter().find(is_meant)?;
            Some(format!("`{}` with field = \"{path}\"", topic.name))
        })
        .take(3)
        .collect();
    let hint =
        if perhaps.is_empty() { String::new() } else { format!("; perhaps {}", perhaps.join(", or ")) };
    Ok((FieldMapping::default(), format!("not found{hint}{passed_over}")))
}

fn field_of(topic: &str, field: &str, unit: &str) -> FieldMapping {
    FieldMapping { topic: topic.into(), field: field.into(), unit: unit.into(), ..FieldMapping::default() }
}

fn has_number(topic: &BagTopic, field: &str) -> bool {
    topic.message_type().is_ok_and(|found| found.number_paths().iter().any(|path| path == field))
}

/// Whether a velocity is not the car's own along its axes, by the words of its topic and frame.
fn is_other_twist(bag: &Bag, topic: &BagTopic) -> Result<bool, ImportError> {
    let frame = match bag.first_frame(topic) {
        Err(error) if error.is_bad_data() => None,
        frame => frame?,
    };
    Ok(has_word(&topic.name, &OTHER_TWISTS) || has_word(&frame.unwrap_or_default(), &OTHER_TWISTS))
}

/// Whether a number is 0 in all of some messages: many odometries fill in the pose alone.
fn is_unfilled(bag: &Bag, topic: &BagTopic, field: &str) -> Result<bool, ImportError> {
    let places = match bag.places(topic) {
        Err(error) if error.is_bad_data() => return Ok(false),
        places => places?,
    };
    let step = places.len().div_ceil(MESSAGES_LOOKED_AT).max(1);
    for &place in places.iter().step_by(step) {
        let value = bag.read(topic, place, |value| value.number(field).map_err(|error| error.to_string()));
        match value {
            Ok(0.0) => {}
            // What is damaged is told when the bag is imported.
            Err(error) if !error.is_bad_data() => return Err(error),
            _ => return Ok(false),
        }
    }
    Ok(true)
}
