"""The made drive of the bags of ROS 2, and its messages.

A car on a circle to the left, clouds at 10 Hz whose points are measured while it moves, a wall of points
around it, two boxes. `base_link` is at the rear axle, 0.3 m over the ground.
"""

from dataclasses import dataclass

import numpy as np
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


# --- the made drive ---


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
            transform=make(
                "geometry_msgs/msg/Transform", translation=vector(*of[:3, 3]), rotation=quaternion(of)
            ),
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
        [
            np.cos(elevation[ring]) * np.cos(azimuth),
            np.cos(elevation[ring]) * np.sin(azimuth),
            np.sin(elevation[ring]),
        ]
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


def image_message(time_ns, frame, i):
    """Picture `i` as rgb8."""
    return make(
        "sensor_msgs/msg/Image",
        header=header(time_ns, frame),
        height=HEIGHT,
        width=WIDTH,
        encoding="rgb8",
        is_bigendian=0,
        step=WIDTH * 3,
        data=picture(i).reshape(-1),
    )


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
        roi=make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        ),
    )


K = np.array([[40.0, 0, 31.5], [0, 41.0, 23.5], [0, 0, 1]])

# Centre on the ground at the first cloud, in the world; length, width, height, yaw, class.
BOXES = [
    ("car-7", "car", (12.0, 2.0), (4.2, 1.9, 1.6), 0.4),
    ("p-1", "pedestrian", (9.0, -3.0), (0.7, 0.6, 1.8), -2.0),
]


def boxes_message(time_ns):
    base_from_world = np.linalg.inv(world_from_base(time_ns))
    detections, expected = [], []
    for name, kind, (x, y), (length, width, height), yaw in BOXES:
        in_base = base_from_world @ pose(x, y, height / 2, 0, 0, yaw)
        center = make(
            "geometry_msgs/msg/Pose", position=point(*in_base[:3, 3]), orientation=quaternion(in_base)
        )
        hypothesis = make("vision_msgs/msg/ObjectHypothesis", class_id=kind, score=0.9)
        nothing = make("geometry_msgs/msg/PoseWithCovariance", pose=center, covariance=np.zeros(36))
        detections.append(
            make(
                "vision_msgs/msg/Detection3D",
                header=header(time_ns, "base_link"),
                results=[
                    make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=nothing)
                ],
                bbox=make("vision_msgs/msg/BoundingBox3D", center=center, size=vector(length, width, height)),
                id=name,
            )
        )
        in_ego = EGO_FROM_BASE @ in_base
        yaw_in_ego = float(np.arctan2(in_ego[1, 0], in_ego[0, 0]))
        box = [*in_ego[:3, 3].tolist(), length, width, height, yaw_in_ego]
        expected.append({"id": name, "category": kind, "box": box})
    message = make(
        "vision_msgs/msg/Detection3DArray", header=header(time_ns, "base_link"), detections=detections
    )
    return message, expected
