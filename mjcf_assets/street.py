"""Street furniture: parts by material."""

from __future__ import annotations

import math

from kinds import prop
from model_writer import Model
from solids import ball, between, box, cylinder, extrude_y, frustum, lathe, moved


def street_props() -> list[Model]:
    lamp = prop("street_lamp", "Street lamp, 6.2 m, single arm.", 120)
    lamp.add(
        "dark_steel",
        cylinder(0.13, 0, 0.5, 12),
        cylinder(0.075, 0.5, 6.0, 10, top=0.05),
        between((0, 0, 5.9), (0.45, 0, 6.2), 0.04),
        box((0.65, 0, 6.19), (0.62, 0.26, 0.10)),
    )
    lamp.collide_cylinder((0, 0, 3.0), 0.12, 6.0)
    lamp.collide_box((0.5, 0, 6.16), (0.9, 0.14, 0.12))
    lamp.add("lamp", box((0.66, 0, 6.13), (0.48, 0.2, 0.04)))
    sign = prop("traffic_sign", "Round speed sign on a post.", 25, 0.7, faces="traffic")
    sign.collide_cylinder((0, 0, 1.375), 0.04, 2.75)
    sign.collide_box((0.0, 0, 2.4), (0.08, 0.56, 0.56))
    sign.add(
        "steel",
        cylinder(0.035, 0, 2.75, 10),
        moved(cylinder(0.30, -0.035, -0.012, 20), (0, 0, 2.4), pitch=math.pi / 2),
    )
    sign.add("red", moved(cylinder(0.30, 0, 0.012, 20), (0.025, 0, 2.4), pitch=math.pi / 2))
    sign.add("white", moved(cylinder(0.22, 0, 0.012, 20), (0.032, 0, 2.4), pitch=math.pi / 2))
    sign.add(
        "black", box((0.046, 0.06, 2.4), (0.008, 0.07, 0.18)), box((0.046, -0.06, 2.4), (0.008, 0.07, 0.18))
    )
    pole = prop("pole", "Wooden utility pole, 7 m.", 300)
    pole.add("wood", cylinder(0.14, 0, 7, 12, top=0.10), box((0, 0, 6.4), (0.10, 1.6, 0.12)))
    pole.collide_cylinder((0, 0, 3.5), 0.14, 7.0)
    pole.collide_box((0, 0, 6.45), (0.10, 1.6, 0.3))
    pole.add("white", *(cylinder(0.05, 6.46, 6.62, 8, (0, y)) for y in (-0.7, -0.3, 0.3, 0.7)))
    bench = prop("bench", "Slatted bench.", 60)
    bench.add(
        "wood",
        *(box((x, 0, 0.45), (0.10, 1.7, 0.04)) for x in (-0.14, 0, 0.14, 0.26)),
        *(
            moved(box((0, 0, 0), (0.035, 1.7, 0.10)), (x, 0, z), pitch=-0.2)
            for x, z in ((-0.22, 0.60), (-0.25, 0.74), (-0.28, 0.88))
        ),
    )
    bench.add(
        "dark_steel",
        *(box((0.05, y, 0.41), (0.5, 0.06, 0.05)) for y in (-0.7, 0.7)),
        *(box((x, y, 0.2), (0.06, 0.06, 0.4)) for x in (-0.18, 0.24) for y in (-0.7, 0.7)),
        *(between((-0.19, y, 0.4), (-0.31, y, 0.93), 0.03) for y in (-0.7, 0.7)),
    )
    bench.collide_box((0.04, 0, 0.235), (0.56, 1.7, 0.47))
    bench.collide_box((-0.25, 0, 0.7), (0.14, 1.7, 0.5))
    bin_ = prop(
        "bin",
        "Litter bin with a hood.",
        30,
        collision="cylinder",
        paint="shell",
        colours={"shell": (0.13, 0.30, 0.18)},
    )
    bin_.add(
        "shell",
        lathe([(0, 0.04), (0.22, 0.04), (0.26, 0.78), (0, 0.78)], 16),
        lathe([(0, 0.94), (0.27, 0.94), (0.2, 1.04), (0, 1.06)], 16),
    )
    bin_.add("black", cylinder(0.20, 0, 0.05), cylinder(0.18, 0.78, 0.94))
    hydrant = prop(
        "hydrant",
        "Fire hydrant.",
        70,
        collision="cylinder",
        paint="paint",
        colours={"paint": (0.75, 0.10, 0.07)},
    )
    hydrant.add(
        "paint",
        lathe(
            [
                (0, 0),
                (0.17, 0),
                (0.17, 0.06),
                (0.115, 0.06),
                (0.115, 0.55),
                (0.15, 0.55),
                (0.15, 0.60),
                (0.12, 0.66),
                (0.07, 0.73),
                (0.03, 0.75),
                (0.03, 0.80),
                (0, 0.80),
            ],
            14,
        ),
        between((0, -0.20, 0.43), (0, 0.20, 0.43), 0.06, n=10),
        between((0, 0, 0.40), (0.20, 0, 0.40), 0.075, n=10),
    )
    hydrant.add(
        "steel",
        *(between((0, s * 0.19, 0.43), (0, s * 0.23, 0.43), 0.075, n=8) for s in (1, -1)),
        between((0.19, 0, 0.40), (0.23, 0, 0.40), 0.09, n=8),
    )
    bollard = prop("bollard", "Steel bollard with a reflecting band.", 40, 0.5, collision="cylinder")
    bollard.add(
        "dark_steel",
        lathe([(0, 0), (0.10, 0), (0.10, 0.05), (0.065, 0.05), (0.065, 0.88), (0.04, 0.94), (0, 0.95)], 14),
    )
    bollard.add("white", cylinder(0.069, 0.72, 0.80))
    planter = prop("planter", "Concrete planter with a shrub.", 400, collision="hull")
    planter.add("concrete", frustum((-0.45, 0.45, -0.45, 0.45, 0), (-0.55, 0.55, -0.55, 0.55, 0.6)))
    planter.add("soil", box((0, 0, 0.6), (0.98, 0.98, 0.03)))
    planter.add(
        "leaves",
        ball((0.05, 0.1, 0.85), (0.42, 0.38, 0.34)),
        ball((-0.2, -0.15, 0.78), (0.30, 0.32, 0.28)),
        ball((0.22, -0.2, 0.80), (0.28, 0.25, 0.26)),
    )
    shelter = prop("bus_shelter", "Glazed bus shelter with a bench.", 900)
    shelter.add(
        "dark_steel",
        *(box((x, y, 1.2), (0.08, 0.08, 2.4)) for x in (-0.65, 0.55) for y in (-1.9, 1.9)),
        box((-0.65, 0, 1.2), (0.06, 0.06, 2.4)),
        box((0, 0, 2.46), (1.6, 4.1, 0.12)),
        *(box((-0.65, 0, z), (0.05, 3.8, 0.05)) for z in (0.25, 2.2)),
    )
    shelter.add("pane", box((-0.65, 0, 1.22), (0.03, 3.7, 1.9)), box((-0.1, -1.9, 1.22), (1.0, 0.03, 1.9)))
    shelter.colours["pane"] = (0.50, 0.60, 0.62)
    shelter.add("wood", box((-0.35, 0.2, 0.45), (0.36, 2.0, 0.05)))
    shelter.add("steel", *(box((-0.35, y, 0.22), (0.3, 0.06, 0.44)) for y in (-0.6, 1.0)))
    shelter.collide_box((-0.65, 0, 1.2), (0.08, 3.9, 2.4))
    shelter.collide_box((-0.05, 0, 2.46), (1.6, 4.1, 0.12))
    for y in (-1.9, 1.9):
        shelter.collide_box((-0.05, y, 1.2), (1.28, 0.12, 2.4))
    shelter.add("paper", box((-0.1, 1.9, 1.3), (1.1, 0.12, 1.8)))
    barrier = prop("barrier", "Concrete road barrier.", 1200, collision="hull")
    barrier.add(
        "concrete",
        extrude_y(
            [
                (-0.30, 0),
                (0.30, 0),
                (0.30, 0.1),
                (0.14, 0.35),
                (0.09, 0.82),
                (-0.09, 0.82),
                (-0.14, 0.35),
                (-0.30, 0.1),
            ],
            -1.0,
            1.0,
        ),
    )
    barrier.add(
        "red", *(box((s * 0.115, y, 0.62), (0.02, 0.3, 0.14)) for s in (1, -1) for y in (-0.6, 0, 0.6))
    )
    return [lamp, sign, pole, bench, bin_, hydrant, bollard, planter, shelter, barrier, *town_props()]


