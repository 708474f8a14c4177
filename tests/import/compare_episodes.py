"""Compares a data set with what came back from its export and import: boxes, calibration, state, pictures,
points.

Usage: compare_episodes.py ORIGINAL RETURNED

Samples are matched by their points. Points must be the same to the bit, pictures to the byte, all
else to 1e-6. Exit code 1 on a difference.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import sys
from pathlib import Path

import numpy as np
from comparison import Comparison, angle_between, rotation_angle
from imported_episode import Moment, read_data_set
from PIL import Image


def fingerprint(moment: Moment) -> str:
    """What a sample is known by: its points."""
    return hashlib.sha256(moment.cloud["x"].tobytes() + moment.cloud["z"].tobytes()).hexdigest()


def pixels_of(image: bytes) -> np.ndarray:
    """A picture, decoded."""
    return np.array(Image.open(io.BytesIO(image)).convert("RGB")).astype(int)


def check_moment(one: Moment, other: Moment, where: str, table: Comparison) -> None:
    """Compares one sample with itself after the journey."""
    table.equal("cameras", sorted(other.cameras), sorted(one.cameras), where)
    for name, camera in one.cameras.items():
        if name not in other.cameras:
            continue
        back = other.cameras[name]
        if back.format == camera.format:
            table.equal("picture bytes", back.image, camera.image, f"{where} {name}")
        else:
            # Each decoder of a JPEG rounds in its own way, by a level or two.
            table.note(f"pictures come back as {back.format}, were {camera.format}")
            off = np.abs(pixels_of(back.image) - pixels_of(camera.image))
            table.add("picture levels, of 255", off, 8, "", f"{where} {name}")
        table.add("K", back.k - camera.k, 1e-6, "px", f"{where} {name}")
        table.add("camera's pose", back.ego_from_camera - camera.ego_from_camera, 1e-6, "", f"{where} {name}")
    table.add("LiDAR's pose", other.ego_from_lidar - one.ego_from_lidar, 1e-6, "", where)
    for axis in ("x", "y", "z", "intensity", "ring"):
        same = np.array_equal(other.cloud[axis], one.cloud[axis])
        table.equal(f"points' {axis}, bits", same, True, where)
        if not same and len(other.cloud[axis]) == len(one.cloud[axis]):
            table.add(f"points' {axis}", other.cloud[axis].astype(float) - one.cloud[axis], 1e-3, "", where)
    for key in one.state:
        table.add(f"state: {key}", other.state[key] - one.state[key], 1e-6, "", where)
    if one.boxes is None or other.boxes is None:
        table.equal("labelled", other.boxes is None, one.boxes is None, where)
        return
    table.equal("number of boxes", len(other.boxes), len(one.boxes), where)
    left = list(other.boxes)
    for box in one.boxes:
        if not left:
            break
        back = min(left, key=lambda b: np.linalg.norm(b.center_m - box.center_m))
        left.remove(back)
        at = f"{where} {box.category} {box.id}"
        table.add("box centres", back.center_m - box.center_m, 1e-6, "m", at)
        table.add("box sizes", back.size_m - box.size_m, 1e-6, "m", at)
        table.add("box yaws", angle_between(back.yaw_rad, box.yaw_rad), 1e-6, "rad", at)
        known = ~(np.isnan(back.velocity_mps) | np.isnan(box.velocity_mps))
        table.add("(told) velocities", (back.velocity_mps - box.velocity_mps)[known], 50.0, "m/s", at)
        # The simulator counts returns from the object, an importer points in its box: ground and neighbours,
        # too.
        table.add("(told) points in boxes", back.n_lidar_points - box.n_lidar_points, 1000, "", at)
        was = f"{box.category} ({box.kind}, {box.distribution})"
        now = f"{back.category} ({back.kind}, {back.distribution})"
        if was != now:
            table.note(f"{was} comes back as {now}".replace("KIND_", "").replace("DISTRIBUTION_", ""))


def main() -> int:
    """Compares all samples."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("original", type=Path)
    parser.add_argument("returned", type=Path)
    options = parser.parse_args()
    table = Comparison()
    back = {}
    for episode in read_data_set(options.returned):
        for moment in episode.moments:
            back[fingerprint(moment)] = (episode, moment)
        for key, sentence in episode.log.get("methods", {}).items():
            if key != "description":
                table.note(f"{key}: {sentence}")
    table.note(f"{len(back)} samples in the returned data set")
    for episode in read_data_set(options.original):
        homes, first = set(), None
        for idx, moment in enumerate(episode.moments):
            where = f"{episode.path.stem} {idx}"
            table.equal("samples that came back", fingerprint(moment) in back, True, where)
            if fingerprint(moment) not in back:
                continue
            home, other = back[fingerprint(moment)]
            homes.add(home.path.stem)
            check_moment(moment, other, where, table)
            if first is None:
                first = moment.world_from_ego @ np.linalg.inv(other.world_from_ego)
            moved = first @ other.world_from_ego
            turned = rotation_angle(moved[:3, :3], moment.world_from_ego[:3, :3])
            table.add("poses, rotation", turned, 1e-6, "rad", where)
            table.add("poses, place", (moved - moment.world_from_ego)[:3, 3], 1e-6, "m", where)
        if len(homes) > 1:
            table.note(f"the samples of {episode.path.stem} come back as {len(homes)} episodes")
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
