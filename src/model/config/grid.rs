//! The bird's-eye grid in the ego frame, on which branches meet and queries are picked.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};

/// Where the detector looks, and the feature cells of that ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridConfig {
    /// Rear end of the map, metres ahead of the rear axle.
    pub x_min_m: f64,
    /// Front end.
    pub x_max_m: f64,
    /// Right end; y points left.
    pub y_min_m: f64,
    /// Left end.
    pub y_max_m: f64,
    /// Points lower than this (in the ego frame) are left out.
    pub z_min_m: f64,
    /// Points higher than this are left out.
    pub z_max_m: f64,
    /// Side of a feature cell. Default 0.8; the paper's is 0.6.
    pub cell_size_m: f64,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self {
            x_min_m: 0.0,
            x_max_m: 51.2,
            y_min_m: -32.0,
            y_max_m: 32.0,
            z_min_m: -1.0,
            z_max_m: 5.0,
            cell_size_m: 0.8,
        }
    }
}

impl GridConfig {
    /// Feature cells along x.
    #[must_use]
    pub fn n_cells_x(&self) -> usize {
        ((self.x_max_m - self.x_min_m) / self.cell_size_m).round() as usize
    }

    /// Feature cells along y.
    #[must_use]
    pub fn n_cells_y(&self) -> usize {
        ((self.y_max_m - self.y_min_m) / self.cell_size_m).round() as usize
    }

    /// All feature cells.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.n_cells_x() * self.n_cells_y()
    }

    /// The same ground in cells of another size.
    #[must_use]
    pub fn with_cell_size(&self, cell_size_m: f64) -> Self {
        Self { cell_size_m, ..*self }
    }

    /// Finds the cell `y * n_cells_x + x` of a point (x, y, z in the ego frame); `None` outside, above and
    /// below the grid.
    pub fn cell_finder(&self) -> impl Fn([f64; 3]) -> Option<u32> + use<> {
        let (grid, n_x, n_y) = (*self, self.n_cells_x(), self.n_cells_y());
        move |[x_m, y_m, z_m]| {
            let x = ((x_m - grid.x_min_m) / grid.cell_size_m).floor();
            let y = ((y_m - grid.y_min_m) / grid.cell_size_m).floor();
            let is_inside = (0.0..n_x as f64).contains(&x)
                && (0.0..n_y as f64).contains(&y)
                && (grid.z_min_m..grid.z_max_m).contains(&z_m);
            is_inside.then(|| (y as usize * n_x + x as usize) as u32)
        }
    }

    /// Centre of cell `y * n_x + x` in the ego frame, x and y, on a map of `scale` cells along a feature cell.
    #[must_use]
    pub fn cell_center_m(&self, cell: usize, n_x: usize, scale: usize) -> [f64; 2] {
        let cell_size_m = self.cell_size_m / scale as f64;
        [
            self.x_min_m + ((cell % n_x) as f64 + 0.5) * cell_size_m,
            self.y_min_m + ((cell / n_x) as f64 + 0.5) * cell_size_m,
        ]
    }
}

impl GridConfig {
    pub(super) fn check(&self) -> Result<(), ModelConfigError> {
        if !(self.cell_size_m > 0.0) {
            return fail("grid.cell_size_m", self.cell_size_m, "it must be above zero");
        }
        for (field, low, high) in
            [("grid.x", self.x_min_m, self.x_max_m), ("grid.y", self.y_min_m, self.y_max_m)]
        {
            let n_cells = (high - low) / self.cell_size_m;
            let is_even = (n_cells.round() as usize).is_multiple_of(2);
            if !(n_cells >= 2.0) || (n_cells - n_cells.round()).abs() > 1e-6 || !is_even {
                return fail(
                    field,
                    format!("{low}..{high} m"),
                    "it must hold an even number of cells: the coarse stage joins two",
                );
            }
        }
        if !(self.z_max_m > self.z_min_m) {
            return fail(
                "grid.z",
                format!("{}..{} m", self.z_min_m, self.z_max_m),
                "the maximum must lie above the minimum",
            );
        }
        Ok(())
    }
}
