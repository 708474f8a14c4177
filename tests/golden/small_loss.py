"""The training loss of the `small` detector, the twin of `src/train/losses.rs`: targets, assignment, losses.

The losses themselves are those of `torch_losses.py`; boxes are (x, y, z, length, width, height, yaw), and
with the velocity (x, y) nine numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from small_config import Config
from small_network import CODE_SIZE
from torch import Tensor
from torch.nn import functional
from torch_losses import CODE_WEIGHTS, box_l1, gaussian_focal, sigmoid_focal

WEIGHTS = {"heatmap": 1.0, "harm": 1.0, "boxes": 0.25}
COSTS = {"harm": 0.15, "center": 0.25, "iou": 0.25}
MIN_RADIUS, OVERLAP, MAX_LOG_SIZE = 2, 0.1, 3.0
Array = np.ndarray


@dataclass
class Objects:
    """The objects of one sample."""

    boxes: Array  # [object, 9]
    harm: Array  # [state, object]: 0 harmful, 1 harmless


def gaussian_radius(length: float, width: float) -> int:
    """CornerNet's radius, in cells."""
    total, area = length + width, length * width

    def root(a: float, b: float, c: float) -> float:
        return (b + np.sqrt(max(b * b - 4 * a * c, 0.0))) / 2

    radii = (
        root(1.0, total, area * (1 - OVERLAP) / (1 + OVERLAP)),
        root(4.0, 2 * total, (1 - OVERLAP) * area),
        root(4 * OVERLAP, -2 * OVERLAP * total, (OVERLAP - 1) * area),
    )
    return max(int(min(radii)), MIN_RADIUS)


def draw_heatmap(boxes: Array, config: Config) -> Array:
    """[1, scale * y, scale * x]."""
    n_y, n_x = (config.heatmap_scale * n for n in config.cells)
    size_m = config.cell_size_m / config.heatmap_scale
    heat = np.zeros((1, n_y, n_x), np.float32)
    for x_m, y_m, _, length_m, width_m, *_ in boxes:
        x, y = int((x_m - config.x_min_m) / size_m), int((y_m - config.y_min_m) / size_m)
        r = gaussian_radius(length_m / size_m, width_m / size_m)
        sigma = (2 * r + 1) / 6
        ys, xs = np.arange(max(y - r, 0), min(y + r + 1, n_y)), np.arange(max(x - r, 0), min(x + r + 1, n_x))
        bell = np.exp(-((ys[:, None] - y) ** 2 + (xs - x) ** 2) / (2 * sigma**2)).astype(np.float32)
        part = heat[0, ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        np.maximum(part, bell, out=part)
    return heat


def encode(boxes: Array, query_m: Array, cell_size_m: float) -> Array:
    """[object, 10]; query_m [object, 2]."""
    place = (boxes[:, :2] - query_m) / cell_size_m
    yaw = boxes[:, 6:7]
    return np.concatenate(
        [place, boxes[:, 2:3], np.log(boxes[:, 3:6]), np.sin(yaw), np.cos(yaw), boxes[:, 7:9]], 1
    )


def decode(codes: Array, query_m: Array, cell_size_m: float) -> Array:
    """[.., 7] from [.., 10]."""
    size = np.exp(codes[..., 3:6].clip(-MAX_LOG_SIZE, MAX_LOG_SIZE))
    yaw = np.arctan2(codes[..., 6:7], codes[..., 7:8])
    return np.concatenate([query_m + codes[..., :2] * cell_size_m, codes[..., 2:3], size, yaw], -1)


def corners(boxes: Array) -> Array:
    """[box, 4, 2], counter-clockwise."""
    half = boxes[:, None, 3:5] / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    s, c = np.sin(boxes[:, 6])[:, None], np.cos(boxes[:, 6])[:, None]
    turned = np.stack([c * half[..., 0] - s * half[..., 1], s * half[..., 0] + c * half[..., 1]], -1)
    return turned + boxes[:, None, :2]


def overlap_area(a: Array, b: Array) -> Array:
    """Shared ground of pairs of footprints, [pair]: the hull of corners inside the other and of crossings."""
    p, q = corners(a), corners(b)

    def inside(points: Array, of: Array) -> Array:
        edge, to = np.roll(of, -1, 1) - of, points[:, :, None] - of[:, None]
        return (edge[:, None, :, 0] * to[..., 1] - edge[:, None, :, 1] * to[..., 0] >= -1e-9).all(2)

    along, across = np.roll(p, -1, 1) - p, np.roll(q, -1, 1) - q
    d, e, gap = along[:, :, None], across[:, None], q[:, None] - p[:, :, None]
    cross = d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0]
    is_parallel = np.abs(cross) < 1e-12
    safe = np.where(is_parallel, 1.0, cross)
    t = (gap[..., 0] * e[..., 1] - gap[..., 1] * e[..., 0]) / safe
    s = (gap[..., 0] * d[..., 1] - gap[..., 1] * d[..., 0]) / safe
    meets = ~is_parallel & (t >= 0) & (t <= 1) & (s >= 0) & (s <= 1)
    crossing = (p[:, :, None] + t[..., None] * d).reshape(len(a), 16, 2)
    points = np.concatenate([p, q, crossing], 1)
    kept = np.concatenate([inside(p, q), inside(q, p), meets.reshape(len(a), 16)], 1)
    n = kept.sum(1)
    middle = (points * kept[..., None]).sum(1) / np.maximum(n, 1)[:, None]
    points = points - middle[:, None]
    angle = np.where(kept, np.arctan2(points[..., 1], points[..., 0]), np.inf)
    order = np.argsort(angle, 1)
    points = np.take_along_axis(points, order[..., None], 1)
    # Points that do not count repeat the first, which adds no area.
    points = np.where(np.arange(24)[None, :, None] < n[:, None, None], points, points[:, :1])
    following = np.roll(points, -1, 1)
    area = (points[..., 0] * following[..., 1] - points[..., 1] * following[..., 0]).sum(1) / 2
    return np.where(n >= 3, area, 0.0)


