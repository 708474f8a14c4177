"""Debris, each in three shapes: branches, planks, rubble.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import (
    bent,
    block,
    creased,
    noise,
    painted,
    pillow,
    rough,
    rounded_rectangle,
    spline,
    stone,
    sweep,
    tube,
)
from solids import Solid, faceted, moved


def branches() -> list[Model]:
    """A leafy bough, a long bare one, and a thick limb in autumn."""
    a = unseen(
        "branch_a",
        "Broken bough with its leaves.",
        22,
        0.3,
        bark=(0.32, 0.24, 0.17),
        leaf=(0.24, 0.42, 0.12),
        wood=(0.80, 0.66, 0.44),
    )
    bough(a, 2.3, 0.055, 7, 1, 0.8, 9)
    b = unseen(
        "branch_b", "Dead branch, forked and bare.", 16, 0.3, bark=(0.42, 0.38, 0.34), wood=(0.72, 0.60, 0.42)
    )
    bough(b, 3.1, 0.075, 9, 4, 1.0, 0)
    c = unseen(
        "branch_c",
        "Short thick limb with autumn leaves.",
        30,
        0.3,
        bark=(0.25, 0.19, 0.14),
        leaf=(0.70, 0.36, 0.08),
        wood=(0.84, 0.70, 0.46),
    )
    bough(c, 1.5, 0.10, 6, 8, 0.75, 10)
    return [a, b, c]


def bough(m: Model, length: float, r: float, n_twigs: int, seed: int, reach: float, n_leaves: int) -> None:
    """A limb that lies on its twigs, along x; the leaves are small lozenges at the ends of the twigs."""

    def h(k, j=0):
        return float(noise(np.array([[0.77 * k + 0.3, 1.31 * j + 0.1, 0.5]]), 0.5, seed)[0])

    points = [
        (
            length * (t - 0.5),
            0.12 * length * h(k),
            r * 1.3 + 0.10 * length * t * (1 - t) + 0.04 * abs(h(k, 1)),
            r * (1 - 0.8 * t) + 0.006,
        )
        for k, t in enumerate(np.linspace(0, 1, 6))
    ]
    m.add("bark", tube(points, 8, 14))
    stem = spline(points, 40)
    m.add(
        "wood",
        *(
            tube(
                [
                    stem[0] * (1, 1, 1, 0) + (0.02, 0, 0, 0.5 * r),
                    stem[0] * (1, 1, 1, 0)
                    + (-0.13 - 0.06 * h(k), r * math.cos(k) * 0.6, r * math.sin(k) * 0.6, 0.008),
                ],
                5,
            )
            for k in range(3)
        ),
    )
    for k in range(n_twigs):
        t = 0.22 + 0.74 * (k + 0.3) / n_twigs
        root = stem[int(39 * t)]
        side = (-1) ** k
        own = reach * length * 0.30 * (1.15 - 0.75 * t) * (1 + 0.3 * h(k, 3))
        out = np.array((0.75, side * (0.75 + 0.3 * h(k, 4)), 0.45 * h(k, 5)))
        way = [
            root[:3] + own * s * out * np.array((1, 1 - 0.25 * s, 1)) + (0, 0, 0.05 * math.sin(3 * s))
            for s in (0, 0.35, 0.7, 1)
        ]
        way = [np.array((p[0], p[1], max(p[2], 0.02 + 0.01 * s))) for s, p in enumerate(way)]
        r0 = 0.55 * root[3]
        m.add("bark", tube([(*p, max(r0 * (1 - 0.27 * s), 0.006)) for s, p in enumerate(way)], 6, 6))
        for j in (1, 2):
            p, q = (
                way[j],
                way[j] + own * np.array((0.30, side * (0.1 - 0.5 * (j - 1)), 0.25 + 0.3 * h(k, 6 + j))),
            )
            q[2] = max(q[2], 0.02)
            m.add(
                "bark",
                tube([(*p, max(r0 * 0.5, 0.006)), (*((p + q) / 2 + (0, 0.02, 0.02)), 0.007), (*q, 0.005)], 5),
            )
            tips = [p + (q - p) * 0.7, q]
            for i in range(n_leaves // 2 if n_leaves else 0):
                at = tips[i % 2] + 0.09 * np.array([h(9 * k + i, 11 + 5 * j + d) for d in range(3)])
                m.add(
                    "leaf",
                    leaf(np.maximum(at, (-9, -9, 0.07)), 3 * h(i + k, 20 + j), 1.2 * h(i + k, 30 + j), 0.16),
                )
        for i in range(n_leaves // 2 if n_leaves else 0):
            at = (
                way[3]
                - 0.25 * own * out * (i / 5)
                + 0.09 * np.array([h(9 * k + i, 41 + d) for d in range(3)])
            )
            m.add("leaf", leaf(np.maximum(at, (-9, -9, 0.07)), 3 * h(i + k, 50), 1.2 * h(i + k, 60), 0.17))
    m.collide_hull(tube(points[:4], 7))
    m.collide_hull(*m.parts["bark"][1:], *m.parts.get("leaf", []), tube(points[2:], 7))
    m.friction = (0.9, 0.02, 0.05)


def leaf(at, yaw: float, pitch: float, length: float) -> Solid:
    """A small spray of leaves: a lozenge, folded along its middle."""
    l, w, t = length / 2, length * 0.32, 0.02
    v = np.array([(-l, 0, 0), (0, -w, t), (l, 0, -t), (0, w, t), (0, 0, 0.006), (0, 0, -0.012)])
    f = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5)])
    return moved((v, f), at, yaw=yaw, pitch=pitch)


def planks() -> list[Model]:
    """Warped boards in a heap, a broken scaffold board, beams with formwork."""
    a = unseen(
        "planks_a",
        "Heap of warped boards.",
        38,
        0.4,
        board=(0.70, 0.54, 0.34),
        grey=(0.50, 0.46, 0.41),
        end=(0.86, 0.74, 0.54),
    )
    for k, (x, y, z, yaw, pitch, l, w) in enumerate(
        (
            (0.0, -0.20, 0.02, 0.10, 0.0, 2.2, 0.14),
            (-0.15, 0.12, 0.02, -0.25, 0.0, 1.9, 0.12),
            (0.2, 0.30, 0.02, 0.05, 0.0, 1.6, 0.16),
            (0.05, 0.0, 0.075, 0.75, 0.02, 1.7, 0.14),
            (-0.1, 0.05, 0.12, -0.7, -0.07, 1.9, 0.12),
            (0.1, 0.10, 0.165, 0.2, 0.09, 2.0, 0.15),
        )
    ):
        a.add("grey" if k in (1, 4) else "board", plank((x, y, z), yaw, pitch, l, w, 0.028, k))
    a.collide_hull(*a.everything())
    b = unseen(
        "planks_b",
        "Scaffold board, snapped; one half lies across the other.",
        19,
        0.45,
        board=(0.62, 0.50, 0.34),
        end=(0.88, 0.78, 0.58),
        steel=(0.66, 0.67, 0.68),
    )
    for s, pose in ((1, ((0.55, 0.0, 0.022), 0.0, 0.0)), (-1, ((-0.20, 0.12, 0.10), 0.75, -0.10))):

        def half(solid, p=pose):
            return moved(solid, p[0], yaw=p[1], pitch=p[2])

        b.add("board", half(plank((0, 0, 0), 0, 0, 1.3, 0.225, 0.038, 3 + s)))
        b.add("steel", half(moved(block((0, 0, 0), (0.03, 0.235, 0.046)), (s * 0.60, 0, 0))))
        for k in range(7):
            y = (k - 3) * 0.03
            spike = tube(
                [
                    (-s * 0.64, y, 0, 0.014),
                    (-s * (0.72 + 0.05 * math.sin(5 * k + s)), y * 1.1, 0.02 * math.sin(3 * k), 0.003),
                ],
                4,
            )
            b.add("end", half(spike))
    b.collide_hull(*b.everything())
    c = unseen(
        "planks_c",
        "Roof beams and a formwork panel across them.",
        74,
        0.4,
        board=(0.74, 0.60, 0.38),
        panel=(0.86, 0.66, 0.12),
        end=(0.88, 0.74, 0.50),
        red=(0.75, 0.12, 0.10),
    )
    for k, (x, y, z, yaw, l) in enumerate(
        ((0, 0.32, 0.05, 0.06, 3.2), (0.1, -0.30, 0.05, -0.09, 2.7), (-0.2, 0.02, 0.05, 0.02, 2.4))
    ):
        c.add("board", plank((x, y, z), yaw, 0, l, 0.10, 0.10, 10 + k, 0.012))
        c.add("red", moved(block((l / 2 - 0.06, 0, 0), (0.1, 0.104, 0.104)), (x, y, z), yaw=yaw))

    def sag(v):
        return v + np.stack([0 * v[:, 0], 0 * v[:, 0], 0.035 * np.cos(2.2 * v[:, 0]) - 0.02], 1)

    panel = sweep(
        [(x, 0, 0) for x in np.linspace(-0.75, 0.75, 9)], rounded_rectangle(0.6, 0.027, 0.004, 1), sharp=True
    )
    c.add("panel", moved(bent(panel, sag), (0.15, 0.1, 0.135), yaw=0.85, pitch=0.04))
    c.collide_hull(*c.parts["board"])
    c.collide_hull(*c.parts["panel"])
    return [a, b, c]


def plank(at, yaw: float, pitch: float, l: float, w: float, h: float, seed: int, warp: float = 0.03) -> Solid:
    """A sawn board that is warped and twisted."""
    v, f = sweep([(x, 0, 0) for x in np.linspace(-l / 2, l / 2, 8)], rounded_rectangle(w, h, 0.004, 1))
    twist = 0.10 * math.sin(1.7 * seed) * v[:, 0] / l
    v = np.stack(
        [
            v[:, 0] + 0.02 * np.sin(60 * v[:, 1] + seed) * (np.abs(v[:, 0]) > 0.49 * l),
            v[:, 1],
            v[:, 2] + twist * v[:, 1] + warp * ((2 * v[:, 0] / l) ** 2 - 0.4) * math.cos(seed),
        ],
        1,
    )
    return moved(creased(faceted((v, f))), at, yaw=yaw, pitch=pitch)


def rubble() -> list[Model]:
    """Bricks with mortar, concrete with reinforcing iron, and a rock with its splinters."""
    a = unseen(
        "rubble_a",
        "Heap of bricks and mortar.",
        130,
        0.35,
        brick=(0.62, 0.26, 0.17),
        pale=(0.72, 0.38, 0.26),
        mortar=(0.66, 0.63, 0.57),
    )
    for k in range(15):
        t, ring_m = 2.4 * k, 0.09 * math.sqrt(k)
        z = max(0.05, 0.30 - 0.75 * ring_m)
        piece = rough(pillow((0, 0, 0), (0.24, 0.115, 0.071), 2, 12), 0.014, 0.07, k)
        a.add(
            "pale" if k % 4 == 1 else "brick",
            moved(
                creased(faceted(piece)),
                (1.15 * ring_m * math.cos(t), ring_m * math.sin(t), z),
                yaw=1.7 * k,
                pitch=0.5 * math.sin(3 * k),
                roll=0.6 * math.cos(2 * k),
            ),
        )
    a.add(
        "mortar",
        *(
            stone((0.36 * math.cos(t), 0.33 * math.sin(t), 0.05), (0.18, 0.16, 0.12), k, 2)
            for k, t in enumerate(np.linspace(0, 6.28, 7)[:-1])
        ),
    )
    a.add("mortar", rough(pillow((0, 0, 0.09), (0.75, 0.66, 0.20), 5, 2.2), 0.03, 0.12, 3))
    a.collide_hull(*a.everything())
    b = unseen(
        "rubble_b",
        "Broken concrete with reinforcing iron.",
        420,
        0.35,
        concrete=(0.60, 0.59, 0.56),
        dark=(0.34, 0.34, 0.34),
        iron=(0.40, 0.23, 0.14),
    )
    for k, (x, y, z, l, w, h) in enumerate(
        (
            (0.0, 0.0, 0.22, 0.95, 0.70, 0.42),
            (-0.55, 0.35, 0.16, 0.50, 0.42, 0.30),
            (0.60, -0.30, 0.14, 0.45, 0.36, 0.28),
            (0.50, 0.45, 0.10, 0.30, 0.34, 0.20),
            (-0.45, -0.45, 0.09, 0.34, 0.28, 0.18),
            (-0.85, -0.05, 0.06, 0.2, 0.16, 0.12),
        )
    ):
        b.add("concrete", rough(stone((x, y, z), (l, w, h), k + 3, 5 if k == 0 else 3), 0.015, 0.08, k))
    b.add("dark", rough(stone((0.05, 0.52, 0.06), (0.52, 0.40, 0.12), 21, 3), 0.01, 0.1, 2))
    for k, (x, y, s) in enumerate(((0.30, 0.16, 1), (0.38, -0.05, 1), (-0.3, -0.18, -1), (-0.36, 0.10, -1))):
        b.add(
            "iron",
            tube(
                [
                    (x * 0.7, y, 0.28, 0.009),
                    (x + 0.18 * s, y * 1.2, 0.42 + 0.04 * k, 0.009),
                    (x + 0.26 * s, y * 1.8 + 0.05, 0.62 - 0.05 * k, 0.009),
                    (x + 0.44 * s, y * 2, 0.60 - 0.08 * k, 0.009),
                ],
                5,
                9,
            ),
        )
    b.collide_hull(*b.parts["concrete"])
    c = unseen(
        "rubble_c",
        "Rock from a slope with its splinters and earth.",
        650,
        0.3,
        rock=(0.47, 0.44, 0.40),
        moss=(0.30, 0.36, 0.18),
        earth=(0.34, 0.25, 0.17),
    )
    v, f = rough(stone((0, 0, 0.36), (0.95, 0.80, 0.78), 17, 8, sharp=False), 0.05, 0.22, 9)
    for material, solids in painted(
        (v, f), lambda x, y, z: "moss" if z > 0.50 and math.sin(7 * x + 2) + math.sin(9 * y) > 0.2 else "rock"
    ).items():
        c.add(material, *(creased(faceted(s)) for s in solids))
    for k, (x, y, size) in enumerate(
        (
            (0.62, 0.20, 0.30),
            (-0.55, -0.42, 0.26),
            (0.40, -0.52, 0.20),
            (-0.60, 0.36, 0.16),
            (0.85, -0.12, 0.12),
            (0.15, 0.62, 0.14),
        )
    ):
        c.add("rock", stone((x, y, 0.36 * size), (size, 0.8 * size, 0.75 * size), 30 + k, 3))
    c.add("earth", rough(pillow((0.05, -0.05, 0.03), (1.5, 1.15, 0.10), 5, 2.2), 0.035, 0.2, 5))
    c.collide_hull(*c.everything())
    return [a, b, c]
