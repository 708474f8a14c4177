//! Batch norm followed by a ReLU, f32, as one pass over each channel: by the batch's own statistics with
//! gradients, or by given ones.
//!
//! ```text
//! y = max(0, gamma (x - mean) / sqrt(var + epsilon) + beta)
//! ```
//!
//! with `mean` and the biased `var` over batch, y and x (Ioffe and Szegedy 2015). The gradient with respect to
//! x is, over the n values of a channel, with `h = (x - mean) / sqrt(var + epsilon)` and g the gradient that the
//! ReLU lets through, `gamma / sqrt(var + epsilon) (g - mean(g) - h mean(g h))`.
//!
//! Images are dense `[batch, channel, y, x]`. Sums run in lanes whose number only the instruction set
//! decides, one channel on one thread, so that results are equal to the bit whatever the number of threads.

#[cfg(not(kernels_alone))]
mod burn_op;

use rayon::prelude::*;

use super::simd::{InstructionSet, Kernel, Scalar, Simd, Vector};

#[cfg(not(kernels_alone))]
pub use burn_op::{Normed, norm_relu, scale_shift_relu};

/// Sizes of a batch of images.
#[derive(Clone, Copy, Debug)]
struct Shape {
    batch: usize,
    channels: usize,
    /// Pixels of one channel of one image.
    pixels: usize,
}

impl Shape {
    fn n_values(self) -> usize {
        self.batch * self.channels * self.pixels
    }

    /// The planes of each channel.
    fn by_channel(self, values: &[f32]) -> Vec<Vec<&[f32]>> {
        let mut planes = vec![Vec::with_capacity(self.batch); self.channels];
        for (i, plane) in values.chunks_exact(self.pixels).enumerate() {
            planes[i % self.channels].push(plane);
        }
        planes
    }

    /// As [`Self::by_channel`], mutable.
    fn by_channel_mut(self, values: &mut [f32]) -> Vec<Vec<&mut [f32]>> {
        let mut planes: Vec<Vec<&mut [f32]>> =
            (0..self.channels).map(|_| Vec::with_capacity(self.batch)).collect();
        for (i, plane) in values.chunks_exact_mut(self.pixels).enumerate() {
            planes[i % self.channels].push(plane);
        }
        planes
    }
}

/// The result of the forward pass.
struct Forward {
    /// As x.
    y: Vec<f32>,
    /// `[channel]`
    mean: Vec<f32>,
    /// `[channel]`, biased.
    variance: Vec<f32>,
}

/// Gradients of a batch.
struct Gradients {
    /// As x.
    dx: Vec<f32>,
    /// `[channel]`
    d_gamma: Vec<f32>,
    /// `[channel]`
    d_beta: Vec<f32>,
}

/// One channel's affine map.
#[derive(Clone, Copy)]
struct Affine {
    gamma: f32,
    beta: f32,
}

/// Statistics of one channel.
#[derive(Clone, Copy, Default)]
struct Statistics {
    mean: f32,
    variance: f32,
}

impl Statistics {
    fn inverse_deviation(self, epsilon: f64) -> f32 {
        (1.0 / (f64::from(self.variance) + epsilon).sqrt()) as f32
    }
}

fn forward(
    shape: Shape,
    x: &[f32],
    gamma: &[f32],
    beta: &[f32],
    epsilon: f64,
    set: InstructionSet,
) -> Forward {
    assert!(x.len() == shape.n_values() && gamma.len() == shape.channels && beta.len() == shape.channels);
    let mut y = vec![0f32; shape.n_values()];
    let tasks: Vec<_> = shape.by_channel(x).into_iter().zip(shape.by_channel_mut(&mut y)).collect();
    let statistics: Vec<Statistics> = tasks
        .into_par_iter()
        .enumerate()
        .map(|(c, (x, y))| {
            let affine = Affine { gamma: gamma[c], beta: beta[c] };
            let mut statistics = Statistics::default();
            set.run(ForwardChannel { x, y, affine, epsilon, statistics: &mut statistics });
            statistics
        })
        .collect();
    let (mean, variance) = statistics.iter().map(|of| (of.mean, of.variance)).unzip();
    Forward { y, mean, variance }
}

/// `x` and the statistics are those of the forward pass.
fn gradients(
    shape: Shape,
    x: &[f32],
    dy: &[f32],
    [gamma, beta]: [&[f32]; 2],
    [mean, variance]: [&[f32]; 2],
    epsilon: f64,
    set: InstructionSet,
) -> Gradients {
    assert!(x.len() == shape.n_values() && dy.len() == shape.n_values());
    assert!([gamma, beta, mean, variance].iter().all(|values| values.len() == shape.channels));
    let mut dx = vec![0f32; shape.n_values()];
    let tasks: Vec<_> = shape
        .by_channel(x)
        .into_iter()
        .zip(shape.by_channel(dy))
        .zip(shape.by_channel_mut(&mut dx))
        .collect();
    let sums: Vec<[f32; 2]> = tasks
        .into_par_iter()
        .enumerate()
        .map(|(c, ((x, dy), dx))| {
            let affine = Affine { gamma: gamma[c], beta: beta[c] };
            let statistics = Statistics { mean: mean[c], variance: variance[c] };
            let mut sums = [0.0; 2];
            set.run(BackwardChannel { x, dy, dx, affine, statistics, epsilon, sums: &mut sums });
            sums
        })
        .collect();
    let (d_gamma, d_beta) = sums.iter().map(|[g, gh]| (*gh, *g)).unzip();
    Gradients { dx, d_gamma, d_beta }
}

