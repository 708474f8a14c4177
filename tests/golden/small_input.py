"""Inputs of the `small` detector in NumPy: pillars, LiDAR depths at image features, frustum cells.

The twin of `src/model/lidar/pillars.rs` and `src/model/camera/cnn_input.rs`; pictures are already resized.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from small_network import Batch, Config

STRIDE = 8
Array = np.ndarray


@dataclass(frozen=True)
class Camera:
    """Intrinsics of the resized picture, and where the camera is: ego = rotation @ camera + position."""

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    rotation: Array
    position: Array

    @property
    def n_features(self) -> tuple[int, int]:
        """Rows and columns after three convolutions of stride 2."""
        return -(-self.height_px // STRIDE), -(-self.width_px // STRIDE)


@dataclass
class Prepared:
    """One sample."""

    point_features: Array  # [point, 10]
    points: Array  # [pillar, max_points]
    pillars: Array  # [pillar]
    image: Array  # [3, y, x], 8 bit
    depth: Array  # [feature_y, feature_x], metres
    frustum_points: Array  # [frustum], index into [bin, feature_y, feature_x]
    frustum_cells: Array  # [frustum]


def pillars(points: Array, config: Config) -> tuple[Array, Array, Array]:
    """Point features, rows of each pillar, and pillar cells. points: [point, 4] in the ego frame."""
    n_y, n_x = (2 * n for n in config.cells)
    size_m = config.cell_size_m / 2
    x = np.floor((points[:, 0] - config.x_min_m) / size_m).astype(int)
    y = np.floor((points[:, 1] - config.y_min_m) / size_m).astype(int)
    inside = (x >= 0) & (x < n_x) & (y >= 0) & (y < n_y)
    inside &= (points[:, 2] >= config.z_min_m) & (points[:, 2] < config.z_max_m)
    of_points = np.flatnonzero(inside)
    order = of_points[np.argsort((y * n_x + x)[of_points], kind="stable")]
    cells, first, count = np.unique((y * n_x + x)[order], return_index=True, return_counts=True)
    features, rows, n_rows = [], [], 0
    for cell, start, n in zip(cells, first, count, strict=True):
        of_cell = points[order[start : start + n]]
        kept = min(n, config.max_points)
        chosen = of_cell[np.arange(kept) * n // kept]
        center = [
            config.x_min_m + (cell % n_x + 0.5) * size_m,
            config.y_min_m + (cell // n_x + 0.5) * size_m,
        ]
        scaled = chosen / np.array([50.0, 30.0, 1.0, 255.0])
        to_mean, to_center = chosen[:, :3] - of_cell[:, :3].mean(0), chosen[:, :2] - center
        features.append(np.c_[scaled, to_mean, to_center, np.full(kept, np.log(n) / 3)])
        rows.append([n_rows + (k if k < kept else 0) for k in range(config.max_points)])
        n_rows += kept
    return np.concatenate(features), np.array(rows), cells


def sparse_depth(points: Array, camera: Camera) -> Array:
    """Nearest LiDAR depth at each image feature, 0 where there is none."""
    x, y, z = ((points[:, :3] - camera.position) @ camera.rotation).T
    ahead = z > 1e-6
    z_or_one = np.where(ahead, z, 1.0)
    u = camera.center_px[0] + camera.focal_px[0] * x / z_or_one
    v = camera.center_px[1] + camera.focal_px[1] * y / z_or_one
    seen = ahead & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    # Halves round up; feature k looks at pixel 8 k.
    column, row = np.floor(u / STRIDE + 0.5).astype(int), np.floor(v / STRIDE + 0.5).astype(int)
    n_y, n_x = camera.n_features
    seen &= (column < n_x) & (row < n_y)
    depth = np.full((n_y, n_x), np.inf)
    np.minimum.at(depth, (row[seen], column[seen]), z[seen])
    return np.where(np.isinf(depth), 0.0, depth)


def frustum(camera: Camera, config: Config) -> tuple[Array, Array]:
    """Frustum points in the grid, and their cells."""
    rows, columns = camera.n_features
    bin_m = (config.depth_max_m - config.depth_min_m) / config.n_depth_bins
    depth = config.depth_min_m + (np.arange(config.n_depth_bins) + 0.5) * bin_m
    d, v, u = np.meshgrid(
        depth, np.arange(rows) * STRIDE + 0.5, np.arange(columns) * STRIDE + 0.5, indexing="ij"
    )
    in_camera = np.stack(
        [
            (u - camera.center_px[0]) / camera.focal_px[0] * d,
            (v - camera.center_px[1]) / camera.focal_px[1] * d,
            d,
        ]
    )
    p = camera.rotation @ in_camera.reshape(3, -1) + camera.position[:, None]
    x = np.floor((p[0] - config.x_min_m) / config.cell_size_m)
    y = np.floor((p[1] - config.y_min_m) / config.cell_size_m)
    n_y, n_x = config.cells
    inside = (x >= 0) & (x < n_x) & (y >= 0) & (y < n_y) & (p[2] >= config.z_min_m) & (p[2] < config.z_max_m)
    return np.flatnonzero(inside), (y * n_x + x)[inside].astype(int)


def prepare(points: Array, image: Array, camera: Camera, config: Config) -> Prepared:
    """points: [point, 4] in the ego frame; image: [3, y, x], resized."""
    return Prepared(*pillars(points, config), image, sparse_depth(points, camera), *frustum(camera, config))


def stack(
    samples: list[Prepared], numeric: Array, config: Config, with_camera: bool, dtype: torch.dtype
) -> Batch:
    """numeric: [batch * state, 2], scaled."""

    def floats(x: Array) -> torch.Tensor:
        # What the program sees is f32.
        return torch.from_numpy(np.ascontiguousarray(x, np.float32)).to(dtype)

    n_points = np.cumsum([0] + [len(sample.point_features) for sample in samples])
    n_y, n_x = config.cells
    shifted = [sample.pillars + 4 * i * n_y * n_x for i, sample in enumerate(samples)]
    rows = [sample.points + first for sample, first in zip(samples, n_points, strict=False)]
    batch = Batch(
        n_samples=len(samples),
        point_features=floats(np.concatenate([sample.point_features for sample in samples])),
        points=torch.from_numpy(np.concatenate(rows).reshape(-1)),
        pillars=torch.from_numpy(np.concatenate(shifted)),
        numeric=floats(numeric),
    )
    if not with_camera:
        return batch
    of_features, of_depths, of_cells = [], [], []
    for i, sample in enumerate(samples):
        n = sample.depth.size
        depth_bin, pixel = sample.frustum_points // n, sample.frustum_points % n
        of_features.append(i * n + pixel)
        of_depths.append((i * n + pixel) * config.n_depth_bins + depth_bin)
        of_cells.append(i * n_y * n_x + sample.frustum_cells)
    features, depths, cells = (np.concatenate(x) for x in (of_features, of_depths, of_cells))
    order = np.argsort(cells, kind="stable")
    batch.image = floats((np.stack([sample.image for sample in samples]).astype(np.float32) - 115) / 58)
    batch.depth = floats(np.stack([np.stack([s.depth / 50, s.depth > 0]) for s in samples]))
    batch.frustum_features, batch.frustum_depths, batch.frustum_cells = (
        torch.from_numpy(np.ascontiguousarray(x[order])) for x in (features, depths, cells)
    )
    return batch
