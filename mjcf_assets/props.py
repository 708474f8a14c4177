"""Street furniture, and the eleven out-of-distribution kinds: parts by material."""

from __future__ import annotations

import math

from model_writer import Model
from solids import ball, between, box, cylinder, extrude_x, extrude_y, frustum, lathe, moved


def prop(name: str, about: str, mass_kg: float, reflectivity=0.4, category=None, **more) -> Model:
    return Model(name, category or name, "static", about, mass_kg, reflectivity, **more)


def ood(name: str, about: str, mass_kg: float, reflectivity=0.4, **more) -> Model:
    return prop(name, about, mass_kg, reflectivity, name[:-2], distribution="ood", **more)


def half_round(width: float, straight: float, n: int = 10) -> list[tuple[float, float]]:
    """A front view: upright sides and a round top."""
    r = width / 2
    return [
        (-r, 0),
        (r, 0),
        *((r * math.cos(math.pi * k / n), straight + r * math.sin(math.pi * k / n)) for k in range(n + 1)),
    ]


def street_props() -> list[Model]:
    lamp = prop("street_lamp", "Street lamp, 6.2 m, single arm.", 120)
    lamp.add(
        "dark_steel",
        cylinder(0.13, 0, 0.5, 12),
        cylinder(0.075, 0.5, 6.0, 10, top=0.05),
        between((0, 0, 5.9), (1.15, 0, 6.2), 0.04),
        box((1.35, 0, 6.19), (0.62, 0.26, 0.10)),
    )
    lamp.add("lamp", box((1.36, 0, 6.13), (0.48, 0.2, 0.04)))
    sign = prop("traffic_sign", "Round speed sign on a post.", 25, 0.7)
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
    planter = prop("planter", "Concrete planter with a shrub.", 400)
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
    shelter.add("paper", box((-0.1, 1.9, 1.3), (1.1, 0.12, 1.8)))
    barrier = prop("barrier", "Concrete road barrier.", 1200)
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
    tree = prop("tree", "Street tree.", 500, 0.3, paint="leaves")
    tree.add(
        "bark",
        cylinder(0.16, 0, 2.5, 10, top=0.11),
        between((0, 0, 2.2), (0.7, 0.3, 3.3), 0.07, 0.04),
        between((0, 0, 2.3), (-0.6, -0.4, 3.3), 0.07, 0.04),
    )
    tree.add(
        "leaves",
        *(
            ball(c, (r, r, r * 0.85), 10, 7)
            for c, r in (
                ((0, 0, 4.4), 1.35),
                ((0.85, 0.4, 3.7), 0.95),
                ((-0.8, -0.5, 3.8), 1.0),
                ((0.1, -0.9, 4.0), 0.9),
                ((-0.2, 0.95, 4.1), 0.9),
                ((0.1, 0, 5.3), 0.85),
            )
        ),
    )
    return [lamp, sign, pole, bench, bin_, hydrant, bollard, planter, shelter, barrier, tree]


def barrels() -> list[Model]:
    out = []
    for tag, about, colour, r, h in (
        ("a", "Steel oil drum.", (0.10, 0.25, 0.50), 0.29, 0.88),
        ("b", "Plastic drum.", (0.85, 0.55, 0.08), 0.26, 0.95),
    ):
        m = ood(
            f"barrel_{tag}", about, 20, 0.5, collision="cylinder", paint="paint", colours={"paint": colour}
        )
        prof = [(0, 0), (r, 0)]
        for z in (0.02, 0.33 * h, 0.66 * h, h - 0.05):
            prof += [(r, z), (r + 0.018, z + 0.012), (r + 0.018, z + 0.028), (r, z + 0.04)]
        m.add("paint", lathe([*prof, (r, h), (r - 0.02, h), (r - 0.02, h - 0.02), (0, h - 0.02)], 16))
        m.add(
            "steel",
            cylinder(0.04, h - 0.02, h - 0.005, 8, (0.15, 0)),
            cylinder(0.025, h - 0.02, h - 0.008, 8, (-0.16, 0.05)),
        )
        out.append(m)
    m = ood("barrel_c", "Wooden cask.", 35, 0.35, collision="cylinder")
    m.add(
        "wood",
        lathe([(0, 0), (0.25, 0), (0.30, 0.25), (0.32, 0.45), (0.30, 0.65), (0.25, 0.9), (0, 0.88)], 16),
    )
    m.add(
        "dark_steel",
        *(
            cylinder(a, z, z + 0.05, 16, top=b)
            for z, a, b in (
                (0.05, 0.268, 0.278),
                (0.27, 0.307, 0.313),
                (0.58, 0.313, 0.307),
                (0.80, 0.278, 0.268),
            )
        ),
    )
    return [*out, m]


