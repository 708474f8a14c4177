"""Compares `harmzone import ros2` with the truth of a made bag (make_ros2_bag.py) or of a raw drive through
kitti2mcap.

Usage: check_ros2.py TRUTH.npz EPISODES_DIR [--training TRAINING_DIR]

TRUTH is OUT.truth.npz of make_ros2_bag.py; or truth.npz of make_kitti_raw.py, with KITTI's folder as
--training. There the bag's `base_link` is at the IMU: the ego frame is then the importer's own, and clouds,
calibration, motion are compared relative to it.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import numpy as np
from check_kitti import read_calibration
from comparison import Comparison, rotation_angle
from imported_episode import Moment, read_data_set
from made_world import pose
from make_kitti_raw import IMU_IN_EGO_M, made_drive
from PIL import Image


def check_cloud(
    moment: Moment,
    points: np.ndarray,
    intensity: np.ndarray,
    table: Comparison,
    where: str,
    limit_m: float = 1e-3,
) -> None:
    """Points [n, 3] as they should be in the LiDAR's own frame, up to quarter turns about z."""
    ours = np.stack([moment.cloud[axis] for axis in "xyz"], axis=1).astype(float)
    table.equal("number of points", len(ours), len(points), where)
    if len(ours) != len(points):
        return
    best, quarter = np.inf, 0
    for turns in range(4):
        cos, sin = round(np.cos(turns * np.pi / 2)), round(np.sin(turns * np.pi / 2))
        turned = points @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T
        error = np.linalg.norm(ours - turned, axis=1).max()
        if error < best:
            best, quarter = error, turns
    if quarter:
        table.note(f"points are turned by {quarter} quarter turns about z")
    table.add("points, in order", best, limit_m, "m", where)
    table.add("intensity, as 0 to 255", moment.cloud["intensity"] - intensity, 0.51, "", where)


def check_picture(moment: Moment, truth: dict, key: str, table: Comparison) -> None:
    """The same bytes where the bag has a PNG; a rectified picture where it is distorted."""
    camera = moment.cameras["cam_front"]
    if f"{key}.picture" in truth:
        table.equal("picture bytes", camera.image, truth[f"{key}.picture"].tobytes(), key)
    if f"{key}.ideal" not in truth:
        return
    found = np.array(Image.open(io.BytesIO(camera.image)).convert("RGB")).astype(float)
    # The ideal picture has the bag's K (0, 0 in the middle of the first pixel); the episode's may be another.
    k, ours = truth["k"], camera.k.copy()
    height, width = found.shape[:2]
    v, u = np.mgrid[0:height, 0:width]
    x = (u - ours[0, 2]) / ours[0, 0]
    y = (v - ours[1, 2]) / ours[1, 1]
    column = np.round(x * k[0, 0] + k[0, 2]).astype(int)
    row = np.round(y * k[1, 1] + k[1, 2]).astype(int)
    ideal, bent = truth[f"{key}.ideal"].astype(float), truth[f"{key}.bent"]
    inside = (column >= 0) & (column < ideal.shape[1]) & (row >= 0) & (row < ideal.shape[0])
    expected = np.zeros_like(found)
    expected[inside] = ideal[row[inside], column[inside]]
    # Two resamplings blur edges, so count pixels that differ by much, away from what no ray reached.
    differs = (np.abs(found - expected).max(axis=2) > 60) & inside & (found.max(axis=2) > 0)
    table.add("pixels off after rectifying", differs.mean(), 0.01, "share", key)
    table.note(
        f"rectified: {100 * (found.max(axis=2) > 0).mean():.1f} % of the picture has content"
        f" of {found.shape[:2]}, was {bent.shape[:2]}; K {ours.round(2).tolist()}"
    )


