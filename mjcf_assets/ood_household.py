"""Washing machines and carpets, each in three shapes.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import (
    block,
    circle,
    frames,
    laid,
    over_ground,
    pillow,
    rough,
    rounded_rectangle,
    sweep,
    torus,
    tube,
)
from solids import ball, between, cylinder, lathe, moved


def washing_machines() -> list[Model]:
    """A front loader with its door open, one on its back, dented, and the bare drum of a third."""
    tones = {
        "enamel": (0.90, 0.91, 0.92),
        "door": (0.70, 0.72, 0.74),
        "hole": (0.07, 0.07, 0.08),
        "panel": (0.30, 0.32, 0.35),
        "knob": (0.78, 0.79, 0.80),
    }
    a = unseen("washing_machine_a", "Washing machine, standing, its door open.", 68, 0.55, **tones)
    washer(a, 0.60, 0.85, lambda s: s, 1.9, 0.0)
    a.collide_box((0, 0, 0.43), (0.56, 0.60, 0.85))
    b = unseen(
        "washing_machine_b",
        "Washing machine on its back, dented, the hose torn off.",
        61,
        0.5,
        **tones | {"enamel": (0.80, 0.79, 0.74), "hose": (0.45, 0.46, 0.48)},
    )

    def back(s):
        return moved(s, (0, 0, 0.30), pitch=-math.pi / 2)

    washer(b, 0.56, 0.80, back, 0.0, 0.05)
    laid(b, 0.0, 0.02)
    b.add(
        "hose",
        over_ground(
            tube(
                [
                    (-0.03, 0.18, 0.06, 0.017),
                    (0.10, 0.10, 0.02, 0.017),
                    (0.22, 0.22, 0.017, 0.017),
                    (0.14, 0.38, 0.017, 0.017),
                    (-0.04, 0.40, 0.03, 0.017),
                    (-0.12, 0.46, 0.017, 0.017),
                ],
                7,
                22,
            )
        ),
    )
    b.collide_hull(*b.parts["enamel"][:1])
    c = unseen(
        "washing_machine_c",
        "Drum of a washing machine in its tub, with belt wheel and weight.",
        38,
        0.5,
        drum=(0.74, 0.75, 0.77),
        tub=(0.62, 0.64, 0.62),
        hole=(0.08, 0.08, 0.09),
        concrete=(0.55, 0.54, 0.52),
        rubber=(0.30, 0.31, 0.33),
    )

    def tilt(s):
        return moved(s, (0, 0, 0.27), pitch=math.pi / 2 - 0.25)

    c.add(
        "tub",
        tilt(
            rough(
                lathe(
                    [
                        (0, -0.22),
                        (0.20, -0.22),
                        (0.265, -0.17),
                        (0.27, 0.0),
                        (0.275, 0.14),
                        (0.262, 0.16),
                        (0.25, 0.14),
                        (0.245, -0.1),
                        (0, -0.12),
                    ],
                    22,
                    sharp=False,
                ),
                0.006,
                0.2,
                2,
            )
        ),
    )
    c.add(
        "drum",
        tilt(
            lathe(
                [
                    (0.235, -0.10),
                    (0.238, 0.15),
                    (0.20, 0.20),
                    (0.165, 0.205),
                    (0.16, 0.19),
                    (0.19, 0.18),
                    (0.225, 0.13),
                    (0.22, -0.09),
                ],
                22,
                sharp=False,
            )
        ),
    )
    c.add("rubber", tilt(moved(torus(0.17, 0.022, 22, 6), (0, 0, 0.21))))
    c.add("hole", tilt(cylinder(0.22, -0.09, -0.08, 18)))
    c.add(
        "drum",
        *(
            tilt(moved(pillow((0.20, 0, 0.04), (0.07, 0.06, 0.20), 3, 3), yaw=2 * math.pi * k / 3))
            for k in range(3)
        ),
    )
    c.add(
        "drum",
        tilt(moved(torus(0.15, 0.014, 20, 5), (0, 0, -0.26))),
        *(
            tilt(between((0, 0, -0.25), (0.15 * math.cos(t), 0.15 * math.sin(t), -0.26), 0.014, n=5))
            for t in (0.3, 1.56, 2.8, 4.1, 5.3)
        ),
        tilt(cylinder(0.03, -0.29, -0.2, 8)),
    )
    c.add(
        "concrete",
        tilt(
            rough(
                sweep(
                    [(0.29 * math.cos(t), 0.29 * math.sin(t), 0.07) for t in np.linspace(2.2, 4.1, 9)],
                    rounded_rectangle(0.10, 0.16, 0.02, 1),
                ),
                0.006,
                0.1,
                4,
            )
        ),
    )
    laid(c, 0.13, 0.21)
    c.collide_hull(*c.parts["tub"], *c.parts["drum"], *c.parts["concrete"])
    return [a, b, c]


def washer(m: Model, w: float, h: float, place, door_rad: float, dent_m: float) -> None:
    """A front loader, 0.56 m deep, with feet; its front is at +x."""
    d, z0 = 0.56, 0.03
    v, f = pillow((0, 0, z0 + (h - z0) / 2), (d, w, h - z0), 8, 16)
    if dent_m:
        for at, r in (
            ((d / 2, w * 0.3, h * 0.9), 0.18),
            ((0.0, -w / 2, h * 0.5), 0.2),
            ((-0.1, w / 2, 0.3), 0.15),
        ):
            off = np.linalg.norm(v - at, axis=1)
            v = v - dent_m * np.exp(-((off / r) ** 2))[:, None] * (v - (0, 0, h / 2)) / 0.45
    m.add("enamel", place((v, f)))
    m.add("panel", place(pillow((d / 2, 0.08, h - 0.075), (0.03, w - 0.24, 0.09), 3, 8)))
    m.add("door", place(pillow((d / 2, -w / 2 + 0.10, h - 0.075), (0.026, 0.16, 0.09), 3, 8)))
    m.add(
        "knob",
        place(moved(cylinder(0.034, 0, 0.045, 14, top=0.028), (d / 2, 0.06, h - 0.075), pitch=math.pi / 2)),
    )
    z = 0.43 * h / 0.85 + 0.02
    m.add("hole", place(moved(cylinder(0.165, 0.0, 0.012, 22), (d / 2 - 0.004, 0, z), pitch=math.pi / 2)))
    m.add("door", place(moved(torus(0.175, 0.022, 24, 6), (d / 2 + 0.004, 0, z), pitch=math.pi / 2)))

    def hinge(s):
        return place(moved(moved(s, (0, -0.2, 0)), (d / 2 + 0.02, 0.2, z), yaw=door_rad))

    m.add("door", hinge(moved(torus(0.155, 0.03, 24, 6, 0.6), (0.012, 0, 0), pitch=math.pi / 2)))
    m.add("glass", hinge(ball((0.0, 0, 0), (0.06, 0.14, 0.14), 14, 8)))
    m.add(
        "black",
        *(
            place(cylinder(0.025, 0, z0 + 0.02, 8, (x, y)))
            for x in (-0.22, 0.22)
            for y in (-w / 2 + 0.07, w / 2 - 0.07)
        ),
    )


def carpet_rolls() -> list[Model]:
    """A roll that sags, a tall one that stands and leans, and one half unrolled."""
    no_faces = np.zeros((0, 3), int)
    a = unseen(
        "carpet_roll_a",
        "Rolled carpet, bent, lying.",
        24,
        0.3,
        pile=(0.46, 0.14, 0.16),
        back=(0.72, 0.64, 0.50),
        cord=(0.9, 0.88, 0.8),
    )
    way = [(0.05 * math.cos(1.6 * y) - 0.28 * (y / 1.3) ** 2, y, 0.155) for y in np.linspace(-1.3, 1.3, 15)]
    roll(a, way, 0.15)
    for k in (4, 10):
        p = np.array(way[k])
        a.add("cord", moved(torus(0.155, 0.012, 14, 4), p, roll=math.pi / 2))
    v = a.parts["pile"][0][0]
    for low in (-1.32, -0.46, 0.42):
        a.collide_hull((v[(v[:, 1] > low - 0.1) & (v[:, 1] < low + 0.98)], no_faces))
    a.friction = (0.9, 0.02, 0.05)
    b = unseen(
        "carpet_roll_b",
        "Tall carpet roll that stands on end and sags.",
        30,
        0.3,
        pile=(0.20, 0.26, 0.44),
        back=(0.60, 0.58, 0.54),
        cord=(0.85, 0.7, 0.2),
    )
    way = [(0.16 * (z / 1.9) ** 2 - 0.05, 0.05 * math.sin(1.8 * z), z) for z in np.linspace(0, 1.9, 11)]
    roll(b, way, 0.18)
    for k in (3, 7):
        b.add("cord", moved(torus(0.188, 0.012, 14, 4), way[k], pitch=0.08))
    laid(b)
    v = b.parts["pile"][0][0]
    foot = [cylinder(0.19, 0, 0.02, 12, way[0][:2])]
    for low, high in ((-1.0, 1.2), (1.1, 3.0)):
        b.collide_hull((v[(v[:, 2] > low) & (v[:, 2] < high)], no_faces), *foot)
        foot = []
    c = unseen(
        "carpet_roll_c",
        "Persian rug, half unrolled, in waves.",
        15,
        0.3,
        pile=(0.52, 0.10, 0.10),
        border=(0.10, 0.12, 0.26),
        field=(0.78, 0.62, 0.34),
        fringe=(0.88, 0.84, 0.74),
    )
    turns = [
        (0.35 - (0.15 - 0.009 * t) * math.sin(t), 0.16 - (0.15 - 0.009 * t) * math.cos(t))
        for t in np.linspace(0, 4 * math.pi, 28)
    ]
    flat = [
        (-1.05 + 1.4 * k / 16, 0.010 + 0.05 * math.sin(5.5 * k / 16 * 1.4) ** 2 * (1 - k / 16))
        for k in range(16)
    ]
    line = [(2 * 0.35 - x, z) for x, z in turns]
    path = [(x, z) for x, z in flat] + [(0.7 - x, z) for x, z in line]
    ys = (-0.62, -0.55, -0.45, 0.45, 0.55, 0.62)
    for y0, y1, material in zip(ys, ys[1:], ("pile", "border", "pile", "border", "pile")):
        ribbon(c, material, path, y0, y1)

    def height(x):
        return 0.03 + 0.05 * math.sin(5.5 * (x + 1.05)) ** 2 * (1 - (x + 1.05) / 1.4)

    for x in (-0.84, -0.45, -0.06):
        c.add("field", moved(block((0, 0, 0), (0.24, 0.24, 0.02)), (x, 0, height(x)), yaw=math.pi / 4))
        c.add("border", moved(block((0, 0, 0), (0.12, 0.12, 0.034)), (x, 0, height(x)), yaw=math.pi / 4))
    c.add("fringe", *(block((-1.09, y, 0.008), (0.07, 0.02, 0.01)) for y in np.linspace(-0.6, 0.6, 13)))
    c.collide_box((-0.35, 0, 0.012), (1.40, 1.24, 0.024))
    c.collide_hull(moved(cylinder(0.155, -0.62, 0.62, 12), (0.35, 0, 0.165), roll=math.pi / 2))
    return [a, b, c]


def roll(m: Model, way, r: float) -> None:
    """A carpet wound about a path: the edge of the outer turn stands off, the ends show the turns."""
    n = 18
    section = [
        (
            (r + (0.018 if k == 0 else 0)) * math.cos(2 * math.pi * k / n),
            (r + (0.018 if k == 0 else 0)) * math.sin(2 * math.pi * k / n),
        )
        for k in range(n)
    ]
    m.add("pile", rough(sweep(way, section), 0.012, 0.3, 6))
    for end, inner in ((0, 1), (-1, -2)):
        p, q = np.array(way[end], float), np.array(way[inner], float)
        out = (p - q) / np.linalg.norm(p - q)
        for radius in (0.78 * r, 0.5 * r, 0.2 * r):
            side, up = frames(np.array([q, p]))[0]
            loop = [
                p + out * 0.006 + radius * (math.cos(t) * side + math.sin(t) * up)
                for t in np.linspace(0, 2 * math.pi, 15)[:-1]
            ]
            m.add("back", sweep(loop, circle(4, 0.014, 0.014), closed=True))


def ribbon(m: Model, material: str, path, y0: float, y1: float) -> None:
    """A cloth 12 mm thick along a line (x, z)."""
    m.add(
        material,
        sweep(
            [(x, (y0 + y1) / 2, z) for x, z in path],
            [
                (y0 - (y0 + y1) / 2, -0.006),
                ((y1 - y0) / 2, -0.006),
                ((y1 - y0) / 2, 0.006),
                (-(y1 - y0) / 2, 0.006),
            ],
        ),
    )
