"""The `small` detector in plain PyTorch, module by module under harmzone's names: the twin of `src/model`.

Maps are [batch, channel, y, x]; a checkpoint is loaded by name. Where PyTorch has several ways to compute one
thing, the fastest on two CPU threads is taken (`docs/detector.md` says which were tried).
"""

from __future__ import annotations

import json
import struct
from pathlib import Path

import torch
from safetensors.torch import load_file
from small_config import Batch, Config
from torch import Tensor, nn
from torch.nn import functional

DEPTH_CHANNELS, CODE_SIZE, N_POINT_FEATURES, N_FOOTPRINT_POINTS = 16, 10, 10, 5
LOG_SPREADS = (-5.0, 3.0)


class ConvBlock(nn.Module):
    """3x3 convolution without bias, batch norm, ReLU."""

    def __init__(self, n_in: int, n_out: int, stride: int = 1, epsilon: float = 1e-3):
        super().__init__()
        self.conv = nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False)
        self.norm = nn.BatchNorm2d(n_out, epsilon)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(self.norm(self.conv(x)), inplace=True)


class Mlp(nn.Module):
    """Two linear layers with a ReLU between them."""

    def __init__(self, n_in: int, n_hidden: int, n_out: int):
        super().__init__()
        self.hidden, self.out = nn.Linear(n_in, n_hidden), nn.Linear(n_hidden, n_out)

    def forward(self, x: Tensor) -> Tensor:
        return self.out(functional.relu(self.hidden(x), inplace=True))


class PillarBranch(nn.Module):
    """Pillar encoder and two-scale bird's-eye net."""

    def __init__(self, config: Config):
        super().__init__()
        n, (fine, coarse) = config.pillar_channels, config.bev_channels
        out = fine * 3 // 4
        self.point = nn.Linear(N_POINT_FEATURES + config.ground, n, bias=False)
        if config.paint_channels:
            self.painted = nn.Linear(config.paint_channels, n, bias=False)
        self.point_norm = nn.BatchNorm1d(n, 1e-3)
        self.fine = nn.Sequential(ConvBlock(n, fine, 2), ConvBlock(fine, fine), ConvBlock(fine, fine))
        self.coarse = nn.Sequential(
            ConvBlock(fine, coarse, 2), ConvBlock(coarse, coarse), ConvBlock(coarse, coarse)
        )
        self.fine_out, self.coarse_out = nn.Conv2d(fine, out, 1), nn.Conv2d(coarse, out, 1)
        self.max_points = config.max_points
        self.n_pillars = [2 * n for n in config.cells]

    def forward(self, batch: Batch, painted: Tensor | None) -> Tensor:
        """`painted` [point, channel]: what the picture shows at each point."""
        points = self.point(batch.point_features)
        if painted is not None:
            points = points + self.painted(painted)
        encoded = functional.relu(self.point_norm(points), inplace=True)
        n = encoded.shape[1]
        highest = encoded.index_select(0, batch.points).view(-1, self.max_points, n).max(1).values
        n_y, n_x = self.n_pillars
        grid = encoded.new_zeros(batch.n_samples * n_y * n_x, n).index_copy(0, batch.pillars, highest)
        fine = self.fine(grid.view(batch.n_samples, n_y, n_x, n).permute(0, 3, 1, 2))
        coarse = functional.interpolate(self.coarse_out(self.coarse(fine)), scale_factor=2, mode="nearest")
        return torch.cat([self.fine_out(fine), coarse], 1)


class Paint(nn.Module):
    """A map of the picture at a quarter of its size, from which points take features."""

    def __init__(self, config: Config):
        super().__init__()
        (_, b, c), n = config.image_channels, config.paint_channels
        self.fine, self.coarse = nn.Conv2d(b, n, 1), nn.Conv2d(c, n, 1)
        self.joint = ConvBlock(n, n)
        self.objects = nn.Conv2d(n, 1, 1)

    def forward(self, fine: Tensor, coarse: Tensor) -> Tensor:
        n_y, n_x = fine.shape[2:]
        coarse = functional.interpolate(self.coarse(coarse), scale_factor=2, mode="nearest")
        return self.joint(self.fine(fine) + coarse[..., :n_y, :n_x])

    @staticmethod
    def take(painted: Tensor, pixels: Tensor) -> Tensor:
        """[point, channel]: of each point's pixel, zeros for one that the picture does not show."""
        rows = painted.permute(0, 2, 3, 1).reshape(-1, painted.shape[1])
        return torch.cat([rows, rows.new_zeros(1, rows.shape[1])]).index_select(0, pixels)


