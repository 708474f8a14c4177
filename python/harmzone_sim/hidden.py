"""What is hidden behind walls and ground, told from their depths alone."""

import functools

import numpy as np
from numpy.typing import NDArray

from harmzone_sim.view import Array, View

_TILE_PX = 10
# Relative error of depths, at most.
_DEPTH_SLACK = 2e-3
# Cells along each side of a plane.
_CELLS = 64


class Depths:
    """The farthest and nearest that a picture shows in each tile of it, for a camera's view.

    Depths are those of OpenGL: 1 near, 0 far or nothing.
    """

    def __init__(self, view: View, depth: NDArray[np.float32]) -> None:
        self._view, (self._height, self._width) = view, depth.shape
        depth = np.pad(depth, [(0, -n % _TILE_PX) for n in depth.shape], mode="edge")
        self._far, self._near = _tiles(np.minimum, depth), _tiles(np.maximum, depth)
        # The farthest but for the sky.
        self._farthest = _tiles(np.minimum, np.where(depth > 0, depth, np.float32(1)))
        # Each level has the farthest of two by two tiles of the one before.
        self._levels = [self._far]
        while max(self._levels[-1].shape) > 1:
            last = self._levels[-1]
            last = np.pad(last, [(0, n % 2) for n in last.shape], mode="edge")
            self._levels.append(last.reshape(last.shape[0] // 2, 2, -1, 2).min(axis=(1, 3)))

    def hides(self, corners_m: Array) -> NDArray[np.bool_]:
        """Which boxes lie wholly behind what is shown: corners_m [box, 8, 3]."""
        view, n = self._view, len(corners_m)
        in_clip = corners_m @ view.clip_from_world[:, :3].T + view.clip_from_world[:, 3]
        depth_m = in_clip[..., 3]
        nearest_m = depth_m.min(axis=1) * (1 - _DEPTH_SLACK)
        is_ahead = nearest_m > view.near_m
        nearest = np.where(is_ahead, nearest_m, 1.0)
        nearest = view.near_m * (view.far_m / nearest - 1) / (view.far_m - view.near_m)
        places = in_clip[..., :2] / np.maximum(depth_m, view.near_m)[..., None]
        places = (places * [1, -1] + 1) / 2 * [self._width, self._height]
        low, high = places.min(axis=1), places.max(axis=1)
        last_tile = np.array(self._far.shape[::-1]) - 1
        first = np.clip(np.floor(low / _TILE_PX).astype(int), 0, last_tile)
        last = np.clip(np.floor(high / _TILE_PX).astype(int), 0, last_tile)
        # The level at which the box meets five tiles by five at most: a coarser one sees past what hides it.
        span = (last - first).max(axis=1, initial=0)
        level = np.maximum(np.ceil(np.log2(np.maximum(span, 1))).astype(int) - 2, 0)
        shown = np.empty(n, dtype=np.float32)
        for i, tiles in enumerate(self._levels):
            here = level == i
            a, b = first[here] >> i, last[here] >> i
            steps = [np.minimum(a + step, b) for step in range(5)]
            met = [tiles[row[:, 1], column[:, 0]] for row in steps for column in steps]
            shown[here] = np.minimum.reduce(met)
        return is_ahead & (nearest < shown)

    def boxes(self, axes: Array) -> tuple[Array, Array]:
        """Boxes along two axes [2, 3] of the world round what each tile shows: lows and highs, [tile, 2].

        The sky is left out.
        """
        view = self._view
        span = view.far_m - view.near_m
        tangents = 1 / np.linalg.norm(view.clip_from_world[:2, :3], axis=1)
        sizes = self._width, self._height
        x, y = (
            ((np.arange(n) + 0.5) * 2 * _TILE_PX / size - 1) * tangent
            for n, size, tangent in zip(self._far.shape[::-1], sizes, tangents, strict=True)
        )
        in_axes = view.axes @ axes.T
        # Half a tile, for a depth of 1.
        half = sum(_TILE_PX / sizes[i] * tangents[i] * np.abs(in_axes[i]) for i in range(2))
        row, column = np.nonzero(self._near > 0)
        way = x[column, None] * in_axes[0] - y[row, None] * in_axes[1] - in_axes[2]
        ends = []
        for tiles in (self._farthest, self._near):
            depth_m = view.near_m * view.far_m / (view.near_m + tiles[row, column].astype(float) * span)
            places = depth_m[:, None] * way
            ends += [places - depth_m[:, None] * half, places + depth_m[:, None] * half]
        eye = axes @ view.eye_m
        return np.minimum(ends[0], ends[2]) + eye, np.maximum(ends[1], ends[3]) + eye


class Shown:
    """Cells of a plane in which something is shown; tells which boxes meet one of them."""

    def __init__(self, low: Array, high: Array, lows: Array, highs: Array, margin: float) -> None:
        """low, high: [2], the part of the plane that matters.

        lows, highs: [box, 2], boxes round what is shown; `margin` is added on each side.
        """
        self._low, self._cell = low, np.maximum(high - low, 1e-9) / _CELLS
        is_within = ((highs > low) & (lows < high)).all(axis=1)
        first, last = self._cells(lows[is_within] - margin, highs[is_within] + margin)
        steps = np.zeros((_CELLS + 1, _CELLS + 1), dtype=np.int64)
        for x, y, step in (
            (first[:, 0], first[:, 1], 1),
            (last[:, 0] + 1, first[:, 1], -1),
            (first[:, 0], last[:, 1] + 1, -1),
            (last[:, 0] + 1, last[:, 1] + 1, 1),
        ):
            np.add.at(steps, (x, y), step)
        is_shown = steps.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
        self._sum = np.zeros((_CELLS + 1, _CELLS + 1), dtype=np.int64)
        self._sum[1:, 1:] = is_shown.cumsum(axis=0).cumsum(axis=1)

    def _cells(self, lows: Array, highs: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The first and last cell of each box."""
        first, last = (
            np.floor((ends - self._low) / self._cell).clip(0, _CELLS - 1).astype(np.int64)
            for ends in (lows, highs)
        )
        return first, last

    def meets(self, lows: Array, highs: Array) -> NDArray[np.bool_]:
        """Which boxes [box, 2] meet something that is shown."""
        (x0, y0), (x1, y1) = (ends.T for ends in self._cells(lows, highs))
        x1, y1 = x1 + 1, y1 + 1
        return self._sum[x1, y1] - self._sum[x0, y1] - self._sum[x1, y0] + self._sum[x0, y0] > 0


def _tiles(function: np.ufunc, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Reduces each tile to one value, line by line, which numpy does far faster than block by block."""
    rows = functools.reduce(function, (depth[i::_TILE_PX] for i in range(_TILE_PX)))
    return functools.reduce(function, (rows[:, i::_TILE_PX] for i in range(_TILE_PX)))
