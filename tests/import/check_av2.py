"""Compares `harmzone import av2` with what the `av2` package reads: cuboids, sweeps, poses, motion.

Usage: check_av2.py SRC EPISODES_DIR

SRC holds log folders. Argoverse's ego frame has its origin at the rear axle's height, ours is on the ground:
the shift along z is found as the median over the boxes and must be one number for a whole log. Exit code 1 on
a difference.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from av2.geometry.camera.pinhole_camera import PinholeCamera
from av2.structures.cuboid import Cuboid, CuboidList
from av2.utils.io import read_city_SE3_ego, read_feather
from comparison import Comparison, angle_between, rotation_angle
from imported_episode import Episode, Moment, corner_signs, read_data_set


def corners_of(cuboid: Cuboid) -> np.ndarray:
    """Corners [8, 3] in the log's ego frame, in the order of `corner_signs`, by the package's own pose."""
    return cuboid.dst_SE3_object.transform_point_cloud(corner_signs * cuboid.dims_lwh_m)


def xyz_of(sweep: pd.DataFrame) -> np.ndarray:
    """Points [n, 3] in the log's ego frame. (The package's Sweep asks for a calibration that a sample may
    lack.)
    """
    return sweep[["x", "y", "z"]].to_numpy().astype(float)


def check_boxes(
    moment: Moment, cuboids: list[tuple[str, Cuboid]], shift: np.ndarray, table: Comparison
) -> None:
    """Every cuboid has its box and the other way round."""
    where = str(moment.time_ns)
    table.equal("number of boxes", len(moment.boxes or []), len(cuboids), where)
    boxes = {box.id: box for box in moment.boxes or []}
    by_id = len(set(boxes) & {track for track, _ in cuboids}) == len(cuboids)
    left = list(boxes.values())
    for track, cuboid in cuboids:
        corners = corners_of(cuboid) + shift
        if not left:
            break
        box = (
            boxes[track]
            if by_id
            else min(left, key=lambda box: np.linalg.norm(box.center_m - corners.mean(0)))
        )
        if box in left:
            left.remove(box)
        forward = corners[0] - corners[4]
        at = f"{where} {cuboid.category} {track[:8]}"
        table.add("box centres", box.center_m - corners.mean(axis=0), 1e-3, "m", at)
        table.add("box sizes", box.size_m - cuboid.dims_lwh_m, 1e-6, "m", at)
        table.add("box yaws", angle_between(box.yaw_rad, np.arctan2(forward[1], forward[0])), 1e-6, "rad", at)
        table.add("box corners (8 each)", np.linalg.norm(box.corners_m() - corners, axis=1), 1e-3, "m", at)
        table.equal("category", box.category.lower(), str(cuboid.category).lower(), at)


def check_points(moment: Moment, sweep: pd.DataFrame, shift: np.ndarray, table: Comparison) -> None:
    """Every point of the sweep, in ego, with its intensity and laser."""
    where = str(moment.time_ns)
    ours = moment.points_in_ego()
    table.equal("number of points", len(ours), len(sweep), where)
    if len(ours) != len(sweep):
        return
    table.add("points, in order", np.linalg.norm(ours - xyz_of(sweep) - shift, axis=1), 1e-3, "m", where)
    table.add("intensity", moment.cloud["intensity"] - sweep.intensity.to_numpy(), 0.0, "", where)
    # Argoverse's two stacked sensors have 32 lasers each; ours are numbered from the lowest beam up.
    n_lasers = len(np.unique(sweep.laser_number))
    table.equal("rings", len(np.unique(moment.cloud["ring"])) >= min(32, n_lasers), True, where)


def check_camera(moment: Moment, log: Path, shift: np.ndarray, table: Comparison) -> None:
    """K, pose and picture of the front camera; and the cloud on it, compensated for motion as the package
    does.
    """
    camera = PinholeCamera.from_feather(log, "ring_front_center")
    ours, where = moment.cameras["cam_front"], str(moment.time_ns)
    table.add("K", ours.k - camera.intrinsics.K, 1e-6, "px", where)
    size = (camera.width_px, camera.height_px)
    table.equal("picture size", (ours.width_px, ours.height_px), size, where)
    pictures = {int(path.stem): path for path in (log / "sensors/cameras/ring_front_center").glob("*.jpg")}
    stamp = min(pictures, key=lambda time_ns: abs(time_ns - moment.time_ns))
    table.equal("picture bytes (of the nearest)", ours.image, pictures[stamp].read_bytes(), where)
    poses = read_city_SE3_ego(log)
    moved = poses[moment.time_ns].inverse().compose(poses[stamp]).compose(camera.ego_SE3_cam).transform_matrix
    found = ours.ego_from_camera.copy()
    found[:3, 3] -= shift
    table.add("camera's pose when it took the picture", found - moved, 1e-6, "", where)
    points = read_feather(log / "sensors/lidar" / f"{moment.time_ns}.feather")
    in_ego = xyz_of(points)
    theirs, _, seen = camera.project_ego_to_img_motion_compensated(
        in_ego, poses[stamp], poses[moment.time_ns]
    )
    pixels, _ = ours.project(moment.points_in_ego())
    if len(pixels) == len(theirs):
        table.add("points on the picture", (pixels - theirs[:, :2])[seen], 0.02, "px", where)


def check_motion(episode: Episode, log: Path, table: Comparison) -> None:
    """Poses of the ego, its speed, and the objects' velocities by differences of their tracks in the city
    frame.
    """
    poses = read_city_SE3_ego(log)
    times = np.array(sorted(poses))
    first = episode.moments[0]
    city_from_world = None
    for moment in episode.moments:
        where = str(moment.time_ns)
        if moment.time_ns not in poses:
            table.note(
                f"{where} has no pose of its own; nearest: {np.abs(times - moment.time_ns).min() / 1e6} ms"
            )
            continue
        ours, theirs = moment.world_from_ego, poses[moment.time_ns].transform_matrix
        if city_from_world is None:
            city_from_world = theirs @ np.linalg.inv(ours)
        moved = city_from_world @ ours
        table.add(
            "poses, rotation (from the first)",
            rotation_angle(moved[:3, :3], theirs[:3, :3]),
            1e-6,
            "rad",
            where,
        )
        # Both ego frames differ by a shift along their z only, which a rotation of the car moves by little.
        table.add("poses, place (from the first)", moved[:3, 3] - theirs[:3, 3], 5e-3, "m", where)
        around = times[np.abs(times - moment.time_ns) <= 250_000_000]
        before, after = poses[int(around[0])], poses[int(around[-1])]
        moved_m = (poses[moment.time_ns].inverse().compose(after)).translation - (
            poses[moment.time_ns].inverse().compose(before)
        ).translation
        speed = moved_m[0] / ((around[-1] - around[0]) / 1e9)
        table.add(
            "speed, against half a second of poses", moment.state["speed_mps"] - speed, 0.3, "m/s", where
        )
    annotations = (
        pd.read_feather(log / "annotations.feather") if (log / "annotations.feather").exists() else None
    )
    if annotations is None or first.boxes is None:
        return
    for moment in episode.moments:
        if moment.time_ns not in poses:
            continue
        ego_from_city = poses[moment.time_ns].inverse()
        for box in moment.boxes or []:
            track = annotations[annotations.track_uuid == box.id]
            near = track[np.abs(track.timestamp_ns - moment.time_ns) <= 150_000_000].sort_values(
                "timestamp_ns"
            )
            if len(near) < 2 or np.isnan(box.velocity_mps).any():
                continue
            ends = []
            for _, row in near.iloc[[0, -1]].iterrows():
                in_ego = np.array([[row.tx_m, row.ty_m, row.tz_m]])
                in_city = poses[int(row.timestamp_ns)].transform_point_cloud(in_ego)
                ends.append(ego_from_city.transform_point_cloud(in_city)[0])
            seconds = (near.timestamp_ns.iloc[-1] - near.timestamp_ns.iloc[0]) / 1e9
            velocity = (ends[1] - ends[0])[:2] / seconds
            table.add(
                "velocities of objects",
                box.velocity_mps - velocity,
                1.0,
                "m/s",
                f"{moment.time_ns} {box.id[:8]}",
            )


def main() -> int:
    """Compares every sample of a data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("episodes", type=Path)
    options = parser.parse_args()
    logs = [path.parent for path in options.source.rglob("city_SE3_egovehicle.feather")]
    table, seen = Comparison(), []
    for episode in read_data_set(options.episodes):
        stamps = {moment.time_ns for moment in episode.moments}
        matching = [
            log for log in logs if any((log / "sensors/lidar" / f"{t}.feather").exists() for t in stamps)
        ]
        if len(matching) != 1:
            table.fault(f"{episode.path}: {len(matching)} logs have sweeps at its times")
            continue
        log = matching[0]
        cuboids: dict[int, list[tuple[str, Cuboid]]] = {}
        if (log / "annotations.feather").exists():
            frame = pd.read_feather(log / "annotations.feather")
            listed = CuboidList.from_feather(log / "annotations.feather")
            for track, cuboid in zip(frame.track_uuid, listed.cuboids, strict=True):
                cuboids.setdefault(int(cuboid.timestamp_ns), []).append((track, cuboid))
        sweeps = {int(path.stem) for path in (log / "sensors/lidar").glob("*.feather")}
        table.equal("samples are the sweeps", stamps <= sweeps, True, str(episode.path))
        if stamps != sweeps:
            table.note(f"{episode.path.stem}: {len(stamps)} of {len(sweeps)} sweeps imported")
        shifts = []
        for moment in episode.moments:
            sweep = read_feather(log / "sensors/lidar" / f"{moment.time_ns}.feather")
            ours = moment.points_in_ego()
            if len(ours) == len(sweep):
                shifts.append(np.median(ours - xyz_of(sweep), axis=0))
        shift = np.median(shifts, axis=0) if shifts else np.zeros(3)
        table.add("ego's shift along x and y", shift[:2], 1e-3, "m", str(log.name))
        table.add("ego's shift along z, from 0.33", shift[2] - 0.33, 0.25, "m", str(log.name))
        table.note(f"shift of the ego frame: {shift.round(4).tolist()} m; log says: {episode.log}")
        for moment in episode.moments:
            seen.append(moment.time_ns)
            sweep = read_feather(log / "sensors/lidar" / f"{moment.time_ns}.feather")
            check_points(moment, sweep, shift, table)
            check_boxes(moment, cuboids.get(moment.time_ns, []), shift, table)
            if (log / "calibration").is_dir():
                check_camera(moment, log, shift, table)
        check_motion(episode, log, table)
    table.equal("some sample is imported", bool(seen), True, str(options.episodes))
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
