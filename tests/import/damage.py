"""Damages inputs in forty ways, runs the program on each, and tabulates what it says and what it leaves
behind.

Usage: damage.py HARMZONE --kitti DIR --av2 DIR --nuscenes DIR --bag DIR --episodes DIR [--only WORD] [--keep
DIR]

Verdicts: `told` the message names the fault (an error, or a sentence beside a result); `SILENT` nothing of it
is said; `VAGUE` it fails, but no expected word is said; `PANIC` it ends by a panic or a signal; `HALF` it
leaves a data set that is not whole. Exit code 1 unless all are told.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class Case:
    """One damage: what is done to a copy of the source, and words of which the program must say one."""

    source: str
    name: str
    words: str  # a regular expression, in lower case
    damage: Callable[[Path], None]
    fails: bool | None = None  # whether it must fail (True), must go on (False), or either


CASES: list[Case] = []


def case(source: str, name: str, words: str, fails: bool | None = None) -> Callable:
    """Registers a damage."""

    def register(damage: Callable[[Path], None]) -> Callable[[Path], None]:
        CASES.append(Case(source, name, words, damage, fails))
        return damage

    return register


def write(path: Path, payload: bytes | str) -> None:
    """Replaces a file of the copy: its hard link to the source is cut first."""
    path.unlink(missing_ok=True)
    path.write_bytes(payload.encode() if isinstance(payload, str) else payload)


def copy(source: Path, target: Path) -> None:
    """A copy whose files are copied by link where the file system can."""
    shutil.copytree(source, target, copy_function=shutil.copyfile)


# ---- KITTI


def edit_cloud(root: Path, change: Callable[[np.ndarray], np.ndarray], names: tuple[str, ...] = ()) -> None:
    """Changes the points [n, 4] of all frames, or of some."""
    for path in sorted((root / "training/velodyne").glob("*.bin")):
        if not names or path.stem in names:
            points = change(np.fromfile(path, dtype="<f4").reshape(-1, 4).copy())
            write(path, points.astype("<f4").tobytes())


@case("kitti", "cloud cut by 7 bytes", r"16|multiple|bytes|cut|whole", fails=True)
def _(root: Path) -> None:
    path = root / "training/velodyne/000003.bin"
    write(path, path.read_bytes()[:-7])


@case("kitti", "a word in a label's number", r"label_2|line \d", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("1.57 1.73", "1.57 wide", 1))


@case("kitti", "a label's row is cut", r"label_2|line \d", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text()[:45] + "\n")


@case("kitti", "no calibration file", r"calib", fails=True)
def _(root: Path) -> None:
    (root / "training/calib/000003.txt").unlink()


@case("kitti", "no P2 in a calibration", r"p2", fails=True)
def _(root: Path) -> None:
    path = root / "training/calib/000003.txt"
    write(path, "".join(x for x in path.read_text().splitlines(True) if not x.startswith("P2")))


@case("kitti", "Tr_velo_to_cam is no rotation", r"rotation|orthogonal|tr_velo", fails=True)
def _(root: Path) -> None:
    path = root / "training/calib/000003.txt"
    write(path, path.read_text().replace("7.533745000000e-03", "7.533745000000e-01", 1))


@case("kitti", "cloud's x and y are swapped", r"ax[ei]s|swap|turned|no points?|point.* in .*box|boxes")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points[:, [1, 0, 2, 3]])


@case("kitti", "NaN points", r"nan|not (a )?(number|finite)|finite")
def _(root: Path) -> None:
    def change(points: np.ndarray) -> np.ndarray:
        points[5:25, 0] = np.nan
        return points

    edit_cloud(root, change)


@case("kitti", "empty cloud", r"empty|no points?|0 points")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points[:0], ("000003",))


@case("kitti", "cloud in millimetres", r"millimet|units?|metres|mm\b")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1000, 1000, 1000, 1])


@case("kitti", "intensity from 0 to 255", r"intensit|reflectance", fails=False)
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1, 1, 1, 255])


@case("kitti", "intensity from 0 to 65535", r"intensit|reflectance")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1, 1, 1, 65535])


@case("kitti", "picture of half the size", r"size|principal|calibration|centre|center")
def _(root: Path) -> None:
    from PIL import Image

    path = root / "training/image_2/000003.png"
    picture = Image.open(path)
    small = picture.resize((picture.width // 2, picture.height // 2))
    path.unlink()
    small.save(path)


@case("kitti", "picture cut in its middle", r"image_2|picture|png", fails=True)
def _(root: Path) -> None:
    path = root / "training/image_2/000003.png"
    write(path, path.read_bytes()[:20_000])


@case("kitti", "picture of another format under .png", r"image_2|picture|png|jpeg")
def _(root: Path) -> None:
    write(root / "training/image_2/000003.png", b"no picture at all" * 50)


@case("kitti", "no picture", r"image_2", fails=True)
def _(root: Path) -> None:
    (root / "training/image_2/000003.png").unlink()


@case("kitti", "a box of negative size", r"size|height|width|length", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("1.57 1.73 4.15", "1.57 -1.73 4.15", 1))


@case("kitti", "a category that the mapping does not name", r"tractor", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("Car ", "Tractor ", 1))


@case("kitti", "an empty folder", r"velodyne|training|no ", fails=True)
def _(root: Path) -> None:
    shutil.rmtree(root)
    root.mkdir()


# ---- Argoverse 2


def edit_table(root: Path, pattern: str, change: Callable) -> None:
    """Changes a feather table through pandas."""
    import pandas as pd

    (path,) = root.rglob(pattern)
    table = change(pd.read_feather(path))
    path.unlink()
    table.to_feather(path)


@case("av2", "no column qw in the annotations", r"qw", fails=True)
def _(root: Path) -> None:
    edit_table(root, "annotations.feather", lambda table: table.drop(columns="qw"))


@case("av2", "the sweep's table is cut", r"lidar|feather", fails=True)
def _(root: Path) -> None:
    (path,) = root.rglob("sensors/lidar/*.feather")
    write(path, path.read_bytes()[:300_000])


@case("av2", "one byte of the sweep is changed", r"lidar|feather|lz4|checksum|column|finite")
def _(root: Path) -> None:
    (path,) = root.rglob("sensors/lidar/*.feather")
    payload = bytearray(path.read_bytes())
    payload[len(payload) // 2] ^= 0xFF
    write(path, bytes(payload))


@case("av2", "no poses", r"city_se3|pose", fails=True)
def _(root: Path) -> None:
    (path,) = root.rglob("city_SE3_egovehicle.feather")
    path.unlink()


@case("av2", "rotations of poses are no unit quaternions", r"quaternion|unit|rotation|norm", fails=True)
def _(root: Path) -> None:
    edit_table(root, "city_SE3_egovehicle.feather", lambda t: t.assign(qw=t.qw * 1.5))


@case("av2", "cloud in millimetres", r"millimet|units?|metres|mm\b|finite")
def _(root: Path) -> None:
    (path,) = root.rglob("sensors/lidar/*.feather")
    name = path.name
    edit_table(
        root,
        name,
        lambda t: t.assign(x=t.x.astype("f4") * 1e3, y=t.y.astype("f4") * 1e3, z=t.z.astype("f4") * 1e3),
    )


# ---- nuScenes


def edit_rows(root: Path, table: str, change: Callable[[list], object]) -> None:
    """Changes a JSON table."""
    (path,) = root.glob(f"v1.0-*/{table}.json")
    rows = json.loads(path.read_text())
    changed = change(rows)
    write(path, json.dumps(rows if changed is None else changed))


def rows_of(root: Path, table: str) -> list[dict]:
    """A JSON table."""
    (path,) = root.glob(f"v1.0-*/{table}.json")
    return json.loads(path.read_text())


def sensor_rows(root: Path, channel: str) -> list[str]:
    """Tokens of a channel's calibrated_sensor rows."""
    sensors = {row["token"] for row in rows_of(root, "sensor") if row["channel"] == channel}
    return [row["token"] for row in rows_of(root, "calibrated_sensor") if row["sensor_token"] in sensors]


