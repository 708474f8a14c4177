"""Small out-of-distribution kinds, and those of paper: parts by material."""

from __future__ import annotations

import math

from kinds import half_round, ood
from model_writer import Model
from solids import ball, between, box, cylinder, extrude_x, extrude_y, frustum, lathe, loft, moved


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
        m.collide_hull(*m.everything())
        out.append(m)
    out.append(carrier_bag())
    for tag, roof in (("a", True), ("b", False)):
        m = ood(
            f"map_table_{tag}",
            "Sloping map board" + (" under a small roof." if roof else " on two posts."),
            70,
        )
        height = 2.2 if roof else 1.0
        for y in (-0.62, 0.62):
            m.collide_box((-0.1, y, height / 2), (0.10, 0.10, height))
        m.collide_box((0, 0, 1.0), (0.75, 1.4, 0.06), pitch=0.6)
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
            m.collide_hull(*m.parts["bark"])
        out.append(m)
    out.append(round_map_table())
    for tag, (l, w, h) in (("a", (0.55, 0.42, 0.40)), ("b", (0.80, 0.60, 0.62)), ("c", (0.45, 0.60, 0.25))):
        m = ood(
            f"cardboard_box_{tag}",
            "Cardboard box" + (" with open flaps." if tag == "b" else ", taped."),
            4,
            0.45,
            paint="card",
            colours={"card": (0.86, 0.83, 0.76), "tape": (0.20, 0.36, 0.62)} if tag == "c" else {},
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
        m.collide_hull(*m.parts["card"])
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
        m.collide_hull(*m.parts["paint"])
        m.collide_box((0, 0, 0.18), (0.40, 0.44, 0.36))
        out.append(m)
    return [*out, twin_newspaper_box()]


def carrier_bag() -> Model:
    """A full plastic bag with its two ears tied."""
    m = ood(
        "shopping_bag_c",
        "Full plastic carrier bag, tied.",
        5,
        0.4,
        paint="paint",
        colours={"paint": (0.90, 0.92, 0.94)},
    )
    rings = ((0.13, 0.0), (0.19, 0.05), (0.205, 0.15), (0.16, 0.27), (0.06, 0.36), (0.03, 0.40))
    creased = lambda t, z: 1 + 0.08 * math.sin(5 * t + 9 * z)  # noqa: E731
    m.add(
        "paint",
        loft(
            [
                [
                    (0.82 * r * creased(t, z) * math.cos(t), 1.1 * r * creased(t, z) * math.sin(t), z)
                    for t in (2 * math.pi * k / 20 for k in range(20))
                ]
                for r, z in rings
            ],
            smooth=True,
        ),
        *(
            between((0, s * 0.01, 0.39), (0.03, s * 0.07, 0.41), 0.03, 0.018, n=6, rounded=True)
            for s in (1, -1)
        ),
    )
    m.add("green", moved(cylinder(0.085, -0.01, 0.01, 14), (0.165, 0, 0.15), pitch=math.pi / 2))
    m.add("red", box((-0.165, 0, 0.15), (0.02, 0.16, 0.10)))
    m.collide_hull(*m.parts["paint"])
    return m


def round_map_table() -> Model:
    """A viewpoint's table: a tilted disc on a stone column."""
    m = ood("map_table_c", "Round map table on a stone column.", 320)
    m.add(
        "stone",
        lathe([(0, 0), (0.34, 0), (0.34, 0.10), (0.24, 0.14), (0.20, 0.85), (0.30, 0.92), (0, 0.92)], 14),
    )
    m.colours["stone"] = (0.52, 0.49, 0.45)
    top = lambda solid: moved(solid, (0, 0, 0.97), pitch=0.22)  # noqa: E731
    m.add("steel", top(cylinder(0.55, -0.03, 0.03, 24)))
    m.add("paper", top(cylinder(0.50, 0.03, 0.04, 24)))
    m.add(
        "green",
        top(ball((-0.12, 0.16, 0.035), (0.24, 0.18, 0.016), 10, 4)),
        top(ball((0.20, -0.18, 0.035), (0.14, 0.2, 0.016), 10, 4)),
    )
    m.add("blue", top(box((0.02, 0.02, 0.044), (0.74, 0.07, 0.008))))
    m.add("red", top(cylinder(0.05, 0.04, 0.055, 10)))
    m.collide_cylinder((0, 0, 0.46), 0.27, 0.92)
    m.collide_hull(*m.parts["steel"])
    return m


def twin_newspaper_box() -> Model:
    """Two compartments side by side on four legs."""
    m = ood(
        "newspaper_box_c",
        "Wide newspaper rack: two windows side by side on four legs.",
        48,
        0.45,
        paint="paint",
        colours={"paint": (0.90, 0.66, 0.10)},
    )
    m.add(
        "paint",
        extrude_y([(-0.22, 0.30), (0.22, 0.30), (0.22, 0.78), (0.10, 0.98), (-0.22, 0.98)], -0.52, 0.52),
    )
    m.add(
        "dark_steel", *(box((x, y, 0.15), (0.05, 0.05, 0.30)) for x in (-0.18, 0.18) for y in (-0.46, 0.46))
    )
    m.add("black", box((0, 0, 0.64), (0.45, 0.02, 0.66)))
    for y in (-0.26, 0.26):
        m.add("glass", box((0.22, y, 0.60), (0.015, 0.42, 0.28)))
        m.add("paper", box((0.226, y, 0.57), (0.012, 0.32, 0.18)))
        m.add("steel", box((0.235, y, 0.40), (0.03, 0.22, 0.03)))
    m.add("red", box((0.16, 0, 0.89), (0.012, 0.9, 0.10)))
    m.collide_hull(*m.parts["paint"])
    m.collide_box((0, 0, 0.15), (0.41, 0.97, 0.30))
    return m
