//! The matrix unit of newer x86-64 CPUs (AMX): products of tiles in bf16, summed in f32.
//!
//! An f32 number is the sum of two bf16 numbers to 2^-17 of itself: `high = bf16(x)`, `low = bf16(x - high)`. Three products
//! of such halves, `high high + high low + low high`, make one of f32 that is right to 2^-16; sums are f32. A
//! tile has 16 rows of 64 bytes: 16 by 32 numbers on the left of a product, 16 pairs by 16 columns on
//! its right, 16 by 16 sums in f32.

use std::env;
use std::sync::OnceLock;

/// Rows of a tile, and columns of sums.
pub(super) const TILE: usize = 16;
/// Sums that [`Blocks`] holds: rows, and columns.
pub(super) const BLOCK: usize = 2 * TILE;
/// Pairs of bf16 in a tile, each in a `u32`.
pub(super) const TILE_PAIRS: usize = TILE * TILE;

/// Half a unit in the last place of a bf16 number, in the bits of an f32.
const HALF: u32 = 0x8000;
const HIGH_BITS: u32 = 0xffff_0000;

/// The bits of both halves of a number, each in the upper 16 bits; below the upper ones of `low` is dirt.
#[inline(always)]
fn halves(x: f32) -> [u32; 2] {
    let high = x.to_bits().wrapping_add(HALF) & HIGH_BITS;
    let low = (x - f32::from_bits(high)).to_bits().wrapping_add(HALF);
    [high, low]
}

/// Splits two rows of numbers into pairs of halves: the first row's in the lower 16 bits.
#[inline(always)]
pub(super) fn split_pairs(first: &[f32], second: &[f32], high: &mut [u32], low: &mut [u32]) {
    let rows = first.iter().zip(second).zip(high.iter_mut().zip(low));
    for ((&a, &b), (high, low)) in rows {
        let ([a_high, a_low], [b_high, b_low]) = (halves(a), halves(b));
        *high = a_high >> 16 | b_high;
        *low = a_low >> 16 | b_low & HIGH_BITS;
    }
}

/// Splits a row of numbers into two rows of halves.
#[inline(always)]
pub(super) fn split(values: &[f32], high: &mut [u16], low: &mut [u16]) {
    for (&x, (high, low)) in values.iter().zip(high.iter_mut().zip(low)) {
        let halves = halves(x).map(|half| (half >> 16) as u16);
        [*high, *low] = halves;
    }
}

/// Set to `off`, this variable leaves the unit alone: all products are of f32 then, in vectors.
const SWITCH: &str = "HARMZONE_MATRIX_UNIT";

/// Whether this machine has the unit, the system lets this process use it, and nobody switched it off.
pub fn is_available() -> bool {
    static IS_AVAILABLE: OnceLock<bool> = OnceLock::new();
    *IS_AVAILABLE.get_or_init(|| env::var_os(SWITCH).is_none_or(|value| value != "off") && unit::request())
}

/// Two tiles' rows of the left operand, at one step of the sum: high halves, then low halves, 64 bytes a row.
#[derive(Clone, Copy)]
pub(super) struct Left {
    /// Of the first 16 rows of sums, and of the second.
    pub rows: [*const u8; 2],
    /// Bytes from a row to the next.
    pub stride: usize,
    /// Bytes from high halves to low ones.
    pub low: usize,
}

/// Two tiles side by side of the right operand, at one step of the sum: pairs of high halves, then of low ones.
#[derive(Clone, Copy)]
pub(super) struct Right {
    /// Of the first 16 columns of sums, and of the second.
    pub columns: [*const u8; 2],
    /// Bytes from a pair's row to the next.
    pub stride: usize,
    /// Bytes from high halves to low ones.
    pub low: usize,
}

/// The unit, set up for this thread until it is dropped: sums of [`BLOCK`] rows by [`BLOCK`] columns.
pub(super) struct Blocks(());

