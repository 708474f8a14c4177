"""The ROS 2 bag of a made world: a LiDAR that turns while the car drives, a camera that distorts.

Called by make_ros2_bag.py.
"""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from made_world import FORWARD_FROM_OPTICAL, Drive, Thing, paint, pose, scan, turn
from PIL import Image
from ros2_messages import START_NS, Bag, T, cloud_message, header, info_message

# Metres ahead and to the left of the start, size, yaw against the drive in degrees, speed, colour
THINGS = [
    (12.0, 2.5, (4.3, 1.8, 1.5), 3.0, 0.0, (235, 140, 40)),
    (20.0, -4.0, (4.6, 1.9, 1.6), 1.0, 0.0, (40, 200, 210)),
    (28.0, 3.0, (0.6, 0.6, 1.75), 90.0, 0.0, (200, 60, 180)),
    (16.0, -2.0, (0.9, 0.7, 0.5), 20.0, 0.0, (90, 200, 60)),
    (-9.0, 4.0, (4.3, 1.8, 1.5), 3.0, 0.0, (160, 160, 160)),
    (40.0, -6.0, (9.0, 2.6, 3.4), 5.0, 0.0, (220, 200, 40)),
]


def distort(pixels: np.ndarray, k: np.ndarray, d: list[float]) -> np.ndarray:
    """Where plumb_bob puts ideal pixels [n, 2]."""
    x, y = (pixels[:, 0] - k[0, 2]) / k[0, 0], (pixels[:, 1] - k[1, 2]) / k[1, 1]
    r2 = x * x + y * y
    radial = 1 + d[0] * r2 + d[1] * r2**2 + d[4] * r2**3
    u = x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x)
    v = y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y
    return np.stack([u * k[0, 0] + k[0, 2], v * k[1, 1] + k[1, 2]], axis=1)


def undistort(pixels: np.ndarray, k: np.ndarray, d: list[float]) -> np.ndarray:
    """The ideal pixels that plumb_bob puts on these [n, 2]: by fixed-point steps, until nothing moves."""
    ideal = pixels.copy()
    for _ in range(200):
        step = pixels - distort(ideal, k, d)
        ideal += step
        if np.abs(step).max() < 1e-9:
            break
    return ideal


