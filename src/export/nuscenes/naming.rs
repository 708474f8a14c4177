//! The categories of exported objects, by choice.

use crate::nuscenes::{CAR_TRUCK, official_category};
use crate::object::{Harm, Kind, Object};

/// What an object's category tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Naming {
    /// `harmful` or `harmless`: an object that changes sides is one instance of each.
    Harm,
    /// The same under names that the devkit's evaluation and mmdetection3d know: harmful is `vehicle.car`, harmless `vehicle.truck`.
    HarmAsCarTruck,
    /// The kind: `vehicle.car`, `human.pedestrian.adult` or `movable_object.barrier`.
    Kinds,
    /// The object's own category, or nuScenes' nearest to it.
    Source,
}

impl Naming {
    pub const ALL: [Self; 4] = [Self::Harm, Self::HarmAsCarTruck, Self::Kinds, Self::Source];

    /// The name in flags and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Harm => "harm",
            Self::HarmAsCarTruck => "harm-as-car-truck",
            Self::Kinds => "kinds",
            Self::Source => "source",
        }
    }

    /// Whether it tells labels.
    #[must_use]
    pub fn needs_labels(self) -> bool {
        matches!(self, Self::Harm | Self::HarmAsCarTruck)
    }

    /// The category of a class of harm.
    #[must_use]
    pub fn of_harm(self, harm: Harm) -> &'static str {
        match self {
            Self::HarmAsCarTruck => CAR_TRUCK[harm.index()].1,
            Self::Harm | Self::Kinds | Self::Source => harm.name(),
        }
    }

    /// The category of an object; `harm` is there where labels are needed.
    #[must_use]
    pub fn category(self, object: &Object, harm: Option<Harm>) -> &'static str {
        match (self, harm, object.kind) {
            (Self::Harm | Self::HarmAsCarTruck, Some(harm), _) => self.of_harm(harm),
            (Self::Kinds, _, Some(Kind::Vehicle)) => "vehicle.car",
            (Self::Kinds, _, Some(Kind::Pedestrian)) => "human.pedestrian.adult",
            (Self::Kinds, _, Some(Kind::Static)) => "movable_object.barrier",
            _ => official_category(object.category.as_deref(), object.kind, object.distribution),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Box3, Point};
    use crate::nuscenes::detection_class;
    use crate::object::Distribution;

    #[test]
    fn each_naming_says_what_it_promises() {
        let center = Point::new(10.0, 0.0, 0.5);
        let box_in_ego = Box3 { center, length_m: 1.0, width_m: 1.0, height_m: 1.0, yaw_rad: 0.0 };
        let bale = Object {
            category: Some("hay_bale".into()),
            kind: Some(Kind::Static),
            distribution: Some(Distribution::Ood),
            ..Object::new(box_in_ego)
        };
        let names = Naming::ALL.map(|naming| naming.category(&bale, Some(Harm::Harmless)));
        assert_eq!(names, ["harmless", "vehicle.truck", "movable_object.barrier", "movable_object.debris"]);
        let kinds =
            Kind::ALL.map(|kind| Naming::Kinds.category(&Object { kind: Some(kind), ..bale.clone() }, None));
        assert_eq!(kinds.map(detection_class), [Some("car"), Some("pedestrian"), Some("barrier")]);
    }
}
