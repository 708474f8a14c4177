"""Times nuscenes-devkit's accumulate and shapely over the boxes of a folder; `make bench` runs it.

Usage: bench_eval.py FOLDER, with predictions.json, truth.json and states.json. Takes from stdin what to do,
`accumulate`, `shapely` or `shapely_arrays`, and prints JSON with seconds and result for each line. Reading
the files and making the devkit's boxes is not timed; making shapely's polygons is, as a label needs them.
"""

import json
import math
import sys
import time
from pathlib import Path

import numpy as np
import shapely
from nuscenes.eval.common.data_classes import EvalBoxes
from nuscenes.eval.common.utils import center_distance
from nuscenes.eval.detection.algo import accumulate, calc_ap
from nuscenes.eval.detection.data_classes import DetectionBox
from shapely.geometry import Polygon

# The devkit refuses other classes' names.
DEVKIT_NAMES = {"harmful": "car", "harmless": "truck"}
THRESHOLDS_M = [0.5, 1.0, 2.0, 4.0]
# The zone's default config.
TIME_GAP_S, MIN_SAFE_DISTANCE_M, WIDTH_M, MIN_AREA_M2, MIN_RATIO = 2.0, 5.0, 3.5, 1.0, 0.25


def devkit_boxes(results: dict) -> EvalBoxes:
    """The devkit's boxes of a results dict."""

    def one(token: str, raw: dict) -> dict:
        return raw | {
            "sample_token": token,
            "ego_translation": raw["translation"],
            "detection_name": DEVKIT_NAMES[raw["detection_name"]],
            "attribute_name": "",
        }

    return EvalBoxes.deserialize(
        {token: [one(token, raw) for raw in boxes] for token, boxes in results.items()}, DetectionBox
    )


def time_devkit(found: EvalBoxes, true: EvalBoxes) -> tuple[float, dict]:
    """Seconds of the devkit's accumulate, and its APs."""
    start = time.perf_counter()
    data = {
        name: [accumulate(true, found, devkit_name, center_distance, d) for d in THRESHOLDS_M]
        for name, devkit_name in DEVKIT_NAMES.items()
    }
    seconds = time.perf_counter() - start
    return seconds, {name: [calc_ap(one, 0.1, 0.1) for one in per] for name, per in data.items()}


def zone_corners(speed_mps: float, steering_rad: float, bumper_x_m: float) -> list[tuple[float, float]]:
    """The danger zone's corners in the ego frame."""
    depth = TIME_GAP_S * max(speed_mps, 0.0) + MIN_SAFE_DISTANCE_M
    sin, cos = math.sin(steering_rad), math.cos(steering_rad)
    local = [(0, -WIDTH_M / 2), (depth, -WIDTH_M / 2), (depth, WIDTH_M / 2), (0, WIDTH_M / 2)]
    return [(bumper_x_m + u * cos - n * sin, u * sin + n * cos) for u, n in local]


def footprint_corners(raw: dict) -> list[tuple[float, float]]:
    """Corners of a box on the ground."""
    yaw = 2 * math.atan2(raw["rotation"][3], raw["rotation"][0])
    sin, cos = math.sin(yaw), math.cos(yaw)
    (x, y, _), (width, length, _) = raw["translation"], raw["size"]
    local = [(length, width), (-length, width), (-length, -width), (length, -width)]
    return [(x + (a * cos - b * sin) / 2, y + (a * sin + b * cos) / 2) for a, b in local]


def time_shapely(truth: list[list[dict]], states: list[list[float]]) -> tuple[float, int]:
    """Seconds of labelling object by object, and how many are harmful."""
    start, n_harmful = time.perf_counter(), 0
    for boxes, state in zip(truth, states, strict=True):
        zone = Polygon(zone_corners(*state))
        for raw in boxes:
            footprint = Polygon(footprint_corners(raw))
            area = footprint.intersection(zone).area
            n_harmful += area >= MIN_AREA_M2 or area / footprint.area >= MIN_RATIO
    return time.perf_counter() - start, int(n_harmful)


def time_shapely_arrays(truth: list[list[dict]], states: list[list[float]]) -> tuple[float, int]:
    """The same with shapely's vectorised functions: a call for all objects."""
    start = time.perf_counter()
    zones = shapely.polygons(np.array([zone_corners(*state) for state in states]))
    footprints = shapely.polygons(np.array([footprint_corners(raw) for boxes in truth for raw in boxes]))
    of_object = np.repeat(zones, [len(boxes) for boxes in truth])
    area = shapely.area(shapely.intersection(footprints, of_object))
    is_harmful = (area >= MIN_AREA_M2) | (area / shapely.area(footprints) >= MIN_RATIO)
    return time.perf_counter() - start, int(is_harmful.sum())


def main() -> None:
    """Reads the boxes, then does what each line names, once, and prints seconds and result as JSON."""
    folder = Path(sys.argv[1])
    predictions, truth, states = (
        json.loads((folder / f"{name}.json").read_text()) for name in ("predictions", "truth", "states")
    )
    boxes = list(truth["results"].values())
    of_devkit: list[EvalBoxes] = []

    def accumulate_all() -> tuple[float, dict]:
        if not of_devkit:
            of_devkit.extend(devkit_boxes(part["results"]) for part in (predictions, truth))
        return time_devkit(*of_devkit)

    work = {
        "accumulate": accumulate_all,
        "shapely": lambda: time_shapely(boxes, states),
        "shapely_arrays": lambda: time_shapely_arrays(boxes, states),
    }
    for line in sys.stdin:
        seconds, result = work[line.strip()]()
        print(json.dumps({"seconds": seconds, "result": result}), flush=True)


if __name__ == "__main__":
    main()
