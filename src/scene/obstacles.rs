//! What loose things bounce off and cannot pass: houses with their annexes, landmarks, stacks, walls and fences.

use super::annexes;
use super::looks::{BoundaryLook, LandmarkLook};
use super::occupancy::Footprint;
use super::path::Vec2;
use super::town::Town;

/// Of landmarks and stacks as far as loose things fly.
const HIGH_M: f64 = 8.0;
/// Of hedges, fences and garden walls, and their width.
const BOUNDARY_M: f64 = 1.0;
const LINE_WIDTH_M: f64 = 0.3;
const PIECE_M: f64 = 3.0;

/// A block on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Block {
    pub footprint: Footprint,
    /// Of its top over the ground in its middle.
    pub height_m: f64,
}

impl Town {
    /// What stands on an area of its own, but for houses. Cranes stand on legs and ships in water.
    pub(super) fn blocks(&self) -> impl Iterator<Item = Block> {
        let annexes = self.buildings.iter().filter_map(|building| building.annex);
        let annexes = annexes.map(|footprint| Block { footprint, height_m: annexes::WALL_M });
        let is_block = |look| !matches!(look, LandmarkLook::QuayCrane | LandmarkLook::Ship);
        let landmarks = self.landmarks.iter().filter(move |landmark| is_block(landmark.look));
        let high = landmarks.map(|landmark| landmark.footprint).chain(self.stacks.iter().copied());
        annexes.chain(high.map(|footprint| Block { footprint, height_m: HIGH_M }))
    }

    /// Pieces of the hedges, fences and walls of which `is_near` holds, given a middle and half a length.
    pub(super) fn lines_where(&self, is_near: impl Fn(Vec2, f64) -> bool) -> Vec<Block> {
        let boundaries = self.boundaries.iter().filter(|boundary| boundary.look != BoundaryLook::Open);
        let boundaries = boundaries.map(|boundary| (&boundary.line, BOUNDARY_M));
        let walls = self.walls.iter().map(|wall| (&wall.line, wall.height_m));
        let mut pieces = Vec::new();
        for (line, height_m) in boundaries.chain(walls) {
            let half_m = line.length_m() / 2.0;
            if is_near(line.at(half_m), half_m) {
                let points = line.points_every(PIECE_M);
                let footprints =
                    points.windows(2).map(|pair| Footprint::between(pair[0], pair[1], LINE_WIDTH_M));
                let near = footprints.filter(|piece| is_near(piece.center, piece.length_m / 2.0));
                pieces.extend(near.map(|footprint| Block { footprint, height_m }));
            }
        }
        pieces
    }
}
