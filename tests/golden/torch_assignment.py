"""Assignment of queries to objects: costs in NumPy and PyTorch, pairs by SciPy's linear_sum_assignment.

Writes `assignment.safetensors` beside itself. Costs as in the published TransFusion head: focal cost of the
class (weight 0.15), L1 of the centres in bird's-eye view, each axis over the map's length (0.25), minus
the IoU of the boxes in 3D (0.25). The overlap of footprints is SciPy's intersection of half-planes, another
method than the program's clipping.

    .venv-golden/bin/python tests/golden/torch_assignment.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from scipy.optimize import linear_sum_assignment, linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

# The default map: x and y from, to, in metres; side of a cell.
RANGE_M = ((0.0, 51.2), (-32.0, 32.0))
CELL_M = 0.8
WEIGHTS = {"class": 0.15, "center": 0.25, "iou": 0.25}
Box = np.ndarray  # x, y, z of the centre, length, width, height, yaw


def halfspaces(box: Box) -> np.ndarray:
    """The footprint as rows (a, b, c) with a x + b y + c <= 0."""
    rows = []
    for angle, half in ((box[6], box[3] / 2), (box[6] + np.pi / 2, box[4] / 2)):
        normal = np.array([np.cos(angle), np.sin(angle)])
        for sign in (1.0, -1.0):
            rows.append([*(sign * normal), -sign * normal @ box[:2] - half])
    return np.array(rows)


def overlap_area(a: Box, b: Box) -> float:
    """Shared ground of two footprints."""
    rows = np.vstack([halfspaces(a), halfspaces(b)])
    # The point deepest inside all half-planes; without one they share nothing.
    best = linprog(
        [0, 0, -1], A_ub=np.c_[rows[:, :2], np.ones(len(rows))], b_ub=-rows[:, 2], bounds=[(None, None)] * 3
    )
    if best.status != 0 or best.x[2] < 1e-9:
        return 0.0
    try:
        return float(ConvexHull(HalfspaceIntersection(rows, best.x[:2]).intersections).volume)
    except QhullError:
        return 0.0


def iou_3d(a: Box, b: Box) -> float:
    """Intersection over union of two upright boxes."""
    top = min(a[2] + a[5] / 2, b[2] + b[5] / 2)
    bottom = max(a[2] - a[5] / 2, b[2] - b[5] / 2)
    shared = overlap_area(a, b) * max(top - bottom, 0.0)
    return shared / (np.prod(a[3:6]) + np.prod(b[3:6]) - shared)


def focal_cost(logits: np.ndarray, harm: np.ndarray) -> np.ndarray:
    """[query, object]: gamma 2, alpha 0.25."""
    p = torch.sigmoid(torch.from_numpy(logits)).numpy()
    positive = -np.log(p + 1e-12) * 0.25 * (1 - p) ** 2
    negative = -np.log(1 - p + 1e-12) * 0.75 * p**2
    return (positive - negative)[:, harm]


def costs_of(guesses: np.ndarray, logits: np.ndarray, truths: np.ndarray, harm: np.ndarray) -> np.ndarray:
    """[query, object]."""
    size = np.array([high - low for low, high in RANGE_M])
    center = np.abs((guesses[:, None, :2] - truths[None, :, :2]) / size).sum(2)
    iou = np.array([[iou_3d(guess, truth) for truth in truths] for guess in guesses]).reshape(center.shape)
    return WEIGHTS["class"] * focal_cost(logits, harm) + WEIGHTS["center"] * center - WEIGHTS["iou"] * iou


def encode(box: Box, query_m: np.ndarray) -> np.ndarray:
    """The program's box code: offset from the query in cells, height, log sizes, yaw, velocity."""
    offset = (box[:2] - query_m) / CELL_M
    return np.array([*offset, box[2], *np.log(box[3:6]), np.sin(box[6]), np.cos(box[6]), 0.0, 0.0])


def random_boxes(rng: np.random.Generator, n: int) -> np.ndarray:
    """Objects on the map."""
    center = np.c_[rng.uniform(*RANGE_M[0], n), rng.uniform(*RANGE_M[1], n), rng.uniform(0.3, 1.5, n)]
    size = np.c_[rng.uniform(0.3, 9.0, n), rng.uniform(0.3, 2.6, n), rng.uniform(0.4, 3.2, n)]
    return np.c_[center, size, rng.uniform(-np.pi, np.pi, n)]


def main() -> None:
    """Writes the file."""
    rng = np.random.default_rng(40)
    found = {}
    cases = {
        "more_queries": (12, 5),
        "more_objects": (4, 9),
        "as_many": (6, 6),
        "one": (1, 1),
        "ties": (10, 6),
    }
    for case, (n_queries, n_objects) in cases.items():
        truths, harm = random_boxes(rng, n_objects), rng.integers(0, 2, n_objects)
        guesses = random_boxes(rng, n_queries)
        # Half of the guesses lie near some object, so that boxes overlap at all angles.
        for q in range(0, n_queries, 2):
            near = truths[rng.integers(n_objects)]
            guesses[q] = near + rng.normal(0, [0.4, 0.4, 0.2, 0.1, 0.1, 0.1, 0.3])
            guesses[q, 3:6] = np.maximum(guesses[q, 3:6], 0.2)
        logits = rng.normal(0, 2, (n_queries, 2))
        if case == "ties":
            # Each guess and each object twice: many assignments cost the same.
            guesses[1::2], logits[1::2], truths[1::2], harm[1::2] = (
                guesses[::2],
                logits[::2],
                truths[::2],
                harm[::2],
            )
        # What the program sees is f32 throughout.
        queries_m = np.float32(guesses[:, :2] + rng.normal(0, 1, (n_queries, 2))).astype(float)
        codes = np.float32([encode(box, at) for box, at in zip(guesses, queries_m, strict=True)])
        logits = np.float32(logits).astype(float)
        costs = costs_of(guesses, logits, truths, harm)
        rows, columns = linear_sum_assignment(costs)
        found |= {
            f"{case}.queries_m": torch.from_numpy(queries_m),
            f"{case}.codes": torch.from_numpy(codes),
            f"{case}.logits": torch.from_numpy(logits).float(),
            f"{case}.truths": torch.from_numpy(truths),
            f"{case}.harm": torch.from_numpy(harm),
            f"{case}.costs": torch.from_numpy(costs),
            f"{case}.pairs": torch.from_numpy(np.c_[rows, columns]),
        }
    path = Path(__file__).parent / "assignment.safetensors"
    save_file({name: value.contiguous() for name, value in found.items()}, path)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
