"""One damage to an input: a name, what is done to a copy, and what the program must say of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Case:
    """One damage: what is done to a copy of the source, and words of which the program must say one."""

    source: str
    name: str
    words: str  # a regular expression, in lower case
    damage: Callable[[Path], None]
    fails: bool | None = None  # whether it must fail (True), must go on (False), or either
    skippable: bool = False  # one sample or drive of several, which --skip-bad leaves out


CASES: list[Case] = []


def case(source: str, name: str, words: str, fails: bool | None = None, skippable: bool = False) -> Callable:
    """Registers a damage."""

    def register(damage: Callable[[Path], None]) -> Callable[[Path], None]:
        CASES.append(Case(source, name, words, damage, fails, skippable))
        return damage

    return register


def write(path: Path, payload: bytes | str) -> None:
    """Replaces a file of the copy."""
    path.unlink(missing_ok=True)
    path.write_bytes(payload.encode() if isinstance(payload, str) else payload)


def copy(source: Path, target: Path) -> None:
    """Copies a folder; the copy may be written to, whatever the source is."""
    shutil.copytree(source, target, copy_function=shutil.copyfile)
