//! Resampling of maps to another size.

use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor, TensorData};

/// Doubles height and width by repeating each cell.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - output: `[batch, channel, 2 y, 2 x]`
pub fn upsample_nearest(x: Tensor<4>) -> Tensor<4> {
    let nearest = InterpolateOptions::new(InterpolateMode::Nearest);
    interpolate(x, nearest.with_scale_factor([2.0, 2.0]))
}

/// Resamples a map with bilinear weights between the cells' centres, as PyTorch's `interpolate` with
/// `align_corners=False` and no antialiasing. As two matrix products: burn's own has no gradient on GPUs.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - output: `[batch, channel, n_y, n_x]`
pub fn resize_bilinear(x: Tensor<4>, [n_y, n_x]: [usize; 2]) -> Tensor<4> {
    let device = x.device();
    let [n_batch, n_channels, n_rows, n_columns] = x.dims();
    let of_columns = bilinear_weights(n_columns, n_x, &device).transpose();
    let of_rows = bilinear_weights(n_rows, n_y, &device);
    let wide = x.reshape([n_batch * n_channels * n_rows, n_columns]).matmul(of_columns);
    let resized = of_rows.unsqueeze::<3>().matmul(wide.reshape([n_batch * n_channels, n_rows, n_x]));
    resized.reshape([n_batch, n_channels, n_y, n_x])
}

/// The weight of each of `n_in` cells in a row for each of `n_out`: `[n_out, n_in]`, each row's sum 1.
fn bilinear_weights(n_in: usize, n_out: usize, device: &Device) -> Tensor<2> {
    let mut weights = vec![0f32; n_out * n_in];
    for (i, row) in weights.chunks_exact_mut(n_in).enumerate() {
        let at = ((i as f64 + 0.5) * n_in as f64 / n_out as f64 - 0.5).max(0.0);
        let below = (at as usize).min(n_in - 1);
        let above = (below + 1).min(n_in - 1);
        let share = (at - below as f64) as f32;
        row[below] += 1.0 - share;
        row[above] += share;
    }
    Tensor::from_data(TensorData::new(weights, [n_out, n_in]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upsampling_repeats_each_cell_in_a_two_by_two_block() {
        let device = Device::flex();
        let x = Tensor::<4>::from_data(TensorData::new(vec![1f32, 2.0, 3.0, 4.0], [1, 1, 2, 2]), &device);
        let values: Vec<f32> = upsample_nearest(x).into_data().try_to_vec().unwrap();
        assert_eq!(values, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0]);
    }

    #[test]
    fn bilinear_resampling_is_burns() {
        let device = Device::flex();
        device.seed(4);
        let x = Tensor::<4>::random([2, 3, 5, 7], burn::tensor::Distribution::Default, &device);
        for size in [[10, 14], [5, 7], [9, 11], [3, 4], [1, 1], [6, 40]] {
            let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
            let burns = interpolate(x.clone(), options.with_output_size(size));
            let own = resize_bilinear(x.clone(), size);
            assert!((own - burns).abs().max().into_scalar::<f32>() < 1e-6, "{size:?}");
        }
    }
}
