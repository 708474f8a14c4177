"""Makes a small nuScenes folder in nuScenes' real conventions, whose truth is known exactly.

Usage: make_nuscenes.py OUT [--scenes N] [--samples N] [--sweeps N] [--columns N]

True to the original: LIDAR_TOP's axes are x right, y forward; calibrated_sensor rows are turned; each
sample_data has an ego_pose of its own at its own time (the cameras' unlike the LiDAR's), with a little roll
and pitch; boxes are upright in global; micro-seconds; sizes width, length, height; CAN bus files, but for the
last scene, as in the original where some lack them. Numbers of sensors are those of a real sample (docs of
the anchors in mmdetection3d's demo file). `OUT/truth.json` holds the speed and steering of each sample.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

import numpy as np
from made_world import FORWARD_FROM_OPTICAL, Drive, Thing, inside, paint, pose, quaternion, scan, turn
from nuscenes_can_bus import save_can_bus
from PIL import Image

VERSION = "v1.0-mini"
SCENES = ["scene-0061", "scene-0103", "scene-0553", "scene-0916", "scene-0655", "scene-0757"]
ELEVATIONS_RAD = np.radians(np.linspace(-30.67, 10.67, 32))

# name: (place in ego, yaw and pitch of the optical axis in degrees, fx, cx, cy, milliseconds against the
# LiDAR)
CAMERAS = {
    "CAM_FRONT": ([1.7008, 0.0159, 1.5110], 0.3, -0.3, 1266.417, 816.267, 491.507, -35.5),
    "CAM_FRONT_RIGHT": ([1.5508, -0.4934, 1.4957], -56.4, -0.8, 1260.847, 807.968, 495.334, -27.6),
    "CAM_BACK_RIGHT": ([1.0149, -0.4806, 1.5624], -110.8, -0.9, 1259.514, 807.253, 501.196, -19.8),
    "CAM_BACK": ([0.0283, 0.0035, 1.5791], 179.9, 1.0, 809.221, 829.220, 481.778, -10.4),
    "CAM_BACK_LEFT": ([1.0357, 0.4848, 1.5910], 108.6, -0.9, 1256.741, 792.113, 492.776, -0.5),
    "CAM_FRONT_LEFT": ([1.5239, 0.4946, 1.5093], 55.2, 0.1, 1272.598, 826.615, 479.752, -43.3),
}
EGO_FROM_LIDAR = pose(turn(np.radians(-89.883), np.radians(0.92), np.radians(-0.32)), [0.9437, 0.0, 1.8402])

# Category, metres ahead and to the left of the start, size, yaw against the drive in degrees, speed,
# attribute
THINGS = [
    ("vehicle.car", 14.0, 1.5, (4.62, 1.93, 1.74), 2.0, 7.0, "vehicle.moving"),
    ("vehicle.car", 22.0, -3.4, (4.21, 1.83, 1.53), -1.5, 0.0, "vehicle.parked"),
    ("vehicle.car", 38.0, 4.6, (4.93, 2.01, 1.86), 178.0, 9.0, "vehicle.moving"),
    ("vehicle.truck", 47.0, -4.1, (8.14, 2.66, 3.41), 3.0, 0.0, "vehicle.stopped"),
    ("vehicle.emergency.police", 30.0, 9.3, (4.88, 1.95, 1.72), 181.0, 0.0, "vehicle.parked"),
    ("vehicle.bicycle", 18.0, 5.2, (1.72, 0.61, 1.63), 8.0, 3.1, "cycle.with_rider"),
    ("human.pedestrian.adult", 26.0, 3.3, (0.72, 0.68, 1.81), -91.0, 1.3, "pedestrian.moving"),
    ("human.pedestrian.child", 16.5, -6.4, (0.44, 0.49, 1.12), 80.0, 0.0, "pedestrian.standing"),
    ("human.pedestrian.stroller", 17.3, -6.9, (0.93, 0.58, 1.06), 74.0, 0.0, "pedestrian.standing"),
    ("movable_object.barrier", 33.0, -2.2, (0.53, 2.48, 1.02), 4.0, 0.0, ""),
    ("movable_object.trafficcone", 29.0, -1.4, (0.41, 0.42, 1.05), 0.0, 0.0, ""),
    ("movable_object.debris", 24.5, 0.4, (0.88, 0.71, 0.43), 33.0, 0.0, ""),
    ("movable_object.pushable_pullable", 35.0, 7.7, (0.66, 0.64, 1.05), 12.0, 0.0, ""),
    ("static_object.bicycle_rack", 40.0, -8.5, (4.1, 1.2, 1.3), -3.0, 0.0, ""),
    ("animal", 31.0, 1.9, (0.92, 0.34, 0.71), 120.0, 0.8, ""),
    ("vehicle.car", -12.0, -3.2, (4.4, 1.85, 1.6), 1.0, 8.0, "vehicle.moving"),
    ("human.pedestrian.construction_worker", -7.0, 5.5, (0.7, 0.7, 1.8), 10.0, 0.0, "pedestrian.standing"),
]
COLOURS = {
    "vehicle": (235, 140, 40),
    "human": (40, 200, 210),
    "movable_object": (200, 60, 180),
    "static_object": (160, 160, 160),
    "animal": (90, 60, 200),
}


def token(*words: object) -> str:
    """32 hex digits that follow from the words."""
    return hashlib.md5("/".join(map(str, words)).encode(), usedforsecurity=False).hexdigest()


def camera_pose(name: str) -> np.ndarray:
    """ego_from_camera."""
    place, yaw, pitch = CAMERAS[name][:3]
    return pose(turn(np.radians(yaw), np.radians(-pitch), np.radians(0.2)) @ FORWARD_FROM_OPTICAL, place)


def camera_k(name: str) -> np.ndarray:
    """Intrinsics."""
    fx, cx, cy = CAMERAS[name][3:6]
    return np.array([[fx, 0.0, cx], [0.0, fx, cy], [0.0, 0.0, 1.0]])


class Tables:
    """The thirteen tables, filled row by row."""

    NAMES = (
        "category",
        "attribute",
        "visibility",
        "instance",
        "sensor",
        "calibrated_sensor",
        "ego_pose",
        "log",
        "scene",
        "sample",
        "sample_data",
        "sample_annotation",
        "map",
    )

    def __init__(self) -> None:
        self.rows: dict[str, list[dict]] = {name: [] for name in self.NAMES}

    def add(self, table: str, key: str, **columns: object) -> str:
        """Adds a row and gives its token."""
        self.rows[table].append({"token": key, **columns})
        return key

    def add_pose(self, table: str, key: str, matrix: np.ndarray, **columns: object) -> str:
        """Adds a row with a translation and a rotation."""
        return self.add(
            table,
            key,
            translation=[float(v) for v in matrix[:3, 3]],
            rotation=quaternion(matrix[:3, :3]),
            **columns,
        )

    def save(self, folder: Path) -> None:
        """Writes the JSON files."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in self.rows.items():
            (folder / f"{name}.json").write_text(json.dumps(rows, indent=0))


