"""The layout that `make bundle` makes and the script that starts it, without packing a whole folder."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import bundle
import pytest

PRINTS_ITS_SURROUNDINGS = """#!/bin/sh
echo "home=$PYTHONHOME venv=$HARMZONE_VENV path=${PYTHONPATH-unset} user_site_off=$PYTHONNOUSERSITE"
echo "arguments=$*"
"""


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


def lay_out(folder: Path, glibc: str) -> Path:
    write(folder / "bin" / "harmzone", PRINTS_ITS_SURROUNDINGS)
    return write(folder / "harmzone", bundle.launcher_text(glibc))


def start(launcher: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    return subprocess.run([launcher, *arguments], env=os.environ | variables, capture_output=True, text=True)


def test_the_folder_starts_with_its_own_python_whatever_the_variables_say(tmp_path):
    folder = tmp_path / "a folder"
    lay_out(folder, "2.1")
    link = tmp_path / "harmzone"
    link.symlink_to(folder / "harmzone")
    found = start(
        link, "gen", "--town", "a b", PYTHONHOME="/wrong", PYTHONPATH="/wrong", HARMZONE_VENV="/wrong"
    )
    surroundings = f"home={folder} venv={folder} path=unset user_site_off=1"
    assert found.stdout == f"{surroundings}\narguments=gen --town a b\n", found.stderr


def test_a_glibc_that_is_too_old_is_told_with_both_versions(tmp_path):
    found = start(lay_out(tmp_path, "99.1"), "doctor")
    own = os.confstr("CS_GNU_LIBC_VERSION").removeprefix("glibc ")
    assert found.returncode == 1 and found.stdout == ""
    assert found.stderr == f"harmzone: this system has glibc {own}; needed is glibc 99.1 or newer\n"


def test_versions_are_compared_by_number(tmp_path):
    # As text, 2.4 is newer than 2.36.
    assert start(lay_out(tmp_path, "2.4")).returncode == 0


def test_patterns_name_paths_within_a_package():
    dropped = bundle.DROPPED["mujoco"]
    for name in ("viewer.py", "doc/a/b.rst", "rollout.py", "_rollout.cpython-311-x86_64-linux-gnu.so"):
        assert bundle.matches(name, dropped), name
    for name in ("__init__.py", "egl/__init__.py", "libmujoco.so.4.0.0", "rendering/classic/renderer.py"):
        assert not bundle.matches(name, dropped), name
    assert bundle.is_kept_of_stdlib("traceback.py") and bundle.is_kept_of_stdlib("email/message.py")
    assert bundle.is_kept_of_stdlib("importlib/abc.py") and not bundle.is_kept_of_stdlib("tkinter/ttk.py")
    assert bundle.is_kept_of_stdlib("encodings/utf_8.py") and not bundle.is_kept_of_stdlib("encodings/gbk.py")


def test_a_package_is_importable_from_its_compiled_modules_alone(tmp_path):
    source = tmp_path / "source" / "numpy"
    write(source / "__init__.py", "from numpy.inner import ANSWER as ANSWER\n")
    write(source / "inner.py", '"""Documented."""\nANSWER = 42\n')
    write(source / "tests" / "test_inner.py", "import pytest\n")
    write(source / "inner.pyi", "ANSWER: int\n")
    site = tmp_path / "site"
    bundle.copy_package(source, site / "numpy", bundle.DROPPED["numpy"])
    assert sorted(path.name for path in site.rglob("*.*")) == ["__init__.pyc", "inner.pyc"]
    assert imported(site, "numpy; print(numpy.ANSWER, numpy.inner.__doc__)") == "42 None"


def test_zipped_modules_are_importable_and_have_the_same_bytes_each_time(tmp_path):
    source = tmp_path / "source"
    write(source / "__init__.py", "")
    write(source / "email.py", "WHO = __name__\n")
    write(source / "tkinter" / "__init__.py", "")
    archives = [tmp_path / name for name in ("one.zip", "two.zip")]
    for archive in archives:
        with zipfile.ZipFile(archive, "w") as file:
            bundle.zip_modules(file, source, "shipped/", bundle.is_kept_of_stdlib)
        os.utime(source / "email.py", (0, 0))
    assert archives[0].read_bytes() == archives[1].read_bytes()
    assert zipfile.ZipFile(archives[0]).namelist() == ["shipped/__init__.pyc", "shipped/email.pyc"]
    assert imported(archives[0], "shipped.email; print(shipped.email.WHO)") == "shipped.email"


def imported(path: Path, code: str) -> str:
    """What the rest of an import statement prints in a fresh Python with `path` first."""
    command = [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(path)!r}); import {code}"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_the_packages_packed_are_those_that_the_program_is_built_and_tested_with():
    def pins(name: str) -> dict[str, str]:
        text = (bundle.ROOT / name).read_text()
        return dict(re.findall(r"^([A-Za-z-]+)(?:\[.*\])?==([0-9.]+)", text, re.MULTILINE))

    product = pins("requirements.txt")
    packed = pins("requirements-bundle.txt") | pins("requirements-bundle-source.txt")
    shared = product.keys() & packed.keys()
    assert shared == {"mujoco-core", "numpy", "PyOpenGL"}
    assert {name: packed[name] for name in shared} == {name: product[name] for name in shared}


def test_the_glibc_needed_is_the_newest_that_any_library_names(tmp_path):
    (tmp_path / "program").write_bytes(Path(sys.executable).read_bytes())
    write(tmp_path / "text.so", "no library")
    assert bundle.binaries(tmp_path) == [tmp_path / "program"]
    assert "libc.so.6" in bundle.needed_libraries(tmp_path / "program")
    parts = [int(part) for part in bundle.glibc_needed(tmp_path).split(".")]
    own = [int(part) for part in os.confstr("CS_GNU_LIBC_VERSION").removeprefix("glibc ").split(".")]
    assert [2, 2] <= parts <= own


def test_a_folder_that_is_too_large_is_refused_and_the_former_one_stays(tmp_path, monkeypatch):
    out = tmp_path / "dist"
    write(out / "harmzone", "the former one")
    monkeypatch.setattr(bundle, "pack", lambda _, folder: write(folder / "bin" / "harmzone", "x" * 5000))
    monkeypatch.setattr(bundle, "examine", lambda _: None)
    monkeypatch.setattr(bundle, "MAX_BYTES", 4096)
    with pytest.raises(SystemExit, match=r"more than the 0\.0 MiB allowed"):
        bundle.main(tmp_path / "program", out)
    assert (out / "harmzone").read_text() == "the former one"
