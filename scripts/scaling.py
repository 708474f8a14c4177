"""Reckons what many workers would make of a large data set: hours, waste, cost, and what gives way first.

A simulation of events, whose inputs stand in scripts/scaling.toml: measured ones, and assumed ones to be set
to one's own cluster. Two ways: an array of shards, each a fixed part that a worker makes alone on a shared
file system; and Ray, where the next free worker takes the next episode and all files go through one head.
Usage: scaling.py [TOML]
"""

import bisect
import heapq
import statistics
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

Inputs = dict[str, dict[str, Any]]


@dataclass
class Outcome:
    """What a simulated run came to."""

    hours: float
    busy_share: float
    """Of the workers' time, spent on episodes that count."""
    n_lost: int
    """Episodes that were begun and lost with a node."""
    head_share: float
    """Of the time, that the head (Ray) or the file system (shards) was at work."""
    what_is_full: str


class Nodes:
    """Workers on nodes that differ in speed and fail together."""

    def __init__(self, inputs: Inputs, n_workers: int, random: Random) -> None:
        assumed = inputs["assumed"]
        self.random = random
        self.per_node = assumed["node_cores"]
        n_nodes = -(-n_workers // self.per_node)
        self.speed = [max(0.5, random.gauss(1.0, assumed["node_speed_deviation"])) for _ in range(n_nodes)]
        self.rate = assumed["failures_a_node_hour"] / 3600.0
        self.back_after_s = assumed["back_after_s"]
        self.fails_at: list[list[float]] = [[] for _ in range(n_nodes)]
        """When each node is lost, as far as is drawn yet."""

    def seconds(self, worker: int, work_s: float) -> float:
        """How long work takes on a worker's node."""
        return work_s / self.speed[worker // self.per_node]

    def failure(self, worker: int, begin: float, end: float) -> float | None:
        """When the worker's node is lost before the work ends, if it is; all its workers lose their work."""
        if not self.rate:
            return None
        fails_at = self.fails_at[worker // self.per_node]
        while not fails_at or fails_at[-1] < end:
            last = fails_at[-1] + self.back_after_s if fails_at else 0.0
            fails_at.append(last + self.random.expovariate(self.rate))
        at = fails_at[bisect.bisect_left(fails_at, begin)]
        return at if at < end else None


def episode_times(inputs: Inputs, n: int, random: Random) -> list[float]:
    """Seconds of each episode on a core of the measured machine; skewed to the right, as measured."""
    mean, deviation = inputs["measured"]["episode_s"], inputs["measured"]["episode_deviation_s"]
    shape = (mean / deviation) ** 2
    return [random.gammavariate(shape, mean / shape) for _ in range(n)]


def simulate(inputs: Inputs, n_workers: int, way: str, seed: int) -> Outcome:
    """One run: `shards` or `ray`."""
    random = Random(seed)
    measured, assumed = inputs["measured"], inputs["assumed"]
    n_episodes = -(-inputs["work"]["n_samples"] // inputs["work"]["samples_an_episode"])
    times = episode_times(inputs, n_episodes, random)
    nodes = Nodes(inputs, n_workers, random)
    is_ray = way == "ray"
    write_s = measured["episode_mb"] / (measured["head_mb_s"] if is_ray else 1e3 * assumed["storage_gb_s"])
    todo = [list(range(n_episodes - 1, -1, -1))]
    if not is_ray:
        todo = [list(range(n_episodes))[worker::n_workers][::-1] for worker in range(n_workers)]

    free = [(measured["start_s"], worker) for worker in range(n_workers)]
    heapq.heapify(free)
    store_free_s = end_s = useful_s = used_s = 0.0
    n_lost = 0
    while free:
        now, worker = heapq.heappop(free)
        mine = todo[0] if is_ray else todo[worker]
        if not mine:
            continue
        episode = mine.pop()
        done = now + nodes.seconds(worker, times[episode])
        failed_at = nodes.failure(worker, now, done)
        if failed_at is not None:
            n_lost += 1
            mine.append(episode)
            used_s += failed_at - now
            heapq.heappush(free, (failed_at + nodes.back_after_s, worker))
            continue
        used_s += done - now
        useful_s += done - now
        # Files go through one place, one after the other; a worker of a shard waits for its own.
        store_free_s = max(store_free_s, done) + write_s
        end_s = max(end_s, store_free_s)
        heapq.heappush(free, (done if is_ray else store_free_s, worker))
    # The shards are joined by two cores: hashes, links, the manifest.
    if not is_ray:
        n_mb = n_episodes * measured["episode_mb"]
        end_s += n_episodes * measured["merge_s_an_episode"] + n_mb / (2 * measured["hash_mb_s"])
    store_share = n_episodes * write_s / end_s
    what = "the head" if is_ray else "the file system"
    return Outcome(
        hours=end_s / 3600.0,
        busy_share=useful_s / (end_s * n_workers),
        n_lost=n_lost,
        head_share=store_share,
        what_is_full=what if store_share > 0.9 else "",
    )


def report(inputs: Inputs) -> str:
    """The table."""
    work, measured, assumed = inputs["work"], inputs["measured"], inputs["assumed"]
    n_episodes = -(-work["n_samples"] // work["samples_an_episode"])
    n_gb = n_episodes * measured["episode_mb"] / 1e3
    lines = [
        f"{work['n_samples']:,} samples: {n_episodes:,} episodes, {n_gb:,.0f} GB, "
        f"dataset.json {n_episodes * measured['manifest_kb_an_episode'] / 1e3:,.0f} MB",
        "",
        "way     workers   hours (range)           speed-up  useful  lost  store busy  USD",
    ]
    for way in ("shards", "ray"):
        alone = None
        for n_workers in assumed["workers"]:
            # One is like another where nothing is left to chance.
            draws = [
                simulate(inputs, n_workers, way, assumed["seed"] + draw)
                for draw in range(assumed["draws"] if n_workers > 1 else 1)
            ]
            hours = statistics.mean(of.hours for of in draws)
            alone = alone or hours
            ends = f"({min(of.hours for of in draws):.2f} to {max(of.hours for of in draws):.2f})"
            usd = hours * n_workers * assumed["core_usd_an_hour"]
            busy, lost, store = (
                statistics.mean(figures)
                for figures in zip(*((of.busy_share, of.n_lost, of.head_share) for of in draws), strict=True)
            )
            lines.append(
                f"{way:<7} {n_workers:>7} {hours:>7.2f} {ends:<20} {alone / hours:>8.0f} {busy:>7.0%} "
                f"{lost:>5.0f} {store:>10.0%} {usd:>5.1f}  {draws[0].what_is_full}".rstrip()
            )
    # An object an episode and one a label file; merge reads each once, and listing is a thousand a request.
    n_puts, n_gets = 2 * n_episodes, 2 * n_episodes + 2 * n_episodes // 1000
    cost = (n_puts * assumed["put_usd_a_million"] + n_gets * assumed["get_usd_a_million"]) / 1e6
    lines += ["", f"on object storage: {n_puts:,} writes and {n_gets:,} reads, {cost:.2f} USD"]
    lines.append(f"the head is full from {full_from(inputs, 'ray'):,.0f} workers on, by its rate alone")
    lines.append(f"the file system is full from {full_from(inputs, 'shards'):,.0f} workers on")
    return "\n".join(lines)


def full_from(inputs: Inputs, way: str) -> float:
    """So many workers make as much as one place takes."""
    measured = inputs["measured"]
    mb_s = measured["head_mb_s"] if way == "ray" else 1e3 * inputs["assumed"]["storage_gb_s"]
    return mb_s * measured["episode_s"] / measured["episode_mb"]


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("scaling.toml")
    print(report(tomllib.loads(path.read_text(encoding="utf-8"))))
