"""Bags of ROS 2 that mislead an import which guesses, one folder a thing.

`tests/import_ros2/guesses.rs` says what each tells.
"""

import shutil

import numpy as np
from ros2_bag import Bag, add_motion
from ros2_world import (
    BASE_FROM_LIDAR,
    BASE_FROM_OPTICAL,
    N_CLOUDS,
    RADIUS_M,
    RINGS,
    SPEED_MPS,
    START_NS,
    K,
    boxes_message,
    camera_info,
    cloud,
    cloud_message,
    header,
    image_message,
    make,
    point,
    pose,
    quaternion,
    tf_message,
    vector,
    world_from_base,
)

YAW_RATE_RPS = SPEED_MPS / RADIUS_M
MOTION_NS = [START_NS + i * 20_000_000 for i in range(-5, 35)]


def begin(path, *, edges=(), lidar=BASE_FROM_LIDAR, shift_ns=0):
    bag = Bag(path)
    static = [("base_link", "lidar", lidar), ("base_link", "camera_optical", BASE_FROM_OPTICAL), *edges]
    at_ns = START_NS + shift_ns
    bag.add("/tf_static", "tf2_msgs/msg/TFMessage", tf_message(static, at_ns), at_ns - 200_000_000)
    return bag


def add_clouds(
    bag, *, topic="/lidar/points", frame="lidar", n=N_CLOUDS, shift_ns=0, moved=None, fields=None, rows=1
):
    """`moved`: 4 x 4 by time; `fields`: further columns by time, scan and points, which it may change."""
    rng = np.random.default_rng(1)
    for i in range(n):
        time_ns = START_NS + i * 100_000_000
        scan = cloud(time_ns, rng)
        points = scan.measured.copy()
        if moved is not None:
            of = moved(time_ns)
            points = points @ of[:3, :3].T + of[:3, 3]
        further = fields(time_ns, scan, points) if fields else []
        columns = [(axis, 4 * j, "f4", points[:, j]) for j, axis in enumerate("xyz")]
        columns.append(("ring", 12, "u2", scan.ring))
        names = [name for name, *_ in further]
        if "intensity" not in names:
            columns.append(("intensity", 16, "f4", scan.intensity))
        message = cloud_message(time_ns + shift_ns, frame, [*columns, *further], step=48, rows=rows)
        bag.add(topic, "sensor_msgs/msg/PointCloud2", message, time_ns + shift_ns + 110_000_000)


def add_pictures(bag, *, numbers=range(N_CLOUDS)):
    for i in numbers:
        time_ns = START_NS + i * 100_000_000 + 12_000_000
        image = image_message(time_ns, "camera_optical", i)
        bag.add("/camera/image_raw", "sensor_msgs/msg/Image", image, time_ns)
        info = camera_info(time_ns, "camera_optical", K)
        bag.add("/camera/camera_info", "sensor_msgs/msg/CameraInfo", info, time_ns)


def add_odometry(bag, *, speed_mps=SPEED_MPS, has_pose=True):
    nothing = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=0.0)
    for time_ns in MOTION_NS:
        of = world_from_base(time_ns)
        orientation = quaternion(of) if has_pose else nothing
        here = make("geometry_msgs/msg/Pose", position=point(*of[:3, 3]), orientation=orientation)
        linear, angular = vector(speed_mps, 0, 0), vector(0, 0, YAW_RATE_RPS)
        twist = make("geometry_msgs/msg/Twist", linear=linear, angular=angular)
        odometry = make(
            "nav_msgs/msg/Odometry",
            header=header(time_ns, "odom"),
            child_frame_id="base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=here, covariance=np.zeros(36)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        bag.add("/odom", "nav_msgs/msg/Odometry", odometry, time_ns)


def add_twist(bag, topic, frame, linear):
    for time_ns in MOTION_NS:
        twist = make("geometry_msgs/msg/Twist", linear=vector(*linear), angular=vector(0, 0, 0))
        message = make("geometry_msgs/msg/TwistStamped", header=header(time_ns, frame), twist=twist)
        bag.add(topic, "geometry_msgs/msg/TwistStamped", message, time_ns)


def add_imu(bag, yaw_rate_rps):
    upright, zeros = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0), np.zeros(9)
    for time_ns in MOTION_NS:
        imu = make(
            "sensor_msgs/msg/Imu",
            header=header(time_ns, "imu_link"),
            orientation=upright,
            orientation_covariance=zeros,
            angular_velocity=vector(0, 0, yaw_rate_rps),
            angular_velocity_covariance=zeros,
            linear_acceleration=vector(0, 0, 9.8),
            linear_acceleration_covariance=zeros,
        )
        bag.add("/imu", "sensor_msgs/msg/Imu", imu, time_ns)


def add_poses(bag, times_ns, *, turn=None):
    """Poses of a topic; `turn` replaces their orientation."""
    for time_ns in times_ns:
        of = world_from_base(time_ns)
        orientation = quaternion(of if turn is None else turn)
        here = make("geometry_msgs/msg/Pose", position=point(*of[:3, 3]), orientation=orientation)
        message = make("geometry_msgs/msg/PoseStamped", header=header(time_ns, "map"), pose=here)
        bag.add("/localization/pose", "geometry_msgs/msg/PoseStamped", message, time_ns)


def add_boxes(bag, topic, numbers, *, name=None):
    for i in numbers:
        time_ns = START_NS + i * 100_000_000
        message, _ = boxes_message(time_ns)
        for detection in message.detections:
            if name is not None:
                object.__setattr__(detection, "id", name)
        bag.add(topic, "vision_msgs/msg/Detection3DArray", message, time_ns + 120_000_000)


