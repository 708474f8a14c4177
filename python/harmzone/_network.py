"""Trained detectors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harmzone import _native
from harmzone._data import Boxes, Sample

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence


class Detector:
    """A trained network.

    Args:
        run: a run's folder, a checkpoint, or `small`, the network inside.
        device: `cpu`, or `cuda:N` or `vulkan:N` in a build with that backend.

    Raises:
        HarmzoneError: no such network, or device.

    """

    def __init__(self, run: str | os.PathLike[str] = "small", *, device: str = "cpu") -> None:
        self._native = _native.Detector(run, device)

    @property
    def operating_score(self) -> float:
        """The score from which on it warns."""
        return self._native.operating_score

    def predict(self, samples: Sample | Sequence[Sample]) -> Boxes | list[Boxes]:
        """Boxes of one sample, or of each of several, which all cores share.

        Raises:
            HarmzoneError: a picture is broken, a state is not finite, or the network tells kinds, not harm.

        """
        if isinstance(samples, Sample):
            return Boxes(*self._native.predict([samples])[0])
        return [Boxes(*found) for found in self._native.predict(list(samples))]
