//! Queries: the highest local maxima of the heatmap.

use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;

use crate::model::config::{GridConfig, HeadConfig};

/// A cell of the heatmap chosen as a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// Heatmap channel.
    pub channel: usize,
    /// Feature cell `y * n_cells_x + x`.
    pub cell: usize,
    /// Heatmap cell within the feature cell, `y * heatmap_scale + x`.
    pub place: usize,
    /// Sigmoid of the heatmap there.
    pub score: f32,
    /// Centre of the heatmap cell in the ego frame: x, y.
    pub center_m: [f64; 2],
}

impl Query {
    /// The heatmap cell `y * scale * n_cells_x + x`, of a map of `n_cells_x` feature cells along x.
    #[must_use]
    pub fn heatmap_cell(&self, n_cells_x: usize, scale: usize) -> usize {
        let y = self.cell / n_cells_x * scale + self.place / scale;
        let x = self.cell % n_cells_x * scale + self.place % scale;
        y * scale * n_cells_x + x
    }
}

/// Picks the best `n_queries` peaks of each sample, best first; where there are too few, other cells with a score
/// of zero follow. On ties the lower index comes first. No gradient flows through the choice.
///
/// # Shapes
/// - heatmap: `[batch, heatmap_channel, scale * cell_y, scale * cell_x]`, before the sigmoid
/// - output: `[batch][query]`
#[must_use]
pub fn pick_queries(heatmap: Tensor<4>, config: &HeadConfig, grid: &GridConfig) -> Vec<Vec<Query>> {
    let [_, n_channels, n_y, n_x] = heatmap.dims();
    let scores: Vec<f32> =
        sigmoid(heatmap.detach()).into_data().try_to_vec().expect("the heatmap is made of f32");
    let (n_cells, scale) = (n_y * n_x, config.heatmap_scale);
    scores
        .chunks(n_channels * n_cells)
        .map(|map| {
            let (mut peaks, others): (Vec<usize>, Vec<usize>) = (0..map.len()).partition(|i| {
                let (channel, cell) = (i / n_cells, i % n_cells);
                let of_channel = &map[channel * n_cells..(channel + 1) * n_cells];
                let reach = config.peak_kernels[channel] / 2;
                is_peak(of_channel, [n_y, n_x], cell, reach, config.border_peaks)
            });
            peaks.sort_unstable_by(|&a, &b| map[b].total_cmp(&map[a]).then(a.cmp(&b)));
            let ranked = peaks.into_iter().map(|i| (map[i], i)).chain(others.into_iter().map(|i| (0.0, i)));
            let query = |(score, i): (f32, usize)| {
                let (y, x) = (i % n_cells / n_x, i % n_x);
                Query {
                    channel: i / n_cells,
                    cell: y / scale * (n_x / scale) + x / scale,
                    place: y % scale * scale + x % scale,
                    score,
                    center_m: grid.cell_center_m(i % n_cells, n_x, scale),
                }
            };
            ranked.take(config.n_queries).map(query).collect()
        })
        .collect()
}

/// Whether no cell within `reach` is higher. Without `at_border`, a cell whose square leaves the map is not a
/// peak (the published head takes maxima without padding).
fn is_peak(map: &[f32], [n_y, n_x]: [usize; 2], cell: usize, reach: usize, at_border: bool) -> bool {
    let (y, x) = (cell / n_x, cell % n_x);
    let is_inner = y >= reach && y + reach < n_y && x >= reach && x + reach < n_x;
    (at_border || is_inner)
        && (y.saturating_sub(reach)..(y + reach + 1).min(n_y)).all(|other_y| {
            (x.saturating_sub(reach)..(x + reach + 1).min(n_x))
                .all(|other_x| map[other_y * n_x + other_x] <= map[cell])
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    fn picked(map: &[f32], n_x: usize, config: HeadConfig) -> Vec<(usize, usize, f32)> {
        let n_channels = config.heatmap.n_channels();
        let n_y = map.len() / n_channels / n_x;
        let logits = map.iter().map(|&p| (p / (1.0 - p)).ln()).collect::<Vec<_>>();
        let shape = [1, n_channels, n_y, n_x];
        let heatmap = Tensor::from_data(TensorData::new(logits, shape), &Device::flex());
        pick_queries(heatmap, &config, &GridConfig::default())[0]
            .iter()
            .map(|query| (query.channel, query.cell, query.score))
            .collect()
    }

    /// Peaks at the border (0.9 at cell 3), inside (0.8 at cell 6) and beside the latter (0.7 at 10).
    const MAP: [f32; 16] = [0.1, 0.1, 0.1, 0.9, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.7, 0.1, 0.1, 0.1, 0.1, 0.1];

    #[test]
    fn a_neighbour_of_a_peak_is_none_and_border_cells_count_where_told() {
        let config =
            HeadConfig { n_queries: 2, border_peaks: false, heatmap_scale: 1, ..HeadConfig::default() };
        let near = |found: &[(usize, usize, f32)], cell: usize, score: f32| {
            found.iter().any(|query| query.1 == cell && (query.2 - score).abs() < 1e-5)
        };
        let mut map = MAP;
        // Away from the border's peak, so that it is a peak of its own.
        (map[6], map[9]) = (0.1, 0.8);
        let found = picked(&map, 4, config);
        assert!(near(&found, 9, 0.8) && found[1].2 == 0.0, "{found:?}");
        let found = picked(&map, 4, HeadConfig { border_peaks: true, ..config });
        assert!(near(&found, 3, 0.9) && near(&found, 9, 0.8), "{found:?}");
    }

    #[test]
    fn a_finer_heatmap_parts_peaks_of_neighbouring_feature_cells() {
        let config = HeadConfig { n_queries: 2, heatmap_scale: 2, ..HeadConfig::default() };
        let mut map = [0.1f32; 16];
        // Row 1, columns 0 and 2 of a map of four: feature cells 0 and 1 of the first row.
        (map[4], map[6]) = (0.9, 0.8);
        let logits = map.iter().map(|&p| (p / (1.0 - p)).ln()).collect::<Vec<_>>();
        let heatmap = Tensor::from_data(TensorData::new(logits, [1, 1, 4, 4]), &Device::flex());
        let grid = GridConfig::default();
        let found = &pick_queries(heatmap, &config, &grid)[0];
        let places: Vec<_> = found.iter().map(|query| (query.cell, query.place)).collect();
        assert_eq!(places, [(0, 2), (1, 2)]);
        let expected = [grid.x_min_m + 0.25 * grid.cell_size_m, grid.y_min_m + 0.75 * grid.cell_size_m];
        assert_eq!(found[0].center_m, expected);
    }

    #[test]
    fn a_kernel_of_one_makes_every_cell_a_peak_of_its_class() {
        let config = HeadConfig {
            n_queries: 3,
            border_peaks: false,
            heatmap: crate::model::Heatmap::PerClass,
            heatmap_scale: 1,
            peak_kernels: [3, 1],
            ..HeadConfig::default()
        };
        let map: Vec<f32> = [0.05; 16].into_iter().chain(MAP).collect();
        let cells: Vec<_> = picked(&map, 4, config).iter().map(|query| (query.0, query.1)).collect();
        assert_eq!(cells, [(1, 3), (1, 6), (1, 10)]);
    }
}
