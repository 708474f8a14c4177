"""The reckoning of many workers (scaling.py), where it can be said beforehand what it must give."""

import copy
import tomllib
from pathlib import Path

import pytest
import scaling

INPUTS = tomllib.loads(Path(scaling.__file__).with_name("scaling.toml").read_text())


def inputs(n_samples=8000, **assumed):
    mine = copy.deepcopy(INPUTS)
    mine["work"]["n_samples"] = n_samples
    mine["assumed"] |= assumed
    return mine


@pytest.mark.parametrize("way", ["shards", "ray"])
def test_one_sure_worker_takes_the_sum(way):
    mine = inputs(failures_a_node_hour=0.0, node_speed_deviation=0.0)
    outcome = scaling.simulate(mine, 1, way, 1)
    assert outcome.hours * 3600 == pytest.approx(200 * mine["measured"]["episode_s"], rel=0.05)
    assert outcome.n_lost == 0 and outcome.busy_share > 0.98


def test_a_lost_node_takes_the_work_of_all_its_workers():
    calm = scaling.simulate(inputs(failures_a_node_hour=0.0), 32, "ray", 3)
    mine = inputs(80_000, failures_a_node_hour=20.0, node_cores=32)
    rough = scaling.simulate(mine, 32, "ray", 3)
    assert calm.n_lost == 0
    # One node: nearly all of its 32 workers are in the middle of something.
    assert rough.n_lost % 32 in {0, 31, 30} and rough.n_lost >= 30
    assert rough.hours > 10 * calm.hours


def test_the_head_is_full_where_its_rate_says():
    full_from = scaling.full_from(INPUTS, "ray")
    below = scaling.simulate(inputs(200_000), int(full_from / 4), "ray", 1)
    above = scaling.simulate(inputs(200_000), int(full_from * 4), "ray", 1)
    assert not below.what_is_full and above.what_is_full == "the head"
    mine = INPUTS["measured"]
    assert above.hours * 3600 == pytest.approx(5000 * mine["episode_mb"] / mine["head_mb_s"], rel=0.1)


def test_the_same_seed_gives_the_same_table():
    mine = inputs(workers=[1, 4], draws=2)
    assert scaling.report(mine) == scaling.report(copy.deepcopy(mine))