def first_file(root: Path, channel: str) -> Path:
    """A channel's first key frame."""
    calibrated = set(sensor_rows(root, channel))
    rows = rows_of(root, "sample_data")
    return root / next(
        r["filename"] for r in rows if r["is_key_frame"] and r["calibrated_sensor_token"] in calibrated
    )


@case("nuscenes", "a table is missing", r"ego_pose", fails=True)
def _(root: Path) -> None:
    (path,) = root.glob("v1.0-*/ego_pose.json")
    path.unlink()


@case("nuscenes", "a row that others name is missing", r"calibrated_sensor", fails=True)
def _(root: Path) -> None:
    gone = sensor_rows(root, "LIDAR_TOP")[0]
    edit_rows(root, "calibrated_sensor", lambda rows: [row for row in rows if row["token"] != gone])


@case("nuscenes", "an annotation's instance is missing", r"instance", fails=True)
def _(root: Path) -> None:
    edit_rows(root, "instance", lambda rows: rows[1:])


@case("nuscenes", "bad JSON", r"sample_annotation|line \d|json", fails=True)
def _(root: Path) -> None:
    (path,) = root.glob("v1.0-*/sample_annotation.json")
    write(path, path.read_text()[:-200])


@case("nuscenes", "a column is missing", r"translation", fails=True)
def _(root: Path) -> None:
    edit_rows(root, "ego_pose", lambda rows: rows[3].pop("translation") and None)


