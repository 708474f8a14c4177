"""Runs mmdetection3d's own data preparation, from its wheel and unpatched, over an export; and loads what it
made.

Usage: run_mmdet3d.py nuscenes|kitti EXPORT [--version v1.0-mini]

The wheel ships `tools/create_data.py` in `mmdet3d/.mim`. mmcv's compiled operations need a compiler and an
hour; neither the script nor the data sets call one, so a module takes their place that fails at any call. The
export is seen as `./data/nuscenes` or `./data/kitti` through a link, as mmdetection3d's docs say; its info
files go there and into no other place.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import runpy
import sys
import tempfile
import types
from pathlib import Path


class MissingOperations(types.ModuleType):
    """Stands for `mmcv._ext`: every operation is there, and fails where it is called."""

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(name)

        def fail(*_arguments: object, **_named: object) -> None:
            raise NotImplementedError(f"mmcv._ext.{name}: mmcv-lite has no compiled operations")

        return fail


def prepare(kind: str, version: str) -> None:
    """`python tools/create_data.py KIND ...` in the present folder."""
    spec = importlib.util.find_spec("mmdet3d")
    tools = Path(spec.submodule_search_locations[0]) / ".mim"
    sys.path.insert(0, str(tools))
    root = f"./data/{kind}"
    arguments = ["create_data.py", kind, "--root-path", root, "--out-dir", root, "--extra-tag", kind]
    sys.argv = arguments + (["--version", version] if kind == "nuscenes" else [])
    runpy.run_path(str(tools / "tools" / "create_data.py"), run_name="__main__")


def load(kind: str) -> None:
    """Every training sample through the data set class and its pipeline: points, boxes, names."""
    from mmengine.registry import init_default_scope

    init_default_scope("mmdet3d")
    from mmdet3d.registry import DATASETS

    nuscenes = kind == "nuscenes"
    n_features = 5 if nuscenes else 4
    pipeline = [
        {
            "type": "LoadPointsFromFile",
            "coord_type": "LIDAR",
            "load_dim": n_features,
            "use_dim": n_features,
        },
        {"type": "LoadAnnotations3D", "with_bbox_3d": True, "with_label_3d": True},
        {"type": "Pack3DDetInputs", "keys": ["points", "gt_bboxes_3d", "gt_labels_3d"]},
    ]
    if nuscenes:
        pipeline.insert(1, {"type": "LoadPointsFromMultiSweeps", "sweeps_num": 3, "remove_close": True})
    prefix = (
        {"pts": "samples/LIDAR_TOP", "sweeps": "sweeps/LIDAR_TOP"}
        if nuscenes
        else {"pts": "training/velodyne"}
    )
    for split in ("train", "val"):
        data_set = DATASETS.build(
            {
                "type": "NuScenesDataset" if nuscenes else "KittiDataset",
                "data_root": f"data/{kind}/",
                "ann_file": f"{kind}_infos_{split}.pkl",
                "data_prefix": prefix,
                "pipeline": pipeline,
                "box_type_3d": "LiDAR",
                "filter_empty_gt": False,
                "metainfo": {},
                "test_mode": False,
            }
        )
        n_points = n_boxes = n_filled = 0
        names: dict[str, int] = {}
        for idx in range(len(data_set)):
            sample = data_set[idx]
            points = sample["inputs"]["points"]
            truth = sample["data_samples"].gt_instances_3d
            n_points += len(points)
            n_boxes += len(truth.bboxes_3d)
            classes = data_set.metainfo["classes"]
            for box, label in zip(truth.bboxes_3d.tensor.numpy(), truth.labels_3d.tolist(), strict=True):
                name = classes[label] if label >= 0 else "of no class"
                names[name] = names.get(name, 0) + 1
                n_filled += count_inside(points[:, :3].numpy(), box) > 0
        print(
            f"{split}: {len(data_set)} samples, {n_points} points, {n_boxes} boxes {names}, "
            f"{n_filled} with points"
        )


def count_inside(points: object, box: object) -> int:
    """Points in a LiDAR box (x y z-of-the-bottom, length width height, yaw) of mmdetection3d."""
    import numpy as np

    local = points - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    along, across = local[:, 0] * cos + local[:, 1] * sin, local[:, 1] * cos - local[:, 0] * sin
    within = (np.abs(along) <= box[3] / 2) & (np.abs(across) <= box[4] / 2)
    return int((within & (local[:, 2] >= 0) & (local[:, 2] <= box[5])).sum())


def main() -> None:
    """Prepares, then loads."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", choices=["nuscenes", "kitti"])
    parser.add_argument("export", type=Path)
    parser.add_argument("--version", default="v1.0-mini", help="or v1.0")
    options = parser.parse_args()
    export = options.export.resolve()
    sys.modules["mmcv._ext"] = MissingOperations("mmcv._ext")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        Path("data").mkdir()
        Path("data", options.kind).symlink_to(export)
        prepare(options.kind, options.version)
        load(options.kind)


if __name__ == "__main__":
    main()
