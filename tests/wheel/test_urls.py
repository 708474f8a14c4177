"""The installed wheel on URLs, against a server of objects on loopback."""

import json
import os
import subprocess
import sys

import harmzone
import pytest
from object_server import ObjectServer

KEYS = {"preset": "demo", "town": "oldtown", "episodes": 2, "samples": 1, "seed": 5, "set": {"val_every": 0}}
URL = "s3://bucket/sets/tiny"

# Not in pytest's process, whose threads could hold a lock at the fork. Each process fetches an episode.
READ_IN_A_FORK = """
import os, signal, sys, harmzone
data = harmzone.Dataset(sys.argv[1], labels="rect")
first = data[0]
child = os.fork()
if child == 0:
    signal.alarm(60)
    ok = len(data[1].points) > 0 and data[1].harmful is not None
    os._exit(0 if ok else 1)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
assert len(data[1].points) > 0
"""


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with ObjectServer() as server, pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith("AWS_")]:
            patch.delenv(name)
        for name, value in server.environment().items():
            patch.setenv(name, value)
        patch.setenv("HARMZONE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield server


def test_what_commands_make_of_a_url_lies_there(server, tmp_path):
    labelled = harmzone.label(harmzone.gen(URL, **KEYS, quiet=True), quiet=True)
    assert "bucket/sets/tiny/labels/rect/labels.json" in server.objects
    scored = harmzone.evaluate("small", labelled, split="train", out="s3://bucket/scores", quiet=True)
    kept = json.loads(server.objects["bucket/scores/metrics.json"][0])
    assert kept.keys() - scored.keys() == {"format_version", "sha256"}
    assert kept | scored == kept
    # All came from the bucket: another cache has none of it.
    read = [sys.executable, "-c", READ_IN_A_FORK, URL]
    other = {**os.environ, "HARMZONE_CACHE": str(tmp_path)}
    subprocess.run(read, env=other, check=True, timeout=120)
    assert labelled[1].harmful is not None
