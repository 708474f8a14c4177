//! The bird's-eye grid in the ego frame, on which branches meet and queries are picked.

use crate::config::{Check, InvalidConfig, Rule, define_config, from_to, require};

define_config! {
    /// The ground that the detector covers, and its feature cells.
    #[derive(Copy)]
    pub struct GridConfig {
        /// Rear end of the map, metres ahead of the rear axle.
        x_min_m: f64 = 0.0, in METRES;
        /// Front end.
        x_max_m: f64 = 51.2, in METRES;
        /// Right end; y points left.
        y_min_m: f64 = -32.0, in METRES;
        /// Left end.
        y_max_m: f64 = 32.0, in METRES;
        /// Points lower than this (in the ego frame) are left out.
        z_min_m: f64 = -1.0, in METRES;
        /// Points higher than this are left out.
        z_max_m: f64 = 5.0, in METRES;
        /// Side of a feature cell. Default 0.8; the paper's is 0.6.
        cell_size_m: f64 = 0.8, in from_to(0.01, 100.0);
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

/// Numbers of the largest map of a sample, 1 GiB of them: a file of some bytes must not ask for any amount of memory.
pub(super) const MAX_MAP_NUMBERS: usize = 1 << 28;

/// Sizes of layers.
pub(super) const CHANNELS: Rule = from_to(1.0, 1024.0);

/// Bounds of a coordinate, metres.
pub(super) const METRES: Rule = from_to(-1000.0, 1000.0);

impl Check for GridConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        for (key, low, high) in
            [("x_max_m", self.x_min_m, self.x_max_m), ("y_max_m", self.y_min_m, self.y_max_m)]
        {
            check_cells(key, [low, high], self.cell_size_m, 1024)?;
            let n_cells = ((high - low) / self.cell_size_m).round() as usize;
            let wanted = "an even number of cells is needed: the coarse stage joins two";
            require(
                n_cells.is_multiple_of(2),
                key,
                format!("{high}, {n_cells} cells from {low} on"),
                wanted,
            )?;
        }
        check_rises("z_max_m", self.z_min_m, self.z_max_m)
    }
}

/// Checks that a range holds a whole number of cells.
pub(super) fn check_cells(
    key: &str,
    [low, high]: [f64; 2],
    size: f64,
    most: u32,
) -> Result<(), InvalidConfig> {
    let n = (high - low) / size;
    let is_whole = (n - n.round()).abs() < 1e-6 && (1.0..=f64::from(most)).contains(&n.round());
    let wanted = format!("a whole number of steps of {size} from {low} on, 1 to {most}, is needed");
    require(is_whole, key, high, wanted)
}

/// Checks that a range's end lies above its start.
pub(super) fn check_rises(key: &str, low: f64, high: f64) -> Result<(), InvalidConfig> {
    require(high > low, key, high, format!("a number above {low}, where the range begins, is needed"))
}
