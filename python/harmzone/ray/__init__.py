"""harmzone on a Ray cluster.

`gen`, `label`, `predict` and `evaluate` take `engine="ray"`, as the commands take `--engine ray`. The same
wheel, with Ray (`pip install 'harmzone-VERSION.whl[ray]'`), must be on every node. docs/scaling.md has more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

# Every process of a cluster imports this: numpy, and PyTorch behind `Dataset`, only where data are read.
if TYPE_CHECKING:
    import os

    import numpy as np
    import ray.data
    from numpy.typing import NDArray

__all__ = ["read"]


def read(
    path: str | os.PathLike[str], *, split: str | None = None, labels: str | None = None
) -> ray.data.Dataset:
    """Read a data set with Ray Data: a row a sample, a read task an episode.

    The folder must be at this path on every node.

    Args:
        path: the folder that `gen` or `import` made.
        split: `train`, `val`, `dev` or `test`; None: all samples.
        labels: name of a label set, such as `rect`; None: without harm.

    Returns:
        Rows in the manifest's order with `id`, `episode`, `time_ns`; `points` (N, 5) float32: x, y, z (m,
        LiDAR frame), intensity, ring; `image` (H, W, 3) uint8; `boxes` (M, 7) float64: centre, length, width,
        height (m), yaw (rad), ego frame; `kinds` (M,); `harmful` (M,) bool, in a labelled data set;
        `intrinsics` (3, 3), `ego_from_lidar`, `ego_from_camera` (4, 4) float64; `speed_mps`,
        `steering_angle_rad` as measured.

    Raises:
        HarmzoneError: as `harmzone.Dataset`.

    """
    import numpy as np
    import ray.data

    from harmzone._data import Dataset

    data = Dataset(path, split=split, labels=labels)
    of_split = [entry for entry in data.episodes if split in (None, entry["split"])]
    ends = np.cumsum([entry["n_samples"] for entry in of_split])
    ranges = [
        {"begin": int(end) - entry["n_samples"], "end": int(end)}
        for entry, end in zip(of_split, ends, strict=True)
    ]

    def rows_of(part: dict[str, int]) -> list[dict[str, Any]]:
        return [_row_of(data[idx]) for idx in range(part["begin"], part["end"])]

    return ray.data.from_items(ranges, override_num_blocks=len(ranges)).flat_map(rows_of)


def _row_of(sample: Any) -> dict[str, Any]:  # noqa: ANN401
    """A sample as a row of Ray Data."""
    row: dict[str, Any] = {
        "id": sample.id,
        "episode": sample.id.rpartition("/")[0],
        "time_ns": sample.time_ns,
        "points": sample.points,
        "image": sample.image,
        "boxes": _rows(sample.boxes),
        "kinds": _column(sample.kinds),
        "intrinsics": sample.intrinsics,
        "ego_from_lidar": sample.ego_from_lidar,
        "ego_from_camera": sample.ego_from_camera,
        "speed_mps": sample.ego["speed_mps"],
        "steering_angle_rad": sample.ego["steering_angle_rad"],
    }
    if sample.harmful is not None:
        row["harmful"] = sample.harmful
    return row


def _column(texts: list[str | None]) -> NDArray[np.object_]:
    """Texts of any length."""
    import numpy as np

    return np.array(texts, dtype=object)


def _rows(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """`(0, 7)` for none."""
    return boxes.reshape(-1, 7)
