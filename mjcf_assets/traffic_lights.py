# Writes the folder `traffic_light` beside this script. Needs Python 3.11 and numpy==2.4.6.
"""The pole and head of a traffic light; x points at the drivers. The lamps are the simulator's."""

from __future__ import annotations

from model_writer import Model
from solids import box, cylinder


def traffic_light() -> Model:
    light = Model(
        "traffic_light",
        "traffic_light",
        "static",
        "Traffic light: a pole with a head for three lamps, whose front is the plane of greatest x.",
        60,
        0.4,
    )
    light.add("dark_steel", cylinder(0.06, 0, 3.35, 10), cylinder(0.11, 0, 0.25, 10))
    light.add("black", box((0.14, 0, 2.88), (0.14, 0.30, 0.98)), box((0.06, 0, 2.88), (0.02, 0.52, 1.2)))
    return light


if __name__ == "__main__":
    traffic_light().write()
