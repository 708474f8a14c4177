"""Damages to KITTI folders and Argoverse 2 logs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from damage_case import case, write


def edit_cloud(root: Path, change: Callable[[np.ndarray], np.ndarray], names: tuple[str, ...] = ()) -> None:
    """Changes the points [n, 4] of all frames, or of some."""
    for path in sorted((root / "training/velodyne").glob("*.bin")):
        if not names or path.stem in names:
            points = change(np.fromfile(path, dtype="<f4").reshape(-1, 4).copy())
            write(path, points.astype("<f4").tobytes())


@case("kitti", "cloud cut by 7 bytes", r"16|multiple|bytes|cut|whole", fails=True, skippable=True)
def _(root: Path) -> None:
    path = root / "training/velodyne/000003.bin"
    write(path, path.read_bytes()[:-7])


@case("kitti", "a word in a label's number", r"label_2|line \d", fails=True, skippable=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("1.57 1.73", "1.57 wide", 1))


@case("kitti", "a label's row is cut", r"label_2|line \d", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text()[:45] + "\n")


@case("kitti", "no calibration file", r"calib", fails=True, skippable=True)
def _(root: Path) -> None:
    (root / "training/calib/000003.txt").unlink()


@case("kitti", "no P2 in a calibration", r"p2", fails=True)
def _(root: Path) -> None:
    path = root / "training/calib/000003.txt"
    write(path, "".join(x for x in path.read_text().splitlines(True) if not x.startswith("P2")))


@case("kitti", "Tr_velo_to_cam is no rotation", r"rotation|orthogonal|tr_velo", fails=True)
def _(root: Path) -> None:
    path = root / "training/calib/000003.txt"
    write(path, path.read_text().replace("7.533745000000e-03", "7.533745000000e-01", 1))


@case("kitti", "cloud's x and y are swapped", r"ax[ei]s|swap|turned|no points?|point.* in .*box|boxes")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points[:, [1, 0, 2, 3]])


@case("kitti", "NaN points", r"nan|not (a )?(number|finite)|finite")
def _(root: Path) -> None:
    def change(points: np.ndarray) -> np.ndarray:
        points[5:25, 0] = np.nan
        return points

    edit_cloud(root, change)


@case("kitti", "empty cloud", r"empty|no points?|0 points")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points[:0], ("000003",))


@case("kitti", "cloud in millimetres", r"millimet|units?|metres|mm\b")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1000, 1000, 1000, 1])


@case("kitti", "intensity from 0 to 255", r"intensit|reflectance", fails=False)
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1, 1, 1, 255])


@case("kitti", "intensity from 0 to 65535", r"intensit|reflectance")
def _(root: Path) -> None:
    edit_cloud(root, lambda points: points * [1, 1, 1, 65535])


@case("kitti", "picture of half the size", r"size|principal|calibration|centre|center")
def _(root: Path) -> None:
    from PIL import Image

    path = root / "training/image_2/000003.png"
    picture = Image.open(path)
    small = picture.resize((picture.width // 2, picture.height // 2))
    path.unlink()
    small.save(path)


@case("kitti", "picture cut in its middle", r"image_2|picture|png", fails=True, skippable=True)
def _(root: Path) -> None:
    path = root / "training/image_2/000003.png"
    write(path, path.read_bytes()[:20_000])


@case("kitti", "picture of another format under .png", r"image_2|picture|png|jpeg")
def _(root: Path) -> None:
    write(root / "training/image_2/000003.png", b"no picture at all" * 50)


@case("kitti", "no picture", r"image_2", fails=True, skippable=True)
def _(root: Path) -> None:
    (root / "training/image_2/000003.png").unlink()


@case("kitti", "a box of negative size", r"size|height|width|length", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("1.57 1.73 4.15", "1.57 -1.73 4.15", 1))


@case("kitti", "a category that the mapping does not name", r"tractor", fails=True)
def _(root: Path) -> None:
    path = root / "training/label_2/000003.txt"
    write(path, path.read_text().replace("Car ", "Tractor ", 1))


@case("kitti", "an empty folder", r"velodyne|training|no ", fails=True)
def _(root: Path) -> None:
    shutil.rmtree(root)
    root.mkdir()


def edit_table(root: Path, pattern: str, change: Callable) -> None:
    """Changes a feather table through pandas."""
    import pandas as pd

    (path,) = root.rglob(pattern)
    table = change(pd.read_feather(path))
    path.unlink()
    table.to_feather(path)


@case("av2", "no column qw in the annotations", r"qw", fails=True)
def _(root: Path) -> None:
    edit_table(root, "annotations.feather", lambda table: table.drop(columns="qw"))


@case("av2", "the sweep's table is cut", r"lidar|feather", fails=True)
def _(root: Path) -> None:
    (path,) = root.rglob("sensors/lidar/*.feather")
    write(path, path.read_bytes()[:300_000])


@case("av2", "no column intensity in the sweep", r"intensity", fails=True)
def _(root: Path) -> None:
    # (A changed byte within a column cannot be told: feather files hold no checksums.)
    (path,) = root.rglob("sensors/lidar/*.feather")
    edit_table(root, path.name, lambda table: table.drop(columns="intensity"))


@case("av2", "no poses", r"city_se3|pose", fails=True)
def _(root: Path) -> None:
    (path,) = root.rglob("city_SE3_egovehicle.feather")
    path.unlink()


@case("av2", "rotations of poses are no unit quaternions", r"quaternion|unit|rotation|norm", fails=True)
def _(root: Path) -> None:
    edit_table(root, "city_SE3_egovehicle.feather", lambda t: t.assign(qw=t.qw * 1.5))


@case("av2", "cloud in millimetres", r"millimet|units?|metres|mm\b|finite")
def _(root: Path) -> None:
    (path,) = root.rglob("sensors/lidar/*.feather")
    name = path.name
    edit_table(
        root,
        name,
        lambda t: t.assign(x=t.x.astype("f4") * 1e3, y=t.y.astype("f4") * 1e3, z=t.z.astype("f4") * 1e3),
    )