@case("nuscenes", "a rotation is no unit quaternion", r"quaternion|unit|rotation|norm", fails=True)
def _(root: Path) -> None:
    def change(rows: list) -> None:
        rows[0]["rotation"] = [value * 0.7 for value in rows[0]["rotation"]]

    edit_rows(root, "calibrated_sensor", change)


@case("nuscenes", "a cloud is cut by 7 bytes", r"20|bytes|multiple|cut|whole", fails=True)
def _(root: Path) -> None:
    path = first_file(root, "LIDAR_TOP")
    write(path, path.read_bytes()[:-7])


@case("nuscenes", "a picture is missing", r"cam_front", fails=True)
def _(root: Path) -> None:
    first_file(root, "CAM_FRONT").unlink()


@case("nuscenes", "a picture is cut", r"cam_front|picture|jpe?g", fails=True)
def _(root: Path) -> None:
    path = first_file(root, "CAM_FRONT")
    write(path, path.read_bytes()[:3000])


@case("nuscenes", "width and height unlike the pictures", r"size|width|1600|800")
def _(root: Path) -> None:
    def change(rows: list) -> None:
        for row in rows:
            if row["fileformat"] == "jpg":
                row["width"], row["height"] = 800, 450

    edit_rows(root, "sample_data", change)


def delay(root: Path, channel: str, milliseconds: int) -> None:
    """Moves a channel's stamps against the cloud's, so that they are that much late."""
    calibrated = set(sensor_rows(root, channel))
    lidar = set(sensor_rows(root, "LIDAR_TOP"))
    rows = rows_of(root, "sample_data")
    clouds = {
        r["sample_token"]: r["timestamp"]
        for r in rows
        if r["calibrated_sensor_token"] in lidar and r["is_key_frame"]
    }
    moved = {}
    for row in rows:
        if row["calibrated_sensor_token"] in calibrated:
            row["timestamp"] = clouds[row["sample_token"]] + milliseconds * 1000
            moved[row["ego_pose_token"]] = row["timestamp"]
    edit_rows(root, "sample_data", lambda _: rows)

    def change(poses: list) -> None:
        for row in poses:
            row["timestamp"] = moved.get(row["token"], row["timestamp"])

    edit_rows(root, "ego_pose", change)


