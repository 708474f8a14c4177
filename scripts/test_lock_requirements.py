"""The lists of pins: which hashes `make lock` writes, and that every pin has some."""

import re

import lock_requirements as locking
import pytest

# Made up; the hash of a file is its name.
FILES = {
    "tool": ["tool-1.0-py3-none-any.whl", "tool-1.0.tar.gz"],
    "fast": [
        "fast-2.0-cp310-cp310-manylinux_2_28_x86_64.whl",
        "fast-2.0-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
        "fast-2.0-cp311-cp311-musllinux_1_2_x86_64.whl",
        "fast-2.0-cp311-cp311-win_amd64.whl",
        "fast-2.0-cp312-abi3-manylinux_2_28_x86_64.whl",
        "fast-2.0-cp314-cp314t-manylinux_2_28_x86_64.whl",
        "fast-2.0.tar.gz",
    ],
}
TEXT = """# Why these.
-r requirements.txt

tool==1.0
fast[more]==2.0 \\
    --hash=sha256:old \\
    --hash=sha256:older
# The end.
"""


def test_comments_and_order_stay_and_old_hashes_go():
    files = {name: {file: file for file in files} for name, files in FILES.items()}
    assert (
        locking.lock(TEXT, files, locking.Wanted(machines=("x86_64",)))
        == """# Why these.
-r requirements.txt

tool==1.0 \\
    --hash=sha256:tool-1.0-py3-none-any.whl
fast[more]==2.0 \\
    --hash=sha256:fast-2.0-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl \\
    --hash=sha256:fast-2.0-cp312-abi3-manylinux_2_28_x86_64.whl
# The end.
"""
    )


def test_a_machine_without_a_wheel_gets_the_source():
    kept = locking.kept_files(FILES["fast"], locking.Wanted())
    assert kept == [FILES["fast"][1], FILES["fast"][4], "fast-2.0.tar.gz"]
    assert locking.kept_files(FILES["tool"], locking.Wanted(is_source=True)) == ["tool-1.0.tar.gz"]


def test_a_package_without_any_file_for_the_machine_is_told():
    with pytest.raises(
        SystemExit, match=r"tool==1\.0 has no file for x86_64, aarch64: tool-1\.0-cp311-cp311-win"
    ):
        locking.lock("tool==1.0\n", {"tool": {"tool-1.0-cp311-cp311-win_amd64.whl": "x"}}, locking.Wanted())


def test_every_list_is_known_and_every_pin_has_hashes():
    lists = {path.relative_to(locking.ROOT).as_posix() for path in locking.ROOT.glob("requirements*.txt")}
    lists |= {
        path.relative_to(locking.ROOT).as_posix() for path in locking.ROOT.glob("tests/*/requirements*.txt")
    }
    assert lists == set(locking.LISTS)
    for name in lists:
        text = (locking.ROOT / name).read_text()
        left = [line for line in locking.PIN.sub("", text).splitlines() if line.strip()]
        assert all(line.startswith(("#", "-r ")) for line in left), (name, left)
        for found in locking.PIN.finditer(text):
            hashes = found[0].removeprefix(found["pin"])
            assert re.fullmatch(r"(\s+\\?\s*--hash=sha256:[0-9a-f]{64})+", hashes), (name, found["pin"])
