//! Learned position encodings of queries and cells, which the decoder adds to their features.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::queries::Query;
use crate::model::config::{GridConfig, HeadConfig, PositionEncoding};
use crate::model::layers::{Mlp, NormedMlp, xavier};

/// Length unit of the shared net's input, metres.
const SHARED_UNIT_M: f64 = 50.0;

/// One net for both, or one each.
#[derive(Module, Debug)]
pub enum Positions {
    Shared(Mlp),
    Separate(SeparatePositions),
}

/// As published: two layers with batch norm between, of x and y in cells.
#[derive(Module, Debug)]
pub struct SeparatePositions {
    pub query: NormedMlp,
    cell: NormedMlp,
}

impl Positions {
    pub fn init(config: &HeadConfig, device: &Device) -> Self {
        let n = config.channels;
        match config.positions {
            PositionEncoding::Shared => Self::Shared(Mlp::init(2, n, n, device)),
            PositionEncoding::Separate => {
                let net = || {
                    let mut net = NormedMlp::init(2, n, n, true, device);
                    xavier(&mut net.hidden, 1, device);
                    xavier(&mut net.out, 1, device);
                    net
                };
                Self::Separate(SeparatePositions { query: net(), cell: net() })
            }
        }
    }

    /// # Shapes
    /// - queries: `[batch][query]`
    /// - output: `[batch, query, channel]`
    pub fn of_queries(&self, queries: &[Vec<Query>], grid: &GridConfig, device: &Device) -> Tensor<3> {
        let centers = queries.iter().flatten().map(|query| query.center_m);
        let at = self.input(centers, [queries.len(), queries[0].len(), 2], grid, device);
        match self {
            Self::Shared(net) => net.forward(at),
            Self::Separate(nets) => nets.query.forward(at),
        }
    }

    /// # Shapes
    /// - output: `[1, channel, cell_y * cell_x]`
    pub fn of_cells(&self, [n_y, n_x]: [usize; 2], grid: &GridConfig, device: &Device) -> Tensor<3> {
        let centers = (0..n_y * n_x).map(|cell| grid.cell_center_m(cell, n_x, 1));
        let at = self.input(centers, [1, n_y * n_x, 2], grid, device);
        match self {
            Self::Shared(net) => net.forward_over_channels(at.swap_dims(1, 2)),
            Self::Separate(nets) => nets.cell.forward(at).swap_dims(1, 2),
        }
    }

    fn input(
        &self,
        centers_m: impl Iterator<Item = [f64; 2]>,
        shape: [usize; 3],
        grid: &GridConfig,
        device: &Device,
    ) -> Tensor<3> {
        let ([x_origin_m, y_origin_m], unit_m) = match self {
            Self::Shared(_) => ([0.0, 0.0], SHARED_UNIT_M),
            Self::Separate(_) => ([grid.x_min_m, grid.y_min_m], grid.cell_size_m),
        };
        let values: Vec<f32> = centers_m
            .flat_map(|[x, y]| [(x - x_origin_m) / unit_m, (y - y_origin_m) / unit_m])
            .map(|value| value as f32)
            .collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }
}
