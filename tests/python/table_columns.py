"""The columns of the evaluation, fair and strict, from their words alone; shares no code with the product.

Usage: table_columns.py PREDICTIONS TRUTH METRICS. Compares AP of every column, class and threshold with the
product's metrics.json, where a cell without a truth is null; prints how many were compared and the greatest
difference, exits 1 if it exceeds 1e-9.

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

Where the truth file says that a sample's truth leaves out something, unmatched predictions may be neutral,
and truths at the labelled range or beyond are dropped (docs/evaluation.md, "What a log does not label").
Neutral ones leave every ranking; the strict score, mean over the thresholds, has them as false positives.
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
NEUTRAL = "neutral"
NEAREST_M = 0.1


def place(box: dict) -> np.ndarray:
    return np.array(box["translation"][:2])


def is_near(box: dict, range_m: float) -> bool:
    return math.dist(box["translation"][:2], (0.0, 0.0)) < range_m


def is_truth(box: dict, facts: dict) -> bool:
    labelled_m = facts.get("labelled", {}).get("max_range_m", math.inf)
    return is_near(box, min(MAX_RANGE_M, labelled_m)) and box.get("num_pts", -1) != 0


def turn(rotation: list[float]) -> np.ndarray:
    w, x, y, z = np.array(rotation) / np.linalg.norm(rotation)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def is_over(point: np.ndarray, corners: np.ndarray) -> bool:
    """Whether a point lies in a convex polygon, whatever its winding."""
    edges = np.roll(corners, -1, axis=0) - corners
    off = point - corners
    sides = edges[:, 0] * off[:, 1] - edges[:, 1] * off[:, 0]
    return bool((sides >= 0).all() or (sides <= 0).all())


def corners_of(box: dict) -> np.ndarray:
    """[8, 3]: the footprint in a ring at the bottom, then at the top."""
    width, length, height = box["size"]
    ring = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    local = np.array([[a * length / 2, b * width / 2, c * height / 2] for c in (-1, 1) for a, b in ring])
    return local @ turn(box["rotation"]).T + np.array(box["translation"])


def to_camera(points: np.ndarray, camera: dict) -> np.ndarray:
    return (points - np.array(camera["translation"])) @ turn(camera["rotation"])


def to_pixels(points: np.ndarray, camera: dict) -> np.ndarray:
    focal, middle = (camera["fx_px"], camera["fy_px"]), (camera["cx_px"], camera["cy_px"])
    return points[:, :2] / points[:, 2:] * focal + middle


def share_in(box: dict, region: dict, camera: dict) -> float:
    """Share of a box's rectangle in the picture that lies in a region of it; 0 where nothing is seen."""
    corners = to_camera(corners_of(box), camera)
    seen = [corner for corner in corners if corner[2] >= NEAREST_M]
    pairs = [(i, (i + 1) % 4) for i in range(4)] + [(4 + i, 4 + (i + 1) % 4) for i in range(4)]
    for one, other in pairs + [(i, i + 4) for i in range(4)]:
        (a, b) = (corners[one], corners[other])
        if (a[2] < NEAREST_M) != (b[2] < NEAREST_M):
            seen.append(a + (NEAREST_M - a[2]) / (b[2] - a[2]) * (b - a))
    if not seen:
        return 0.0
    pixels = to_pixels(np.array(seen), camera)
    least = np.maximum(pixels.min(axis=0), 0)
    most = np.minimum(pixels.max(axis=0), (camera["width_px"], camera["height_px"]))
    area = float(np.prod(np.maximum(most - least, 0)))
    low = np.maximum(least, (region["left_px"], region["top_px"]))
    high = np.minimum(most, (region["right_px"], region["bottom_px"]))
    return float(np.prod(np.maximum(high - low, 0))) / area if area > 0 else 0.0


def has_labelled_size(box: dict, labelled: dict) -> bool:
    width, length, height = box["size"]
    for kind in labelled["kinds"]:
        if kind not in labelled["sizes"]:
            return True
        sizes = labelled["sizes"][kind]
        low, high = zip(sizes["length_m"], sizes["width_m"], sizes["height_m"], strict=True)
        for size in ((length, width, height), (width, length, height)):
            if all(a <= value <= b for a, value, b in zip(low, size, high, strict=True)):
                return True
    return False


