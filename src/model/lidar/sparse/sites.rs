//! Active sites: the cells of a grid that hold features, in order.

/// The active cells of several samples' grids, ordered by sample, z, y, x; row `n` of a feature tensor
/// belongs to site `n`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sites {
    shape: [usize; 3],
    keys: Vec<u64>,
}

/// Sample and cell in one number with the order of (sample, z, y, x).
pub(super) fn key(sample_idx: usize, [z, y, x]: [usize; 3]) -> u64 {
    ((sample_idx as u64) << 48) | ((z as u64) << 32) | ((y as u64) << 16) | x as u64
}

/// Sample and cell of a key.
pub(super) fn sample_and_cell(key: u64) -> (usize, [usize; 3]) {
    let part = |shift: u32| (key >> shift) as usize & 0xffff;
    (part(48), [part(32), part(16), part(0)])
}

impl Sites {
    /// The sites of samples whose cells (z, y, x) are given in rising order.
    ///
    /// # Panics
    /// If cells do not rise or lie outside the shape, or if shape or samples exceed 65,536.
    #[must_use]
    pub fn new(shape: [usize; 3], samples: &[&[[u16; 3]]]) -> Self {
        assert!(shape.iter().chain([&samples.len()]).all(|&n| n <= 1 << 16), "a key has 16 bits an axis");
        let mut keys = Vec::with_capacity(samples.iter().map(|cells| cells.len()).sum());
        for (sample_idx, cells) in samples.iter().enumerate() {
            for cell in cells.iter().map(|cell| cell.map(usize::from)) {
                assert!(
                    cell.iter().zip(shape).all(|(&at, n)| at < n),
                    "cell {cell:?} lies outside {shape:?}"
                );
                keys.push(key(sample_idx, cell));
            }
        }
        Self::from_keys(shape, keys)
    }

    pub(super) fn from_keys(shape: [usize; 3], keys: Vec<u64>) -> Self {
        assert!(keys.is_sorted_by(|a, b| a < b), "sites rise");
        Self { shape, keys }
    }

    /// Cells of the grid along z, y, x.
    #[must_use]
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    #[must_use]
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    pub(super) fn keys(&self) -> &[u64] {
        &self.keys
    }

    /// Sample and cell (z, y, x) of each site.
    pub fn iter(&self) -> impl Iterator<Item = (usize, [usize; 3])> {
        self.keys.iter().map(|&key| sample_and_cell(key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_order_as_sample_and_cell_do_and_give_them_back() {
        let places = [(0, [0, 0, 9]), (0, [0, 1, 0]), (0, [2, 0, 0]), (1, [0, 0, 0]), (65_535, [65_535; 3])];
        let keys: Vec<u64> = places.iter().map(|&(sample_idx, cell)| key(sample_idx, cell)).collect();
        assert!(keys.is_sorted_by(|a, b| a < b));
        assert_eq!(keys.into_iter().map(sample_and_cell).collect::<Vec<_>>(), places);
    }

    #[test]
    #[should_panic(expected = "sites rise")]
    fn a_cell_given_twice_is_refused() {
        let _ = Sites::new([2, 2, 2], &[&[[0, 0, 0], [0, 0, 0]]]);
    }

    #[test]
    #[should_panic(expected = "lies outside")]
    fn a_cell_outside_is_refused() {
        let _ = Sites::new([2, 2, 2], &[&[[0, 2, 0]]]);
    }
}