class CnnBranch(nn.Module):
    """Image net, depth distribution, lift-splat."""

    def __init__(self, config: Config):
        super().__init__()
        (a, b, c), lift = config.image_channels, config.lift_channels
        self.image = nn.Sequential(
            ConvBlock(3, a, 2), ConvBlock(a, b, 2), ConvBlock(b, b), ConvBlock(b, c, 2), ConvBlock(c, c)
        )
        self.depth = ConvBlock(2, DEPTH_CHANNELS)
        self.joint = ConvBlock(c + DEPTH_CHANNELS, c)
        self.lift = nn.Conv2d(c, config.n_depth_bins + lift, 1)
        self.smooth = ConvBlock(lift, lift)
        if config.paint_channels:
            self.paint = Paint(config)
        self.n_depth_bins, self.n_lift = config.n_depth_bins, lift
        self.cells = config.cells
        self.pool = "bags"

    def image_features(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Maps at a quarter and at an eighth of the picture."""
        quarter = self.image[:3](batch.image)
        return quarter, self.joint(torch.cat([self.image[3:](quarter), self.depth(batch.depth)], 1))

    def forward(self, joint: Tensor, batch: Batch) -> Tensor:
        """From the map at an eighth to the bird's-eye grid."""
        lifted = self.lift(joint).permute(0, 2, 3, 1).reshape(-1, self.n_depth_bins + self.n_lift)
        share = lifted[:, : self.n_depth_bins].softmax(1).reshape(-1)
        context = lifted[:, self.n_depth_bins :]
        n_y, n_x = self.cells
        grid = POOLS[self.pool](context, share, batch, batch.n_samples * n_y * n_x)
        return self.smooth(grid.view(batch.n_samples, n_y, n_x, self.n_lift).permute(0, 3, 1, 2))


def pool_bags(context: Tensor, share: Tensor, batch: Batch, n_cells: int) -> Tensor:
    """[cell, channel]: a cell is a bag of pixels, weighted."""
    offsets = torch.searchsorted(batch.frustum_cells, torch.arange(n_cells))
    weights = share.index_select(0, batch.frustum_depths)
    return functional.embedding_bag(
        batch.frustum_features, context.contiguous(), offsets, mode="sum", per_sample_weights=weights
    )


def pool_index_add(context: Tensor, share: Tensor, batch: Batch, n_cells: int) -> Tensor:
    """[cell, channel]: points first."""
    weights = share.index_select(0, batch.frustum_depths)[:, None]
    points = context.index_select(0, batch.frustum_features) * weights
    return context.new_zeros(n_cells, context.shape[1]).index_add(0, batch.frustum_cells, points)


def pool_scatter_add(context: Tensor, share: Tensor, batch: Batch, n_cells: int) -> Tensor:
    """[cell, channel]: points first, with an index that is expanded over channels."""
    weights = share.index_select(0, batch.frustum_depths)[:, None]
    points = context.index_select(0, batch.frustum_features) * weights
    index = batch.frustum_cells[:, None].expand_as(points)
    return context.new_zeros(n_cells, context.shape[1]).scatter_add(0, index, points)


POOLS = {"bags": pool_bags, "index_add": pool_index_add, "scatter_add": pool_scatter_add}


class Attention(nn.Module):
    """Scaled dot-product attention with several heads."""

    def __init__(self, n_channels: int, n_heads: int):
        super().__init__()
        self.query, self.key, self.value, self.out = (nn.Linear(n_channels, n_channels) for _ in range(4))
        self.n_heads = n_heads

    def forward(self, query: Tensor, memory: Tensor) -> Tensor:
        """All [batch, query or key, channel]."""

        def heads(x: Tensor) -> Tensor:
            return x.unflatten(2, (self.n_heads, -1)).transpose(1, 2)

        q, k, v = heads(self.query(query)), heads(self.key(memory)), heads(self.value(memory))
        return self.out(functional.scaled_dot_product_attention(q, k, v).transpose(1, 2).flatten(2))


class DecoderLayer(nn.Module):
    """Post-norm: self attention, cross attention, feed-forward net."""

    def __init__(self, config: Config):
        super().__init__()
        n = config.channels
        self.self_attention, self.cross_attention = (Attention(n, config.n_heads) for _ in range(2))
        self.feed_forward = Mlp(n, config.ffn_channels, n)
        self.norms = nn.ModuleList(nn.LayerNorm(n) for _ in range(3))

    def forward(self, query: Tensor, position: Tensor, memory: Tensor) -> Tensor:
        placed = query + position
        x = self.norms[0](query + self.self_attention(placed, placed))
        x = self.norms[1](x + self.cross_attention(x + position, memory))
        return self.norms[2](x + self.feed_forward(x))


class Numeric(nn.Module):
    """Speed and steering to scales and shifts of the class branch (FiLM)."""

    def __init__(self, config: Config):
        super().__init__()
        self.embed = Mlp(2, config.channels, 8 * config.channels)


class HarmBranch(nn.Module):
    """Two hidden layers, scaled and shifted channel by channel."""

    def __init__(self, n_in: int, n_hidden: int):
        super().__init__()
        self.first, self.second = nn.Linear(n_in, n_hidden), nn.Linear(n_hidden, n_hidden)
        self.out = nn.Linear(n_hidden, 2)

    def forward(self, x: Tensor, modulation: Tensor) -> Tensor:
        scale_1, shift_1, scale_2, shift_2 = modulation.chunk(4, 2)
        hidden = functional.relu(self.first(x) * (scale_1 + 1) + shift_1)
        return self.out(functional.relu(self.second(hidden) * (scale_2 + 1) + shift_2))


class Placed(nn.Module):
    """One net for the box; the class branch sees centre and corners of its footprint."""

    def __init__(self, config: Config):
        super().__init__()
        n, n_spreads = config.channels, CODE_SIZE * config.spread
        self.boxes = Mlp(n, n, CODE_SIZE + n_spreads)
        self.harm = HarmBranch(n + 2 * N_FOOTPRINT_POINTS + CODE_SIZE - 2 + n_spreads, 2 * n)
        self.cell_size_m = config.cell_size_m

    def forward(self, decoded: Tensor, center_m: Tensor, modulation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Boxes, logarithms of their spreads (no columns without), and harm."""
        boxes, spread = self.boxes(decoded).split_with_sizes(
            [CODE_SIZE, self.boxes.out.out_features - CODE_SIZE], 2
        )
        spread = spread.clamp(*LOG_SPREADS)
        code = boxes.detach()
        center = code[..., :2] * self.cell_size_m + center_m
        half_length, half_width = (code[..., 3:5].clamp(-3, 3).exp() / 2).split(1, 2)
        direction = code[..., 6:8] / (code[..., 6:8].square().sum(2, keepdim=True) + 1e-6).sqrt()
        sin, cos = direction.split(1, 2)
        along = torch.cat([cos, sin], 2) * half_length
        across = torch.cat([-sin, cos], 2) * half_width
        front, back = center + along, center - along
        points = torch.cat([center, front + across, front - across, back + across, back - across], 2)
        place = [points / 5, code[..., 2:8], code[..., 8:] * 0.1, spread.detach()]
        return boxes, spread, self.harm(torch.cat([decoded, *place], 2), modulation)


class Head(nn.Module):
    """Heatmap, queries at its peaks, one decoder layer, boxes and harm."""

    def __init__(self, config: Config):
        super().__init__()
        n, self.scale = config.channels, config.heatmap_scale
        self.shared = nn.ModuleDict({"Normed": ConvBlock(config.fuser_channels, n, epsilon=1e-5)})
        self.heatmap_hidden = ConvBlock(n, n, epsilon=1e-5)
        self.heatmap_out = nn.Conv2d(n, self.scale**2, 3, padding=1)
        self.class_embedding = nn.Linear(self.scale**2, n)
        self.position = nn.ModuleDict({"Shared": Mlp(2, n, n)})
        self.decoder = DecoderLayer(config)
        self.numeric = Numeric(config)
        self.predict = nn.ModuleDict({"Placed": Placed(config)})
        self.n_queries = config.n_queries
        # Of feature cells and of heatmap cells.
        self.register_buffer("centers_m", config.centers_m(1), persistent=False)
        self.register_buffer("fine_centers_m", config.centers_m(self.scale), persistent=False)

    def pick(self, heatmap: Tensor) -> tuple[Tensor, Tensor]:
        """Cells and scores of the best peaks, both [batch, query]; no gradient."""
        scores = heatmap.detach().sigmoid()
        peaks = functional.max_pool2d(scores, 3, 1, 1)
        flat = (scores * (scores == peaks)).flatten(1)
        scores, cells = flat.sort(dim=1, descending=True, stable=True)
        return cells[:, : self.n_queries], scores[:, : self.n_queries]

    def forward(self, features: Tensor, numeric: Tensor, cells: Tensor | None = None) -> dict[str, Tensor]:
        """`cells`, of the heatmap, replace the picked ones."""
        shared = self.shared["Normed"](features)
        heatmap = functional.pixel_shuffle(self.heatmap_out(self.heatmap_hidden(shared)), self.scale)
        picked, scores = self.pick(heatmap)
        cells = picked if cells is None else cells
        memory = shared.flatten(2).transpose(1, 2)
        y, x = cells.div(heatmap.shape[3], rounding_mode="floor"), cells % heatmap.shape[3]
        feature_cells = y.div(self.scale, rounding_mode="floor") * shared.shape[3]
        feature_cells += x.div(self.scale, rounding_mode="floor")
        query = memory.gather(1, feature_cells[..., None].expand(-1, -1, memory.shape[2]))
        place_in_cell = functional.one_hot(y % self.scale * self.scale + x % self.scale, self.scale**2)
        query = query + self.class_embedding(place_in_cell.to(query.dtype))
        center_m = self.fine_centers_m[cells]
        place = self.position["Shared"]
        position = place(center_m / 50)
        decoded = self.decoder(query, position, memory + place(self.centers_m / 50)) + position
        n_states = numeric.shape[0] // features.shape[0]
        decoded, center_m = (x.repeat_interleave(n_states, 0) for x in (decoded, center_m))
        modulation = self.numeric.embed(numeric)[:, None]
        boxes, spread, harm = self.predict["Placed"](decoded, center_m, modulation)
        output = {"heatmap": heatmap, "cells": cells, "scores": scores, "boxes": boxes, "harm": harm}
        return output | ({"spread": spread} if spread.shape[2] else {})


class Detector(nn.Module):
    """The whole detector."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config
        self.lidar = nn.ModuleDict({"Pillars": PillarBranch(config)})
        self.camera = nn.ModuleDict({"Cnn": CnnBranch(config)})
        n_in = 2 * (config.bev_channels[0] * 3 // 4) + config.lift_channels
        self.fuser = ConvBlock(n_in, config.fuser_channels, epsilon=1e-5)
        self.head = Head(config)

    def forward(self, batch: Batch, cells: Tensor | None = None) -> dict[str, Tensor]:
        of_camera, of_picture, painted = self.camera["Cnn"], {}, None
        if batch.image is not None:
            quarter, joint = of_camera.image_features(batch)
            if self.config.paint_channels:
                paint = of_camera.paint(quarter, joint)
                painted = Paint.take(paint, batch.pixels)
                if self.training:
                    of_picture = {"objects": of_camera.paint.objects(paint)}
        lidar = self.lidar["Pillars"](batch, painted)
        if batch.image is None:
            n, _, n_y, n_x = lidar.shape
            camera = torch.zeros_like(lidar[:, :1]).expand(n, self.config.lift_channels, n_y, n_x)
        else:
            camera = of_camera(joint, batch)
        return self.head(self.fuser(torch.cat([camera, lidar], 1)), batch.numeric, cells) | of_picture


def read_metadata(path: Path) -> dict[str, str]:
    """The texts in a safetensors file's header."""
    with path.open("rb") as file:
        (n,) = struct.unpack("<Q", file.read(8))
        return json.loads(file.read(n))["__metadata__"]


def load(path: Path) -> Detector:
    """The twin of a checkpoint that `harmzone train` wrote."""
    detector = Detector(Config.parse(read_metadata(path)["harmzone.model"]))
    found = load_file(path)
    renamed = {"gamma": "weight", "beta": "bias"}
    state = {}
    for name, value in found.items():
        owner, _, leaf = name.rpartition(".")
        is_linear = isinstance(detector.get_submodule(owner), nn.Linear)
        state[f"{owner}.{renamed.get(leaf, leaf)}"] = value.T if is_linear and leaf == "weight" else value
    missing, unexpected = detector.load_state_dict(state, strict=False)
    missing = [name for name in missing if not name.endswith("num_batches_tracked")]
    if missing or unexpected:
        raise ValueError(f"{path}: missing {missing}, unexpected {unexpected}")
    return detector
