//! The models that stand and move as unfamiliar objects do: those of the world's own side of the benchmark, or random
//! solids.

use super::models::{Model, indices_of};
use super::populate::PopulateConfig;
use super::solids::CATEGORY;
use super::split::SceneSplit;
use crate::object::{Distribution, Kind};

/// Indices of the unfamiliar models that worlds of a split may hold.
pub(super) fn unfamiliar(models: &[Model], split: SceneSplit) -> Vec<usize> {
    let mut indices = indices_of(models, Kind::Static, Distribution::Ood);
    indices.retain(|&i| models[i].facts.split == split);
    indices
}

/// Indices of the models that a world places as unfamiliar.
pub(super) fn strange(models: &[Model], config: &PopulateConfig) -> Vec<usize> {
    if config.places_solids() {
        return (0..models.len()).filter(|&i| models[i].facts.category == CATEGORY).collect();
    }
    unfamiliar(models, config.split)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::models;
    use super::*;

    #[test]
    fn no_unfamiliar_category_is_on_both_sides() {
        let library = models::load().unwrap();
        let [dev, test] = SceneSplit::ALL.map(|split| -> BTreeSet<&str> {
            let of_split = unfamiliar(&library, split).into_iter();
            of_split.map(|i| library[i].facts.category.as_str()).collect()
        });
        assert!(dev.len() == 11 && test.len() >= 14 && dev.is_disjoint(&test), "{dev:?}, {test:?}");
        let familiar = library.iter().filter(|model| model.facts.distribution == Distribution::Id);
        let familiar: BTreeSet<&str> = familiar.map(|model| model.facts.category.as_str()).collect();
        assert!(familiar.is_disjoint(&dev) && familiar.is_disjoint(&test));
    }
}
