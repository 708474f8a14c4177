# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Arterial: a boulevard of three lanes each way with a median, a ring of two and two, side streets.

80, 60 and 50 km/h. All crossings with the boulevard and those of the ring with the big side street
have lights; where three lanes arrive, the innermost is for left turns. Bus bays lie in the
boulevard.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, driving, write_town

WALK = Lane("sidewalk", 3.0)
MEDIAN = Lane("median", 1.5, "solid")
BUS_BAY = Lane("stop", 3.0, "curb", (0.5, 0.85))
BOULEVARD = Profile(
    (MEDIAN, *driving(3, 3.5), WALK), (MEDIAN, *driving(3, 3.5), WALK), 80, centre="none"
)  # fmt: skip
BOULEVARD_BAYS = Profile(
    (MEDIAN, *driving(3, 3.5, "solid"), BUS_BAY, WALK),
    (MEDIAN, *driving(3, 3.5, "solid"), Lane("stop", 3.0, "curb", (0.15, 0.5)), WALK),
    80, centre="none",
)  # fmt: skip
RING = Profile((*driving(2, 3.4), WALK), (*driving(2, 3.4), WALK), 60, centre="solid")
BIG_SIDE = Profile((*driving(2, 3.25), WALK), (*driving(2, 3.25), WALK), 50, centre="solid")
SIDE = Profile((*driving(1, 3.5), WALK), (*driving(1, 3.5), WALK), 50)

# Number, x, y, lights.
CROSSINGS = (
    (101, -235, 4, True), (102, -85, 12, True), (103, 85, -10, True), (104, 235, 0, True),
    (105, -85, 150, True), (106, 85, 145, False), (107, -85, -140, True), (108, 85, -150, False),
)  # fmt: skip
# Start, end, profile, points on the way, headings away from both crossings (degrees; None: direct).
STREETS = (
    (101, 102, BOULEVARD, ((-160, 14),), (8, None)),
    (102, 103, BOULEVARD_BAYS, (), (-4, 172)),
    (103, 104, BOULEVARD, ((160, -12),), (-4, 184)),
    (101, 105, RING, ((-235, 90), (-185, 145)), (90, 180)),
    (105, 106, SIDE, ((0, 155),), (None, None)),
    (106, 104, RING, ((185, 145), (235, 90)), (0, 90)),
    (104, 108, RING, ((235, -95), (185, -150)), (-90, 0)),
    (108, 107, SIDE, ((0, -138),), (None, None)),
    (107, 101, RING, ((-185, -140), (-235, -90)), (180, -90)),
    (102, 105, BIG_SIDE, (), (None, None)),
    (107, 102, BIG_SIDE, (), (None, None)),
    (103, 106, SIDE, ((92, 70),), (None, None)),
    (108, 103, SIDE, ((80, -80),), (None, None)),
)


def main() -> None:
    crossings = [
        Crossing(n, x, y, kerb_radius_m=9.0, has_lights=lights, least_m=8.0) for n, x, y, lights in CROSSINGS
    ]
    streets = [
        Street(k, start, end, profile, via, f"street {k}", *degrees)
        for k, (start, end, profile, via, degrees) in enumerate(STREETS, start=1)
    ]
    write_town("arterial", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
