//! Attention within windows of tokens, with a learned bias for each relative position.
//!
//! Every second block cuts the map into windows half a window further down and right. The map is rolled,
//! so that a window at the far border holds tokens from both sides; a mask keeps these apart. A map whose sides
//! are not multiples of the window is padded with zeros on the right and at the bottom, as in torchvision and
//! mmdet; a side that fits in one window is not shifted, as in torchvision.

use crate::kernels::softmax_last;
use burn::module::{Module, Param};
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::ops::PadMode;
use burn::tensor::{Device, Int, Tensor, TensorData};

/// Standard deviation of fresh weights (Liu et al. 2021).
const WEIGHT_STD: f64 = 0.02;
/// The mask's value between tokens that are not neighbours.
const APART: f32 = -100.0;

/// A linear layer with Swin's fresh weights: normal, no bias at first.
pub(super) fn linear(n_in: usize, n_out: usize, has_bias: bool, device: &Device) -> Linear {
    let normal = Initializer::Normal { mean: 0.0, std: WEIGHT_STD };
    let mut layer = LinearConfig::new(n_in, n_out).with_bias(has_bias).with_initializer(normal).init(device);
    layer.bias = layer.bias.map(|_| Initializer::Zeros.init([n_out], device));
    layer
}

/// Adds rows and columns of zeros at the bottom and on the right.
///
/// # Shapes
/// - x: `[batch, y, x, channel]`
pub(super) fn fill_up(x: Tensor<4>, [n_y, n_x]: [usize; 2]) -> Tensor<4> {
    let [_, from_y, from_x, _] = x.dims();
    if [from_y, from_x] == [n_y, n_x] {
        return x;
    }
    x.pad([(0, n_y - from_y), (0, n_x - from_x), (0, 0)], PadMode::Constant(0.0))
}

/// How a map is cut into windows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Windows {
    /// Rows and columns of the map.
    map: [usize; 2],
    /// Rows and columns of windows.
    n: [usize; 2],
    /// Side of a window.
    size: usize,
    /// Rows and columns by which the map is rolled up and left.
    shift: [usize; 2],
}

impl Windows {
    pub fn new(map: [usize; 2], size: usize, is_shifted: bool) -> Self {
        let n = map.map(|tokens| tokens.div_ceil(size));
        let shift = n.map(|windows| if is_shifted && windows > 1 { size / 2 } else { 0 });
        Self { map, n, size, shift }
    }

    fn padded(&self) -> [usize; 2] {
        self.n.map(|windows| windows * self.size)
    }

    fn count(&self) -> usize {
        self.n[0] * self.n[1]
    }

    /// Tokens of a window.
    fn area(&self) -> usize {
        self.size * self.size
    }

    /// # Shapes
    /// - x: `[batch, y, x, channel]`
    /// - output: `[batch * window, token, channel]`
    fn cut(&self, x: Tensor<4>) -> Tensor<3> {
        let [n_batch, _, _, n_channels] = x.dims();
        let [padded_y, padded_x] = self.padded();
        let x = fill_up(x, [padded_y, padded_x]);
        let [up, left] = self.shift.map(|by| -(by as i64));
        x.roll(&[up, left], &[1, 2])
            .reshape([n_batch, self.n[0], self.size, self.n[1], self.size, n_channels])
            .permute([0, 1, 3, 2, 4, 5])
            .reshape([n_batch * self.count(), self.area(), n_channels])
    }

    /// The inverse of [`Self::cut`].
    fn join(&self, windows: Tensor<3>) -> Tensor<4> {
        let [n_windows, _, n_channels] = windows.dims();
        let n_batch = n_windows / self.count();
        let [padded_y, padded_x] = self.padded();
        let [down, right] = self.shift.map(|by| by as i64);
        windows
            .reshape([n_batch, self.n[0], self.n[1], self.size, self.size, n_channels])
            .permute([0, 1, 3, 2, 4, 5])
            .reshape([n_batch, padded_y, padded_x, n_channels])
            .roll(&[down, right], &[1, 2])
            .slice([0..n_batch, 0..self.map[0], 0..self.map[1], 0..n_channels])
    }

    /// The mask that keeps tokens apart: zero, or [`APART`] between tokens from opposite borders.
    ///
    /// # Shapes
    /// - output: `[window, 1, token, token]`; `None` if nothing is shifted
    pub fn mask(&self, device: &Device) -> Option<Tensor<4>> {
        if self.shift == [0, 0] {
            return None;
        }
        let padded = self.padded();
        // Before the last window, in it, and what came round from the other border.
        let region = |axis: usize, at: usize| match self.shift[axis] {
            0 => 0,
            shift => usize::from(at >= padded[axis] - self.size) + usize::from(at >= padded[axis] - shift),
        };
        let mut values = Vec::with_capacity(self.count() * self.area() * self.area());
        for window in 0..self.count() {
            let origin = [window / self.n[1] * self.size, window % self.n[1] * self.size];
            let of_token = |token: usize| {
                3 * region(0, origin[0] + token / self.size) + region(1, origin[1] + token % self.size)
            };
            let regions: Vec<usize> = (0..self.area()).map(of_token).collect();
            for &a in &regions {
                values.extend(regions.iter().map(|&b| if a == b { 0.0 } else { APART }));
            }
        }
        let dims = [self.count(), 1, self.area(), self.area()];
        Some(Tensor::from_data(TensorData::new(values, dims), device))
    }
}

/// Row of the bias table for each pair of tokens of a window, `[token * token]`: the offset in rows, then in
/// columns, both counted from the most negative one.
fn bias_rows(size: usize) -> Vec<i64> {
    let span = 2 * size - 1;
    let row = |a: usize, b: usize| {
        let offset_y = a / size + size - 1 - b / size;
        let offset_x = a % size + size - 1 - b % size;
        (offset_y * span + offset_x) as i64
    };
    let n = size * size;
    (0..n).flat_map(|a| (0..n).map(move |b| row(a, b))).collect()
}

