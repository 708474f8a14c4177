//! Houses on their plots: what each one is like, and a lower building beside some.

use std::f64::consts::{FRAC_PI_2, PI};

use rand::RngExt;

use super::Grower;
use crate::scene::buildings::{Building, Roof, n_floors_of};
use crate::scene::looks::RoofStyle;
use crate::scene::occupancy::Footprint;
use crate::scene::path::Vec2;

/// Between a building's corner and a road.
const ROAD_GAP_M: f64 = 0.5;
/// Size of an annex along its house and away from it.
const ANNEX_M: [[f64; 2]; 2] = [[2.6, 6.0], [2.0, 3.6]];
/// Height of the teeth of a roof.
const TOOTH_M: f64 = 2.6;

impl Grower<'_> {
    pub(super) fn is_off_the_pavement(&self, footprint: &Footprint, gap_m: f64) -> bool {
        let n_along = (footprint.length_m / 1.5).ceil() as usize;
        let n_across = (footprint.width_m / 1.5).ceil() as usize;
        (0..=n_along).all(|i| {
            (0..=n_across).all(|j| {
                let x = footprint.length_m * (i as f64 / n_along as f64 - 0.5);
                let y = footprint.width_m * (j as f64 / n_across as f64 - 0.5);
                self.surface.paved_grid.clearance_m(footprint.at(x, y)) > gap_m
            })
        })
    }

    /// A building's corners keep further from roads than from pavements.
    pub(super) fn is_off_the_road(&self, footprint: &Footprint) -> bool {
        let corners = footprint.corners().map(|at| Vec2::new(at.x_m, at.y_m));
        corners.into_iter().all(|at| self.surface.road_grid.clearance_m(at) > ROAD_GAP_M)
    }

    pub(super) fn build(&mut self, footprint: Footprint) {
        let config = self.config;
        let height_m = self.draw(config.building_height_m);
        let pitch_rad = self.draw(config.roof_pitch_deg).to_radians();
        let mut building = Building {
            footprint,
            n_floors: n_floors_of(height_m),
            facade: self.pick(config.wall_colors.len()),
            roof_color: self.pick(config.roof_colors.len()),
            roof: Roof::Flat,
            balconies: Vec::new(),
            annex: None,
        };
        let more = &config.more_roof_styles;
        let style = if more.is_empty() { 0 } else { self.pick(more.len() + 1) };
        building.roof = match if style == 0 { config.roof_style } else { more[style - 1] } {
            RoofStyle::Flat => Roof::Flat,
            RoofStyle::Gable => Roof::Gable { rise_m: footprint.width_m / 2.0 * pitch_rad.tan() },
            RoofStyle::GableFront => Roof::GableFront { rise_m: footprint.length_m / 2.0 * pitch_rad.tan() },
            RoofStyle::Shed => Roof::Shed { rise_m: footprint.width_m * pitch_rad.tan() },
            RoofStyle::Sawtooth => Roof::Sawtooth { rise_m: TOOTH_M },
        };
        if config.annex_share > 0.0 && self.chance(config.annex_share) {
            building.annex = self.annex_of(&footprint);
        }
        let depth_m = self.draw(config.balcony_depth_m);
        building.add_balconies(|| self.rng.random::<f64>() < config.balcony_share, depth_m);
        self.plots.buildings.push(building);
    }

    /// Room for a lower building against the back or the right of a house, if there is some.
    fn annex_of(&mut self, house: &Footprint) -> Option<Footprint> {
        let [length_m, width_m] = ANNEX_M.map(|range_m| self.draw(range_m));
        let is_behind = self.chance(0.5);
        let wall_m = if is_behind { house.length_m } else { house.width_m };
        let length_m = length_m.min(wall_m - 0.6);
        let along_m = (wall_m - length_m) * (self.draw([-0.5, 0.5]));
        let out_m = width_m / 2.0 + if is_behind { house.width_m } else { house.length_m } / 2.0;
        let (center, turn) =
            if is_behind { (house.at(along_m, out_m), PI) } else { (house.at(out_m, along_m), FRAC_PI_2) };
        let annex = Footprint { center, yaw_rad: house.yaw_rad + turn, length_m, width_m };
        let is_free = self.is_off_the_pavement(&annex, 0.3)
            && self.is_off_the_road(&annex)
            && self.occupied.claim(annex, -0.02);
        is_free.then_some(annex)
    }
}
