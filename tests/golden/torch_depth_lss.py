"""Writes lss_fpn.safetensors and depth_lss.safetensors: the feature pyramid and the view transform of the
published camera branch, small, with gradients.

    .venv-golden/bin/python tests/golden/torch_depth_lss.py

Written from BEVFusion's published values (Liu et al. 2023); state dicts have harmzone's names. Batch norms
use the statistics of the batch.
"""

import math
from pathlib import Path

import formula
import torch
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional as F  # noqa: N812

HERE = Path(__file__).parent


class ConvNorm(nn.Module):
    """Convolution, batch norm, ReLU."""

    def __init__(self, n_in: int, n_out: int, kernel: int, stride: int = 1, bias: bool = False):
        super().__init__()
        self.conv = nn.Conv2d(n_in, n_out, kernel, stride, kernel // 2, bias=bias)
        self.norm = nn.BatchNorm2d(n_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return F.relu(self.norm(self.conv(x)))


class LssFpn(nn.Module):
    """Coarse maps enlarged, concatenated behind finer ones and mixed."""

    def __init__(self, channels: list[int], out: int):
        super().__init__()
        sizes = [channels[0] + out, channels[1] + channels[2]]
        self.levels = nn.ModuleList(
            nn.ModuleDict({"lateral": ConvNorm(n, out, 1), "smooth": ConvNorm(out, out, 3)}) for n in sizes
        )

    def forward(self, maps: list[torch.Tensor]) -> torch.Tensor:
        x = maps[2]
        for i in (1, 0):
            x = F.interpolate(x, size=maps[i].shape[2:], mode="bilinear", align_corners=False)
            x = self.levels[i]["lateral"](torch.cat([maps[i], x], 1))
            x = self.levels[i]["smooth"](x)
        return x


# The view transform's sizes; depth bins 1, 2, .. 8 m; cells of 1 m.
BINS = torch.arange(1.0, 9.0, 1.0, dtype=torch.float64)
X_MIN, X_MAX, Y_MIN, Y_MAX, Z_MIN, Z_MAX = 0.0, 8.0, -6.0, 6.0, -1.0, 3.0
IMAGE, STRIDE, CHANNELS_IN, DEPTH_CHANNELS, HIDDEN, OUT = (40, 72), 8, 7, (2, 3, 4), 6, 5


class DepthLss(nn.Module):
    """Sparse depth and image features to bird's-eye cells."""

    def __init__(self):
        super().__init__()
        a, b, c = DEPTH_CHANNELS
        self.depth = nn.ModuleList(
            [ConvNorm(1, a, 1, 1, True), ConvNorm(a, b, 5, 4, True), ConvNorm(b, c, 5, 2, True)]
        )
        self.joint = nn.ModuleList(
            [ConvNorm(c + CHANNELS_IN, HIDDEN, 3, 1, True), ConvNorm(HIDDEN, HIDDEN, 3, 1, True)]
        )
        self.lift = nn.Conv2d(HIDDEN, len(BINS) + OUT, 1)
        self.smooth = nn.ModuleList([ConvNorm(OUT, OUT, 3), ConvNorm(OUT, OUT, 3, 2), ConvNorm(OUT, OUT, 3)])

    def pool(self, features: torch.Tensor, depth: torch.Tensor, cells: list[torch.Tensor]) -> torch.Tensor:
        """cells: [bin, y, x] for each sample, -1 outside. Output: [batch, channel, cell_y, cell_x]."""
        for block in self.depth:
            depth = block(depth)
        x = torch.cat([depth, features], 1)
        for block in self.joint:
            x = block(x)
        x = self.lift(x)
        share, context = x[:, : len(BINS)].softmax(1), x[:, len(BINS) :]
        points = share[:, None] * context[:, :, None]  # [batch, channel, bin, y, x]
        n_y, n_x = int(Y_MAX - Y_MIN), int(X_MAX - X_MIN)
        pooled = []
        for sample, cell in zip(points, cells, strict=True):
            inside = cell >= 0
            zero = torch.zeros(OUT, n_y * n_x)
            pooled.append(zero.index_add(1, cell[inside], sample[:, inside]).reshape(OUT, n_y, n_x))
        return torch.stack(pooled)


def camera(yaw: float, pitch: float, position: tuple[float, float, float]) -> torch.Tensor:
    """4x4 pose of a camera in the ego frame: it looks along x, turned down by pitch, then left by yaw."""
    looking_along_x = torch.tensor([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]], dtype=torch.float64)
    s, c = math.sin(pitch), math.cos(pitch)
    down = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    s, c = math.sin(yaw), math.cos(yaw)
    left = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = left @ down @ looking_along_x
    pose[:3, 3] = torch.tensor(position)
    return pose


def frustum_cells(k: torch.Tensor, pose: torch.Tensor) -> torch.Tensor:
    """Cell of each frustum point, [bin, y, x], -1 outside."""
    rows, columns = -(-IMAGE[0] // STRIDE), -(-IMAGE[1] // STRIDE)
    # Indices of pixels, whose middles lie half a pixel further.
    u = torch.linspace(0, IMAGE[1] - 1, columns, dtype=torch.float64) + 0.5
    v = torch.linspace(0, IMAGE[0] - 1, rows, dtype=torch.float64) + 0.5
    d, v, u = torch.meshgrid(BINS, v, u, indexing="ij")
    in_camera = torch.linalg.inv(k) @ torch.stack([u * d, v * d, d]).reshape(3, -1)
    p = (pose[:3, :3] @ in_camera + pose[:3, 3:]).reshape(3, *d.shape)
    x, y = torch.floor(p[0] - X_MIN), torch.floor(p[1] - Y_MIN)
    inside = (x >= 0) & (x < X_MAX - X_MIN) & (y >= 0) & (y < Y_MAX - Y_MIN)
    inside &= (p[2] >= Z_MIN) & (p[2] < Z_MAX)
    return torch.where(inside, y * (X_MAX - X_MIN) + x, -1.0).long()


def depth_image(points: torch.Tensor, k: torch.Tensor, pose: torch.Tensor) -> torch.Tensor:
    """Nearest depth in each pixel, 0 where there is none. points: [point, 3] in the ego frame."""
    image = torch.zeros(IMAGE)
    for point in points:
        x, y, z = pose[:3, :3].T @ (point - pose[:3, 3])
        if z > 0:
            u, v, _ = k @ torch.stack([x, y, z]) / z
            if 0 <= u < IMAGE[1] and 0 <= v < IMAGE[0]:
                seen = image[int(v), int(u)]
                image[int(v), int(u)] = z if seen == 0 else min(z, seen)
    return image


def save_depth_lss() -> None:
    poses = [camera(0.0, 0.1, (0.5, 0.2, 1.4)), camera(0.4, -0.05, (0.0, -0.5, 1.2))]
    k = torch.tensor([[50.0, 0, 35], [0, 48, 21], [0, 0, 1]], dtype=torch.float64)
    box = torch.tensor([9.0, 7.0, 2.0], dtype=torch.float64)
    points = [formula.tensor(f"points{i}", (400, 3)).double() * box for i in range(2)]
    depth = torch.stack([depth_image(p, k, pose) for p, pose in zip(points, poses, strict=True)])[:, None]
    cells = [frustum_cells(k, pose) for pose in poses]

    net = DepthLss()
    formula.fill(net)
    features = formula.tensor("features", (2, CHANNELS_IN, 5, 9)).requires_grad_()
    pooled = net.pool(features, depth, cells)
    out = pooled
    for block in net.smooth:
        out = block(out)
    (out * formula.tensor("d_out", tuple(out.shape))).sum().backward()
    result = {f"gradient.{name}": p.grad for name, p in net.named_parameters()}
    result |= {"gradient.features": features.grad, "pooled": pooled.detach().clone()}
    result |= {"out": out.detach().clone()}
    result |= {"depth": depth, "cells": torch.stack(cells).permute(0, 2, 3, 1).contiguous().float()}
    save_file(result, HERE / "depth_lss.safetensors")
    print("frustum points inside:", [int((c >= 0).sum()) for c in cells])
    print("pixels seen:", int((depth > 0).sum()))


def save_lss_fpn() -> None:
    net = LssFpn([6, 8, 10], 12)
    formula.fill(net)
    shapes = [(2, 6, 7, 10), (2, 8, 4, 5), (2, 10, 2, 3)]
    maps = [formula.tensor(f"map{i}", shape).requires_grad_() for i, shape in enumerate(shapes)]
    out = net(maps)
    (out * formula.tensor("d_out", tuple(out.shape))).sum().backward()
    result = {f"gradient.{name}": p.grad for name, p in net.named_parameters()}
    result |= {f"gradient.map{i}": m.grad for i, m in enumerate(maps)}
    save_file(result | {"out": out.detach().clone()}, HERE / "lss_fpn.safetensors")


if __name__ == "__main__":
    save_depth_lss()
    save_lss_fpn()
