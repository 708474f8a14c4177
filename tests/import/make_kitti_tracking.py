"""Lays the frames of a made raw drive out as a KITTI tracking sequence: labels with tracks, one calibration,
oxts rows.

Usage: make_kitti_tracking.py TRAINING_DIR RAW_DIR OUT   (RAW_DIR as make_kitti_raw.py makes it)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np


def main() -> None:
    """Makes sequence 0000."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("training", type=Path)
    parser.add_argument("raw", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    target, names = options.out / "training", np.load(options.raw / "truth.npz")["names"]
    for folder in ("velodyne/0000", "image_02/0000", "calib", "oxts", "label_02"):
        (target / folder).mkdir(parents=True, exist_ok=True)
    labels, track = [], 0
    for idx, name in enumerate(names):
        cloud = (options.training / "velodyne" / f"{name}.bin").read_bytes()
        (target / f"velodyne/0000/{idx:06d}.bin").write_bytes(cloud)
        picture = (options.training / "image_2" / f"{name}.png").read_bytes()
        (target / f"image_02/0000/{idx:06d}.png").write_bytes(picture)
        for line in (options.training / "label_2" / f"{name}.txt").read_text().splitlines():
            words = line.split()
            words[1] = str(round(float(words[1])))  # tracking's truncation is 0, 1 or 2
            labels.append(f"{idx} {-1 if words[0] == 'DontCare' else track} {' '.join(words)}")
            track += words[0] != "DontCare"
    (target / "label_02/0000.txt").write_text("\n".join(labels) + "\n")
    # Tracking's names have no colon after the last three rows.
    rows = (options.training / "calib" / f"{names[0]}.txt").read_text().splitlines()
    renamed = {"R0_rect:": "R_rect", "Tr_velo_to_cam:": "Tr_velo_cam", "Tr_imu_to_velo:": "Tr_imu_velo"}
    for old, new in renamed.items():
        rows = [row.replace(old, new) for row in rows]
    (target / "calib/0000.txt").write_text("\n".join(rows) + "\n")
    packets = sorted(options.raw.rglob("oxts/data/*.txt"))
    (target / "oxts/0000.txt").write_text("".join(path.read_text() for path in packets))
    print(f"{len(names)} frames as a tracking sequence: {target}")


if __name__ == "__main__":
    main()
