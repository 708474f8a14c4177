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
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from check_kitti import FORWARD_FROM_OPTICAL, read_calibration
from made_world import WHEELBASE_M, Drive, Thing, pose, quaternion, scan, turn
from PIL import Image
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(
    get_types_from_msg(
        "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\n"
        "float32 jerk\n",
        "ackermann_msgs/msg/AckermannDrive",
    )
    | get_types_from_msg(
        "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
        "ackermann_msgs/msg/AckermannDriveStamped",
    )
)
START_NS = 1_700_000_000_000_000_000
T = STORE.types


def stamp(time_ns: int) -> object:
    """builtin_interfaces/Time."""
    return T["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)


def header(time_ns: int, frame: str) -> object:
    """std_msgs/Header."""
    return T["std_msgs/msg/Header"](stamp=stamp(time_ns), frame_id=frame)


def rotation_message(matrix: np.ndarray) -> object:
    """geometry_msgs/Quaternion."""
    w, x, y, z = quaternion(matrix[:3, :3])
    return T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def transform_message(time_ns: int, parent: str, child: str, matrix: np.ndarray) -> object:
    """geometry_msgs/TransformStamped: parent_from_child."""
    x, y, z = (float(v) for v in matrix[:3, 3])
    return T["geometry_msgs/msg/TransformStamped"](
        header=header(time_ns, parent),
        child_frame_id=child,
        transform=T["geometry_msgs/msg/Transform"](
            translation=T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z), rotation=rotation_message(matrix)
        ),
    )


def cloud_message(time_ns: int, frame: str, points: np.ndarray, step: int) -> object:
    """sensor_msgs/PointCloud2 of a structured array, each point padded to `step` bytes."""
    codes = {"<u1": 2, "<u2": 4, "<u4": 6, "<f4": 7, "<f8": 8}
    offsets = {"x": 0, "y": 4, "z": 8, "intensity": 16, "ring": 20, "t": 24}
    layout = np.dtype(
        {
            "names": list(points.dtype.names),
            "formats": [points.dtype[name].str for name in points.dtype.names],
            "offsets": [offsets[name] for name in points.dtype.names],
            "itemsize": step,
        }
    )
    packed = np.zeros(len(points), layout)
    for name in points.dtype.names:
        packed[name] = points[name]
    fields = [
        T["sensor_msgs/msg/PointField"](
            name=name, offset=offsets[name], datatype=codes["<" + points.dtype[name].str[1:]], count=1
        )
        for name in points.dtype.names
    ]
    return T["sensor_msgs/msg/PointCloud2"](
        header=header(time_ns, frame),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(points),
        data=np.frombuffer(packed.tobytes(), dtype=np.uint8),
        is_dense=True,
    )


