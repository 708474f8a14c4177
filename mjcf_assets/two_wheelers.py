"""Bicycle, motorcycle and scooter, each with its rider: parts by material, facing +x."""

from __future__ import annotations

import math

from model_writer import Model
from solids import Solid, ball, between, box, cylinder, extrude_y, frustum, loft, moved


def torso(m: Model, material: str, low, high, h: float) -> None:
    rows = []
    for t, rx, ry in (
        (0, 0.055, 0.088),
        (0.3, 0.058, 0.085),
        (0.7, 0.070, 0.112),
        (0.9, 0.055, 0.110),
        (1, 0.03, 0.05),
    ):
        c = [low[k] + t * (high[k] - low[k]) for k in range(3)]
        rows.append(
            [
                (c[0] + rx * h * math.cos(a), c[1] + ry * h * math.sin(a), c[2])
                for a in (2 * math.pi * k / 12 for k in range(12))
            ]
        )
    m.add(material, loft(rows, smooth=True))


def ring(centre, radius: float, tube: float, n: int = 16, bead: int = 5) -> list[Solid]:
    """A tyre in the xz plane, as bars from point to point."""
    (x, y, z), turn = centre, 2 * math.pi / n
    points = [(x + radius * math.cos(turn * k), y, z + radius * math.sin(turn * k)) for k in range(n)]
    return [between(points[k], points[(k + 1) % n], tube, n=bead) for k in range(n)]


def motorcycle() -> Model:
    m = Model(
        "motorcycle",
        "two_wheeler",
        "vehicle",
        "Motorcycle with rider.",
        280,
        0.35,
        paint="tank",
        colours={
            "tank": (0.70, 0.12, 0.08),
            "jacket": (0.10, 0.11, 0.13),
            "trousers": (0.13, 0.16, 0.24),
            "helmet": (0.85, 0.85, 0.84),
        },
    )
    for x in (0.72, -0.70):
        m.add("tyre", *ring((x, 0, 0.32), 0.265, 0.058, 18, 7))
        m.add("rim", moved(cylinder(0.205, -0.03, 0.03, 14), (x, 0, 0.32), roll=math.pi / 2))
    m.add(
        "tank",
        loft(
            [
                [
                    (x, r * math.cos(t), z + 0.85 * r * math.sin(t))
                    for t in (math.pi * k / 5 for k in range(10))
                ]
                for x, z, r in (
                    (0.42, 0.84, 0.09),
                    (0.32, 0.87, 0.16),
                    (0.08, 0.85, 0.17),
                    (-0.08, 0.80, 0.10),
                )
            ],
            smooth=True,
        ),
        frustum((-0.86, -0.42, -0.09, 0.09, 0.74), (-0.92, -0.44, -0.08, 0.08, 0.84)),
        moved(
            extrude_y([(-0.30, 0.0), (0.24, 0.02), (0.16, 0.09), (-0.20, 0.10)], -0.07, 0.07), (0.70, 0, 0.62)
        ),
    )
    m.add(
        "trim",
        frustum((-0.66, -0.04, -0.12, 0.12, 0.76), (-0.62, -0.08, -0.10, 0.10, 0.85)),
        box((0.02, 0, 0.46), (0.52, 0.26, 0.34)),
        between((0.40, -0.34, 1.02), (0.40, 0.34, 1.02), 0.018, n=6),
        *(box((0.36, s * 0.40, 1.13), (0.03, 0.13, 0.08)) for s in (1, -1)),
    )
    m.add(
        "steel",
        *(between((0.72, s * 0.09, 0.32), (0.42, s * 0.08, 0.98), 0.026, n=7) for s in (1, -1)),
        *(between((-0.70, s * 0.09, 0.32), (-0.05, s * 0.10, 0.40), 0.025, n=6) for s in (1, -1)),
        between((0.05, -0.16, 0.28), (-0.82, -0.17, 0.42), 0.045, 0.055, n=8),
    )
    m.add("headlamp", moved(cylinder(0.085, -0.05, 0.05, 12), (0.52, 0, 0.90), pitch=math.pi / 2))
    m.add("taillamp", box((-0.92, 0, 0.78), (0.04, 0.14, 0.06)))
    m.add("plate", box((-0.94, 0, 0.62), (0.02, 0.20, 0.16)))
    rider(
        m,
        1.74,
        (-0.28, 0.92),
        (0.12, 1.40),
        (0.40, 0.32, 1.04),
        (0.16, 0.20, 0.72),
        (-0.10, 0.19, 0.32),
        "jacket",
    )
    m.add("helmet", ball((0.21, 0, 1.60), (0.145, 0.125, 0.15), 12, 8))
    m.add("glass", box((0.325, 0, 1.60), (0.05, 0.17, 0.08)))
    return m


