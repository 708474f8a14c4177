"""The process behind `--engine ray`: hears tasks as lines of JSON, has Ray do them, answers in lines.

src/worker/ray.rs has the other side. Where tasks run, when they are tried again and what becomes of a dead
node's is Ray's to decide.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import queue
import signal
import socket
import sys
import threading
import time
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TextIO

from harmzone.ray import _node

if TYPE_CHECKING:
    from collections.abc import Mapping

# How often a task is tried again after its node or process has died.
_MAX_RETRIES = 5
# How long to wait for a task's end before looking at new ones, seconds.
_WAIT_S = 0.2
# How often to ask for ticks, and how often for nodes, seconds.
_TICKS_PERIOD_S = 1.0
_NODES_PERIOD_S = 1.0
# How long a cluster may take to answer at all, seconds.
_CONNECT_S = 10.0


class _Ticks:
    """An actor: how far each task is. A task that is tried again counts from where it was before."""

    def __init__(self) -> None:
        self.of_place: dict[int, int] = {}

    def tell(self, place: int, n_ticks: int) -> None:
        self.of_place[place] = n_ticks

    def take(self) -> dict[int, int]:
        told, self.of_place = self.of_place, {}
        return told


class _Engine:
    """The tasks of one command on one cluster."""

    def __init__(self, header: Mapping[str, Any], answers: TextIO) -> None:
        import ray

        self.ray = ray
        self.answers = answers
        self.cluster = header["cluster"]
        self.folder = Path(header["folder"])
        self.pending: dict[Any, int] = {}
        """Ray's reference of a task, and the task's place."""
        self.n_ticks: dict[int, int] = {}
        """Told already, by place."""
        self.nodes: set[str] = set()
        self.takes = 0
        call = _node.Call(
            build=_node.build(),
            command=header["command"],
            job=json.dumps(header["job"]),
            environment=header["environment"],
        )
        # In the store once, however many tasks read them.
        self.call = ray.put(call)
        self.shared = ray.put({name: Path(path).read_bytes() for name, path in header["shared"]})
        self.ticks = ray.remote(_Ticks).options(num_cpus=0, max_restarts=-1, **_here(ray)).remote()
        self.do = ray.remote(_node.do).options(
            name=header["command"],
            num_cpus=self.cluster["task_cpus"],
            num_gpus=self.cluster["task_gpus"],
            max_retries=_MAX_RETRIES,
            retry_exceptions=[_node.WorkerDiedError],
            scheduling_strategy="SPREAD",
        )

    def say(self, what: object) -> None:
        print(json.dumps(what), file=self.answers, flush=True)

    def answer(self, place: int, answer: str) -> None:
        # As the node wrote it: no number is read and written anew.
        print(f'{{"answer":{{"place":{place},"answer":{answer}}}}}', file=self.answers, flush=True)

    def look_at_nodes(self) -> None:
        """Say how many tasks fit, and which nodes are gone."""
        alive = {node["NodeID"]: node for node in self.ray.nodes() if node["Alive"]}
        for gone in sorted(self.nodes - alive.keys()):
            self.say({"told": f"a node of the Ray cluster was lost ({gone[:12]}); its tasks are done again"})
        self.nodes = set(alive)
        slots = sum(self.slots_of(node["Resources"]) for node in alive.values())
        takes = self.cluster["most_in_flight"] or max(1, slots + max(2, slots // 4))
        if takes == self.takes:
            return
        if slots == 0:
            cpus, gpus = self.cluster["task_cpus"], self.cluster["task_gpus"]
            self.say({"told": f"no node has {cpus:g} cores and {gpus:g} GPUs for a task; Ray waits for one"})
        self.takes = takes
        self.say({"takes": takes})

    def slots_of(self, resources: Mapping[str, float]) -> int:
        """How many tasks a node does at once."""
        wanted = {"CPU": self.cluster["task_cpus"], "GPU": self.cluster["task_gpus"]}
        return int(min(resources.get(name, 0.0) / share for name, share in wanted.items() if share > 0))

    def begin(self, line: str) -> None:
        """Give a task to Ray."""
        numbered = json.loads(line)
        place = numbered["place"]
        try:
            reads = {name: (self.folder / name).read_bytes() for name in numbered["reads"]}
        except OSError as error:
            self.answer(place, json.dumps({"failed": str(error)}))
            return
        task = json.dumps(numbered["task"])
        reference = self.do.remote(self.call, self.shared, place, task, self.ray.put(reads), self.ticks)
        self.pending[reference] = place

    def finish(self, reference: Any) -> None:  # noqa: ANN401
        """Take back what a task has made, and answer it."""
        place = self.pending.pop(reference)
        try:
            outcome = self.ray.get(reference)
            for name, content, sha256 in outcome.files:
                _write(self.folder, name, content, sha256)
            answer = outcome.answer
        except Exception as error:
            # Ray's own errors and those of the node, after the last try.
            if self.is_lost(error):
                text = f"given up after {1 + _MAX_RETRIES} tries: {_told(error)}"
                self.n_ticks.pop(place, None)
                self.say({"lost": {"place": place, "text": text}})
                return
            answer = json.dumps({"failed": _told(error)})
        self.tick(place, _samples_of(answer))
        self.n_ticks.pop(place, None)
        self.answer(place, answer)

    def is_lost(self, error: Exception) -> bool:
        """Whether the process or the node died, so that the task itself may be fine."""
        known = self.ray.exceptions
        if isinstance(error, known.RayTaskError):
            return isinstance(error.cause, _node.WorkerDiedError)
        died = (known.WorkerCrashedError, known.NodeDiedError, known.OutOfMemoryError, known.ObjectLostError)
        return isinstance(error, died)

    def tick(self, place: int, n_ticks: int) -> None:
        """Pass on the ticks that have not been told yet."""
        told = self.n_ticks.get(place, 0)
        for _ in range(told, n_ticks):
            self.answer(place, '"tick"')
        self.n_ticks[place] = max(told, n_ticks)

    def pass_on_ticks(self) -> None:
        under_way = set(self.pending.values())
        try:
            told = self.ray.get(self.ticks.take.remote(), timeout=30)
        except self.ray.exceptions.RayError:
            return  # only the bar stands still meanwhile: a task's end tells all of its ticks
        for place, n_ticks in told.items():
            if place in under_way:
                self.tick(place, n_ticks)

    def run(self, lines: queue.SimpleQueue[str | None]) -> None:
        """Until the lines end; what is under way then is cancelled."""
        looked_at = asked_at = -1e9
        while True:
            if time.monotonic() - looked_at > _NODES_PERIOD_S:
                self.look_at_nodes()
                looked_at = time.monotonic()
            with contextlib.suppress(queue.Empty):
                while True:
                    line = lines.get(timeout=0 if self.pending else _WAIT_S)
                    if line is None:
                        return
                    self.begin(line)
            if self.pending:
                done, _ = self.ray.wait(list(self.pending), num_returns=1, timeout=_WAIT_S)
                for reference in done:
                    self.finish(reference)
            if time.monotonic() - asked_at > _TICKS_PERIOD_S:
                self.pass_on_ticks()
                asked_at = time.monotonic()

    def cancel(self) -> None:
        for reference in self.pending:
            with contextlib.suppress(Exception):
                self.ray.cancel(reference, force=True)


def _samples_of(answer: str) -> int:
    """Ticks of a finished task: its samples, if it says how many."""
    made = json.loads(answer).get("done")
    if isinstance(made, list):
        made = made[0]
    if not isinstance(made, dict):
        return 0
    return made.get("n_samples", len(made.get("found", ())))


def _here(ray: Any) -> dict[str, Any]:  # noqa: ANN401
    """Keeps an actor on the node of this process, so that it does not die with another."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    try:
        here = ray.get_runtime_context().get_node_id()
        return {"scheduling_strategy": NodeAffinitySchedulingStrategy(here, soft=False)}
    except Exception:
        return {}  # a client from outside of the cluster has no node