/// `max(0, scale x + shift)`, a scale and a shift for each channel.
fn scale_shift(shape: Shape, x: &[f32], scale: &[f32], shift: &[f32], set: InstructionSet) -> Vec<f32> {
    assert!(x.len() == shape.n_values() && scale.len() == shape.channels && shift.len() == shape.channels);
    let mut y = vec![0f32; shape.n_values()];
    y.par_chunks_exact_mut(shape.pixels).zip(x.par_chunks_exact(shape.pixels)).enumerate().for_each(
        |(i, (y, x))| {
            let c = i % shape.channels;
            set.run(ScaleShift { x, y, scale: scale[c], shift: shift[c] });
        },
    );
    y
}

/// Vectors that are summed side by side: a sum waits for the one before it.
const CHAINS: usize = 4;

/// Sums both results of `of(a, b)` in [`CHAINS`] vectors of partial sums, then these one after the other. Vectors by name: from
/// a loop over lanes the compiler makes scalar code.
#[inline(always)]
fn sums<S: Simd, const LANES: usize>(
    a: &[f32],
    b: &[f32],
    of: impl Fn(Vector<S, f32>, Vector<S, f32>) -> [Vector<S, f32>; 2],
) -> [f64; 2] {
    let mut sums = [[0f32.splat::<S>(); 2]; CHAINS];
    // SAFETY: `LANES` is the number of floats in a vector of `S`, and each slice holds as many.
    let load = |values: &[f32; LANES]| unsafe { f32::vload_unaligned::<S>(values.as_ptr()) };
    let ((a_whole, a_rest), (b_whole, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let ((a_fours, a_few), (b_fours, b_few)) = (a_whole.as_chunks::<CHAINS>(), b_whole.as_chunks::<CHAINS>());
    for (a, b) in a_fours.iter().zip(b_fours) {
        for (sums, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            let [first, second] = of(load(a), load(b));
            sums[0] += first;
            sums[1] += second;
        }
    }
    for (sums, (a, b)) in sums.iter_mut().zip(a_few.iter().zip(b_few)) {
        let [first, second] = of(load(a), load(b));
        sums[0] += first;
        sums[1] += second;
    }
    let pad = |rest: &[f32]| {
        let mut padded = [0.0; LANES];
        padded[..rest.len()].copy_from_slice(rest);
        padded
    };
    let rest = of(load(&pad(a_rest)), load(&pad(b_rest)));
    [0, 1].map(|i| {
        let lanes = |vector: Vector<S, f32>| {
            let mut lanes = [0f32; LANES];
            // SAFETY: as above.
            unsafe { f32::vstore_unaligned(lanes.as_mut_ptr(), vector) };
            lanes
        };
        let sum = sums.iter().skip(1).fold(sums[0][i], |sum, more| sum + more[i]);
        let rest = lanes(rest[i]).iter().take(a_rest.len()).sum::<f32>();
        f64::from(lanes(sum).iter().sum::<f32>() + rest)
    })
}

struct ForwardChannel<'a> {
    x: Vec<&'a [f32]>,
    y: Vec<&'a mut [f32]>,
    affine: Affine,
    epsilon: f64,
    statistics: &'a mut Statistics,
}

impl Kernel for ForwardChannel<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let n_values = (self.x.len() * self.x[0].len()) as f64;
        // Planes add up in f64: a plane's own sum is short.
        let (mut sum, mut squares) = (0.0, 0.0);
        for x in &self.x {
            sum += sums::<S, LANES>(x, x, |a, _| [a, a])[0];
        }
        let mean = (sum / n_values) as f32;
        let mean_of_all = mean.splat::<S>();
        for x in &self.x {
            let square = |a| (a - mean_of_all) * (a - mean_of_all);
            squares += sums::<S, LANES>(x, x, |a, _| [square(a); 2])[0];
        }
        let statistics = Statistics { mean, variance: (squares / n_values) as f32 };
        *self.statistics = statistics;
        let inverse = statistics.inverse_deviation(self.epsilon);
        let Affine { gamma, beta } = self.affine;
        for (y, x) in self.y.into_iter().zip(self.x) {
            for (y, &x) in y.iter_mut().zip(x) {
                *y = ((x - mean) * inverse * gamma + beta).max(0.0);
            }
        }
    }
}