def scooter() -> Model:
    m = Model(
        "scooter",
        "two_wheeler",
        "vehicle",
        "Motor scooter with rider and a top case.",
        190,
        0.35,
        paint="paint",
        colours={
            "paint": (0.72, 0.80, 0.78),
            "jacket": (0.82, 0.46, 0.10),
            "trousers": (0.20, 0.22, 0.28),
            "helmet": (0.12, 0.12, 0.13),
        },
    )
    for x in (0.63, -0.60):
        m.add("tyre", *ring((x, 0, 0.23), 0.18, 0.05, 16, 7))
        m.add("rim", moved(cylinder(0.13, -0.03, 0.03, 12), (x, 0, 0.23), roll=math.pi / 2))
    m.add(
        "paint",
        # Leg shield, floor, tail and the front wheel's cover.
        moved(
            frustum((-0.03, 0.05, -0.22, 0.22, 0.0), (-0.03, 0.03, -0.15, 0.15, 0.66)),
            (0.40, 0, 0.30),
            pitch=-0.16,
        ),
        box((0.14, 0, 0.28), (0.52, 0.32, 0.07)),
        loft(
            [
                [
                    (x, r * math.cos(t), z + 0.9 * r * math.sin(t))
                    for t in (math.pi * k / 5 for k in range(10))
                ]
                for x, z, r in (
                    (-0.06, 0.50, 0.15),
                    (-0.30, 0.52, 0.21),
                    (-0.66, 0.58, 0.17),
                    (-0.86, 0.62, 0.08),
                )
            ],
            smooth=True,
        ),
        moved(extrude_y([(-0.20, 0), (0.20, 0), (0.12, 0.12), (-0.14, 0.14)], -0.07, 0.07), (0.63, 0, 0.40)),
        box((0.34, 0, 1.00), (0.14, 0.22, 0.13)),
    )
    m.add(
        "trim",
        box((-0.34, 0, 0.74), (0.62, 0.26, 0.08)),
        box((-0.80, 0, 0.92), (0.34, 0.38, 0.30)),
        between((0.33, -0.33, 1.04), (0.33, 0.33, 1.04), 0.018, n=6),
        *(box((0.34, s * 0.36, 1.16), (0.03, 0.12, 0.08)) for s in (1, -1)),
    )
    m.add("steel", *(between((0.63, s * 0.08, 0.23), (0.40, s * 0.05, 0.80), 0.024, n=6) for s in (1, -1)))
    m.add("headlamp", box((0.42, 0, 1.00), (0.05, 0.15, 0.09)))
    m.add("taillamp", box((-0.875, 0, 0.66), (0.04, 0.16, 0.07)))
    m.add("plate", box((-0.89, 0, 0.50), (0.02, 0.18, 0.15)))
    rider(
        m,
        1.68,
        (-0.30, 0.86),
        (-0.16, 1.38),
        (0.33, 0.30, 1.06),
        (0.12, 0.17, 0.78),
        (0.16, 0.14, 0.40),
        "jacket",
    )
    m.add("helmet", ball((-0.13, 0, 1.57), (0.14, 0.125, 0.145), 12, 8))
    m.add("skin", ball((-0.02, 0, 1.53), (0.06, 0.07, 0.08)))
    return m


