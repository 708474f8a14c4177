"""Damages to data sets in our own format, as any tool may write them."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from damage_case import case, write


def rewrite_episode(
    root: Path, topic: str, change: Callable[[object], object], drop: int | None = None
) -> None:
    """Writes a data set's first episode again with one topic changed, and its new hash into the manifest."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer
    from mcap_protobuf.decoder import DecoderFactory

    manifest = json.loads((root / "dataset.json").read_text())
    path = root / manifest["episodes"][0]["file"]
    payload = path.read_bytes()
    path.unlink()
    with path.open("wb") as stream:
        reader = make_reader(io.BytesIO(payload), decoder_factories=[DecoderFactory()])
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="harmzone damaged")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, dict(record.metadata))
        schemas, channels, seen = {}, {}, 0
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            if channel.topic not in channels:
                if schema.name not in schemas:
                    schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, "protobuf", schemas[schema.name]
                )
            data, log_time = message.data, message.log_time
            if channel.topic == topic:
                seen += 1
                if drop is not None and seen == drop:
                    continue
                changed = change(decoded)
                data = changed.SerializeToString()
                stamp = getattr(changed, "timestamp", None)
                if stamp is not None and hasattr(stamp, "seconds"):
                    log_time = stamp.seconds * 10**9 + stamp.nanos
            writer.add_message(channels[channel.topic], log_time, data, log_time)
        writer.finish()
    manifest["episodes"][0]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    write(root / "dataset.json", json.dumps(manifest, indent=2))


def edit_episode_points(root: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Changes the clouds' points as a structured array."""
    layout = np.dtype(
        {"names": ["x", "y", "z", "intensity", "ring"], "formats": ["<f4"] * 4 + ["<u2"], "itemsize": 18}
    )

    def one(message: object) -> object:
        message.data = change(np.frombuffer(message.data, dtype=layout).copy()).tobytes()
        return message

    rewrite_episode(root, "/lidar_top", one)


@case("episodes", "wrong sha256 in dataset.json", r"sha-?256|hash")
def _(root: Path) -> None:
    text = (root / "dataset.json").read_text()
    write(
        root / "dataset.json",
        re.sub(r'("sha256": ")(.)', lambda m: m[1] + ("0" if m[2] != "0" else "1"), text, count=1),
    )


@case("episodes", "one byte of an episode is changed", r"crc|damage|chunk|sha-?256|hash")
def _(root: Path) -> None:
    path = root / json.loads((root / "dataset.json").read_text())["episodes"][0]["file"]
    payload = bytearray(path.read_bytes())
    payload[len(payload) // 2] ^= 0x10
    write(path, bytes(payload))


@case("episodes", "an episode is missing", r"\.mcap")
def _(root: Path) -> None:
    (root / json.loads((root / "dataset.json").read_text())["episodes"][0]["file"]).unlink()


@case("episodes", "bad JSON in dataset.json", r"dataset\.json")
def _(root: Path) -> None:
    write(root / "dataset.json", (root / "dataset.json").read_text()[:-40])


@case("episodes", "the cloud has a pose of its own (which is applied)", r"^", fails=False)
def _(root: Path) -> None:
    def change(message: object) -> object:
        message.pose.position.x = 1.5
        message.pose.orientation.w = 1.0
        return message

    rewrite_episode(root, "/lidar_top", change)


@case("episodes", "the cloud's frame_id is another", r"frame")
def _(root: Path) -> None:
    def change(message: object) -> object:
        message.frame_id = "velodyne"
        return message

    rewrite_episode(root, "/lidar_top", change)


@case("episodes", "picture size unlike camera_info", r"size|pixels|\d+ ?[x×] ?\d+")
def _(root: Path) -> None:
    def change(message: object) -> object:
        message.width, message.height = message.width // 2, message.height // 2
        return message

    rewrite_episode(root, "/cam_front/camera_info", change)


@case("episodes", "intensity from 0 to 1", r"intensit")
def _(root: Path) -> None:
    def change(points: np.ndarray) -> np.ndarray:
        points["intensity"] /= 255
        return points

    edit_episode_points(root, change)


@case("episodes", "cloud in millimetres", r"millimet|units?|metres|mm\b")
def _(root: Path) -> None:
    def change(points: np.ndarray) -> np.ndarray:
        for axis in "xyz":
            points[axis] *= 1000
        return points

    edit_episode_points(root, change)


@case("episodes", "NaN points", r"nan|not (a )?(number|finite)|finite")
def _(root: Path) -> None:
    def change(points: np.ndarray) -> np.ndarray:
        points["x"][:9] = np.nan
        return points

    edit_episode_points(root, change)


@case("episodes", "empty clouds", r"empty|no points?|0 points")
def _(root: Path) -> None:
    edit_episode_points(root, lambda points: points[:0])


@case("episodes", "camera in body axes", r"optical|ax[ei]s|forward|down")
def _(root: Path) -> None:
    def change(message: object) -> object:
        for one in message.transforms:
            if one.child_frame_id == "cam_front":
                one.rotation.x, one.rotation.y, one.rotation.z, one.rotation.w = 0.0, 0.0, 0.0, 1.0
        return message

    rewrite_episode(root, "/tf", change)


def late(root: Path, milliseconds: int) -> None:
    """The front picture's stamps that much later."""

    def change(message: object) -> object:
        time_ns = message.timestamp.seconds * 10**9 + message.timestamp.nanos + milliseconds * 10**6
        message.timestamp.seconds, message.timestamp.nanos = time_ns // 10**9, time_ns % 10**9
        return message

    rewrite_episode(root, "/cam_front/image_rect_compressed", change)


@case("episodes", "front picture 35 ms late (within the tolerance)", r"^", fails=False)
def _(root: Path) -> None:
    late(root, 35)


@case("episodes", "front picture 60 ms late", r"ms|stamp|tolerance|cam_front")
def _(root: Path) -> None:
    late(root, 60)


@case("episodes", "one cloud is missing", r"lidar_top", fails=True)
def _(root: Path) -> None:
    rewrite_episode(root, "/lidar_top", lambda message: message, drop=1)
