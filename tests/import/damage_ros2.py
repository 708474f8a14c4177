"""Damages to ROS 2 bags, written again through `rosbags`."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from damage_case import case, write


def rewrite_bag(root: Path, change: Callable[[str, str, object], object]) -> None:
    """Writes a bag again, message by message, through rosbags; `change` gives a message, changed, or None to
    drop it.
    """
    from ros2_messages import STORE
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer

    other = root.with_name(root.name + ".new")
    with Reader(root) as reader, Writer(other, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for connection, time_ns, payload in reader.messages():
            message = change(
                connection.topic, connection.msgtype, STORE.deserialize_cdr(payload, connection.msgtype)
            )
            if message is None:
                continue
            if connection.topic not in connections:
                connections[connection.topic] = writer.add_connection(
                    connection.topic, connection.msgtype, typestore=STORE
                )
            writer.write(
                connections[connection.topic], time_ns, STORE.serialize_cdr(message, connection.msgtype)
            )
    shutil.rmtree(root)
    other.rename(root)


def edit_points(root: Path, change: Callable[[np.ndarray], None]) -> None:
    """Changes x, y, z, intensity of the clouds, given as [n, step] bytes seen as float32 columns 0, 1, 2,
    4.
    """

    def one(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("PointCloud2"):
            data = message.data.copy()
            columns = data.view("<f4").reshape(-1, message.point_step // 4)
            change(columns)
            message.data = data
        return message

    rewrite_bag(root, one)


@case("ros2", "the bag is cut", r"mcap|cut|end|index|footer|recover", fails=True)
def _(root: Path) -> None:
    (path,) = root.glob("*.mcap")
    write(path, path.read_bytes()[: path.stat().st_size * 2 // 3])


@case("ros2", "one byte in a chunk is changed", r"crc|chunk|damage|torn|cdr", fails=True)
def _(root: Path) -> None:
    (path,) = root.glob("*.mcap")
    payload = bytearray(path.read_bytes())
    payload[len(payload) // 2] ^= 0xFF
    write(path, bytes(payload))


@case("ros2", "no /tf_static", r"tf|transform|frame", fails=True)
def _(root: Path) -> None:
    rewrite_bag(root, lambda topic, _kind, message: None if topic == "/tf_static" else message)


@case("ros2", "a cloud's frame_id that no transform names", r"frame|transform|tf", fails=True)
def _(root: Path) -> None:
    def change(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("PointCloud2"):
            message.header.frame_id = "somewhere"
        return message

    rewrite_bag(root, change)


@case("ros2", "CameraInfo's size unlike the picture's", r"size|width|621|1242")
def _(root: Path) -> None:
    def change(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("CameraInfo"):
            message.width, message.height = 621, 187
        return message

    rewrite_bag(root, change)


@case("ros2", "no CameraInfo", r"camera_?info|calibration|camera")
def _(root: Path) -> None:
    rewrite_bag(root, lambda _topic, kind, message: None if kind.endswith("CameraInfo") else message)


@case("ros2", "clouds in millimetres", r"millimet|units?|metres|mm\b")
def _(root: Path) -> None:
    def change(columns: np.ndarray) -> None:
        columns[:, :3] *= 1000

    edit_points(root, change)


@case("ros2", "NaN points", r"nan|not (a )?(number|finite)|finite")
def _(root: Path) -> None:
    def change(columns: np.ndarray) -> None:
        columns[:50, :3] = np.nan

    edit_points(root, change)


@case("ros2", "empty clouds", r"empty|no points?|0 points")
def _(root: Path) -> None:
    def change(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("PointCloud2"):
            message.data, message.width, message.row_step = message.data[:0], 0, 0
        return message

    rewrite_bag(root, change)


@case("ros2", "a cloud's data shorter than width x step", r"bytes|width|step|data", fails=True)
def _(root: Path) -> None:
    def change(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("PointCloud2"):
            message.data = message.data[:-100]
        return message

    rewrite_bag(root, change)


def late_pictures(root: Path, milliseconds: int) -> None:
    """Sets the pictures' stamps that much after the clouds'."""

    def change(topic: str, kind: str, message: object) -> object:
        if kind.endswith(("CompressedImage", "CameraInfo", "/Image")):
            time_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            grid = round((time_ns + 10_000_000) / 100_000_000) * 100_000_000 + milliseconds * 1_000_000
            message.header.stamp.sec, message.header.stamp.nanosec = grid // 10**9, grid % 10**9
        return message

    rewrite_bag(root, change)


@case("ros2", "pictures 35 ms late (within the tolerance)", r"^", fails=False)
def _(root: Path) -> None:
    late_pictures(root, 35)


@case("ros2", "pictures 60 ms late", r"ms|stamp|tolerance|60|within")
def _(root: Path) -> None:
    # Every other picture is gone, else the one before is 40 ms early and close enough.
    late_pictures(root, 60)
    kept = {"n": 0}

    def change(_topic: str, kind: str, message: object) -> object | None:
        if kind.endswith("CompressedImage"):
            kept["n"] += 1
            return message if kept["n"] % 2 else None
        return message

    rewrite_bag(root, change)


@case("ros2", "a CompressedImage that is no picture", r"picture|image|png|jpe?g")
def _(root: Path) -> None:
    def change(_topic: str, kind: str, message: object) -> object:
        if kind.endswith("CompressedImage"):
            message.data = message.data[:200]
        return message

    rewrite_bag(root, change)


@case("ros2", "camera in body axes", r"optical|ax[ei]s|forward|down")
def _(root: Path) -> None:
    def change(topic: str, _kind: str, message: object) -> object:
        if topic == "/tf_static":
            for one in message.transforms:
                if "camera" in one.child_frame_id:
                    r = one.transform.rotation
                    r.x, r.y, r.z, r.w = 0.0, 0.0, 0.0, 1.0
        return message

    rewrite_bag(root, change)
