"""Compares `harmzone import kitti` with KITTI's own formulas, on every box, point, calibration and picture.

Usage: check_kitti.py SRC EPISODES_DIR [--some]

SRC is the folder with `training/` (object layout). Labels are read by the rules of KITTI's development kit
(readLabels.m, computeBox3D.m): the location is the middle of the bottom face in rectified camera 0, sizes are
height, width, length, `rotation_y` turns about the camera's y, zero along its x. Exit code 1 on a difference.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np
from comparison import Comparison, angle_between, rotation_angle
from imported_episode import Episode, Moment, corner_signs, read_data_set
from made_world import FORWARD_FROM_OPTICAL


def read_calibration(path: Path) -> dict[str, np.ndarray]:
    """Camera 2's K and its shift from camera 0, and the rectified camera's pose to the LiDAR, 4x4."""
    rows = {}
    for line in path.read_text().splitlines():
        if ":" in line:
            name, values = line.split(":", 1)
            rows[name] = np.array(values.split(), dtype=float)
    p2 = rows["P2"].reshape(3, 4)
    rectify, rect_from_velo = np.eye(4), np.eye(4)
    rectify[:3, :3] = rows["R0_rect"].reshape(3, 3)
    rect_from_velo[:3] = rows["Tr_velo_to_cam"].reshape(3, 4)
    camera2_from_rect = np.eye(4)
    camera2_from_rect[:3, 3] = np.linalg.inv(p2[:, :3]) @ p2[:, 3]
    return {
        "p2": p2,
        "k": p2[:, :3],
        "camera2_from_rect": camera2_from_rect,
        "rect_from_velo": rectify @ rect_from_velo,
    }


def read_labels(path: Path) -> tuple[list[dict], list[np.ndarray]]:
    """Labelled objects, and DontCare rectangles (left, top, right, bottom)."""
    objects, regions = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        numbers = [float(word) for word in words[1:15]]
        if words[0] == "DontCare":
            regions.append(np.array(numbers[3:7]))
            continue
        height, width, length, x, y, z, rotation_y = numbers[7:14]
        cos, sin = np.cos(rotation_y), np.sin(rotation_y)
        turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
        # The box's axes: length along x, height up (-y), width along z; left of forward is +z there.
        axes = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).T
        center = np.array([x, y - height / 2, z])
        size = np.array([length, width, height])
        corners = (corner_signs * size) @ axes.T @ turn.T + center
        objects.append({"category": words[0], "corners": corners, "center": center, "size": size})
    return objects, regions


def find_frame(episode: Episode, idx: int, source: Path, clouds: dict[bytes, str]) -> str | None:
    """The KITTI frame of a sample: by its picture's bytes, else by the episode's name."""
    name = clouds.get(episode.moments[idx].cameras["cam_front"].image)
    if name:
        return name
    found = re.findall(r"\d{6}", episode.path.stem)
    return found[-1] if found and (source / "velodyne" / f"{found[-1]}.bin").exists() else None


def check_moment(moment: Moment, source: Path, name: str, table: Comparison) -> None:
    """Compares one sample with one frame."""
    calibration = read_calibration(source / "calib" / f"{name}.txt")
    camera = moment.cameras["cam_front"]
    table.equal("picture bytes", camera.image, (source / "image_2" / f"{name}.png").read_bytes(), name)
    # KITTI does not say whether pixel (0, 0) is the corner or the middle of its first pixel: kept, or half a
    # pixel more.
    shift_px = np.round((camera.k[:2, 2] - calibration["k"][:2, 2]) * 2) / 2
    table.note(f"K's principal point is KITTI's plus {shift_px.tolist()} px")
    k = calibration["k"].copy()
    k[:2, 2] += shift_px
    table.add("K", camera.k - k, 1e-6, "px", name)
    table.add("K's shift", shift_px, 0.5, "px", name)
    table.equal("distortion", [x for x in camera.d if x], [], name)

    # The ego frame is the importer's choice; it is taken from the camera, and the LiDAR must agree with it.
    ego_from_rect = camera.ego_from_camera @ calibration["camera2_from_rect"]
    ego_from_lidar = ego_from_rect @ calibration["rect_from_velo"]
    # R0_rect and Tr have seven digits: they are rotations to 1e-6 only, so compare with the nearest rotation,
    # too.
    u, _, vt = np.linalg.svd(ego_from_lidar[:3, :3])
    table.add(
        "LiDAR to camera, rotation", rotation_angle(moment.ego_from_lidar[:3, :3], u @ vt), 1e-6, "rad", name
    )
    table.add("LiDAR to camera, place", (moment.ego_from_lidar - ego_from_lidar)[:3, 3], 1e-3, "m", name)
    table.add(
        "ego's up against the camera's",
        rotation_angle(ego_from_rect[:3, :3], FORWARD_FROM_OPTICAL),
        0.03,
        "rad",
        name,
    )
    table.add("LiDAR over the ground, from 1.73", moment.ego_from_lidar[2, 3] - 1.73, 0.2, "m", name)

    raw = np.fromfile(source / "velodyne" / f"{name}.bin", dtype="<f4").reshape(-1, 4)
    cloud = np.stack([moment.cloud[axis] for axis in "xyz"], axis=1)
    table.equal("number of points", len(cloud), len(raw), name)
    if len(cloud) == len(raw):
        table.add("points, in order", np.linalg.norm(cloud - raw[:, :3], axis=1), 1e-3, "m", name)
        scale = 255.0 if raw[:, 3].max() <= 1.0 else 1.0
        table.add("intensity, as 0 to 255", moment.cloud["intensity"] - raw[:, 3] * scale, 0.51, "", name)
        # LiDAR points on the picture, by KITTI's own chain and by the episode's.
        homogeneous = np.c_[raw[:, :3].astype(float), np.ones(len(raw))]
        theirs = (calibration["p2"] @ calibration["rect_from_velo"] @ homogeneous.T).T
        seen = theirs[:, 2] > 2.0
        theirs_px = theirs[seen, :2] / theirs[seen, 2:]
        inside = (theirs_px >= 0).all(1) & (theirs_px < [camera.width_px, camera.height_px]).all(1)
        ours_px, _ = camera.project(moment.points_in_ego()[seen])
        table.add("points on the picture", (ours_px - theirs_px - shift_px)[inside], 0.01, "px", name)

    objects, regions = read_labels(source / "label_2" / f"{name}.txt")
    table.equal("labelled", moment.boxes is not None, True, name)
    boxes = list(moment.boxes or [])
    table.equal("number of boxes", len(boxes), len(objects), name)
    for one in objects:
        corners = one["corners"] @ ego_from_rect[:3, :3].T + ego_from_rect[:3, 3]
        if not boxes:
            table.fault(f"no box is left for {one['category']} of {name}")
            continue
        center = corners.mean(axis=0)
        box = min(boxes, key=lambda box: np.linalg.norm(box.center_m - center))
        boxes.remove(box)
        where = f"{name} {one['category']}"
        forward = corners[0] - corners[4]
        yaw = np.arctan2(forward[1], forward[0])
        table.add("box centres", box.center_m - center, 1e-3, "m", where)
        table.add("box sizes", box.size_m - one["size"], 1e-6, "m", where)
        table.add("box yaws", angle_between(box.yaw_rad, yaw), 1e-6, "rad", where)
        table.add("box corners (8 each)", np.linalg.norm(box.corners_m() - corners, axis=1), 1e-3, "m", where)
        table.equal("category", box.category.lower().replace(" ", "_"), one["category"].lower(), where)
    rectangles = [one.image for one in moment.ignored if one.HasField("image")]
    ours = sorted([one.left_px, one.top_px, one.right_px, one.bottom_px] for one in rectangles)
    table.equal("number of DontCare rectangles", len(ours), len(regions), name)
    if len(ours) == len(regions):
        # Half a pixel as in K, or without; at the border also cut to the picture.
        table.add(
            "DontCare rectangles", np.array(ours) - np.array(sorted(map(list, regions))), 1.0, "px", name
        )


def main() -> int:
    """Compares every sample of a data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("episodes", type=Path)
    parser.add_argument("--some", action="store_true", help="the episodes hold some of the frames only")
    options = parser.parse_args()
    source = options.source
    if (source / "training").is_dir():
        source = source / "training"
    pictures = {path.read_bytes(): path.stem for path in sorted((source / "image_2").glob("*.png"))}
    table, seen = Comparison(), set()
    for episode in read_data_set(options.episodes):
        for idx, moment in enumerate(episode.moments):
            name = find_frame(episode, idx, source, pictures)
            if name is None:
                table.fault(f"no frame is found for sample {idx} of {episode.path}")
                continue
            seen.add(name)
            check_moment(moment, source, name, table)
    if options.some:
        table.equal("some frame is imported", bool(seen), True, str(source))
    else:
        table.equal("frames imported", sorted(seen), sorted(pictures.values()), str(source))
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
