"""Numbers that the scripts here and the Rust tests make alike, so that large weights need no file.

`src/model/golden/formula.rs` is the same in Rust.
"""

import math

import numpy as np
import torch


def uniform(name: str, n: int) -> np.ndarray:
    """Returns n numbers in [-1, 1) from an integer hash of the name and the index; exact in float64."""
    seed = 2166136261
    for byte in name.encode():
        seed = ((seed ^ byte) * 16777619) & 0xFFFFFFFF
    h = np.arange(n, dtype=np.uint32) * np.uint32(2654435761) + np.uint32(seed)
    h = (h ^ (h >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    h = (h ^ (h >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    h = h ^ (h >> np.uint32(16))
    return (h >> np.uint32(8)).astype(np.float64) / 2**23 - 1.0


def weight(name: str, shape: tuple[int, ...]) -> torch.Tensor:
    """A weight: of several axes with variance one over its inputs, scales about 1, the rest about 0."""
    values = uniform(name, math.prod(shape))
    if len(shape) > 1:
        values = values * math.sqrt(3.0 / math.prod(shape[1:]))
    elif name.endswith("weight"):
        values = 1.0 + 0.1 * values
    else:
        values = 0.1 * values
    return torch.from_numpy(values.astype(np.float32)).reshape(shape)


def tensor(name: str, shape: tuple[int, ...]) -> torch.Tensor:
    """An input: uniform in [-1, 1)."""
    return torch.from_numpy(uniform(name, math.prod(shape)).astype(np.float32)).reshape(shape)


def fill(module: torch.nn.Module) -> None:
    """Sets every parameter to the weight of its name."""
    with torch.no_grad():
        for name, parameter in module.named_parameters():
            parameter.copy_(weight(name, tuple(parameter.shape)))
