//! Objects and detections as messages and back, exactly; values that no consumer could use are a
//! [`MessageFault`].

use super::convert::FINITE;
use super::error::MessageFault;
use super::messages::{own_time, wire};
use crate::geometry::{Box3, BoxError, Ego, Frame, Point};
use crate::object::{BoxSpread, Detection, Distribution, Event, Harm, Kind, Object, SolidPart, Spot};

/// An enum as messages hold it: by the number of the variant of the same name.
macro_rules! enum_numbers {
    ($to:ident, $from:ident, $name:ident { $($variant:ident),* }, $field:literal, $wanted:literal) => {
        pub(super) fn $to(value: $name) -> i32 {
            match value {
                $($name::$variant => wire::$name::$variant),*
            }
            .into()
        }

        pub(super) fn $from(number: i32) -> Result<$name, MessageFault> {
            match wire::$name::try_from(number) {
                $(Ok(wire::$name::$variant) => Ok($name::$variant),)*
                _ => Err(MessageFault::new($field, number, $wanted)),
            }
        }
    };
}
enum_numbers!(
    kind_number,
    kind_of,
    Kind { Vehicle, Pedestrian, Static },
    "kind",
    "vehicle (1), pedestrian (2) or static (3) is needed"
);
enum_numbers!(
    distribution_number,
    distribution_of,
    Distribution { Id, Ood },
    "distribution",
    "id (1) or ood (2) is needed"
);
enum_numbers!(
    event_number,
    event_of,
    Event { None, Lies, Falls, Rolls, Thrown },
    "event",
    "a number from 0 to 4 is needed"
);
enum_numbers!(
    spot_number,
    spot_of,
    Spot { None, Beside, Lane, Junction, Bend, Crossing, Behind, Aloft },
    "spot",
    "a number from 0 to 7 is needed"
);
enum_numbers!(
    harm_number,
    harm_of,
    Harm { Harmful, Harmless },
    "harm",
    "harmful (1) or harmless (2) is needed"
);

/// A message with the fields of a box in the ego frame and its velocity.
macro_rules! box_message {
    ($name:ident, $box_in_ego:expr, $velocity_mps:expr, { $($field:ident: $value:expr),* $(,)? }) => {
        wire::$name {
            x_m: $box_in_ego.center.x(),
            y_m: $box_in_ego.center.y(),
            z_m: $box_in_ego.center.z(),
            length_m: $box_in_ego.length_m,
            width_m: $box_in_ego.width_m,
            height_m: $box_in_ego.height_m,
            yaw_rad: $box_in_ego.yaw_rad,
            vx_mps: $velocity_mps[0],
            vy_mps: $velocity_mps[1],
            $($field: $value),*
        }
    };
}

/// The box in the ego frame and the velocity that a message holds.
macro_rules! box_of {
    ($message:expr) => {{
        let box_in_ego = Box3::<Ego> {
            center: Point::new($message.x_m, $message.y_m, $message.z_m),
            length_m: $message.length_m,
            width_m: $message.width_m,
            height_m: $message.height_m,
            yaw_rad: $message.yaw_rad,
        };
        (box_in_ego, [$message.vx_mps, $message.vy_mps])
    }};
}

/// Unknown facts become the message's defaults; [`check_object`] refuses them.
pub(super) fn objects_message(time_ns: u64, objects: &[Object]) -> wire::Objects {
    let objects = objects.iter().map(|object| {
        box_message!(Object, object.box_in_ego, object.velocity_in_ego_mps, {
            id: object.id.clone().unwrap_or_default(),
            category: object.category.clone().unwrap_or_default(),
            kind: object.kind.map_or(0, kind_number),
            distribution: object.distribution.map_or(0, distribution_number),
            n_lidar_points: object.n_lidar_points.unwrap_or_default(),
            visible_px: object.visible_px,
            visible_fraction: object.visible_fraction.map(|fraction| fraction as f32),
            event: object.event.map_or(0, event_number),
            solid: object.solid.map(|SolidPart { along_m, across_m, length_m, width_m }| {
                wire::SolidPart { along_m, across_m, length_m, width_m }
            }),
            clearance_m: object.clearance_m,
            spot: object.spot.map_or(0, spot_number),
            is_tipped: object.is_tipped.unwrap_or_default(),
        })
    });
    wire::Objects { timestamp: Some(own_time(time_ns)), objects: objects.collect() }
}

pub(super) fn object_of(message: wire::Object) -> Result<Object, MessageFault> {
    let (box_in_ego, velocity_in_ego_mps) = box_of!(message);
    let read = || {
        let kind = kind_of(message.kind)?;
        let distribution = distribution_of(message.distribution)?;
        let event = event_of(message.event)?;
        let spot = spot_of(message.spot)?;
        Ok((kind, distribution, event, spot))
    };
    let (kind, distribution, event, spot) = read().map_err(|fault: MessageFault| fault.of(&message.id))?;
    let solid = message.solid.map(|wire::SolidPart { along_m, across_m, length_m, width_m }| SolidPart {
        along_m,
        across_m,
        length_m,
        width_m,
    });
    let object = Object {
        box_in_ego,
        velocity_in_ego_mps,
        id: Some(message.id),
        category: Some(message.category),
        kind: Some(kind),
        distribution: Some(distribution),
        n_lidar_points: Some(message.n_lidar_points),
        visible_px: message.visible_px,
        visible_fraction: message.visible_fraction.map(f64::from),
        event: Some(event),
        solid,
        clearance_m: message.clearance_m,
        spot: Some(spot),
        is_tipped: Some(message.is_tipped),
    };
    check_numbers(&object).map_err(|fault| fault.of(object.id.as_deref().unwrap_or_default()))?;
    Ok(object)
}

