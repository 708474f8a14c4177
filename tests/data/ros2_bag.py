"""A bag of ROS 2 being written by `rosbags`, and what stands in a sample of it."""

import shutil
from pathlib import Path

import numpy as np
from ros2_world import (
    BASE_FROM_LIDAR,
    EGO_FROM_BASE,
    RADIUS_M,
    SPEED_MPS,
    START_NS,
    STORE,
    WHEELBASE_M,
    header,
    make,
    tf_message,
    world_from_base,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

# --- bags ---


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
    """Tf at 50 Hz, from before the first cloud to after the last turn."""
    for i in range(-5, 35):
        time_ns = START_NS + i * 20_000_000
        bag.add(
            "/tf",
            "tf2_msgs/msg/TFMessage",
            tf_message([(fixed, base, world_from_base(time_ns))], time_ns),
            time_ns,
        )


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


def sample_of(time_ns, scan, k, base_from_optical, image_ns, boxes):
    """`image_ns`: of the picture, whose camera is where the car was then."""
    base_from_base = np.linalg.inv(world_from_base(time_ns)) @ world_from_base(image_ns)
    return {
        "time_ns": time_ns,
        "world_from_ego": (world_from_base(time_ns) @ np.linalg.inv(EGO_FROM_BASE)).tolist(),
        "ego_from_lidar": (EGO_FROM_BASE @ BASE_FROM_LIDAR).tolist(),
        "ego_from_camera": (EGO_FROM_BASE @ base_from_base @ base_from_optical).tolist(),
        "k": k.tolist(),
        "points": [
            [*np.round(at, 6).tolist(), float(intensity), int(ring)]
            for at, intensity, ring in zip(scan.at_stamp, scan.intensity, scan.ring, strict=True)
        ],
        "boxes": boxes,
    }
