"""The page of the Python module in the docs is what its sources and stubs say."""

from pathlib import Path

import python_reference

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "python.md"


def test_the_page_is_what_the_sources_say():
    assert PAGE.read_text() == python_reference.page(), "docs/reference/python.md is old: make reference"


def test_every_public_name_is_on_the_page():
    page = python_reference.page()
    for name in ("Dataset", "Detector", "Zone", "evaluate", "gen", "to_torch"):
        assert f"\n## {name}\n" in page