@case("nuscenes", "front picture 35 ms late (within the tolerance)", r"^", fails=False)
def _(root: Path) -> None:
    delay(root, "CAM_FRONT", 35)


@case("nuscenes", "front picture 60 ms late", r"ms|stamp|tolerance|60")
def _(root: Path) -> None:
    delay(root, "CAM_FRONT", 60)


@case("nuscenes", "camera in body axes", r"optical|ax[ei]s|forward|down")
def _(root: Path) -> None:
    chosen = set(sensor_rows(root, "CAM_FRONT"))

    def change(rows: list) -> None:
        for row in rows:
            if row["token"] in chosen:
                row["rotation"] = [0.99999, 0.0, 0.0, 0.004472]

    edit_rows(root, "calibrated_sensor", change)


@case("nuscenes", "one ego pose is 500 m off", r"pose|m/s|speed|jump|km/h")
def _(root: Path) -> None:
    calibrated = set(sensor_rows(root, "LIDAR_TOP"))
    rows = [
        r
        for r in rows_of(root, "sample_data")
        if r["is_key_frame"] and r["calibrated_sensor_token"] in calibrated
    ]
    wrong = rows[2]["ego_pose_token"]

    def change(poses: list) -> None:
        for row in poses:
            if row["token"] == wrong:
                row["translation"][0] += 500.0

    edit_rows(root, "ego_pose", change)


@case(
    "nuscenes",
    "LiDAR's axes: the mounting lacks its quarter turn",
    r"ax[ei]s|turn|point.*box|boxes|mount|camera",
)
def _(root: Path) -> None:
    chosen = set(sensor_rows(root, "LIDAR_TOP"))

    def change(rows: list) -> None:
        for row in rows:
            if row["token"] in chosen:
                row["rotation"] = [1.0, 0.0, 0.0, 0.0]

    edit_rows(root, "calibrated_sensor", change)


@case("nuscenes", "a category that the mapping does not name", r"spaceship", fails=True)
def _(root: Path) -> None:
    def change(rows: list) -> None:
        for row in rows:
            if row["name"] == "vehicle.truck":
                row["name"] = "vehicle.spaceship"

    edit_rows(root, "category", change)


@case("nuscenes", "intensity from 0 to 1", r"intensit", fails=False)
def _(root: Path) -> None:
    for path in root.rglob("*.pcd.bin"):
        points = np.fromfile(path, dtype="<f4").reshape(-1, 5).copy()
        points[:, 3] /= 255
        write(path, points.tobytes())


@case("nuscenes", "CAN speed in m/s where km/h is meant", r"speed|can")
def _(root: Path) -> None:
    for path in (root / "can_bus").glob("*_vehicle_monitor.json"):
        rows = json.loads(path.read_text())
        for row in rows:
            row["vehicle_speed"] /= 3.6
        write(path, json.dumps(rows))
    for path in (root / "can_bus").glob("*_zoe_veh_info.json"):
        path.unlink()
    for path in (root / "can_bus").glob("*_pose.json"):
        path.unlink()


@case("nuscenes", "bad JSON in the CAN bus", r"can_bus|vehicle_monitor|json")
def _(root: Path) -> None:
    for path in (root / "can_bus").glob("*_vehicle_monitor.json"):
        write(path, path.read_text()[:-30])


# ---- ROS 2


def rewrite_bag(root: Path, change: Callable[[str, str, object], object]) -> None:
    """Writes a bag again, message by message, through rosbags; `change` gives a message, changed, or None to
    drop it.
    """
    from make_ros2_bag import STORE
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


@case("ros2", "one byte in a chunk is changed", r"crc|chunk|damage|mcap|cdr", fails=True)
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


# ---- harmzone's own data sets, as any tool may write them


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
        import io

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


@case("episodes", "the cloud has a pose of its own", r"pose")
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


