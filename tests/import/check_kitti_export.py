"""Compares what `harmzone export kitti` wrote with the episodes that it came from, by KITTI's own formulas.

Usage: check_kitti_export.py DATASET EXPORT [--draw DIR]

Episodes are read with the public MCAP packages, the export as KITTI's development kit reads it: a label's
location is the middle of the bottom face in the rectified camera, and pixels are
`P2 * R0_rect * Tr_velo_to_cam * point` (computeBox3D.m, projectToImage.m).
`--draw` writes pictures with boxes and points. Exit code 1 on a difference.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from pathlib import Path

import numpy as np
from comparison import Comparison, angle_between
from imported_episode import Moment, corner_signs, read_data_set
from PIL import Image, ImageDraw

EDGES = [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]


def read_calibration(path: Path) -> dict[str, np.ndarray]:
    """P2 [3, 4], and 4x4 matrices of the other rows."""
    rows = {}
    for line in path.read_text().splitlines():
        name, values = line.split(":", 1)
        rows[name] = np.array(values.split(), dtype=float)
    rect_from_camera, camera_from_velo, velo_from_imu = np.eye(4), np.eye(4), np.eye(4)
    rect_from_camera[:3, :3] = rows["R0_rect"].reshape(3, 3)
    camera_from_velo[:3] = rows["Tr_velo_to_cam"].reshape(3, 4)
    velo_from_imu[:3] = rows["Tr_imu_to_velo"].reshape(3, 4)
    return {
        "p2": rows["P2"].reshape(3, 4),
        "rect_from_velo": rect_from_camera @ camera_from_velo,
        "velo_from_imu": velo_from_imu,
        "rect_from_camera": rect_from_camera,
    }


def project(p2: np.ndarray, points_in_rect: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [n, 2] and depths [n] of points [n, 3]."""
    homogeneous = np.c_[points_in_rect, np.ones(len(points_in_rect))] @ p2.T
    return homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]


def corners_of(numbers: list[float]) -> np.ndarray:
    """The corners [8, 3] of a label in the rectified camera's frame."""
    height, width, length, x, y, z, rotation_y = numbers[7:14]
    cos, sin = np.cos(rotation_y), np.sin(rotation_y)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    axes = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).T
    center = np.array([x, y - height / 2, z])
    return (corner_signs * [length, width, height]) @ axes.T @ turn.T + center