pub(super) fn detections_message(time_ns: u64, detections: &[Detection]) -> wire::Detections {
    let detections = detections.iter().map(|detection| {
        box_message!(Detection, detection.box_in_ego, detection.velocity_in_ego_mps, {
            harm: harm_number(detection.harm),
            score: detection.score as f32,
            spread: detection.spread.as_ref().map(spread_message),
        })
    });
    wire::Detections { timestamp: Some(own_time(time_ns)), detections: detections.collect() }
}

fn check_box<F: Frame>(found: &Box3<F>, velocity_mps: [f64; 2]) -> Result<(), MessageFault> {
    found.check().map_err(|error| match error {
        BoxError::NotFinite { field, found } => MessageFault::new(field, found, FINITE),
        BoxError::NotPositive { field, found } => {
            MessageFault::new(field, found, "a size above zero is needed")
        }
    })?;
    // NaN is an unknown velocity.
    let infinite = [("vx_mps", velocity_mps[0]), ("vy_mps", velocity_mps[1])];
    match infinite.into_iter().find(|(_, found)| found.is_infinite()) {
        Some((field, found)) => Err(MessageFault::new(field, found, FINITE)),
        None => Ok(()),
    }
}

/// Whether a reader will accept every number of an object.
fn check_numbers(object: &Object) -> Result<(), MessageFault> {
    check_box(&object.box_in_ego, object.velocity_in_ego_mps)?;
    if let Some(SolidPart { along_m, across_m, length_m, width_m }) = object.solid {
        let numbers = [("solid.along_m", along_m), ("solid.across_m", across_m)];
        let sizes = [("solid.length_m", length_m), ("solid.width_m", width_m)];
        if let Some((field, found)) = numbers.into_iter().chain(sizes).find(|(_, number)| !number.is_finite())
        {
            return Err(MessageFault::new(field, found, FINITE));
        }
        if let Some((field, found)) = sizes.into_iter().find(|&(_, size_m)| size_m <= 0.0) {
            return Err(MessageFault::new(field, found, "a size above zero is needed"));
        }
    }
    match object.clearance_m.filter(|clearance_m| !clearance_m.is_finite()) {
        Some(found) => Err(MessageFault::new("clearance_m", found, FINITE)),
        None => Ok(()),
    }
}

/// Episodes hold these facts of every object; logs may lack the others.
fn check_facts(object: &Object) -> Result<(), MessageFault> {
    let facts = [
        ("id", object.id.is_some()),
        ("category", object.category.is_some()),
        ("kind", object.kind.is_some()),
        ("distribution", object.distribution.is_some()),
        ("n_lidar_points", object.n_lidar_points.is_some()),
        ("event", object.event.is_some()),
    ];
    let unknown = facts.into_iter().find(|(_, is_known)| !is_known);
    unknown.map_or(Ok(()), |(field, _)| Err(MessageFault::new(field, "unknown", "a known one is needed")))
}

/// Whether every fact of an object is known, and a reader will accept every number.
pub(super) fn check_object(object: &Object) -> Result<(), MessageFault> {
    check_facts(object)
        .and_then(|()| check_numbers(object))
        .map_err(|fault| fault.of(object.id.as_deref().unwrap_or_default()))
}

fn spread_message(of: &BoxSpread) -> wire::BoxSpread {
    wire::BoxSpread {
        x_m: of.x_m as f32,
        y_m: of.y_m as f32,
        z_m: of.z_m as f32,
        length: of.length as f32,
        width: of.width as f32,
        height: of.height as f32,
        yaw_rad: of.yaw_rad as f32,
    }
}

fn spread_of(message: &wire::BoxSpread) -> BoxSpread {
    BoxSpread {
        x_m: message.x_m.into(),
        y_m: message.y_m.into(),
        z_m: message.z_m.into(),
        length: message.length.into(),
        width: message.width.into(),
        height: message.height.into(),
        yaw_rad: message.yaw_rad.into(),
    }
}

fn check_spread(of: &BoxSpread) -> Result<(), MessageFault> {
    let parts = [
        ("spread.x_m", of.x_m),
        ("spread.y_m", of.y_m),
        ("spread.z_m", of.z_m),
        ("spread.length", of.length),
        ("spread.width", of.width),
        ("spread.height", of.height),
        ("spread.yaw_rad", of.yaw_rad),
    ];
    match parts.into_iter().find(|(_, found)| !(found.is_finite() && *found >= 0.0)) {
        Some((field, found)) => Err(MessageFault::new(field, found, "a finite number from 0 on is needed")),
        None => Ok(()),
    }
}

pub(crate) fn check_detection(detection: &Detection) -> Result<(), MessageFault> {
    detection.spread.as_ref().map_or(Ok(()), check_spread)?;
    check_box(&detection.box_in_ego, detection.velocity_in_ego_mps)?;
    if !(0.0..=1.0).contains(&detection.score) {
        return Err(MessageFault::new("score", detection.score, "a number from 0 to 1 is needed"));
    }
    Ok(())
}

pub(super) fn detection_of(message: &wire::Detection) -> Result<Detection, MessageFault> {
    let (box_in_ego, velocity_in_ego_mps) = box_of!(message);
    let harm = harm_of(message.harm)?;
    let (score, spread) = (message.score.into(), message.spread.as_ref().map(spread_of));
    let detection = Detection { box_in_ego, velocity_in_ego_mps, harm, score, spread };
    check_detection(&detection)?;
    Ok(detection)
}
