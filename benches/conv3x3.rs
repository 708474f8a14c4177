//! Own 3x3 convolution against burn's, forward and forward with backward, on the shapes the model uses.

use burn::tensor::{Device, Distribution, Tensor, module::conv2d, ops::ConvOptions};
use harmzone::kernels::conv3x3;

/// channels in, channels out, height, width, stride
type Case = (usize, usize, usize, usize, usize);

const CASES: [Case; 5] = [
    (64, 64, 80, 64, 1),
    (32, 32, 160, 128, 1),
    (64, 64, 160, 128, 1),
    (128, 128, 40, 32, 1),
    (3, 16, 225, 400, 2),
];

fn main() {
    divan::main();
}

fn burns(x: Tensor<4>, w: Tensor<4>, stride: usize) -> Tensor<4> {
    conv2d(x, w, None, ConvOptions::new([stride, stride], [1, 1], [1, 1], 1))
}

fn operands((channels_in, channels_out, height, width, _): Case, device: &Device) -> (Tensor<4>, Tensor<4>) {
    let random = |dims| Tensor::<4>::random(dims, Distribution::Uniform(-0.5, 0.5), device);
    (random([1, channels_in, height, width]), random([channels_out, channels_in, 3, 3]))
}

fn bench_forward(bencher: divan::Bencher, case: Case, conv: fn(Tensor<4>, Tensor<4>, usize) -> Tensor<4>) {
    let (x, w) = operands(case, &Device::flex());
    bencher.bench_local(|| conv(x.clone(), w.clone(), case.4));
}

fn bench_train(bencher: divan::Bencher, case: Case, conv: fn(Tensor<4>, Tensor<4>, usize) -> Tensor<4>) {
    let (x, w) = operands(case, &Device::flex().autodiff());
    let (x, w) = (x.require_grad(), w.require_grad());
    bencher.bench_local(|| conv(x.clone(), w.clone(), case.4).sum().backward());
}

#[divan::bench(args = CASES, sample_count = 15, sample_size = 1)]
fn forward_own(bencher: divan::Bencher, case: Case) {
    bench_forward(bencher, case, conv3x3);
}

#[divan::bench(args = CASES, sample_count = 15, sample_size = 1)]
fn forward_burn(bencher: divan::Bencher, case: Case) {
    bench_forward(bencher, case, burns);
}

#[divan::bench(args = CASES, sample_count = 15, sample_size = 1)]
fn train_own(bencher: divan::Bencher, case: Case) {
    bench_train(bencher, case, conv3x3);
}

#[divan::bench(args = CASES, sample_count = 15, sample_size = 1)]
fn train_burn(bencher: divan::Bencher, case: Case) {
    bench_train(bencher, case, burns);
}
