//! Which input row meets which output row at each kernel offset.

use std::ops::Range;
use std::sync::OnceLock;

use burn::tensor::{Device, Int, Tensor, TensorData};

/// Rows that meet at one kernel offset; pair `n` is `(inputs[n], outputs[n])`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct OffsetPairs {
    /// Input rows, strictly rising.
    pub inputs: Vec<u32>,
    /// Output rows, strictly rising.
    pub outputs: Vec<u32>,
}

/// Input and output rows of a tensor, one entry for each pair.
type Indices = (Tensor<1, Int>, Tensor<1, Int>);

/// The pairs of all offsets of a sparse convolution.
#[derive(Debug)]
pub struct Rulebook {
    n_inputs: usize,
    n_outputs: usize,
    offsets: Vec<OffsetPairs>,
    /// The pairs as tensors, for devices that run burn's own operations; made on first use.
    indices: OnceLock<Vec<Option<Indices>>>,
}

impl Rulebook {
    /// # Panics
    /// If the rows of an offset do not rise, differ in number, or lie outside.
    #[must_use]
    pub fn new(n_inputs: usize, n_outputs: usize, offsets: Vec<OffsetPairs>) -> Self {
        for pairs in &offsets {
            assert_eq!(pairs.inputs.len(), pairs.outputs.len(), "a pair has two rows");
            for (rows, n_rows) in [(&pairs.inputs, n_inputs), (&pairs.outputs, n_outputs)] {
                assert!(rows.is_sorted_by(|a, b| a < b), "rows of an offset rise");
                assert!(rows.last().is_none_or(|&row| (row as usize) < n_rows), "a row lies outside");
            }
        }
        Self { n_inputs, n_outputs, offsets, indices: OnceLock::new() }
    }

    #[must_use]
    pub fn n_inputs(&self) -> usize {
        self.n_inputs
    }

    #[must_use]
    pub fn n_outputs(&self) -> usize {
        self.n_outputs
    }

    #[must_use]
    pub fn offsets(&self) -> &[OffsetPairs] {
        &self.offsets
    }

    /// Pairs of all offsets together.
    #[must_use]
    pub fn n_pairs(&self) -> usize {
        self.offsets.iter().map(|pairs| pairs.inputs.len()).sum()
    }

    /// The pairs of each offset on a device, `None` for an offset without any.
    pub(super) fn indices(&self, device: &Device) -> Vec<Option<Indices>> {
        let tensor = |rows: &[u32], device: &Device| {
            let rows: Vec<i64> = rows.iter().map(|&row| i64::from(row)).collect();
            Tensor::<1, Int>::from_data(TensorData::new(rows.clone(), [rows.len()]), device)
        };
        let made = self.indices.get_or_init(|| {
            let pair = |pairs: &OffsetPairs| {
                let is_met = !pairs.inputs.is_empty();
                is_met.then(|| (tensor(&pairs.inputs, device), tensor(&pairs.outputs, device)))
            };
            self.offsets.iter().map(pair).collect()
        });
        made.iter()
            .map(|pair| pair.clone().map(|(a, b)| (a.to_device(device), b.to_device(device))))
            .collect()
    }
}

/// Direction in which the pairs are read: from inputs to outputs, or back, as for the gradient of the input.
#[derive(Debug, Clone, Copy)]
pub(super) enum Direction {
    Forward,
    Backward,
}

impl Direction {
    /// Rows read and rows written of one offset.
    pub fn rows(self, pairs: &OffsetPairs) -> (&[u32], &[u32]) {
        match self {
            Self::Forward => (&pairs.inputs, &pairs.outputs),
            Self::Backward => (&pairs.outputs, &pairs.inputs),
        }
    }

    /// Number of rows written.
    pub fn n_written(self, rulebook: &Rulebook) -> usize {
        match self {
            Self::Forward => rulebook.n_outputs,
            Self::Backward => rulebook.n_inputs,
        }
    }
}

/// Positions of the rows that lie in `rows`, where `sorted` rises.
pub(super) fn positions(sorted: &[u32], rows: Range<usize>) -> Range<usize> {
    let start = sorted.partition_point(|&row| (row as usize) < rows.start);
    start..start + sorted[start..].partition_point(|&row| (row as usize) < rows.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_those_of_the_rows_in_the_range() {
        let sorted = [0, 3, 4, 9];
        assert_eq!(positions(&sorted, 1..5), 1..3);
        assert_eq!(positions(&sorted, 0..10), 0..4);
        assert_eq!(positions(&sorted, 5..9), 3..3);
    }

    #[test]
    #[should_panic(expected = "a row lies outside")]
    fn a_row_outside_is_refused() {
        let _ = Rulebook::new(2, 2, vec![OffsetPairs { inputs: vec![2], outputs: vec![0] }]);
    }

    #[test]
    #[should_panic(expected = "rows of an offset rise")]
    fn rows_that_do_not_rise_are_refused() {
        let _ = Rulebook::new(2, 2, vec![OffsetPairs { inputs: vec![0, 1], outputs: vec![1, 1] }]);
    }
}
