"""Writes nuscenes_*.json: random boxes and what nuscenes-devkit's own code makes of them.

Run with nuscenes-devkit 1.2.0 (pins in requirements-test.txt) from any folder:
    python tests/golden/nuscenes_accumulate.py
The devkit refuses class names of others, so harmful goes through it as `car`, harmless as `truck`:
both have orientations with a period of 2 pi. Boxes lie in the ego frame (ego_translation equals
translation). Every step is the devkit's: deserialize, filter_eval_boxes, accumulate, calc_ap, calc_tp.
"""

import json
import math
import random
from pathlib import Path

from nuscenes.eval.common.data_classes import EvalBoxes
from nuscenes.eval.common.loaders import filter_eval_boxes
from nuscenes.eval.common.utils import center_distance
from nuscenes.eval.detection.algo import accumulate, calc_ap, calc_tp
from nuscenes.eval.detection.data_classes import DetectionBox

DEVKIT_NAMES = {"harmful": "car", "harmless": "truck"}
THRESHOLDS_M = [0.5, 1.0, 2.0, 4.0]
TP_THRESHOLD_M = 2.0
MIN_RECALL, MIN_PRECISION, MAX_RANGE_M = 0.1, 0.1, 50


class NoRacks:
    """Stands for the NuScenes database in filter_eval_boxes, which asks it for bicycle racks."""

    def get(self, table: str, token: str) -> dict:
        return {"anns": []}


def box(rng: random.Random, x: float, y: float, name: str) -> dict:
    yaw = rng.uniform(-math.pi, math.pi)
    # A little roll and an unnormalised quaternion: only the heading counts.
    rotation = [math.cos(yaw / 2), rng.choice([0, 0.02]), 0.0, math.sin(yaw / 2)]
    return {
        "translation": [round(x, 3), round(y, 3), round(rng.uniform(0, 2), 3)],
        "size": [round(rng.uniform(0.5, 3), 2), round(rng.uniform(0.5, 6), 2), round(rng.uniform(1, 3), 2)],
        "rotation": [round(part, 4) for part in rotation],
        "velocity": [round(rng.gauss(0, 3), 2), round(rng.gauss(0, 3), 2)],
        "detection_name": name,
    }


def random_case(
    seed: int, n_samples: int, score_digits: int, noise_m: float, names: list[str], on_grid: bool = False
) -> tuple[dict, dict]:
    """Predictions and truth; fewer score digits make more ties, a grid of 0.5 m makes equal distances."""
    rng = random.Random(seed)
    truth, predictions = {}, {}
    for index in range(n_samples):
        token = f"sample-{index:02}"
        truth[token], predictions[token] = [], []
        for _ in range(rng.randrange(0, 9)):
            x, y = rng.uniform(1, 58), rng.uniform(-12, 12)
            name = rng.choice(names)
            truth[token].append(box(rng, x, y, name) | {"num_pts": rng.choice([-1, 0, 3, 40, 40])})
            for _ in range(rng.choice([0, 1, 1, 2])):
                found = box(rng, x + rng.gauss(0, noise_m), y + rng.gauss(0, noise_m), name)
                if rng.random() < 0.15:
                    found["detection_name"] = rng.choice(list(DEVKIT_NAMES))
                if rng.random() < 0.5:
                    found["size"], found["rotation"] = truth[token][-1]["size"], truth[token][-1]["rotation"]
                found["detection_score"] = round(rng.random() ** 0.5, score_digits)
                predictions[token].append(found)
        for _ in range(rng.randrange(0, 3)):
            clutter = box(rng, rng.uniform(1, 58), rng.uniform(-12, 12), rng.choice(list(DEVKIT_NAMES)))
            predictions[token].append(clutter | {"detection_score": round(rng.random() * 0.7, score_digits)})
    if on_grid:
        for raw in [raw for boxes in (*truth.values(), *predictions.values()) for raw in boxes]:
            raw["translation"] = [round(2 * part) / 2 for part in raw["translation"]]
    # The predictions' order of samples is what decides ties.
    tokens = list(predictions)
    rng.shuffle(tokens)
    return {token: predictions[token] for token in tokens}, truth


def devkit_boxes(results: dict) -> EvalBoxes:
    def one(token: str, raw: dict) -> dict:
        return raw | {
            "sample_token": token,
            "ego_translation": raw["translation"],
            "detection_name": DEVKIT_NAMES[raw["detection_name"]],
            "attribute_name": "",
        }

    content = {token: [one(token, raw) for raw in boxes] for token, boxes in results.items()}
    boxes = EvalBoxes.deserialize(content, DetectionBox)
    return filter_eval_boxes(NoRacks(), boxes, dict.fromkeys(DEVKIT_NAMES.values(), MAX_RANGE_M))


def expected(predictions: dict, truth: dict) -> dict:
    found, true = devkit_boxes(predictions), devkit_boxes(truth)
    outcome = {"per_threshold": {}, "tp_errors": {}, "n_truths": {}, "n_detections": {}}
    for name, devkit_name in DEVKIT_NAMES.items():
        data = {d: accumulate(true, found, devkit_name, center_distance, d) for d in THRESHOLDS_M}
        outcome["per_threshold"][name] = [calc_ap(data[d], MIN_RECALL, MIN_PRECISION) for d in THRESHOLDS_M]
        errors = {"ate": "trans_err", "ase": "scale_err", "aoe": "orient_err"}
        outcome["tp_errors"][name] = {
            ours: calc_tp(data[TP_THRESHOLD_M], MIN_RECALL, theirs) for ours, theirs in errors.items()
        }
        outcome["n_truths"][name] = sum(box.detection_name == devkit_name for box in true.all)
        outcome["n_detections"][name] = sum(box.detection_name == devkit_name for box in found.all)
    return outcome


def main() -> None:
    both = list(DEVKIT_NAMES)
    cases = {
        "ties": random_case(1, 12, 1, 0.6, both),
        "distinct": random_case(2, 12, 6, 0.6, both),
        "vague": random_case(3, 10, 2, 2.5, both),
        "one_class": random_case(4, 6, 1, 0.4, ["harmless"]),
        "all_equal": random_case(5, 8, 0, 0.3, both),
        "far_off": random_case(6, 6, 1, 30.0, both),
        "grid": random_case(8, 12, 1, 0.8, both, on_grid=True),
        "few": random_case(7, 2, 1, 0.3, both),
    }
    folder = Path(__file__).parent
    for name, (predictions, truth) in cases.items():
        parts = {
            "predictions": {"meta": {}, "results": predictions},
            "truth": {"meta": {}, "results": truth},
            "expected": expected(predictions, truth),
        }
        for part, content in parts.items():
            text = json.dumps(content, separators=(",", ":"))
            (folder / f"nuscenes_{name}.{part}.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
