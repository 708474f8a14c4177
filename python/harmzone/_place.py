"""Where a data set, a run or scores lie: at a path of this machine, or at a URL."""

from __future__ import annotations

import os
import re

# As the command line tells them apart.
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def is_url(place: str | os.PathLike[str]) -> bool:
    """Whether a place is a URL, such as `s3://lab/data`."""
    text = os.fspath(place)
    return isinstance(text, str) and _URL.match(text) is not None
