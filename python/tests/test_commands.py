"""What the commands' functions hand on, and what they return; no extension module and no bucket is needed."""

import importlib
import json
import sys
import tomllib
import types

import numpy as np
import pytest

URL = "s3://lab/sets/x"
FOLDER_OF_URL = "/home/me/.cache/harmzone/store/0123/x"
# Places whose data sets were opened, in order.
opened = []


class Native:
    """The extension module's data set: a folder, or the one that a URL's files are fetched to."""

    def __init__(self, path, split, labels):
        opened.append(str(path))
        self.path = FOLDER_OF_URL if str(path) == URL else path


@pytest.fixture
def harmzone():
    """The package over a stand-in for its extension module, for one test."""
    native = types.ModuleType("harmzone._native")
    native.HarmzoneError, native.__version__ = type("HarmzoneError", (Exception,), {}), "0"
    native.Dataset, native.Sample, native.Zone = Native, object, list
    opened.clear()
    others = [name for name in sys.modules if name.split(".")[0] == "harmzone"]
    before = {name: sys.modules.pop(name) for name in others}
    sys.modules["harmzone._native"] = native
    package = importlib.import_module("harmzone")
    package._native = native
    yield package
    for name in [name for name in sys.modules if name.split(".")[0] == "harmzone"]:
        del sys.modules[name]
    sys.modules.update(before)


@pytest.fixture
def ran(harmzone, monkeypatch):
    """The words of each command, which is not run."""
    words = []

    def run(*given, quiet=False):
        words.append([str(word) for word in given])
        return json.dumps({"set": "rect", "total": 1})

    monkeypatch.setattr(importlib.import_module("harmzone._command"), "run", run)
    return words


def settings(harmzone, **of):
    """What the command line makes of them: the words after `--set`, read as TOML."""
    words = importlib.import_module("harmzone._command")._options({"set": of})
    assert words[::2] == ["--set"] * (len(words) // 2)
    return tomllib.loads("\n".join(words[1::2]))


def test_commands_take_a_url_and_not_the_folder_that_its_files_are_fetched_to(harmzone, ran):
    data = harmzone.Dataset(URL, split="val")
    assert str(data.path) == FOLDER_OF_URL and data.place == URL
    labelled = harmzone.label(data)
    assert (labelled.place, labelled.split, labelled.labels) == (URL, "val", "rect")
    harmzone.train(labelled, "run")
    harmzone.predict("small", labelled, out="found")
    harmzone.evaluate("small", labelled, out="s3://lab/scores")
    assert ran[0][:2] == ["label", URL] and ran[1][:2] == ["train", URL]
    assert all(words[2:4] == ["--data", URL] for words in ran[2:]), ran


def test_a_url_is_not_opened_before_what_a_command_made_is_read(harmzone, ran):
    labelled = harmzone.label(harmzone.gen(URL, preset="demo"))
    harmzone.train(labelled, "s3://lab/run")
    assert opened == []
    assert labelled.path and opened == [URL]


def test_commands_take_a_folder_as_before(harmzone, ran, tmp_path):
    data = harmzone.gen(tmp_path / "data", preset="demo")
    assert opened == [str(tmp_path / "data")]
    assert harmzone.label(data).place == data.path == tmp_path / "data"
    assert ran == [
        ["gen", "--out", str(tmp_path / "data"), "--preset", "demo"],
        ["label", str(tmp_path / "data"), "--json"],
    ]


def test_a_run_at_a_url_is_returned_as_its_url(harmzone, ran, tmp_path):
    assert harmzone.train("data", "s3://lab/run") == "s3://lab/run"
    assert harmzone.train("data", "file:///lab/run") == "file:///lab/run"
    assert harmzone.train("data", str(tmp_path)) == tmp_path


def test_scores_at_a_url_come_from_the_commands_output_and_those_of_a_folder_from_it(harmzone, ran, tmp_path):
    assert harmzone.evaluate("small", URL, out="s3://lab/scores", breakdown=True)["total"] == 1
    assert ran[0] == ["eval", "small", "--data", URL, "--out", "s3://lab/scores", "--json"]
    (tmp_path / "metrics.json").write_text('{"sha256": "0"}')
    assert harmzone.evaluate("small", URL, out=tmp_path, breakdown=True) == {"sha256": "0"}
    assert ran[1] == ["eval", "small", "--data", URL, "--out", str(tmp_path), "--breakdown"]


def test_settings_are_toml(harmzone):
    inf = float("inf")
    given = {
        "a": [1, -2.5, True, "x\x7f\n😀"],
        "b": (inf, -inf),
        "c": 1e-7,
        "d": 1e30,
        "e": "'bare'",
        "f": [],
    }
    assert settings(harmzone, **given) == {**given, "b": [inf, -inf], "e": "bare"}
    assert str(settings(harmzone, a=float("nan"))) == "{'a': nan}"


def test_settings_of_numpy_are_pythons(harmzone):
    scalars = {"a": np.int64(3), "b": np.float32(0.5), "c": np.bool_(False), "d": np.float64("-inf")}
    assert settings(harmzone, **scalars) == {"a": 3, "b": 0.5, "c": False, "d": float("-inf")}
    nested = {"e": [np.int64(1), (np.float64(0.1),)], "f": np.arange(4).reshape(2, 2)}
    assert settings(harmzone, **nested) == {"e": [1, [0.1]], "f": [[0, 1], [2, 3]]}
    options = importlib.import_module("harmzone._command")._options
    assert options({"ood": np.True_, "force": np.False_, "episodes": np.int64(2)}) == [
        "--ood",
        "--episodes",
        "2",
    ]


def test_dictionaries_of_settings_are_keys_with_dots(harmzone):
    words = importlib.import_module("harmzone._command")._options
    given = {"lidar_stage": {"epochs": 1, "rate": {"first": np.float32(0.5)}}, "fused_stage.epochs": 2}
    assert words({"set": given})[1::2] == [
        "lidar_stage.epochs=1",
        "lidar_stage.rate.first=0.5",
        "fused_stage.epochs=2",
    ]


def test_a_setting_that_toml_has_not_is_named_with_what_would_be_valid(harmzone):
    for value in (None, {1}, b"x", 1j, [None], [{"a": 1}], np.datetime64("2026-01-01")):
        with pytest.raises(TypeError, match=r"`ttc\.horizon_s` has .*valid are numbers"):
            settings(harmzone, ttc={"horizon_s": value})
        with pytest.raises(TypeError, match=r"`ttc\.horizon_s` has .*valid are numbers"):
            harmzone.Zone("ttc", ttc={"horizon_s": value})
    with pytest.raises(TypeError, match="valid is a dictionary"):
        harmzone.gen("data", set="val_every=2")


def test_a_zones_settings_are_toml(harmzone):
    zone = harmzone.Zone("ttc", width_m=np.float32(4), ttc={"horizon_s": float("inf")}, note="4")
    assert zone._native == ["kind=ttc", "width_m=4.0", "ttc.horizon_s=inf", 'note="4"']
