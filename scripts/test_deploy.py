"""The manifests of deploy/kubernetes: against Kubernetes' own schema, and what their pods would run."""

import os
import subprocess
from pathlib import Path

import kubernetes_validate
import pytest
import yaml

DEPLOY = Path(__file__).parents[1] / "deploy"
MANIFESTS = sorted((DEPLOY / "kubernetes").glob("*.yaml"))


def read(name):
    return yaml.safe_load((DEPLOY / "kubernetes" / name).read_text())


def run_in_pod(job, tmp_path, **environment):
    """Runs a job's command with a program that only notes its words; returns these, a line a call."""
    program = tmp_path / "harmzone"
    program.write_text(f'#!/bin/sh\nprintf "%s|" "$@" >> {tmp_path}/said\necho >> {tmp_path}/said\n')
    program.chmod(0o755)
    container = job["spec"]["template"]["spec"]["containers"][0]
    given = {entry["name"]: entry["value"] for entry in container.get("env", ()) if "value" in entry}
    path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    subprocess.run([*container["command"], *container["args"]], env=path | given | environment, check=True)
    return (tmp_path / "said").read_text().splitlines()


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.name)
def test_a_manifest_is_valid(path):
    kubernetes_validate.validate(yaml.safe_load(path.read_text()), "1.33", strict=True)


def test_a_wrong_manifest_is_not_valid():
    job = read("gen.yaml")
    job["spec"]["completionsMode"] = "Indexed"
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(job, "1.33", strict=True)


def test_each_pod_makes_its_own_shard_of_the_same_data_set(tmp_path):
    job = read("gen.yaml")
    shards = job["spec"]["completions"]
    made, labelled = run_in_pod(job, tmp_path, JOB_COMPLETION_INDEX="7", JOBS="4")
    assert made == (
        f"gen|--out|/data/shards/7|--shard|7/{shards}|--jobs|4|--preset=small|--ood|--episodes=10000|--seed=7|"
    )
    assert labelled == "label|/data/shards/7|"
    assert job["spec"]["completionMode"] == "Indexed"


def test_the_merge_takes_what_the_pods_have_made(tmp_path):
    job = read("merge.yaml")
    [said] = run_in_pod(job, tmp_path)
    assert said == "merge|/data/shards/*|--out|/data/data|"
    mounts = [read(name)["spec"]["template"]["spec"]["volumes"] for name in ("gen.yaml", "merge.yaml")]
    assert mounts[0] == mounts[1]
    assert mounts[0][0]["persistentVolumeClaim"]["claimName"] == read("volume.yaml")["metadata"]["name"]
