"""The danger zone: the ground that the ego will soon need."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harmzone import _native
from harmzone._settings import by_dotted_key, toml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray


class Zone:
    """A rule by which objects are harmful; docs/zones.md has the formulas.

    >>> import harmzone
    >>> ego = {"speed_mps": 10, "steering_angle_rad": 0, "yaw_rate_rps": 0, "acceleration_mps2": 0,
    ...     "wheelbase_m": 2.7, "front_bumper_x_m": 3.6}
    >>> harmzone.Zone("rect").harmful([[20, 0, 0.5, 1, 1, 1, 0], [20, 6, 0.5, 1, 1, 1, 0]], ego).tolist()
    [True, False]

    Args:
        kind: `rect`, the paper's; `arc`, `ttc` or `rss`.
        settings: keys of configs/zone.toml, such as `width_m=4`; tables as dictionaries:
            `ttc={"horizon_s": 3}`.

    Raises:
        HarmzoneError: no such kind or key, or a value that is not valid.
        TypeError: a value that is no number, text, list or dictionary.

    """

    def __init__(self, kind: str = "rect", **settings: float | dict[str, float]) -> None:
        words = [f"{key}={toml(key, value)}" for key, value in by_dotted_key(settings)]
        self._native = _native.Zone([f"kind={kind}", *words])

    def harmful(
        self, boxes: ArrayLike, ego: Mapping[str, float], velocities: ArrayLike | None = None
    ) -> NDArray[np.bool_]:
        """Whether each box is harmful.

        The answer may differ from `Sample.harmful`. Labels use `Sample.true_ego`, not the measured
        `Sample.ego`, and judge the solid part of an object and its height above the ground under it. This
        judges the whole box, and its height above the ego's plane.

        Args:
            boxes: (N, 7): x, y, z, length, width, height (m), yaw (rad), ego frame.
            ego: the ego's state, as `Sample.true_ego` or `Sample.ego` gives it.
            velocities: (N, 2): over ground, along the ego's x and y, m/s; None: all stand. Only `ttc` and
                `rss` use them.

        Raises:
            HarmzoneError: a number is not finite, or a size not above zero.
            ValueError: an array has another shape.

        """
        given = None if velocities is None else _rows(velocities, 2, "velocities")
        return self._native.harmful(_rows(boxes, 7, "boxes"), dict(ego), given)

    def corners(self, ego: Mapping[str, float]) -> NDArray[np.float64]:
        """The zone's corners on the ground, (N, 2): x, y, m, ego frame."""
        return self._native.corners(dict(ego))


def _rows(array: ArrayLike, n_columns: int, name: str) -> NDArray[np.float64]:
    rows = np.asarray(array, dtype=np.float64)
    if rows.size == 0:
        return rows.reshape(0, n_columns)
    if rows.ndim != 2 or rows.shape[1] != n_columns:
        raise ValueError(f"{name} have the shape {rows.shape}; (N, {n_columns}) is needed")
    return rows