def check_made(truth: dict, episodes: Path, table: Comparison) -> None:
    """A bag whose base_link is our ego frame."""
    times = sorted({int(key.split(".")[0]) for key in truth if "." in key})
    found = []
    for episode in read_data_set(episodes):
        for key, sentence in episode.log.get("methods", {}).items():
            table.note(f"{episode.path.stem}: {key}: {sentence}")
        first = None
        for moment in episode.moments:
            key = str(moment.time_ns)
            if f"{key}.points" not in truth:
                table.fault(f"no cloud of the bag is at {key}")
                continue
            found.append(moment.time_ns)
            scale = 255.0 if truth[f"{key}.intensity"].max() <= 1.0 else 1.0
            check_cloud(
                moment, truth[f"{key}.points"].astype(float), truth[f"{key}.intensity"] * scale, table, key
            )
            if len(moment.cloud["ring"]) == len(truth[f"{key}.ring"]):
                table.add("ring", moment.cloud["ring"].astype(float) - truth[f"{key}.ring"], 0.0, "", key)
            if first is None:
                # The origin of the odometry is free.
                first = truth[f"{key}.pose"] @ np.linalg.inv(moment.world_from_ego)
            moved = first @ moment.world_from_ego
            table.add(
                "poses, rotation",
                rotation_angle(moved[:3, :3], truth[f"{key}.pose"][:3, :3]),
                1e-5,
                "rad",
                key,
            )
            table.add("poses, place", (moved - truth[f"{key}.pose"])[:3, 3], 2e-3, "m", key)
            speed, steering = truth[f"{key}.state"]
            table.add("speed", moment.state["speed_mps"] - speed, 0.05, "m/s", key)
            table.add("steering", moment.state["steering_angle_rad"] - steering, 0.005, "rad", key)
            camera = moment.cameras["cam_front"]
            ego_from_base = np.eye(4)
            ego_from_base[2, 3] = moment.ego_from_lidar[2, 3] - truth["base_from_lidar"][2, 3]
            if abs(ego_from_base[2, 3]) > 1e-9:
                table.note(f"the ego frame lies {-ego_from_base[2, 3]:.4f} m from base_link's height")
            lidar = ego_from_base @ truth["base_from_lidar"]
            table.add("LiDAR's place", (moment.ego_from_lidar - lidar)[:3, 3], 1e-6, "m", key)
            mounted = ego_from_base @ truth["base_from_camera"]
            turned = rotation_angle(camera.ego_from_camera[:3, :3], mounted[:3, :3])
            moved_m = np.linalg.norm(camera.ego_from_camera[:3, 3] - mounted[:3, 3])
            if moved_m > 1e-3:
                table.note(f"the camera's pose holds the ego's motion since the picture: {moved_m:.3f} m")
            table.add("camera's rotation", turned, 1e-6 if moved_m < 1e-3 else 0.01, "rad", key)
            table.add("camera's place", moved_m, 0.2, "m", key)
            check_picture(moment, truth, key, table)
            if f"{key}.picture" in truth:
                table.add("K", camera.k - truth["k"], 1e-6, "px", key)
    table.equal("clouds imported", sorted(found), times, str(episodes))


def untwist(points: np.ndarray, since_start_ns: int, training: Path, name: str) -> np.ndarray:
    """Points of a raw drive's cloud as they would be without motion: the head turns clockwise at 10 Hz.

    Seen from above, from behind to behind; the stamp is that of looking ahead (as in KISS-ICP's reader of raw
    drives).
    """
    rows = (training / "calib" / f"{name}.txt").read_text().splitlines()
    numbers = next(row.split(":")[1].split() for row in rows if row.startswith("Tr_imu_to_velo"))
    velo_from_imu = np.eye(4)
    velo_from_imu[:3] = np.array(numbers, dtype=float).reshape(3, 4)
    ego_from_velo = pose(np.eye(3), IMU_IN_EGO_M) @ np.linalg.inv(velo_from_imu)
    drive, seconds = made_drive(), since_start_ns / 1e9
    velo_from_world = np.linalg.inv(drive.level_pose_at(seconds) @ ego_from_velo)
    ticks = np.round(-np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * 0.1 / 2e-5).astype(int)
    still = np.empty_like(points)
    for tick in np.unique(ticks):
        moved = velo_from_world @ drive.level_pose_at(seconds + tick * 2e-5) @ ego_from_velo
        still[ticks == tick] = points[ticks == tick] @ moved[:3, :3].T + moved[:3, 3]
    return still