def is_neutral(box: dict, facts: dict, truths: list[dict]) -> bool:
    camera, labelled = facts.get("camera"), facts.get("labelled")
    for region in facts.get("ignored", []):
        if "ground" in region:
            ring = np.array([[p["x_m"], p["y_m"]] for p in region["ground"]["corners_in_ego_m"]])
            if is_over(place(box), ring):
                return True
        elif camera is not None and share_in(box, region["image"], camera) >= 0.5:
            return True
    if labelled is None:
        return False
    if not is_near(box, labelled.get("max_range_m", math.inf)):
        return True
    if labelled.get("in_camera_view") and camera is not None:
        center = to_camera(np.array([box["translation"]]), camera)
        if center[0, 2] <= 0 or not 0 <= to_pixels(center, camera)[0, 0] < camera["width_px"]:
            return True
    lies_on = any(is_over(place(box), corners_of(truth)[:4, :2]) for truth in truths)
    return not has_labelled_size(box, labelled) and box.get("num_pts", -1) > 0 and not lies_on


def verdicts(
    predictions: dict, truth: dict, facts: dict, name: str, threshold_m: float
) -> list[tuple[bool, str]]:
    """By rank: whether a prediction is a true positive, and of which distribution, unmatched or neutral."""
    # One table of all predictions of the class; a stable ascending sort, read backwards.
    table = [
        (box["detection_score"], sample, box)
        for sample, boxes in predictions.items()
        for box in boxes
        if box["detection_name"] == name and is_near(box, MAX_RANGE_M)
    ]
    order = np.argsort([score for score, _, _ in table], kind="stable")[::-1]
    claimed: set[int] = set()
    found = []
    for rank in order:
        _, sample, box = table[rank]
        own, other = [], []
        of_sample = facts.get(sample, {})
        for candidate in truth[sample]:
            if not is_truth(candidate, of_sample):
                continue
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
            found.append((False, NEUTRAL if is_neutral(box, of_sample, truth[sample]) else UNMATCHED))
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


def columns(found: list[tuple[bool, str]], truth: dict, facts: dict, name: str) -> dict[str, float | None]:
    counts = {
        of: sum(
            box["detection_name"] == name
            and box["distribution"] == of
            and is_truth(box, facts.get(sample, {}))
            for sample, boxes in truth.items()
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
    worst, n_compared, n_between, n_neutral = 0.0, 0, 0, 0
    truths, facts = truth["results"], truth.get("samples", {})

    def compare(ours: float | None, theirs: float | None) -> None:
        nonlocal worst, n_compared, n_between
        n_compared += 1
        if ours is None or theirs is None:
            worst = worst if ours is theirs else math.inf
            return
        worst = max(worst, abs(ours - theirs))
        n_between += 0 < ours < 1

    for name in ("harmful", "harmless"):
        strict: dict[str, list[float | None]] = {}
        for index, threshold_m in enumerate(THRESHOLDS_M):
            found = verdicts(predictions["results"], truths, facts, name, threshold_m)
            n_neutral += sum(of == NEUTRAL for _, of in found)
            for column, ap in columns(found, truths, facts, name).items():
                compare(ap, metrics["per_threshold"][column][name][index])
            found = [(hit, UNMATCHED if of == NEUTRAL else of) for hit, of in found]
            for column, ap in columns(found, truths, facts, name).items():
                strict.setdefault(column, []).append(ap)
        for column, aps in strict.items():
            mean = None if None in aps else sum(aps) / len(aps)
            compare(mean, metrics.get("strict", metrics)[column][name])
    counts = f"{n_compared} compared, {n_between} between 0 and 1"
    print(f"{counts}, greatest difference {worst:.1e}, {n_neutral} neutral")
    return 0 if worst <= TOLERANCE else 1


if __name__ == "__main__":
    sys.exit(main())
