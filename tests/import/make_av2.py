"""Makes a small Argoverse 2 sensor log with pictures and calibration, which the samples at hand lack.

Usage: make_av2.py OUT [--sweeps N]

True to the original: everything in the ego frame at the rear axle's height (0.33 m over the ground), sweeps
compensated to their stamps, float16 points with a laser's number, portrait pictures of ring_front_center at
20 Hz whose stamps are not the sweeps', poses at 40 Hz and at all stamps, boxes upright in ego with their
track's id. `av2` reads it.
"""

from __future__ import annotations

import argparse
import hashlib
import uuid
from pathlib import Path

import numpy as np
import pandas as pd
from made_world import FORWARD_FROM_OPTICAL, Drive, Thing, inside, paint, pose, quaternion, scan, turn

AXLE_HEIGHT_M = 0.33
START_NS = 315_973_157_959_879_000
CAMERAS = {
    # name: (place in ego, yaw in degrees, width, height, f, cx, cy)
    "ring_front_center": ([1.63, 0.0, 1.43], 0.3, 1550, 2048, 1686.6, 774.7, 1011.5),
    "ring_side_left": ([1.30, 0.14, 1.42], 98.0, 2048, 1550, 1684.9, 1021.2, 776.0),
}
UP_LIDAR_M = [1.35018, 0.0, 1.64042]
THINGS = [
    ("REGULAR_VEHICLE", 13.0, 1.2, (4.5, 1.9, 1.6), 1.0, 6.0),
    ("BUS", 30.0, -5.0, (11.5, 2.8, 3.2), 2.0, 0.0),
    ("PEDESTRIAN", 16.0, -4.0, (0.7, 0.6, 1.8), 88.0, 1.2),
    ("BOLLARD", 11.0, -3.0, (0.3, 0.3, 1.0), 0.0, 0.0),
    ("CONSTRUCTION_CONE", 21.0, 2.8, (0.4, 0.4, 0.8), 5.0, 0.0),
    ("DOG", 14.0, 3.9, (0.9, 0.35, 0.6), 130.0, 0.7),
    ("STROLLER", 19.0, -4.6, (0.9, 0.6, 1.1), 70.0, 0.9),
    ("REGULAR_VEHICLE", -8.0, 3.5, (4.4, 1.8, 1.5), 180.0, 7.0),
]


def row_of(matrix: np.ndarray) -> dict[str, float]:
    """Columns of a pose."""
    w, x, y, z = quaternion(matrix[:3, :3])
    tx, ty, tz = (float(v) for v in matrix[:3, 3])
    return {"qw": w, "qx": x, "qy": y, "qz": z, "tx_m": tx, "ty_m": ty, "tz_m": tz}


def camera_pose(name: str) -> np.ndarray:
    """ego_from_camera."""
    place, yaw = CAMERAS[name][:2]
    return pose(turn(np.radians(yaw), 0.01, 0.003) @ FORWARD_FROM_OPTICAL, place)


