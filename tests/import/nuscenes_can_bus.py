"""The CAN bus files of a made nuScenes scene: what the car measured of its own drive."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from made_world import WHEELBASE_M, Drive, quaternion

STEERING_RATIO = 15.2  # of the steering wheel's angle to the road wheels'


def save_can_bus(folder: Path, name: str, drive: Drive, zero_us: int, seconds: float) -> None:
    """The CAN bus expansion's files: each at its own rate and in its own units, as in the original."""
    folder.mkdir(parents=True, exist_ok=True)

    def save(kind: str, rate_hz: float, row: object) -> None:
        times = np.arange(-0.5, seconds, 1 / rate_hz)
        rows = [{"utime": zero_us + round(t * 1e6), **row(float(t))} for t in times]
        (folder / f"{name}_{kind}.json").write_text(json.dumps(rows))

    curvature = np.tan(drive.steering_rad) / WHEELBASE_M
    kmh = lambda t: drive.speed_at(t) * 3.6  # noqa: E731

    def pose_row(t: float) -> dict:
        matrix = drive.pose_at(t)
        return {
            "accel": [drive.acceleration_mps2, drive.speed_at(t) ** 2 * curvature, 9.81],
            "orientation": quaternion(matrix[:3, :3]),
            "pos": matrix[:3, 3].tolist(),
            "rotation_rate": [0.0, 0.0, drive.speed_at(t) * curvature],
            "vel": [drive.speed_at(t), 0.0, 0.0],
        }

    save("pose", 50, pose_row)
    save("steeranglefeedback", 100, lambda t: {"value": drive.steering_rad * STEERING_RATIO})
    save(
        "vehicle_monitor",
        2,
        lambda t: {
            "available_distance": 95,
            "battery_level": 87,
            "brake": 0,
            "brake_switch": 2,
            "gear_position": 7,
            "left_signal": 0,
            "rear_left_rpm": kmh(t) / 0.1156,
            "rear_right_rpm": kmh(t) / 0.1156,
            "right_signal": 0,
            "steering": float(np.degrees(drive.steering_rad) * STEERING_RATIO),
            "steering_speed": 0.0,
            "throttle": 20,
            "vehicle_speed": kmh(t),
            "yaw_rate": float(np.degrees(drive.speed_at(t) * curvature)),
        },
    )
    save(
        "zoe_veh_info",
        100,
        lambda t: {
            "FL_wheel_speed": kmh(t) / 0.1156,
            "FR_wheel_speed": kmh(t) / 0.1156,
            "RL_wheel_speed": kmh(t) / 0.1156,
            "RR_wheel_speed": kmh(t) / 0.1156,
            "longitudinal_accel": drive.acceleration_mps2,
            "odom_speed": kmh(t),
            "steer_corrected": float(np.degrees(drive.steering_rad) * STEERING_RATIO),
            "steer_offset_can": 0.0,
            "steer_raw": float(np.degrees(drive.steering_rad) * STEERING_RATIO),
            "transversal_accel": 0.0,
        },
    )
    save(
        "ms_imu",
        100,
        lambda t: {
            "linear_accel": [drive.acceleration_mps2, 0.0, 9.81],
            "q": quaternion(drive.pose_at(t)[:3, :3]),
            "rotation_rate": [0.0, 0.0, drive.speed_at(t) * curvature],
        },
    )
