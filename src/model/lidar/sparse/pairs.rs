//! Which active sites a sparse convolution joins: its output sites and its rulebook.
//!
//! As a dense convolution: output cell `o` reads input cell `i = o * stride - padding + k` at offset `k`.
//! At a fixed offset, `o` rises with `i` in the order of sites, so that two sorted lists are merged and no
//! hash is needed.

use rayon::prelude::*;

use super::sites::{Sites, key, sample_and_cell};
use crate::kernels::{OffsetPairs, Rulebook};
use crate::model::config::SparseKernel;

impl SparseKernel {
    /// Offsets along z, y, x, in the order of the kernel's matrices.
    fn offsets(&self) -> Vec<[usize; 3]> {
        let [n_z, n_y, n_x] = self.kernel;
        (0..n_z * n_y * n_x).map(|k| [k / (n_x * n_y), k / n_x % n_y, k % n_x]).collect()
    }

    /// The output cell that reads `input` at `offset`.
    fn output_of(&self, input: [usize; 3], offset: [usize; 3], out_shape: [usize; 3]) -> Option<[usize; 3]> {
        let mut output = [0; 3];
        for axis in 0..3 {
            let ahead = (input[axis] + self.padding[axis]).checked_sub(offset[axis])?;
            // Divisions by a number that is not known in advance would take most of the time.
            let (quotient, remainder) = match self.stride[axis] {
                1 => (ahead, 0),
                2 => (ahead / 2, ahead % 2),
                stride => (ahead / stride, ahead % stride),
            };
            if remainder != 0 || quotient >= out_shape[axis] {
                return None;
            }
            output[axis] = quotient;
        }
        Some(output)
    }

    /// The output sites of a strided sparse convolution: every cell that reads at least one input.
    ///
    /// # Panics
    /// If the kernel does not fit into the grid.
    pub fn output_sites(&self, inputs: &Sites) -> Sites {
        let out_shape = self.out_shape(inputs.shape()).expect("the encoder's config has been checked");
        let offsets = self.offsets();
        let mut keys: Vec<u64> = inputs
            .keys()
            .par_iter()
            .flat_map_iter(|&input| {
                let (sample_idx, cell) = sample_and_cell(input);
                offsets.iter().filter_map(move |&offset| {
                    self.output_of(cell, offset, out_shape).map(|output| key(sample_idx, output))
                })
            })
            .collect();
        keys.par_sort_unstable();
        keys.dedup();
        Sites::from_keys(out_shape, keys)
    }

    /// The pairs of all offsets from input sites to output sites.
    pub fn rulebook(&self, inputs: &Sites, outputs: &Sites) -> Rulebook {
        let pairs: Vec<OffsetPairs> =
            self.offsets().into_par_iter().map(|offset| self.pairs(inputs, outputs, offset)).collect();
        Rulebook::new(inputs.len(), outputs.len(), pairs)
    }

    /// The pairs of a submanifold convolution, whose outputs are its inputs: opposite offsets have the same pairs,
    /// turned around, and the middle offset joins each site with itself.
    pub fn submanifold_rulebook(sites: &Sites) -> Rulebook {
        let offsets = Self::SUBMANIFOLD.offsets();
        let middle = offsets.len() / 2;
        let mut pairs: Vec<OffsetPairs> = offsets[..middle]
            .par_iter()
            .map(|&offset| Self::SUBMANIFOLD.pairs(sites, sites, offset))
            .collect();
        let all: Vec<u32> = (0..sites.len() as u32).collect();
        pairs.push(OffsetPairs { inputs: all.clone(), outputs: all });
        for opposite in (0..middle).rev() {
            let OffsetPairs { inputs, outputs } = pairs[opposite].clone();
            pairs.push(OffsetPairs { inputs: outputs, outputs: inputs });
        }
        Rulebook::new(sites.len(), sites.len(), pairs)
    }

    /// The pairs of one offset.
    fn pairs(&self, inputs: &Sites, outputs: &Sites, offset: [usize; 3]) -> OffsetPairs {
        let mut pairs = OffsetPairs::default();
        let mut candidates = outputs.keys().iter().enumerate().peekable();
        for (input_row, &input) in inputs.keys().iter().enumerate() {
            let (sample_idx, cell) = sample_and_cell(input);
            let Some(output) = self.output_of(cell, offset, outputs.shape()) else { continue };
            let wanted = key(sample_idx, output);
            while candidates.next_if(|&(_, &candidate)| candidate < wanted).is_some() {}
            if let Some((output_row, _)) = candidates.next_if(|&(_, &candidate)| candidate == wanted) {
                pairs.inputs.push(input_row as u32);
                pairs.outputs.push(output_row as u32);
            }
        }
        pairs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRIDED: SparseKernel = SparseKernel { kernel: [3; 3], stride: [2; 3], padding: [1; 3] };

    #[test]
    fn turning_pairs_around_gives_those_of_the_opposite_offset() {
        let cells: Vec<[u16; 3]> =
            (0..240).filter(|i| i * i % 7 < 3).map(|i| [i / 60, i / 10 % 6, i % 10]).collect();
        let sites = Sites::new([4, 6, 10], &[&cells, &cells[5..]]);
        let (turned, merged) =
            (SparseKernel::submanifold_rulebook(&sites), SparseKernel::SUBMANIFOLD.rulebook(&sites, &sites));
        assert_eq!(turned.offsets(), merged.offsets());
        assert!(turned.n_pairs() > 3 * sites.len());
    }

    #[test]
    fn a_submanifold_pair_needs_both_sites_and_one_sample() {
        let sites = Sites::new([2, 2, 4], &[&[[0, 0, 0], [0, 0, 1], [0, 0, 3]], &[[0, 0, 2]]]);
        let rulebook = SparseKernel::SUBMANIFOLD.rulebook(&sites, &sites);
        let at = |z: usize, y: usize, x: usize| &rulebook.offsets()[(z * 3 + y) * 3 + x];
        assert_eq!(at(1, 1, 1).inputs, [0, 1, 2, 3]);
        // Offset 2 along x: an output reads its right neighbour.
        assert_eq!((&at(1, 1, 2).inputs[..], &at(1, 1, 2).outputs[..]), (&[1][..], &[0][..]));
        assert_eq!((&at(1, 1, 0).inputs[..], &at(1, 1, 0).outputs[..]), (&[0][..], &[1][..]));
        assert_eq!(rulebook.n_pairs(), 6);
    }

    #[test]
    fn a_strided_site_is_reached_from_every_cell_of_its_kernel() {
        let sites = Sites::new([1, 1, 6], &[&[[0, 0, 1], [0, 0, 4]]]);
        let outputs = STRIDED.output_sites(&sites);
        // Along x, cell 1 is read by outputs 0 and 1, cell 4 by output 2.
        assert_eq!(outputs, Sites::new([1, 1, 3], &[&[[0, 0, 0], [0, 0, 1], [0, 0, 2]]]));
        let rulebook = STRIDED.rulebook(&sites, &outputs);
        let along_x: Vec<&OffsetPairs> = (0..3).map(|x| &rulebook.offsets()[(3 + 1) * 3 + x]).collect();
        assert_eq!((&along_x[0].inputs[..], &along_x[0].outputs[..]), (&[0][..], &[1][..]));
        assert_eq!((&along_x[1].inputs[..], &along_x[1].outputs[..]), (&[1][..], &[2][..]));
        assert_eq!((&along_x[2].inputs[..], &along_x[2].outputs[..]), (&[0][..], &[0][..]));
    }
}
