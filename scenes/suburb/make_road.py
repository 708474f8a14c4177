# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Suburb: winding residential streets on rolling ground, 30 km/h, cars parked in bays at the kerb."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, write_town

WALK = Lane("sidewalk", 1.8)
DRIVE = Lane("driving", 3.2, "curb")


def bay(first: float, last: float) -> Lane:
    return Lane("parking", 2.1, "curb", (first, last))


PLAIN = Profile((DRIVE, WALK), (DRIVE, WALK), 30, centre="none")
BAYS_RIGHT = Profile((DRIVE, bay(0.2, 0.8), WALK), (DRIVE, WALK), 30, centre="none")
BAYS_BOTH = Profile((DRIVE, bay(0.15, 0.5), WALK), (DRIVE, bay(0.5, 0.85), WALK), 30, centre="none")

# Number, x, y, height.
CROSSINGS = (
    (101, -60, -160, 0.0), (102, 75, -150, 2.6), (103, -190, -15, 3.2), (104, -55, -40, 0.8),
    (105, 62, -28, 4.2), (106, 195, -12, 0.6), (107, -45, 92, 4.6), (108, 78, 108, 1.4),
)  # fmt: skip
# Start, end, profile, points on the way.
STREETS = (
    (101, 102, BAYS_RIGHT, ((5, -140),)),
    (102, 101, PLAIN, ((70, -215), (5, -238), (-55, -222))),
    (101, 103, BAYS_BOTH, ((-130, -165), (-185, -130))),
    (102, 106, BAYS_BOTH, ((140, -160), (188, -112))),
    (103, 104, PLAIN, ((-150, -38), (-105, -32))),
    (104, 105, BAYS_BOTH, ((-12, -48), (25, -18))),
    (105, 106, BAYS_RIGHT, ((110, -42), (150, -10))),
    (101, 104, BAYS_RIGHT, ((-75, -120), (-45, -80))),
    (102, 105, PLAIN, ((90, -110), (62, -70))),
    (104, 107, PLAIN, ((-70, 10), (-40, 48))),
    (105, 108, BAYS_RIGHT, ((50, 22), (82, 62))),
    (107, 108, BAYS_BOTH, ((15, 78),)),
    (103, 107, PLAIN, ((-205, 50), (-165, 105), (-105, 112))),
    (108, 106, PLAIN, ((140, 128), (200, 95), (212, 45))),
)


def main() -> None:
    crossings = [Crossing(n, x, y, z, kerb_radius_m=5.0) for n, x, y, z in CROSSINGS]
    streets = [
        Street(k, start, end, profile, via, name=f"street {k}")
        for k, (start, end, profile, via) in enumerate(STREETS, start=1)
    ]
    write_town("suburb", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
