"""Makes `crossroads.xodr` with scenariogeneration: four arms that meet at a junction.

A network of another writer than ours, which `tests/traffic.rs` drives on:
`.venv-test/bin/python tests/data/make_crossroads.py`.
"""

import math
from pathlib import Path

from scenariogeneration import xodr

ARM_M = 120.0
RADIUS_M = 16.0
OUT = Path(__file__).with_name("crossroads.xodr")

arms = [
    xodr.create_road(xodr.Line(ARM_M), arm, left_lanes=1, right_lanes=1, lane_width=3.5) for arm in range(4)
]
junction = xodr.CommonJunctionCreator(id=100, name="crossroads")
for i, arm in enumerate(arms):
    junction.add_incoming_road_circular_geometry(arm, RADIUS_M, i * math.pi / 2, "successor")
for i in range(4):
    for other in range(i):
        junction.add_connection(i, other)
network = xodr.OpenDrive("crossroads")
for arm in arms:
    network.add_road(arm)
network.add_junction_creator(junction)
network.adjust_roads_and_lanes()
network.write_xml(str(OUT))
# The writer puts the date into the header; without it the same script gives the same bytes.
lines = OUT.read_text().splitlines()
OUT.write_text(
    "\n".join(line if "<header" not in line else line.split(' date="')[0] + "/>" for line in lines) + "\n"
)