def with_signal(_time_ns, scan, _points):
    """An Ouster's: the intensity is the number of photons, beyond 255."""
    return [("intensity", 16, "f4", scan.intensity * 15.0), ("reflectivity", 20, "u2", scan.intensity)]


def with_holes(time_ns, scan, points):
    """No return at some places of the organised cloud: NaN, and the stamp 0."""
    stamps = time_ns * 1e-9 + scan.offset_s
    missing = np.arange(len(points)) % 7 == 3
    points[missing], stamps[missing] = np.nan, 0.0
    return [("timestamp", 24, "f8", stamps)]


def of_motion(out):
    """What poses, twists and IMUs may have wrong."""
    bag = begin(out / "zero_twist")
    add_odometry(bag, speed_mps=0.0)
    add_clouds(bag)
    bag.close()

    bag = begin(out / "no_poses")
    add_odometry(bag, has_pose=False)
    add_clouds(bag)
    bag.close()

    bag = begin(out / "static_map", edges=[("map", "base_link", np.eye(4))])
    add_clouds(bag)
    bag.close()

    bag = begin(out / "gnss_velocity")
    add_twist(bag, "/gnss/velocity", "gnss", (-0.2, SPEED_MPS, 0))
    add_clouds(bag)
    bag.close()

    down = ("base_link", "imu_link", pose(0, 0, 0, np.pi, 0, 0))
    bag = begin(out / "imu_below", edges=[down])
    add_twist(bag, "/vehicle/twist", "base_link", (SPEED_MPS, 0, 0))
    add_imu(bag, -YAW_RATE_RPS)
    add_clouds(bag)
    bag.close()

    bag = begin(out / "imu_mirrored", edges=[("base_link", "imu_link", np.eye(4))])
    add_motion(bag)
    add_imu(bag, -YAW_RATE_RPS)
    add_clouds(bag)
    bag.close()

    bag = begin(out / "heading_aside")
    add_poses(bag, MOTION_NS, turn=pose(0, 0, 0, 0, 0, np.pi / 2))
    add_clouds(bag)
    bag.close()

    bag = begin(out / "slow_poses")
    add_poses(bag, [START_NS + i * 1_001_000_000 for i in range(-1, 5)])
    add_clouds(bag, n=20)
    bag.close()

    bag = begin(out / "hole")
    add_poses(bag, [START_NS + i * 20_000_000 for i in [*range(-5, 10), *range(150, 180)]])
    add_clouds(bag, n=33)
    bag.close()


def of_sensors(out):
    """What clouds and pictures may have wrong."""
    bag = begin(out / "registered")
    add_motion(bag)
    add_clouds(bag)
    moved = {"moved": lambda time_ns: world_from_base(time_ns) @ BASE_FROM_LIDAR}
    add_clouds(bag, topic="/cloud_registered", frame="odom", **moved)
    bag.close()

    bag = begin(out / "world_alone")
    add_motion(bag)
    add_clouds(bag, topic="/cloud", frame="odom", **moved)
    bag.close()

    bag = begin(out / "lidars", edges=[("base_link", "lidar_left", BASE_FROM_LIDAR)])
    add_motion(bag)
    add_clouds(bag, topic="/lidar_left/points", frame="lidar_left")
    add_clouds(bag, topic="/lidar_top/points")
    bag.close()

    bag = begin(out / "ouster")
    add_motion(bag)
    add_clouds(bag, fields=with_signal)
    bag.close()

    bag = begin(out / "holes_in_cloud")
    add_motion(bag)
    add_clouds(bag, fields=with_holes, rows=RINGS)
    bag.close()

    bag = begin(out / "tilted", lidar=pose(1.2, 0, 1.5, 0, np.radians(25), 0))
    add_motion(bag)
    add_clouds(bag)
    bag.close()

    bag = begin(out / "slow_camera")
    add_motion(bag)
    add_clouds(bag)
    add_pictures(bag, numbers=(0, 2, 4))
    bag.close()


def of_boxes(out):
    """Boxes at some clouds, of a detector, without ids of use."""
    bag = begin(out / "boxes_of_some")
    add_motion(bag)
    add_clouds(bag)
    add_boxes(bag, "/boxes", (1, 3))
    bag.close()

    bag = begin(out / "same_ids")
    add_motion(bag)
    add_clouds(bag)
    add_boxes(bag, "/a_detector/boxes", range(N_CLOUDS))
    add_boxes(bag, "/boxes_gt", range(N_CLOUDS), name="0")
    bag.close()


def of_folders(out):
    """Two drives an hour apart, of another mounting each, as files of one folder without metadata."""
    (out / "two_drives").mkdir(exist_ok=True)
    for i, lidar in enumerate([BASE_FROM_LIDAR, BASE_FROM_LIDAR @ pose(-0.5, 0, 0.4, 0, 0, 0)]):
        shift_ns = i * 3_600_000_000_000
        bag = begin(out / f"drive{i}", lidar=lidar, shift_ns=shift_ns)
        add_clouds(bag, shift_ns=shift_ns)
        bag.close()
        shutil.move(next((out / f"drive{i}").glob("*.mcap")), out / "two_drives" / f"drive{i}.mcap")
        shutil.rmtree(out / f"drive{i}")


def misleading(out):
    of_motion(out)
    of_sensors(out)
    of_boxes(out)
    of_folders(out)
