"""Messages of made ROS 2 bags, and the bag that holds them until it is written (rosbag2 folder, MCAP storage,
CDR).

A matrix is 4x4, `parent_from_child`; times are nanoseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from made_world import WHEELBASE_M, Drive, quaternion
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

    def add_statics(self, frames: list[tuple[str, str, np.ndarray]]) -> None:
        """Where fixed frames stand: parent, child, and the matrix [4, 4] from child to parent."""
        transforms = [transform_message(START_NS, *frame) for frame in frames]
        message = T["tf2_msgs/msg/TFMessage"](transforms=transforms)
        self.add(START_NS - 400_000_000, "/tf_static", "tf2_msgs/msg/TFMessage", message)

    def add_motion(self, drive: Drive, until_s: float) -> None:
        """/tf map -> odom -> base_link and /odom, 50 Hz."""
        for tick in range(-25, int(until_s * 50) + 25):
            seconds = tick / 50
            time_ns = START_NS + round(seconds * 1e9)
            transforms = [transform_message(time_ns, "odom", "base_link", drive.level_pose_at(seconds))]
            message = T["tf2_msgs/msg/TFMessage"](transforms=transforms)
            self.add(time_ns, "/tf", "tf2_msgs/msg/TFMessage", message)
            self.add(time_ns, "/odom", "nav_msgs/msg/Odometry", odometry_message(time_ns, drive, seconds))
