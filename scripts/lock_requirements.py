"""Writes the hashes behind every pin of the requirements files, as the index tells them (`make lock`).

Only `NAME==VERSION` is read: to raise a version, change it, run `make lock`, read the difference. Comments,
`-r` lines and the order stay. A pin gets the hashes of the files that PYTHONS on MACHINES install: the wheels
that fit one of them, and the source archive if one of them has no wheel. uv asks the index.

Usage: lock_requirements.py [FILE ..], a file being as tests/golden/requirements.txt
"""

import re
import subprocess
import sys
import tomllib
import urllib.parse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from packaging.tags import Tag
from packaging.utils import canonicalize_name, parse_wheel_filename

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ((3, 11), (3, 12), (3, 13), (3, 14))
MACHINES = ("x86_64", "aarch64")
# A pin with all that belongs to it: the rest of its line, and the lines that a backslash adds.
PIN = re.compile(
    r"^(?P<pin>(?P<name>[\w.-]+)(?:\[[\w,-]+\])?==(?P<version>[\w.+!]+))(?:[^\n]*\\\n)*[^\n]*$", re.MULTILINE
)


@dataclass(frozen=True)
class Wanted:
    """Which files of a package a list names."""

    machines: tuple[str, ...] = MACHINES
    # The source archive alone, on the pin's own line.
    is_source: bool = False


LISTS = {
    "requirements.txt": Wanted(),
    "requirements-test.txt": Wanted(),
    "requirements-wheel.txt": Wanted(),
    "requirements-supply.txt": Wanted(),
    "requirements-bundle.txt": Wanted(machines=("x86_64",)),
    "requirements-bundle-source.txt": Wanted(is_source=True),
    "tests/golden/requirements.txt": Wanted(),
    "tests/golden/requirements-cuda.txt": Wanted(),
    "tests/import/requirements.txt": Wanted(),
    "tests/import/requirements-mmdet3d.txt": Wanted(),
}


def main(names: Iterable[str]) -> None:
    """Locks the lists and tells how many hashes each has."""
    total = 0
    for name in names:
        if name not in LISTS:
            sys.exit(f"lock: no list is called {name}; there are {', '.join(LISTS)}")
        path = ROOT / name
        text = path.read_text()
        locked = lock(text, files_of_pins(text), LISTS[name])
        if locked != text:
            path.write_text(locked)
        n_hashes = locked.count("--hash=sha256:")
        total += n_hashes
        told = "rewritten" if locked != text else "unchanged"
        print(f"{len(PIN.findall(locked)):5} pins {n_hashes:5} hashes  {told}  {name}")
    print(f"{total:16} hashes")


def files_of_pins(text: str) -> dict[str, dict[str, str]]:
    """All files of each pinned version with their SHA-256: `{canonical name: {file name: hash}}`."""
    pins = "".join(f"{found['name']}=={found['version']}\n" for found in PIN.finditer(text))
    command = [
        *("uv", "pip", "compile", "--quiet", "--no-config", "--no-deps", "--universal", "--refresh"),
        *("--python-version", ".".join(map(str, PYTHONS[0])), "--format", "pylock.toml", "-"),
    ]
    command[0] = str(Path(sys.executable).with_name("uv"))
    done = subprocess.run(command, input=pins, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"lock: uv could not read the index:\n{done.stderr}")
    return files_of_lock(done.stdout)


def files_of_lock(pylock: str) -> dict[str, dict[str, str]]:
    """The files that a `pylock.toml` names."""
    found = {}
    for package in tomllib.loads(pylock)["packages"]:
        files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
        hashes = {name_of_file(file): file["hashes"]["sha256"] for file in files}
        found[canonicalize_name(package["name"])] = hashes
    return found


def name_of_file(file: dict) -> str:
    """A file's name; a lock file may leave it to the address."""
    return file.get("name") or urllib.parse.unquote(file["url"].rsplit("/", 1)[1])


def lock(text: str, files: dict[str, dict[str, str]], wanted: Wanted) -> str:
    """The list with the hashes of the given files behind its pins."""

    def locked(found: re.Match) -> str:
        of_package = files[canonicalize_name(found["name"])]
        kept = kept_files(of_package, wanted)
        if not kept:
            machines = ", ".join(wanted.machines)
            sys.exit(f"lock: {found['pin']} has no file for {machines}: {', '.join(of_package)}")
        between = " " if wanted.is_source else " \\\n    "
        return between.join([found["pin"], *(f"--hash=sha256:{of_package[name]}" for name in kept)])

    return PIN.sub(locked, text)


def kept_files(names: Iterable[str], wanted: Wanted) -> list[str]:
    """The files that a platform installs, in order."""
    wheels = {name: parse_wheel_filename(name)[3] for name in names if name.endswith(".whl")}
    archives = sorted(name for name in names if not name.endswith(".whl"))
    if wanted.is_source:
        return archives
    platforms = [(python, machine) for python in PYTHONS for machine in wanted.machines]
    kept = [name for name in sorted(wheels) if any(fits(wheels[name], *platform) for platform in platforms)]
    if all(any(fits(wheels[name], *platform) for name in kept) for platform in platforms):
        return kept
    return kept + archives


def fits(tags: Iterable[Tag], python: tuple[int, int], machine: str) -> bool:
    """Whether a wheel can be installed with CPython on a Linux with glibc, of whatever age."""
    platform = re.compile(rf"any|manylinux\w*_{machine}")
    return any(fits_python(tag, python) and platform.fullmatch(tag.platform) for tag in tags)


def fits_python(tag: Tag, python: tuple[int, int]) -> bool:
    """Whether a tag's interpreter and ABI are those of CPython of this version."""
    found = re.fullmatch(r"(py|cp)(\d)(\d*)", tag.interpreter)
    if found is None:
        return False
    kind, version = found[1], (int(found[2]), int(found[3] or 0))
    if tag.abi == f"cp{python[0]}{python[1]}":
        return version == python
    is_any_abi = tag.abi == "none" and (kind == "py" or version == python)
    return version[0] == 3 and version <= python and (is_any_abi or (kind == "cp" and tag.abi == "abi3"))


if __name__ == "__main__":
    main(sys.argv[1:] or LISTS)
