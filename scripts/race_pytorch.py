"""Races `harmzone` against the same network in PyTorch: repetition by repetition, two threads each.

Weights, inputs and objects come from `xtask bench-model --dump`, and before the race outputs, losses
and the norm of the gradients must agree. Of the ways to run PyTorch (`VARIANTS`) the fastest is raced. Prints
medians, minima and their ratios as Markdown; `--json FILE` keeps all times.

    .venv-golden/bin/python scripts/race_pytorch.py target/release/xtask DATA --model small
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

N_THREADS = 2
os.environ["OMP_NUM_THREADS"] = str(N_THREADS)
sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "golden"))

import torch  # noqa: E402
from safetensors.torch import load_file  # noqa: E402
from small_config import Batch  # noqa: E402
from small_input import Prepared, stack  # noqa: E402
from small_loss import Objects, loss, picture_loss  # noqa: E402
from small_network import POOLS, ConvBlock, Detector, load  # noqa: E402
from torch import Tensor, nn  # noqa: E402

CONTESTS = {
    "lidar_step": "training step, LiDAR stage",
    "fused_step": "training step, fused stage",
    "inference": "inference, one prepared sample",
}
# As the program trains (`src/train/bench/mod.rs`, `configs/train.toml`).
LEARNING_RATE, WEIGHT_DECAY, CLIP_NORM, DECAY = 1e-5, 0.01, 10.0, 0.998
# Largest error over the largest value, of two programs in f32.
TOLERANCE = 1e-4
# Of losses, in which rare logarithms outweigh thousands of other terms.
LOSS_TOLERANCE = 5e-4
# Of gradients' norms, in training, where a ReLU here and there falls on the other side.
NORM_TOLERANCE = 3e-3
# Spinning threads of one side would slow the other down.
PAUSE_S = 0.03
N_TRIALS = 7


@dataclass(frozen=True)
class Variant:
    """A way to run the network."""

    channels_last: bool
    pool: str
    folded: bool = False

    def __str__(self) -> str:
        layout = "channels_last" if self.channels_last else "contiguous"
        return ", ".join([layout, f"lift by {self.pool}"] + ["norms folded"] * self.folded)


VARIANTS = [Variant(layout, pool) for layout in (False, True) for pool in POOLS]


def fold(detector: Detector) -> Detector:
    """Batch norms into the layers before them; for inference."""
    detector = copy.deepcopy(detector).eval()
    for module in detector.modules():
        if isinstance(module, ConvBlock):
            module.conv = nn.utils.fusion.fuse_conv_bn_eval(module.conv, module.norm)
            module.norm = nn.Identity()
    pillars = detector.lidar["Pillars"]
    pillars.point = nn.utils.fusion.fuse_linear_bn_eval(pillars.point, pillars.point_norm)
    if detector.config.paint_channels:
        norm = pillars.point_norm
        scale = norm.weight / (norm.running_var + norm.eps).sqrt()
        pillars.painted.weight = nn.Parameter(pillars.painted.weight * scale[:, None])
    pillars.point_norm = nn.Identity()
    return detector


def laid_out(detector: Detector, batch: Batch, variant: Variant) -> tuple[Detector, Batch]:
    """The network and its inputs as the variant wants them."""
    detector = fold(detector) if variant.folded else copy.deepcopy(detector)
    detector.camera["Cnn"].pool = variant.pool
    if not variant.channels_last:
        return detector, batch
    maps = {
        name: value.contiguous(memory_format=torch.channels_last)
        for name in ("image", "depth")
        if (value := getattr(batch, name)) is not None
    }
    return detector.to(memory_format=torch.channels_last), replace(batch, **maps)


class Training:
    """Everything that a step changes."""

    def __init__(self, detector: Detector, batch: Batch, objects: list[Objects]) -> None:
        self.detector, self.batch, self.objects = detector.train(), batch, objects
        self.optimizer = torch.optim.AdamW(
            detector.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY, fused=True
        )
        latest = [*detector.parameters(), *(b for b in detector.buffers() if b.is_floating_point())]
        self.latest = [value.detach() for value in latest]
        self.average = [value.clone() for value in self.latest]

    def step(self) -> None:
        """One step."""
        self.optimizer.zero_grad(set_to_none=True)
        output = self.detector(self.batch)
        parts = loss(output, self.objects, self.detector.head.fine_centers_m, self.detector.config)
        total = parts["total"]
        if "objects" in output:
            total = total + picture_loss(output["objects"], torch.zeros_like(output["objects"]))
        total.backward()
        nn.utils.clip_grad_norm_(self.detector.parameters(), CLIP_NORM, foreach=True)
        self.optimizer.step()
        torch._foreach_lerp_(self.average, self.latest, 1 - DECAY)


def in_ms(work: Callable[[], object]) -> float:
    """How long it takes."""
    begin = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - begin)


def fastest(name: str, of: dict[Variant, Callable[[], object]]) -> tuple[Variant, Callable[[], object]]:
    """The variant with the least time; they take turns."""
    times: dict[Variant, list[float]] = {variant: [] for variant in of}
    for trial in range(N_TRIALS + 2):
        for variant, work in of.items():
            spent = in_ms(work)
            if trial >= 2:
                times[variant].append(spent)
    best = min(times, key=lambda variant: min(times[variant]))
    for variant, ms in times.items():
        mark = "*" if variant == best else " "
        print(f"{mark} {name}: {min(ms):7.1f} ms  {variant}", file=sys.stderr)
    return best, of[best]


def read_batch(found: dict[str, Tensor], prefix: str, detector: Detector, with_camera: bool) -> Batch:
    """A batch of the dump."""
    samples = []
    while f"{prefix}.{len(samples)}.image" in found:
        part = {
            name: found[f"{prefix}.{len(samples)}.{name}"].numpy() for name in Prepared.__dataclass_fields__
        }
        rows = -(-part["image"].shape[1] // 8)
        samples.append(Prepared(**part | {"depth": part["depth"].reshape(rows, -1)}))
    numeric = found[f"{prefix}.numeric"].numpy()
    return stack(samples, numeric, detector.config, with_camera, torch.float32)


def read_objects(found: dict[str, Tensor]) -> list[Objects]:
    """What training asks for."""
    names = [name for name in found if name.startswith("training.") and name.endswith(".harm")]
    return [
        Objects(found[f"training.{i}.boxes"].numpy(), found[f"training.{i}.harm"].numpy())
        for i in range(len(names))
    ]


def check(what: str, found: Tensor, expected: Tensor, tolerance: float = TOLERANCE) -> None:
    """Stops where the two programs disagree."""
    error = ((found - expected).abs().max() / expected.abs().max()).item()
    if not error <= tolerance:
        sys.exit(f"{what}: off by {error:.1e} of the largest value; at most {tolerance:.0e}")


def check_output(what: str, of: dict[str, Tensor], found: dict[str, Tensor], prefix: str) -> None:
    """Heatmap, scores of the queries, and what is predicted at the program's own cells."""
    for name in ("heatmap", "boxes", "spread", "harm"):
        if name != "spread" or f"{prefix}.output.{name}" in found:
            check(f"{what}, {name}", of[name], found[f"{prefix}.output.{name}"])
    check(f"{what}, scores", of["scores"], found[f"{prefix}.output.scores"])


