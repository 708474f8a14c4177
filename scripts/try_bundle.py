"""Runs the folder of `make bundle`, from generating to scoring, in another root without network.

The root is a bare Debian that debootstrap makes, once, unless ROOT is the root folder of some other Linux.
There the folder lies under a path with a blank, and runs with no variables but PATH and HOME.
Needs root, for chroot. Usage: try_bundle.py FOLDER ROOT
"""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

# All that docs/bundle.md tells a user to install.
PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri", "libegl-mesa0")
SUITE = "bookworm"
# What the folder must do without.
ABSENT = ("cargo", "rustc", "cc", "python", "python3")

PLACE = "/opt/a copy/harmzone"
WORK = "/tmp/bundle-test"
N_SAMPLES = 4
STEPS = {
    "doctor": ["doctor"],
    "gen": [
        *("gen", "--town", "downtown", "--samples", str(N_SAMPLES), "--episodes", "3", "--seed", "7"),
        *("--jobs", "2", "--set", "val_every=3", "--out", "data"),
    ],
    "label": ["label", "data"],
    "train": [
        *("train", "data", "--out", "run"),
        *("--set", "lidar_stage.epochs=1", "--set", "fused_stage.epochs=1"),
    ],
    "eval small": ["eval", "small", "--data", "data", "--out", "eval-small"],
    "eval of the run": ["eval", "run", "--data", "data", "--out", "eval-run"],
    "predict small": ["predict", "small", "--data", "data", "--out", "predictions"],
}


def main(folder: Path, root: Path) -> None:
    """Copies the folder into the root, runs all steps there and checks what they leave."""
    if os.geteuid() != 0:
        sys.exit("bundle-test: chroot needs root; call it with sudo")
    if not (folder / "harmzone").is_file():
        sys.exit(f"bundle-test: no `harmzone` in the folder; `make bundle` makes it: {folder}")
    if not (root / "bin" / "sh").exists():
        make_root(root)
    found = [name for name in ABSENT if inside(root, "sh", "-c", f"command -v {name}").returncode == 0]
    if found:
        sys.exit(f"bundle-test: this root has {', '.join(found)}, so that it shows nothing: {root}")
    place, work = root / PLACE[1:], root / WORK[1:]
    for path in (place, work):
        shutil.rmtree(path, ignore_errors=True)
    work.mkdir(parents=True)
    shutil.copytree(folder, place, symlinks=True)
    for step, arguments in STEPS.items():
        run_step(root, step, arguments)
    for line in check(work):
        print(line)
    shutil.rmtree(place.parent)
    shutil.rmtree(work)


def make_root(root: Path, packages: tuple[str, ...] = PACKAGES) -> None:
    """Makes a bare Debian with OpenGL or other packages; about 460 MB."""
    debootstrap = shutil.which("debootstrap")
    if debootstrap is None:
        sys.exit(
            "bundle-test: debootstrap is missing (apt-get install debootstrap), or name a root: ROOT=DIR"
        )
    print(f"making a bare Debian {SUITE}: {root}", flush=True)
    partial = root.with_name(root.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.parent.mkdir(parents=True, exist_ok=True)
    command = [debootstrap, "--variant=minbase", f"--include={','.join(packages)}", SUITE, str(partial)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"bundle-test: {' '.join(command)}:\n{done.stdout[-2000:]}{done.stderr}")
    partial.rename(root)


def inside(root: Path, *command: str) -> subprocess.CompletedProcess:
    """Runs a command in the root, with its own processes, mounts and no network."""
    isolated = [
        "unshare",
        "--mount",
        "--pid",
        "--fork",
        "--net",
        f"--mount-proc={root}/proc",
        "chroot",
        str(root),
    ]
    bare = ["/usr/bin/env", "-i", "PATH=/usr/bin:/bin", "HOME=/tmp"]
    return subprocess.run([*isolated, *bare, *command], capture_output=True, text=True)


def run_step(root: Path, step: str, arguments: list[str]) -> None:
    """Runs one harmzone command in the root's work folder and tells its time."""
    begin = time.monotonic()
    script = f'cd {WORK} && exec "{PLACE}/harmzone" "$@"'
    done = inside(root, "sh", "-c", script, "harmzone", *arguments)
    if done.returncode != 0:
        sys.exit(
            f"bundle-test: {step} ended with {done.returncode}: harmzone {' '.join(arguments)}\n"
            f"{done.stdout}{done.stderr}"
        )
    print(f"{time.monotonic() - begin:>8.1f} s  {step}", flush=True)
    if step == "doctor":
        print(done.stdout, end="", flush=True)


def check(work: Path) -> list[str]:
    """What the steps found, as lines; ends the test where a file is missing or a figure cannot be."""
    said = []
    for scores in ("eval-small", "eval-run"):
        metrics = json.loads((work / scores / "metrics.json").read_text())
        ap, n_samples = metrics["total"]["mean"], metrics["counts"]["n_samples"]
        if n_samples != N_SAMPLES or not 0 <= ap <= 1:
            sys.exit(
                f"bundle-test: {n_samples} samples scored where {N_SAMPLES} are, mAP {ap}: {work / scores}"
            )
        # The network inside the program was trained; one epoch of 8 samples need not find anything.
        if scores == "eval-small" and ap < 0.3:
            sys.exit(f"bundle-test: the network inside the program has mAP {ap}: {work / scores}")
        said.append(f"{scores}: mAP {ap:.3f} on {n_samples} samples")
    predictions = json.loads((work / "predictions" / "predictions.json").read_text())
    n_boxes = sum(len(boxes) for boxes in predictions["results"].values())
    if len(predictions["results"]) != N_SAMPLES or n_boxes == 0:
        sys.exit(
            f"bundle-test: {n_boxes} boxes in {len(predictions['results'])} samples: {work / 'predictions'}"
        )
    said.append(f"predictions: {n_boxes} boxes")
    return said


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
