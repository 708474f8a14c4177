"""The TransFusion head in plain PyTorch: one decoder layer (values and gradients) and the whole head.

Writes `head.safetensors` beside itself. Formulas: TransFusion (Bai et al. 2022) section 3, figures of the
published BEVFusion detector: post-norm decoder with keys, queries and values all carrying their position
(8 heads there, 4 here), separate position encodings of queries and cells, a net of its own for each
predicted quantity, a one-pixel border without peaks. Speed and steering: a feed-forward net to one number
a query, concatenated and fused by a convolution (arXiv 2506.23426). Tensors are [batch, channel, y, x].

    .venv-golden/bin/python tests/golden/torch_head.py
"""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional

CHANNELS_IN, HIDDEN, N_HEADS, FFN, HEAD_CHANNELS = 12, 16, 4, 24, 8
N_QUERIES, N_CLASSES, N_BATCH, N_Y, N_X = 10, 2, 2, 7, 9
CODE = {"center": 2, "height": 1, "dims": 3, "rotation": 2, "velocity": 2, "harm": N_CLASSES}


class DecoderLayer(nn.Module):
    """Post-norm: self attention, cross attention, feed-forward net."""

    def __init__(self) -> None:
        super().__init__()
        self.self_attention = nn.MultiheadAttention(HIDDEN, N_HEADS, batch_first=True)
        self.cross_attention = nn.MultiheadAttention(HIDDEN, N_HEADS, batch_first=True)
        self.hidden, self.out = nn.Linear(HIDDEN, FFN), nn.Linear(FFN, HIDDEN)
        self.norms = nn.ModuleList(nn.LayerNorm(HIDDEN) for _ in range(3))

    def forward(
        self, query: Tensor, query_position: Tensor, memory: Tensor, memory_position: Tensor
    ) -> Tensor:
        """All [batch, query or cell, channel]."""
        placed = query + query_position
        x = self.norms[0](query + self.self_attention(placed, placed, placed, need_weights=False)[0])
        key = memory + memory_position
        x = self.norms[1](x + self.cross_attention(x + query_position, key, key, need_weights=False)[0])
        return self.norms[2](x + self.out(torch.relu(self.hidden(x))))

    def weights(self, prefix: str) -> dict[str, Tensor]:
        """The weights by the names of harmzone's layers; PyTorch keeps query, key and value in one matrix."""
        found = {}
        for name in ("self_attention", "cross_attention"):
            attention: nn.MultiheadAttention = getattr(self, name)
            for i, part in enumerate(("query", "key", "value")):
                rows = slice(i * HIDDEN, (i + 1) * HIDDEN)
                found[f"{prefix}{name}.{part}.weight"] = attention.in_proj_weight[rows]
                found[f"{prefix}{name}.{part}.bias"] = attention.in_proj_bias[rows]
            found[f"{prefix}{name}.out.weight"] = attention.out_proj.weight
            found[f"{prefix}{name}.out.bias"] = attention.out_proj.bias
        for name in ("hidden", "out"):
            linear: nn.Linear = getattr(self, name)
            found[f"{prefix}feed_forward.{name}.weight"] = linear.weight
            found[f"{prefix}feed_forward.{name}.bias"] = linear.bias
        for i, norm in enumerate(self.norms):
            found[f"{prefix}norms.{i}.weight"] = norm.weight
            found[f"{prefix}norms.{i}.bias"] = norm.bias
        return found


def pair(n_in: int, n_hidden: int, n_out: int, first_bias: bool) -> nn.Sequential:
    """Conv1d, BatchNorm1d, ReLU, Conv1d."""
    return nn.Sequential(
        nn.Conv1d(n_in, n_hidden, 1, bias=first_bias),
        nn.BatchNorm1d(n_hidden),
        nn.ReLU(),
        nn.Conv1d(n_hidden, n_out, 1),
    )


def pair_weights(pair: nn.Sequential, prefix: str) -> dict[str, Tensor]:
    """Conv1d of kernel 1 as the linear layer that it is."""
    found = {f"{prefix}hidden.weight": pair[0].weight[:, :, 0]}
    if pair[0].bias is not None:
        found[f"{prefix}hidden.bias"] = pair[0].bias
    for name in ("weight", "bias", "running_mean", "running_var"):
        found[f"{prefix}norm.{name}"] = getattr(pair[1], name)
    found[f"{prefix}out.weight"] = pair[3].weight[:, :, 0]
    found[f"{prefix}out.bias"] = pair[3].bias
    return found


