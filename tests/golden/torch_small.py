"""The whole `small` detector in PyTorch: values in training and at inference, and gradients of the loss.

Writes `small.safetensors` beside itself. Weights and inputs are numbers that `formula.py` makes from their
names, as `src/train/twin_tests.rs` makes them: points, a picture, speeds, objects. Computed in f64.

Case `whole` is the profile as it ships: values. Case `coarse` is a narrower network on a coarse map with a
little picture: values and gradients. A gradient jumps where an activation crosses the kink of its ReLU. Of
the whole's millions of activations some always lie within the rounding of f32; the coarse one's inputs are
chosen (`seed`) so that none does.

    .venv-golden/bin/python tests/golden/torch_small.py
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import formula
import numpy as np
import small_input
import torch
import torch_assignment
from safetensors.torch import save_file
from small_config import Config
from small_loss import Objects, iou_3d, loss, picture_loss
from small_network import Detector, Head
from torch import Tensor
from torch.nn import functional

HERE = Path(__file__).parent
SMALL = Config.parse((HERE / "../../configs/model/small.toml").read_text())
N_SAMPLES, N_STATES, N_CROWDED, N_OBJECTS = 2, 2, 600, 5
LIDAR_M, CAMERA_M, PITCH_RAD = np.array([0.9, 0.0, 1.8]), np.array([1.7, 0.2, 1.5]), 0.02
# The heatmap starts at a prior of 0.1, as in training.
HEATMAP_BIAS = -2.2
OUTPUTS = ("heatmap", "cells", "scores", "boxes", "spread", "harm")
# Values kept of each gradient, evenly over the tensor.
N_KEPT = 48
# Norms whose running statistics are kept.
WATCHED = ("lidar.Pillars.point_norm", "camera.Cnn.smooth.norm", "fuser.norm", "head.heatmap_hidden.norm")
# What rounding in f32 may move an activation by, of case `coarse`.
MARGIN = 3e-6
# And a score, so that the same cells become queries.
GAP = 5e-6
# And an output, relative to it, so that the same queries go to the same objects.
ROUNDING = 4e-5
N_TRIALS = 16


@dataclasses.dataclass(frozen=True)
class Case:
    """A config and its inputs."""

    name: str
    config: Config
    height_px: int
    n_points: int
    seed: int = 0
    with_gradients: bool = False


CASES = (
    Case("whole", SMALL, 225, 8000, seed=5),
    Case(
        "coarse",
        dataclasses.replace(
            SMALL,
            cell_size_m=6.4,
            image_width_px=64,
            n_queries=20,
            channels=64,
            fuser_channels=64,
            pillar_channels=32,
            bev_channels=(64, 96),
        ),
        36,
        1200,
        seed=464,
        with_gradients=True,
    ),
)


def numbers(name: str, *shape: int) -> np.ndarray:
    """In [-1, 1)."""
    return formula.uniform(name, math.prod(shape)).reshape(shape)


def points(case: Case, sample: int) -> np.ndarray:
    """[point, 4] in the ego frame; some stand so close that pillars overflow."""
    spread = numbers(f"points{sample}.{case.seed}", case.n_points, 4)
    scale = np.tile([26.0, 33.0, 2.6, 127.5], (case.n_points, 1))
    middle = np.tile([25.0, 0.0, -0.6, 127.5], (case.n_points, 1))
    scale[:N_CROWDED, :2], middle[:N_CROWDED, :2] = 1.2, [12.0, 3.0]
    in_lidar = (middle + scale * spread).astype(np.float32).astype(float)
    in_lidar[:, :3] += LIDAR_M
    return in_lidar


def picture(case: Case, sample: int) -> np.ndarray:
    """[3, y, x], 8 bit."""
    shape = (case.height_px, case.config.image_width_px, 3)
    values = np.floor((numbers(f"picture{sample}.{case.seed}", *shape) + 1) * 128)
    return values.astype(np.uint8).transpose(2, 0, 1)


def camera(case: Case) -> small_input.Camera:
    """70 degrees wide; looks along x, turned down a little."""
    width_px, height_px = case.config.image_width_px, case.height_px
    focal = width_px / 2 / math.tan(math.radians(70) / 2)
    s, c = math.sin(PITCH_RAD), math.cos(PITCH_RAD)
    down = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    axes = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    center = (width_px / 2, height_px / 2)
    return small_input.Camera(width_px, height_px, (focal, focal), center, down @ axes, CAMERA_M)


def states() -> np.ndarray:
    """[batch * state, 2]: speed over 10 m/s, steering over 0.35 rad."""
    speed_and_angle = numbers("states", N_SAMPLES * N_STATES, 2) * [9.0, 0.3] + [9.0, 0.0]
    return speed_and_angle / [10.0, 0.35]


def objects(sample: int) -> Objects:
    """Some objects on the map, harmful or not anew for each state."""
    scale = np.array([20.0, 20.0, 0.3, 1.6, 0.6, 0.4, 3.0, 5.0, 5.0])
    boxes = numbers(f"objects{sample}", N_OBJECTS, 9) * scale + [26, 0, 0.8, 2.6, 1.4, 1.2, 0, 0, 0]
    harm = numbers(f"harm{sample}", N_STATES, N_OBJECTS) >= 0
    return Objects(boxes, harm.astype(int))


def shown(logits: Tensor) -> Tensor:
    """Which pixels are to show an object, [batch, 1, y, x]."""
    return torch.from_numpy(numbers("shown", *logits.shape) >= 0.5).to(logits.dtype)


class Kinks:
    """Inside `with`, records how near activations come to the kink of a ReLU, relative to the largest."""

    def __enter__(self) -> Kinks:
        self.relu, self.nearest = functional.relu, math.inf
        functional.relu = self.watch
        return self

    def watch(self, x: Tensor, inplace: bool = False) -> Tensor:
        magnitude = x.detach().abs()
        self.nearest = min(self.nearest, (magnitude.min() / magnitude.max()).item())
        return self.relu(x, inplace)

    def __exit__(self, *_: object) -> None:
        functional.relu = self.relu


def network(case: Case) -> Detector:
    """With the formula's weights, in f64."""
    detector = Detector(case.config)
    formula.fill(detector)
    with torch.no_grad():
        detector.head.heatmap_out.bias.fill_(HEATMAP_BIAS)
    return detector.double()