def iou_3d(guesses: Array, truths: Array) -> Array:
    """[.., query, object] of guesses [.., query, 7] and truths [object, 7]."""
    a, b = guesses[..., :, None, :], truths[:, :]
    a, b = np.broadcast_arrays(a, b)
    gap = np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])
    reach = (np.hypot(a[..., 3], a[..., 4]) + np.hypot(b[..., 3], b[..., 4])) / 2
    near = gap <= reach
    iou = np.zeros(near.shape)
    a, b = a[near], b[near]
    if len(a):
        top = np.minimum(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
        bottom = np.maximum(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
        shared = overlap_area(a, b) * np.maximum(top - bottom, 0)
        iou[near] = shared / (a[:, 3:6].prod(1) + b[:, 3:6].prod(1) - shared)
    return iou


def focal_cost(logits: Array) -> Array:
    """Gamma 2, alpha 0.25."""
    p = 1 / (1 + np.exp(-logits))
    return -np.log(p + 1e-12) * 0.25 * (1 - p) ** 2 + np.log(1 - p + 1e-12) * 0.75 * p**2


def loss(
    output: dict[str, Tensor], objects: list[Objects], fine_centers_m: Tensor, config: Config
) -> dict[str, Tensor]:
    """The weighted parts and their total; fine_centers_m: [heatmap cell, 2]."""
    n_batch, n_rows, n_queries = len(objects), *output["boxes"].shape[:2]
    n_states = n_rows // n_batch
    dtype = output["boxes"].dtype
    target = np.stack([draw_heatmap(of.boxes, config) for of in objects])
    heatmap = gaussian_focal(output["heatmap"], torch.from_numpy(target).to(dtype))

    codes = output["boxes"].detach().double().numpy().reshape(n_batch, n_states, n_queries, CODE_SIZE)
    logits = output["harm"].detach().double().numpy().reshape(n_batch, n_states, n_queries, 2)
    queries_m = fine_centers_m[output["cells"]].double().numpy()
    size = np.array([config.x_max_m - config.x_min_m, config.y_max_m - config.y_min_m])
    harm_target = np.zeros((n_batch, n_states, n_queries, 2), np.float32)
    code_target = np.zeros((n_batch, n_states, n_queries, CODE_SIZE), np.float32)
    matched = np.zeros((n_batch, n_states, n_queries), np.float32)
    for i, of in enumerate(objects):
        if not len(of.boxes):
            continue
        guesses = decode(codes[i], queries_m[i], config.cell_size_m)
        away = np.abs(guesses[:, :, None, :2] - of.boxes[:, :2]) / size
        shared = COSTS["center"] * away.sum(-1) - COSTS["iou"] * iou_3d(guesses, of.boxes[:, :7])
        of_class = focal_cost(logits[i])
        for state, harm in enumerate(of.harm):
            q, o = linear_sum_assignment(shared[state] + COSTS["harm"] * of_class[state][:, harm])
            harm_target[i, state, q, harm[o]] = 1
            code_target[i, state, q] = encode(of.boxes[o], queries_m[i, q], config.cell_size_m)
            matched[i, state, q] = 1

    def rows(x: Array) -> Tensor:
        return torch.from_numpy(x.reshape(n_rows, n_queries, *x.shape[3:])).to(dtype)

    boxes = box_l1(output["boxes"], rows(code_target), rows(matched))
    if "spread" in output:
        off = (output["boxes"].detach() - rows(code_target)).abs()
        boxes = boxes + spread_loss(off, output["spread"], rows(matched))
    parts = {
        "heatmap": WEIGHTS["heatmap"] * heatmap,
        "harm": WEIGHTS["harm"] * sigmoid_focal(output["harm"], rows(harm_target), int(matched.sum())),
        "boxes": WEIGHTS["boxes"] * boxes,
    }
    return parts | {"total": sum(parts.values())}


def spread_loss(off: Tensor, log_spread: Tensor, is_matched: Tensor) -> Tensor:
    """Laplace's negative log-likelihood of the distances, less a constant, over the matched queries."""
    each = (off * torch.exp(-log_spread) + log_spread) * CODE_WEIGHTS * is_matched[..., None]
    return each.sum() / max(int(is_matched.sum()), 1)


def picture_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Whether each pixel shows an object: mean binary cross entropy; both [batch, 1, y, x]."""
    return functional.binary_cross_entropy_with_logits(logits, target)
