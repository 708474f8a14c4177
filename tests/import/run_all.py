"""Runs every check of the importers and exporters, and prints one line each: what `make check-logs` calls.

Usage: run_all.py HARMZONE [--samples ../shared/samples] [--work DIR] [--mmdet3d PYTHON] [--only WORD]

Each check's whole output lies in WORK/<check>.txt. Without the samples of KITTI and Argoverse 2, whose
licences keep them out of this repository, their checks are skipped, and that is said.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
SAVE_AS = ">"  # before the last word of a step: the file for its standard output
# Of the made drives (made_world.py); a bag does not say it.
WHEELBASE = ("--set", "vehicle.wheelbase_m=2.588")


class Runner:
    """Runs commands one after the other, and keeps what they say."""

    def __init__(self, program: Path, work: Path, only: str) -> None:
        self.program, self.work, self.only = program, work, only
        self.verdicts: list[tuple[str, str]] = []

    def run(self, name: str, *steps: list[object], makes: tuple[Path, ...] = ()) -> bool:
        """Runs the steps until one fails; one line for all of them. What they make is removed before."""
        if self.only not in name:
            return False
        for path in makes:
            shutil.rmtree(path, ignore_errors=True)
            path.unlink(missing_ok=True)
        start, said, good = time.monotonic(), "", True
        for step in steps:
            command = [str(word) for word in step]
            save_as = command.pop() if command[-2:-1] == [SAVE_AS] else None
            if save_as:
                command.pop()
            done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=HERE)
            said += f"$ {' '.join(command)}\n{done.stdout}{done.stderr}\n"
            if save_as:
                Path(save_as).write_text(done.stdout)
            # 3: done, with losses that were told.
            good = done.returncode in (0, 3) if step[0] == self.program else done.returncode == 0
            if not good:
                break
        (self.work / f"{name}.txt").write_text(said)
        self.verdicts.append((name, "ok" if good else "FAILS"))
        print(f"{'ok' if good else 'FAILS':<7} {time.monotonic() - start:6.1f} s  {name}", flush=True)
        return good

    def skip(self, name: str, why: str) -> None:
        """Says that a check is not run."""
        if self.only in name:
            self.verdicts.append((name, "skipped"))
            print(f"skipped: {name}: {why}", flush=True)

    def harmzone(self, *words: object) -> list[object]:
        """A command of the program."""
        return [self.program, *words]

    def script(self, name: str, *words: object) -> list[object]:
        """A script of this folder."""
        return [sys.executable, HERE / name, *words]


def check_samples(runner: Runner, samples: Path) -> None:
    """KITTI's and Argoverse's own frames."""
    if not samples.is_dir():
        runner.skip("kitti", f"no samples in {samples}")
        runner.skip("av2", f"no samples in {samples}")
        return
    work = runner.work
    for name in ("kitti", "av2"):
        out = work / f"{name}_episodes"
        runner.run(
            name,
            runner.harmzone("import", name, samples / name, "--out", out),
            runner.script(f"check_{name}.py", samples / name, out),
            runner.harmzone("doctor", out),
            runner.harmzone("label", out),
            makes=(out,),
        )


def check_made_av2(runner: Runner) -> None:
    """An Argoverse log with pictures and calibration."""
    source, out = runner.work / "made_av2", runner.work / "made_av2_episodes"
    runner.run(
        "av2 made",
        runner.script("make_av2.py", source),
        runner.harmzone("import", "av2", source, "--out", out),
        runner.script("check_av2.py", source, out),
        makes=(source, out),
    )


def check_raw_drive(runner: Runner, samples: Path) -> None:
    """KITTI's raw layout: stamps, oxts poses, points moved to one time."""
    if not samples.is_dir():
        runner.skip("kitti raw", f"no samples in {samples}")
        return
    raw, out = runner.work / "raw_drive", runner.work / "raw_drive_episodes"
    training = samples / "kitti/training"
    runner.run(
        "kitti raw",
        runner.script("make_kitti_raw.py", training, raw),
        runner.harmzone("import", "kitti", raw, "--out", out, "--set", "compensate_motion=true"),
        runner.script("check_ros2.py", raw / "truth.npz", out, "--training", training),
        makes=(raw, out),
    )
    sequence, out = runner.work / "tracking", runner.work / "tracking_episodes"
    runner.run(
        "kitti tracking",
        runner.script("make_kitti_tracking.py", training, raw, sequence),
        runner.harmzone("import", "kitti", sequence, "--out", out),
        runner.script("check_kitti.py", samples / "kitti", out, "--some"),
        makes=(sequence, out),
    )


def check_nuscenes_import(runner: Runner) -> None:
    """A made folder in nuScenes' conventions."""
    source, out = runner.work / "made_nuscenes", runner.work / "made_nuscenes_episodes"
    runner.run(
        "nuscenes import",
        runner.script("make_nuscenes.py", source),
        runner.harmzone("import", "nuscenes", source, "--out", out),
        runner.script("check_nuscenes_import.py", source, out, "--truth", source / "truth.json"),
        makes=(source, out),
    )
    runner.run("killed and gone on", runner.script("check_resume.py", runner.program, "nuscenes", source))


