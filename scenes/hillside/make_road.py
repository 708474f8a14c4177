# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Hillside: a village on a slope of 18 m: hairpins, steep narrow lanes, few of them with two pavements.

Streets along the slope are nearly level, those across it climb by 6 to 10 %. Crossings are forks
rather than right angles.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import Crossing, Lane, Profile, Street, bend, write_town

WALK = Lane("sidewalk", 1.3)
DRIVE, NARROW = Lane("driving", 3.0, "solid"), Lane("driving", 2.6)
# The road through the village, its bends outside, and lanes with a pavement on one side or none.
VILLAGE = Profile((Lane("driving", 3.0, "curb"), WALK), (Lane("driving", 3.0, "curb"), WALK), 30)
ROAD = Profile((DRIVE,), (DRIVE,), 40, centre="broken")
LEFT = Profile((NARROW,), (NARROW, WALK), 30, centre="none")
RIGHT = Profile((NARROW, WALK), (NARROW,), 30, centre="none")
BARE = Profile((NARROW,), (NARROW,), 20, centre="none")
# One way; the road's line is its left edge.
LOOP = Profile((Lane("driving", 4.2), WALK), (), 20, centre="none")
ALLEY = Profile((Lane("driving", 3.3), WALK), (), 20, centre="none")

# Number, x, y, height.
CROSSINGS = (
    (101, -160, -98, 0.0), (102, -25, -112, 1.4), (103, 128, -96, 2.4),
    (104, -150, -14, 5.0), (105, -52, -38, 5.0), (106, 58, -30, 6.4), (107, 150, 0, 8.2),
    (108, -72, 36, 8.8), (109, 34, 34, 10.2), (110, -140, 92, 13.4), (111, -12, 92, 14.4),
    (112, 112, 84, 14.0), (113, 40, 146, 18.2), (114, -88, 138, 18.0),
)  # fmt: skip
# Start, end, profile, points on the way, headings away from both crossings (degrees; None: direct).
STREETS = (
    (101, 102, VILLAGE, ((-92, -112),), (-20, 175)),
    (102, 103, VILLAGE, ((55, -116),), (-5, 190)),
    (101, 104, ROAD, ((-172, -55),), (105, 250)),
    (102, 105, LEFT, ((-30, -76),), (95, 290)),
    (103, 107, ROAD, ((152, -62), (162, -30)), (55, 285)),
    (104, 105, VILLAGE, ((-100, -34),), (-20, 170)),
    (105, 106, VILLAGE, ((5, -42),), (-8, 190)),
    (106, 107, RIGHT, ((105, -26),), (10, 205)),
    (104, 108, ROAD, bend((-150, 21), 18, 185, 80), (130, 185)),
    (105, 108, BARE, ((-52, 0),), (80, -70)),
    (106, 109, ALLEY, ((72, 2),), (75, -35)),
    (108, 109, VILLAGE, ((-18, 24),), (-10, 185)),
    (107, 112, ROAD, ((162, 36), (144, 68)), (70, -40)),
    (109, 112, LEFT, ((72, 46),), (20, 230)),
    (108, 110, LEFT, ((-84, 62), (-118, 66)), (110, -60)),
    (110, 111, RIGHT, ((-78, 78),), (-5, 190)),
    (109, 111, ALLEY, ((24, 62), (-4, 66)), (105, -85)),
    (111, 112, VILLAGE, ((50, 80),), (-15, 170)),
    (112, 113, ROAD, bend((112, 122), 20, -30, 100), (60, -5)),
    (111, 113, BARE, ((2, 122),), (70, 195)),
    (110, 114, ROAD, bend((-140, 128), 17, 200, 80), (120, 185)),
    (114, 111, BARE, ((-44, 124),), (-20, 125)),
    (114, 114, LOOP, bend((-85, 176), 16, -10, 190), (60, 120)),
)  # fmt: skip


def main() -> None:
    crossings = [
        Crossing(n, x, y, z, kerb_radius_m=5.5, has_crosswalks=n in (102, 105, 108, 109), least_m=6.0)
        for n, x, y, z in CROSSINGS
    ]
    streets = [
        Street(k, start, end, profile, via, f"street {k}", *degrees)
        for k, (start, end, profile, via, degrees) in enumerate(STREETS, start=1)
    ]
    write_town("hillside", crossings, streets, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