def rider(m: Model, height: float, hip, shoulders, hand, knee, foot, top: str) -> None:
    """One who sits: hip and shoulders (x, z) on the middle plane, the rest on the left, mirrored."""
    torso(m, top, (hip[0], 0, hip[1]), (shoulders[0] + 0.05, 0, shoulders[1] + 0.05), height)
    for side in (1, -1):
        at = lambda p, s=side: (p[0], s * p[1], p[2])  # noqa: E731
        m.add(
            "trousers",
            between((hip[0], side * 0.10, hip[1]), at(knee), 0.088, 0.066, rounded=True),
            between(at(knee), at(foot), 0.062, 0.045, rounded=True),
        )
        m.add("shoe", box((foot[0] + 0.06, side * foot[1], foot[2] - 0.04), (0.26, 0.10, 0.09)))
        shoulder = (shoulders[0], side * 0.18, shoulders[1] - 0.01)
        elbow = (
            (shoulder[0] + hand[0]) / 2 - 0.05,
            side * 0.30,
            (shoulder[2] + hand[2]) / 2 - 0.06,
        )
        m.add(
            top,
            between(shoulder, elbow, 0.060, 0.050, rounded=True),
            between(elbow, at(hand), 0.048, 0.038, rounded=True),
        )
        m.add("black", ball(at(hand), (0.05, 0.045, 0.04), 8, 5))


def cyclist() -> Model:
    m = Model(
        "cyclist",
        "two_wheeler",
        "vehicle",
        "Bicycle with rider.",
        90,
        0.3,
        paint="clothes",
        colours={"clothes": (0.12, 0.42, 0.36), "trousers": (0.12, 0.12, 0.15), "frame": (0.70, 0.10, 0.10)},
    )
    for x in (0.53, -0.53):
        m.add("tyre", *ring((x, 0, 0.35), 0.325, 0.024))
        spokes = [
            (x + 0.325 * math.cos(a), 0, 0.35 + 0.325 * math.sin(a))
            for a in (math.pi * k / 4 for k in range(8))
        ]
        m.add("rim", *(between((x, 0, 0.35), end, 0.007, n=4) for end in spokes))
    crank, seat = (-0.08, 0, 0.30), (-0.24, 0, 0.92)
    rods = [
        (crank, seat),
        (seat, (0.34, 0, 0.86)),
        (crank, (0.38, 0, 0.74)),
        ((0.53, 0, 0.35), (0.36, 0, 1.02)),
        (crank, (-0.53, 0, 0.35)),
        ((-0.53, 0, 0.35), (-0.22, 0, 0.84)),
        ((0.36, -0.28, 1.05), (0.36, 0.28, 1.05)),
    ]
    m.add("frame", *(between(p, q, 0.022, n=6) for p, q in rods))
    m.add("trim", box((-0.25, 0, 0.95), (0.26, 0.16, 0.06)))
    hip, shoulders = (-0.22, 0, 1.02), (0.08, 0, 1.46)
    torso(m, "clothes", hip, (0.14, 0, 1.50), 1.70)
    for side, foot, knee in (
        (1, (-0.02, 0.13, 0.14), (0.14, 0.12, 0.60)),
        (-1, (-0.12, -0.13, 0.46), (0.20, -0.12, 0.82)),
    ):
        m.add(
            "trousers",
            between((hip[0], side * 0.09, hip[2] - 0.02), knee, 0.085, 0.062, rounded=True),
            between(knee, foot, 0.058, 0.042, rounded=True),
        )
        m.add("shoe", box((foot[0] + 0.06, foot[1], foot[2] - 0.04), (0.25, 0.09, 0.08)))
        elbow, hand = (0.22, side * 0.24, 1.22), (0.36, side * 0.25, 1.08)
        m.add(
            "clothes", between((shoulders[0], side * 0.18, shoulders[2]), elbow, 0.055, 0.045, rounded=True)
        )
        m.add("skin", between(elbow, hand, 0.040, 0.034, rounded=True))
    m.add("skin", ball((0.20, 0, 1.63), (0.095, 0.078, 0.115)))
    m.add("helmet", ball((0.18, 0, 1.68), (0.13, 0.095, 0.095)))
    m.colours["helmet"] = (0.90, 0.90, 0.88)
    return m