def check_frame(moment: Moment, half: Path, entry: dict, table: Comparison, draw: Path | None) -> None:
    """Compares one frame with its sample."""
    name = entry["frame"]
    calibration = read_calibration(half / "calib" / f"{name}.txt")
    camera = moment.cameras["cam_front"]
    picture = Image.open(half / "image_2" / f"{name}.png").convert("RGB")
    pixels = np.asarray(picture)
    wanted = np.asarray(Image.open(io.BytesIO(camera.image)).convert("RGB"))
    # Two decoders of JPEG may differ by a level.
    table.add("picture", pixels.astype(int) - wanted, 0 if camera.format == "png" else 4, "level", name)

    raw = np.fromfile(half / "velodyne" / f"{name}.bin", dtype="<f4").reshape(-1, 4)
    cloud = np.stack([moment.cloud[axis] for axis in "xyz"], axis=1)
    table.equal("points to the bit", raw[:, :3].tobytes(), cloud.astype("<f4").tobytes(), name)
    table.add("intensity / 255", raw[:, 3] * 255 - moment.cloud["intensity"], 1e-4, "", name)
    rings = np.fromfile(half / "ring" / f"{name}.bin", dtype="<u2")
    table.equal("rings", rings.tolist(), moment.cloud["ring"].tolist(), name)
    table.add(
        "ego from LiDAR", np.linalg.inv(calibration["velo_from_imu"]) - moment.ego_from_lidar, 1e-9, "m", name
    )

    # Up in the rectified camera is up in the ego, so that a rotation about y is a yaw.
    ego_from_rect = np.linalg.inv(calibration["velo_from_imu"]) @ np.linalg.inv(calibration["rect_from_velo"])
    table.add("the camera's down is the ego's", ego_from_rect[:3, 1] - [0, 0, -1], 1e-9, "", name)

    points_in_rect = (calibration["rect_from_velo"] @ np.c_[raw[:, :3].astype(float), np.ones(len(raw))].T).T[
        :, :3
    ]
    theirs_px, depth = project(calibration["p2"], points_in_rect)
    ours_px, _ = camera.project(moment.points_in_ego())
    seen = depth > 1.0
    inside = seen & (theirs_px >= 0).all(1) & (theirs_px < [camera.width_px, camera.height_px]).all(1)
    table.add("points on the picture", (ours_px - theirs_px)[inside], 1e-6, "px", name)

    boxes = {box.id: box for box in moment.boxes or []}
    rows = []
    if (half / "label_2" / f"{name}.txt").exists():
        rows = [line.split() for line in (half / "label_2" / f"{name}.txt").read_text().splitlines()]
    objects = [words for words in rows if words[0] != "DontCare"]
    table.equal("rows have ids", len(objects), len(entry["objects"]), name)
    canvas = ImageDraw.Draw(picture)
    for words, id_ in zip(objects, entry["objects"], strict=True):
        box, numbers, where = boxes.pop(id_), [float(word) for word in words[1:15]], f"{name} {id_}"
        corners = corners_of(numbers)
        in_ego = corners @ ego_from_rect[:3, :3].T + ego_from_rect[:3, 3]
        table.add("box corners", np.linalg.norm(in_ego - box.corners_m(), axis=1), 1e-6, "m", where)
        heading = ego_from_rect[:3, :3] @ (corners[0] - corners[4])
        table.add("yaw", angle_between(np.arctan2(heading[1], heading[0]), box.yaw_rad), 1e-6, "rad", where)
        alpha = numbers[13] - np.arctan2(numbers[10], numbers[12])
        table.add("alpha", angle_between(numbers[2], alpha), 1e-5, "rad", where)
        # The 2D box holds the corners, where all lie before the camera; the picture cuts off the truncation.
        corner_px, corner_depth = project(calibration["p2"], corners)
        if (corner_depth > 0.2).all():
            low, high = corner_px.min(axis=0), corner_px.max(axis=0)
            size = np.array([camera.width_px, camera.height_px])
            cut = np.r_[np.clip(low, 0, size), np.clip(high, 0, size)]
            table.add("2D boxes", np.array(numbers[3:7]) - cut, 1e-3, "px", where)
            share = 1 - np.prod(cut[2:] - cut[:2]) / np.prod(high - low)
            table.add("truncation", numbers[0] - share, 1e-4, "", where)
            color = {"Harmful": "red", "Harmless": "deepskyblue"}.get(words[0], "yellow")
            for one, other in EDGES:
                canvas.line([*corner_px[one], *corner_px[other]], fill=color, width=2)
        canvas.rectangle(numbers[3:7], outline="white")
    # What is not labelled is not in the picture.
    for box in boxes.values():
        center_px, center_depth = camera.project(box.center_m[None])
        is_seen = center_depth[0] > 0.2 and (center_px[0] >= 0).all()
        is_seen &= (center_px[0] < [camera.width_px, camera.height_px]).all()
        table.equal("boxes left out are out of view", bool(is_seen), False, f"{name} {box.id}")
    if draw:
        for u, v in theirs_px[inside][::4]:
            canvas.point((u, v), fill="lime")
        picture.save(draw / f"{name}.png")


def main() -> int:
    """Compares every frame of an export."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("export", type=Path)
    parser.add_argument("--draw", type=Path)
    options = parser.parse_args()
    if options.draw:
        options.draw.mkdir(parents=True, exist_ok=True)
    entries = json.loads((options.export / "harmzone.json").read_text())["frames"]
    by_sample = {(entry["episode"], entry["sample_idx"]): entry for entry in entries}
    table, splits = Comparison(), {}
    for episode in read_data_set(options.dataset):
        for idx, moment in enumerate(episode.moments):
            entry = by_sample.pop((episode.path.stem, idx))
            splits.setdefault(entry["split"], []).append(entry["frame"])
            half = options.export / ("testing" if entry["split"] in ("dev", "test") else "training")
            check_frame(moment, half, entry, table, options.draw)
    table.equal("frames of no sample", len(by_sample), 0, "harmzone.json")
    for split in ("train", "val", "test"):
        if split == "test" and split not in splits:
            splits[split] = splits.get("dev", splits.get("val", []))  # one of these takes its place
        listed = (options.export / "ImageSets" / f"{split}.txt").read_text().split()
        table.equal("lists of frames", listed, sorted(splits.get(split, [])), split)
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
