"""Makes ROS 2 bags (rosbag2 folders, MCAP storage, CDR) with `rosbags`, whose truth is known exactly.

Usage: make_ros2_bag.py OUT --kitti TRAINING_DIR    real KITTI frames, a made drive round them
       make_ros2_bag.py OUT --made                  a made world: a LiDAR that turns while it drives, a
       distorted camera

`OUT` is the bag's folder; the truth is in `OUT.truth.npz`. `base_link` is the rear axle's middle on the
ground. Both hold PointCloud2, CameraInfo, /tf, /tf_static and Odometry; the KITTI bag has CompressedImage
(PNG), padded points with `ring` (step 32) and AckermannDriveStamped; the made one raw images, a `t` of each
point in nanoseconds, and plumb_bob distortion.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from check_kitti import read_calibration
from made_ros2_bag import make_made_bag
from made_world import Drive, pose, turn
from PIL import Image
from ros2_messages import START_NS, Bag, T, cloud_message, header, info_message


def make_kitti_bag(source: Path, out: Path) -> None:
    """KITTI's frames, one each 0.1 s."""
    names = sorted(path.stem for path in (source / "velodyne").glob("*.bin"))
    # One calibration for the bag: frames of another car's day are left out.
    first = next(name for name in names if name != "000000")
    wanted = read_calibration(source / "calib" / f"{first}.txt")
    names = [
        name
        for name in names
        if np.allclose(read_calibration(source / "calib" / f"{name}.txt")["p2"], wanted["p2"])
    ]
    base_from_lidar = pose(turn(0.002, 0.011, -0.006), [0.76, 0.02, 1.73])
    lidar_from_camera = np.linalg.inv(wanted["camera2_from_rect"] @ wanted["rect_from_velo"])
    u, _, vt = np.linalg.svd(lidar_from_camera[:3, :3])
    lidar_from_camera[:3, :3] = u @ vt
    base_from_camera = base_from_lidar @ lidar_from_camera
    drive = Drive(np.array([30.0, -12.0, 0.0]), 0.6, 6.0, 0.5, 0.03, [])
    bag, truth = Bag(), {}
    bag.add_statics(
        [
            ("base_link", "velodyne", base_from_lidar),
            ("velodyne", "camera_optical", lidar_from_camera),
        ]
    )
    bag.add_motion(drive, len(names) * 0.1)
    for idx, name in enumerate(names):
        time_ns = START_NS + idx * 100_000_000
        raw = np.fromfile(source / "velodyne" / f"{name}.bin", dtype="<f4").reshape(-1, 4)
        points = np.zeros(
            len(raw), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")]
        )
        for column, axis in enumerate(["x", "y", "z", "intensity"]):
            points[axis] = raw[:, column]
        elevation = np.degrees(np.arctan2(raw[:, 2], np.linalg.norm(raw[:, :2], axis=1)))
        points["ring"] = np.clip((elevation + 24.9) / 28.9 * 64, 0, 63).astype(int)
        bag.add(
            time_ns,
            "/velodyne_points",
            "sensor_msgs/msg/PointCloud2",
            cloud_message(time_ns, "velodyne", points, 32),
        )
        camera_ns = time_ns - 7_000_000 - 1_000_000 * idx
        picture = (source / "image_2" / f"{name}.png").read_bytes()
        size = Image.open(source / "image_2" / f"{name}.png").size
        bag.add(
            camera_ns,
            "/camera/image_raw/compressed",
            "sensor_msgs/msg/CompressedImage",
            T["sensor_msgs/msg/CompressedImage"](
                header=header(camera_ns, "camera_optical"),
                format="png",
                data=np.frombuffer(picture, dtype=np.uint8),
            ),
        )
        bag.add(
            camera_ns,
            "/camera/camera_info",
            "sensor_msgs/msg/CameraInfo",
            info_message(camera_ns, "camera_optical", size, wanted["k"], [0.0] * 5),
        )
        seconds = idx * 0.1
        bag.add(
            time_ns,
            "/vehicle/ackermann",
            "ackermann_msgs/msg/AckermannDriveStamped",
            T["ackermann_msgs/msg/AckermannDriveStamped"](
                header=header(time_ns, "base_link"),
                drive=T["ackermann_msgs/msg/AckermannDrive"](
                    steering_angle=drive.steering_rad,
                    steering_angle_velocity=0.0,
                    speed=drive.speed_at(seconds),
                    acceleration=drive.acceleration_mps2,
                    jerk=0.0,
                ),
            ),
        )
        truth[f"{time_ns}.points"] = raw[:, :3]
        truth[f"{time_ns}.intensity"] = raw[:, 3] * 255
        truth[f"{time_ns}.ring"] = points["ring"]
        truth[f"{time_ns}.pose"] = drive.level_pose_at(seconds)
        truth[f"{time_ns}.state"] = np.array([drive.speed_at(seconds), drive.steering_rad])
        truth[f"{time_ns}.picture"] = np.frombuffer(picture, dtype=np.uint8)
    truth |= {"k": wanted["k"], "base_from_lidar": base_from_lidar, "base_from_camera": base_from_camera}
    bag.write(out, compress=False)
    np.savez(out.with_suffix(".truth.npz"), **truth)
    print(f"{len(names)} clouds of KITTI: {out}")


def main() -> None:
    """Makes one bag."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--kitti", type=Path)
    parser.add_argument("--made", action="store_true")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    if options.made:
        make_made_bag(options.out)
    else:
        make_kitti_bag(options.kitti, options.out)


if __name__ == "__main__":
    main()