def mailboxes() -> list[Model]:
    a = ood(
        "mailbox_a",
        "Street collection box with a round top.",
        90,
        0.5,
        paint="paint",
        colours={"paint": (0.08, 0.20, 0.50)},
    )
    a.add(
        "paint",
        moved(extrude_x(half_round(0.52, 0.80), -0.26, 0.26), (0, 0, 0.18)),
        *(box((x, y, 0.1), (0.06, 0.06, 0.2)) for x in (-0.22, 0.22) for y in (-0.22, 0.22)),
    )
    a.add("dark_steel", box((0.265, 0, 0.98), (0.04, 0.40, 0.05)), box((0.262, 0, 0.25), (0.02, 0.5, 0.04)))
    a.add("white", box((0.262, 0, 0.66), (0.015, 0.30, 0.22)))
    b = ood(
        "mailbox_b",
        "Rural mailbox with a round top on a wooden post.",
        12,
        0.5,
        paint="paint",
        colours={"paint": (0.62, 0.63, 0.65)},
    )
    b.add("wood", box((0, 0, 0.5), (0.10, 0.10, 1.0)), box((0, 0, 1.01), (0.45, 0.16, 0.03)))
    b.add("paint", moved(extrude_x(half_round(0.20, 0.14, 8), -0.26, 0.26), (0, 0, 1.025)))
    b.add("red", box((0.05, 0.108, 1.22), (0.03, 0.012, 0.2)), box((0.10, 0.108, 1.30), (0.12, 0.012, 0.06)))
    b.add("dark_steel", box((0.265, 0, 1.24), (0.02, 0.05, 0.03)))
    c = ood(
        "mailbox_c",
        "Round pillar box.",
        150,
        0.5,
        collision="cylinder",
        paint="paint",
        colours={"paint": (0.75, 0.06, 0.05)},
    )
    c.add(
        "paint",
        lathe(
            [(0, 0.12), (0.23, 0.12), (0.23, 1.32), (0.28, 1.32), (0.28, 1.42), (0.18, 1.50), (0, 1.54)], 16
        ),
    )
    c.add("black", cylinder(0.26, 0, 0.12, 16), box((0.225, 0, 1.2), (0.02, 0.26, 0.04)))
    c.add("white", box((0.222, 0, 0.95), (0.03, 0.16, 0.20)))
    return [a, b, c]


def cones() -> list[Model]:
    out = []
    for tag, h, r, colour in (
        ("a", 0.75, 0.15, (0.95, 0.32, 0.04)),
        ("b", 0.46, 0.11, (0.88, 0.12, 0.06)),
        ("c", 1.0, 0.16, (0.92, 0.50, 0.05)),
    ):
        m = ood(
            f"construction_cone_{tag}",
            f"Traffic cone, {h:g} m, with reflecting bands.",
            4,
            0.7,
            paint="cone",
            colours={"cone": colour},
        )
        at = lambda t: r + (0.03 - r) * t  # noqa: E731
        m.add("cone" if tag != "c" else "black", box((0, 0, 0.02), (2.5 * r, 2.5 * r, 0.04)))
        m.add("cone", lathe([(0, 0.03), (r, 0.03), (0.03, h), (0.015, h), (0, h - 0.01)], 16))
        m.add(
            "white",
            *(
                cylinder(at(p) + 0.004, p * h, q * h, 16, top=at(q) + 0.004)
                for p, q in ((0.38, 0.55), (0.70, 0.82))
            ),
        )
        out.append(m)
    return out


