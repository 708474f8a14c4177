"""Makes bags of ROS 2 with `rosbags`, and JSON of what stands in them, computed here and not by harmzone.

`plain` and `odd` are the fixtures of `tests/import_ros2.rs`: `python tests/data/make_ros2_bags.py tests/data/ros2`
(pip install rosbags numpy pillow). `--kitti DIR OUT` makes a bag of KITTI's object frames instead, for a look at real ones.

The made drive: a car on a circle to the left, seven clouds at 10 Hz whose points are measured while it moves, a
wall of points around it, two boxes. `base_link` is at the rear axle, 0.3 m over the ground.
"""

import argparse
import io
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_NS = 1_700_000_000_000_000_000
SPEED_MPS = 5.0
RADIUS_M = 20.0
WHEELBASE_M = 2.8
BASE_HEIGHT_M = 0.3
N_CLOUDS = 5
TURN_S = 0.1
RINGS, COLUMNS = 8, 20
WIDTH, HEIGHT = 64, 48

OWN_TYPES = {
    "car_msgs/msg/Wheel": "float64 rps\nuint8 FLAG=0x01\n",
    "car_msgs/msg/VehicleStatus": "std_msgs/Header header\nstring<=16 name\ncar_msgs/Wheel[4] wheels\n"
    "float32 speed_kph\nint16 steering_wheel_deg\n",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}


def typestore():
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {}
    for name, text in OWN_TYPES.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


STORE = typestore()


def make(kind, /, **fields):
    return STORE.types[kind](**fields)


def stamp(time_ns):
    return make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)


def header(time_ns, frame):
    return make("std_msgs/msg/Header", stamp=stamp(time_ns), frame_id=frame)


# --- the made drive ---------------------------------------------------------------------------------------------------


def pose(x, y, z, roll, pitch, yaw):
    """4 x 4, roll about x first, then pitch about y, then yaw about z."""
    cr, sr, cp, sp, cy, sy = (f(angle) for angle in (roll, pitch, yaw) for f in (np.cos, np.sin))
    made = np.eye(4)
    made[:3, :3] = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    made[:3, 3] = x, y, z
    return made


def world_from_base(time_ns):
    """The car on its circle; the base frame is BASE_HEIGHT_M over the ground."""
    angle = SPEED_MPS / RADIUS_M * (time_ns - START_NS) * 1e-9
    return pose(RADIUS_M * np.sin(angle), RADIUS_M * (1 - np.cos(angle)), BASE_HEIGHT_M, 0, 0, angle)