#[cfg(all(target_arch = "x86_64", target_os = "linux", not(miri)))]
mod unit {
    use std::arch::asm;

    use super::{BLOCK, Blocks, Left, Right};

    /// `arch_prctl` with ARCH_REQ_XCOMP_PERM for XTILEDATA (Linux 5.16).
    const ARCH_REQ_XCOMP_PERM: libc::c_long = 0x1023;
    const XTILEDATA: libc::c_long = 18;
    /// CPUID leaf 7: AMX-BF16 and AMX-TILE in EDX.
    const NEEDED: u32 = 1 << 22 | 1 << 24;

    /// Asks the system for the unit; whether there is one, and this process may use it.
    pub fn request() -> bool {
        let leaves = std::arch::x86_64::__cpuid(0).eax;
        // The code around the products is that of AVX-512.
        if leaves < 7 || !std::arch::is_x86_feature_detected!("avx512f") {
            return false;
        }
        if std::arch::x86_64::__cpuid_count(7, 0).edx & NEEDED != NEEDED {
            return false;
        }
        // SAFETY: the call takes two integers; a kernel that does not know it refuses.
        unsafe { libc::syscall(libc::SYS_arch_prctl, ARCH_REQ_XCOMP_PERM, XTILEDATA) == 0 }
    }

    /// Palette 1: eight tiles of 16 rows of 64 bytes.
    #[repr(C, align(64))]
    struct TileConfig([u8; 64]);

    static CONFIG: TileConfig = {
        let mut bytes = [0; 64];
        bytes[0] = 1;
        let mut tile = 0;
        while tile < 8 {
            bytes[16 + 2 * tile] = 64;
            bytes[48 + tile] = 16;
            tile += 1;
        }
        TileConfig(bytes)
    };

