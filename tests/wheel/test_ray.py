"""`--engine ray` on a cluster of two raylets of this machine; `make wheel-test` runs it."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ray")

import ray
from ray.cluster_utils import Cluster

COMMAND = Path(sys.executable).with_name("harmzone")
WORLD = ["--preset", "demo", "--town", "oldtown,suburb", "--seed", "5", "--set", "val_every=0"]
N_EPISODES = int(os.environ.get("HARMZONE_RAY_EPISODES", "24"))
SIZE = ["--episodes", N_EPISODES, "--samples", 4]


def hashes(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".toml")
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def call(*words, **more):
    return subprocess.run([COMMAND, *map(str, words)], capture_output=True, text=True, **more)


@pytest.fixture(scope="module")
def cluster():
    # Ray's default takes up to 20 s to call a node dead, which is longer than these runs.
    soon = {
        "health_check_initial_delay_ms": 0,
        "health_check_period_ms": 500,
        "health_check_failure_threshold": 3,
    }
    head = {"num_cpus": 1, "include_dashboard": False, "_system_config": soon}
    made = Cluster(initialize_head=True, head_node_args=head)
    made.add_node(num_cpus=1)
    made.wait_for_nodes()
    yield made
    made.shutdown()


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A data set that one process made, labelled."""
    path = tmp_path_factory.mktemp("ray") / "here"
    begin = time.monotonic()
    made = call("gen", "--out", path, *WORLD, *SIZE, "--jobs", 1)
    assert made.returncode == 0, made.stderr
    print(f"one process: {time.monotonic() - begin:.1f} s")
    assert call("label", path).returncode == 0
    return path


