//! All rulebooks of an encoder for one batch: built once from the voxels' cells and shared by its layers.

use std::sync::Arc;

use rayon::prelude::*;

use super::sites::Sites;
use crate::kernels::Rulebook;
use crate::model::config::{SparseEncoderConfig, SparseKernel};

/// The rulebooks of a [`super::SparseEncoder`] and the sites it ends in.
#[derive(Debug, Clone)]
pub struct EncoderRulebooks {
    /// Rulebook of each stage's submanifold convolutions.
    pub(super) stages: Vec<Arc<Rulebook>>,
    /// Rulebook of the strided convolution that ends each stage but the last.
    pub(super) downs: Vec<Arc<Rulebook>>,
    /// Rulebook of the convolution along z at the end.
    pub(super) last: Arc<Rulebook>,
    /// Sites of the output.
    pub(super) sites: Sites,
}

impl EncoderRulebooks {
    /// # Panics
    /// If the config has not passed its check for the sites' shape.
    #[must_use]
    pub fn build(sites: Sites, config: &SparseEncoderConfig) -> Self {
        let strided: Vec<SparseKernel> = config.strided_kernels();
        // The sites of each level first, one after the other; then all rulebooks at once.
        let mut levels = vec![sites];
        for geometry in &strided {
            levels.push(geometry.output_sites(&levels[levels.len() - 1]));
        }
        let n_stages = config.channels.len();
        let stages = levels[..n_stages].par_iter().map(SparseKernel::submanifold_rulebook);
        let between = strided
            .par_iter()
            .enumerate()
            .map(|(level, geometry)| geometry.rulebook(&levels[level], &levels[level + 1]));
        let mut made = stages.chain(between).map(Arc::new).collect::<Vec<_>>().into_iter();
        let stages = made.by_ref().take(n_stages).collect();
        let downs = made.by_ref().take(n_stages - 1).collect();
        let last = made.next().expect("there is one strided convolution for each stage");
        let sites = levels.pop().expect("there is one level more than strided convolutions");
        Self { stages, downs, last, sites }
    }
}
