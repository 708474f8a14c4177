"""Installs the wheel in another root without Rust and network, and goes from generating to scoring there.

The root is a bare Debian with Python and Mesa's EGL that debootstrap makes, once. The command's bytes are
compared with those of the program outside, and the README's Python session runs as it is. Needs root, for
chroot. Usage: try_wheel_root.py WHEELS PROGRAM ROOT
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import try_bundle

# All that docs/python.md tells a user to have.
PACKAGES = (*try_bundle.PACKAGES, "python3", "python3-venv")
# What the wheel must do without.
ABSENT = ("cargo", "rustc", "cc")
WORK = "/tmp/wheel-test"
WORLD = ["--preset", "demo", "--town", "oldtown,suburb", "--episodes", "4", "--samples", "4", "--seed", "5"]
MADE = [["gen", "--out", "data", *WORLD, "--set", "val_every=2"], ["label", "data"]]
STEPS = {
    "pip install": [
        *("python3", "-m", "venv", "venv"),
        *("&&", "venv/bin/pip", "install", "--quiet", "--no-index", "--find-links", "wheels", "harmzone"),
    ],
    "pip check": ["venv/bin/pip", "check"],
    "doctor": ["venv/bin/harmzone", "doctor"],
    "gen": ["venv/bin/harmzone", *MADE[0]],
    "label": ["venv/bin/harmzone", *MADE[1]],
    "train": [
        *("venv/bin/harmzone", "train", "data", "--out", "run"),
        *("--set", "lidar_stage.epochs=1", "--set", "fused_stage.epochs=1"),
    ],
    "eval": ["venv/bin/harmzone", "eval", "run", "--data", "data", "--out", "scores"],
    "the README's Python": [
        "mkdir",
        "session",
        "&&",
        "cd",
        "session",
        "&&",
        "../venv/bin/python",
        "../session.py",
    ],
}


def main(wheels: Path, program: Path, root: Path) -> None:
    """Prints each step's time, and whether the bytes are the program's."""
    if os.geteuid() != 0:
        sys.exit("wheel-root-test: chroot needs root; call it with sudo")
    [wheel] = wheels.glob("harmzone-*.whl")
    if not (root / "bin" / "sh").exists():
        try_bundle.make_root(root, PACKAGES)
    found = [
        name for name in ABSENT if try_bundle.inside(root, "sh", "-c", f"command -v {name}").returncode == 0
    ]
    if found:
        sys.exit(f"wheel-root-test: this root has {', '.join(found)}, so that it shows nothing: {root}")
    work = root / WORK[1:]
    shutil.rmtree(work, ignore_errors=True)
    (work / "wheels").mkdir(parents=True)
    # What pip would fetch, for the Python in the root.
    version = try_bundle.inside(
        root, "python3", "-c", "import sys; print('%d.%d' % sys.version_info[:2])"
    ).stdout
    fetch = [
        *(sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"),
        *("--only-binary=:all:", "--python-version", version.strip(), "--dest", str(work / "wheels")),
        str(wheel),
    ]
    subprocess.run(fetch, check=True)
    readme = Path(__file__).parents[1].joinpath("README.md").read_text(encoding="utf-8")
    (work / "session.py").write_text(readme.split("```python\n", 1)[1].split("```", 1)[0])
    for step, words in STEPS.items():
        run_step(root, step, words)
    with tempfile.TemporaryDirectory() as folder:
        for words in MADE:
            subprocess.run([program, *words], cwd=folder, check=True, capture_output=True)
        mine, theirs = hashes(Path(folder) / "data"), hashes(work / "data")
    if mine != theirs or len(mine) < 8:
        sys.exit("wheel-root-test: the bytes are not those of the program outside")
    print(f"{len(mine)} files have the hashes of the program's")
    shutil.rmtree(work)


def run_step(root: Path, step: str, words: list[str]) -> None:
    """Runs one step in the root's work folder and tells its time."""
    begin = time.monotonic()
    script = f"cd {WORK} && {' '.join(words)}"
    done = try_bundle.inside(root, "sh", "-c", script)
    if done.returncode != 0:
        sys.exit(
            f"wheel-root-test: {step} ended with {done.returncode}: {script}\n{done.stdout}{done.stderr}"
        )
    print(f"{time.monotonic() - begin:>8.1f} s  {step}", flush=True)
    if step == "pip check":
        print(f"            {done.stdout.strip()}", flush=True)


def hashes(folder: Path) -> dict[str, str]:
    """Of every file below a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*(Path(word).resolve() for word in sys.argv[1:]))
