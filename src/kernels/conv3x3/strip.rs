//! What the products of `tiles` and `blocks` work on: a convolution, its phases, and strips of tile positions.

use super::band::{Layout, Planes};
use super::pass::TILE_VECTORS;

/// Outputs of one parity (`upscale` 2), or all of them.
pub(super) struct Phase {
    /// Offset of each tap in the packed band: 1, 2, 4 or 9 of them.
    pub offsets: Vec<usize>,
    pub weights: Weights,
    /// Row offset of the output pixel.
    pub y: usize,
    /// Column offset of the output pixel.
    pub x: usize,
}

/// Weights as the products want them, from [`pack_weights`](super::tiles::pack_weights).
pub(super) enum Weights {
    /// `[block of channels_out][channel_in][tap][channel_out in block]`, zero beyond the last channel.
    Rows(Vec<f32>),
    /// For the matrix unit: [`super::blocks`].
    Blocks(Vec<u32>),
}

/// The input, output and sizes of a convolution.
pub(super) struct Convolution<'a> {
    pub source: Planes<'a>,
    pub batch: usize,
    pub channels_out: usize,
    /// Tile positions.
    pub rows: usize,
    pub columns: usize,
    /// 1 or 2.
    pub upscale: usize,
    pub out_height_px: usize,
    pub out_width_px: usize,
    /// A shift of each output channel, `[channel_out]`, that is added to the sums.
    pub shift: Option<&'a [f32]>,
    /// Whether negative sums become zero, after the shift.
    pub has_relu: bool,
}

/// The output, shared by tasks that write disjoint parts of it.
#[derive(Clone, Copy)]
pub(super) struct SharedOutput {
    pub start: *mut f32,
    pub len: usize,
}

// SAFETY: the pointer is only written through, by `tile` and `copy_piece`; each task owns one band of one image, that is
// a set of output rows no other task writes, and the vector outlives the tasks.
unsafe impl Send for SharedOutput {}
// SAFETY: as above.
unsafe impl Sync for SharedOutput {}

/// A run of output pixels of one row, as they lie in a tile.
#[derive(Clone, Copy, Default)]
pub(super) struct Piece {
    pub in_tile: usize,
    pub in_plane: usize,
    pub len: usize,
}

/// One phase of one strip of a band.
pub(super) struct TileStrip<'a> {
    pub convolution: &'a Convolution<'a>,
    pub layout: &'a Layout,
    /// Whether the band is of pairs of bf16.
    pub is_paired: bool,
    pub phase: &'a Phase,
    pub shift: Option<&'a [f32]>,
    pub output: SharedOutput,
    pub image: usize,
    pub first_row: usize,
    pub n_rows: usize,
}

impl TileStrip<'_> {
    /// The output pixels of the tile at `start`, up to `stop`; the padding between rows has none.
    #[inline(always)]
    pub fn pieces(&self, start: usize, stop: usize) -> ([Piece; TILE_VECTORS * 16], usize) {
        let c = self.convolution;
        let mut pieces = [Piece::default(); TILE_VECTORS * 16];
        let mut n_pieces = 0;
        let mut q = start;
        while q < stop {
            let (row, column) = (q / self.layout.width, q % self.layout.width);
            let y = (self.first_row + row) * c.upscale + self.phase.y;
            let x = column * c.upscale + self.phase.x;
            let n_columns = c.columns.saturating_sub(column).min(stop - q);
            let len = n_columns.min((c.out_width_px + c.upscale - 1).saturating_sub(x) / c.upscale);
            if len > 0 && y < c.out_height_px {
                pieces[n_pieces] = Piece { in_tile: q - start, in_plane: y * c.out_width_px + x, len };
                n_pieces += 1;
            }
            q += n_columns.max(1);
        }
        (pieces, n_pieces)
    }
}
