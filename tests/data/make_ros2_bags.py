"""Makes bags of ROS 2 with `rosbags`, and JSON of what stands in them, computed here and not by harmzone.

`plain`, `odd` and the damaged ones are the fixtures of `tests/import_ros2.rs`:
`python tests/data/make_ros2_bags.py tests/data/ros2` (pip install rosbags numpy pillow). `--kitti DIR OUT`
makes a bag of KITTI's object frames instead, for a look at real ones. `ros2_world.py` has the made drive.
"""

import argparse
import io
import json
from pathlib import Path

import numpy as np
from PIL import Image
from ros2_bag import Bag, add_motion, add_status, sample_of
from ros2_damage import damaged
from ros2_misleading import misleading
from ros2_world import (
    BASE_FROM_CAMERA_BODY,
    BASE_FROM_LIDAR,
    BASE_FROM_OPTICAL,
    HEIGHT,
    N_CLOUDS,
    RADIUS_M,
    RINGS,
    SPEED_MPS,
    START_NS,
    WHEELBASE_M,
    WIDTH,
    K,
    boxes_message,
    camera_info,
    cloud,
    cloud_message,
    header,
    make,
    picture,
    point,
    pose,
    quaternion,
    tf_message,
    vector,
    world_from_base,
)


def plain(out):
    """Little-endian, one file: packed floats, u32 nanoseconds, bgr8 in padded rows, optical frame, boxes."""
    rng = np.random.default_rng(1)
    bag, expected = Bag(out / "plain"), []
    static = [("base_link", "lidar", BASE_FROM_LIDAR), ("base_link", "camera_optical", BASE_FROM_OPTICAL)]
    bag.add("/tf_static", "tf2_msgs/msg/TFMessage", tf_message(static, START_NS), START_NS - 200_000_000)
    add_motion(bag)
    steering_rad = add_status(bag)
    for i in range(N_CLOUDS):
        time_ns = START_NS + i * 100_000_000
        scan = cloud(time_ns, rng)
        columns = [
            ("x", 0, "f4", scan.measured[:, 0]),
            ("y", 4, "f4", scan.measured[:, 1]),
            ("z", 8, "f4", scan.measured[:, 2]),
            ("intensity", 16, "u1", scan.intensity),
            ("t", 20, "u4", np.round(scan.offset_s * 1e9)),
            ("ring", 26, "u2", scan.ring),
        ]
        bag.add(
            "/lidar/points",
            "sensor_msgs/msg/PointCloud2",
            cloud_message(time_ns, "lidar", columns, step=32),
            time_ns + 110_000_000,
        )
        rows = np.zeros((HEIGHT, WIDTH * 3 + 8), np.uint8)
        rows[:, : WIDTH * 3] = picture(i)[..., ::-1].reshape(HEIGHT, -1)
        image_ns = time_ns + 12_000_000
        image = make(
            "sensor_msgs/msg/Image",
            header=header(image_ns, "camera_optical"),
            height=HEIGHT,
            width=WIDTH,
            encoding="bgr8",
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.reshape(-1),
        )
        bag.add("/camera/front/image_raw", "sensor_msgs/msg/Image", image, image_ns + 5_000_000)
        info = camera_info(image_ns, "camera_optical", K)
        bag.add("/camera/front/camera_info", "sensor_msgs/msg/CameraInfo", info, image_ns + 5_000_000)
        message, boxes = boxes_message(time_ns)
        bag.add("/boxes", "vision_msgs/msg/Detection3DArray", message, time_ns + 120_000_000)
        expected.append(sample_of(time_ns, scan, K, BASE_FROM_OPTICAL, image_ns, boxes))
    bag.close()
    return {
        "samples": expected,
        "speed_mps": SPEED_MPS,
        "steering_rad": steering_rad,
        "wheelbase_m": WHEELBASE_M,
    }


