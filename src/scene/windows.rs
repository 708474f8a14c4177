//! Windows of facades: where they lie in a bay of a floor, and how deep.

use super::looks::FacadeLook;

/// Which floor a tile shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Floor {
    Ground,
    Upper,
    /// No floor: wall alone.
    Blank,
}

/// Window as fractions of the tile: left, bottom, right, top.
pub(super) fn window(look: FacadeLook, floor: Floor) -> [f64; 4] {
    match (look, floor) {
        (_, Floor::Blank) => [2.0; 4],
        (FacadeLook::Brick, Floor::Upper) => [0.3, 0.22, 0.7, 0.82],
        (FacadeLook::Brick | FacadeLook::Plaster, Floor::Ground) => [0.1, 0.12, 0.9, 0.72],
        (FacadeLook::Plaster, Floor::Upper) => [0.18, 0.3, 0.82, 0.8],
        (FacadeLook::Shutters, Floor::Upper) => [0.35, 0.1, 0.65, 0.78],
        (FacadeLook::Shutters, Floor::Ground) => [0.26, 0.04, 0.74, 0.68],
        (FacadeLook::Stone, Floor::Upper) => [0.36, 0.25, 0.64, 0.85],
        (FacadeLook::Stone, Floor::Ground) => [0.22, 0.04, 0.78, 0.78],
        (FacadeLook::Glass, Floor::Upper) => [0.02, 0.3, 0.98, 0.96],
        (FacadeLook::Glass, Floor::Ground) => [0.03, 0.05, 0.97, 0.85],
        (FacadeLook::House, Floor::Upper) => [0.3, 0.35, 0.7, 0.82],
        (FacadeLook::House, Floor::Ground) => [0.28, 0.32, 0.72, 0.76],
        (FacadeLook::Metal, Floor::Upper) => [0.12, 0.7, 0.88, 0.9],
        (FacadeLook::Metal, Floor::Ground) => [0.14, 0.03, 0.86, 0.82],
        (FacadeLook::Warehouse, Floor::Upper) => [0.24, 0.18, 0.76, 0.84],
        (FacadeLook::Warehouse, Floor::Ground) => [0.16, 0.02, 0.84, 0.8],
        (FacadeLook::Rubble, Floor::Upper) => [0.36, 0.28, 0.62, 0.72],
        (FacadeLook::Rubble, Floor::Ground) => [0.34, 0.3, 0.64, 0.7],
    }
}

/// How far panes and gates lie behind the wall, metres: curtain walls least, rough masonry most.
pub(super) fn reveal_m(look: FacadeLook, floor: Floor) -> f64 {
    match (look, floor) {
        (FacadeLook::Glass, Floor::Upper) => 0.06,
        (FacadeLook::Metal, Floor::Upper) => 0.08,
        (FacadeLook::Brick | FacadeLook::Plaster | FacadeLook::House, _) => 0.14,
        (FacadeLook::Shutters, _) => 0.18,
        (FacadeLook::Glass | FacadeLook::Metal | FacadeLook::Stone | FacadeLook::Warehouse, _) => 0.24,
        (FacadeLook::Rubble, _) => 0.3,
    }
}
