//! Kernels over vectors of f32, compiled for each instruction set and chosen at run time.
//!
//! The vectors and the detection are those of the crate `macerator`, which burn's flex backend uses too. A [`Kernel`] is
//! written once, generic over `macerator::Simd`. The matrix unit ([`super::matrix_unit`]) comes on top of AVX-512.

use macerator::{Arch, WithSimd};
pub(super) use macerator::{Scalar, Simd, Vector};

use super::matrix_unit;
use super::products::{Products, has_pairs};

/// Work to be compiled once for each instruction set. Mark `run` and everything it calls `#[inline(always)]`.
pub(super) trait Kernel {
    /// `ROWS` is the height of the register tile (rows of `S` vectors), `LANES` the number of floats in a vector.
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self);
}

/// An instruction set that this machine has.
#[derive(Clone, Copy, Debug)]
pub(super) struct InstructionSet {
    vectors: Arch,
    has_matrix_unit: bool,
    has_pairs: bool,
}

impl InstructionSet {
    /// The fastest set of this machine.
    pub fn best() -> Self {
        Self { vectors: Arch::detect(), has_matrix_unit: matrix_unit::is_available(), has_pairs: false }
    }

    /// The fastest set for products of such numbers. Pairs go to vectors on every machine that has them, so that the same
    /// bytes come out.
    pub fn for_products(products: Products) -> Self {
        let best = Self::best();
        if products == Products::Bf16 && has_pairs() && best.lanes() == 16 {
            return Self { has_pairs: true, ..best.without_matrix_unit() };
        }
        best
    }

    /// All sets of this machine, slowest first.
    #[cfg(test)]
    pub fn available() -> Vec<Self> {
        let Self { vectors: best, has_matrix_unit, .. } = Self::best();
        #[cfg(target_arch = "x86_64")]
        let all = [Arch::Scalar, Arch::V2, Arch::V3, Arch::V4];
        #[cfg(not(target_arch = "x86_64"))]
        let all = [Arch::Scalar, best];
        // Each set of x86-64 holds the ones before it.
        let mut found: Vec<Self> = (all.into_iter().filter(|&set| set as u8 <= best as u8))
            .map(|vectors| Self { vectors, has_matrix_unit: false, has_pairs: false })
            .collect();
        found.extend(has_matrix_unit.then(Self::best));
        found
    }

    /// The same vectors alone.
    pub fn without_matrix_unit(self) -> Self {
        Self { has_matrix_unit: false, ..self }
    }

    /// Whether products of matrices may go to the matrix unit.
    pub fn has_matrix_unit(self) -> bool {
        self.has_matrix_unit
    }

    /// Whether convolutions multiply pairs of bf16.
    pub fn has_pairs(self) -> bool {
        self.has_pairs
    }

    /// Floats in a vector: `LANES` of [`Kernel::run`].
    pub fn lanes(self) -> usize {
        self.dispatch(TileSize)[1]
    }

    /// Height of the register tile: `ROWS` of [`Kernel::run`].
    pub fn rows(self) -> usize {
        self.dispatch(TileSize)[0]
    }

    /// Runs the kernel's version for this set.
    pub fn run<K: Kernel>(self, kernel: K) {
        self.dispatch(Run(kernel));
    }

    fn dispatch<W: WithSimd>(self, work: W) -> W::Output {
        // SAFETY: `best` and `available` make only sets that this machine has.
        unsafe { self.vectors.dispatch(work) }
    }
}

struct Run<K>(K);

impl<K: Kernel> WithSimd for Run<K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self) {
        const { assert!(matches!(lanes::<S>(), 2 | 4 | 8 | 16)) };
        // Constant conditions: only one branch is compiled for a set. Rows are those of `rows`.
        if const { lanes::<S>() == 16 } {
            self.0.run::<S, 8, 16>();
        } else if const { lanes::<S>() == 8 } {
            self.0.run::<S, 4, 8>();
        } else if const { lanes::<S>() == 4 } {
            self.0.run::<S, 4, 4>();
        } else {
            self.0.run::<S, 4, 2>();
        }
    }
}

struct TileSize;

impl WithSimd for TileSize {
    type Output = [usize; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self) -> [usize; 2] {
        const { [rows::<S>(), lanes::<S>()] }
    }
}

/// Floats in a vector.
pub(super) const fn lanes<S: Simd>() -> usize {
    size_of::<S::Register>() / size_of::<f32>()
}

/// Rows of a register tile. Rows times 3 accumulators, 3 operands and one broadcast fill the 16 registers of AVX2 and
/// older sets (4) and most of the 32 of AVX-512 (8).
const fn rows<S: Simd>() -> usize {
    if lanes::<S>() == 16 { 8 } else { 4 }
}