class Head(nn.Module):
    """The whole head."""

    def __init__(self) -> None:
        super().__init__()
        self.shared = nn.Conv2d(CHANNELS_IN, HIDDEN, 3, padding=1)
        self.heatmap_hidden = nn.Conv2d(HIDDEN, HIDDEN, 3, padding=1, bias=False)
        self.heatmap_norm = nn.BatchNorm2d(HIDDEN)
        self.heatmap_out = nn.Conv2d(HIDDEN, N_CLASSES, 3, padding=1)
        self.class_embedding = nn.Conv1d(N_CLASSES, HIDDEN, 1)
        self.query_position = pair(2, HIDDEN, HIDDEN, True)
        self.cell_position = pair(2, HIDDEN, HIDDEN, True)
        self.decoder = DecoderLayer()
        self.numeric_hidden, self.numeric_out = nn.Linear(2, HIDDEN), nn.Linear(HIDDEN, N_QUERIES)
        self.numeric_fuse = nn.Conv1d(HIDDEN + 1, HIDDEN, 1)
        self.heads = nn.ModuleDict({name: pair(HIDDEN, HEAD_CHANNELS, n, False) for name, n in CODE.items()})

    def forward(self, features: Tensor, numeric: Tensor) -> dict[str, Tensor]:
        """Features [batch, channel, y, x], numeric [batch, 2]."""
        shared = self.shared(features)
        heatmap = self.heatmap_out(torch.relu(self.heatmap_norm(self.heatmap_hidden(shared))))
        scores = torch.sigmoid(heatmap).detach()
        peaks = torch.zeros_like(scores)
        peaks[:, :, 1:-1, 1:-1] = functional.max_pool2d(scores, 3, stride=1, padding=0)
        flat = (scores * (scores == peaks)).flatten(1)
        best = flat.argsort(dim=1, descending=True, stable=True)[:, :N_QUERIES]
        classes, cells = best // (N_Y * N_X), best % (N_Y * N_X)
        memory = shared.flatten(2)
        query = memory.gather(2, cells[:, None].expand(-1, HIDDEN, -1))
        one_hot = functional.one_hot(classes, N_CLASSES).permute(0, 2, 1).float()
        query = query + self.class_embedding(one_hot)
        all_cells = torch.arange(N_Y * N_X)
        centers = torch.stack([all_cells % N_X + 0.5, all_cells // N_X + 0.5])  # [x and y, cell], in cells
        query_position = self.query_position(centers[:, cells].permute(1, 0, 2))
        cell_position = self.cell_position(centers.expand(N_BATCH, -1, -1))
        decoded = self.decoder(*(x.transpose(1, 2) for x in (query, query_position, memory, cell_position)))
        per_query = self.numeric_out(torch.relu(self.numeric_hidden(numeric)))[:, None]  # [batch, 1, query]
        fused = torch.relu(self.numeric_fuse(torch.cat([decoded.transpose(1, 2), per_query], 1)))
        of = {name: head(fused).transpose(1, 2) for name, head in self.heads.items()}
        boxes = torch.cat([of[name] for name in CODE if name != "harm"], 2)
        query_scores = flat.gather(1, best)
        return {"heatmap": heatmap, "cells": cells, "classes": classes, "scores": query_scores,
                "boxes": boxes, "harm": of["harm"]}  # fmt: skip

    def weights(self) -> dict[str, Tensor]:
        """The weights by the names of harmzone's layers."""
        found = {
            "shared.Plain.weight": self.shared.weight,
            "shared.Plain.bias": self.shared.bias,
            "heatmap_hidden.conv.weight": self.heatmap_hidden.weight,
            "heatmap_out.weight": self.heatmap_out.weight,
            "heatmap_out.bias": self.heatmap_out.bias,
            "class_embedding.weight": self.class_embedding.weight[:, :, 0],
            "class_embedding.bias": self.class_embedding.bias,
            "numeric.embed.hidden.weight": self.numeric_hidden.weight,
            "numeric.embed.hidden.bias": self.numeric_hidden.bias,
            "numeric.embed.out.weight": self.numeric_out.weight,
            "numeric.embed.out.bias": self.numeric_out.bias,
            "numeric.fuse.weight": self.numeric_fuse.weight[:, :, 0],
            "numeric.fuse.bias": self.numeric_fuse.bias,
        }
        for name in ("weight", "bias", "running_mean", "running_var"):
            found[f"heatmap_hidden.norm.{name}"] = getattr(self.heatmap_norm, name)
        found |= pair_weights(self.query_position, "position.Separate.query.")
        found |= pair_weights(self.cell_position, "position.Separate.cell.")
        for name, head in self.heads.items():
            found |= pair_weights(head, f"predict.Separate.{name}.")
        return found | self.decoder.weights("decoder.")


def vary(module: nn.Module) -> None:
    """Random biases, norms and running statistics too, so that none of them can be left out unnoticed."""
    with torch.no_grad():
        for name, value in [*module.named_parameters(), *module.named_buffers()]:
            if name.endswith("running_var"):
                value.uniform_(0.5, 1.5)
            elif value.dim() == 1:
                value.add_(0.2 * torch.randn_like(value))


def decoder_case() -> dict[str, Tensor]:
    """One layer in training without dropout: output, and gradients of its inputs and weights."""
    layer = DecoderLayer()
    vary(layer)
    shapes = {
        "query": N_QUERIES,
        "query_position": N_QUERIES,
        "memory": N_Y * N_X,
        "memory_position": N_Y * N_X,
    }
    inputs = {name: torch.randn(N_BATCH, n, HIDDEN, requires_grad=True) for name, n in shapes.items()}
    weights = layer.weights("")
    output = layer(*inputs.values())
    of_output = torch.randn_like(output)
    output.backward(of_output)
    gradients = {
        "self_attention.query.weight": layer.self_attention.in_proj_weight.grad[:HIDDEN],
        "self_attention.value.bias": layer.self_attention.in_proj_bias.grad[2 * HIDDEN :],
        "cross_attention.key.weight": layer.cross_attention.in_proj_weight.grad[HIDDEN : 2 * HIDDEN],
        "cross_attention.out.weight": layer.cross_attention.out_proj.weight.grad,
        "feed_forward.hidden.weight": layer.hidden.weight.grad,
        "norms.1.weight": layer.norms[1].weight.grad,
    }
    return (
        {f"decoder.weights.{name}": value for name, value in weights.items()}
        | {f"decoder.inputs.{name}": value for name, value in inputs.items()}
        | {"decoder.output": output, "decoder.output_gradient": of_output}
        | {f"decoder.input_gradients.{name}": value.grad for name, value in inputs.items()}
        | {f"decoder.weight_gradients.{name}": value for name, value in gradients.items()}
    )


def head_case() -> dict[str, Tensor]:
    """The whole head, at inference and in a training step (batch statistics) with gradients."""
    head = Head()
    vary(head)
    features = torch.randn(N_BATCH, CHANNELS_IN, N_Y, N_X, requires_grad=True)
    numeric = torch.randn(N_BATCH, 2)
    found = {f"head.weights.{name}": value.clone() for name, value in head.weights().items()}
    found |= {"head.features": features, "head.numeric": numeric}
    head.eval()
    found |= {f"head.eval.{name}": value for name, value in head(features, numeric).items()}
    head.train()
    trained = head(features, numeric)
    of = {name: torch.randn_like(trained[name]) for name in ("heatmap", "boxes", "harm")}
    sum((trained[name] * of[name]).sum() for name in of).backward()
    found |= {f"head.train.{name}": trained[name] for name in of}
    found |= {f"head.train.output_gradients.{name}": value for name, value in of.items()}
    found["head.train.features_gradient"] = features.grad
    found |= {
        "head.train.weight_gradients.numeric.embed.out.weight": head.numeric_out.weight.grad,
        "head.train.weight_gradients.class_embedding.weight": head.class_embedding.weight.grad[:, :, 0],
        "head.train.weight_gradients.position.query.hidden.weight": head.query_position[0].weight.grad[
            :, :, 0
        ],
        "head.train.running_mean": head.heads["dims"][1].running_mean,
    }
    return found


def main() -> None:
    """Writes the file."""
    torch.manual_seed(20)
    found = decoder_case() | head_case()
    path = Path(__file__).parent / "head.safetensors"
    save_file({name: value.detach().contiguous() for name, value in found.items()}, path)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
