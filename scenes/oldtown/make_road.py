# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Old town: three rings of narrow streets on a low hill, and lanes between them.

The inner ring round the square is one-way, and so are the lanes that lead to it. Streets leave
their crossings along the rings or towards the middle, a few degrees off, so no two look alike.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, write_town

WALK = Lane("sidewalk", 1.1)
DRIVE = Lane("driving", 2.8, "curb")
STREET = Profile((DRIVE, WALK), (DRIVE, WALK), 30, centre="none")
# A single lane; the road's line is its left kerb.
ONE_WAY = Profile((Lane("driving", 3.4, "curb"), WALK), (WALK,), 20, centre="none")

# Angle in degrees, radius and height in metres of the crossings of each ring.
INNER = ((5, 46, 3.6), (78, 37, 3.2), (150, 47, 3.5), (222, 38, 3.8), (295, 45, 3.3))
MIDDLE = (
    (0, 100, 1.9), (45, 86, 1.6), (86, 92, 1.5), (142, 104, 1.8),
    (190, 90, 2.2), (229, 92, 2.1), (263, 88, 1.7), (301, 102, 1.6),
)  # fmt: skip
OUTER = (
    (350, 160, 0.4), (40, 136, 0.0), (93, 144, 0.3), (136, 164, 0.2),
    (186, 140, 0.8), (236, 152, 0.5), (268, 136, 0.2), (307, 162, 0.0),
)  # fmt: skip
# Which crossings a lane joins: (inner, middle) and (middle, outer), by rank.
INWARD, OUTWARD = {0: 0, 2: 3, 4: 7}, {1: 2, 3: 5}
OUTER_LANES = {0: 0, 1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 6, 7: 7}
LEAN_DEG = (9, -11, 6, 12, -10, -7, 11, -9)


def main() -> None:
    crossings, streets = [], []
    rings = {100: INNER, 110: MIDDLE, 120: OUTER}
    for first, ring in rings.items():
        for k, (degrees, radius, z) in enumerate(ring):
            x, y = radius * math.cos(math.radians(degrees)), radius * math.sin(math.radians(degrees))
            crossings.append(Crossing(
                first + k, x, y, z, kerb_radius_m=4.6, has_crosswalks=first == 120, least_m=7.0,
            ))  # fmt: skip
    number = 0
    for first, ring in rings.items():
        profile = ONE_WAY if first == 100 else STREET
        for k, (degrees, _, _) in enumerate(ring):
            following = (k + 1) % len(ring)
            number += 1
            streets.append(Street(
                number, first + k, first + following, profile, name=f"ring {first // 10 - 9}",
                start_deg=degrees + 90 + LEAN_DEG[k],
                end_deg=ring[following][0] - 90 + LEAN_DEG[following],
            ))  # fmt: skip

    def lane(start: int, end: int, profile: Profile) -> None:
        nonlocal number
        number += 1
        angle = {c.id: math.degrees(math.atan2(c.y, c.x)) for c in crossings}
        is_inward = start > end
        streets.append(Street(
            number, start, end, profile, name="lane",
            start_deg=angle[start] + (180 if is_inward else 0),
            end_deg=angle[end] + (0 if is_inward else 180),
        ))  # fmt: skip

    for inner, middle in INWARD.items():
        lane(110 + middle, 100 + inner, ONE_WAY)
    for inner, middle in OUTWARD.items():
        lane(100 + inner, 110 + middle, ONE_WAY)
    for middle, outer in OUTER_LANES.items():
        if middle == 1:
            lane(110 + middle, 120 + outer, ONE_WAY)
        elif middle == 4:
            lane(120 + outer, 110 + middle, ONE_WAY)
        else:
            lane(110 + middle, 120 + outer, STREET)
    write_town("oldtown", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