def fill_fixed_tables(tables: Tables, out: Path) -> None:
    """Categories, attributes, visibilities, sensors, the map with its picture."""
    for name in sorted({thing[0] for thing in THINGS}):
        tables.add("category", token("category", name), name=name, description=name)
    for name in sorted({thing[6] for thing in THINGS} - {""}):
        tables.add("attribute", token("attribute", name), name=name, description=name)
    for idx, level in enumerate(["v0-40", "v40-60", "v60-80", "v80-100"], 1):
        tables.add("visibility", str(idx), level=level, description=level)
    tables.add("sensor", token("sensor", "LIDAR_TOP"), channel="LIDAR_TOP", modality="lidar")
    tables.add("sensor", token("sensor", "RADAR_FRONT"), channel="RADAR_FRONT", modality="radar")
    for name in CAMERAS:
        tables.add("sensor", token("sensor", name), channel=name, modality="camera")
    (out / "maps").mkdir(parents=True, exist_ok=True)
    Image.new("L", (64, 64), 255).save(out / "maps" / f"{token('map')}.png")


def make_scene(tables: Tables, out: Path, name: str, idx: int, options: argparse.Namespace) -> list[dict]:
    """One scene: its rows, pictures, clouds and CAN bus; the truth of its samples."""
    random = np.random.default_rng(100 + idx)
    yaw = 0.7 + 1.9 * idx
    start = np.array([411.3 + 97.7 * idx, 1180.9 - 61.3 * idx, 0.0])
    drive = Drive(start, yaw, 8.0 - idx, 0.6 - 0.4 * idx, [0.02, -0.05, 0.0, 0.09][idx % 4], [])
    for category, ahead, left, size, heading, speed, _ in THINGS:
        place = start + turn(yaw) @ [ahead + 1.5 * idx, left, 0.0]
        drive.things.append(Thing(category, place, np.array(size), yaw + np.radians(heading), speed))
    colours = [COLOURS[thing.category.split(".")[0]] for thing in drive.things]
    zero_us = 1_532_402_927_647_951 + idx * 60_000_000
    log = tables.add(
        "log",
        token("log", name),
        logfile=f"n015-2018-07-24-11-22-4{idx}+0800",
        vehicle="n015",
        date_captured="2018-07-24",
        location="singapore-onenorth",
    )
    calibrated = {
        "LIDAR_TOP": tables.add_pose(
            "calibrated_sensor",
            token("calibrated", name, "LIDAR_TOP"),
            EGO_FROM_LIDAR,
            sensor_token=token("sensor", "LIDAR_TOP"),
            camera_intrinsic=[],
        )
    }
    for camera in CAMERAS:
        calibrated[camera] = tables.add_pose(
            "calibrated_sensor",
            token("calibrated", name, camera),
            camera_pose(camera),
            sensor_token=token("sensor", camera),
            camera_intrinsic=camera_k(camera).tolist(),
        )

    def add_data(
        sample_idx: int, channel: str, time_us: int, key: bool, payload: bytes, size: tuple[int, int]
    ) -> None:
        stem = f"{tables.rows['log'][-1]['logfile']}__{channel}__{time_us}"
        ending = "pcd.bin" if channel == "LIDAR_TOP" else "jpg"
        path = f"{'samples' if key else 'sweeps'}/{channel}/{stem}.{ending}"
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        (out / path).write_bytes(payload)
        data = token("data", name, channel, time_us)
        tables.add_pose("ego_pose", data, drive.pose_at((time_us - zero_us) / 1e6), timestamp=time_us)
        before = [
            row for row in tables.rows["sample_data"] if row["calibrated_sensor_token"] == calibrated[channel]
        ]
        tables.add(
            "sample_data",
            data,
            sample_token=token("sample", name, sample_idx),
            ego_pose_token=data,
            calibrated_sensor_token=calibrated[channel],
            timestamp=time_us,
            fileformat="pcd" if channel == "LIDAR_TOP" else "jpg",
            is_key_frame=key,
            height=size[1],
            width=size[0],
            filename=path,
            prev=before[-1]["token"] if before else "",
            next="",
        )
        if before:
            before[-1]["next"] = data

    truth = []
    for sample_idx in range(options.samples):
        key_us = zero_us + sample_idx * 500_000 + int(random.integers(-700, 700))
        for sweep_idx in range(1 if sample_idx == 0 else options.sweeps + 1):
            # The sweeps that lead to this key frame, then the key frame.
            back = 0 if sample_idx == 0 else options.sweeps - sweep_idx
            time_us = key_us - back * 50_000
            seconds = (time_us - zero_us) / 1e6
            boxes = [(thing.pose_at(seconds), thing.size_m) for thing in drive.things]
            cloud, _ = scan(
                drive.pose_at(seconds) @ EGO_FROM_LIDAR, boxes, ELEVATIONS_RAD, options.columns, random
            )
            add_data(sample_idx, "LIDAR_TOP", time_us, back == 0, cloud.tobytes(), (0, 0))
        for camera, numbers in CAMERAS.items():
            time_us = key_us + round(numbers[6] * 1000)
            at = (time_us - zero_us) / 1e6
            shown = [(thing.pose_at(at), thing.size_m) for thing in drive.things]
            picture = paint(
                drive.pose_at(at) @ camera_pose(camera), camera_k(camera), (1600, 900), shown, colours
            )
            add_data(sample_idx, camera, time_us, True, picture, (1600, 900))
        in_global = cloud[:, :3].astype(float) @ (drive.pose_at(seconds) @ EGO_FROM_LIDAR)[:3, :3].T
        in_global += (drive.pose_at(seconds) @ EGO_FROM_LIDAR)[:3, 3]
        for thing_idx in range(len(drive.things)):
            if sample_idx == 2 and thing_idx == 8:
                continue  # the stroller is not annotated once: a track with a hole
            global_from_box, size = boxes[thing_idx]
            attribute = THINGS[thing_idx][6]
            tables.add_pose(
                "sample_annotation",
                token("annotation", name, sample_idx, thing_idx),
                global_from_box,
                sample_token=token("sample", name, sample_idx),
                instance_token=token("instance", name, thing_idx),
                visibility_token="4",
                attribute_tokens=[token("attribute", attribute)] if attribute else [],
                size=[float(size[1]), float(size[0]), float(size[2])],
                prev="",
                next="",
                num_lidar_pts=int(inside(in_global, global_from_box, size).sum()),
                num_radar_pts=0,
            )
        tables.add(
            "sample",
            token("sample", name, sample_idx),
            timestamp=key_us,
            prev=token("sample", name, sample_idx - 1) if sample_idx else "",
            next=token("sample", name, sample_idx + 1) if sample_idx + 1 < options.samples else "",
            scene_token=token("scene", name),
        )
        truth.append(
            {
                "scene": name,
                "timestamp_us": key_us,
                "speed_mps": drive.speed_at(seconds),
                "steering_angle_rad": drive.steering_rad,
            }
        )
    for thing_idx, thing in enumerate(drive.things):
        key = token("instance", name, thing_idx)
        track = [row for row in tables.rows["sample_annotation"] if row["instance_token"] == key]
        for before, after in zip(track, track[1:]):
            before["next"], after["prev"] = after["token"], before["token"]
        tables.add(
            "instance",
            key,
            category_token=token("category", thing.category),
            nbr_annotations=len(track),
            first_annotation_token=track[0]["token"],
            last_annotation_token=track[-1]["token"],
        )
    tables.add(
        "scene",
        token("scene", name),
        log_token=log,
        nbr_samples=options.samples,
        first_sample_token=token("sample", name, 0),
        last_sample_token=token("sample", name, options.samples - 1),
        name=name,
        description=f"Made scene {idx}: a curve, debris on the road, an animal",
    )
    if idx + 1 < options.scenes or options.scenes == 1:
        save_can_bus(out / "can_bus", name, drive, zero_us, options.samples * 0.5 + 1.0)
    return truth


def main() -> None:
    """Makes the folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=3)
    parser.add_argument("--samples", type=int, default=6)
    parser.add_argument("--sweeps", type=int, default=3, help="between two key frames (the original has 9)")
    parser.add_argument("--columns", type=int, default=720, help="of the LiDAR (the original has 1084)")
    options = parser.parse_args()
    tables = Tables()
    fill_fixed_tables(tables, options.out)
    truth = []
    for idx, name in enumerate(SCENES[: options.scenes]):
        truth += make_scene(tables, options.out, name, idx, options)
    tables.add(
        "map",
        token("map"),
        log_tokens=[row["token"] for row in tables.rows["log"]],
        category="semantic_prior",
        filename=f"maps/{token('map')}.png",
    )
    tables.save(options.out / VERSION)
    (options.out / "truth.json").write_text(json.dumps(truth, indent=1))
    print(f"{options.scenes} scenes of {options.samples} samples: {options.out}")


if __name__ == "__main__":
    main()
