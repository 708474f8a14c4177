"""What a Ray cluster of two raylets of one core each gains over one process of one core, on this machine.

`make bench-ray` runs it in an environment with the wheel. Prints seconds and their ratio for gen, label,
predict and eval, whether all hashes are equal, and what gen takes when a third raylet is killed halfway.
Usage: bench_ray.py [EPISODES [SAMPLES]]
"""

import hashlib
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ray.cluster_utils import Cluster

COMMAND = Path(sys.executable).with_name("harmzone")
WORLD = ["--preset", "small", "--seed", "5", "--set", "val_every=1"]


def hashes(folder: Path) -> dict[str, str]:
    """Of every file below a folder but the configs, which name paths."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".toml")
    of = {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    of.pop("source.json", None)  # where scores come from: it quotes the command
    return of


def run(*words: object, **environment: str) -> float:
    """Runs a command; returns its seconds."""
    begin = time.monotonic()
    done = subprocess.run(
        [COMMAND, *map(str, words)], capture_output=True, text=True, env=os.environ | environment
    )
    if done.returncode:
        sys.exit(done.stderr)
    return time.monotonic() - begin


def episode_seconds(data: Path) -> list[float]:
    """How long each episode took a single process, from when its file was whole, but for the first."""
    whole = sorted(path.stat().st_mtime for path in data.glob("episodes/*.mcap"))
    return [after - before for before, after in itertools.pairwise(whole)]


def run_and_kill(cluster: Cluster, out: Path, words: list[object], n_episodes: int) -> float:
    """Makes a data set on the cluster, of which a third node is killed halfway."""
    third = cluster.add_node(num_cpus=1)
    begin = time.monotonic()
    with subprocess.Popen([COMMAND, *map(str, words)], stdout=subprocess.DEVNULL) as running:
        while len(list(out.glob("episodes/*.mcap"))) < n_episodes // 2 and running.poll() is None:
            time.sleep(0.1)
        cluster.remove_node(third, allow_graceful=False)
        if running.wait():
            sys.exit(f"gen ended with {running.returncode}")
    return time.monotonic() - begin


def main(n_episodes: int, n_samples: int) -> None:
    """Prints the table."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    far = ["--engine", "ray", "--address", cluster.address]
    size = ["--episodes", n_episodes, "--samples", n_samples]
    alone = {"RAYON_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        one, two = folder / "one", folder / "two"
        # Workers that are asleep are started before the clock is.
        run("gen", "--out", folder / "warm", *WORLD, "--episodes", 2, "--samples", 1, *far)

        rows = []
        stages = {
            "gen": lambda out, more: ["gen", "--out", out, *WORLD, *size, *more],
            "label": lambda out, more: ["label", out, *more],
            "predict": lambda out, more: [
                *("predict", "small", "--data", one, "--split", "val"),
                *("--out", f"{out}-boxes", *more),
            ],
            "eval": lambda out, more: [
                *("eval", "small", "--data", one, "--split", "val"),
                *("--out", f"{out}-scores", *more),
            ],
        }
        for stage, words in stages.items():
            jobs = ["--jobs", 1] if stage == "gen" else []
            seconds = [run(*words(one, jobs), **alone), run(*words(two, far))]
            ends = {"predict": "-boxes", "eval": "-scores"}.get(stage, "")
            is_same = hashes(Path(f"{one}{ends}")) == hashes(Path(f"{two}{ends}"))
            rows.append((stage, *seconds, seconds[0] / seconds[1], is_same))
        each = episode_seconds(one)
        print(f"{n_episodes} episodes of {n_samples} samples; two raylets of one core each")
        print("stage    one process s  two raylets s  ratio  same bytes")
        for stage, alone_s, far_s, ratio, is_same in rows:
            print(f"{stage:<8} {alone_s:13.1f}  {far_s:13.1f}  {ratio:5.2f}  {'yes' if is_same else 'NO'}")
        mean, deviation = statistics.mean(each), statistics.stdev(each)
        n_bytes = statistics.mean(path.stat().st_size for path in one.glob("episodes/*.mcap"))
        print(f"an episode, one process: {mean:.1f} s, deviation {deviation:.1f} s, {n_bytes / 1e6:.2f} MB")

        out = folder / "killed"
        words = stages["gen"](out, far)
        seconds = run_and_kill(cluster, out, words, n_episodes)
        run("label", out)
        same = hashes(out) == hashes(one)
        print(
            f"gen with a third raylet, killed halfway: {seconds:.1f} s, same bytes: {'yes' if same else 'NO'}"
        )
        print(json.dumps({"episode_s": [round(s, 2) for s in each]}))
    cluster.shutdown()
    if not same or not all(row[-1] for row in rows):
        sys.exit("the bytes differ")


if __name__ == "__main__":
    main(*(int(word) for word in (*sys.argv[1:], *("40", "40")[len(sys.argv) - 1 :])))
