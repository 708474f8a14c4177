# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Harbour: quays round a basin, a roundabout, staggered crossings, dead ends with turning loops.

Quays have a wide pavement on the side of the water and no centre line, the road behind them
shoulders. The roundabout is a ring of four crossings; who comes from outside gives way.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, bend, write_town

WALK, QUAYSIDE = Lane("sidewalk", 2.2), Lane("sidewalk", 4.0)
WIDE, LANE = Lane("driving", 4.25, "curb"), Lane("driving", 3.25, "solid")
NARROW = Lane("driving", 3.1, "curb")
SHOULDER = Lane("shoulder", 1.6, "curb", (0.12, 0.88))
QUAY = Profile((WIDE, QUAYSIDE), (WIDE, WALK), 30, centre="none")
FREIGHT = Profile((LANE, SHOULDER, WALK), (LANE, SHOULDER, WALK), 60, centre="solid")
LINK = Profile((WIDE, WALK), (WIDE, WALK), 40, centre="broken")
SHEDS = Profile((NARROW, WALK), (NARROW, Lane("parking", 2.8, "curb", (0.2, 0.8)), WALK), 30, centre="none")
# One way; the road's line is the left kerb.
RING = Profile((Lane("driving", 5.0, "curb"), WALK), (), 30, centre="solid")
LOOP = Profile((Lane("driving", 4.6, "curb"), WALK), (), 20, centre="none")

# The roundabout's middle and the radius of its island.
MIDDLE, ISLAND_M = (0, 58), 24.0
# Half of the circle's turn from a crossing's middle to its end.
LEAN_DEG = 12
RING_ARMS = {111: 0, 112: 90, 113: 180, 114: 270}
# Number, x, y.
CROSSINGS = (
    (101, -195, -84), (103, -75, -12), (104, 66, -14), (105, 148, -93), (107, 215, 18),
    (108, -128, 62), (109, 84, 56), (110, 137, 60), (115, 0, -16),
    (116, -205, 148), (120, -140, 150), (121, 110, 152), (122, 0, 148),
)  # fmt: skip
# Start, end, profile, points on the way, headings away from both crossings (degrees; None: direct).
STREETS = (
    (101, 103, QUAY, (*((-150, -93), (-112, -93)), *bend((-105, -63), 30, -80, -10), (-75, -50)), (-12, 270)),
    (103, 115, QUAY, (), (None, None)),
    (115, 104, QUAY, (), (None, None)),
    (104, 105, QUAY, ((66, -50), *bend((96, -63), 30, 190, 260)), (270, 180)),
    (105, 107, LINK, ((180, -93), *bend((185, -63), 30, -80, -10), (215, -40)), (0, 270)),
    (103, 108, LINK, ((-112, 16),), (150, -65)),
    (104, 109, LINK, ((78, 16),), (75, 270)),
    (105, 110, SHEDS, ((150, -40), (140, 10)), (90, -85)),
    (115, 114, LINK, (), (90, 270)),
    (111, 109, FREIGHT, (), (0, 180)),
    (109, 110, FREIGHT, (), (0, 180)),
    (110, 107, FREIGHT, ((180, 52),), (0, 130)),
    (113, 108, FREIGHT, (), (180, 0)),
    (112, 122, LINK, (), (90, 270)),
    (108, 120, FREIGHT, ((-150, 105),), (125, 275)),
    (120, 122, SHEDS, ((-70, 160),), (10, 180)),
    (122, 121, SHEDS, ((55, 142),), (0, 185)),
    (121, 110, LINK, ((128, 105),), (-60, 95)),
    (121, 107, FREIGHT, ((165, 158), *bend((190, 120), 36, 80, 0), (226, 70)), (15, 65)),
    (120, 116, SHEDS, (), (180, 0)),
    (101, 101, LOOP, bend((-221, -76), 17, 90, 270), (130, 215)),
    (116, 116, LOOP, bend((-231, 148), 17, 90, 270), (130, 230)),
)  # fmt: skip


def main() -> None:
    crossings = [
        Crossing(n, x, y, kerb_radius_m=9.0, least_m=8.0, has_lights=n in (109, 110)) for n, x, y in CROSSINGS
    ]
    streets = [
        Street(k, start, end, profile, via, f"street {k}", *degrees)
        for k, (start, end, profile, via, degrees) in enumerate(STREETS, start=1)
    ]
    ring = list(RING_ARMS.items())
    for k, (n, degrees) in enumerate(ring):
        angle = math.radians(degrees)
        x, y = (MIDDLE[i] + ISLAND_M * part for i, part in enumerate((math.cos(angle), math.sin(angle))))
        yields = frozenset(street.id for street in streets if n in (street.start, street.end))
        crossings.append(Crossing(n, x, y, kerb_radius_m=7.0, least_m=6.0, yields=yields))
        following = ring[(k + 1) % len(ring)]
        streets.append(Street(
            len(STREETS) + 1 + k, n, following[0], RING, name="roundabout",
            start_deg=degrees + 90 + LEAN_DEG, end_deg=following[1] - 90 - LEAN_DEG,
        ))  # fmt: skip
    write_town("harbour", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
