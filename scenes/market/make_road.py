# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Market: wide streets between halls and yards, flat, with turns that trucks can drive.

Bays of 3 m for vans and trucks lie along the streets. The pavement beside the market place is wide
enough for stalls.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, write_town

DRIVE = Lane("driving", 4.0, "curb")
WALK, STALLS = Lane("sidewalk", 2.0), Lane("sidewalk", 6.0)


def bay(first: float, last: float) -> Lane:
    return Lane("parking", 3.0, "curb", (first, last))


PLAIN = Profile((DRIVE, WALK), (DRIVE, WALK), 50)
BAYS = Profile((DRIVE, bay(0.2, 0.8), WALK), (DRIVE, WALK), 50)
BAYS_BOTH = Profile((DRIVE, bay(0.1, 0.6), WALK), (DRIVE, bay(0.4, 0.9), WALK), 50)
PLACE = Profile((DRIVE, STALLS), (DRIVE, STALLS), 30)

CROSSINGS = (
    (101, -95, -120), (102, 60, -130), (103, -195, -10), (104, -75, 0),
    (105, 75, 5), (106, 195, -5), (107, -60, 120), (108, 85, 130),
)  # fmt: skip
STREETS = (
    (101, 102, BAYS, ()),
    (101, 103, BAYS_BOTH, ((-165, -115), (-198, -80))),
    (102, 106, BAYS, ((150, -132), (196, -88))),
    (103, 104, PLAIN, ()),
    (104, 105, PLACE, ()),
    (105, 106, BAYS_BOTH, ()),
    (101, 104, PLACE, ()),
    (102, 105, BAYS, ()),
    (104, 107, BAYS_BOTH, ()),
    (105, 108, PLACE, ()),
    (107, 108, BAYS, ()),
    (103, 107, BAYS, ((-198, 70), (-160, 116))),
    (108, 106, BAYS_BOTH, ((155, 132), (198, 90))),
)


def main() -> None:
    crossings = [Crossing(n, x, y, kerb_radius_m=10.0, least_m=9.0) for n, x, y in CROSSINGS]
    streets = [
        Street(k, start, end, profile, via, name=f"street {k}")
        for k, (start, end, profile, via) in enumerate(STREETS, start=1)
    ]
    write_town("market", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
