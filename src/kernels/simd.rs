//! Vectors of f32 behind one trait, and the choice of an instruction set at run time.
//!
//! A [`Kernel`] is written once, generic over [`Simd`]; [`InstructionSet::run`] compiles it for each set.

use std::sync::OnceLock;

/// A vector of `LANES` floats.
///
/// # Safety
/// Methods may only be called by code compiled for the instruction set of the type, on a machine that has
/// it. A [`Kernel`] started by [`InstructionSet::run`] is such code.
pub(super) trait Simd: Copy {
    type Vector: Copy;
    const LANES: usize;

    unsafe fn zero() -> Self::Vector;
    unsafe fn splat(x: f32) -> Self::Vector;
    /// Reads `LANES` floats at `p`, which need no alignment beyond that of f32.
    unsafe fn load(p: *const f32) -> Self::Vector;
    /// Writes `LANES` floats at `p`, which need no alignment beyond that of f32.
    unsafe fn store(p: *mut f32, v: Self::Vector);
    /// The larger of each pair of lanes; `b` where one is no number.
    unsafe fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b + c`.
    unsafe fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
}

/// Work to be compiled once for each instruction set.
pub(super) trait Kernel {
    /// `ROWS` is the height of the register tile (rows of `S` vectors); `LANES` equals `S::LANES`.
    ///
    /// # Safety
    /// The machine has the instruction set of `S`, and the caller is compiled for it.
    unsafe fn run<S: Simd, const ROWS: usize, const LANES: usize>(self);
}

/// Instruction sets, by falling portability.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum InstructionSet {
    /// Plain Rust; the compiler makes of it what the target offers.
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The fastest set of this machine.
    pub fn best() -> Self {
        static BEST: OnceLock<InstructionSet> = OnceLock::new();
        *BEST.get_or_init(|| *Self::available().last().expect("Portable is always available"))
    }

    /// All sets of this machine, slowest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "only x86-64 adds to it")]
        let mut sets = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Self::Avx2);
            }
            if is_x86_feature_detected!("avx512f") {
                sets.push(Self::Avx512);
            }
        }
        sets
    }

    /// Floats in a vector: `LANES` of [`Kernel::run`].
    pub fn lanes(self) -> usize {
        match self {
            Self::Portable => 8,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => 8,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => 16,
        }
    }

    /// Height of the register tile: `ROWS` of [`Kernel::run`]. Rows times 3 accumulators, 3 operands and one
    /// broadcast fill the 16 registers of AVX2 (4) and most of the 32 of AVX-512 (8).
    pub fn rows(self) -> usize {
        match self {
            Self::Portable => 4,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => 4,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => 8,
        }
    }

    /// Runs the kernel's version for this set.
    ///
    /// # Panics
    /// If the machine lacks the set.
    pub fn run<K: Kernel>(self, kernel: K) {
        match self {
            // SAFETY: `Portable` uses no instruction beyond the target's baseline.
            Self::Portable => unsafe { kernel.run::<Portable, 4, 8>() },
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                assert!(is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));
                // SAFETY: the line above found the features `run_avx2` is compiled for.
                unsafe { run_avx2(kernel) }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                assert!(is_x86_feature_detected!("avx512f"));
                // SAFETY: the line above found the feature `run_avx512` is compiled for.
                unsafe { run_avx512(kernel) }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn run_avx2<K: Kernel>(kernel: K) {
    // SAFETY: this function is compiled for AVX2 and FMA, and its caller checked for both.
    unsafe { kernel.run::<x86::Avx2, 4, 8>() }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn run_avx512<K: Kernel>(kernel: K) {
    // SAFETY: this function is compiled for AVX-512F, and its caller checked for it.
    unsafe { kernel.run::<x86::Avx512, 8, 16>() }
}

#[derive(Clone, Copy)]
struct Portable;

impl Simd for Portable {
    type Vector = [f32; 8];
    const LANES: usize = 8;

    #[inline(always)]
    unsafe fn zero() -> [f32; 8] {
        [0.0; 8]
    }

    #[inline(always)]
    unsafe fn splat(x: f32) -> [f32; 8] {
        [x; 8]
    }

    #[inline(always)]
    unsafe fn load(p: *const f32) -> [f32; 8] {
        // SAFETY: the caller vouches for 8 floats at `p`; an array of f32 is aligned as f32 is.
        unsafe { p.cast::<[f32; 8]>().read() }
    }

    #[inline(always)]
    unsafe fn store(p: *mut f32, v: [f32; 8]) {
        // SAFETY: as for `load`.
        unsafe { p.cast::<[f32; 8]>().write(v) }
    }

    #[inline(always)]
    unsafe fn max(mut a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        for lane in 0..8 {
            a[lane] = if a[lane] > b[lane] { a[lane] } else { b[lane] };
        }
        a
    }

    #[inline(always)]
    unsafe fn mul_add(a: [f32; 8], b: [f32; 8], mut c: [f32; 8]) -> [f32; 8] {
        // Not `f32::mul_add`, which is a slow library call where the target has no such instruction.
        for lane in 0..8 {
            c[lane] += a[lane] * b[lane];
        }
        c
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64 as arch;

    macro_rules! simd {
        ($name:ident, $vector:ty, $lanes:expr, $zero:ident, $splat:ident, $load:ident, $store:ident, $max:ident, $fma:ident) => {
            #[derive(Clone, Copy)]
            pub(super) struct $name;

            // SAFETY of every method: the trait's contract gives the instruction set, and for `load` and
            // `store` the caller vouches for the floats at `p`; these intrinsics need no alignment.
            impl super::Simd for $name {
                type Vector = $vector;
                const LANES: usize = $lanes;

                #[inline(always)]
                unsafe fn zero() -> $vector {
                    // SAFETY: see above.
                    unsafe { arch::$zero() }
                }

                #[inline(always)]
                unsafe fn splat(x: f32) -> $vector {
                    // SAFETY: see above.
                    unsafe { arch::$splat(x) }
                }

                #[inline(always)]
                unsafe fn load(p: *const f32) -> $vector {
                    // SAFETY: see above.
                    unsafe { arch::$load(p) }
                }

                #[inline(always)]
                unsafe fn store(p: *mut f32, v: $vector) {
                    // SAFETY: see above.
                    unsafe { arch::$store(p, v) }
                }

                #[inline(always)]
                unsafe fn max(a: $vector, b: $vector) -> $vector {
                    // SAFETY: see above.
                    unsafe { arch::$max(a, b) }
                }

                #[inline(always)]
                unsafe fn mul_add(a: $vector, b: $vector, c: $vector) -> $vector {
                    // SAFETY: see above.
                    unsafe { arch::$fma(a, b, c) }
                }
            }
        };
    }

    simd!(
        Avx2,
        arch::__m256,
        8,
        _mm256_setzero_ps,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_max_ps,
        _mm256_fmadd_ps
    );
    simd!(
        Avx512,
        arch::__m512,
        16,
        _mm512_setzero_ps,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_max_ps,
        _mm512_fmadd_ps
    );
}