def test_a_cluster_makes_the_bytes_of_one_process_although_a_node_dies(cluster, here, tmp_path):
    second = cluster.add_node(num_cpus=1)
    out = tmp_path / "far"
    words = ["gen", "--out", out, *WORLD, *SIZE, "--engine", "ray", "--address", cluster.address]
    begin = time.monotonic()
    with subprocess.Popen(
        [COMMAND, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        # In the middle: some episodes are there, and others are under way.
        while len(list(out.glob("episodes/*.mcap"))) < N_EPISODES // 3:
            assert running.poll() is None, running.stderr.read()
            time.sleep(0.05)
        cluster.remove_node(second, allow_graceful=False)
        _, told = running.communicate()
    print(f"two raylets, and a third one killed: {time.monotonic() - begin:.1f} s")
    assert running.returncode == 0, told
    assert "a node of the Ray cluster was lost" in told
    far = hashes(out)
    assert far == {name: sha for name, sha in hashes(here).items() if not name.startswith("labels")}
    assert len(far) == N_EPISODES + 1
    # Labels too, and nothing is made twice.
    again = call(*words, "--json")
    assert json.loads(again.stdout)["n_kept"] == N_EPISODES, again.stderr
    assert call("label", out, "--engine", "ray", "--address", cluster.address).returncode == 0
    assert hashes(out) == hashes(here)


def test_boxes_and_scores_are_those_of_one_process(cluster, here, tmp_path):
    far = ["--engine", "ray", "--address", cluster.address]
    for folder, more in (("here", []), ("far", far)):
        split = ["--data", here, "--split", "train", *more]
        told = call("predict", "small", *split, "--out", tmp_path / folder)
        assert told.returncode == 0, told.stderr
        told = call("eval", "small", *split, "--ood", "--out", tmp_path / f"{folder}-scores")
        assert told.returncode == 0, told.stderr
        told = call("eval", "small", *split, "--blind", "camera", "--out", tmp_path / f"{folder}-dark")
        assert told.returncode == 0, told.stderr
    assert hashes(tmp_path / "far") == hashes(tmp_path / "here")
    assert len(hashes(tmp_path / "far")) == N_EPISODES + 1
    for kind in ("scores", "dark"):
        [mine, theirs] = [(tmp_path / f"{of}-{kind}" / "metrics.json").read_bytes() for of in ("here", "far")]
        assert mine == theirs
    assert (tmp_path / "here-scores/metrics.json").read_bytes() != (
        tmp_path / "here-dark/metrics.json"
    ).read_bytes()


def test_own_meshes_and_checkpoints_reach_the_nodes(cluster, here, tmp_path):
    far = ["--engine", "ray", "--address", cluster.address]
    models = tmp_path / "models"
    models.mkdir()
    corners = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    faces = ["124", "143", "578", "586", "156", "162", "348", "387", "137", "175", "268", "284"]
    text = corners + "".join(f"f {' '.join(face)}\n" for face in faces)
    (models / "crate.obj").write_text(text)
    own = [*WORLD, "--ood", "--models", models, "--episodes", 2, "--samples", 2]
    for folder, more in (("here", []), ("far", far)):
        made = call("gen", "--out", tmp_path / folder, *own, *more)
        assert made.returncode == 0, made.stderr
    assert hashes(tmp_path / "far") == hashes(tmp_path / "here")

    tiny = [
        "--set",
        "lidar_stage.epochs=1",
        "--set",
        "fused_stage.epochs=0",
        "--set",
        "validate_every_epochs=0",
    ]
    trained = call("train", here, "--out", tmp_path / "run", *tiny, "--set", "model.use_camera=false")
    assert trained.returncode == 0, trained.stderr
    for folder, more in (("p-here", []), ("p-far", far)):
        split = ["--data", tmp_path / "here", "--split", "dev", *more]
        told = call("predict", tmp_path / "run", *split, "--out", tmp_path / folder)
        assert told.returncode == 0, told.stderr
    assert hashes(tmp_path / "p-far") == hashes(tmp_path / "p-here")


def test_an_interrupt_leaves_what_is_whole_and_nothing_under_way(cluster, here, tmp_path):
    out = tmp_path / "far"
    words = ["gen", "--out", out, *WORLD, *SIZE, "--engine", "ray", "--address", cluster.address]
    with subprocess.Popen([COMMAND, *map(str, words)], stderr=subprocess.PIPE, text=True) as running:
        while not list(out.glob("episodes/*.mcap")):
            assert running.poll() is None, running.stderr.read()
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        begin = time.monotonic()
        running.wait(20)
    assert running.returncode not in (0, 1)
    assert time.monotonic() - begin < 5
    deadline = time.monotonic() + 60
    while subprocess.run(["pgrep", "-f", "harmzone gen-worker"], capture_output=True).returncode == 0:
        assert time.monotonic() < deadline, "workers are left"
        time.sleep(0.5)
    assert call(*words).returncode == 0
    assert hashes(out) == {name: sha for name, sha in hashes(here).items() if not name.startswith("labels")}


def test_a_task_whose_process_dies_each_time_is_given_up_and_the_rest_is_made(cluster, here, tmp_path):
    out, told = tmp_path / "far", tmp_path / "told"
    words = ["gen", "--out", out, *WORLD, *SIZE, "--engine", "ray", "--address", cluster.address]
    with told.open("w") as stderr, subprocess.Popen([COMMAND, *map(str, words)], stderr=stderr) as running:
        # Each try dies at once, wherever Ray has it done, until a task has had all of its tries.
        while "given up after 6 tries" not in told.read_text():
            assert running.poll() is None, told.read_text()
            subprocess.run(["pkill", "-KILL", "-f", "harmzone gen-worker"], check=False)
            time.sleep(0.05)
        running.wait(600)
    assert running.returncode == 3, told.read_text()
    assert "Traceback" not in told.read_text()
    n_lost = told.read_text().count("given up after 6 tries")
    assert 0 < n_lost < N_EPISODES
    whole = {name: sha for name, sha in hashes(here).items() if not name.startswith("labels")}
    made = hashes(out)
    assert len([name for name in made if name.endswith(".mcap")]) == N_EPISODES - n_lost
    assert all(whole[name] == sha for name, sha in made.items() if name.endswith(".mcap"))
    # The same command makes the rest.
    assert call(*words).returncode == 0
    assert hashes(out) == whole


def test_failures_are_told(cluster, here, tmp_path):
    far = ["--engine", "ray", "--address", cluster.address]
    told = call("gen", "--out", tmp_path / "x", *WORLD, *SIZE, "--engine", "ray", "--address", "127.0.0.1:1")
    assert told.returncode == 1 and "127.0.0.1:1" in told.stderr, told.stderr
    told = call("gen", "--out", tmp_path / "y", "--address", cluster.address)
    assert told.returncode == 1 and "--engine ray" in told.stderr, told.stderr
    data = tmp_path / "data"
    subprocess.run(["cp", "-r", here, data], check=True)
    broken = next(data.glob("episodes/*.mcap"))
    broken.write_bytes(broken.read_bytes()[:5000])
    told = call("label", data, "--labels", "again", *far)
    assert told.returncode == 1 and broken.stem in told.stderr, told.stderr
    assert "Traceback" not in told.stderr
    assert not (data / "labels/again/labels.json").exists()


def test_ray_data_reads_what_the_data_set_has(cluster, here):
    import harmzone.ray

    ray.init(address=cluster.address, log_to_driver=False)
    try:
        rows = harmzone.ray.read(here, labels="rect").take_all()
    finally:
        ray.shutdown()
    data = harmzone.Dataset(here, labels="rect")
    assert sorted(row["id"] for row in rows) == sorted(sample.id for sample in data)
    by_id = {row["id"]: row for row in rows}
    for sample in data:
        row = by_id[sample.id]
        assert np.array_equal(row["points"], sample.points) and np.array_equal(row["image"], sample.image)
        assert np.array_equal(np.asarray(row["boxes"]).reshape(-1, 7), sample.boxes)
        assert list(row["harmful"]) == list(sample.harmful) and list(row["kinds"]) == list(sample.kinds)


def test_other_builds_on_a_node_are_refused():
    from harmzone.ray import _node

    call_ = _node.Call(build="0.0.0 (0)", command="gen-worker", job="{}", environment={})
    outcome = _node.do(call_, {}, 0, "{}", {}, None)
    assert "same wheel" in json.loads(outcome.answer)["failed"]


def test_files_of_nodes_stay_in_the_folder(tmp_path):
    from harmzone.ray import _engine

    sha256 = hashlib.sha256(b"x").hexdigest()
    _engine._write(tmp_path, "episodes/a.mcap", b"x", sha256)
    assert (tmp_path / "episodes/a.mcap").read_bytes() == b"x"
    for name, content in (("../b", b"x"), ("/tmp/b", b"x"), ("c", b"y")):
        with pytest.raises(ValueError, match="node"):
            _engine._write(tmp_path, name, content, sha256)
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["a.mcap"]