BODY_FROM_OPTICAL = np.eye(4)
BODY_FROM_OPTICAL[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
BASE_FROM_LIDAR = pose(1.2, 0.05, 1.5, 0.01, -0.02, 0.03)
BASE_FROM_CAMERA_BODY = pose(1.6, -0.1, 1.2, 0.005, 0.02, -0.01)
BASE_FROM_OPTICAL = BASE_FROM_CAMERA_BODY @ BODY_FROM_OPTICAL
EGO_FROM_BASE = pose(0, 0, BASE_HEIGHT_M, 0, 0, 0)


def quaternion(matrix):
    """x, y, z, w of the rotation of a 4 x 4."""
    m = matrix[:3, :3]
    w = np.sqrt(max(0.0, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
    if w < 0.1:
        x = np.sqrt(max(0.0, 1 + m[0, 0] - m[1, 1] - m[2, 2])) / 2
        y = np.sqrt(max(0.0, 1 - m[0, 0] + m[1, 1] - m[2, 2])) / 2
        z = np.sqrt(max(0.0, 1 - m[0, 0] - m[1, 1] + m[2, 2])) / 2
        x, y, z = np.copysign([x, y, z], [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
        return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    x, y, z = (m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w)
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def point(x, y, z):
    return make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))


def vector(x, y, z):
    return make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def tf_message(edges, time_ns):
    """Edges: parent, child, 4 x 4."""
    transforms = [
        make(
            "geometry_msgs/msg/TransformStamped",
            header=header(time_ns, parent),
            child_frame_id=child,
            transform=make("geometry_msgs/msg/Transform", translation=vector(*of[:3, 3]), rotation=quaternion(of)),
        )
        for parent, child, of in edges
    ]
    return make("tf2_msgs/msg/TFMessage", transforms=transforms)


@dataclass
class Cloud:
    """Points of a turn: in the LiDAR frame when measured, and where that was at the cloud's stamp."""

    measured: np.ndarray
    at_stamp: np.ndarray
    intensity: np.ndarray
    ring: np.ndarray
    offset_s: np.ndarray


def cloud(time_ns, rng):
    """Points of rings from below, at rest in the world, seen one column after another."""
    elevation = np.radians(np.linspace(-12, 6, RINGS))
    ring, column = np.meshgrid(np.arange(RINGS), np.arange(COLUMNS), indexing="ij")
    azimuth = np.radians(-60 + 120 * column / COLUMNS)
    offset_s = column / COLUMNS * TURN_S
    rng_m = 6 + 20 * rng.random(ring.shape)
    beam = np.stack(
        [np.cos(elevation[ring]) * np.cos(azimuth), np.cos(elevation[ring]) * np.sin(azimuth), np.sin(elevation[ring])]
    )
    measured = (beam * rng_m).reshape(3, -1).T
    offset_s = np.round(offset_s.reshape(-1) * 1e9) * 1e-9
    now_from_world = np.linalg.inv(world_from_base(time_ns) @ BASE_FROM_LIDAR)
    at_stamp = np.empty_like(measured)
    measured = measured.astype(np.float32).astype(float)
    for i, (at, offset) in enumerate(zip(measured, offset_s, strict=True)):
        then = world_from_base(time_ns + round(offset * 1e9)) @ BASE_FROM_LIDAR
        at_stamp[i] = (now_from_world @ then @ [*at, 1])[:3]
    # Each point of a cloud is known again by its ring and intensity.
    intensity = np.tile(np.arange(COLUMNS) * 10, (RINGS, 1)).reshape(-1)
    return Cloud(measured, at_stamp, intensity, ring.reshape(-1), offset_s)


TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def cloud_message(time_ns, frame, columns, *, step, big_endian=False, rows=1, row_padding=0):
    """Columns: name, offset, type, values."""
    n = len(columns[0][3])
    order = ">" if big_endian else "<"
    layout = np.dtype(
        {
            "names": [name for name, *_ in columns],
            "offsets": [offset for _, offset, _, _ in columns],
            "formats": [order + kind for _, _, kind, _ in columns],
            "itemsize": step,
        }
    )
    records = np.zeros(n, layout)
    for name, _, _, values in columns:
        records[name] = values
    width = n // rows
    data = b"".join(
        records[row * width : (row + 1) * width].tobytes() + b"\xab" * row_padding for row in range(rows)
    )
    return make(
        "sensor_msgs/msg/PointCloud2",
        header=header(time_ns, frame),
        height=rows,
        width=width,
        fields=[
            make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=TYPES[kind], count=1)
            for name, offset, kind, _ in columns
        ],
        is_bigendian=big_endian,
        point_step=step,
        row_step=width * step + row_padding,
        data=np.frombuffer(data, np.uint8),
        is_dense=True,
    )


def picture(i):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([x * 4, y * 5, np.full_like(x, 40 * i)], axis=-1).astype(np.uint8)


def camera_info(time_ns, frame, k, *, model="plumb_bob", d=(0.0,) * 5, p=None, size=(WIDTH, HEIGHT)):
    p = np.zeros(12) if p is None else p
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header(time_ns, frame),
        height=size[1],
        width=size[0],
        distortion_model=model,
        d=np.array(d, float),
        k=np.array(k, float).reshape(-1),
        r=np.eye(3).reshape(-1),
        p=np.array(p, float),
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


K = np.array([[40.0, 0, 31.5], [0, 41.0, 23.5], [0, 0, 1]])

# Centre on the ground at the first cloud, in the world; length, width, height, yaw, class.
BOXES = [("car-7", "car", (12.0, 2.0), (4.2, 1.9, 1.6), 0.4), ("p-1", "pedestrian", (9.0, -3.0), (0.7, 0.6, 1.8), -2.0)]


def boxes_message(time_ns):
    base_from_world = np.linalg.inv(world_from_base(time_ns))
    detections, expected = [], []
    for name, kind, (x, y), (length, width, height), yaw in BOXES:
        in_base = base_from_world @ pose(x, y, height / 2, 0, 0, yaw)
        center = make("geometry_msgs/msg/Pose", position=point(*in_base[:3, 3]), orientation=quaternion(in_base))
        hypothesis = make("vision_msgs/msg/ObjectHypothesis", class_id=kind, score=0.9)
        nothing = make("geometry_msgs/msg/PoseWithCovariance", pose=center, covariance=np.zeros(36))
        detections.append(
            make(
                "vision_msgs/msg/Detection3D",
                header=header(time_ns, "base_link"),
                results=[make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=nothing)],
                bbox=make("vision_msgs/msg/BoundingBox3D", center=center, size=vector(length, width, height)),
                id=name,
            )
        )
        in_ego = EGO_FROM_BASE @ in_base
        yaw_in_ego = float(np.arctan2(in_ego[1, 0], in_ego[0, 0]))
        box = [*in_ego[:3, 3].tolist(), length, width, height, yaw_in_ego]
        expected.append({"id": name, "category": kind, "box": box})
    message = make("vision_msgs/msg/Detection3DArray", header=header(time_ns, "base_link"), detections=detections)
    return message, expected


# --- bags -------------------------------------------------------------------------------------------------------------


class Bag:
    """A bag that is written in the order of log times."""

    def __init__(self, path, *, little_endian=True, compress=True):
        shutil.rmtree(path, ignore_errors=True)
        self.path, self.little_endian, self.compress, self.messages = Path(path), little_endian, compress, []

    def add(self, topic, kind, message, log_time_ns):
        self.messages.append((log_time_ns, len(self.messages), topic, kind, message))

    def write(self, path, messages):
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        if self.compress:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections = {}
            for _, _, topic, kind, _ in self.messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            for log_time_ns, _, topic, kind, message in messages:
                data = STORE.serialize_cdr(message, kind, little_endian=self.little_endian)
                writer.write(connections[topic], log_time_ns, data)

    def close(self, *, n_files=1):
        self.messages.sort(key=lambda message: message[:2])
        if n_files == 1:
            self.write(self.path, self.messages)
            return
        # The package writes one file; rosbag2 splits into files of one folder, whose metadata lists them.
        parts = np.array_split(np.arange(len(self.messages)), n_files)
        self.path.mkdir(parents=True)
        names = []
        for i, part in enumerate(parts):
            folder = self.path / f"part{i}"
            self.write(folder, [self.messages[j] for j in part])
            names.append(f"{self.path.name}_{i}.mcap")
            shutil.move(next(folder.glob("*.mcap")), self.path / names[-1])
            metadata = (folder / "metadata.yaml").read_text()
            shutil.rmtree(folder)
        lines = []
        for line in metadata.splitlines():
            if ".mcap" in line and line.strip().startswith("- "):
                lines += [line[: len(line) - len(line.lstrip())] + "- " + name for name in names]
            elif line.strip().startswith("- path:") or ".mcap" not in line:
                lines.append(line)
        (self.path / "metadata.yaml").write_text("\n".join(lines) + "\n")


def add_motion(bag, *, base="base_link", fixed="odom"):
    """tf at 50 Hz, from before the first cloud to after the last turn."""
    for i in range(-5, 35):
        time_ns = START_NS + i * 20_000_000
        bag.add("/tf", "tf2_msgs/msg/TFMessage", tf_message([(fixed, base, world_from_base(time_ns))], time_ns), time_ns)


def add_status(bag):
    """Speed in km/h and the steering wheel in degrees (whole ones), in a type that nobody has seen before."""
    wheel_deg = round(np.degrees(np.arctan(WHEELBASE_M / RADIUS_M)) * 15)
    for i in range(-5, 35):
        time_ns = START_NS + i * 20_000_000
        status = make(
            "car_msgs/msg/VehicleStatus",
            header=header(time_ns, "base_link"),
            name="harmzone",
            wheels=[make("car_msgs/msg/Wheel", rps=float(n)) for n in range(4)],
            speed_kph=np.float32(SPEED_MPS * 3.6),
            steering_wheel_deg=wheel_deg,
        )
        bag.add("/vehicle/status", "car_msgs/msg/VehicleStatus", status, time_ns + 3_000_000)
    return np.radians(wheel_deg / 15)


def sample_of(time_ns, scan, k, base_from_optical, boxes):
    return {
        "time_ns": time_ns,
        "world_from_ego": (world_from_base(time_ns) @ np.linalg.inv(EGO_FROM_BASE)).tolist(),
        "ego_from_lidar": (EGO_FROM_BASE @ BASE_FROM_LIDAR).tolist(),
        "ego_from_camera": (EGO_FROM_BASE @ base_from_optical).tolist(),
        "k": k.tolist(),
        "points": [
            [*np.round(at, 6).tolist(), float(intensity), int(ring)]
            for at, intensity, ring in zip(scan.at_stamp, scan.intensity, scan.ring, strict=True)
        ],
        "boxes": boxes,
    }


def plain(out):
    """Little-endian, one file: packed floats, u32 nanoseconds, bgr8 in padded rows, optical camera frame, boxes, status."""
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
            ("x", 0, "f4", scan.measured[:, 0]), ("y", 4, "f4", scan.measured[:, 1]), ("z", 8, "f4", scan.measured[:, 2]),
            ("intensity", 16, "u1", scan.intensity), ("t", 20, "u4", np.round(scan.offset_s * 1e9)),
            ("ring", 26, "u2", scan.ring),
        ]  # fmt: skip
        bag.add("/lidar/points", "sensor_msgs/msg/PointCloud2", cloud_message(time_ns, "lidar", columns, step=32), time_ns + 110_000_000)
        rows = np.zeros((HEIGHT, WIDTH * 3 + 8), np.uint8)
        rows[:, : WIDTH * 3] = picture(i)[..., ::-1].reshape(HEIGHT, -1)
        image_ns = time_ns + 12_000_000
        image = make(
            "sensor_msgs/msg/Image", header=header(image_ns, "camera_optical"), height=HEIGHT, width=WIDTH, encoding="bgr8",
            is_bigendian=0, step=rows.shape[1], data=rows.reshape(-1),
        )  # fmt: skip
        bag.add("/camera/front/image_raw", "sensor_msgs/msg/Image", image, image_ns + 5_000_000)
        info = camera_info(image_ns, "camera_optical", K)
        bag.add("/camera/front/camera_info", "sensor_msgs/msg/CameraInfo", info, image_ns + 5_000_000)
        message, boxes = boxes_message(time_ns)
        bag.add("/boxes", "vision_msgs/msg/Detection3DArray", message, time_ns + 120_000_000)
        expected.append(sample_of(time_ns, scan, K, BASE_FROM_OPTICAL, boxes))
    bag.close()
    return {"samples": expected, "speed_mps": SPEED_MPS, "steering_rad": steering_rad, "wheelbase_m": WHEELBASE_M}