def town_props() -> list[Model]:
    """What only some towns have: those that name it among their prop weights."""
    stall = prop(
        "stall",
        "Market stall: striped awning on four posts over a table of crates.",
        140,
        weight=0,
        paint="awning",
        colours={"awning": (0.72, 0.14, 0.12), "fruit": (0.88, 0.50, 0.10)},
    )
    width, n_stripes = 2.6, 10
    stripe = width / n_stripes
    for k in range(n_stripes):
        y = -width / 2 + stripe * k
        slope = [(-0.85, 2.48), (-0.85, 2.52), (0.95, 2.14), (0.95, 1.92), (0.92, 1.92), (0.92, 2.11)]
        stall.add("awning" if k % 2 == 0 else "white", extrude_y(slope, y, y + stripe))
    stall.add(
        "wood",
        *(box((x, y, h / 2), (0.07, 0.07, h)) for x, h in ((-0.78, 2.48), (0.70, 2.14)) for y in (-1.2, 1.2)),
        box((0.12, 0, 0.80), (1.10, 2.3, 0.05)),
        box((0.62, 0, 0.55), (0.04, 2.3, 0.45)),
        *(box((x, y, 0.4), (0.06, 0.06, 0.8)) for x in (-0.35, 0.55) for y in (-1.05, 1.05)),
        *(
            frustum((0.12, 0.58, y - 0.24, y + 0.24, 0.83), (0.10, 0.60, y - 0.26, y + 0.26, 0.97))
            for y in (-0.8, 0, 0.8)
        ),
        *(box((-0.2, y, 0.90), (0.40, 0.50, 0.16)) for y in (-0.8, 0, 0.8)),
    )
    for material, y in (("fruit", -0.8), ("red", 0), ("leaves", 0.8)):
        stall.add(
            material,
            ball((0.35, y, 0.97), (0.22, 0.24, 0.10), 9, 5),
            ball((-0.2, y, 0.98), (0.18, 0.22, 0.07), 8, 4),
        )
    stall.collide_box((0.12, 0, 0.49), (1.10, 2.4, 0.98))
    stall.collide_hull(*stall.parts["awning"], *stall.parts["white"])
    for x, h in ((-0.78, 2.48), (0.70, 2.14)):
        for y in (-1.2, 1.2):
            stall.collide_box((x, y, h / 2), (0.07, 0.07, h))
    jersey = prop(
        "jersey_barrier",
        "Long concrete barrier of a divided road, with reflectors.",
        2600,
        category="barrier",
        collision="hull",
        weight=0,
    )
    profile = [
        (-0.30, 0),
        (0.30, 0),
        (0.30, 0.08),
        (0.17, 0.33),
        (0.10, 0.90),
        (-0.10, 0.90),
        (-0.17, 0.33),
        (-0.30, 0.08),
    ]
    jersey.add("concrete", extrude_y(profile, -1.98, 1.98))
    jersey.add("dark_steel", *(box((0, s * 1.985, 0.45), (0.10, 0.02, 0.30)) for s in (1, -1)))
    jersey.add(
        "yellow", *(box((s * 0.118, y, 0.78), (0.02, 0.10, 0.10)) for s in (1, -1) for y in (-1.3, 0, 1.3))
    )
    stop = prop(
        "bus_stop",
        "Bus stop: sign with a timetable on a post.",
        35,
        0.6,
        category="traffic_sign",
        faces="traffic",
        weight=0,
    )
    stop.add("steel", cylinder(0.04, 0, 2.9, 10), cylinder(0.14, 0, 0.05, 12))
    stop.add("yellow", moved(cylinder(0.27, -0.015, 0.015, 20), (0.05, 0, 2.6), pitch=math.pi / 2))
    stop.add("green", moved(cylinder(0.20, -0.02, 0.02, 20), (0.05, 0, 2.6), pitch=math.pi / 2))
    stop.add(
        "yellow",
        *(box((0.072, y, 2.6), (0.012, 0.035, 0.20)) for y in (-0.06, 0.06)),
        box((0.072, 0, 2.6), (0.012, 0.12, 0.035)),
    )
    stop.add("dark_steel", box((0.05, 0, 1.5), (0.03, 0.40, 0.55)))
    stop.add("paper", box((0.068, 0, 1.5), (0.01, 0.33, 0.47)))
    stop.collide_cylinder((0, 0, 1.45), 0.045, 2.9)
    stop.collide_box((0.05, 0, 2.6), (0.06, 0.5, 0.5))
    stop.collide_box((0.05, 0, 1.5), (0.05, 0.40, 0.55))
    lantern = prop(
        "gas_lamp", "Old street lantern on a cast-iron post, 3.7 m.", 150, category="street_lamp", weight=0
    )
    lantern.add(
        "black",
        lathe(
            [
                (0, 0),
                (0.19, 0),
                (0.19, 0.12),
                (0.13, 0.18),
                (0.10, 0.75),
                (0.12, 0.80),
                (0.055, 0.88),
                (0.045, 2.75),
                (0.08, 2.80),
                (0.04, 2.85),
                (0.04, 2.95),
                (0, 2.95),
            ],
            12,
        ),
        between((0, -0.28, 2.72), (0, 0.28, 2.72), 0.022, n=7),
        frustum((-0.11, 0.11, -0.11, 0.11, 2.95), (-0.13, 0.13, -0.13, 0.13, 2.99)),
        *(
            between((sx * 0.125, sy * 0.125, 2.98), (sx * 0.20, sy * 0.20, 3.42), 0.014, n=5)
            for sx in (1, -1)
            for sy in (1, -1)
        ),
        frustum((-0.23, 0.23, -0.23, 0.23, 3.42), (-0.05, 0.05, -0.05, 0.05, 3.62)),
        lathe([(0, 3.6), (0.05, 3.62), (0.03, 3.68), (0, 3.75)], 8),
    )
    lantern.add("lamp", frustum((-0.11, 0.11, -0.11, 0.11, 2.99), (-0.185, 0.185, -0.185, 0.185, 3.42)))
    lantern.collide_cylinder((0, 0, 1.475), 0.14, 2.95)
    lantern.collide_box((0, 0, 3.3), (0.42, 0.42, 0.75))
    return [stall, jersey, stop, lantern]
