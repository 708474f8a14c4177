//! The kernels of `src/kernels/mod.rs`, without burn.

#[path = "../../../src/kernels/conv3x3/mod.rs"]
mod conv3x3;
#[path = "../../../src/kernels/matrix_unit.rs"]
mod matrix_unit;
#[path = "../../../src/kernels/norm_relu/mod.rs"]
mod norm_relu;
#[path = "../../../src/kernels/products.rs"]
mod products;
#[path = "../../../src/kernels/scratch.rs"]
mod scratch;
#[path = "../../../src/kernels/simd.rs"]
mod simd;
#[path = "../../../src/kernels/softmax/mod.rs"]
mod softmax;
#[path = "../../../src/kernels/transpose.rs"]
mod transpose;