def main() -> None:
    """Makes one log."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--sweeps", type=int, default=8)
    options = parser.parse_args()
    random = np.random.default_rng(11)
    log = options.out / str(uuid.UUID(hashlib.md5(b"made", usedforsecurity=False).hexdigest()))
    for folder in ("sensors/lidar", "calibration", *(f"sensors/cameras/{name}" for name in CAMERAS)):
        (log / folder).mkdir(parents=True, exist_ok=True)
    drive = Drive(np.array([1468.9, 211.5, 0.0]), 0.33, 9.0, -0.7, 0.04, [])
    for category, ahead, left, size, heading, speed in THINGS:
        place = drive.start_m + turn(drive.yaw_rad) @ [ahead, left, 0.0]
        drive.things.append(
            Thing(category, place, np.array(size), drive.yaw_rad + np.radians(heading), speed)
        )
    raised = pose(np.eye(3), [0, 0, AXLE_HEIGHT_M])

    def ego_at(time_ns: int) -> np.ndarray:
        """city_from_ego; level, so that boxes upright in the city are upright in ego."""
        return drive.level_pose_at((time_ns - START_NS) / 1e9) @ raised

    def boxes_at(time_ns: int) -> list[tuple[np.ndarray, np.ndarray]]:
        return [(thing.pose_at((time_ns - START_NS) / 1e9), thing.size_m) for thing in drive.things]

    sweeps = [
        START_NS + idx * 100_000_000 + int(random.integers(-200_000, 200_000))
        for idx in range(options.sweeps)
    ]
    pictures = [START_NS - 30_000_000 + idx * 50_000_000 for idx in range(options.sweeps * 2)]
    ticks = range(-20, options.sweeps * 4 + 20)
    stamps = sorted({*sweeps, *pictures, *(START_NS + tick * 25_000_000 for tick in ticks)})
    pd.DataFrame([{"timestamp_ns": t, **row_of(ego_at(t))} for t in stamps]).to_feather(
        log / "city_SE3_egovehicle.feather"
    )
    mounts = {
        "up_lidar": pose(np.eye(3), UP_LIDAR_M),
        "down_lidar": pose(turn(0, 0, np.pi), [1.355, 0.0, 1.56]),
    }
    mounts |= {name: camera_pose(name) for name in CAMERAS}
    pd.DataFrame([{"sensor_name": name, **row_of(mount)} for name, mount in mounts.items()]).to_feather(
        log / "calibration/egovehicle_SE3_sensor.feather"
    )
    rows = []
    for name, (_, _, width, height, f, cx, cy) in CAMERAS.items():
        lens = {"k1": -0.27, "k2": -0.11, "k3": 0.16}  # of the raw pictures; those of a log are free of it
        rows.append({"sensor_name": name, "fx_px": f, "fy_px": f, "cx_px": cx, "cy_px": cy, **lens})
        rows[-1] |= {"height_px": height, "width_px": width}
    pd.DataFrame(rows).to_feather(log / "calibration/intrinsics.feather")
    colours = [(235, 140, 40), (220, 200, 40), (40, 200, 210), (90, 200, 60), (200, 60, 180), (90, 60, 200)]
    for time_ns in pictures:
        for name, (_, _, width, height, f, cx, cy) in CAMERAS.items():
            k = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1.0]])
            shades = [colours[idx % len(colours)] for idx in range(len(THINGS))]
            picture = paint(
                ego_at(time_ns) @ camera_pose(name), k, (width, height), boxes_at(time_ns), shades
            )
            (log / f"sensors/cameras/{name}/{time_ns}.jpg").write_bytes(picture)
    annotations = []
    for time_ns in sweeps:
        lidar = ego_at(time_ns) @ mounts["up_lidar"]
        cloud, _ = scan(lidar, boxes_at(time_ns), np.radians(np.linspace(-25, 15, 64)), 500, random)
        in_ego = cloud[:, :3] + UP_LIDAR_M
        azimuth = np.arctan2(cloud[:, 1], cloud[:, 0])
        pd.DataFrame(
            {
                "x": in_ego[:, 0].astype(np.float16),
                "y": in_ego[:, 1].astype(np.float16),
                "z": in_ego[:, 2].astype(np.float16),
                "intensity": cloud[:, 3].astype(np.uint8),
                "laser_number": cloud[:, 4].astype(np.uint8),
                "offset_ns": ((azimuth / (2 * np.pi) + 0.5) * 1e8).astype(np.int32),
            }
        ).to_feather(log / f"sensors/lidar/{time_ns}.feather", compression="lz4")
        rounded = in_ego.astype(np.float16).astype(float)
        for idx, (city_from_box, size) in enumerate(boxes_at(time_ns)):
            ego_from_box = np.linalg.inv(ego_at(time_ns)) @ city_from_box
            columns = row_of(ego_from_box)
            length, width, height = (float(v) for v in size)
            annotations.append(
                {
                    "timestamp_ns": time_ns,
                    "track_uuid": str(uuid.UUID(int=idx + 1)),
                    "category": THINGS[idx][0],
                    "length_m": length,
                    "width_m": width,
                    "height_m": height,
                    "qw": columns["qw"],
                    "qx": 0.0,
                    "qy": 0.0,
                    "qz": columns["qz"],
                    "tx_m": columns["tx_m"],
                    "ty_m": columns["ty_m"],
                    "tz_m": columns["tz_m"],
                    "num_interior_pts": int(inside(rounded, ego_from_box, size).sum()),
                }
            )
    pd.DataFrame(annotations).to_feather(log / "annotations.feather")
    print(f"{len(sweeps)} sweeps, {len(pictures)} pictures a camera: {log}")


if __name__ == "__main__":
    main()
