"""The installed wheel: command and module, beside the program; `make wheel-test` runs it in a fresh venv."""

import doctest
import hashlib
import importlib.util
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import harmzone
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
COMMAND = Path(sys.executable).with_name("harmzone")
WORLD = ["--preset", "demo", "--town", "oldtown,suburb", "--episodes", "2", "--samples", "3", "--seed", "5"]
KEYS = {"preset": "demo", "town": ["oldtown", "suburb"], "episodes": 2, "samples": 3, "seed": 5}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("wheel") / "data"
    bare = harmzone.gen(path, **KEYS, set={"val_every": 0}, quiet=True)
    assert len(bare) == 6
    assert bare[0].harmful is None
    return harmzone.label(bare, quiet=True)


def hashes(folder):
    files = sorted(folder.glob("**/*.mcap"))
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_the_command_tells_its_version_and_what_the_machine_has():
    told = subprocess.run([COMMAND, "--version"], capture_output=True, text=True, check=True).stdout
    assert told == f"harmzone {harmzone.__version__}\n"
    told = subprocess.run([COMMAND, "doctor"], capture_output=True, text=True, check=True).stdout
    assert sys.prefix in told and "which runs the program" in told


def test_wrong_usage_ends_with_2_and_a_failure_with_1():
    assert subprocess.run([COMMAND, "gen", "--no-such-flag"], capture_output=True).returncode == 2
    failed = subprocess.run([COMMAND, "info", "/no/such/data"], capture_output=True, text=True)
    assert failed.returncode == 1
    assert failed.stderr.startswith("error: ") and "/no/such/data" in failed.stderr
    assert "Traceback" not in failed.stderr


def test_the_wheel_and_the_program_make_the_same_bytes(data, tmp_path):
    program = os.environ.get("HARMZONE_PROGRAM")
    if not program:
        pytest.skip("HARMZONE_PROGRAM names no program to compare with")
    subprocess.run(
        [program, "gen", "--out", tmp_path, *WORLD, "--set", "val_every=0"], check=True, capture_output=True
    )
    subprocess.run([program, "label", tmp_path], check=True, capture_output=True)
    assert hashes(tmp_path) == hashes(data.path)
    assert len(hashes(tmp_path)) == 4


def test_a_sample_has_the_shapes_that_the_stubs_tell(data):
    sample = data[-1]
    assert sample.points.dtype == np.float32 and sample.points.shape[1] == 5 and len(sample.points) > 1000
    assert sample.image.dtype == np.uint8 and sample.image.shape[2] == 3
    assert sample.encoded_image[:2] == b"\xff\xd8"
    n = len(sample.boxes)
    assert n > 0 and sample.boxes.shape == (n, 7) and sample.velocities.shape == (n, 2)
    assert sample.harmful.shape == (n,) and len(sample.categories) == len(sample.kinds) == n
    assert sample.id == f"{data.episodes[-1]['name']}/2"
    with pytest.raises(IndexError, match="there is no sample 6; the data set has 6"):
        data[6]


def test_points_seen_through_the_calibration_lie_in_the_boxes_that_count_them(data):
    checked = 0
    for sample in data:
        points = (
            np.c_[sample.points[:, :3].astype(float), np.ones(len(sample.points))] @ sample.ego_from_lidar.T
        )
        for box, counted in zip(sample.boxes, sample.n_lidar_points, strict=True):
            x, y = (points[:, :2] - box[:2]).T
            cos, sin = np.cos(box[6]), np.sin(box[6])
            along, across, up = x * cos + y * sin, y * cos - x * sin, points[:, 2] - box[2]
            inside = (abs(along) <= box[3] / 2) & (abs(across) <= box[4] / 2) & (abs(up) <= box[5] / 2)
            # All that it counts, but for the noise at its edges; the road under it may be in the box, too.
            assert inside.sum() >= counted - 1 - counted // 50, sample.id
            checked += counted > 0
    assert checked > 5


