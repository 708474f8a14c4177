"""Out-of-distribution kinds that take two hands or more: parts by material."""

from __future__ import annotations

import math

from kinds import half_round, ood
from model_writer import Model
from solids import ball, box, cylinder, extrude_x, extrude_y, frustum, lathe, moved


def barrels() -> list[Model]:
    out = []
    for tag, about, colour, r, h in (
        ("a", "Steel oil drum.", (0.10, 0.25, 0.50), 0.29, 0.88),
        ("b", "Plastic drum with a black lid.", (0.85, 0.58, 0.10), 0.28, 0.72),
    ):
        m = ood(
            f"barrel_{tag}", about, 20, 0.5, collision="cylinder", paint="paint", colours={"paint": colour}
        )
        if tag == "a":
            prof = [(0, 0), (r, 0)]
            for z in (0.02, 0.33 * h, 0.66 * h, h - 0.05):
                prof += [(r, z), (r + 0.018, z + 0.012), (r + 0.018, z + 0.028), (r, z + 0.04)]
            prof += [(r, h), (r - 0.02, h), (r - 0.02, h - 0.02), (0, h - 0.02)]
        else:
            prof = [
                (0, 0),
                (r - 0.04, 0),
                (r, 0.06),
                (r + 0.01, 0.30),
                (r - 0.02, 0.33),
                (r - 0.02, 0.52),
                (r + 0.01, 0.55),
            ]
            prof += [(r, 0.78), (r - 0.06, h - 0.05), (r - 0.06, h - 0.02), (0, h - 0.02)]
            m.add("black", cylinder(r - 0.035, h - 0.07, h, 16), cylinder(0.06, h, h + 0.03, 10, (0.1, 0)))
        m.add("paint", lathe(prof, 16))
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
    for model in (*out, m):
        model.friction = (0.7, 0.01, 0.03)
        model.rolls = "z"
    return [*out, m]


def mailboxes() -> list[Model]:
    a = ood(
        "mailbox_a",
        "Street collection box with a round top.",
        90,
        0.5,
        collision="hull",
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
    b.collide_box((0, 0, 0.5), (0.10, 0.10, 1.0))
    b.collide_hull(*b.parts["paint"])
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
            collision="hull",
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
        collision="hull",
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
    b = ood(
        "container_b",
        "Open skip for rubble.",
        400,
        collision="hull",
        paint="paint",
        colours={"paint": (0.85, 0.60, 0.08)},
    )
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
            collision="hull",
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
    m = ood(
        "cloth_container_c",
        "Low clothes bin with a gabled roof and a round hatch.",
        95,
        0.45,
        collision="hull",
        paint="paint",
        colours={"paint": (0.80, 0.28, 0.38), "roof": (0.30, 0.32, 0.34)},
    )
    m.add(
        "paint", extrude_x([(-0.48, 0.08), (0.48, 0.08), (0.48, 1.18), (0, 1.42), (-0.48, 1.18)], -0.42, 0.42)
    )
    m.add(
        "roof",
        *(moved(box((0, 0, 0), (0.96, 0.60, 0.05)), (0, s * 0.26, 1.33), roll=-s * 0.4636) for s in (1, -1)),
    )
    m.add("black", moved(cylinder(0.20, -0.02, 0.02, 18), (0.425, 0, 0.98), pitch=math.pi / 2))
    m.add("steel", moved(cylinder(0.24, -0.012, 0.012, 18), (0.422, 0, 0.98), pitch=math.pi / 2))
    m.add("white", box((0.425, 0, 0.52), (0.015, 0.62, 0.30)))
    m.add(
        "dark_steel", *(box((x, y, 0.05), (0.10, 0.10, 0.10)) for x in (-0.34, 0.34) for y in (-0.40, 0.40))
    )
    return [*out, m]


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
        collision="hull",
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
    b.friction = (0.9, 0.02, 0.04)
    b.rolls = "y"
    b.collide_cylinder((0, 0, 0.6), 0.6, 1.16, "y")
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