# ---- running


def is_whole(out: Path) -> str:
    """What is wrong with what lies in OUT; empty if nothing, or a whole data set."""
    if not out.exists():
        return ""
    partial = [str(path.relative_to(out)) for path in out.rglob("*.partial")]
    if partial:
        return f"left {partial[0]}"
    manifest = out / "dataset.json"
    if not manifest.exists():
        episodes = list(out.rglob("*.mcap"))
        # Whole episodes without a manifest are what a later run goes on from.
        return "" if not episodes else f"(no dataset.json; {len(episodes)} whole episodes kept)"
    for entry in json.loads(manifest.read_text())["episodes"]:
        path = out / entry["file"]
        if not path.exists():
            return f"dataset.json names {entry['file']}, which is not there"
        if hashlib.sha256(path.read_bytes()).hexdigest() != entry["sha256"]:
            return f"the hash of {entry['file']} is another"
    return ""


def run_case(program: Path, one: Case, sources: dict[str, Path], folder: Path, extra: list[str]) -> list[str]:
    """Runs the program on a damaged copy; a row of the table."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    root, out = folder / "source", folder / "out"
    copy(sources[one.source], root)
    one.damage(root)
    if one.source == "episodes":
        commands = [["doctor", str(root)], ["label", str(root), "--out", "d"], ["info", str(root)]][:1]
    else:
        commands = [["import", one.source, str(root), "--out", str(out), *extra]]
    said, code = "", 0
    for command in commands:
        done = subprocess.run([program, *command], capture_output=True, text=True, timeout=280, check=False)
        code = code or done.returncode
        said += done.stderr + done.stdout
        (folder / "said.txt").write_text(said)
    lines = [line.strip() for line in said.replace("\r", "\n").splitlines() if line.strip()]
    spoken = [line for line in lines if re.search(one.words, line.replace(str(folder), "").lower())]
    half = "" if one.source == "episodes" else is_whole(out)
    if code < 0 or code == 101 or "panicked" in said:
        verdict = "PANIC"
    elif half and not half.startswith("("):
        verdict = "HALF"
    elif one.fails is False and code not in (0, 3):
        verdict = "REFUSED"
    elif not spoken:
        verdict = "SILENT" if code == 0 else "VAGUE"
    elif one.fails is True and code == 0:
        verdict = "WENT ON"
    else:
        verdict = "told"
    shown = spoken[-1] if spoken and one.words != "^" else (lines[-1] if lines else "")
    shown = shown.replace(str(folder), "")
    return [one.source, one.name, str(code), verdict, half, shown[:230]]


def main() -> int:
    """Runs the cases whose sources are given."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    for source in ("kitti", "av2", "nuscenes", "bag", "episodes"):
        parser.add_argument(f"--{source}", type=Path)
    parser.add_argument("--only", default="", help="run the cases whose source and name hold this")
    parser.add_argument("--extra", default="", help="further flags for import, with spaces")
    parser.add_argument("--keep", type=Path, help="keep the damaged inputs and outputs here")
    options = parser.parse_args()
    sources = {
        "kitti": options.kitti,
        "av2": options.av2,
        "nuscenes": options.nuscenes,
        "ros2": options.bag,
        "episodes": options.episodes,
    }
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for idx, one in enumerate(CASES):
            if sources[one.source] is None or options.only not in f"{one.source} {one.name}":
                continue
            folder = (options.keep or Path(temporary)) / f"{idx:02d}"
            row = run_case(options.program.resolve(), one, sources, folder, options.extra.split())
            rows.append(row)
            print(
                f"{row[3]:<8} {row[2]:>4}  {row[0]:<9} {row[1]}\n               {row[4]} {row[5]}", flush=True
            )
            if options.keep is None:
                shutil.rmtree(folder)
    bad = [row for row in rows if row[3] != "told"]
    print(f"{len(rows)} cases, {len(rows) - len(bad)} told, {len(bad)} not")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
