//! Rows to columns: blocks of 16 by 16 words in vectors of AVX-512.

/// Turns 16 rows of 16 words, `stride` words apart, into columns; rows need no alignment.
///
/// # Safety
/// The rows are readable, 256 words are writable at `to`, and the CPU has AVX-512.
#[allow(clippy::cast_ptr_alignment, reason = "these loads and stores need no alignment")]
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn transpose(from: *const u32, stride: usize, to: *mut u32) {
    use std::arch::x86_64::{
        _mm512_loadu_si512, _mm512_shuffle_i32x4, _mm512_storeu_si512, _mm512_unpackhi_epi32,
        _mm512_unpackhi_epi64, _mm512_unpacklo_epi32, _mm512_unpacklo_epi64,
    };
    // SAFETY: the caller's promise.
    let row = |i: usize| unsafe { _mm512_loadu_si512(from.add(i * stride).cast()) };
    // Of four rows: in quarter q of vector c, column 4 q + c.
    let fours: [[_; 4]; 4] = std::array::from_fn(|four| {
        let [a, b, c, d] = std::array::from_fn(|i| row(4 * four + i));
        let (low, high) = (_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
        let (low_2, high_2) = (_mm512_unpacklo_epi32(c, d), _mm512_unpackhi_epi32(c, d));
        [
            _mm512_unpacklo_epi64(low, low_2),
            _mm512_unpackhi_epi64(low, low_2),
            _mm512_unpacklo_epi64(high, high_2),
            _mm512_unpackhi_epi64(high, high_2),
        ]
    });
    let [first, second, third, fourth] = fours;
    let columns = first.into_iter().zip(second).zip(third.into_iter().zip(fourth));
    for (c, ((a, b), (c_, d))) in columns.enumerate() {
        // Quarters 0 and 2, then 1 and 3.
        let even = (_mm512_shuffle_i32x4::<0x88>(a, b), _mm512_shuffle_i32x4::<0x88>(c_, d));
        let odd = (_mm512_shuffle_i32x4::<0xdd>(a, b), _mm512_shuffle_i32x4::<0xdd>(c_, d));
        let columns = [
            _mm512_shuffle_i32x4::<0x88>(even.0, even.1),
            _mm512_shuffle_i32x4::<0x88>(odd.0, odd.1),
            _mm512_shuffle_i32x4::<0xdd>(even.0, even.1),
            _mm512_shuffle_i32x4::<0xdd>(odd.0, odd.1),
        ];
        for (quarter, column) in columns.into_iter().enumerate() {
            // SAFETY: the caller's promise; column `4 quarter + c` of 16.
            unsafe { _mm512_storeu_si512(to.add((4 * quarter + c) * 16).cast(), column) };
        }
    }
}

/// # Safety
/// Never called: other CPUs have no AVX-512.
#[cfg(not(target_arch = "x86_64"))]
pub(super) unsafe fn transpose(_: *const u32, _: usize, _: *mut u32) {
    unreachable!("callers ask for AVX-512");
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;

    #[test]
    fn columns_become_rows() {
        if !std::arch::is_x86_feature_detected!("avx512f") {
            return; // nothing calls it then
        }
        let from: Vec<u32> = (0..16 * 19).collect();
        let mut to = vec![0; 256];
        // SAFETY: 16 rows of 16 words, 19 apart, are readable; 256 words are writable.
        unsafe { transpose(from.as_ptr(), 19, to.as_mut_ptr()) };
        for (at, word) in to.iter().enumerate() {
            assert_eq!(*word, from[at % 16 * 19 + at / 16]);
        }
    }
}