def make_made_bag(out: Path) -> None:
    """A made world in which the LiDAR turns while the car drives, and the camera distorts."""
    random = np.random.default_rng(5)
    drive = Drive(np.array([100.0, 50.0, 0.0]), -0.4, 11.0, -0.8, 0.06, [])
    for ahead, left, size, heading, speed, _ in THINGS:
        place = drive.start_m + turn(drive.yaw_rad) @ [ahead, left, 0.0]
        drive.things.append(Thing("box", place, np.array(size), drive.yaw_rad + np.radians(heading), speed))
    base_from_lidar = pose(turn(np.radians(90), 0.01, 0.004), [1.0, 0.1, 1.9])
    base_from_camera = pose(turn(0.01, 0.02, 0.0) @ FORWARD_FROM_OPTICAL, [1.6, 0.05, 1.5])
    k = np.array([[900.0, 0.0, 641.3], [0.0, 905.0, 358.6], [0.0, 0.0, 1.0]])
    d = [-0.28, 0.09, 0.0004, -0.0007, -0.012]
    size = (1280, 720)
    elevations = np.radians(np.linspace(-25, 15, 32))
    n_columns, n_steps = 900, 60
    columns = n_columns // n_steps
    boxes = [(thing.pose_at(0.0), thing.size_m) for thing in drive.things]
    colours = [colour for *_, colour in THINGS]
    bag, truth = Bag(), {}
    bag.add_statics(
        [
            ("base_link", "lidar_top", base_from_lidar),
            ("base_link", "camera_front", base_from_camera),
        ]
    )
    bag.add_motion(drive, 1.0)
    grid = (
        np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)
        .reshape(-1, 2)
        .astype(np.float64)
    )
    ideal = undistort(grid, k, d).reshape(size[1], size[0], 2)
    for idx in range(6):
        time_ns = START_NS + idx * 100_000_000
        parts = []
        for step in range(n_steps):
            # A sixtieth of the turn at a time; the stamp of the message is that of its first point.
            offset_s = 0.1 * step / n_steps
            lidar = drive.level_pose_at(idx * 0.1 + offset_s) @ base_from_lidar
            turned = 2 * np.pi * step / n_steps
            points, _ = scan(lidar, boxes, elevations, n_columns, random)
            angle = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
            part = points[
                (angle >= turned - 1e-9) & (angle < turned + 2 * np.pi * columns / n_columns - 1e-9)
            ]
            parts.append((part, np.full(len(part), round(offset_s * 1e9))))
        raw, offsets = np.concatenate([p for p, _ in parts]), np.concatenate([o for _, o in parts])
        points = np.zeros(
            len(raw),
            [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("t", "<u4")],
        )
        for column, axis in enumerate(["x", "y", "z", "intensity", "ring"]):
            points[axis] = raw[:, column]
        points["t"] = offsets
        bag.add(
            time_ns,
            "/lidar/points",
            "sensor_msgs/msg/PointCloud2",
            cloud_message(time_ns, "lidar_top", points, 28),
        )
        # What the points are once the motion within the turn is taken out: all in the LiDAR's frame at the
        # stamp.
        still = np.empty((len(raw), 3))
        lidar_from_global = np.linalg.inv(drive.level_pose_at(idx * 0.1) @ base_from_lidar)
        for offset_ns in np.unique(offsets):
            moved = lidar_from_global @ drive.level_pose_at(idx * 0.1 + offset_ns / 1e9) @ base_from_lidar
            chosen = offsets == offset_ns
            still[chosen] = raw[chosen, :3].astype(float) @ moved[:3, :3].T + moved[:3, 3]
        camera_ns = time_ns + 11_000_000
        global_from_camera = drive.level_pose_at(idx * 0.1 + 0.011) @ base_from_camera
        pure = np.array(Image.open(io.BytesIO(paint(global_from_camera, k, size, boxes, colours, "PNG"))))
        bent = cv2.remap(
            pure, ideal[..., 0].astype(np.float32), ideal[..., 1].astype(np.float32), cv2.INTER_LINEAR
        )
        bag.add(
            camera_ns,
            "/camera_front/image_raw",
            "sensor_msgs/msg/Image",
            T["sensor_msgs/msg/Image"](
                header=header(camera_ns, "camera_front"),
                height=size[1],
                width=size[0],
                encoding="bgr8",
                is_bigendian=0,
                step=size[0] * 3,
                data=np.ascontiguousarray(bent[..., ::-1]).ravel(),
            ),
        )
        bag.add(
            camera_ns,
            "/camera_front/camera_info",
            "sensor_msgs/msg/CameraInfo",
            info_message(camera_ns, "camera_front", size, k, d),
        )
        truth[f"{time_ns}.points"] = still
        truth[f"{time_ns}.raw"] = raw[:, :3]
        truth[f"{time_ns}.intensity"] = raw[:, 3]
        truth[f"{time_ns}.ring"] = raw[:, 4]
        truth[f"{time_ns}.pose"] = drive.level_pose_at(idx * 0.1)
        truth[f"{time_ns}.state"] = np.array([drive.speed_at(idx * 0.1), drive.steering_rad])
        truth[f"{time_ns}.ideal"] = pure
        truth[f"{time_ns}.bent"] = bent
    truth |= {
        "k": k,
        "d": np.array(d),
        "base_from_lidar": base_from_lidar,
        "base_from_camera": base_from_camera,
    }
    bag.write(out, compress=True)
    np.savez(out.with_suffix(".truth.npz"), **truth)
    print(f"6 clouds of a made world: {out}")