def train(case: Case, detector: Detector, samples: list, with_camera: bool) -> tuple[dict, dict, float]:
    """Output, losses and the nearest kink of a pass in training; leaves gradients."""
    batch = small_input.stack(samples, states(), case.config, with_camera, torch.float64)
    detector.train()
    detector.zero_grad()
    with Kinks() as kinks:
        output = detector(batch)
    parts = loss(output, [objects(i) for i in range(N_SAMPLES)], detector.head.fine_centers_m, case.config)
    if with_camera:
        parts["picture"] = picture_loss(output["objects"], shown(output["objects"]))
        parts["total"] = parts["total"] + parts["picture"]
    parts["total"].backward()
    return output, parts, kinks.nearest


def is_assignment_clear(case: Case, output: dict, parts: dict) -> bool:
    """Whether the losses change no more than the outputs do, at some disturbances by rounding."""

    def noise(name: str, like: Tensor) -> Tensor:
        return torch.from_numpy(numbers(name, *like.shape))

    centers_m = case.config.centers_m(case.config.heatmap_scale)
    for trial in range(N_TRIALS):
        disturbed = {
            name: output[name].detach() * (1 + ROUNDING * noise(f"rounding{trial}{name}", output[name]))
            for name in ("heatmap", "boxes", "harm")
        }
        of = [objects(i) for i in range(N_SAMPLES)]
        found = loss(output | disturbed, of, centers_m, case.config)
        if any(abs(found[name] / parts[name] - 1) > ROUNDING for name in ("harm", "boxes")):
            return False
    return True


def prepare(case: Case) -> list[small_input.Prepared]:
    """The samples."""
    view = camera(case)
    return [
        small_input.prepare(points(case, i), picture(case, i), view, case.config) for i in range(N_SAMPLES)
    ]


