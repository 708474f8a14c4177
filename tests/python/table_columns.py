"""The four columns of the evaluation, from their words alone; shares no code with the product.

Usage: table_columns.py PREDICTIONS TRUTH METRICS. Compares AP of every column, class and threshold with the
product's metrics.json, where a cell without a truth is null; prints how many were compared and the greatest difference, exits 1 if it exceeds 1e-9.

For class c and threshold d, predictions in descending score (ties: later index first). Each takes the
nearest unclaimed truth of class c in its sample within d: a true positive, of that truth's distribution.
Otherwise, if a truth of the other class lies within d (the nearest one counts), it is a misclassified false
positive of that truth's distribution. Otherwise it is an unmatched false positive.

| column      | true positives | false positives                | positives |
|-------------|----------------|--------------------------------|-----------|
| total       | all            | all                            | all       |
| id_matched  | ID             | misclassified on ID            | ID        |
| ood_all     | OOD            | misclassified on OOD, unmatched| OOD       |
| ood_matched | OOD            | misclassified on OOD           | OOD       |

AP: precision over recall at 0, 0.01 .. 1 (numpy's interp, 0 beyond what is reached), mean over the 90 steps
above 0.1 of what exceeds a precision of 0.1, over 0.9. Truths without a LiDAR point and boxes at 50 m or more
do not count.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np

THRESHOLDS_M = [0.5, 1.0, 2.0, 4.0]
MAX_RANGE_M = 50.0
TOLERANCE = 1e-9
UNMATCHED = "unmatched"


def place(box: dict) -> np.ndarray:
    return np.array(box["translation"][:2])


def is_kept(box: dict) -> bool:
    return math.dist(box["translation"][:2], (0.0, 0.0)) < MAX_RANGE_M and box.get("num_pts", -1) != 0


def verdicts(predictions: dict, truth: dict, name: str, threshold_m: float) -> list[tuple[bool, str]]:
    """By rank: whether a prediction is a true positive, and of which distribution or unmatched."""
    # One table of all predictions of the class; a stable ascending sort, read backwards.
    table = [
        (box["detection_score"], sample, box)
        for sample, boxes in predictions.items()
        for box in boxes
        if box["detection_name"] == name and is_kept(box)
    ]
    order = np.argsort([score for score, _, _ in table], kind="stable")[::-1]
    claimed: set[int] = set()
    found = []
    for rank in order:
        _, sample, box = table[rank]
        own, other = [], []
        for candidate in filter(is_kept, truth[sample]):
            offset = place(candidate) - place(box)
            distance = float(np.sqrt(offset @ offset))
            if distance < threshold_m:
                (own if candidate["detection_name"] == name else other).append((distance, candidate))
        free = [entry for entry in own if id(entry[1]) not in claimed]
        if free:
            nearest = min(free, key=lambda entry: entry[0])[1]
            claimed.add(id(nearest))
            found.append((True, nearest["distribution"]))
        elif other:
            found.append((False, min(other, key=lambda entry: entry[0])[1]["distribution"]))
        else:
            found.append((False, UNMATCHED))
    return found


def average_precision(hits: list[bool], n_positives: int) -> float | None:
    if n_positives == 0:
        return None
    if not any(hits):
        return 0.0
    true = np.cumsum(hits)
    precision = true / np.arange(1, len(hits) + 1)
    steps = np.linspace(0, 1, 101)
    sampled = np.interp(steps, true / n_positives, precision, right=0)[11:]
    return float(np.mean(np.maximum(sampled - 0.1, 0)) / 0.9)


def columns(predictions: dict, truth: dict, name: str, threshold_m: float) -> dict[str, float | None]:
    found = verdicts(predictions, truth, name, threshold_m)
    counts = {
        of: sum(
            box["detection_name"] == name and box["distribution"] == of and is_kept(box)
            for boxes in truth.values()
            for box in boxes
        )
        for of in ("id", "ood")
    }
    rules = {
        "total": ({"id", "ood", UNMATCHED}, counts["id"] + counts["ood"]),
        "id_matched": ({"id"}, counts["id"]),
        "ood_all": ({"ood", UNMATCHED}, counts["ood"]),
        "ood_matched": ({"ood"}, counts["ood"]),
    }
    return {
        column: average_precision([hit for hit, of in found if of in counted], n_positives)
        for column, (counted, n_positives) in rules.items()
    }


def main() -> int:
    predictions, truth, metrics = (json.loads(Path(path).read_text()) for path in sys.argv[1:4])
    worst, n_compared, n_between = 0.0, 0, 0
    for name in ("harmful", "harmless"):
        for index, threshold_m in enumerate(THRESHOLDS_M):
            ours = columns(predictions["results"], truth["results"], name, threshold_m)
            for column, ap in ours.items():
                theirs = metrics["per_threshold"][column][name][index]
                n_compared += 1
                if ap is None or theirs is None:
                    worst = worst if ap is theirs else math.inf
                    continue
                worst = max(worst, abs(ap - theirs))
                n_between += 0 < ap < 1
    print(f"{n_compared} compared, {n_between} between 0 and 1, greatest difference {worst:.1e}")
    return 0 if worst <= TOLERANCE else 1


if __name__ == "__main__":
    sys.exit(main())
