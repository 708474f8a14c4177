"""What is hidden behind walls and ground, told from their depths alone."""

import functools

import numpy as np
from numpy.typing import NDArray

from harmzone_sim.view import Array, View

_TILE_PX = 10


class Depths:
    """The farthest and nearest that a picture shows in each tile of it, for a camera's view.

    Depths are those of OpenGL: 1 near, 0 far or nothing.
    """

    def __init__(self, view: View, depth: NDArray[np.float32]) -> None:
        self._view, (self._height, self._width) = view, depth.shape
        depth = np.pad(depth, [(0, -n % _TILE_PX) for n in depth.shape], mode="edge")
        self._far, self._near = _tiles(np.minimum, depth), _tiles(np.maximum, depth)
        # Each level has the farthest of two by two tiles of the one before.
        self._levels = [self._far]
        while max(self._levels[-1].shape) > 1:
            last = self._levels[-1]
            last = np.pad(last, [(0, n % 2) for n in last.shape], mode="edge")
            self._levels.append(last.reshape(last.shape[0] // 2, 2, -1, 2).min(axis=(1, 3)))

    def hides(self, center_m: Array, radius_m: Array) -> NDArray[np.bool_]:
        """Which balls lie wholly behind what is shown: center_m [ball, 3], radius_m [ball]."""
        view = self._view
        in_clip = np.column_stack([center_m, np.ones(len(center_m))]) @ view.clip_from_world.T
        depth_m = in_clip[:, 3]
        nearest_m = depth_m - radius_m
        is_ahead = nearest_m > view.near_m
        nearest_m = np.where(is_ahead, nearest_m, 1.0)
        nearest = view.near_m * (view.far_m / nearest_m - 1) / (view.far_m - view.near_m)
        # The box of the ball's outline, from the slopes of its four tangent planes.
        n = len(center_m)
        low, high = np.empty((n, 2)), np.empty((n, 2))
        for i, size in enumerate((self._width, self._height)):
            row = view.clip_from_world[i]
            stretch = np.linalg.norm(row[:3])
            aside_m, gap = in_clip[:, i] / stretch, np.maximum(depth_m**2 - radius_m**2, 1e-9)
            middle = aside_m * depth_m
            half = radius_m * np.sqrt(np.maximum(aside_m**2 + depth_m**2 - radius_m**2, 0))
            low[:, i], high[:, i] = (
                (stretch * side / gap + 1) / 2 * size for side in (middle - half, middle + half)
            )
        low[:, 1], high[:, 1] = self._height - high[:, 1], self._height - low[:, 1]
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

    def bounds(self, axes: Array) -> tuple[Array, Array]:
        """The box along two axes [2, 3] of the world that holds all that is shown, leaving out the sky."""
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
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for tiles in (self._far, self._near):
            row, column = np.nonzero(tiles > 0)
            depth_m = view.near_m * view.far_m / (view.near_m + tiles[row, column].astype(float) * span)
            way = x[column, None] * in_axes[0] - y[row, None] * in_axes[1] - in_axes[2]
            places = depth_m[:, None] * way
            low = np.minimum(low, (places - depth_m[:, None] * half).min(axis=0, initial=np.inf))
            high = np.maximum(high, (places + depth_m[:, None] * half).max(axis=0, initial=-np.inf))
        eye = axes @ view.eye_m
        return low + eye, high + eye


def _tiles(function: np.ufunc, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Reduces each tile to one value, line by line, which numpy does far faster than block by block."""
    rows = functools.reduce(function, (depth[i::_TILE_PX] for i in range(_TILE_PX)))
    return functools.reduce(function, (rows[:, i::_TILE_PX] for i in range(_TILE_PX)))
