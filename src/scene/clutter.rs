//! Background along pavements: bushes on the ground beside them, bags, crates and racks at their outer edges; and rows of
//! barriers and bins, which are objects.

use rand::RngExt;

use super::facing::is_plant;
use super::ground::{GRASS_M, PAVEMENT_M};
use super::models::{Model, Role};
use super::path::Vec2;
use super::populate::Filler;
use super::surface::StripKind;
use super::world::Motion;
use crate::object::{Distribution, Kind};
use crate::random;

/// Only pavements of this width have room for things at their outer edge.
const ROOMY_M: f64 = 2.4;
/// Bushes stand up to this far from the pavement.
const BESIDE_M: f64 = 5.0;
/// Farther from the route, hardly a beam meets things as small.
const CLUTTER_REACH_M: f64 = 25.0;
/// Rows hold this many things, least and most, with this gap between.
const ROW: [u32; 2] = [3, 7];
const ROW_GAP_M: f64 = 0.06;
/// Rows keep this far from a pavement's ends, where people cross.
const CORNER_M: f64 = 9.0;

impl Filler<'_> {
    /// Things that are never annotated, on both sides of each pavement's outer edge.
    pub(super) fn place_clutter(&mut self) {
        let mut rng = random::stream(self.seed, "clutter", 0);
        let (town, config) = (self.town, &self.town.config);
        let is_clutter = |model: &Model| model.facts.role == Role::Background;
        let weights: Vec<f64> = self
            .models
            .iter()
            .map(|model| config.clutter_weights.get(&model.name).copied().filter(|_| is_clutter(model)))
            .map(Option::unwrap_or_default)
            .collect();
        let [low, high] = config.clutter_spacing_m;
        for strip in town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Pavement) {
            let outer = -self.kerb_side(strip);
            let mut station_m = 3.0 * rng.random::<f64>();
            while station_m < strip.center.length_m() {
                let Some(model) = random::pick_weighted(weights.iter().copied(), &mut rng) else { return };
                let draw = rng.random::<f64>();
                let half_m = self.models[model].width_m().max(self.models[model].length_m()) / 2.0;
                let is_plant = is_plant(&self.models[model].facts.category);
                let heading_rad = strip.center.heading_rad(station_m);
                let (out_m, over_m, yaw_rad) = if is_plant {
                    let out_m = strip.width_m / 2.0 + half_m + 0.1 + BESIDE_M * draw * draw;
                    (out_m, GRASS_M, std::f64::consts::TAU * rng.random::<f64>())
                } else {
                    let depth_m = self.models[model].length_m() / 2.0;
                    // They look over the kerb.
                    (
                        strip.width_m / 2.0 - depth_m - 0.1,
                        PAVEMENT_M,
                        heading_rad - outer * std::f64::consts::FRAC_PI_2,
                    )
                };
                let at = strip.center.beside(station_m, outer * out_m);
                let has_room = if is_plant {
                    town.surface.paved_grid.clearance_m(at) > 0.4 * half_m
                        && self.is_off_walls(at, 0.8 * half_m)
                } else {
                    strip.width_m > ROOMY_M && self.is_off_walls(at, 0.1)
                };
                if has_room && self.is_closer(at, CLUTTER_REACH_M) && self.claim(model, at, yaw_rad, 0.05) {
                    self.put(model, at, over_m, yaw_rad, Motion::Still, &mut rng);
                }
                station_m += low + (high - low) * rng.random::<f64>();
            }
        }
    }

    /// Barriers end to end and bins side by side along the kerbs of pavements.
    pub(super) fn place_rows(&mut self) {
        let mut rng = random::stream(self.seed, "rows", 0);
        let town = self.town;
        for strip in town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Pavement) {
            let length_m = strip.center.length_m();
            let (is_wanted, draw): (bool, f64) =
                (rng.random::<f64>() < town.config.row_share * self.config.prop_density, rng.random());
            let n = rng.random_range(ROW[0]..=ROW[1]);
            let Some(model) = self.draw_row_model(&mut rng) else { return };
            if !is_wanted || length_m < 2.0 * CORNER_M + 10.0 {
                continue;
            }
            let side = self.kerb_side(strip);
            let (size_m, depth_m) = (self.models[model].width_m(), self.models[model].length_m());
            let mut station_m = CORNER_M + draw * (length_m - 2.0 * CORNER_M);
            for _ in 0..n {
                let at = strip.center.beside(station_m, side * (strip.width_m / 2.0 - depth_m / 2.0 - 0.2));
                let yaw_rad = strip.center.heading_rad(station_m) + side * std::f64::consts::FRAC_PI_2;
                if self.is_near(at) && station_m < length_m - CORNER_M && self.claim(model, at, yaw_rad, 0.0)
                {
                    self.put(model, at, PAVEMENT_M, yaw_rad, Motion::Still, &mut rng);
                }
                station_m += size_m + ROW_GAP_M;
            }
        }
    }

    /// A model that stands in rows, by the town's weights.
    fn draw_row_model(&self, rng: &mut random::Rng) -> Option<usize> {
        let weight_of = |model: &Model| {
            let is_prop = model.facts.kind == Kind::Static && model.facts.distribution == Distribution::Id;
            let weight = self.town.config.row_weights.get(&model.name).copied();
            weight.filter(|_| is_prop).unwrap_or_default()
        };
        random::pick_weighted(self.models.iter().map(weight_of), rng)
    }

    fn is_closer(&self, point: Vec2, reach_m: f64) -> bool {
        self.near.iter().any(|other| (point - other).norm() < reach_m)
    }

    fn is_off_walls(&self, at: Vec2, gap_m: f64) -> bool {
        !self.town.buildings.iter().any(|building| building.footprint.grow(gap_m).contains(at))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Arc;

    use crate::scene::{PopulateConfig, Town, populate};

    #[test]
    fn bushes_are_background_off_the_pavement_and_rows_are_contiguous_objects() {
        let town = Arc::new(Town::load("suburb").unwrap());
        let config = PopulateConfig { prop_density: 3.0, ..PopulateConfig::default() };
        let world = populate(&town, &config, 4).unwrap();
        let mut n_bushes = 0;
        let mut rows: Vec<_> = Vec::new();
        for (placement, object) in world.placements.iter().zip(world.objects()) {
            if object.category == "bush" {
                n_bushes += 1;
                assert!(object.is_background && !object.is_heap());
                assert!(town.surface.paved_grid.clearance_m(placement.position) > 0.1, "{}", placement.id);
            }
            if object.category == "barrier" {
                assert!(!object.is_background);
                rows.push((placement.position, world.models[placement.model].width_m()));
            }
        }
        assert!(n_bushes > 30, "{n_bushes}");
        let touches =
            rows.windows(2).filter(|pair| (pair[0].0 - pair[1].0).norm() < pair[0].1 + 0.15).count();
        assert!(rows.len() > 3 && 2 * touches > rows.len(), "{touches} of {}", rows.len());
    }
    #[test]
    fn bags_crates_and_racks_are_heaps() {
        let town = Arc::new(Town::load("market").unwrap());
        let world = populate(&town, &PopulateConfig::default(), 4).unwrap();
        let heaps = world.objects().iter().filter(|object| object.is_heap());
        let found: BTreeSet<&str> = heaps.map(|object| object.category.as_str()).collect();
        let all = BTreeSet::from(["bike_rack", "crates", "rubbish_bags"]);
        assert!(!found.is_empty() && found.is_subset(&all), "{found:?}");
    }
}
