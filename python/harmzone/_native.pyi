"""The extension module, written in Rust."""

import os
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

__version__: str

class HarmzoneError(Exception): ...

def main(words: list[str]) -> NoReturn: ...

class Dataset:
    def __new__(
        cls, path: str | os.PathLike[str], split: str | None = None, labels: str | None = None
    ) -> Dataset: ...
    def __len__(self) -> int: ...
    def __getitem__(self, idx: int) -> Sample: ...
    @property
    def path(self) -> os.PathLike[str]: ...
    @property
    def labels(self) -> str | None: ...
    @property
    def episodes(self) -> list[dict[str, Any]]: ...

class Sample:
    @property
    def id(self) -> str:
        """`<episode>/<sample index>`."""
    @property
    def time_ns(self) -> int:
        """Nanoseconds since the Unix epoch; in simulation from a fixed start."""
    @property
    def points(self) -> NDArray[np.float32]:
        """(N, 5): x, y, z (m, LiDAR frame), intensity (0 to 255), ring (0 the lowest).

        Cut to the camera's field of view.
        """
    @property
    def image(self) -> NDArray[np.uint8]:
        """(H, W, 3): RGB, row by row from the top."""
    @property
    def encoded_image(self) -> bytes:
        """The picture as the episode holds it: JPEG or PNG."""
    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """(3, 3): pixels from the camera frame, x to the right, y down, z ahead."""
    @property
    def ego_from_lidar(self) -> NDArray[np.float64]:
        """(4, 4)."""
    @property
    def ego_from_camera(self) -> NDArray[np.float64]:
        """(4, 4)."""
    @property
    def world_from_ego(self) -> NDArray[np.float64]:
        """(4, 4)."""
    @property
    def ego(self) -> dict[str, float]:
        """The ego's state as measured; labels use `true_ego`.

        speed_mps, steering_angle_rad, yaw_rate_rps, acceleration_mps2, wheelbase_m, front_bumper_x_m.
        """
    @property
    def true_ego(self) -> dict[str, float]:
        """The state by which objects are labelled."""
    @property
    def is_annotated(self) -> bool:
        """Whether it is known what was there."""
    @property
    def boxes(self) -> NDArray[np.float64]:
        """(M, 7): x, y, z of the centre, length, width, height (m), yaw (rad), ego frame.

        In simulation of the objects in the picture, in a log of all that it has.
        """
    @property
    def velocities(self) -> NDArray[np.float64]:
        """(M, 2): over ground, along the ego's x and y, m/s; NaN where unknown."""
    @property
    def harmful(self) -> NDArray[np.bool_] | None:
        """(M,): the labels; None in a data set without.

        They use `true_ego` and the solid part of an object: `Zone.harmful(boxes, ego)` may differ.
        """
    @property
    def object_ids(self) -> list[str | None]: ...
    @property
    def categories(self) -> list[str | None]:
        """The model's family: `car`, `child`, `hay_bale`."""
    @property
    def kinds(self) -> list[str | None]:
        """`vehicle`, `pedestrian` or `static`."""
    @property
    def distributions(self) -> list[str | None]:
        """`id`, or `ood` for kinds that no training set holds."""
    @property
    def events(self) -> list[str | None]:
        """What it does: `none`, `lies`, `falls`, `rolls`, `thrown`."""
    @property
    def n_lidar_points(self) -> list[int | None]: ...
    @property
    def visible_px(self) -> list[int | None]: ...

class Zone:
    def __new__(cls, settings: list[str] = ...) -> Zone: ...
    def harmful(
        self, boxes: NDArray[np.float64], ego: dict[str, float], velocities: NDArray[np.float64] | None = None
    ) -> NDArray[np.bool_]:
        """Judges whole boxes; labels use `Sample.true_ego` and the solid part of an object: may differ."""
    def corners(self, ego: dict[str, float]) -> NDArray[np.float64]: ...

class Detector:
    def __new__(cls, run: str | os.PathLike[str], device: str = "cpu") -> Detector: ...
    @property
    def operating_score(self) -> float: ...
    def predict(
        self, samples: list[Sample]
    ) -> list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]]: ...
