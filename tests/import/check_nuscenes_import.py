"""Compares `harmzone import nuscenes` with what nuscenes-devkit reads from the same folder.

Usage: check_nuscenes_import.py SRC EPISODES_DIR [--version v1.0-mini] [--truth SRC/truth.json]

Boxes are upright in global, ours in ego: centre and yaw (of the box's x axis in ego) must be equal, and the
corners those of the box laid upright; how far that is from the tilted box is told. Exit code 1 on a
difference.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from comparison import Comparison, angle_between, rotation_angle
from imported_episode import Moment, read_data_set, upright_corners
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud
from nuscenes.utils.geometry_utils import transform_matrix, view_points
from pyquaternion import Quaternion


def pose_of(nusc: NuScenes, data: dict, table: str) -> np.ndarray:
    """global_from_ego (`ego_pose`) or ego_from_sensor (`calibrated_sensor`) of a sample_data row."""
    row = nusc.get(table, data[f"{table}_token"])
    return transform_matrix(row["translation"], Quaternion(row["rotation"]))


def check_camera(nusc: NuScenes, sample: dict, moment: Moment, channel: str, table: Comparison) -> None:
    """Picture, K and pose of a camera; and LiDAR points on it through the devkit's whole chain."""
    where = f"{sample['timestamp']} {channel}"
    camera = moment.cameras.get(channel.lower())
    if camera is None:
        table.fault(f"{where} is not in the episode")
        return
    data = nusc.get("sample_data", sample["data"][channel])
    lidar = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])
    picture = Path(nusc.get_sample_data_path(data["token"])).read_bytes()
    table.equal("picture bytes", camera.image, picture, where)
    table.equal("picture size", (camera.width_px, camera.height_px), (data["width"], data["height"]), where)
    k = np.array(nusc.get("calibrated_sensor", data["calibrated_sensor_token"])["camera_intrinsic"])
    shift_px = camera.k[:2, 2] - k[:2, 2]
    if np.abs(shift_px - 0.5).max() < 1e-6:
        table.note("K's principal points are half a pixel further: (0, 0) is the picture's corner here")
        k[:2, 2] += 0.5
    table.add("K", camera.k - k, 1e-6, "px", where)
    # The camera's place when its picture was taken, seen from the ego at the cloud's time.
    moving = (
        np.linalg.inv(pose_of(nusc, lidar, "ego_pose"))
        @ pose_of(nusc, data, "ego_pose")
        @ pose_of(nusc, data, "calibrated_sensor")
    )
    mounted = pose_of(nusc, data, "calibrated_sensor")
    if np.abs(moving - camera.ego_from_camera).max() <= np.abs(mounted - camera.ego_from_camera).max():
        table.note(
            "cameras stand where they were when the picture was taken (the ego's motion is in their pose)"
        )
        expected = moving
    else:
        table.note(
            "cameras have the mounted pose: the ego's motion between picture and cloud, "
            f"{np.linalg.norm(moving[:3, 3] - mounted[:3, 3]):.2f} m here, is not in it"
        )
        expected = mounted
    table.add(
        "camera pose, rotation",
        rotation_angle(camera.ego_from_camera[:3, :3], expected[:3, :3]),
        1e-6,
        "rad",
        where,
    )
    table.add("camera pose, place", (camera.ego_from_camera - expected)[:3, 3], 1e-3, "m", where)
    points = LidarPointCloud.from_file(nusc.get_sample_data_path(lidar["token"]))
    points.transform(np.linalg.inv(expected) @ pose_of(nusc, lidar, "calibrated_sensor"))
    theirs = view_points(points.points[:3], k, normalize=True)[:2].T
    ours, _ = camera.project(moment.points_in_ego())
    seen = (points.points[2] > 2) & (theirs >= 0).all(1) & (theirs < [data["width"], data["height"]]).all(1)
    if len(ours) == len(theirs):
        table.add("points on the picture", (ours - theirs)[seen], 0.01, "px", where)


