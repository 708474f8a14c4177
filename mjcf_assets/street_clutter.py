"""What stands in rows along kerbs, and what is never annotated: bags, crates, bicycles at a rack."""

from __future__ import annotations

import math
import random

import numpy as np
from kinds import prop
from leaves import sheets
from model_writer import Model
from solids import ball, between, box, cylinder, extrude_x, moved


def rows() -> list[Model]:
    """Objects of a known category: plastic barriers."""
    barrier = prop(
        "road_barrier",
        "Plastic barrier of building sites, red or white.",
        35,
        0.55,
        category="barrier",
        weight=0,
        collision="hull",
    )
    right = [(0.27, 0), (0.24, 0.12), (0.09, 0.34), (0.07, 0.80)]
    profile = right + [(-x, z) for x, z in reversed(right)]
    for start, end, colour in ((-0.6, -0.2, "red"), (-0.2, 0.2, "white"), (0.2, 0.6, "red")):
        barrier.add(colour, moved(extrude_x(profile, start, end), yaw=math.pi / 2))
    return [barrier]


def bicycle(model: Model, y: float, lean: float, colour: str) -> None:
    """A bicycle along x, front wheel at the rack."""
    bars: dict[str, list] = {"tyre": [], colour: []}
    n, flat = 10, []
    for x in (-0.52, 0.52):
        at = lambda r, k, x=x: np.array(  # noqa: E731
            [x + r * math.cos(2 * math.pi * k / n), 0, 0.34 + r * math.sin(2 * math.pi * k / n)]
        )
        for k in range(n):
            a, b, c, d = at(0.34, k), at(0.34, k + 1), at(0.29, k + 1), at(0.29, k)
            flat += [np.array([a, b, c]), np.array([a, c, d])]
        flat += [np.array([at(0.3, k), at(0.3, k + 0.25), at(0.3, k + 5)]) for k in (0, 1.7, 3.3)]
    bars["tyre"].append(sheets(flat))
    model.loose.add("tyre")
    frame = (
        ((-0.52, 0, 0.34), (-0.1, 0, 0.3)),
        ((-0.1, 0, 0.3), (0.38, 0, 0.78)),
        ((-0.1, 0, 0.3), (-0.22, 0, 0.92)),
        ((-0.2, 0, 0.8), (0.37, 0, 0.82)),
        ((-0.52, 0, 0.34), (-0.2, 0, 0.8)),
        ((0.52, 0, 0.34), (0.34, 0, 1.02)),
    )
    bars[colour] += [between(a, b, 0.02, n=3) for a, b in frame]
    bars["tyre"] += [
        between((0.34, -0.28, 1.02), (0.34, 0.28, 1.02), 0.017, n=3),
        box((-0.23, 0, 0.95), (0.24, 0.12, 0.05)),
    ]
    for material, solids in bars.items():
        model.add(material, *(moved(solid, (0, y, 0), roll=lean) for solid in solids))


def background(name: str, about: str, mass_kg: float, **more) -> Model:
    return prop(name, about, mass_kg, 0.3, role="background", weight=0, **more)


def left_things() -> list[Model]:
    rng = random.Random("bags")
    bags = background("rubbish_bags", "Tied rubbish bags in a heap.", 30, collision="hull")
    for k in range(6):
        x, y = rng.uniform(-0.22, 0.22), rng.uniform(-0.6, 0.6)
        z = 0.25 if k < 4 else 0.55
        material = "black" if k % 3 else "bag"
        sides = (rng.uniform(0.24, 0.32), rng.uniform(0.26, 0.36), rng.uniform(0.22, 0.29))
        bags.add(
            material,
            moved(ball((0, 0, 0), sides, 8, 5), (x, y, z), rng.uniform(0, 3), rng.uniform(-0.3, 0.3)),
        )
        bags.add(material, moved(cylinder(0.04, 0, 0.14, 6, top=0.07), (x, y, z + 0.2)))
    bags.colours["bag"] = (0.75, 0.77, 0.78)
    crates = background("crates", "Stacked crates of slats.", 40, collision="hull")
    for x, y, level in ((0, -0.33, 0), (0.02, 0.34, 0), (-0.02, -0.28, 1), (0.01, 0.3, 1), (0, -0.3, 2)):
        z = 0.31 * level
        material = "wood" if (level + (y > 0)) % 2 else "green"
        for h in (0.08, 0.23):
            crates.add(
                material,
                *(box((x + s * 0.19, y, z + h), (0.015, 0.58, 0.13)) for s in (-1, 1)),
                *(box((x, y + s * 0.29, z + h), (0.39, 0.015, 0.13)) for s in (-1, 1)),
            )
        crates.add(material, box((x, y, z + 0.01), (0.38, 0.57, 0.02)))
    rack = background("bike_rack", "Bicycles at a rack.", 60, collision="hull")
    for k, (y, colour) in enumerate(((-0.95, "red"), (-0.35, "blue"), (0.2, "steel"), (0.9, "black"))):
        bicycle(rack, y, (0.08, -0.06, 0.05, -0.1)[k], colour)
    for y in (-1.15, -0.6, 0, 0.6, 1.15):
        hoop = [(0.3, y, 0.0), (0.3, y, 0.72), (0.7, y, 0.72), (0.7, y, 0.0)]
        rack.add("dark_steel", *(between(a, b, 0.025, n=3) for a, b in zip(hoop, hoop[1:], strict=False)))
    return [bags, crates, rack]


def street_clutter() -> list[Model]:
    return [*rows(), *left_things()]