def check_equal(detector: Detector, found: dict[str, Tensor]) -> None:
    """Outputs, losses and gradients of both programs."""
    with torch.inference_mode():
        batch = read_batch(found, "inference", detector, True)
        plain = detector.eval()(batch, found["inference.output.cells"])
        check_output("inference", plain, found, "inference")
        for variant in (*VARIANTS, *(replace(variant, folded=True) for variant in VARIANTS)):
            other, of_variant = laid_out(detector, batch, variant)
            output = other.eval()(of_variant, found["inference.output.cells"])
            check_output(f"inference, {variant}", output, found, "inference")
    objects = read_objects(found)
    for stage, with_camera in (("lidar", False), ("fused", True)):
        training = copy.deepcopy(detector).train()
        batch = read_batch(found, "training", detector, with_camera)
        output = training(batch, found[f"{stage}.output.cells"])
        check_output(stage, output, found, stage)
        parts = loss(output, objects, training.head.fine_centers_m, training.config)
        for name in ("heatmap", "harm", "boxes"):
            check(
                f"{stage}, {name} loss", parts[name].detach(), found[f"{stage}.loss.{name}"], LOSS_TOLERANCE
            )
        parts["total"].backward()
        norm = nn.utils.get_total_norm([p.grad for p in training.parameters() if p.grad is not None])
        check(f"{stage}, gradients' norm", norm, found[f"{stage}.loss.norm"], NORM_TOLERANCE)


