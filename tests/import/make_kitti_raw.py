"""Lays KITTI's object frames out as a raw drive (date folder, calibration files, stamps, oxts), for tools
that read that layout.

Usage: make_kitti_raw.py TRAINING_DIR OUT [--offset-ms MS]

The frames are single shots, so the drive between them is made: a car on an arc, written as oxts packets that
`pykitti` turns into poses. `OUT/truth.npz` holds the poses of the IMU (first packet's place is the origin),
speed and steering.
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from made_world import WHEELBASE_M, Drive, pose
from PIL import Image

DATE, DRIVE = "2011_09_26", "0001"
EARTH_RADIUS_M = 6378137.0  # pykitti's Mercator projection
IMU_IN_EGO_M = (0.05, 0.32, 0.93)  # as KITTI's set-up has it


def made_drive() -> Drive:
    """The drive, in seconds since the first cloud's whole second."""
    return Drive(np.zeros(3), 0.5, 7.0, 0.4, 0.04, [])


def oxts_packet(
    latitude_deg: float, longitude_deg: float, yaw_rad: float, speed: float, rate: float, a: float
) -> str:
    """The 30 numbers of an oxts file: roll and pitch zero."""
    numbers = [latitude_deg, longitude_deg, 112.8, 0.0, 0.0, yaw_rad]
    numbers += [speed * np.sin(yaw_rad), speed * np.cos(yaw_rad), speed, 0.0, 0.0]  # vn ve vf vl vu
    numbers += [
        a,
        0.0,
        9.81,
        a,
        0.0,
        9.81,
        0.0,
        0.0,
        rate,
        0.0,
        0.0,
        rate,
    ]  # ax ay az af al au wx wy wz wf wl wu
    numbers += [0.05, 0.02, 4, 10, 4, 4, 6]  # accuracies, navstat, satellites, modes
    assert len(numbers) == 30
    return " ".join(str(number) for number in numbers) + "\n"


def write_stamps(path: Path, times_ns: list[int]) -> None:
    """`timestamps.txt`: nine digits after the second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = []
    for time_ns in times_ns:
        second = datetime.fromtimestamp(time_ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S")
        lines.append(f"{second}.{time_ns % 10**9:09d}\n")
    path.write_text("".join(lines))


def main() -> None:
    """Makes the drive."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--offset-ms", type=float, default=-4.0, help="of the pictures' stamps against the clouds'"
    )
    options = parser.parse_args()
    rows = {}
    for line in (options.source / "calib" / "000001.txt").read_text().splitlines():
        if ":" in line:
            name, values = line.split(":", 1)
            rows[name] = values.split()
    day = options.out / DATE
    drive_folder = day / f"{DATE}_drive_{DRIVE}_sync"
    day.mkdir(parents=True, exist_ok=True)

    def rigid(name: str) -> str:
        numbers = rows[name]
        rotation = " ".join(numbers[i] for i in (0, 1, 2, 4, 5, 6, 8, 9, 10))
        return f"R: {rotation}\nT: {numbers[3]} {numbers[7]} {numbers[11]}\n"

    (day / "calib_velo_to_cam.txt").write_text(f"calib_time: 15-Mar-2012 11:37:16\n{rigid('Tr_velo_to_cam')}")
    (day / "calib_imu_to_velo.txt").write_text(f"calib_time: 25-May-2012 16:47:16\n{rigid('Tr_imu_to_velo')}")
    cameras = "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\n"
    identity = "1 0 0 0 1 0 0 0 1"
    for camera in range(4):
        rectify = " ".join(rows["R0_rect"]) if camera == 0 else identity
        cameras += (
            f"S_0{camera}: 1392 512\nK_0{camera}: {identity}\nD_0{camera}: 0 0 0 0 0\n"
            f"R_0{camera}: {identity}\n"
            f"T_0{camera}: 0 0 0\nS_rect_0{camera}: 1242 375\nR_rect_0{camera}: {rectify}\n"
            f"P_rect_0{camera}: {' '.join(rows[f'P{camera}'])}\n"
        )
    (day / "calib_cam_to_cam.txt").write_text(cameras)

    names = [path.stem for path in sorted((options.source / "velodyne").glob("*.bin"))]
    names = [n for n in names if Image.open(options.source / "image_2" / f"{n}.png").size == (1242, 375)]
    start_ns = 1_317_042_145_000_000_000
    drive = made_drive()
    # pykitti scales Mercator's x and y by the cosine of the first latitude.
    origin = np.radians([49.011, 8.4228])
    scale = np.cos(origin[0])
    mercator_y = scale * EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + origin[0] / 2))
    poses, states, clouds, pictures, packets = [], [], [], [], []
    imu_in_ego = pose(np.eye(3), IMU_IN_EGO_M)
    for idx, name in enumerate(names):
        cloud_ns = start_ns + idx * 103_000_000 + 961_661
        packet_ns = cloud_ns + 1_500_000
        seconds = (packet_ns - start_ns) / 1e9
        imu = drive.level_pose_at(seconds) @ imu_in_ego
        yaw = float(np.arctan2(imu[1, 0], imu[0, 0]))
        longitude = origin[1] + imu[0, 3] / (scale * EARTH_RADIUS_M)
        latitude = 2 * np.arctan(np.exp((mercator_y + imu[1, 3]) / (scale * EARTH_RADIUS_M))) - np.pi / 2
        rate = drive.speed_at(seconds) * np.tan(drive.steering_rad) / WHEELBASE_M
        packet = oxts_packet(
            float(np.degrees(latitude)),
            float(np.degrees(longitude)),
            yaw,
            drive.speed_at(seconds),
            float(rate),
            drive.acceleration_mps2,
        )
        for folder, ending, payload in [
            ("velodyne_points/data", "bin", (options.source / "velodyne" / f"{name}.bin").read_bytes()),
            ("image_02/data", "png", (options.source / "image_2" / f"{name}.png").read_bytes()),
            ("oxts/data", "txt", packet.encode()),
        ]:
            path = drive_folder / folder / f"{idx:010d}.{ending}"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(payload)
        clouds.append(cloud_ns)
        pictures.append(cloud_ns + round(options.offset_ms * 1e6))
        packets.append(packet_ns)
        poses.append(imu)
        cloud_seconds = (cloud_ns - start_ns) / 1e9
        states.append([drive.speed_at(cloud_seconds), drive.steering_rad])
    write_stamps(drive_folder / "velodyne_points" / "timestamps.txt", clouds)
    write_stamps(drive_folder / "velodyne_points" / "timestamps_start.txt", [t - 50_000_000 for t in clouds])
    write_stamps(drive_folder / "velodyne_points" / "timestamps_end.txt", [t + 50_000_000 for t in clouds])
    write_stamps(drive_folder / "image_02" / "timestamps.txt", pictures)
    write_stamps(drive_folder / "oxts" / "timestamps.txt", packets)
    first = np.linalg.inv(pose(np.eye(3), poses[0][:3, 3]))
    np.savez(
        options.out / "truth.npz",
        names=names,
        clouds_ns=clouds,
        pictures_ns=pictures,
        packets_ns=packets,
        world_from_imu=np.array([first @ one for one in poses]),
        states=np.array(states),
        start_ns=start_ns,
    )
    print(f"{len(names)} frames as a raw drive: {drive_folder}")


if __name__ == "__main__":
    main()
