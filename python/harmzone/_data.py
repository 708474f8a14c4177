"""Data sets as numpy arrays and, where PyTorch is installed, as tensors."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harmzone import _native
from harmzone._place import is_url

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

try:
    from torch.utils.data import Dataset as _Base
except (ImportError, OSError):
    _Base = object  # a data set is a sequence, which PyTorch's loaders take, too

Sample = _native.Sample


@dataclass(frozen=True)
class Boxes:
    """What a detector found in one sample, best first."""

    boxes: NDArray[np.float64]
    """(N, 7): x, y, z of the centre, length, width, height, m; yaw, rad; ego frame."""
    scores: NDArray[np.float64]
    """(N,): 0 to 1."""
    harmful: NDArray[np.bool_]
    """(N,): whether the detector calls it harmful."""

    def __len__(self) -> int:
        return len(self.scores)

    def above(self, score: float) -> Boxes:
        """Those of at least this score."""
        kept = self.scores >= score
        return Boxes(self.boxes[kept], self.scores[kept], self.harmful[kept])


class Dataset(_Base):
    """The samples of a data set's folder, in the manifest's order; each is read when it is asked for.

    A `torch.utils.data.Dataset` where PyTorch is installed; the processes of a `DataLoader` can have it,
    if they return tensors (`collate`).

    Args:
        path: the folder or URL that `gen` or `import` made.
        split: `train`, `val`, `dev` or `test`; None: all samples.
        labels: name of a label set, such as `rect`; None: without harm.

    Raises:
        HarmzoneError: no data set, no such labels, labels of another data set, no episode of the split.

    """

    def __init__(
        self, path: str | os.PathLike[str], *, split: str | None = None, labels: str | None = None
    ) -> None:
        self._how = (path, split, labels)
        self._native = _native.Dataset(path, split, labels)

    @classmethod
    def _when_read(
        cls, path: str | os.PathLike[str], *, split: str | None = None, labels: str | None = None
    ) -> Dataset:
        """One that is not opened before it is read."""
        data = cls.__new__(cls)
        data._how = (path, split, labels)
        return data

    @cached_property
    def _native(self) -> _native.Dataset:
        return _native.Dataset(*self._how)

    def __len__(self) -> int:
        return len(self._native)

    def __getitem__(self, idx: int) -> Sample:
        return self._native[idx]

    def __iter__(self) -> Iterator[Sample]:
        return (self[idx] for idx in range(len(self)))

    def __repr__(self) -> str:
        path, split, labels = self._how
        return f"Dataset({str(path)!r}, split={split!r}, labels={labels!r}): {len(self)} samples"

    def __getstate__(self) -> object:
        return self._how

    def __setstate__(self, how: tuple[Any, str | None, str | None]) -> None:
        path, split, labels = how
        self.__init__(path, split=split, labels=labels)

    @property
    def path(self) -> Path:
        """The data set's folder; of a URL the folder on this machine that its files are fetched to."""
        return Path(self._native.path)

    @property
    def place(self) -> Path | str:
        """What commands take: the data set's folder, or its URL."""
        given = self._how[0]
        return os.fspath(given) if is_url(given) else self.path

    @property
    def split(self) -> str | None:
        """The split's name; None: all samples."""
        return self._how[1]

    @property
    def labels(self) -> str | None:
        """The label set's name."""
        return self._how[2]

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """The manifest's entries: name, file, split, seed, town, weather, ood, n_samples, sha256."""
        return self._native.episodes


def to_torch(sample: Sample) -> dict[str, Any]:
    """A sample as tensors.

    Returns:
        `points` (N, 5) float32: x, y, z (m, LiDAR frame), intensity, ring; `image` (3, H, W) uint8;
        `boxes` (M, 7) float32, ego frame; `harmful` (M,) bool, in a labelled data set; `intrinsics` (3, 3),
        `ego_from_lidar`, `ego_from_camera` (4, 4) float32; `state` (2,) float32: speed (m/s), steering angle
        (rad); `id`.

    Raises:
        ModuleNotFoundError: PyTorch is not installed.

    """
    import torch

    def floats(array: NDArray[Any]) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))

    ego = sample.ego
    tensors = {
        "id": sample.id,
        "points": torch.from_numpy(sample.points),
        "image": torch.from_numpy(np.ascontiguousarray(sample.image.transpose(2, 0, 1))),
        "boxes": floats(sample.boxes),
        "intrinsics": floats(sample.intrinsics),
        "ego_from_lidar": floats(sample.ego_from_lidar),
        "ego_from_camera": floats(sample.ego_from_camera),
        "state": torch.tensor([ego["speed_mps"], ego["steering_angle_rad"]], dtype=torch.float32),
    }
    harmful = sample.harmful
    if harmful is not None:
        tensors["harmful"] = torch.from_numpy(harmful)
    return tensors


def collate(samples: Sequence[Sample]) -> dict[str, Any]:
    """A batch of samples, for a `DataLoader`'s `collate_fn`.

    Returns:
        As `to_torch`: what has one size is stacked, with the batch first; `points`, `boxes`, `harmful` and
        `id` are lists of one entry a sample, and so are pictures where their sizes differ.

    """
    import torch

    tensors = [to_torch(sample) for sample in samples]
    lists = {"id", "points", "boxes", "harmful"}
    if len({tuple(of["image"].shape) for of in tensors}) > 1:
        lists.add("image")

    batch = {name: [of[name] for of in tensors] for name in tensors[0]}
    return {name: each if name in lists else torch.stack(each) for name, each in batch.items()}