def last_gap(head: Head, heatmap: Tensor) -> float:
    """Gap between the scores of the last query and of the next best cell; inf where no peak is left."""
    head.n_queries += 1
    _, scores = head.pick(heatmap)
    head.n_queries -= 1
    gap = scores[:, -2] - scores[:, -1]
    return gap.where(scores[:, -2] > 0, math.inf).min().item()


def kept(values: Tensor) -> Tensor:
    """At most N_KEPT values, evenly spaced."""
    flat = values.reshape(-1)
    return flat[:: -(-len(flat) // N_KEPT)]


def results(case: Case) -> dict[str, Tensor]:
    """The numbers that the program must reproduce, of the LiDAR stage and then of the fused one.

    Inference is of the whole alone: burn takes the plain variance into its running statistics, PyTorch
    n / (n - 1) of it, which shows where a map has few cells.
    """
    samples, detector, found, gaps = prepare(case), network(case), {}, []
    for stage, with_camera in (("lidar", False), ("fused", True)):
        output, parts, nearest = train(case, detector, samples, with_camera)
        found |= {f"{stage}.train.{name}": output[name] for name in OUTPUTS}
        found |= {f"{stage}.loss.{name}": value for name, value in parts.items()}
        print(case.name, stage, {name: round(value.item(), 4) for name, value in parts.items()})
        gaps.append(last_gap(detector.head, output["heatmap"]))
        assert is_assignment_clear(case, output, parts), "choose another seed"
        print(f"  nearest kink {nearest:.1e}, gap behind the last query {gaps[-1]:.1e}")
        if case.with_gradients:
            assert nearest > MARGIN, "choose another seed"
            of = {name: p.grad for name, p in detector.named_parameters() if p.grad is not None}
            found |= {f"{stage}.gradient.{name}": kept(gradient) for name, gradient in of.items()}
            found |= {f"{stage}.largest.{name}": gradient.abs().max() for name, gradient in of.items()}
    assert min(gaps) > GAP, "choose another seed"
    if case.with_gradients:
        return {f"{case.name}.{name}": value for name, value in found.items()}
    detector.eval()
    with torch.inference_mode():
        output = detector(small_input.stack(samples, states(), case.config, True, torch.float64))
    gaps.append(last_gap(detector.head, output["heatmap"]))
    assert min(gaps) > GAP, "choose another seed"
    found |= {f"eval.{name}": output[name] for name in OUTPUTS}
    for name in WATCHED:
        for kind in ("running_mean", "running_var"):
            found[f"{name}.{kind}"] = detector.get_submodule(name).get_buffer(kind)
    print("  pillars", [len(s.pillars) for s in samples], "points", [len(s.point_features) for s in samples])
    print("  frustum points", [len(s.frustum_cells) for s in samples], end=", ")
    print("features with a depth", [int((s.depth > 0).sum()) for s in samples])
    return {f"{case.name}.{name}": value for name, value in found.items()}


def check_overlap() -> None:
    """The overlap of boxes here against that of `torch_assignment.py`, which is another method."""
    rng = np.random.default_rng(50)
    truths = torch_assignment.random_boxes(rng, 12)
    guesses = truths + rng.normal(0, [0.6, 0.6, 0.2, 0.1, 0.1, 0.05, 0.5], (12, 7))
    guesses[:, 3:6] = np.maximum(guesses[:, 3:6], 0.2)
    expected = np.array([[torch_assignment.iou_3d(a, b) for b in truths] for a in guesses])
    assert (expected > 0.05).sum() >= 8, "boxes that meet"
    assert np.abs(iou_3d(guesses, truths) - expected).max() < 1e-9


def main() -> None:
    """Writes the file."""
    check_overlap()
    found = {name: value.detach() for case in CASES for name, value in results(case).items()}
    found |= {f"{case.name}.seed": torch.tensor([float(case.seed)]) for case in CASES}
    path = HERE / "small.safetensors"
    saved = {name: value.float() if value.is_floating_point() else value for name, value in found.items()}
    save_file({name: value.clone().contiguous() for name, value in saved.items()}, path)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
