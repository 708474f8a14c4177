"""Damages inputs in forty ways, runs the program on each, and tabulates what it says and what it leaves
behind.

Usage: damage.py HARMZONE --kitti DIR --av2 DIR --nuscenes DIR --bag DIR --episodes DIR [--only WORD] [--keep
DIR]

Verdicts: `told` the message names the fault (an error, or a sentence beside a result); `SILENT` nothing of it
is said; `VAGUE` it fails, but no expected word is said; `PANIC` it ends by a panic or a signal; `HALF` it
leaves a data set that is not whole. Exit code 1 unless all are told.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import damage_episodes
import damage_kitti_av2
import damage_nuscenes
import damage_ros2
from damage_case import CASES, Case, copy

MODULES = (damage_kitti_av2, damage_nuscenes, damage_ros2, damage_episodes)  # each registers its cases


def is_whole(out: Path) -> str:
    """What is wrong with what lies in OUT; empty if nothing, or a whole data set."""
    if not out.exists():
        return ""
    partial = [str(path.relative_to(out)) for path in out.rglob("*.partial")]
    if partial:
        return f"left {partial[0]}"
    manifest = out / "dataset.json"
    if not manifest.exists():
        episodes = list(out.rglob("*.mcap"))
        # Whole episodes without a manifest are what a later run goes on from.
        return "" if not episodes else f"(no dataset.json; {len(episodes)} whole episodes kept)"
    for entry in json.loads(manifest.read_text())["episodes"]:
        path = out / entry["file"]
        if not path.exists():
            return f"dataset.json names {entry['file']}, which is not there"
        if hashlib.sha256(path.read_bytes()).hexdigest() != entry["sha256"]:
            return f"the hash of {entry['file']} is another"
    return ""


def run_case(program: Path, one: Case, sources: dict[str, Path], folder: Path, extra: list[str]) -> list[str]:
    """Runs the program on a damaged copy; a row of the table."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    root, out = folder / "source", folder / "out"
    copy(sources[one.source], root)
    # Labels belong to the undamaged files, so they would be a fault of their own.
    shutil.rmtree(root / "labels", ignore_errors=True)
    one.damage(root)
    if one.source == "episodes":
        commands = [["doctor", str(root)]]
    else:
        commands = [["import", one.source, str(root), "--out", str(out), *extra]]
    said, code = "", 0
    for command in commands:
        done = subprocess.run([program, *command], capture_output=True, text=True, timeout=280, check=False)
        code = code or done.returncode
        said += done.stderr + done.stdout
        (folder / "said.txt").write_text(said)
    lines = [line.strip() for line in said.replace("\r", "\n").splitlines() if line.strip()]
    spoken = [line for line in lines if re.search(one.words, line.replace(str(folder), "").lower())]
    half = "" if one.source == "episodes" else is_whole(out)
    skipped = ""
    if one.skippable and not half:
        # The same again, told to go on: the rest must be there, and the exit code is 3.
        done = subprocess.run(
            [program, *commands[0], "--skip-bad"], capture_output=True, text=True, timeout=280, check=False
        )
        manifest = out / "dataset.json"
        n = len(json.loads(manifest.read_text())["episodes"]) if manifest.exists() else 0
        skipped = f"[--skip-bad: exit {done.returncode}, {n} episodes]"
        half = is_whole(out)
        if done.returncode != 3 or n == 0:
            skipped += " NOT AS IT SHOULD BE"
    if code < 0 or code == 101 or "panicked" in said:
        verdict = "PANIC"
    elif half and not half.startswith("("):
        verdict = "HALF"
    elif skipped.endswith("BE"):
        verdict = "NO SKIP"
    elif one.fails is False and code not in (0, 3):
        verdict = "REFUSED"
    elif not spoken:
        verdict = "SILENT" if code == 0 else "VAGUE"
    elif one.fails is True and code == 0:
        verdict = "WENT ON"
    else:
        verdict = "told"
    shown = spoken[-1] if spoken and one.words != "^" else (lines[-1] if lines else "")
    shown = shown.replace(str(folder), "")
    return [one.source, one.name, str(code), verdict, f"{half}{skipped}", shown[:230]]


def main() -> int:
    """Runs the cases whose sources are given."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    for source in ("kitti", "av2", "nuscenes", "bag", "episodes"):
        parser.add_argument(f"--{source}", type=Path)
    parser.add_argument("--only", default="", help="run the cases whose source and name hold this")
    parser.add_argument("--extra", default="", help="further flags for import, with spaces")
    parser.add_argument("--keep", type=Path, help="keep the damaged inputs and outputs here")
    options = parser.parse_args()
    sources = {
        "kitti": options.kitti,
        "av2": options.av2,
        "nuscenes": options.nuscenes,
        "ros2": options.bag,
        "episodes": options.episodes,
    }
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for idx, one in enumerate(CASES):
            if sources[one.source] is None or options.only not in f"{one.source} {one.name}":
                continue
            folder = (options.keep or Path(temporary)) / f"{idx:02d}"
            row = run_case(options.program.resolve(), one, sources, folder, options.extra.split())
            rows.append(row)
            print(
                f"{row[3]:<8} {row[2]:>4}  {row[0]:<9} {row[1]}\n               {row[4]} {row[5]}", flush=True
            )
            if options.keep is None:
                shutil.rmtree(folder)
    bad = [row for row in rows if row[3] != "told"]
    print(f"{len(rows)} cases, {len(rows) - len(bad)} told, {len(bad)} not")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
