"""The commands as functions.

Each is `python -m harmzone COMMAND ..` in a process of its own, which an interrupt ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harmzone._data import Dataset
from harmzone._native import HarmzoneError
from harmzone._place import is_url
from harmzone._settings import by_dotted_key, plain, toml

if TYPE_CHECKING:
    PathText = str | os.PathLike[str]
    # Numbers of numpy and its arrays, too.
    Setting = str | float | bool | list[Any] | tuple[Any, ...] | Mapping[str, Any]
    Flag = Setting | os.PathLike[str] | None

# Exit code of a command that is done, but for a part that it names.
_WITH_LOSSES = 3


class CommandError(HarmzoneError):
    """A command failed; its text is what the command says.

    `returncode`: 1 failed, 2 wrong usage, 3 a part is missing.
    """

    def __init__(self, text: str, returncode: int) -> None:
        super().__init__(text)
        self.returncode = returncode

    def __reduce__(self) -> tuple[type[CommandError], tuple[str, int]]:
        return type(self), (str(self), self.returncode)


def run(*words: PathText | float, quiet: bool = False) -> str:
    """Run `harmzone` with these arguments; returns what it writes to standard output.

    Its standard error (progress, warnings) goes to Python's, unless `quiet`.

    Raises:
        CommandError: the command failed, or a part of what was asked for is missing.

    """
    command = [
        sys.executable,
        "-P",
        "-m",
        "harmzone",
        *(os.fspath(w) if isinstance(w, os.PathLike) else str(w) for w in words),
    ]
    said: list[str] = []
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
    ) as process:

        def pass_on() -> None:
            for line in process.stderr or ():
                said.append(line)
                del said[:-200]
                if not quiet:
                    # A closed standard error must not stop the command.
                    with contextlib.suppress(AttributeError, OSError, ValueError):
                        sys.stderr.write(line)

        listener = threading.Thread(target=pass_on, daemon=True)
        listener.start()
        try:
            answer = process.stdout.read() if process.stdout else ""
            process.wait()
        except BaseException:
            process.kill()
            raise
        finally:
            listener.join()
    if process.returncode:
        raise CommandError(_told(said, process.returncode), process.returncode)
    return answer


def _told(said: list[str], returncode: int) -> str:
    """What a command said of its failure: from its last line that begins so, or all of the end."""
    begin = next((i for i in reversed(range(len(said))) if said[i].startswith("error: ")), None)
    if begin is None:
        end = "".join(said[-15:]).strip()
        how = "left a part out" if returncode == _WITH_LOSSES else f"ended with code {returncode}"
        return f"harmzone {how}: {end}" if end else f"harmzone {how}"
    return "".join(said[begin:]).removeprefix("error: ").strip()


def _options(flags: Mapping[str, Flag]) -> list[str]:
    """`preset="demo", ood=True, set={"sample_period_s": 0.9}` as a command line takes them."""
    words: list[str] = []
    for name, given in flags.items():
        flag, value = "--" + name.rstrip("_").replace("_", "-"), plain(given)
        if name == "set" and value is not None:
            words += _overrides(value)
        elif value is True:
            words.append(flag)
        elif value is None or value is False:
            continue
        elif isinstance(value, list | tuple):
            words += [flag, ",".join(str(part) for part in value)]
        else:
            words += [flag, os.fspath(value) if isinstance(value, os.PathLike) else str(value)]
    return words


def _overrides(settings: object) -> list[str]:
    """`--set KEY=VALUE` for each setting. Text stands as it is, as in a shell."""
    if not isinstance(settings, Mapping):
        raise TypeError(f'`set` is {settings!r}; valid is a dictionary, such as {{"val_every": 2}}')
    words: list[str] = []
    for key, value in by_dotted_key(settings):
        words += ["--set", f"{key}={value if isinstance(value, str) else toml(key, value)}"]
    return words


def gen(out: PathText, *, quiet: bool = False, **flags: Flag) -> Dataset:
    """Make a data set: `harmzone gen --out OUT`, with its flags as keywords.

    >>> data = gen("data", preset="demo", town="oldtown", episodes=2, set={"samples": 4})  # doctest: +SKIP

    Returns:
        The data set, without labels.

    """
    run("gen", "--out", out, *_options(flags), quiet=quiet)
    return _made(out)


def label(data: PathText | Dataset, *, quiet: bool = False, **flags: Flag) -> Dataset:
    """Label the objects of a data set harmful or harmless: `harmzone label DATA`.

    Returns:
        The data set, of the same split, with its labels.

    """
    place, split = _place_of(data), data.split if isinstance(data, Dataset) else None
    summary = json.loads(run("label", place, "--json", *_options(flags), quiet=quiet))
    return _made(place, split=split, labels=summary["set"])


def train(data: PathText | Dataset, out: PathText, *, quiet: bool = False, **flags: Flag) -> Path | str:
    """Train a detector: `harmzone train DATA --out OUT`. The same call goes on with what was interrupted.

    A `Dataset` also says by which labels; training and validation take the splits `train` and `val`.

    Returns:
        The run's folder, which `Detector`, `predict` and `evaluate` take; or its URL, which `predict` and
        `evaluate` take.

    """
    run("train", _place_of(data), "--out", out, *_options(_said_by(data, "labels") | flags), quiet=quiet)
    return os.fspath(out) if is_url(out) else Path(out)


def predict(run_: PathText, data: PathText | Dataset, *, quiet: bool = False, **flags: Flag) -> str:
    """Write a detector's boxes for a data set: `harmzone predict RUN --data DATA`; returns what it says."""
    return run(
        "predict", run_, "--data", _place_of(data), *_options(_said_by(data, "split") | flags), quiet=quiet
    )


def evaluate(
    run_: PathText, data: PathText | Dataset, *, quiet: bool = False, **flags: Flag
) -> dict[str, Any]:
    """Score a detector: `harmzone eval RUN --data DATA`.

    Args:
        run_: a run's folder or URL, a checkpoint, or `small`, the network inside.
        data: a labelled data set; a `Dataset` also says which split and which labels.
        quiet: without progress.
        flags: those of `harmzone eval`: `ood=True`, `split="val"`; `out=DIR` keeps the files, in a folder or
            at a URL.

    Returns:
        `metrics.json`, as docs/evaluation.md describes it. Where `out` is a URL, it lacks the file's
        `format_version` and `sha256`.

    """
    flags = _said_by(data, "split", "labels") | flags
    with tempfile.TemporaryDirectory() as folder:
        out = flags.pop("out", None) or folder
        words = ["eval", run_, "--data", _place_of(data), "--out", out]
        if is_url(out):
            # The command refuses `--json` beside `--breakdown`, which only prints more.
            flags |= {"json": True, "breakdown": None}
            return json.loads(run(*words, *_options(flags), quiet=quiet))
        run(*words, *_options(flags), quiet=quiet)
        return json.loads((Path(out) / "metrics.json").read_text(encoding="utf-8"))


def _said_by(data: PathText | Dataset, *names: str) -> dict[str, Flag]:
    """Flags that a data set says by itself."""
    return {name: getattr(data, name) for name in names} if isinstance(data, Dataset) else {}


def _place_of(data: PathText | Dataset) -> PathText:
    return data.place if isinstance(data, Dataset) else data


def _made(place: PathText, *, split: str | None = None, labels: str | None = None) -> Dataset:
    """What a command made.

    A URL is opened only when it is read: no command can write there while this process has it open.
    """
    opened = Dataset._when_read if is_url(place) else Dataset
    return opened(place, split=split, labels=labels)