def containers() -> list[Model]:
    a = ood(
        "container_a",
        "Wheeled waste container with a domed lid.",
        60,
        paint="paint",
        colours={"paint": (0.12, 0.33, 0.20)},
    )
    a.add(
        "paint",
        frustum((-0.42, 0.42, -0.56, 0.56, 0.2), (-0.52, 0.52, -0.66, 0.66, 1.05)),
        *(box((0.49, y, 0.62), (0.06, 0.05, 0.7)) for y in (-0.4, 0, 0.4)),
    )
    a.add(
        "lid",
        moved(
            extrude_x(
                [(-0.68, 0), (0.68, 0), (0.66, 0.06), (0.35, 0.2), (-0.35, 0.2), (-0.66, 0.06)], -0.54, 0.54
            ),
            (0, 0, 1.05),
        ),
    )
    a.colours["lid"] = (0.10, 0.12, 0.11)
    a.add(
        "tyre",
        *(
            moved(cylinder(0.1, -0.03, 0.03, 12), (x, y, 0.1), roll=math.pi / 2)
            for x in (-0.32, 0.32)
            for y in (-0.46, 0.46)
        ),
    )
    b = ood("container_b", "Open skip for rubble.", 400, paint="paint", colours={"paint": (0.85, 0.60, 0.08)})
    b.add(
        "paint",
        extrude_y([(-0.95, 0.05), (0.95, 0.05), (1.6, 1.2), (-1.6, 1.2)], -0.85, 0.85),
        *(box((0, y, 1.2), (3.3, 0.1, 0.1)) for y in (-0.85, 0.85)),
    )
    b.add(
        "dark_steel",
        *(box((x, s * 0.88, 0.65), (0.1, 0.08, 1.1)) for x in (-0.5, 0.5) for s in (1, -1)),
        box((0, 0, 0.03), (1.8, 1.5, 0.06)),
    )
    b.add("concrete", ball((0.1, 0, 1.15), (1.3, 0.72, 0.3), 9, 5))
    c = ood(
        "container_c",
        "Small corrugated shipping container.",
        1300,
        paint="paint",
        colours={"paint": (0.55, 0.20, 0.12)},
    )
    c.add(
        "paint",
        box((0, 0, 1.3), (2.9, 2.3, 2.45)),
        *(box((-1.2 + 0.3 * k, s * 1.16, 1.3), (0.15, 0.06, 2.3)) for k in range(9) for s in (1, -1)),
    )
    c.add(
        "dark_steel",
        *(box((x, y, 1.3), (0.14, 0.14, 2.6)) for x in (-1.45, 1.45) for y in (-1.15, 1.15)),
        *(box((1.47, y, 1.3), (0.05, 0.04, 2.3)) for y in (-0.7, -0.2, 0.2, 0.7)),
    )
    return [a, b, c]


def cloth_containers() -> list[Model]:
    out = []
    for tag, colour, w, h in (("a", (0.88, 0.72, 0.12), 1.1, 1.85), ("b", (0.80, 0.80, 0.78), 1.25, 2.1)):
        m = ood(
            f"cloth_container_{tag}",
            "Clothes donation bin with a sloping roof and a chute.",
            130,
            0.45,
            paint="paint",
            colours={"paint": colour},
        )
        m.add(
            "paint", extrude_y([(-0.5, 0.1), (0.5, 0.1), (0.5, h - 0.3), (0.3, h), (-0.5, h)], -w / 2, w / 2)
        )
        m.add(
            "dark_steel",
            box((0, 0, 0.05), (0.9, w - 0.1, 0.1)),
            box((0.50, 0, h - 0.50), (0.10, w * 0.7, 0.30)),
        )
        m.add("steel", box((0.57, 0, h - 0.60), (0.06, w * 0.45, 0.04)))
        m.add("blue" if tag == "a" else "green", box((0.502, 0, 0.75), (0.015, w * 0.8, 0.55)))
        m.add("white", box((0.51, 0, 0.75), (0.015, w * 0.5, 0.20)))
        out.append(m)
    return out