def odd(out):
    """Big-endian, two files: organised float64 cloud with padded rows, rings from above, times of the epoch.

    PNG 35 ms late, rectified by P, body-axes camera frame under a mount, odometry topic instead of tf,
    slashes before frames.
    """
    rng = np.random.default_rng(2)
    bag, expected = Bag(out / "odd", little_endian=False), []
    mount = pose(1.0, 0, 1.0, 0, 0, 0.2)
    static = [
        ("/base_link", "/mount", mount),
        ("/mount", "/velodyne", np.linalg.inv(mount) @ BASE_FROM_LIDAR),
        ("/mount", "/camera", np.linalg.inv(mount) @ BASE_FROM_CAMERA_BODY),
    ]
    bag.add("/tf_static", "tf2_msgs/msg/TFMessage", tf_message(static, 0), START_NS - 200_000_000)
    for i in range(-5, 35):
        time_ns = START_NS + i * 20_000_000
        of = world_from_base(time_ns)
        here = make("geometry_msgs/msg/Pose", position=point(*of[:3, 3]), orientation=quaternion(of))
        twist = make(
            "geometry_msgs/msg/Twist",
            linear=vector(SPEED_MPS, 0, 0),
            angular=vector(0, 0, SPEED_MPS / RADIUS_M),
        )
        odometry = make(
            "nav_msgs/msg/Odometry",
            header=header(time_ns, "/odom"),
            child_frame_id="/base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=here, covariance=np.zeros(36)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        bag.add("/odometry", "nav_msgs/msg/Odometry", odometry, time_ns)
        steering = make("std_msgs/msg/Float64", data=float(np.degrees(np.arctan(WHEELBASE_M / RADIUS_M))))
        bag.add("/steering_angle", "std_msgs/msg/Float64", steering, time_ns)
    p = np.hstack([K, np.zeros((3, 1))])
    for i in range(N_CLOUDS):
        time_ns = START_NS + i * 100_000_000
        scan = cloud(time_ns, rng)
        order = np.argsort(-scan.ring, kind="stable")  # the first row is the highest ring
        columns = [
            ("x", 0, "f8", scan.measured[order, 0]),
            ("y", 8, "f8", scan.measured[order, 1]),
            ("z", 16, "f8", scan.measured[order, 2]),
            ("reflectivity", 24, "u2", scan.intensity[order]),
            ("channel", 26, "u1", RINGS - 1 - scan.ring[order]),
            ("timestamp", 32, "f8", time_ns * 1e-9 + scan.offset_s[order]),
        ]
        message = cloud_message(
            time_ns, "/velodyne", columns, step=40, big_endian=True, rows=RINGS, row_padding=16
        )
        bag.add("/points", "sensor_msgs/msg/PointCloud2", message, time_ns + 110_000_000)
        image_ns = time_ns + 35_000_000
        packed = io.BytesIO()
        Image.fromarray(picture(i)).save(packed, "png")
        image = make(
            "sensor_msgs/msg/CompressedImage",
            header=header(image_ns, "/camera"),
            format="rgb8; png compressed",
            data=np.frombuffer(packed.getvalue(), np.uint8),
        )
        bag.add("/cam/image_rect_color/compressed", "sensor_msgs/msg/CompressedImage", image, image_ns)
        raw_k = [90.0, 0, 30, 0, 90, 20, 0, 0, 1]
        info = camera_info(
            image_ns, "/camera", raw_k, model="rational_polynomial", d=[0.1] * 8, p=p.reshape(-1)
        )
        bag.add("/cam/camera_info", "sensor_msgs/msg/CameraInfo", info, image_ns)
        expected.append(sample_of(time_ns, scan, K, BASE_FROM_OPTICAL, image_ns, None))
    bag.close(n_files=2)
    steering_rad = float(np.arctan(WHEELBASE_M / RADIUS_M))
    return {
        "samples": expected,
        "speed_mps": SPEED_MPS,
        "steering_rad": steering_rad,
        "wheelbase_m": WHEELBASE_M,
    }


# --- KITTI ---


def kitti(source, out):
    """KITTI's object frames as one bag, one each 0.5 s: they do not follow each other, so the car stands."""
    bag = Bag(out, compress=False)
    for i, path in enumerate(sorted((source / "velodyne").glob("*.bin"))):
        time_ns = START_NS + i * 500_000_000
        lines = (source / "calib" / f"{path.stem}.txt").read_text().split("\n")
        calib = {
            line.split(":")[0]: np.array(line.split(":")[1].split(), float) for line in lines if ":" in line
        }
        rectified = np.eye(4)
        rectified[:3, :3] = calib["R0_rect"].reshape(3, 3)
        camera0_from_velo = np.vstack([calib["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
        p2 = calib["P2"].reshape(3, 4)
        camera2_from_camera0 = np.eye(4)
        camera2_from_camera0[:3, 3] = np.linalg.inv(p2[:, :3]) @ p2[:, 3]
        camera_from_velo = camera2_from_camera0 @ rectified @ camera0_from_velo
        base_from_velo = pose(0.76, 0, 1.73, 0, 0, 0)
        frames = [
            ("base_link", "velodyne", base_from_velo),
            ("base_link", f"camera_{path.stem}", base_from_velo @ np.linalg.inv(camera_from_velo)),
        ]
        bag.add("/tf_static", "tf2_msgs/msg/TFMessage", tf_message(frames, time_ns), time_ns)
        standing = tf_message([("odom", "base_link", np.eye(4))], time_ns)
        bag.add("/tf", "tf2_msgs/msg/TFMessage", standing, time_ns)
        points = np.fromfile(path, "<f4").reshape(-1, 4)
        columns = [(name, 4 * j, "f4", points[:, j]) for j, name in enumerate(["x", "y", "z", "intensity"])]
        bag.add(
            "/velodyne_points",
            "sensor_msgs/msg/PointCloud2",
            cloud_message(time_ns, "velodyne", columns, step=16),
            time_ns,
        )
        pixels = np.asarray(Image.open(source / "image_2" / f"{path.stem}.png").convert("RGB"))
        height, width = pixels.shape[:2]
        frame = f"camera_{path.stem}"
        image = make(
            "sensor_msgs/msg/Image",
            header=header(time_ns, frame),
            height=height,
            width=width,
            encoding="rgb8",
            is_bigendian=0,
            step=width * 3,
            data=pixels.reshape(-1),
        )
        bag.add("/camera/image_rect_color", "sensor_msgs/msg/Image", image, time_ns)
        info = camera_info(
            time_ns,
            frame,
            p2[:, :3],
            p=np.hstack([p2[:, :3], np.zeros((3, 1))]).reshape(-1),
            size=(width, height),
        )
        bag.add("/camera/camera_info", "sensor_msgs/msg/CameraInfo", info, time_ns)
    bag.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--kitti", type=Path, help="KITTI's folder `training`: make a bag of it instead")
    parser.add_argument("--damaged", action="store_true", help="make the damaged bags instead")
    parser.add_argument(
        "--misleading", action="store_true", help="make the bags that mislead a guess instead"
    )
    args = parser.parse_args()
    if args.kitti:
        kitti(args.kitti, args.out)
        return
    args.out.mkdir(parents=True, exist_ok=True)
    if args.damaged:
        damaged(args.out)
        return
    if args.misleading:
        misleading(args.out)
        return
    for name, made in [("plain", plain(args.out)), ("odd", odd(args.out))]:
        (args.out / f"{name}.json").write_text(json.dumps(made) + "\n")


if __name__ == "__main__":
    main()
