"""Writes voxel.safetensors: a cloud, and its voxels by a plain loop over the points.

The rules are those of mmcv's hard voxelization on the CPU.

Run in the environment of requirements.txt in this folder, from any folder:
    python tests/golden/torch_voxel.py
"""

from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

LOW = np.array([0.0, -2.0, -1.0])
SIZE = np.array([0.25, 0.25, 0.5])
SHAPE = np.array([12, 16, 4])
MAX_POINTS, MAX_VOXELS = 10, 300


def cloud(rng: np.random.Generator) -> np.ndarray:
    """[point, 4]: an even part that leaves the grid on all sides, and clusters that crowd some voxels."""
    even = rng.uniform(LOW - 0.5, LOW + SIZE * SHAPE + 0.5, size=(700, 3))
    clusters = rng.uniform(LOW, LOW + SIZE * SHAPE, size=(12, 1, 3)) + rng.normal(0, 0.08, size=(12, 50, 3))
    points = np.concatenate([even, clusters.reshape(-1, 3)])
    # Points on the lower faces of voxels: they belong to the voxel above.
    points[:40] = LOW + SIZE * rng.integers(0, SHAPE, size=(40, 3))
    points = np.concatenate([points, rng.uniform(0, 255, size=(len(points), 1))], axis=1)
    return rng.permutation(points).astype(np.float32).astype(np.float64)


def voxelize(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (z, y, x) [voxel, 3] in rising order, and mean features [voxel, 4]."""
    voxels: dict[tuple[int, ...], list[np.ndarray]] = {}
    for point in points:
        cell = np.floor((point[:3] - LOW) / SIZE).astype(int)
        if (cell < 0).any() or (cell >= SHAPE).any():
            continue
        key = tuple(int(at) for at in cell[::-1])
        if key not in voxels:
            if len(voxels) >= MAX_VOXELS:
                continue
            voxels[key] = []
        if len(voxels[key]) < MAX_POINTS:
            voxels[key].append(point)
    assert len(voxels) == MAX_VOXELS and max(map(len, voxels.values())) == MAX_POINTS
    keys = sorted(voxels)
    return np.array(keys), np.array([np.mean(voxels[key], axis=0) for key in keys])


def main() -> None:
    points = cloud(np.random.default_rng(7))
    cells, features = voxelize(points)
    tensors = {
        "points": points.astype(np.float32),
        "cells": cells.astype(np.float32),
        "features": features.astype(np.float32),
    }
    save_file(tensors, Path(__file__).parent / "voxel.safetensors")


if __name__ == "__main__":
    main()