def test_the_zone_labels_as_the_labels_do(data):
    zone = harmzone.Zone("rect")
    same = [
        zone.harmful(sample.boxes, sample.true_ego, sample.velocities) == sample.harmful for sample in data
    ]
    # Labels judge what is solid of an object, the function the box that it is given.
    assert np.mean(np.concatenate(same)) > 0.95
    corners = zone.corners(data[0].true_ego)
    assert corners.shape == (4, 2)
    with pytest.raises(harmzone.HarmzoneError, match="kind"):
        harmzone.Zone("circle")
    with pytest.raises(ValueError, match="speed_mps"):
        zone.harmful([[0, 0, 0, 1, 1, 1, 0]], {})


def test_the_detector_and_its_scores_are_those_of_the_command(data, tmp_path):
    detector = harmzone.Detector("small")
    assert 0 < detector.operating_score < 1
    one, all_of_it = detector.predict(data[0]), detector.predict(list(data))
    assert len(all_of_it) == 6
    assert np.array_equal(one.boxes, all_of_it[0].boxes)
    assert all(np.all(np.diff(found.scores) <= 0) for found in all_of_it)
    assert len(one.above(0.5)) == int((one.scores >= 0.5).sum())
    scored = harmzone.evaluate("small", data, split="train", out=tmp_path / "scores", quiet=True)
    assert scored == json.loads((tmp_path / "scores/metrics.json").read_text())


def test_errors_are_exceptions_with_the_commands_words(data, tmp_path):
    with pytest.raises(harmzone.CommandError, match="valid is a number from") as told:
        harmzone.gen(tmp_path / "x", episodes=0, quiet=True)
    assert told.value.returncode == 2
    with pytest.raises(harmzone.HarmzoneError, match="harmzone label"):
        harmzone.Dataset(data.path, labels="other")
    with pytest.raises(harmzone.HarmzoneError, match="no episode of split test"):
        harmzone.Dataset(data.path, split="test")
    with pytest.raises(ValueError, match="valid are train, val, dev, test"):
        harmzone.Dataset(data.path, split="tests")
    torn = tmp_path / "torn"
    shutil.copytree(data.path, torn)
    episode = next(iter(torn.glob("episodes/*.mcap")))
    episode.write_bytes(episode.read_bytes()[:-100])
    with pytest.raises(harmzone.HarmzoneError, match=episode.name):
        list(harmzone.Dataset(torn))


def test_an_interrupt_ends_the_command_and_the_same_call_goes_on(tmp_path):
    # Many, and short: the last must not be done as soon as the first.
    many = {**KEYS, "episodes": 12, "samples": 1}
    world = [*WORLD[:4], "--episodes", "12", "--samples", "1", *WORLD[8:]]
    process = subprocess.Popen(
        [COMMAND, "gen", "--out", tmp_path, *world], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    # In the middle, however fast the machine is.
    while not list(tmp_path.glob("episodes/*.mcap")):
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=10) != 0
    process.communicate()
    assert len(harmzone.gen(tmp_path, **many, quiet=True)) == 12


def test_a_data_set_can_be_sent_to_another_process(data):
    again = pickle.loads(pickle.dumps(data))
    assert np.array_equal(again[3].points, data[3].points)


def test_training_with_pytorch(data):
    torch = pytest.importorskip("torch")
    spec = importlib.util.spec_from_file_location("train_pytorch", ROOT / "examples/train_pytorch.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    losses = example.train(data.path, epochs=6)
    assert losses[-1] < losses[0]
    assert isinstance(data, torch.utils.data.Dataset)
    loader = torch.utils.data.DataLoader(
        data, batch_size=4, num_workers=2, collate_fn=harmzone.collate, multiprocessing_context="spawn"
    )
    batches = list(loader)
    assert [len(batch["id"]) for batch in batches] == [4, 2]
    assert batches[0]["image"].shape[:2] == (4, 3)


def test_a_tiny_network_is_trained_scored_and_used(data, tmp_path):
    run = harmzone.train(
        data,
        tmp_path / "run",
        quiet=True,
        set={"lidar_stage.epochs": 1, "fused_stage.epochs": 1, "validate_every_epochs": 0},
    )
    scored = harmzone.evaluate(run, data, split="train", on_training_data=True, quiet=True)
    assert scored
    assert len(harmzone.Detector(run).predict(data[0])) >= 0


def test_the_examples_in_the_documentation_run():
    for module in (harmzone._zone, harmzone._command):
        assert doctest.testmod(module).failed == 0
