//! Names of classes: categories, the ten classes of the detection task, attributes.

use crate::object::{Distribution, Harm, Kind};

/// Stand-ins of harmful and harmless among the classes that the devkit's evaluation and mmdetection3d know: both are scored
/// up to 50 m, with orientations that repeat after a whole turn.
pub const CAR_TRUCK: [(Harm, &str); 2] = [(Harm::Harmful, "vehicle.car"), (Harm::Harmless, "vehicle.truck")];

/// All attributes.
pub const ATTRIBUTES: [&str; 8] = [
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "cycle.without_rider",
    "pedestrian.sitting_lying_down",
    "pedestrian.standing",
    "pedestrian.moving",
];

/// The categories of nuScenes, and three of its segmentation, each with its class of the detection task; empty without one.
/// The devkit has a colour for these alone.
const CATEGORIES: [(&str, &str); 26] = [
    ("animal", ""),
    ("human.pedestrian.adult", "pedestrian"),
    ("human.pedestrian.child", "pedestrian"),
    ("human.pedestrian.construction_worker", "pedestrian"),
    ("human.pedestrian.personal_mobility", ""),
    ("human.pedestrian.police_officer", "pedestrian"),
    ("human.pedestrian.stroller", ""),
    ("human.pedestrian.wheelchair", ""),
    ("movable_object.barrier", "barrier"),
    ("movable_object.debris", ""),
    ("movable_object.pushable_pullable", ""),
    ("movable_object.trafficcone", "traffic_cone"),
    ("static_object.bicycle_rack", ""),
    ("vehicle.bicycle", "bicycle"),
    ("vehicle.bus.bendy", "bus"),
    ("vehicle.bus.rigid", "bus"),
    ("vehicle.car", "car"),
    ("vehicle.construction", "construction_vehicle"),
    ("vehicle.emergency.ambulance", ""),
    ("vehicle.emergency.police", ""),
    ("vehicle.motorcycle", "motorcycle"),
    ("vehicle.trailer", "trailer"),
    ("vehicle.truck", "truck"),
    ("static.manmade", ""),
    ("static.vegetation", ""),
    ("static.other", ""),
];

/// Names of other sources, in lower case with `_` between words, and the categories that mean the same.
const SYNONYMS: [(&str, &str); 51] = [
    ("adult", "human.pedestrian.adult"),
    ("articulated_bus", "vehicle.bus.bendy"),
    ("barrier", "movable_object.barrier"),
    ("bicycle", "vehicle.bicycle"),
    ("bicyclist", "vehicle.bicycle"),
    ("bin", "movable_object.pushable_pullable"),
    ("bollard", "static.manmade"),
    ("box_truck", "vehicle.truck"),
    ("bus", "vehicle.bus.rigid"),
    ("car", "vehicle.car"),
    ("child", "human.pedestrian.child"),
    ("construction_barrel", "movable_object.trafficcone"),
    ("construction_cone", "movable_object.trafficcone"),
    ("construction_worker", "human.pedestrian.construction_worker"),
    ("cyclist", "vehicle.bicycle"),
    ("dog", "animal"),
    ("hedge", "static.vegetation"),
    ("large_vehicle", "vehicle.truck"),
    ("message_board_trailer", "vehicle.trailer"),
    ("misc", "static.other"),
    ("mobile_pedestrian_crossing_sign", "static.manmade"),
    ("motorcycle", "vehicle.motorcycle"),
    ("motorcyclist", "vehicle.motorcycle"),
    ("official_signaler", "human.pedestrian.police_officer"),
    ("pedestrian", "human.pedestrian.adult"),
    ("person", "human.pedestrian.adult"),
    ("person_sitting", "human.pedestrian.adult"),
    ("regular_vehicle", "vehicle.car"),
    ("railed_vehicle", "vehicle.bus.rigid"),
    ("school_bus", "vehicle.bus.rigid"),
    ("scooter", "vehicle.motorcycle"),
    ("sign", "static.manmade"),
    ("stop_sign", "static.manmade"),
    ("shopping_trolley", "movable_object.pushable_pullable"),
    ("stroller", "human.pedestrian.stroller"),
    ("traffic_cone", "movable_object.trafficcone"),
    ("traffic_light_trailer", "vehicle.trailer"),
    ("trailer", "vehicle.trailer"),
    ("tram", "vehicle.bus.rigid"),
    ("tree", "static.vegetation"),
    ("truck", "vehicle.truck"),
    ("truck_cab", "vehicle.truck"),
    ("two_wheeler", "vehicle.motorcycle"),
    ("van", "vehicle.car"),
    ("vehicle", "vehicle.car"),
    ("vehicular_trailer", "vehicle.trailer"),
    ("wheelchair", "human.pedestrian.wheelchair"),
    ("wheeled_device", "human.pedestrian.personal_mobility"),
    ("wheeled_rider", "human.pedestrian.personal_mobility"),
    ("animal", "animal"),
    ("ambulance", "vehicle.emergency.ambulance"),
];

