//! A closer look at each query's place: the pillars around it, at twice the resolution of the map that the decoder sees.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::queries::Query;

/// From a square of pillars to what is added to the query.
#[derive(Module, Debug)]
pub struct CloserLook {
    linear: Linear,
    /// Pillars along a side: odd.
    #[module(skip)]
    n_side: usize,
}

impl CloserLook {
    /// # Arguments
    /// - `n_pillar_channels`: of a pillar
    /// - `n_side`: pillars along a side of the square: odd
    pub fn init(n_pillar_channels: usize, n_side: usize, n_channels: usize, device: &Device) -> Self {
        let n_in = n_side * n_side * n_pillar_channels;
        Self { linear: LinearConfig::new(n_in, n_channels).init(device), n_side }
    }

    /// # Shapes
    /// - pillars: `[batch, pillar_channel, 2 cell_y, 2 cell_x]`
    /// - queries: `[batch][query]`, of a heatmap of `scale` cells along a feature cell
    /// - output: `[batch, query, channel]`
    pub fn forward(&self, pillars: Tensor<4>, queries: &[Vec<Query>], scale: usize) -> Tensor<3> {
        let [n_batch, n_channels, n_y, n_x] = pillars.dims();
        let device = pillars.device();
        let n_queries = queries.first().map_or(0, Vec::len);
        let mut places = Vec::with_capacity(n_batch * n_queries * self.n_side * self.n_side);
        for (sample, queries) in queries.iter().enumerate() {
            for query in queries {
                let cell = query.heatmap_cell(n_x / 2, scale);
                let width = scale * n_x / 2;
                // The pillar at the cell's middle, or just behind it.
                let [x, y] = [cell % width, cell / width].map(|at| at * 2 / scale + (2 / scale) / 2);
                for dy in 0..self.n_side {
                    for dx in 0..self.n_side {
                        let at =
                            (y + dy).checked_sub(self.n_side / 2).zip((x + dx).checked_sub(self.n_side / 2));
                        let inside = at.filter(|&(y, x)| y < n_y && x < n_x);
                        // Beyond the map there is nothing: the row after the last.
                        let row = inside.map_or(n_batch * n_y * n_x, |(y, x)| (sample * n_y + y) * n_x + x);
                        places.push(row as i64);
                    }
                }
            }
        }
        let n_places = places.len();
        let places = Tensor::<1, Int>::from_data(TensorData::new(places, [n_places]), &device);
        let rows = pillars.permute([0, 2, 3, 1]).reshape([n_batch * n_y * n_x, n_channels]);
        let rows = Tensor::cat(vec![rows, Tensor::zeros([1, n_channels], &device)], 0);
        let squares =
            rows.select(0, places).reshape([n_batch, n_queries, self.n_side * self.n_side * n_channels]);
        self.linear.forward(squares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two samples of 4 by 6 pillars, 2 by 3 feature cells, each pillar's one feature its number.
    #[test]
    fn a_query_sees_the_pillars_around_it_in_its_own_sample_and_zeros_beyond_the_map() {
        let device = Device::flex();
        let numbers: Vec<f32> = (0..48).map(|i| 1.0 + i as f32).collect();
        let pillars = Tensor::<4>::from_data(TensorData::new(numbers, [2, 1, 4, 6]), &device);
        let mut look = CloserLook::init(1, 3, 9, &device);
        let same: Vec<f32> = (0..81).map(|i| if i % 10 == 0 { 1.0 } else { 0.0 }).collect();
        look.linear.weight =
            look.linear.weight.map(|w| Tensor::from_data(TensorData::new(same.clone(), [9, 9]), &w.device()));
        look.linear.bias = look.linear.bias.map(|bias| bias.map(|bias| bias.zeros_like()));
        let query = |cell, place| Query { channel: 0, cell, place, score: 0.5, center_m: [0.0; 2] };
        // Feature cell (1, 2), its lower left heatmap cell: pillar (2, 4); and the first pillar of the second sample.
        let seen = look.forward(pillars, &[vec![query(5, 0)], vec![query(0, 0)]], 2);
        let seen: Vec<f32> = seen.into_data().try_to_vec().unwrap();
        assert_eq!(seen[..9], [10.0, 11.0, 12.0, 16.0, 17.0, 18.0, 22.0, 23.0, 24.0]);
        assert_eq!(seen[9..], [0.0, 0.0, 0.0, 0.0, 25.0, 26.0, 0.0, 31.0, 32.0]);
    }
}
