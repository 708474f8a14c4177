//! One transformer decoder layer, post-norm: self attention among queries, cross attention to the
//! bird's-eye map, feed-forward net (TransFusion, Bai et al. 2022).

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

use super::layers::Mlp;

/// Scaled dot-product attention with several heads (Vaswani et al. 2017).
#[derive(Module, Debug)]
pub struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    #[module(skip)]
    n_heads: usize,
}

impl Attention {
    pub fn init(n_channels: usize, n_heads: usize, device: &Device) -> Self {
        let linear = || LinearConfig::new(n_channels, n_channels).init(device);
        Self { query: linear(), key: linear(), value: linear(), out: linear(), n_heads }
    }

    /// # Shapes
    /// - query: `[batch, query, channel]`
    /// - memory: `[batch, key, channel]`, keys and values
    /// - output: `[batch, query, channel]`
    pub fn forward(&self, query: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        let [n_batch, n_query, n_channels] = query.dims();
        let n_per_head = n_channels / self.n_heads;
        let heads = |x: Tensor<3>| {
            let [_, n, _] = x.dims();
            x.reshape([n_batch, n, self.n_heads, n_per_head]).swap_dims(1, 2)
        };
        let q = heads(self.query.forward(query)).mul_scalar(1.0 / (n_per_head as f64).sqrt());
        let k = heads(self.key.forward(memory.clone()));
        let v = heads(self.value.forward(memory));
        let weights = softmax(q.matmul(k.swap_dims(2, 3)), 3);
        self.out.forward(weights.matmul(v).swap_dims(1, 2).reshape([n_batch, n_query, n_channels]))
    }
}

/// The decoder layer.
#[derive(Module, Debug)]
pub struct DecoderLayer {
    self_attention: Attention,
    cross_attention: Attention,
    feed_forward: Mlp,
    norms: Vec<LayerNorm>,
}

impl DecoderLayer {
    pub fn init(n_channels: usize, n_heads: usize, device: &Device) -> Self {
        Self {
            self_attention: Attention::init(n_channels, n_heads, device),
            cross_attention: Attention::init(n_channels, n_heads, device),
            feed_forward: Mlp::init(n_channels, 2 * n_channels, n_channels, device),
            norms: (0..3).map(|_| LayerNormConfig::new(n_channels).init(device)).collect(),
        }
    }

    /// # Shapes
    /// - query, query_position: `[batch, query, channel]`
    /// - memory: `[batch, key, channel]` with its position encoding added
    /// - output: `[batch, query, channel]`
    pub fn forward(&self, query: Tensor<3>, query_position: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        let placed = query.clone() + query_position.clone();
        let x = self.norms[0].forward(query + self.self_attention.forward(placed.clone(), placed));
        let x = self.norms[1].forward(x.clone() + self.cross_attention.forward(x + query_position, memory));
        self.norms[2].forward(x.clone() + self.feed_forward.forward(x))
    }
}