def info_message(time_ns: int, frame: str, size: tuple[int, int], k: np.ndarray, d: list[float]) -> object:
    """sensor_msgs/CameraInfo; P is K, as for a single camera."""
    return T["sensor_msgs/msg/CameraInfo"](
        header=header(time_ns, frame),
        height=size[1],
        width=size[0],
        distortion_model="plumb_bob",
        d=np.array(d, dtype=float),
        k=k.ravel().astype(float),
        r=np.eye(3).ravel(),
        p=np.c_[k, np.zeros(3)].ravel().astype(float),
        binning_x=0,
        binning_y=0,
        roi=T["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


def odometry_message(time_ns: int, drive: Drive, seconds: float) -> object:
    """nav_msgs/Odometry of base_link in odom, with its speed and yaw rate."""
    matrix = drive.level_pose_at(seconds)
    x, y, z = (float(v) for v in matrix[:3, 3])
    vector = T["geometry_msgs/msg/Vector3"]
    rate = drive.speed_at(seconds) * np.tan(drive.steering_rad) / WHEELBASE_M
    return T["nav_msgs/msg/Odometry"](
        header=header(time_ns, "odom"),
        child_frame_id="base_link",
        pose=T["geometry_msgs/msg/PoseWithCovariance"](
            pose=T["geometry_msgs/msg/Pose"](
                position=T["geometry_msgs/msg/Point"](x=x, y=y, z=z), orientation=rotation_message(matrix)
            ),
            covariance=np.zeros(36),
        ),
        twist=T["geometry_msgs/msg/TwistWithCovariance"](
            twist=T["geometry_msgs/msg/Twist"](
                linear=vector(x=drive.speed_at(seconds), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=rate)
            ),
            covariance=np.zeros(36),
        ),
    )


@dataclass
class Bag:
    """Messages to write, in the order of their times."""

    messages: list[tuple[int, str, str, object]] = field(default_factory=list)

    def add(self, time_ns: int, topic: str, kind: str, message: object) -> None:
        """Adds one, recorded 2 ms after its stamp as a real recorder would."""
        self.messages.append((time_ns + 2_000_000, topic, kind, message))

    def write(self, folder: Path, compress: bool) -> None:
        """Writes the folder: metadata.yaml and an MCAP file."""
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        if compress:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            topics = {}
            for time_ns, topic, kind, message in sorted(self.messages, key=lambda one: one[0]):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=STORE)
                writer.write(topics[topic], time_ns, STORE.serialize_cdr(message, kind))

    def add_motion(self, drive: Drive, until_s: float) -> None:
        """/tf map -> odom -> base_link and /odom, 50 Hz."""
        for tick in range(-25, int(until_s * 50) + 25):
            seconds = tick / 50
            time_ns = START_NS + round(seconds * 1e9)
            transforms = [transform_message(time_ns, "odom", "base_link", drive.level_pose_at(seconds))]
            message = T["tf2_msgs/msg/TFMessage"](transforms=transforms)
            self.add(time_ns, "/tf", "tf2_msgs/msg/TFMessage", message)
            self.add(time_ns, "/odom", "nav_msgs/msg/Odometry", odometry_message(time_ns, drive, seconds))


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
    statics = T["tf2_msgs/msg/TFMessage"](
        transforms=[
            transform_message(START_NS, "base_link", "velodyne", base_from_lidar),
            transform_message(START_NS, "velodyne", "camera_optical", lidar_from_camera),
        ]
    )
    bag.add(START_NS - 400_000_000, "/tf_static", "tf2_msgs/msg/TFMessage", statics)
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
    import cv2  # only here: the KITTI bag does not need it
    from made_world import paint

    random = np.random.default_rng(5)
    drive = Drive(np.array([100.0, 50.0, 0.0]), -0.4, 11.0, -0.8, 0.06, [])
    for ahead, left, size, heading, speed in [
        (12.0, 2.5, (4.3, 1.8, 1.5), 3.0, 0.0),
        (20.0, -4.0, (4.6, 1.9, 1.6), 1.0, 0.0),
        (28.0, 3.0, (0.6, 0.6, 1.75), 90.0, 0.0),
        (16.0, -2.0, (0.9, 0.7, 0.5), 20.0, 0.0),
        (-9.0, 4.0, (4.3, 1.8, 1.5), 3.0, 0.0),
        (40.0, -6.0, (9.0, 2.6, 3.4), 5.0, 0.0),
    ]:
        place = drive.start_m + turn(drive.yaw_rad) @ [ahead, left, 0.0]
        drive.things.append(Thing("box", place, np.array(size), drive.yaw_rad + np.radians(heading), speed))
    base_from_lidar = pose(turn(np.radians(90), 0.01, 0.004), [1.0, 0.1, 1.9])
    base_from_camera = pose(turn(0.01, 0.02, 0.0) @ FORWARD_FROM_OPTICAL, [1.6, 0.05, 1.5])
    k = np.array([[900.0, 0.0, 641.3], [0.0, 905.0, 358.6], [0.0, 0.0, 1.0]])
    d = [-0.28, 0.09, 0.0004, -0.0007, -0.012]
    size = (1280, 720)
    elevations = np.radians(np.linspace(-25, 15, 32))
    n_columns, n_steps = 900, 60
    boxes = [(thing.pose_at(0.0), thing.size_m) for thing in drive.things]
    bag, truth = Bag(), {}
    statics = T["tf2_msgs/msg/TFMessage"](
        transforms=[
            transform_message(START_NS, "base_link", "lidar_top", base_from_lidar),
            transform_message(START_NS, "base_link", "camera_front", base_from_camera),
        ]
    )
    bag.add(START_NS - 400_000_000, "/tf_static", "tf2_msgs/msg/TFMessage", statics)
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
            columns = n_columns // n_steps
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
        colours = [
            (235, 140, 40),
            (40, 200, 210),
            (200, 60, 180),
            (90, 200, 60),
            (160, 160, 160),
            (220, 200, 40),
        ]
        import io

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
