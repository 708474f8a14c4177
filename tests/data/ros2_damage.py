"""Damaged bags of ROS 2, one folder a fault."""

import numpy as np
from ros2_bag import Bag, add_motion
from ros2_world import (
    BASE_FROM_LIDAR,
    BASE_FROM_OPTICAL,
    HEIGHT,
    START_NS,
    WIDTH,
    K,
    camera_info,
    cloud,
    cloud_message,
    header,
    image_message,
    make,
    tf_message,
)

# --- damaged variants ---


def small(
    out,
    name,
    *,
    cloud_of=None,
    info_of=None,
    tf_edges=None,
    image_late_ns=0,
    size=(WIDTH, HEIGHT),
    d=None,
    model=None,
    camera="camera_optical",
):
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
        image = image_message(image_ns, camera, i)
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
    roi = make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=4, y_offset=0, height=40, width=60, do_rectify=False
    )
    small(out, "empty_cloud", cloud_of=without_points)
    small(out, "nan_points", cloud_of=with_nan)
    small(out, "out_of_order", cloud_of=out_of_order)
    small(out, "short_cloud", cloud_of=too_short)
    small(out, "zero_k", info_of=lambda info: with_fields(info, k=np.zeros(9)))
    small(out, "binned", info_of=lambda info: with_fields(info, binning_x=2, binning_y=2))
    small(out, "region", info_of=lambda info: with_fields(info, roi=roi))
    small(out, "other_size", size=(128, 96))
    small(out, "late_camera", image_late_ns=60_000_000)
    small(
        out,
        "no_tf_path",
        tf_edges=[("base_link", "camera_optical", BASE_FROM_OPTICAL), ("gps", "lidar", np.eye(4))],
    )
    small(out, "fisheye", d=[0.05, 0.01, -0.002, 0.001], model="equidistant")
    small(out, "plumb_bob", d=[-0.3, 0.1, 0.001, -0.001, 0.02])