def check_ros2(runner: Runner, samples: Path) -> None:
    """Bags by `rosbags` and by kitti2mcap, with the mapping that is proposed."""
    work = runner.work
    jobs = [("ros2 made", ["--made"])]
    if samples.is_dir():
        jobs.append(("ros2 kitti", ["--kitti", samples / "kitti/training"]))
    else:
        runner.skip("ros2 kitti", f"no samples in {samples}")
    for name, words in jobs:
        bag = work / name.replace(" ", "_")
        out, mapping = work / f"{bag.name}_episodes", work / f"{bag.name}.toml"
        runner.run(
            name,
            runner.script("make_ros2_bag.py", bag, *words),
            [*runner.harmzone("import", "ros2", bag, "--out", out, "--list"), SAVE_AS, mapping],
            runner.harmzone("import", "ros2", bag, "--out", out, "--mapping", mapping, *WHEELBASE),
            runner.script("check_ros2.py", bag.with_suffix(".truth.npz"), out),
            makes=(bag, out, mapping),
        )
    if samples.is_dir():
        raw, bag, out = work / "kitti_raw", work / "kitti2mcap.mcap", work / "kitti2mcap_episodes"
        mapping = work / "kitti2mcap.toml"
        training = samples / "kitti/training"
        words = ["--date", "2011_09_26", "--drive", "0001", "--kitti-dir", raw, "--output", bag]
        runner.run(
            "ros2 kitti2mcap",
            runner.script("make_kitti_raw.py", training, raw),
            [sys.executable, "-m", "kitti2mcap", *words],
            [*runner.harmzone("import", "ros2", bag, "--out", out, "--list"), SAVE_AS, mapping],
            runner.harmzone("import", "ros2", bag, "--out", out, "--mapping", mapping, *WHEELBASE),
            runner.script("check_ros2.py", raw / "truth.npz", out, "--training", training),
            makes=(raw, bag, out, mapping),
        )


def check_exports(runner: Runner, mmdet3d: Path | None) -> None:
    """Simulated episodes out to nuScenes and KITTI, and back."""
    work = runner.work
    data = work / "simulated"
    scored, boxes = work / "simulated_eval", work / "simulated_boxes"
    words = ["gen", "--town", "oldtown", "--samples", "10", "--episodes", "4", "--seed", "5"]
    runner.run(
        "simulated data",
        runner.harmzone(*words, "--set", "val_every=2", "--out", data),
        runner.harmzone("label", data),
        runner.harmzone("predict", "small", "--data", data, "--split", "val", "--out", boxes),
        runner.harmzone("eval", "small", "--data", data, "--split", "val", "--out", scored),
        makes=(data, scored, boxes),
    )
    for categories in ("harm", "harm-as-car-truck", "kinds", "source"):
        export = work / f"nuscenes_{categories}"
        runner.run(
            f"export nuscenes {categories}",
            runner.harmzone(
                "export", "nuscenes", data, export, "--categories", categories, "--version", "v1.0-mini"
            ),
            runner.script("check_nuscenes.py", export, data, "--pictures", work / "pictures"),
            makes=(export,),
        )
    export, results = work / "nuscenes_harm-as-car-truck", work / "results_nusc.json"
    names = ["--format", "nuscenes", "--names", "harm-as-car-truck", "--split", "val"]
    runner.run(
        "export predictions",
        runner.harmzone("export", "predictions", boxes, results, "--data", data, *names),
        runner.script(
            "check_nuscenes.py",
            export,
            data,
            "--predictions",
            results,
            "--metrics",
            scored / "metrics.json",
        ),
        makes=(results,),
    )
    export, back = work / "nuscenes_source", work / "nuscenes_back"
    runner.run(
        "import(export nuscenes)",
        runner.harmzone("import", "nuscenes", export, "--out", back),
        runner.script("compare_episodes.py", data, back),
        makes=(back,),
    )
    export, back = work / "kitti_export", work / "kitti_back"
    runner.run(
        "import(export kitti)",
        runner.harmzone("export", "kitti", data, export, "--categories", "kinds"),
        runner.harmzone("import", "kitti", export, "--out", back),
        runner.script("compare_episodes.py", data, back),
        makes=(export, back),
    )
    if mmdet3d is None:
        runner.skip("mmdet3d", "no --mmdet3d PYTHON; `make check-mmdet3d` installs it")
        return
    for kind, folder in (("nuscenes", "nuscenes_harm-as-car-truck"), ("kitti", "kitti_export")):
        runner.run(f"mmdet3d {kind}", [mmdet3d, HERE / "run_mmdet3d.py", kind, work / folder])


def main() -> int:
    """Runs all that can run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    parser.add_argument("--samples", type=Path, default=HERE.parents[2] / "shared/samples")
    parser.add_argument("--work", type=Path)
    parser.add_argument("--mmdet3d", type=Path)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    work = options.work or Path(tempfile.mkdtemp(prefix="harmzone-logs-"))
    work.mkdir(parents=True, exist_ok=True)
    runner = Runner(options.program.resolve(), work.resolve(), options.only)
    check_samples(runner, options.samples.resolve())
    check_made_av2(runner)
    check_raw_drive(runner, options.samples.resolve())
    check_nuscenes_import(runner)
    check_ros2(runner, options.samples.resolve())
    check_exports(runner, options.mmdet3d.absolute() if options.mmdet3d else None)
    failed = [name for name, verdict in runner.verdicts if verdict == "FAILS"]
    (work / "verdicts.json").write_text(json.dumps(runner.verdicts, indent=1))
    print(f"{len(runner.verdicts)} checks, {len(failed)} failed; outputs in {work}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
