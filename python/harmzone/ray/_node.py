"""What a node does: one task, in a process of the program that a node's later tasks use again.

The process works in a folder of its own, where the files lie that a task reads; what the task makes there
goes back and is removed.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Files = Mapping[str, bytes]

# Ticks are gathered so long, seconds.
_TICK_PERIOD_S = 0.5
_FOLDER_PREFIX = "harmzone-ray-"


class WorkerDiedError(Exception):
    """The process of the program died: Ray tries the task again, perhaps elsewhere."""


@dataclass(frozen=True)
class Call:
    """What all tasks share."""

    build: str
    """`build()` of the process that gives the tasks."""
    command: str
    job: str
    """JSON; its `folder` is the node's own."""
    environment: dict[str, str]


@dataclass(frozen=True)
class Outcome:
    """What became of a task."""

    answer: str
    """JSON: `{"done": ..}` or `{"failed": ".."}`."""
    files: list[tuple[str, bytes, str]]
    """Path below the folder, content, SHA-256 of it before its way."""
    seconds: float
    """Taken by the task alone."""


@cache
def build() -> str:
    """Which harmzone this is: its version and the hash of its native part."""
    from harmzone import _native

    native = Path(_native.__file__).read_bytes()
    return f"{_native.__version__} ({hashlib.sha256(native).hexdigest()[:16]})"


class _Server:
    """A process of the program that serves tasks of one call."""

    def __init__(self, call: Call, shared: Files) -> None:
        _sweep()
        self.call = call
        self.folder = Path(tempfile.mkdtemp(prefix=f"{_FOLDER_PREFIX}{os.getpid()}-"))
        self.kept = _write(self.folder, shared)
        self.stderr = tempfile.TemporaryFile()  # noqa: SIM115
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "harmzone", call.command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.stderr,
            env=os.environ | call.environment | _gpu(),
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        self.say(json.dumps(json.loads(call.job) | {"folder": str(self.folder)}))

    def say(self, line: str) -> None:
        """Write a line; a dead process is noticed when it should answer."""
        with contextlib.suppress(BrokenPipeError):
            assert self.process.stdin
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()

    def do(self, task: str, reads: Files, on_tick: Callable[[int], None]) -> Outcome:
        """Do one task; `on_tick` hears how far it is."""
        begin = time.monotonic()
        inputs = _write(self.folder, reads)
        self.say(task)
        n_ticks = 0
        assert self.process.stdout
        for line in self.process.stdout:
            if line == '"tick"\n':
                n_ticks += 1
                on_tick(n_ticks)
            elif line.startswith(('{"done":', '{"failed":')):
                files = [] if line.startswith('{"failed":') else self.made(inputs)
                self.clear()
                return Outcome(line.strip(), files, time.monotonic() - begin)
        raise WorkerDiedError(self.last_words())

    def made(self, inputs: set[Path]) -> list[tuple[str, bytes, str]]:
        """Whatever was not there before the task."""
        found = []
        for path in sorted(self.folder.rglob("*")):
            if path.is_file() and path not in self.kept and path not in inputs:
                content = path.read_bytes()
                sha256 = hashlib.sha256(content).hexdigest()
                found.append((path.relative_to(self.folder).as_posix(), content, sha256))
        return found

    def clear(self) -> None:
        """Remove what was read and made."""
        for path in self.folder.rglob("*"):
            if path.is_file() and path not in self.kept:
                path.unlink()

    def last_words(self) -> str:
        """How it died."""
        code = self.process.wait()
        self.stderr.seek(0)
        said = self.stderr.read().decode(errors="replace").splitlines()[-15:]
        return "\n    ".join([f"the worker process died (exit code {code})", *said])

    def close(self) -> None:
        """End it, and remove its folder."""
        self.process.kill()
        self.process.wait()
        self.stderr.close()
        shutil.rmtree(self.folder, ignore_errors=True)


_server: _Server | None = None


def _close() -> None:
    global _server
    if _server:
        _server.close()
        _server = None


atexit.register(_close)


def do(call: Call, shared: Files, place: int, task: str, reads: Files, ticks: Any) -> Outcome:  # noqa: ANN401
    """Do one task on this node; the function that Ray runs.

    Args:
        call: what all tasks share.
        shared: files that every task reads, by their path below the folder.
        place: of the task.
        task: as JSON.
        reads: files that this task reads.
        ticks: an actor that hears how far the task is.

    """
    global _server
    if build() != call.build:
        failed = (
            f"this node has harmzone {build()}, wanted is {call.build} as where the command runs: "
            "install the same wheel on every node"
        )
        return Outcome(json.dumps({"failed": failed}), [], 0.0)
    if _server is None or _server.call != call or _server.process.poll() is not None:
        _close()
        _server = _Server(call, shared)
    told_at = 0.0

    def on_tick(n_ticks: int) -> None:
        nonlocal told_at
        if time.monotonic() - told_at > _TICK_PERIOD_S:
            told_at = time.monotonic()
            ticks.tell.remote(place, n_ticks)

    try:
        return _server.do(task, reads, on_tick)
    except BaseException:
        _close()
        raise


def _gpu() -> dict[str, str]:
    """Has EGL render on the GPU that Ray has set aside."""
    import ray

    ids = ray.get_gpu_ids()
    return {"MUJOCO_EGL_DEVICE_ID": str(ids[0])} if ids and "MUJOCO_EGL_DEVICE_ID" not in os.environ else {}


def _write(folder: Path, files: Files) -> set[Path]:
    """Write files below a folder."""
    written = set()
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        written.add(path)
    return written


def _sweep() -> None:
    """Remove the folders of processes that were killed."""
    for path in Path(tempfile.gettempdir()).glob(f"{_FOLDER_PREFIX}*"):
        pid = path.name.removeprefix(_FOLDER_PREFIX).partition("-")[0]
        if pid.isdecimal() and not Path(f"/proc/{pid}").exists():
            shutil.rmtree(path, ignore_errors=True)