def advertisements() -> list[Model]:
    a = ood(
        "advertisement_a",
        "Upright poster case on two legs.",
        180,
        0.5,
        paint="poster",
        colours={"poster": (0.85, 0.25, 0.35)},
    )
    a.add(
        "dark_steel",
        box((0, 0, 1.5), (0.20, 1.35, 2.0)),
        *(box((0, y, 0.26), (0.14, 0.14, 0.52)) for y in (-0.45, 0.45)),
    )
    for s in (1, -1):
        a.add("poster", box((s * 0.10, 0, 1.5), (0.02, 1.18, 1.76)))
        a.add(
            "white",
            box((s * 0.112, 0.1, 1.98), (0.012, 0.8, 0.22)),
            box((s * 0.112, 0, 0.80), (0.012, 1.0, 0.12)),
        )
        a.add("yellow", box((s * 0.112, -0.15, 1.40), (0.012, 0.55, 0.60)))
    b = ood(
        "advertisement_b",
        "Folding pavement sign.",
        9,
        0.4,
        paint="board",
        colours={"board": (0.10, 0.12, 0.13)},
    )
    for s in (1, -1):
        b.add("wood", moved(box((0, 0, 0), (0.03, 0.64, 1.04)), (s * 0.16, 0, 0.51), pitch=-s * 0.28))
        b.add("board", moved(box((0, 0, 0), (0.02, 0.54, 0.86)), (s * 0.178, 0, 0.53), pitch=-s * 0.28))
        b.add(
            "paper",
            *(
                moved(box((0, y, 0), (0.01, w, 0.05)), (s * x, 0, z), pitch=-s * 0.28)
                for y, w, x, z in ((0, 0.4, 0.146, 0.70), (0.03, 0.3, 0.178, 0.57), (0, 0.36, 0.21, 0.45))
            ),
        )
    c = ood(
        "advertisement_c",
        "Round advertising column.",
        700,
        0.45,
        collision="cylinder",
        paint="poster",
        colours={"poster": (0.90, 0.80, 0.55)},
    )
    c.add(
        "dark_steel",
        cylinder(0.68, 0, 0.35, 16),
        lathe([(0, 2.6), (0.72, 2.6), (0.72, 2.72), (0.3, 3.0), (0, 3.1)], 16),
    )
    c.add("poster", cylinder(0.62, 0.35, 2.6, 16))
    c.add("red", box((0, 0, 1.9), (1.26, 0.5, 0.8)))
    c.add("blue", box((0, 0, 1.2), (0.5, 1.26, 0.9)))
    return [a, b, c]


def hay_bales() -> list[Model]:
    a = ood("hay_bale_a", "Small rectangular bale with two straps.", 18, 0.35, paint="straw")
    a.add(
        "straw",
        box((0, 0, 0.24), (1.0, 0.5, 0.46)),
        box((0, 0, 0.24), (0.94, 0.46, 0.48)),
        box((0, 0, 0.24), (0.96, 0.52, 0.42)),
    )
    a.add("strap", *(box((x, 0, 0.24), (0.03, 0.535, 0.492)) for x in (-0.25, 0.25)))
    b = ood("hay_bale_b", "Round bale lying on its side.", 220, 0.35, paint="straw")
    b.add(
        "straw",
        moved(
            lathe([(0, -0.58), (0.52, -0.58), (0.6, -0.5), (0.6, 0.5), (0.52, 0.58), (0, 0.58)], 16),
            (0, 0, 0.6),
            roll=math.pi / 2,
        ),
    )
    b.add(
        "strap",
        *(
            moved(cylinder(0.61, y - 0.02, y + 0.02, 16), (0, 0, 0.6), roll=math.pi / 2)
            for y in (-0.3, 0, 0.3)
        ),
    )
    c = ood(
        "hay_bale_c",
        "Large square bale with four straps.",
        300,
        0.35,
        paint="straw",
        colours={"straw": (0.72, 0.62, 0.34)},
    )
    c.add("straw", box((0, 0, 0.45), (1.9, 1.1, 0.86)), box((0, 0, 0.45), (1.84, 1.05, 0.9)))
    c.add("strap", *(box((x, 0, 0.45), (0.035, 1.12, 0.915)) for x in (-0.7, -0.25, 0.25, 0.7)))
    return [a, b, c]


