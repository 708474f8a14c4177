"""What the twin of `small` reads: sizes from the TOML that the program reads, and the inputs of a batch."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from functools import reduce

import torch
from torch import Tensor

# The architecture that the twin has, by key of the config.
TWIN = {
    "use_lidar": True,
    "use_camera": True,
    "lidar.encoder": "pillars",
    "camera.backbone": "cnn",
    "head.dropout": 0.0,
    "head.shared_norm": True,
    "head.heatmap": "agnostic",
    "head.border_peaks": True,
    "head.positions": "shared",
    "head.prediction": "placed",
    "head.numeric_fusion": "film",
    "head.look_pillars": 0,
}


@dataclass(frozen=True)
class Config:
    """The sizes that the twin reads from a model config; it refuses other architectures."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float
    z_min_m: float
    z_max_m: float
    cell_size_m: float
    max_points: int
    pillar_channels: int
    bev_channels: tuple[int, int]
    image_width_px: int
    image_channels: tuple[int, int, int]
    lift_channels: int
    depth_min_m: float
    depth_max_m: float
    n_depth_bins: int
    fuser_channels: int
    channels: int
    n_queries: int
    n_heads: int
    ffn_channels: int
    heatmap_scale: int
    paint_channels: int
    ground: bool
    spread: bool

    @staticmethod
    def parse(text: str) -> Config:
        """Reads `configs/model/small.toml` or the text inside a checkpoint."""
        whole = tomllib.loads(text)
        head, cnn, pillars = whole["head"], whole["camera"]["cnn"], whole["lidar"]["pillars"]
        chosen = {key: reduce(dict.__getitem__, key.split("."), whole) for key in TWIN}
        if chosen != TWIN or head["peak_kernels"][0] != 3:
            raise ValueError(f"the twin has {TWIN} and a peak kernel of 3, the config {chosen}, {head}")
        names = {field.name for field in fields(Config)}
        same_names = {key: value for key, value in (whole["grid"] | cnn | head).items() if key in names}
        return Config(
            **same_names,
            max_points=pillars["max_points"],
            pillar_channels=pillars["channels"],
            bev_channels=tuple(pillars["bev_channels"]),
            ground=pillars["ground"],
            image_channels=tuple(cnn["channels"]),
            fuser_channels=whole["fuser_channels"],
        )

    @property
    def cells(self) -> tuple[int, int]:
        """Cells along y and x."""
        size = self.cell_size_m
        return round((self.y_max_m - self.y_min_m) / size), round((self.x_max_m - self.x_min_m) / size)

    def centers_m(self, scale: int) -> Tensor:
        """Centre of each cell, x and y, on a map of `scale` cells along a feature cell, [cell, 2]."""
        (n_y, n_x), size_m = self.cells, self.cell_size_m / scale
        cell = torch.arange(scale * n_y * scale * n_x, dtype=torch.float64)
        x = self.x_min_m + (cell % (scale * n_x) + 0.5) * size_m
        y = self.y_min_m + (cell.div(scale * n_x, rounding_mode="floor") + 0.5) * size_m
        return torch.stack([x, y], 1).float()


@dataclass
class Batch:
    """Inputs of some samples, as `src/model/batch.rs` stacks them."""

    n_samples: int
    point_features: Tensor  # [point, feature]
    points: Tensor  # [pillar * max_points], rows of point_features
    pillars: Tensor  # [pillar], index into [batch, 2 cell_y, 2 cell_x]
    numeric: Tensor  # [batch * state, 2]
    image: Tensor | None = None  # [batch, 3, y, x], normalized; None in the LiDAR stage
    depth: Tensor | None = None  # [batch, 2, feature_y, feature_x]
    frustum_features: Tensor | None = None  # [frustum], index into [batch, feature_y, feature_x]
    frustum_depths: Tensor | None = None  # [frustum], index into [batch, feature_y, feature_x, bin]
    frustum_cells: Tensor | None = None  # [frustum], index into [batch, cell_y, cell_x]; sorted
    # [point], index into [batch, quarter_y, quarter_x], its length for a point that the picture does not show
    pixels: Tensor | None = None