/// The category that comes nearest to an object of any source. What is unfamiliar and has no name among them is debris:
/// "left on the drivable surface, too large to be driven over safely".
#[must_use]
pub fn official_category(
    category: Option<&str>,
    kind: Option<Kind>,
    distribution: Option<Distribution>,
) -> &'static str {
    let name = category.unwrap_or_default();
    if let Some((official, _)) = CATEGORIES.iter().find(|(official, _)| *official == name) {
        return official;
    }
    let lower = name.to_ascii_lowercase();
    if let Some((_, official)) = SYNONYMS.iter().find(|(synonym, _)| *synonym == lower) {
        return official;
    }
    match (kind, distribution) {
        (Some(Kind::Vehicle), _) => "vehicle.car",
        (Some(Kind::Pedestrian), _) => "human.pedestrian.adult",
        (_, Some(Distribution::Ood)) => "movable_object.debris",
        (Some(Kind::Static), _) => "static.manmade",
        (None, _) => "static.other",
    }
}

/// The class of the detection task that a category belongs to, if any.
#[must_use]
pub fn detection_class(category: &str) -> Option<&'static str> {
    let found = CATEGORIES.iter().find(|(name, _)| *name == category);
    found.map(|(_, class)| *class).filter(|class| !class.is_empty())
}

/// Below this an object counts as standing, m/s; as mmdetection3d's results have it.
const MOVING_MPS: f64 = 0.2;

/// The attribute of an object of a class by its speed; empty where the class has none or the speed is not known.
#[must_use]
pub fn default_attribute(class: &str, velocity_mps: [f64; 2]) -> &'static str {
    let speed_mps = velocity_mps[0].hypot(velocity_mps[1]);
    if speed_mps.is_nan() {
        return "";
    }
    let is_moving = speed_mps > MOVING_MPS;
    match class {
        "car" | "bus" | "construction_vehicle" | "trailer" | "truck" if is_moving => "vehicle.moving",
        "car" | "bus" | "construction_vehicle" | "trailer" | "truck" => "vehicle.parked",
        "pedestrian" if is_moving => "pedestrian.moving",
        "pedestrian" => "pedestrian.standing",
        "bicycle" | "motorcycle" if is_moving => "cycle.with_rider",
        "bicycle" | "motorcycle" => "cycle.without_rider",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn categories_of_every_source_find_an_official_one() {
        use Distribution::{Id, Ood};
        let of =
            |name: &str, kind, distribution| official_category(Some(name), Some(kind), Some(distribution));
        assert_eq!(of("vehicle.bus.bendy", Kind::Vehicle, Id), "vehicle.bus.bendy");
        assert_eq!(of("Pedestrian", Kind::Pedestrian, Id), "human.pedestrian.adult");
        assert_eq!(of("CONSTRUCTION_CONE", Kind::Static, Ood), "movable_object.trafficcone");
        assert_eq!(of("hay_bale", Kind::Static, Ood), "movable_object.debris");
        assert_eq!(of("street_lamp", Kind::Static, Id), "static.manmade");
        assert!(SYNONYMS.iter().all(|(_, to)| CATEGORIES.iter().any(|(name, _)| name == to)));
    }

    #[test]
    fn stand_ins_are_detected_classes_and_speeds_give_attributes() {
        assert_eq!(CAR_TRUCK.map(|(_, name)| detection_class(name)), [Some("car"), Some("truck")]);
        assert_eq!(detection_class("movable_object.debris"), None);
        assert_eq!(default_attribute("car", [3.0, 0.0]), "vehicle.moving");
        assert_eq!(default_attribute("pedestrian", [0.0, 0.0]), "pedestrian.standing");
        assert_eq!(default_attribute("car", [f64::NAN; 2]), "");
        assert_eq!(default_attribute("barrier", [0.0; 2]), "");
    }
}