struct BackwardChannel<'a> {
    x: Vec<&'a [f32]>,
    dy: Vec<&'a [f32]>,
    dx: Vec<&'a mut [f32]>,
    affine: Affine,
    statistics: Statistics,
    epsilon: f64,
    /// Sums of g and of g h: the gradients of beta and gamma.
    sums: &'a mut [f32; 2],
}

impl Kernel for BackwardChannel<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let n_values = (self.x.len() * self.x[0].len()) as f64;
        let Affine { gamma, beta } = self.affine;
        let mean = self.statistics.mean;
        let inverse = self.statistics.inverse_deviation(self.epsilon);
        let normed = |x: f32| (x - mean) * inverse;
        // The same expression as in the forward pass, so that both see the same sign.
        let passed = |x: f32, dy: f32| if normed(x) * gamma + beta > 0.0 { dy } else { 0.0 };
        let (mut g, mut gh) = (0.0, 0.0);
        let (means, inverses) = (mean.splat::<S>(), inverse.splat());
        let (gammas, betas) = (gamma.splat::<S>(), beta.splat());
        for (x, dy) in self.x.iter().zip(&self.dy) {
            let of_plane = sums::<S, LANES>(x, dy, |x, dy| {
                let normed = (x - means) * inverses;
                let passed = (normed * gammas + betas).gt(0f32.splat()).select(dy, 0f32.splat());
                [passed, passed * normed]
            });
            g += of_plane[0];
            gh += of_plane[1];
        }
        *self.sums = [g as f32, gh as f32];
        let (mean_g, mean_gh) = ((g / n_values) as f32, (gh / n_values) as f32);
        let scale = gamma * inverse;
        for ((dx, x), dy) in self.dx.into_iter().zip(self.x).zip(self.dy) {
            for ((dx, &x), &dy) in dx.iter_mut().zip(x).zip(dy) {
                *dx = scale * (passed(x, dy) - mean_g - normed(x) * mean_gh);
            }
        }
    }
}

struct ScaleShift<'a> {
    x: &'a [f32],
    y: &'a mut [f32],
    scale: f32,
    shift: f32,
}

impl Kernel for ScaleShift<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        for (y, &x) in self.y.iter_mut().zip(self.x) {
            *y = (x * self.scale + self.shift).max(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every instruction set agrees with the formulas in f64.
    #[test]
    fn every_instruction_set_equals_the_formula_in_double_precision() {
        let epsilon = 1e-3;
        for (batch, channels, pixels) in [(2, 3, 37), (1, 1, 1), (3, 2, 64), (2, 2, 150)] {
            let shape = Shape { batch, channels, pixels };
            let mut random = crate::random::stream(3, "norm-relu-test", pixels as u64);
            let mut draw = |n: usize| -> Vec<f32> {
                (0..n).map(|_| rand::RngExt::random_range(&mut random, -1.0..1.0)).collect()
            };
            let (x, dy) = (draw(shape.n_values()), draw(shape.n_values()));
            let (gamma, beta) = (draw(channels), draw(channels));
            for set in InstructionSet::available() {
                let found = forward(shape, &x, &gamma, &beta, epsilon, set);
                let back =
                    gradients(shape, &x, &dy, [&gamma, &beta], [&found.mean, &found.variance], epsilon, set);
                for c in 0..channels {
                    let of = |i: &usize| i / pixels % channels == c;
                    let indices: Vec<usize> = (0..x.len()).filter(of).collect();
                    let n = indices.len() as f64;
                    let sum = |f: &dyn Fn(usize) -> f64| indices.iter().map(|&i| f(i)).sum::<f64>();
                    let [xs, dys] = [&x, &dy].map(|v| v.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>());
                    let mean = sum(&|i| xs[i]) / n;
                    let variance = sum(&|i| (xs[i] - mean).powi(2)) / n;
                    let deviation = (variance + epsilon).sqrt();
                    let (gamma, beta) = (f64::from(gamma[c]), f64::from(beta[c]));
                    let h = |i: usize| (xs[i] - mean) / deviation;
                    let g = |i: usize| if h(i) * gamma + beta > 0.0 { dys[i] } else { 0.0 };
                    let (mean_g, mean_gh) = (sum(&g) / n, sum(&|i| g(i) * h(i)) / n);
                    let near = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 2e-5, "{set:?} {a} {b}");
                    near(found.mean[c], mean);
                    near(found.variance[c], variance);
                    near(back.d_gamma[c], mean_gh * n);
                    near(back.d_beta[c], mean_g * n);
                    for &i in &indices {
                        near(found.y[i], (h(i) * gamma + beta).max(0.0));
                        near(back.dx[i], gamma / deviation * (g(i) - mean_g - h(i) * mean_gh));
                    }
                }
                let scaled = scale_shift(shape, &x, &gamma, &beta, set);
                for (i, &y) in scaled.iter().enumerate() {
                    let c = i / pixels % channels;
                    assert!((y - (x[i] * gamma[c] + beta[c]).max(0.0)).abs() < 1e-6);
                }
            }
        }
    }
}