def _write(folder: Path, name: str, content: bytes, sha256: str) -> None:
    """Write a file that a node has made: checked, below the folder, whole or not at all."""
    inner = PurePosixPath(name)
    if inner.is_absolute() or ".." in inner.parts:
        raise ValueError(f"a node names a file outside of the folder: {name}")
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ValueError(f"a file was damaged on its way from a node: {name}")
    path = folder / inner
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.partial")
    with partial.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _told(error: Exception) -> str:
    """A failure of Ray's in words, without the way that it took through the code."""
    cause = getattr(error, "cause", None)
    text = str(cause if isinstance(cause, Exception) else error).strip()
    return text or type(error).__name__


def _probe(address: str) -> None:
    """Whether anything listens there, since Ray itself tries for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdecimal():
        socket.create_connection((host, int(port)), timeout=_CONNECT_S).close()


def _listen(lines: queue.SimpleQueue[str | None]) -> None:
    for line in sys.stdin:
        lines.put(line)
    lines.put(None)


def main() -> None:
    """Serve the tasks that standard input names."""
    # An interrupt ends the command that started this process, whose closed pipe ends this one in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    # What libraries print is no answer.
    os.dup2(2, 1)
    header = json.loads(sys.stdin.readline())
    try:
        import ray
    except ImportError as error:
        sys.exit(f"Ray is not installed here ({error}); pip install 'harmzone-VERSION.whl[ray]' brings it")
    address = header["cluster"]["address"] or os.environ.get("RAY_ADDRESS") or "local"
    alone = {"include_dashboard": False} if address == "local" else {}
    try:
        _probe(address)
        ray.init(address=address, log_to_driver=False, logging_level="error", **alone)
    except Exception as error:
        sys.exit(f"no Ray cluster answers at {address}: {error}")
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(lines,), daemon=True).start()
    engine = _Engine(header, answers)
    try:
        engine.run(lines)
    except BrokenPipeError:
        pass  # nobody hears the answers any more
    finally:
        engine.cancel()
        ray.shutdown()