def check_raw(truth: dict, episodes: Path, training: Path, table: Comparison) -> None:
    """kitti2mcap's bag of a raw drive."""
    names = {int(t): str(name) for t, name in zip(truth["clouds_ns"], truth["names"], strict=True)}
    found = []
    for episode in read_data_set(episodes):
        for key, sentence in episode.log.get("methods", {}).items():
            table.note(f"{episode.path.stem}: {key}: {sentence}")
        for idx, moment in enumerate(episode.moments):
            where = str(moment.time_ns)
            if moment.time_ns not in names:
                table.fault(f"no cloud of the drive is at {where}")
                continue
            found.append(moment.time_ns)
            name = names[moment.time_ns]
            raw = np.fromfile(training / "velodyne" / f"{name}.bin", dtype="<f4").reshape(-1, 4)
            points, limit_m = raw[:, :3].astype(float), 1e-3
            if "moved by the poses" in episode.log.get("methods", {}).get("motion", ""):
                points = untwist(points, moment.time_ns - int(truth["start_ns"]), training, name)
                limit_m = 5e-3  # poses come at 10 Hz, and the points at their ends lie beyond the last
            check_cloud(moment, points, raw[:, 3] * 255.0, table, where, limit_m)
            calibration = read_calibration(training / "calib" / f"{name}.txt")
            camera = moment.cameras["cam_front"]
            table.add("K", (camera.k - calibration["k"])[:2, :2], 1e-6, "px", where)
            theirs = np.array(Image.open(training / "image_2" / f"{name}.png").convert("RGB"))
            ours = np.array(Image.open(io.BytesIO(camera.image)).convert("RGB"))
            # A raw picture may be packed as JPEG.
            levels = np.abs(ours.astype(float) - theirs).mean() if ours.shape == theirs.shape else np.inf
            table.add("picture's levels of 255, mean", levels, 4.0, "", where)
            camera_from_lidar = calibration["camera2_from_rect"] @ calibration["rect_from_velo"]
            u, _, vt = np.linalg.svd(camera_from_lidar[:3, :3])
            chain = np.linalg.inv(camera.ego_from_camera) @ moment.ego_from_lidar
            moved_m = np.linalg.norm((chain - camera_from_lidar)[:3, 3])
            # The picture is 4 ms early: at 7 m/s that is 3 cm, if the importer counts it.
            table.add("LiDAR to camera, rotation", rotation_angle(chain[:3, :3], u @ vt), 2e-3, "rad", where)
            table.add("LiDAR to camera, place", moved_m, 0.05, "m", where)
            speed, steering = truth["states"][list(truth["clouds_ns"]).index(moment.time_ns)]
            table.add("speed", moment.state["speed_mps"] - speed, 0.2, "m/s", where)
            table.add("steering", moment.state["steering_angle_rad"] - steering, 0.02, "rad", where)
            table.add("LiDAR over the ground, from 1.73", moment.ego_from_lidar[2, 3] - 1.73, 0.2, "m", where)
            if idx:
                before = episode.moments[idx - 1]
                step = np.linalg.inv(before.world_from_ego) @ moment.world_from_ego
                seconds = (moment.time_ns - before.time_ns) / 1e9
                table.add("metres between samples", step[0, 3] - speed * seconds, 0.1, "m", where)
    table.equal("clouds imported", len(found), len(names), str(episodes))


def main() -> int:
    """Compares a data set with its truth."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("truth", type=Path)
    parser.add_argument("episodes", type=Path)
    parser.add_argument("--training", type=Path)
    options = parser.parse_args()
    truth, table = dict(np.load(options.truth)), Comparison()
    if "clouds_ns" in truth:
        check_raw(truth, options.episodes, options.training, table)
    else:
        check_made(truth, options.episodes, table)
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
