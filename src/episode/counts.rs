//! Counts of objects by distribution, kind and harm, as manifests hold them.

use serde::{Deserialize, Serialize};

use crate::object::{Distribution, Harm, Kind, Object};

/// One value for each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerKind<T> {
    pub vehicle: T,
    pub pedestrian: T,
    #[serde(rename = "static")]
    pub static_object: T,
}

impl<T> PerKind<T> {
    pub fn get(&self, kind: Kind) -> &T {
        match kind {
            Kind::Vehicle => &self.vehicle,
            Kind::Pedestrian => &self.pedestrian,
            Kind::Static => &self.static_object,
        }
    }

    pub fn get_mut(&mut self, kind: Kind) -> &mut T {
        match kind {
            Kind::Vehicle => &mut self.vehicle,
            Kind::Pedestrian => &mut self.pedestrian,
            Kind::Static => &mut self.static_object,
        }
    }

    /// The values in the order vehicle, pedestrian, static.
    pub fn values(&self) -> [&T; 3] {
        [&self.vehicle, &self.pedestrian, &self.static_object]
    }
}

/// One value for each distribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerDistribution<T> {
    pub id: T,
    pub ood: T,
}

impl<T> PerDistribution<T> {
    pub fn get(&self, distribution: Distribution) -> &T {
        match distribution {
            Distribution::Id => &self.id,
            Distribution::Ood => &self.ood,
        }
    }

    pub fn get_mut(&mut self, distribution: Distribution) -> &mut T {
        match distribution {
            Distribution::Id => &mut self.id,
            Distribution::Ood => &mut self.ood,
        }
    }
}

impl<T> PerDistribution<PerKind<T>> {
    /// The value of an object's distribution and kind; `None` if either is unknown.
    pub fn of_mut(&mut self, object: &Object) -> Option<&mut T> {
        Some(self.get_mut(object.distribution?).get_mut(object.kind?))
    }
}

/// Annotated boxes, each sample counted anew.
pub type ObjectCounts = PerDistribution<PerKind<u64>>;

impl ObjectCounts {
    #[must_use]
    pub fn total(&self) -> u64 {
        self.id.values().into_iter().chain(self.ood.values()).sum()
    }
}

/// Boxes of each class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HarmCounts {
    pub harmful: u64,
    pub harmless: u64,
}

impl HarmCounts {
    pub fn add(&mut self, harm: Harm) {
        match harm {
            Harm::Harmful => self.harmful += 1,
            Harm::Harmless => self.harmless += 1,
        }
    }

    pub fn add_all(&mut self, others: &Self) {
        self.harmful += others.harmful;
        self.harmless += others.harmless;
    }
}

/// Labelled boxes, each sample counted anew.
pub type LabelCounts = PerDistribution<PerKind<HarmCounts>>;

impl LabelCounts {
    pub fn add_all(&mut self, others: &Self) {
        for distribution in [Distribution::Id, Distribution::Ood] {
            for kind in [Kind::Vehicle, Kind::Pedestrian, Kind::Static] {
                self.get_mut(distribution).get_mut(kind).add_all(others.get(distribution).get(kind));
            }
        }
    }
}
