//! One transformer decoder layer, post-norm: self attention among queries, cross attention to the
//! bird's-eye map, feed-forward net (TransFusion, Bai et al. 2022).
//!
//! Keys, queries and values all carry their position, as in TransFusion. Dropout acts on attention
//! weights, on what each part adds, and inside the feed-forward net; only in training.

use burn::module::Module;
use burn::nn::{Dropout, DropoutConfig, Initializer, LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use crate::kernels::{attend, softmax_last};
use crate::model::config::HeadConfig;
use crate::model::layers::{Mlp, linear_over_channels, xavier};

/// Scaled dot-product attention with several heads (Vaswani et al. 2017).
#[derive(Module, Debug)]
pub struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    dropout: Dropout,
    #[module(skip)]
    n_heads: usize,
}

impl Attention {
    fn init(config: &HeadConfig, device: &Device) -> Self {
        let n_channels = config.channels;
        // Glorot weights over query, key and value as one matrix, and no bias at first, as published.
        let linear = |n_parts: usize| {
            let mut linear = LinearConfig::new(n_channels, n_channels).init(device);
            xavier(&mut linear, n_parts, device);
            linear.bias = Some(Initializer::Zeros.init([n_channels], device));
            linear
        };
        Self {
            query: linear(3),
            key: linear(3),
            value: linear(3),
            out: linear(1),
            dropout: DropoutConfig::new(config.dropout).init(),
            n_heads: config.n_heads,
        }
    }

    /// # Shapes
    /// - query: `[batch, query, channel]`
    /// - memory: `[batch, channel, key]`, a map of keys and values
    /// - output: `[batch, query, channel]`
    fn forward(&self, query: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        let [n_batch, n_query, n_channels] = query.dims();
        let n_per_head = n_channels / self.n_heads;
        let [_, _, n_keys] = memory.dims();
        let q = self.query.forward(query).mul_scalar(1.0 / (n_per_head as f64).sqrt());
        let q = q.reshape([n_batch, n_query, self.n_heads, n_per_head]).swap_dims(1, 2);
        let [k, v] = [&self.key, &self.value].map(|linear| {
            let projected = linear_over_channels(linear, memory.clone());
            projected.reshape([n_batch, self.n_heads, n_per_head, n_keys])
        });
        let attended = if self.dropout.prob > 0.0 {
            self.dropout.forward(softmax_last(q.matmul(k))).matmul(v.swap_dims(2, 3))
        } else {
            attend(q, k, v)
        };
        self.out.forward(attended.swap_dims(1, 2).reshape([n_batch, n_query, n_channels]))
    }
}

/// The decoder layer.
#[derive(Module, Debug)]
pub struct DecoderLayer {
    self_attention: Attention,
    cross_attention: Attention,
    feed_forward: Mlp,
    norms: Vec<LayerNorm>,
    dropout: Dropout,
}

impl DecoderLayer {
    pub fn init(config: &HeadConfig, device: &Device) -> Self {
        let mut feed_forward = Mlp::init(config.channels, config.ffn_channels, config.channels, device);
        xavier(&mut feed_forward.hidden, 1, device);
        xavier(&mut feed_forward.out, 1, device);
        Self {
            self_attention: Attention::init(config, device),
            cross_attention: Attention::init(config, device),
            feed_forward,
            norms: (0..3).map(|_| LayerNormConfig::new(config.channels).init(device)).collect(),
            dropout: DropoutConfig::new(config.dropout).init(),
        }
    }

    /// # Shapes
    /// - query, query_position: `[batch, query, channel]`
    /// - memory: `[batch, channel, key]` with its position encoding added
    /// - output: `[batch, query, channel]`
    pub fn forward(&self, query: Tensor<3>, query_position: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        let dropped = |x: Tensor<3>| self.dropout.forward(x);
        let placed = query.clone() + query_position.clone();
        let among = self.self_attention.forward(placed.clone(), placed.swap_dims(1, 2));
        let x = self.norms[0].forward(query + dropped(among));
        let asked = self.cross_attention.forward(x.clone() + query_position, memory);
        let x = self.norms[1].forward(x + dropped(asked));
        let hidden = dropped(relu(self.feed_forward.hidden.forward(x.clone())));
        self.norms[2].forward(x + dropped(self.feed_forward.out.forward(hidden)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::golden::Golden;
    use burn::optim::GradientsParams;
    use burn::tensor::TensorData;

    /// The sizes of `tests/golden/torch_head.py`.
    fn config() -> HeadConfig {
        HeadConfig { channels: 16, n_heads: 4, ffn_channels: 24, ..HeadConfig::default() }
    }

    #[test]
    fn one_layer_equals_pytorchs_in_values_and_gradients() {
        let golden = Golden::read("head");
        let device = test_device().autodiff();
        let layer = golden.load_torch("decoder.weights", DecoderLayer::init(&config(), &device));
        let input =
            |name: &str| golden.tensor::<3>(&format!("decoder.inputs.{name}"), &device).require_grad();
        let [query, query_position] = ["query", "query_position"].map(input);
        let [memory, memory_position] = ["memory", "memory_position"].map(input);

        let placed = (memory.clone() + memory_position.clone()).swap_dims(1, 2);
        let output = layer.forward(query.clone(), query_position.clone(), placed);
        golden.check("decoder.output", &output);

        let weighted = output * golden.tensor("decoder.output_gradient", &device);
        let gradients = weighted.sum().backward();
        for (input, name) in [
            (query, "query"),
            (query_position, "query_position"),
            (memory, "memory"),
            (memory_position, "memory_position"),
        ] {
            golden.check(&format!("decoder.input_gradients.{name}"), &input.grad(&gradients).unwrap());
        }
        let gradients = GradientsParams::from_grads(gradients, &layer);
        let expected = |name: &str| format!("decoder.weight_gradients.{name}");
        for (linear, name) in [
            (&layer.self_attention.query, "self_attention.query.weight"),
            (&layer.cross_attention.key, "cross_attention.key.weight"),
            (&layer.cross_attention.out, "cross_attention.out.weight"),
            (&layer.feed_forward.hidden, "feed_forward.hidden.weight"),
        ] {
            // PyTorch keeps a linear layer's weight as [out, in].
            let gradient = gradients.get::<2>(linear.weight.id).unwrap().transpose();
            golden.check(&expected(name), &gradient);
        }
        let bias = layer.self_attention.value.bias.as_ref().unwrap();
        let scale = &layer.norms[1].gamma;
        for (id, name) in [(bias.id, "self_attention.value.bias"), (scale.id, "norms.1.weight")] {
            let gradient = gradients.get::<1>(id).unwrap();
            golden.check(&expected(name), &gradient);
        }
    }

    #[test]
    fn dropout_changes_training_and_leaves_inference_alone() {
        let device = Device::flex().autodiff();
        let layer = DecoderLayer::init(&HeadConfig { dropout: 0.5, ..config() }, &device);
        let forward = |layer: &DecoderLayer, device: &Device| -> Vec<f32> {
            let numbers = |n: usize| (0..n * 16).map(|i| (i as f32).sin()).collect::<Vec<_>>();
            let tensor = |n| Tensor::<3>::from_data(TensorData::new(numbers(n), [1, n, 16]), device);
            let memory = tensor(9).swap_dims(1, 2);
            layer.forward(tensor(5), tensor(5), memory).into_data().try_to_vec().unwrap()
        };
        let inference = forward(&layer.valid(), &Device::flex());
        assert_eq!(forward(&layer.valid(), &Device::flex()), inference);
        assert_ne!(forward(&layer, &device), inference);
    }
}
