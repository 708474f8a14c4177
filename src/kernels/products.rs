//! The numbers that convolutions multiply in training: f32, or pairs of bf16 whose products are summed in f32.
//!
//! bf16 keeps 8 bits of a number, which training forgives (Kalamkar et al. 2019): weights, sums, norms and steps stay
//! f32. A CPU with AVX512-BF16 multiplies twice as many of them at a time; others multiply in f32 all the same.

use std::cell::Cell;

use serde::{Deserialize, Serialize};

/// What the convolutions of a training step multiply.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Products {
    #[default]
    F32,
    /// Where the CPU can.
    Bf16,
}

thread_local! {
    static CURRENT: Cell<Products> = const { Cell::new(Products::F32) };
}

impl Products {
    /// Runs work whose convolutions, as far as they have gradients, multiply such numbers. It holds for this thread: the
    /// one that calls the operations, whichever threads compute them, forward and backward.
    pub fn during<R>(self, work: impl FnOnce() -> R) -> R {
        struct Restore(Products);
        impl Drop for Restore {
            fn drop(&mut self) {
                CURRENT.set(self.0);
            }
        }
        let _restore = Restore(CURRENT.replace(self));
        work()
    }

    /// What this thread's convolutions multiply.
    pub(super) fn current() -> Self {
        CURRENT.get()
    }
}

/// Whether this CPU multiplies pairs of bf16 in vectors of AVX-512.
pub(super) fn has_pairs() -> bool {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512bw")
            && std::arch::is_x86_feature_detected!("avx512bf16")
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    {
        false
    }
}

/// Half a unit in the last place of a bf16 number, in the bits of an f32.
pub(super) const HALF: u32 = 0x8000;

/// Two numbers rounded to bf16, the first in the lower 16 bits, as the bits of an f32.
#[inline(always)]
pub(super) fn pair(first: f32, second: f32) -> f32 {
    let round = |x: f32| x.to_bits().wrapping_add(HALF);
    f32::from_bits(round(first) >> 16 | round(second) & 0xffff_0000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_holds_both_numbers_to_eight_bits() {
        let bits = pair(1.2345, -300.7).to_bits();
        let [first, second] = [bits << 16, bits & 0xffff_0000].map(f32::from_bits);
        assert!((first - 1.2345).abs() < 1.2345 / 256.0 && (second + 300.7).abs() < 300.7 / 256.0);
        assert_eq!(pair(0.0, 1.0).to_bits(), 0x3f80_0000);
    }

    #[test]
    fn products_hold_for_the_work_alone() {
        assert_eq!(Products::Bf16.during(Products::current), Products::Bf16);
        assert_eq!(Products::current(), Products::F32);
    }
}
