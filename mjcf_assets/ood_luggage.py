"""Suitcases and gas bottles, each in three shapes.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import bent, block, circle, pillow, rough, rounded_rectangle, sweep, torus, tube
from solids import ball, between, cylinder, lathe, moved


def suitcases() -> list[Model]:
    """A hard shell on its wheels, a burst old one with its clothes, and a long duffel bag."""
    a = unseen(
        "suitcase_a",
        "Trolley case with a hard shell, handle out.",
        9,
        0.45,
        shell=(0.80, 0.62, 0.05),
        zip=(0.12, 0.12, 0.12),
    )
    v, f = pillow((0, 0, 0.40), (0.28, 0.46, 0.66), 8, 7)
    on_face = np.clip(np.abs(v[:, 0]) / 0.14, 0, 1) ** 8
    v[:, 0] += np.sign(v[:, 0]) * 0.010 * on_face * np.sin(2 * math.pi * v[:, 1] / 0.105)
    a.add("shell", (v, f))
    belt = [
        (0.004 * math.sin(9 * y), y * 1.012, 0.40 + z * 1.012)
        for y, z in rounded_rectangle(0.46, 0.66, 0.07, 3)
    ]
    a.add("zip", sweep(belt, circle(4, 0.012, 0.012), closed=True))
    a.add(
        "zip",
        *(
            moved(cylinder(0.032, -0.012, 0.012, 10), (x, y, 0.032), roll=math.pi / 2)
            for x in (-0.10, 0.10)
            for y in (-0.18, 0.18)
        ),
    )
    a.add("zip", *(block((x, y, 0.06), (0.05, 0.04, 0.05)) for x in (-0.10, 0.10) for y in (-0.18, 0.18)))
    a.add("steel", *(between((-0.10, y, 0.70), (-0.10, y, 1.06), 0.009, n=6) for y in (-0.09, 0.09)))
    a.add(
        "zip", tube([(-0.10, -0.10, 1.06, 0.016), (-0.10, 0, 1.075, 0.018), (-0.10, 0.10, 1.06, 0.016)], 6, 5)
    )
    a.add(
        "zip", tube([(0.03, -0.08, 0.725, 0.012), (0.03, 0, 0.765, 0.012), (0.03, 0.08, 0.725, 0.012)], 5, 6)
    )
    a.collide_hull(*a.parts["shell"])
    a.collide_box((0, 0, 0.05), (0.26, 0.40, 0.10))
    b = unseen(
        "suitcase_b",
        "Old leather suitcase, burst open, with clothes hanging out.",
        12,
        0.4,
        shell=(0.46, 0.24, 0.11),
        lining=(0.75, 0.66, 0.50),
        cloth=(0.20, 0.36, 0.62),
        shirt=(0.88, 0.88, 0.90),
        jumper=(0.70, 0.14, 0.16),
    )
    b.add("shell", pillow((0, 0, 0.09), (0.52, 0.76, 0.18), 5, 8))

    def lid(s):
        return moved(s, (-0.25, 0, 0.17), pitch=-1.95)

    b.add("shell", lid(pillow((0.26, 0, 0.03), (0.52, 0.76, 0.09), 5, 8)))
    b.add("lining", lid(block((0.26, 0, -0.018), (0.46, 0.70, 0.01))))
    b.add(
        "zip",
        *(
            ball((x, y, z), (0.035, 0.035, 0.035), 6, 4)
            for x in (0.24,)
            for y in (-0.36, 0.36)
            for z in (0.03, 0.16)
        ),
        tube([(0.26, -0.08, 0.10, 0.012), (0.30, 0, 0.10, 0.013), (0.26, 0.08, 0.10, 0.012)], 5, 6),
    )
    b.colours["zip"] = (0.66, 0.52, 0.22)
    b.add("cloth", rough(pillow((0.04, 0.12, 0.20), (0.42, 0.42, 0.13), 6, 3), 0.03, 0.12, 1))
    b.add("shirt", rough(pillow((0.10, -0.20, 0.18), (0.50, 0.28, 0.12), 6, 3), 0.03, 0.1, 2))

    def fall(v):
        return np.stack(
            [v[:, 0] + 0.3, v[:, 1], 0.02 + 0.20 / (1 + np.exp(14 * (v[:, 0] + 0.02))) + v[:, 2]], 1
        )

    b.add("jumper", rough(bent(pillow((0, 0.02, 0.02), (0.52, 0.26, 0.04), 6, 5), fall), 0.012, 0.09, 5))
    b.collide_hull(*b.everything())
    c = unseen(
        "suitcase_c",
        "Duffel bag, full and slumped.",
        14,
        0.35,
        shell=(0.13, 0.30, 0.24),
        strap=(0.06, 0.06, 0.06),
        patch=(0.85, 0.40, 0.08),
    )
    body = tube(
        [
            (-0.40, 0, 0.16, 0.12),
            (-0.36, 0, 0.17, 0.165),
            (0, 0.02, 0.155, 0.175),
            (0.36, 0, 0.17, 0.165),
            (0.40, 0, 0.16, 0.12),
        ],
        14,
        14,
        wide=1.15,
    )
    v, f = rough(body, 0.022, 0.16, 7)
    c.add("shell", (np.stack([v[:, 0], v[:, 1], np.maximum(v[:, 2], 0.004 * np.sin(8 * v[:, 0]))], 1), f))
    for x in (-0.17, 0.17):
        loop = [
            (x + 0.02 * math.sin(3 * t), 0.02 + 0.205 * math.cos(t), 0.16 + 0.185 * math.sin(t), 0.012)
            for t in np.linspace(-0.6, math.pi + 0.6, 12)
        ]
        c.add("strap", tube(loop, 4, wide=2.2))
    for s in (1, -1):
        c.add(
            "strap",
            tube(
                [
                    (-0.17, s * 0.10, 0.32, 0.014),
                    (-0.08, s * 0.14, 0.40 - 0.1 * (s < 0), 0.012),
                    (0.08, s * 0.13, 0.41 - 0.12 * (s < 0), 0.012),
                    (0.17, s * 0.10, 0.32, 0.014),
                ],
                5,
                9,
            ),
        )
    c.add("patch", rough(pillow((0.0, 0.195, 0.16), (0.22, 0.02, 0.16), 3, 6), 0.008, 0.1, 3))
    c.collide_hull(*c.parts["shell"])
    return [a, b, c]


def gas_bottles() -> list[Model]:
    """A 11 kg propane bottle, a 33 kg one on its side, a camping bottle with its burner."""
    a = unseen(
        "gas_bottle_a",
        "Propane bottle of 11 kg, standing.",
        21,
        0.5,
        paint=(0.78, 0.10, 0.08),
        brass=(0.72, 0.56, 0.22),
        label=(0.9, 0.9, 0.86),
    )
    bottle(a, 0.15, 0.46, lambda s: s)
    guard(a, "paint", 0.105, 0.455, 0.14, lambda s: s)
    a.add(
        "label",
        sweep(
            [(0.1515 * math.cos(t), 0.1515 * math.sin(t), 0.26) for t in np.linspace(-0.7, 0.7, 7)],
            rounded_rectangle(0.004, 0.14, 0.001, 1),
        ),
    )
    a.collide_cylinder((0, 0, 0.30), 0.15, 0.60)
    a.rolls = "z"
    b = unseen(
        "gas_bottle_b",
        "Tall propane bottle of 33 kg, lying.",
        62,
        0.5,
        paint=(0.55, 0.57, 0.58),
        cap=(0.75, 0.30, 0.05),
        brass=(0.72, 0.56, 0.22),
        rust=(0.36, 0.20, 0.12),
    )

    def lay(s):
        return moved(s, (0, 0.63, 0.159), roll=math.pi / 2)

    bottle(b, 0.159, 1.08, lay)
    b.add(
        "cap",
        lay(
            lathe(
                [(0.0, 1.07), (0.085, 1.07), (0.088, 1.18), (0.075, 1.24), (0.04, 1.26), (0, 1.262)],
                14,
                sharp=False,
            )
        ),
    )
    b.add("rust", *(lay(moved(torus(0.157, 0.008, 18, 4), (0, 0, z))) for z in (0.42, 0.80)))
    b.rolls = "y"
    b.collide_cylinder((0, 0, 0.159), 0.159, 1.24, "y")
    c = unseen(
        "gas_bottle_c",
        "Blue camping gas bottle with its burner, on its side.",
        5,
        0.5,
        paint=(0.06, 0.20, 0.60),
        brass=(0.72, 0.56, 0.22),
    )

    def tip(s):
        return moved(s, (0, 0.19, 0.121), roll=math.pi / 2 - 0.03)

    c.add(
        "paint",
        tip(
            lathe(
                [
                    (0, 0.02),
                    (0.085, 0.0),
                    (0.098, 0.012),
                    (0.118, 0.06),
                    (0.1205, 0.10),
                    (0.1205, 0.16),
                    (0.105, 0.215),
                    (0.06, 0.25),
                    (0, 0.258),
                ],
                18,
                sharp=False,
            )
        ),
    )
    c.add(
        "steel",
        tip(cylinder(0.03, 0.25, 0.30, 10)),
        tip(lathe([(0, 0.30), (0.05, 0.30), (0.065, 0.33), (0.04, 0.345), (0, 0.345)], 14)),
    )
    for k in range(4):
        t = math.pi * k / 2 + 0.5
        c.add(
            "steel",
            tip(
                tube(
                    [
                        (0.02 * math.cos(t), 0.02 * math.sin(t), 0.30, 0.005),
                        (0.11 * math.cos(t), 0.11 * math.sin(t), 0.36, 0.005),
                        (0.085 * math.cos(t), 0.085 * math.sin(t), 0.385, 0.005),
                    ],
                    4,
                )
            ),
        )
    c.add(
        "brass",
        tip(between((0.02, 0, 0.28), (0.085, 0, 0.275), 0.013, n=7)),
        tip(moved(torus(0.02, 0.006, 10, 4), (0.09, 0, 0.275), pitch=math.pi / 2)),
    )
    c.collide_hull(*c.parts["paint"])
    c.collide_hull(tip(cylinder(0.11, 0.35, 0.38, 8)))
    return [a, b, c]


def bottle(m: Model, r: float, h: float, place) -> None:
    """Domed at both ends, a foot ring, a weld round the middle, a valve; axis z."""
    curve = [
        (0, 0.035),
        (0.6 * r, 0.04),
        (0.88 * r, 0.065),
        (r, 0.12),
        (r, h - 0.13),
        (0.93 * r, h - 0.075),
        (0.7 * r, h - 0.03),
        (0.3 * r, h),
        (0, h + 0.002),
    ]
    m.add("paint", place(lathe(curve, 20, sharp=False)))
    m.add("paint", place(lathe([(0.72 * r, 0.05), (0.76 * r, 0.0), (0.82 * r, 0.0), (0.80 * r, 0.055)], 18)))
    m.add("paint", place(moved(torus(r - 0.001, 0.004, 20, 4), (0, 0, 0.48 * h))))
    m.add(
        "brass",
        place(cylinder(0.018, h - 0.01, h + 0.07, 8)),
        place(between((0, 0, h + 0.045), (0.055, 0, h + 0.045), 0.014, n=7)),
        place(cylinder(0.026, h + 0.07, h + 0.088, 10)),
    )


def guard(m: Model, material: str, r: float, z: float, h: float, place) -> None:
    """The collar about the valve: an open ring on feet with a rolled rim."""
    arc = np.linspace(0.55, 2 * math.pi - 0.55, 18)
    m.add(
        material,
        place(
            sweep(
                [(r * math.cos(t), r * math.sin(t), z + h / 2) for t in arc],
                rounded_rectangle(0.006, h * 0.8, 0.002, 1),
            )
        ),
    )
    m.add(
        material,
        place(
            sweep([(r * math.cos(t), r * math.sin(t), z + h * 0.95) for t in arc], circle(5, 0.011, 0.011))
        ),
    )