def odd(out):
    """Big-endian, two files: organised float64 cloud with padded rows, rings from above, times of the epoch, PNG 35 ms late, rectified by P,
    body-axes camera frame under a mount, odometry topic instead of tf, slashes before frames."""
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
        twist = make("geometry_msgs/msg/Twist", linear=vector(SPEED_MPS, 0, 0), angular=vector(0, 0, SPEED_MPS / RADIUS_M))
        odometry = make(
            "nav_msgs/msg/Odometry", header=header(time_ns, "/odom"), child_frame_id="/base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=here, covariance=np.zeros(36)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )  # fmt: skip
        bag.add("/odometry", "nav_msgs/msg/Odometry", odometry, time_ns)
        steering = make("std_msgs/msg/Float64", data=float(np.degrees(np.arctan(WHEELBASE_M / RADIUS_M))))
        bag.add("/steering_angle", "std_msgs/msg/Float64", steering, time_ns)
    p = np.hstack([K, np.zeros((3, 1))])
    for i in range(N_CLOUDS):
        time_ns = START_NS + i * 100_000_000
        scan = cloud(time_ns, rng)
        order = np.argsort(-scan.ring, kind="stable")  # the first row is the highest ring
        columns = [
            ("x", 0, "f8", scan.measured[order, 0]), ("y", 8, "f8", scan.measured[order, 1]),
            ("z", 16, "f8", scan.measured[order, 2]), ("reflectivity", 24, "u2", scan.intensity[order]),
            ("channel", 26, "u1", RINGS - 1 - scan.ring[order]), ("timestamp", 32, "f8", time_ns * 1e-9 + scan.offset_s[order]),
        ]  # fmt: skip
        message = cloud_message(time_ns, "/velodyne", columns, step=40, big_endian=True, rows=RINGS, row_padding=16)
        bag.add("/points", "sensor_msgs/msg/PointCloud2", message, time_ns + 110_000_000)
        image_ns = time_ns + 35_000_000
        packed = io.BytesIO()
        Image.fromarray(picture(i)).save(packed, "png")
        image = make(
            "sensor_msgs/msg/CompressedImage", header=header(image_ns, "/camera"), format="rgb8; png compressed",
            data=np.frombuffer(packed.getvalue(), np.uint8),
        )  # fmt: skip
        bag.add("/cam/image_rect_color/compressed", "sensor_msgs/msg/CompressedImage", image, image_ns)
        raw_k = [90.0, 0, 30, 0, 90, 20, 0, 0, 1]
        info = camera_info(image_ns, "/camera", raw_k, model="rational_polynomial", d=[0.1] * 8, p=p.reshape(-1))
        bag.add("/cam/camera_info", "sensor_msgs/msg/CameraInfo", info, image_ns)
        expected.append(sample_of(time_ns, scan, K, BASE_FROM_OPTICAL, None))
    bag.close(n_files=2)
    steering_rad = float(np.arctan(WHEELBASE_M / RADIUS_M))
    return {"samples": expected, "speed_mps": SPEED_MPS, "steering_rad": steering_rad, "wheelbase_m": WHEELBASE_M}


# --- damaged variants -------------------------------------------------------------------------------------------------


def small(out, name, *, cloud_of=None, info_of=None, tf_edges=None, image_late_ns=0, size=(WIDTH, HEIGHT), d=None, model=None, camera="camera_optical"):
    """A bag of three clouds with one thing that is not right."""
    rng = np.random.default_rng(3)
    bag = Bag(out / name)
    static = tf_edges or [("base_link", "lidar", BASE_FROM_LIDAR), ("base_link", camera, BASE_FROM_OPTICAL)]
    bag.add("/tf_static", "tf2_msgs/msg/TFMessage", tf_message(static, START_NS), START_NS - 200_000_000)
    add_motion(bag)
    for i in range(3):
        time_ns = START_NS + i * 100_000_000
        scan = cloud(time_ns, rng)
        columns = [(axis, 4 * j, "f4", scan.measured[:, j]) for j, axis in enumerate("xyz")]
        columns.append(("intensity", 12, "f4", scan.intensity / 255))
        message = cloud_message(time_ns, "lidar", columns, step=16)
        message = cloud_of(message, i) if cloud_of else message
        bag.add("/points", "sensor_msgs/msg/PointCloud2", message, time_ns)
        image_ns = time_ns + image_late_ns
        image = make(
            "sensor_msgs/msg/Image", header=header(image_ns, camera), height=HEIGHT, width=WIDTH, encoding="rgb8",
            is_bigendian=0, step=WIDTH * 3, data=picture(i).reshape(-1),
        )  # fmt: skip
        bag.add("/image_raw", "sensor_msgs/msg/Image", image, time_ns)
        info = camera_info(image_ns, camera, K, size=size, d=d or (0.0,) * 5, model=model or "plumb_bob")
        bag.add("/camera_info", "sensor_msgs/msg/CameraInfo", info_of(info) if info_of else info, time_ns)
    bag.close()


def with_fields(message, **fields):
    for name, value in fields.items():
        object.__setattr__(message, name, value)
    return message


def without_points(message, i):
    return with_fields(message, width=0, row_step=0, data=np.zeros(0, np.uint8)) if i == 1 else message


def with_nan(message, i):
    data = message.data.copy()
    data[:4] = [0, 0, 0xC0, 0x7F]
    return with_fields(message, data=data)


def out_of_order(message, i):
    stamps = [0, 200_000_000, 100_000_000]
    return with_fields(message, header=header(START_NS + stamps[i], "lidar"))


def too_short(message, i):
    return with_fields(message, data=message.data[:-16]) if i == 2 else message


def damaged(out):
    """One folder a fault; `tests/import_ros2.rs` says which sentence each gives."""
    roi = make("sensor_msgs/msg/RegionOfInterest", x_offset=4, y_offset=0, height=40, width=60, do_rectify=False)
    small(out, "empty_cloud", cloud_of=without_points)
    small(out, "nan_points", cloud_of=with_nan)
    small(out, "out_of_order", cloud_of=out_of_order)
    small(out, "short_cloud", cloud_of=too_short)
    small(out, "zero_k", info_of=lambda info: with_fields(info, k=np.zeros(9)))
    small(out, "binned", info_of=lambda info: with_fields(info, binning_x=2, binning_y=2))
    small(out, "region", info_of=lambda info: with_fields(info, roi=roi))
    small(out, "other_size", size=(128, 96))
    small(out, "late_camera", image_late_ns=60_000_000)
    small(out, "no_tf_path", tf_edges=[("base_link", "camera_optical", BASE_FROM_OPTICAL), ("gps", "lidar", np.eye(4))])
    small(out, "fisheye", d=[0.05, 0.01, -0.002, 0.001], model="equidistant")
    small(out, "plumb_bob", d=[-0.3, 0.1, 0.001, -0.001, 0.02])


# --- KITTI ------------------------------------------------------------------------------------------------------------


def kitti(source, out):
    """KITTI's object frames as one bag, a frame each 0.5 s: frames do not follow each other, so the car stands still."""
    bag = Bag(out, compress=False)
    for i, path in enumerate(sorted((source / "velodyne").glob("*.bin"))):
        time_ns = START_NS + i * 500_000_000
        lines = (source / "calib" / f"{path.stem}.txt").read_text().split("\n")
        calib = {line.split(":")[0]: np.array(line.split(":")[1].split(), float) for line in lines if ":" in line}
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
        bag.add("/velodyne_points", "sensor_msgs/msg/PointCloud2", cloud_message(time_ns, "velodyne", columns, step=16), time_ns)
        pixels = np.asarray(Image.open(source / "image_2" / f"{path.stem}.png").convert("RGB"))
        height, width = pixels.shape[:2]
        frame = f"camera_{path.stem}"
        image = make(
            "sensor_msgs/msg/Image", header=header(time_ns, frame), height=height, width=width, encoding="rgb8",
            is_bigendian=0, step=width * 3, data=pixels.reshape(-1),
        )  # fmt: skip
        bag.add("/camera/image_rect_color", "sensor_msgs/msg/Image", image, time_ns)
        info = camera_info(time_ns, frame, p2[:, :3], p=np.hstack([p2[:, :3], np.zeros((3, 1))]).reshape(-1), size=(width, height))
        bag.add("/camera/camera_info", "sensor_msgs/msg/CameraInfo", info, time_ns)
    bag.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--kitti", type=Path, help="KITTI's folder `training`: make a bag of it instead")
    parser.add_argument("--damaged", action="store_true", help="make the damaged bags instead")
    args = parser.parse_args()
    if args.kitti:
        kitti(args.kitti, args.out)
        return
    args.out.mkdir(parents=True, exist_ok=True)
    if args.damaged:
        damaged(args.out)
        return
    for name, made in [("plain", plain(args.out)), ("odd", odd(args.out))]:
        (args.out / f"{name}.json").write_text(json.dumps(made) + "\n")


if __name__ == "__main__":
    main()