/// Attention with several heads within each window.
#[derive(Module, Debug)]
pub struct WindowAttention {
    qkv: Linear,
    proj: Linear,
    /// `[relative position, head]`
    bias_table: Param<Tensor<2>>,
    #[module(skip)]
    n_heads: usize,
    #[module(skip)]
    window_size: usize,
}

impl WindowAttention {
    pub fn init(
        n_channels: usize,
        n_heads: usize,
        window_size: usize,
        qkv_bias: bool,
        device: &Device,
    ) -> Self {
        let span = 2 * window_size - 1;
        Self {
            qkv: linear(n_channels, 3 * n_channels, qkv_bias, device),
            proj: linear(n_channels, n_channels, true, device),
            bias_table: Initializer::Normal { mean: 0.0, std: WEIGHT_STD }
                .init([span * span, n_heads], device),
            n_heads,
            window_size,
        }
    }

    /// # Shapes
    /// - x and output: `[batch, y, x, channel]`
    /// - mask: `windows.mask()`
    pub(super) fn forward(&self, x: Tensor<4>, windows: &Windows, mask: Option<&Tensor<4>>) -> Tensor<4> {
        let x = windows.cut(x);
        let [n_windows, n_tokens, n_channels] = x.dims();
        let n_per_head = n_channels / self.n_heads;
        let qkv = self
            .qkv
            .forward(x)
            .reshape([n_windows, n_tokens, 3, self.n_heads, n_per_head])
            .permute([2, 0, 3, 1, 4]);
        let part =
            |i: usize| qkv.clone().narrow(0, i, 1).reshape([n_windows, self.n_heads, n_tokens, n_per_head]);
        let query = part(0).mul_scalar(1.0 / (n_per_head as f64).sqrt());
        let scores = query.matmul(part(1).swap_dims(2, 3));
        let scores = self.add_bias(scores, mask);
        let seen = softmax_last(scores).matmul(part(2));
        let joined = seen.swap_dims(1, 2).reshape([n_windows, n_tokens, n_channels]);
        windows.join(self.proj.forward(joined))
    }

    /// Adds the bias of relative positions and the mask to scores of `[batch * window, head, token, token]`.
    fn add_bias(&self, scores: Tensor<4>, mask: Option<&Tensor<4>>) -> Tensor<4> {
        let [n_windows, n_heads, n_tokens, _] = scores.dims();
        let rows = bias_rows(self.window_size);
        let n_rows = rows.len();
        let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [n_rows]), &scores.device());
        let bias =
            self.bias_table.val().select(0, rows).swap_dims(0, 1).reshape([1, n_heads, n_tokens, n_tokens]);
        let Some(mask) = mask else {
            return scores + bias;
        };
        let [n_per_sample, ..] = mask.dims();
        (scores.reshape([n_windows / n_per_sample, n_per_sample * n_heads, n_tokens, n_tokens])
            + (bias + mask.clone()).reshape([1, n_per_sample * n_heads, n_tokens, n_tokens]))
        .reshape([n_windows, n_heads, n_tokens, n_tokens])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(dims: [usize; 4], device: &Device) -> Tensor<4> {
        let n = dims.iter().product::<usize>();
        Tensor::from_data(TensorData::new((0..n).map(|i| i as f32 + 1.0).collect(), dims), device)
    }

    #[test]
    fn joining_undoes_cutting() {
        let device = Device::flex();
        for (map, is_shifted) in [([6, 9], true), ([5, 7], true), ([5, 7], false), ([2, 3], true)] {
            let x = numbered([2, map[0], map[1], 2], &device);
            let windows = Windows::new(map, 3, is_shifted);
            assert_eq!(windows.join(windows.cut(x.clone())).into_data(), x.into_data(), "{map:?}");
        }
    }

    #[test]
    fn the_second_window_of_a_shifted_map_starts_half_a_window_later() {
        let device = Device::flex();
        let windows = Windows::new([4, 4], 2, true);
        let cut: Vec<f32> = windows.cut(numbered([1, 4, 4, 1], &device)).into_data().try_to_vec().unwrap();
        // Rows of the map: 1 2 3 4 / 5 6 7 8 / 9 10 11 12 / 13 14 15 16.
        assert_eq!(cut, [6., 7., 10., 11., 8., 5., 12., 9., 14., 15., 2., 3., 16., 13., 4., 1.]);
    }

    #[test]
    fn the_mask_parts_only_tokens_from_opposite_borders() {
        let device = Device::flex();
        let mask: Vec<f32> =
            Windows::new([4, 4], 2, true).mask(&device).unwrap().into_data().try_to_vec().unwrap();
        assert!(mask[..16].iter().all(|&value| value == 0.0), "the first window is whole");
        let (o, x) = (0.0, APART);
        assert_eq!(mask[16..32], [o, x, o, x, x, o, x, o, o, x, o, x, x, o, x, o], "left and right");
        assert_eq!(mask[48..52], [o, x, x, x], "all four corners meet in the last window");
        assert!(Windows::new([4, 4], 4, true).mask(&device).is_none(), "one window is not shifted");
    }

    #[test]
    fn bias_rows_count_offsets_from_the_most_negative() {
        let rows = bias_rows(2);
        assert_eq!(rows[0], 4, "a token and itself: the middle of the 3 x 3 table");
        assert_eq!(rows[3], 0, "the first token seen from the last's place: one up, one left");
        assert_eq!(rows[12], 8);
        assert_eq!(rows[1], 3, "one to the left");
    }
}