def contestants(detector: Detector, found: dict[str, Tensor]) -> dict[str, tuple[Variant, Callable]]:
    """PyTorch's fastest way of each contest."""
    chosen = {}
    objects = read_objects(found)
    for contest, with_camera in (("lidar_step", False), ("fused_step", True)):
        batch = read_batch(found, "training", detector, with_camera)
        # Without the camera there is no lift to choose.
        variants = [v for v in VARIANTS if with_camera or v.pool == "bags"]
        ways = {variant: Training(*laid_out(detector, batch, variant), objects).step for variant in variants}
        chosen[contest] = fastest(contest, ways)
    batch = read_batch(found, "inference", detector, True)

    def inference(variant: Variant) -> Callable[[], object]:
        network, of_variant = laid_out(detector, batch, variant)
        network.eval()

        def infer() -> object:
            with torch.inference_mode():
                return network(of_variant)

        return infer

    variants = [replace(variant, folded=folded) for variant in VARIANTS for folded in (False, True)]
    chosen["inference"] = fastest("inference", {variant: inference(variant) for variant in variants})
    return chosen


class Program:
    """The other side: `xtask bench-model --lockstep`."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def once(self, contest: str) -> float:
        """Milliseconds of one repetition."""
        print(json.dumps(contest), file=self.process.stdin, flush=True)
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"the program ended with {self.process.wait()}")
        return json.loads(line)["ms"]

    def close(self) -> None:
        """Lets it end."""
        self.process.stdin.close()
        self.process.wait()


def race(program: Program, contest: str, work: Callable[[], object], n: int) -> dict[str, list[float]]:
    """Turn by turn; the first repetitions of both do not count."""
    times: dict[str, list[float]] = {"harmzone": [], "pytorch": []}
    for repetition in range(-3, n):
        ours = program.once(contest)
        time.sleep(PAUSE_S)
        theirs = in_ms(work)
        time.sleep(PAUSE_S)
        if repetition >= 0:
            times["harmzone"].append(ours)
            times["pytorch"].append(theirs)
    return times


def main() -> None:
    """Dumps, checks, chooses, races, prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", help="the xtask program (cargo build --release -p xtask)")
    parser.add_argument("data", help="labelled dataset")
    parser.add_argument("--model", default="small", help="run folder or checkpoint, or `small`")
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--json", type=Path, help="file for all times")
    parser.add_argument(
        "rest", nargs="*", help="after --: more flags of bench-model, such as --set accumulate=2"
    )
    args = parser.parse_args()
    torch.set_num_threads(N_THREADS)
    environment = os.environ | {"RAYON_NUM_THREADS": str(N_THREADS)}
    # The twin knows no objects that are to be ignored.
    command = [args.program, "bench-model", "--data", args.data, "--model", args.model]
    command += ["--set", "loss.unhit=background", *args.rest]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*command, "--dump", folder], check=True, env=environment, stdout=subprocess.DEVNULL)
        detector = load(Path(folder) / "model.safetensors")
        found = load_file(Path(folder) / "race.safetensors")
    check_equal(detector, found)
    chosen = contestants(detector, found)
    program = Program([*command, "--lockstep"], environment)
    results = {
        contest: {"variant": str(variant)} | race(program, contest, work, args.repetitions)
        for contest, (variant, work) in chosen.items()
    }
    program.close()

    print(f"{N_THREADS} threads each, {args.repetitions} repetitions in turn, PyTorch {torch.__version__}\n")
    print("| | harmzone, ms: median (least) | PyTorch, ms: median (least) | ratio of medians (of leasts) |")
    print("|---|---|---|---|")
    for contest, of in results.items():
        (ours, our_least), (theirs, their_least) = (
            (statistics.median(of[side]), min(of[side])) for side in ("harmzone", "pytorch")
        )
        of |= {"ratio_of_medians": ours / theirs, "ratio_of_leasts": our_least / their_least}
        print(
            f"| {CONTESTS[contest]} | {ours:.1f} ({our_least:.1f}) | {theirs:.1f} ({their_least:.1f}) "
            f"| {ours / theirs:.2f} ({our_least / their_least:.2f}) |"
        )
    print()
    for contest, of in results.items():
        print(f"PyTorch's fastest, {CONTESTS[contest]}: {of['variant']}")
    if args.json:
        args.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
