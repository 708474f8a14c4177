//! The kernels that hold `unsafe` code, compiled from the program's own files, with their tests: Miri checks
//! every access of the portable path. The vector paths are the same code over other vector types; Miri does not
//! know most of their instructions, AddressSanitizer checks those. `sparse_conv` hands its products to the crate
//! `gemm` and is left out; the inline assembly of the matrix unit is checked by neither.

#[path = "../../../src/random.rs"]
mod random;

#[path = "kernels.rs"]
mod kernels;
