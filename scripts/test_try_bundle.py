"""What `make bundle-test` takes as a failure of the steps it ran."""

import json
from pathlib import Path

import pytest
import try_bundle


def leave(work: Path, ap: float, n_samples: int = try_bundle.N_SAMPLES, boxes: int = 2) -> Path:
    metrics = {"total": {"mean": ap}, "counts": {"n_samples": n_samples}}
    results = {f"sample-{idx}": [{}] * boxes for idx in range(try_bundle.N_SAMPLES)}
    for name, content in {
        "eval-small/metrics.json": metrics,
        "eval-run/metrics.json": metrics,
        "predictions/predictions.json": {"results": results},
    }.items():
        (work / name).parent.mkdir()
        (work / name).write_text(json.dumps(content))
    return work


def test_scores_and_boxes_are_told(tmp_path):
    said = try_bundle.check(leave(tmp_path, 0.5))
    assert said == [
        "eval-small: mAP 0.500 on 4 samples",
        "eval-run: mAP 0.500 on 4 samples",
        "predictions: 8 boxes",
    ]


@pytest.mark.parametrize(
    ("left", "told"),
    [
        ({"ap": 0.1}, r"mAP 0\.1"),
        ({"ap": float("nan")}, "mAP nan"),
        ({"ap": 0.5, "n_samples": 3}, "3 samples scored where 4 are"),
        ({"ap": 0.5, "boxes": 0}, "0 boxes in 4 samples"),
    ],
)
def test_what_a_working_folder_cannot_leave_ends_the_test(tmp_path, left, told):
    with pytest.raises(SystemExit, match=told):
        try_bundle.check(leave(tmp_path, **left))


def test_a_folder_without_the_program_is_told_with_its_path(tmp_path, monkeypatch):
    monkeypatch.setattr(try_bundle.os, "geteuid", lambda: 0)
    with pytest.raises(SystemExit, match=f"no `harmzone` in the folder.*{tmp_path}"):
        try_bundle.main(tmp_path, tmp_path / "root")
