"""Reads imported episodes with nothing but the public MCAP and protobuf packages, as numpy arrays.

Knows nothing of harmzone's code: schemas come from the files, meanings from docs/episode_format.md.
Frames: a 4x4 matrix `a_from_b` takes points of b to a. Metres, radians, nanoseconds.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

# foxglove.PackedElementField's types.
NUMPY_TYPES = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}


def matrix(translation: object, rotation: object) -> np.ndarray:
    """4x4 matrix of a translation (x, y, z) and a quaternion (x, y, z, w) message."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = [translation.x, translation.y, translation.z]
    return result


@dataclass
class Box:
    """An object of an episode: upright in the ego frame."""

    id: str
    category: str
    kind: str
    distribution: str
    center_m: np.ndarray
    size_m: np.ndarray  # length, width, height
    yaw_rad: float
    velocity_mps: np.ndarray
    n_lidar_points: int

    def corners_m(self) -> np.ndarray:
        """The eight corners in ego [8, 3], in the order of `corner_signs`."""
        return upright_corners(self.center_m, self.size_m, self.yaw_rad)


# Front left top first; the same order everywhere, so that corners compare one to one.
corner_signs = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]) / 2.0


def upright_corners(center_m: np.ndarray, size_m: np.ndarray, yaw_rad: float) -> np.ndarray:
    """Corners [8, 3] of an upright box; size is length, width, height."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return (corner_signs * size_m) @ turn.T + center_m


@dataclass
class Camera:
    """One camera's picture and calibration at a sample."""

    image: bytes
    format: str
    width_px: int
    height_px: int
    k: np.ndarray
    p: np.ndarray
    d: list[float]
    ego_from_camera: np.ndarray

    def project(self, points_in_ego: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels [n, 2] and depths [n] of points in ego [n, 3]."""
        camera_from_ego = np.linalg.inv(self.ego_from_camera)
        in_camera = points_in_ego @ camera_from_ego[:3, :3].T + camera_from_ego[:3, 3]
        pixels = in_camera @ self.k.T
        return pixels[:, :2] / pixels[:, 2:], in_camera[:, 2]


@dataclass
class Moment:
    """Everything an episode holds for one sample."""

    time_ns: int
    world_from_ego: np.ndarray
    ego_from_lidar: np.ndarray
    cloud: dict[str, np.ndarray]
    state: dict[str, float]
    cameras: dict[str, Camera]
    boxes: list[Box] | None
    ignored: list[object] = field(default_factory=list)

    def points_in_ego(self) -> np.ndarray:
        """The cloud in ego [n, 3], in double."""
        points = np.stack([self.cloud[axis] for axis in "xyz"], axis=1).astype(float)
        return points @ self.ego_from_lidar[:3, :3].T + self.ego_from_lidar[:3, 3]


@dataclass
class Sweep:
    """A cloud of the top LiDAR between two samples, in the LiDAR's axes."""

    time_ns: int
    map_from_lidar: np.ndarray
    cloud: dict[str, np.ndarray]


@dataclass
class Episode:
    """An imported episode, whole."""

    path: Path
    metadata: dict[str, dict[str, str]]
    moments: list[Moment]
    sweeps: list[Sweep] = field(default_factory=list)

    @property
    def log(self) -> dict:
        """What the episode says of its source: the record `log`; empty if it has none."""
        return tomllib.loads(self.metadata.get("log", {}).get("facts_toml", ""))


def read_cloud(message: object) -> dict[str, np.ndarray]:
    """The fields of a foxglove.PointCloud by its own field table."""
    fields = [(one.name, NUMPY_TYPES[one.type], one.offset) for one in message.fields]
    layout = np.dtype(
        {
            "names": [name for name, _, _ in fields],
            "formats": [code for _, code, _ in fields],
            "offsets": [offset for _, _, offset in fields],
            "itemsize": message.point_stride,
        }
    )
    points = np.frombuffer(message.data, dtype=layout)
    return {name: points[name].copy() for name, _, _ in fields}


def enum_name(message: object, name: str) -> str:
    """Name of an enum field's value."""
    descriptor = message.DESCRIPTOR.fields_by_name[name]
    return descriptor.enum_type.values_by_number[getattr(message, name)].name


def read_box(one: object) -> Box:
    """A harmzone.Object."""
    return Box(
        one.id,
        one.category,
        enum_name(one, "kind"),
        enum_name(one, "distribution"),
        np.array([one.x_m, one.y_m, one.z_m]),
        np.array([one.length_m, one.width_m, one.height_m]),
        one.yaw_rad,
        np.array([one.vx_mps, one.vy_mps]),
        one.n_lidar_points,
    )


def read_messages(path: Path) -> tuple[dict[str, list], dict[str, dict[str, str]]]:
    """Every message of a file as (log time, decoded) by topic; and its metadata records."""
    topics: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
        metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    return topics, metadata


def read_episode(path: Path) -> Episode:
    """An episode with all of its samples."""
    topics, metadata = read_messages(path)
    by_time = {topic: dict(messages) for topic, messages in topics.items() if topic != "/map"}
    cameras = [topic.split("/")[1] for topic in topics if topic.endswith("/image_rect_compressed")]
    moments = []
    for time_ns, state in topics["/ego/state"]:
        frames = {
            one.child_frame_id: matrix(one.translation, one.rotation)
            for one in by_time["/tf"][time_ns].transforms
        }
        cloud = by_time["/lidar_top"][time_ns]
        assert cloud.frame_id == "lidar_top", cloud.frame_id
        views = {}
        for name in cameras:
            image = by_time[f"/{name}/image_rect_compressed"].get(time_ns)
            info = by_time[f"/{name}/camera_info"].get(time_ns)
            if image is None or info is None:
                continue
            views[name] = Camera(
                bytes(image.data),
                image.format,
                info.width,
                info.height,
                np.array(info.K).reshape(3, 3),
                np.array(info.P).reshape(3, 4),
                list(info.D),
                frames[name],
            )
        truth = by_time.get("/truth/objects", {}).get(time_ns)
        ignored = by_time.get("/truth/ignored", {}).get(time_ns)
        moments.append(
            Moment(
                time_ns,
                frames["ego"],
                frames["lidar_top"],
                read_cloud(cloud),
                {
                    one.name: getattr(state, one.name)
                    for one in state.DESCRIPTOR.fields
                    if one.message_type is None
                },
                views,
                None if truth is None else [read_box(one) for one in truth.objects],
                [] if ignored is None else list(ignored.regions),
            )
        )
    sweeps = [
        Sweep(time_ns, matrix(one.pose.position, one.pose.orientation), read_cloud(one))
        for time_ns, one in topics.get("/lidar_top/sweeps", [])
    ]
    return Episode(path, metadata, moments, sweeps)


def read_data_set(folder: Path) -> Iterator[Episode]:
    """The episodes that a data set's `dataset.json` names, in its order."""
    manifest = json.loads((folder / "dataset.json").read_text())
    for entry in manifest["episodes"]:
        yield read_episode(folder / entry["file"])