    #[allow(clippy::unused_self)] // that there is one says that the unit is set up
    impl Blocks {
        /// Sets the unit up for this thread.
        ///
        /// # Safety
        /// [`super::is_available`] holds, and this thread has no other.
        #[inline(always)]
        pub unsafe fn begin() -> Self {
            // SAFETY: the configuration is valid and as long as the instruction reads.
            unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const CONFIG, options(nostack, readonly)) };
            Self(())
        }

        /// Sets all sums to zero.
        #[inline(always)]
        pub fn clear(&mut self) {
            // SAFETY: the unit is set up; nothing but the tiles changes.
            unsafe {
                asm!("tilezero tmm0", "tilezero tmm1", "tilezero tmm2", "tilezero tmm3", out("tmm0") _, out("tmm1") _,
                    out("tmm2") _, out("tmm3") _, options(nostack, nomem, preserves_flags));
            }
        }

        /// Takes sums from memory, [`BLOCK`] rows of [`BLOCK`].
        ///
        /// # Safety
        /// They are readable.
        #[inline(always)]
        pub unsafe fn load(&mut self, from: *const f32) {
            // SAFETY: four tiles of 16 rows, 128 bytes apart.
            unsafe {
                asm!(
                    "tileloadd tmm0, [{from} + {stride}*1]",
                    "tileloadd tmm1, [{from} + {stride}*1 + 64]",
                    "tileloadd tmm2, [{from} + {stride}*1 + 2048]",
                    "tileloadd tmm3, [{from} + {stride}*1 + 2112]",
                    from = in(reg) from, stride = in(reg) BLOCK * 4,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    options(nostack, readonly, preserves_flags)
                );
            }
        }

        /// Writes the sums to memory, [`BLOCK`] rows of [`BLOCK`].
        ///
        /// # Safety
        /// They are writable.
        #[inline(always)]
        pub unsafe fn store(&mut self, to: *mut f32) {
            // SAFETY: four tiles of 16 rows, 128 bytes apart.
            unsafe {
                asm!(
                    "tilestored [{to} + {stride}*1], tmm0",
                    "tilestored [{to} + {stride}*1 + 64], tmm1",
                    "tilestored [{to} + {stride}*1 + 2048], tmm2",
                    "tilestored [{to} + {stride}*1 + 2112], tmm3",
                    to = in(reg) to, stride = in(reg) BLOCK * 4,
                    options(nostack, preserves_flags)
                );
            }
        }

        /// Adds the products of 32 numbers for each sum.
        ///
        /// # Safety
        /// Each operand's four tiles are readable.
        #[inline(always)]
        pub unsafe fn add(&mut self, left: Left, right: Right) {
            let high = left.rows;
            let low = left.rows.map(|row| row.wrapping_add(left.low));
            let right_high = right.columns;
            let right_low = right.columns.map(|column| column.wrapping_add(right.low));
            // SAFETY: the loads are of the tiles named.
            unsafe {
                asm!(
                    "tileloadd tmm4, [{left_high_0} + {left_stride}*1]",
                    "tileloadd tmm6, [{right_low_0} + {right_stride}*1]",
                    "tdpbf16ps tmm0, tmm4, tmm6",
                    "tileloadd tmm5, [{left_high_1} + {left_stride}*1]",
                    "tdpbf16ps tmm2, tmm5, tmm6",
                    "tileloadd tmm7, [{right_low_1} + {right_stride}*1]",
                    "tdpbf16ps tmm1, tmm4, tmm7",
                    "tdpbf16ps tmm3, tmm5, tmm7",
                    "tileloadd tmm6, [{right_high_0} + {right_stride}*1]",
                    "tdpbf16ps tmm0, tmm4, tmm6",
                    "tdpbf16ps tmm2, tmm5, tmm6",
                    "tileloadd tmm7, [{right_high_1} + {right_stride}*1]",
                    "tdpbf16ps tmm1, tmm4, tmm7",
                    "tdpbf16ps tmm3, tmm5, tmm7",
                    "tileloadd tmm4, [{left_low_0} + {left_stride}*1]",
                    "tdpbf16ps tmm0, tmm4, tmm6",
                    "tdpbf16ps tmm1, tmm4, tmm7",
                    "tileloadd tmm5, [{left_low_1} + {left_stride}*1]",
                    "tdpbf16ps tmm2, tmm5, tmm6",
                    "tdpbf16ps tmm3, tmm5, tmm7",
                    left_high_0 = in(reg) high[0],
                    left_high_1 = in(reg) high[1],
                    left_low_0 = in(reg) low[0],
                    left_low_1 = in(reg) low[1],
                    left_stride = in(reg) left.stride,
                    right_high_0 = in(reg) right_high[0],
                    right_high_1 = in(reg) right_high[1],
                    right_low_0 = in(reg) right_low[0],
                    right_low_1 = in(reg) right_low[1],
                    right_stride = in(reg) right.stride,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                    options(nostack, readonly, preserves_flags)
                );
            }
        }
    }

    impl Drop for Blocks {
        #[inline(always)]
        fn drop(&mut self) {
            // SAFETY: the unit was set up by `begin`.
            unsafe { asm!("tilerelease", options(nostack, nomem, preserves_flags)) };
        }
    }
}

/// Where there is no such unit.
#[cfg(not(all(target_arch = "x86_64", target_os = "linux", not(miri))))]
mod unit {
    use super::{Blocks, Left, Right};

    const WHY: &str = "`is_available` says no";

    pub fn request() -> bool {
        false
    }

    #[allow(clippy::unused_self)] // that there is one says that the unit is set up
    impl Blocks {
        pub unsafe fn begin() -> Self {
            unreachable!("{WHY}");
        }

        pub fn clear(&mut self) {
            unreachable!("{WHY}");
        }

        pub unsafe fn load(&mut self, _: *const f32) {
            unreachable!("{WHY}");
        }

        pub unsafe fn store(&mut self, _: *mut f32) {
            unreachable!("{WHY}");
        }

        pub unsafe fn add(&mut self, _: Left, _: Right) {
            unreachable!("{WHY}");
        }
    }
}
