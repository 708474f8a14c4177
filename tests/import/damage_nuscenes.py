"""Damages to nuScenes folders."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from damage_case import case, write


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


@case("nuscenes", "a cloud is cut by 7 bytes", r"20|bytes|multiple|cut|whole", fails=True, skippable=True)
def _(root: Path) -> None:
    path = first_file(root, "LIDAR_TOP")
    write(path, path.read_bytes()[:-7])


@case("nuscenes", "a picture is missing", r"cam_front", fails=True, skippable=True)
def _(root: Path) -> None:
    first_file(root, "CAM_FRONT").unlink()


@case("nuscenes", "a picture is cut", r"cam_front|picture|jpe?g", fails=True, skippable=True)
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
