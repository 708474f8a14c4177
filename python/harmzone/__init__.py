"""harmzone: what matters to a self-driving car.

Data sets as numpy arrays, danger zones, the detector and its scores; the command line's commands as
functions. Metres, radians, seconds; boxes are rows of x, y, z of the centre, length, width, height, yaw, in
the ego frame: x ahead, y to the left, z up, origin on the ground below the middle of the rear axle.
"""

import importlib
from typing import TYPE_CHECKING

from harmzone._native import HarmzoneError, __version__

if TYPE_CHECKING:
    from harmzone._command import CommandError, evaluate, gen, label, predict, run, train
    from harmzone._data import Boxes, Dataset, Sample, collate, to_torch
    from harmzone._network import Detector
    from harmzone._zone import Zone

# The command and its workers import this package, too, and need neither numpy here nor PyTorch.
_FOUND_IN = {
    "_command": ("CommandError", "evaluate", "gen", "label", "predict", "run", "train"),
    "_data": ("Boxes", "Dataset", "Sample", "collate", "to_torch"),
    "_network": ("Detector",),
    "_zone": ("Zone",),
}

__all__ = [
    "Boxes",
    "CommandError",
    "Dataset",
    "Detector",
    "HarmzoneError",
    "Sample",
    "Zone",
    "__version__",
    "collate",
    "evaluate",
    "gen",
    "label",
    "predict",
    "run",
    "to_torch",
    "train",
]


def __getattr__(name: str) -> object:
    for module, names in _FOUND_IN.items():
        if name in names:
            return getattr(importlib.import_module(f"harmzone.{module}"), name)
    raise AttributeError(f"module 'harmzone' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