def small_things() -> list[Model]:
    out = []
    for tag, colour, l, w, h in (
        ("a", (0.75, 0.55, 0.36), 0.18, 0.34, 0.40),
        ("b", (0.85, 0.20, 0.40), 0.16, 0.42, 0.34),
    ):
        m = ood(
            f"shopping_bag_{tag}",
            "Standing shopping bag with two handles.",
            3,
            0.4,
            paint="paint",
            colours={"paint": colour},
        )
        m.add(
            "paint", frustum((-l / 2, l / 2, -w / 2, w / 2, 0), (-l * 0.38, l * 0.38, -w * 0.52, w * 0.52, h))
        )
        for s in (1, -1):
            arc = [
                (s * l * 0.34, 0.22 * w * math.cos(t), h - 0.02 + 0.15 * math.sin(t))
                for t in (math.pi * k / 6 for k in range(7))
            ]
            m.add("trim", *(between(p, q, 0.009, n=5) for p, q in zip(arc, arc[1:])))
        m.add("white", box((l * 0.45, 0, h * 0.5), (0.02, w * 0.4, h * 0.25)))
        out.append(m)
    for tag, roof in (("a", True), ("b", False)):
        m = ood(
            f"map_table_{tag}",
            "Sloping map board" + (" under a small roof." if roof else " on two posts."),
            70,
        )
        m.add(
            "wood",
            *(
                box((-0.1, y, 1.1 if roof else 0.5), (0.10, 0.10, 2.2 if roof else 1.0))
                for y in (-0.62, 0.62)
            ),
            moved(box((0, 0, 0), (0.75, 1.4, 0.05)), (0, 0, 1.0), pitch=0.6),
        )
        tilt = lambda x, y, l, w, z: moved(box((x, y, z), (l, w, 0.012)), (0, 0, 1.0), pitch=0.6)  # noqa: E731
        m.add("paper", tilt(0, 0, 0.65, 1.28, 0.03))
        m.add("green", tilt(-0.08, 0.25, 0.36, 0.5, 0.037), tilt(0.15, -0.3, 0.22, 0.4, 0.037))
        m.add("blue", tilt(0.02, -0.05, 0.6, 0.08, 0.041))
        m.add("red", tilt(-0.18, -0.35, 0.10, 0.10, 0.037))
        if roof:
            m.add("bark", extrude_y([(-0.6, 2.12), (0.4, 2.12), (-0.1, 2.45)], -0.85, 0.85))
        out.append(m)
    for tag, (l, w, h) in (("a", (0.55, 0.42, 0.40)), ("b", (0.80, 0.60, 0.62)), ("c", (0.45, 0.60, 0.25))):
        m = ood(
            f"cardboard_box_{tag}",
            "Cardboard box" + (" with open flaps." if tag == "b" else ", taped."),
            4,
            0.45,
            paint="card",
        )
        m.add("card", box((0, 0, h / 2), (l, w, h)))
        if tag == "b":
            m.add(
                "card",
                *(
                    moved(box((s * 0.14, 0, 0), (0.28, w, 0.012)), (s * l / 2, 0, h), pitch=s * 0.6)
                    for s in (1, -1)
                ),
                *(
                    moved(box((0, s * 0.14, 0), (l, 0.28, 0.012)), (0, s * w / 2, h), roll=s * 0.5)
                    for s in (1, -1)
                ),
            )
            m.add("soil", box((0, 0, h), (l - 0.04, w - 0.04, 0.01)))
        else:
            m.add("tape", box((0, 0, h / 2), (l + 0.006, 0.07, h + 0.006)))
        m.add("paper", box((l / 2, w * 0.22, h * 0.6), (0.012, w * 0.3, h * 0.3)))
        out.append(m)
    for tag, colour, round_top in (("a", (0.75, 0.08, 0.08), False), ("b", (0.10, 0.28, 0.60), True)):
        m = ood(
            f"newspaper_box_{tag}",
            "Coin-operated newspaper box.",
            35,
            0.45,
            paint="paint",
            colours={"paint": colour},
        )
        if round_top:
            m.add("paint", moved(extrude_x(half_round(0.48, 0.62, 8), -0.21, 0.21), (0, 0, 0.35)))
        else:
            m.add(
                "paint",
                extrude_y(
                    [(-0.21, 0.35), (0.21, 0.35), (0.21, 1.0), (0.12, 1.12), (-0.21, 1.12)], -0.25, 0.25
                ),
                box((-0.05, 0.14, 1.2), (0.16, 0.14, 0.2)),
            )
        m.add(
            "dark_steel",
            box((0, 0, 0.19), (0.14, 0.14, 0.36)),
            box((0, 0, 0.02), (0.40, 0.44, 0.04)),
            box((0.22, 0, 0.58), (0.04, 0.24, 0.03)),
        )
        m.add("glass", box((0.21, 0, 0.80), (0.015, 0.38, 0.30)))
        m.add("paper", box((0.216, 0, 0.77), (0.012, 0.30, 0.20)))
        out.append(m)
    return out


def ood_props() -> list[Model]:
    return [
        *barrels(),
        *mailboxes(),
        *cones(),
        *containers(),
        *cloth_containers(),
        *advertisements(),
        *hay_bales(),
        *small_things(),
    ]