def check_moment(nusc: NuScenes, sample: dict, moment: Moment, mapping: list[str], table: Comparison) -> None:
    """Cloud, boxes, poses of one sample."""
    where = str(sample["timestamp"])
    lidar = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])
    global_from_ego = pose_of(nusc, lidar, "ego_pose")
    ego_from_lidar = pose_of(nusc, lidar, "calibrated_sensor")
    cloud = LidarPointCloud.from_file(nusc.get_sample_data_path(lidar["token"]))
    raw = np.fromfile(nusc.get_sample_data_path(lidar["token"]), dtype="<f4").reshape(-1, 5)
    cloud.transform(ego_from_lidar)
    points = moment.points_in_ego()
    table.equal("number of points", len(points), len(raw), where)
    if len(points) == len(raw):
        table.add("points, in order", np.linalg.norm(points - cloud.points[:3].T, axis=1), 1e-3, "m", where)
        table.add("intensity", moment.cloud["intensity"] - raw[:, 3], 0.0, "", where)
        table.add("ring", moment.cloud["ring"].astype(float) - raw[:, 4], 0.0, "", where)
    # Quarter turns about z relate the two LiDAR frames: the same place, and axes forward and up.
    table.add("LiDAR's place", (moment.ego_from_lidar - ego_from_lidar)[:3, 3], 1e-6, "m", where)
    table.add(
        "LiDAR's axes from ego's", rotation_angle(moment.ego_from_lidar[:3, :3], np.eye(3)), 0.1, "rad", where
    )
    world_difference = moment.world_from_ego - global_from_ego
    table.add(
        "ego pose, rotation",
        rotation_angle(moment.world_from_ego[:3, :3], global_from_ego[:3, :3]),
        1e-6,
        "rad",
        where,
    )
    table.add("ego pose, place", world_difference[:3, 3], 1e-3, "m", where)
    for channel in mapping:
        check_camera(nusc, sample, moment, channel, table)

    found = {box.id: box for box in moment.boxes or []}
    n_ignored = len([one for one in moment.ignored if one.HasField("ground")])
    n_boxes = 0
    ego_from_global = np.linalg.inv(global_from_ego)
    for annotation_token in sample["anns"]:
        row = nusc.get("sample_annotation", annotation_token)
        box = nusc.get_box(annotation_token)
        in_ego = ego_from_global @ transform_matrix(box.center, box.orientation)
        at = f"{where} {row['category_name']}"
        ours = found.pop(row["instance_token"], None)
        if ours is None:
            near = [b for b in found.values() if np.linalg.norm(b.center_m - in_ego[:3, 3]) < 0.05]
            if not near:
                table.note(f"no box of {row['category_name']} (counted among {n_ignored} ignored regions?)")
                continue
            ours = found.pop(near[0].id)
        n_boxes += 1
        size = box.wlh[[1, 0, 2]]
        yaw = float(np.arctan2(in_ego[1, 0], in_ego[0, 0]))
        table.add("box centres", ours.center_m - in_ego[:3, 3], 1e-3, "m", at)
        table.add("box sizes", ours.size_m - size, 1e-6, "m", at)
        table.add("box yaws", angle_between(ours.yaw_rad, yaw), 1e-6, "rad", at)
        laid = upright_corners(in_ego[:3, 3], size, yaw)
        table.add("box corners, laid upright", np.linalg.norm(ours.corners_m() - laid, axis=1), 1e-3, "m", at)
        tilted = (laid - in_ego[:3, 3]) @ np.eye(3)
        tilted = (upright_corners(np.zeros(3), size, 0.0)) @ in_ego[:3, :3].T + in_ego[:3, 3]
        table.add(
            "(told) corners of the tilted box",
            np.linalg.norm(ours.corners_m() - tilted, axis=1),
            0.2,
            "m",
            at,
        )
        velocity = nusc.box_velocity(annotation_token)
        in_ego_velocity = ego_from_global[:3, :3] @ velocity
        if np.isnan(velocity).any() or np.isnan(ours.velocity_mps).any():
            table.equal(
                "velocity unknown in both",
                bool(np.isnan(ours.velocity_mps).any()),
                bool(np.isnan(velocity).any()),
                at,
            )
        else:
            table.add("velocities", ours.velocity_mps - in_ego_velocity[:2], 0.02, "m/s", at)
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = (points - in_ego[:3, 3]) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        n_inside = int((np.abs(local) <= size / 2).all(axis=1).sum())
        table.add("points counted in boxes", ours.n_lidar_points - n_inside, 0, "", at)
        # Those of the tilted box: faces and the ground under it make a little difference.
        share = (n_inside - row["num_lidar_pts"]) / max(row["num_lidar_pts"], 20)
        table.add("(told) points as the log counts them", share, 0.2, "share", at)
    table.equal("boxes without an annotation", sorted(found), [], where)
    table.equal("annotations are boxes or ignored", n_boxes + n_ignored >= len(sample["anns"]), True, where)


def main() -> int:
    """Compares every sample of a data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("episodes", type=Path)
    parser.add_argument("--version", default="v1.0-mini")
    parser.add_argument("--truth", type=Path, help="speeds and steering as make_nuscenes.py writes them")
    parser.add_argument("--cameras", default="CAM_FRONT", help="channels that were imported, with commas")
    options = parser.parse_args()
    nusc = NuScenes(options.version, str(options.source), verbose=False)
    by_time = {sample["timestamp"] * 1000: sample for sample in nusc.sample}
    truth = {}
    if options.truth:
        truth = {row["timestamp_us"] * 1000: row for row in json.loads(options.truth.read_text())}
    table, seen = Comparison(), []
    for episode in read_data_set(options.episodes):
        for key, sentence in episode.log.get("methods", {}).items():
            table.note(f"{episode.path.stem}: {key}: {sentence}")
        for moment in episode.moments:
            sample = by_time.get(moment.time_ns)
            if sample is None:
                lidar_times = {
                    nusc.get("sample_data", one["data"]["LIDAR_TOP"])["timestamp"] * 1000: one
                    for one in nusc.sample
                }
                sample = lidar_times.get(moment.time_ns)
            if sample is None:
                table.fault(f"{episode.path.stem} has a sample at {moment.time_ns}, the source has none")
                continue
            seen.append(sample["token"])
            check_moment(nusc, sample, moment, options.cameras.split(","), table)
            if moment.time_ns in truth:
                row = truth[moment.time_ns]
                at = f"{row['scene']} {moment.time_ns}"
                table.add("speed", moment.state["speed_mps"] - row["speed_mps"], 0.1, "m/s", at)
                table.add(
                    "steering",
                    moment.state["steering_angle_rad"] - row["steering_angle_rad"],
                    0.005,
                    "rad",
                    at,
                )
    table.equal("samples imported", len(set(seen)), len(nusc.sample), str(options.source))
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
