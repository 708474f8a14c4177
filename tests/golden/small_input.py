"""Inputs of the `small` detector in NumPy: pillars, LiDAR depths at image features, frustum cells.

The twin of `pillars.rs` and `ground.rs` in `src/model/lidar` and of `src/model/camera/cnn_input.rs`; pictures
are already resized.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from small_config import Batch, Config

STRIDE, PAINT_STRIDE = 8, 4
# The fit of the ground.
NODE_M, SQUARE_M, REACH_M, ABOVE_M, BELOW_M = 6.4, 0.8, 9.0, 0.1, 0.4
PRIOR_POINTS, SLOPE_CHANGE, FADING, N_ROUNDS, MOST_M = 3.0, 0.05, 0.8, 5, 12.0
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

    point_features: Array  # [point, 10 or, with the height over the ground, 11]
    points: Array  # [pillar, max_points]
    pillars: Array  # [pillar]
    image: Array  # [3, y, x], 8 bit
    depth: Array  # [feature_y, feature_x], metres
    frustum_points: Array  # [frustum], index into [bin, feature_y, feature_x]
    frustum_cells: Array  # [frustum]
    pixels: Array  # [point], index into [quarter_y, quarter_x], its length for a point out of the picture


class Ground:
    """Planes at the nodes of a lattice, each fitted to the lowest points around it, from the car outwards."""

    def __init__(self, points: Array, config: Config):
        self.min_m = np.array([config.x_min_m, config.y_min_m])
        extent_m = np.array([config.x_max_m, config.y_max_m]) - self.min_m
        self.n_nodes = np.ceil(extent_m / NODE_M).astype(int) + 1
        lowest = self.lowest_of_squares(points, extent_m)
        n_x, n_y = self.n_nodes
        self.planes = np.full((n_y, n_x, 3), np.nan)
        nodes = [(*(self.min_m + np.array([x, y]) * NODE_M), y, x) for y in range(n_y) for x in range(n_x)]
        for x_m, y_m, y, x in sorted(nodes, key=lambda node: np.hypot(*node[:2])):
            away = lowest[:, :2] - [x_m, y_m]
            square = np.floor((lowest[:, :2] - self.min_m) / SQUARE_M)
            ends = [np.floor((np.array([x_m, y_m]) + s * REACH_M - self.min_m) / SQUARE_M) for s in (-1, 1)]
            near = ((square >= ends[0]) & (square <= ends[1])).all(1)
            weight = np.exp(-2 * (away[near] ** 2).sum(1) / REACH_M**2)
            self.planes[y, x] = fit_plane(away[near], lowest[near, 2], weight, self.foretell(x, y))

    def lowest_of_squares(self, points: Array, extent_m: Array) -> Array:
        """[square, 3] of the squares that hold a point."""
        n = np.ceil(extent_m / SQUARE_M)
        place = (points[:, :2] - self.min_m) / SQUARE_M
        inside = ((place >= 0) & (place < n)).all(1) & (np.abs(points[:, 2]) <= MOST_M)
        kept, square = points[inside, :3], np.floor(place[inside]).astype(int) @ [1, int(n[0])]
        order = np.lexsort((kept[:, 2], square))
        _, first = np.unique(square[order], return_index=True)
        return kept[order][first]

    def foretell(self, x: int, y: int) -> Array:
        """The plane as its fitted neighbours continue."""
        found = []
        for other_y in range(max(y - 1, 0), min(y + 2, self.n_nodes[1])):
            for other_x in range(max(x - 1, 0), min(x + 2, self.n_nodes[0])):
                height_m, along_x, along_y = self.planes[other_y, other_x] * [1, FADING, FADING]
                if np.isfinite(height_m):
                    rise_m = (along_x * (x - other_x) + along_y * (y - other_y)) * NODE_M
                    found.append((height_m + rise_m, along_x, along_y))
        return np.mean(found, 0) if found else np.zeros(3)

    def height_m(self, points: Array) -> Array:
        """[point] of places [point, 2]."""
        at = np.clip((points - self.min_m) / NODE_M, 0, self.n_nodes - 1)
        low = np.minimum(at.astype(int), self.n_nodes - 2)
        share = at - low

        def of(dx: int, dy: int) -> Array:
            plane = self.planes[low[:, 1] + dy, low[:, 0] + dx]
            off_m = (at - low - [dx, dy]) * NODE_M
            return plane[:, 0] + plane[:, 1] * off_m[:, 0] + plane[:, 2] * off_m[:, 1]

        rows = [of(0, dy) * (1 - share[:, 0]) + of(1, dy) * share[:, 0] for dy in (0, 1)]
        return rows[0] * (1 - share[:, 1]) + rows[1] * share[:, 1]


def fit_plane(away: Array, z: Array, weight: Array, prior: Array) -> Array:
    """Height and slopes, by weighted least squares whose weights fall with the distance from the plane."""
    rows = np.c_[np.ones(len(z)), away]
    of_slope = PRIOR_POINTS * (ABOVE_M / SLOPE_CHANGE) ** 2
    of_prior = np.array([PRIOR_POINTS, of_slope, of_slope])
    plane = prior
    for _ in range(N_ROUNDS):
        above = z - rows @ plane
        now = weight / (1 + (above / np.where(above > 0, ABOVE_M, BELOW_M)) ** 2)
        a = np.diag(of_prior) + (rows * now[:, None]).T @ rows
        plane = np.linalg.solve(a, of_prior * prior + (rows * now[:, None]).T @ z)
    return plane


def pillars(points: Array, config: Config) -> tuple[Array, Array, Array, Array]:
    """Point features, rows of pillars, their cells, each row's point. points: [point, 4] in the ego frame."""
    n_y, n_x = (2 * n for n in config.cells)
    size_m = config.cell_size_m / 2
    x = np.floor((points[:, 0] - config.x_min_m) / size_m).astype(int)
    y = np.floor((points[:, 1] - config.y_min_m) / size_m).astype(int)
    inside = (x >= 0) & (x < n_x) & (y >= 0) & (y < n_y)
    over_ground = points[:, 2] - (Ground(points, config).height_m(points[:, :2]) if config.ground else 0.0)
    inside &= (over_ground >= config.z_min_m) & (over_ground < config.z_max_m)
    of_points = np.flatnonzero(inside)
    order = of_points[np.argsort((y * n_x + x)[of_points], kind="stable")]
    cells, first, count = np.unique((y * n_x + x)[order], return_index=True, return_counts=True)
    features, rows, sources, n_rows = [], [], [], 0
    for cell, start, n in zip(cells, first, count, strict=True):
        of_cell = points[order[start : start + n]]
        kept = min(n, config.max_points)
        source = order[start : start + n]
        if n > kept:
            by_height = source[np.argsort(of_cell[:, 2], kind="stable")]
            source = by_height[np.arange(kept) * (n - 1) // max(kept - 1, 1)]
        chosen = points[source]
        center = [
            config.x_min_m + (cell % n_x + 0.5) * size_m,
            config.y_min_m + (cell // n_x + 0.5) * size_m,
        ]
        scaled = chosen / np.array([50.0, 30.0, 1.0, 255.0])
        to_mean, to_center = chosen[:, :3] - of_cell[:, :3].mean(0), chosen[:, :2] - center
        columns = [scaled, to_mean, to_center, np.full(kept, np.log(n) / 3)]
        features.append(np.column_stack(columns + [over_ground[source]] * config.ground))
        sources.append(source)
        rows.append([n_rows + (k if k < kept else 0) for k in range(config.max_points)])
        n_rows += kept
    return np.concatenate(features), np.array(rows), cells, np.concatenate(sources)


def see(points: Array, camera: Camera) -> tuple[Array, Array, Array, Array]:
    """Columns, rows and depths of points in the picture, and whether it shows them."""
    x, y, z = ((points[:, :3] - camera.position) @ camera.rotation).T
    ahead = z > 1e-6
    z_or_one = np.where(ahead, z, 1.0)
    u = camera.center_px[0] + camera.focal_px[0] * x / z_or_one
    v = camera.center_px[1] + camera.focal_px[1] * y / z_or_one
    seen = ahead & (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    return u, v, z, seen


def pixels_of(points: Array, camera: Camera) -> Array:
    """Where the map at a quarter of the picture shows each of these points."""
    u, v, _, seen = see(points, camera)
    n_y, n_x = -(-camera.height_px // PAINT_STRIDE), -(-camera.width_px // PAINT_STRIDE)
    column = np.minimum(np.floor(np.where(seen, u, 0) / PAINT_STRIDE + 0.5).astype(int), n_x - 1)
    row = np.minimum(np.floor(np.where(seen, v, 0) / PAINT_STRIDE + 0.5).astype(int), n_y - 1)
    return np.where(seen, row * n_x + column, n_y * n_x)


def sparse_depth(points: Array, camera: Camera) -> Array:
    """Nearest LiDAR depth at each image feature, 0 where there is none."""
    u, v, z, seen = see(points, camera)
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
    *of_pillars, sources = pillars(points, config)
    seen = pixels_of(points[sources], camera)
    return Prepared(*of_pillars, image, sparse_depth(points, camera), *frustum(camera, config), seen)


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
    of_features, of_depths, of_cells, of_points = [], [], [], []
    for i, sample in enumerate(samples):
        n = sample.depth.size
        depth_bin, pixel = sample.frustum_points // n, sample.frustum_points % n
        of_features.append(i * n + pixel)
        of_depths.append((i * n + pixel) * config.n_depth_bins + depth_bin)
        of_cells.append(i * n_y * n_x + sample.frustum_cells)
        n_pixels = np.prod([-(-n // PAINT_STRIDE) for n in sample.image.shape[1:]])
        nowhere = len(samples) * n_pixels
        of_points.append(np.where(sample.pixels < n_pixels, i * n_pixels + sample.pixels, nowhere))
    features, depths, cells = (np.concatenate(x) for x in (of_features, of_depths, of_cells))
    order = np.argsort(cells, kind="stable")
    batch.image = floats((np.stack([sample.image for sample in samples]).astype(np.float32) - 115) / 58)
    batch.depth = floats(np.stack([np.stack([s.depth / 50, s.depth > 0]) for s in samples]))
    batch.frustum_features, batch.frustum_depths, batch.frustum_cells = (
        torch.from_numpy(np.ascontiguousarray(x[order])) for x in (features, depths, cells)
    )
    batch.pixels = torch.from_numpy(np.concatenate(of_points))
    return batch
