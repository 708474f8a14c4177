"""Parts that vehicles lose, each in three shapes: tyres and bumpers.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import bent, block, frames, laid, pillow, rough, rounded_rectangle, sweep, tube
from solids import cylinder, lathe, moved


def tyres() -> list[Model]:
    """A car's tyre on its side, a truck's standing, and a car's wheel with a rim, flat and torn."""
    a = unseen(
        "tyre_a",
        "Car tyre that lies on its side.",
        9,
        0.12,
        rubber=(0.07, 0.07, 0.075),
        wall=(0.11, 0.11, 0.115),
    )
    tyre(a, 0.316, 0.203, 0.205, lambda s: moved(s, (0, 0, 0.1025)), 28)
    a.rolls = "z"
    a.friction = (0.9, 0.01, 0.012)
    a.collide_cylinder((0, 0, 0.1025), 0.316, 0.205)
    b = unseen(
        "tyre_b",
        "Truck tyre that stands on its tread.",
        62,
        0.12,
        rubber=(0.085, 0.085, 0.085),
        wall=(0.13, 0.125, 0.12),
    )
    tyre(b, 0.52, 0.286, 0.31, lambda s: moved(s, (0, 0, 0.52), roll=math.pi / 2), 30)
    b.rolls = "y"
    b.friction = (0.9, 0.02, 0.02)
    b.collide_cylinder((0, 0, 0.52), 0.52, 0.29, "y")
    c = unseen(
        "tyre_c",
        "Wheel of a car with its rim, the tyre burst and half off.",
        19,
        0.2,
        rubber=(0.065, 0.065, 0.07),
        wall=(0.10, 0.10, 0.10),
        rim=(0.70, 0.71, 0.73),
    )

    def torn(v):
        t = np.arctan2(v[:, 1], v[:, 0])
        off = np.exp(-((t - 0.6) ** 2) / 0.5)
        return v * np.stack([1 + 0.22 * off, 1 + 0.22 * off, 1 - 0.1 * off], 1) + np.stack(
            [0.10 * off, 0.05 * off, 0.10 * off], 1
        )

    tyre(c, 0.33, 0.216, 0.225, lambda s: bent(moved(s, (0, 0, 0.113)), torn), 28)
    c.add(
        "rim",
        lathe(
            [
                (0.205, 0.0),
                (0.225, 0.01),
                (0.20, 0.035),
                (0.19, 0.19),
                (0.225, 0.215),
                (0.215, 0.228),
                (0.18, 0.20),
                (0.175, 0.04),
                (0.205, 0.0),
            ],
            24,
        ),
    )
    for k in range(5):
        t = 2 * math.pi * k / 5
        arm = [
            (0.03 * math.cos(t), 0.03 * math.sin(t), 0.195),
            (0.11 * math.cos(t), 0.11 * math.sin(t), 0.205),
            (0.19 * math.cos(t), 0.19 * math.sin(t), 0.19),
        ]
        c.add("rim", sweep(arm, rounded_rectangle(0.06, 0.03, 0.008, 1)))
    c.add("rim", cylinder(0.06, 0.15, 0.215, 14))
    c.collide_hull(*c.everything())
    return [a, b, c]


def tyre(m: Model, radius: float, bore: float, width: float, place, n: int) -> None:
    """Side walls that bulge, an open bore, and a tread of blocks; axis z, middle at the origin."""
    w, r = width / 2, radius
    deep = r - bore
    wall = [
        (bore, -0.62 * w),
        (bore + 0.04 * r, -0.78 * w),
        (bore + 0.45 * deep, -w),
        (r - 0.14 * deep, -0.92 * w),
        (r - 0.05 * deep, -0.72 * w),
        (r - 0.05 * deep, 0.72 * w),
        (r - 0.14 * deep, 0.92 * w),
        (bore + 0.45 * deep, w),
        (bore + 0.04 * r, 0.78 * w),
        (bore, 0.62 * w),
        (bore + 0.35 * deep, 0.70 * w),
        (bore + 0.75 * deep, 0.5 * w),
        (bore + 0.75 * deep, -0.5 * w),
        (bore + 0.35 * deep, -0.70 * w),
    ]
    turn = 2 * math.pi / n
    path = [(math.cos(turn * k) * r, math.sin(turn * k) * r, 0.0) for k in range(n)]
    m.add("wall", place(sweep(path, ring_section(path, wall, r), closed=True)))
    turn = 2 * math.pi / 22
    for row, y in enumerate((-0.36, 0.36)):
        for k in range(22):
            t = turn * (k + 0.5 * row)
            knob = block((r - 0.03 * deep, 0, y * w), (0.10 * deep, 0.66 * turn * r, 0.66 * w))
            m.add("rubber", place(moved(knob, yaw=t)))


def ring_section(path, wall, r: float) -> list[tuple[float, float]]:
    """The section of a ring in the frame that `sweep` makes along it: out is its first axis or against it."""
    side = frames(np.asarray(path, float), True)[0][0]
    sign = 1.0 if side[0] > 0 else -1.0
    return [(sign * (p - r), z) for p, z in wall]


def bumpers() -> list[Model]:
    """A front bumper with its grille, a rear one of a van, and a crumpled one that stands on its side."""
    a = unseen(
        "bumper_a",
        "Front bumper of a car with grille and number plate.",
        7,
        0.45,
        paint=(0.66, 0.68, 0.72),
        trim=(0.07, 0.07, 0.08),
        plate=(0.9, 0.9, 0.86),
        foam=(0.15, 0.15, 0.16),
    )
    skin(a, "paint", 1.72, 0.56, 0.50, lambda s: moved(s, (0, 0, 0.0), pitch=-0.35), 1.0)

    def front(s):
        return moved(moved(s, (0.30, 0, 0.26)), pitch=-0.35)

    a.add(
        "trim",
        front(pillow((0.03, 0, 0.07), (0.09, 0.90, 0.12), 4, 6)),
        front(pillow((0.015, 0, -0.13), (0.09, 1.05, 0.14), 4, 6)),
    )
    a.add("trim", *(front(pillow((-0.03, s * 0.68, -0.11), (0.10, 0.20, 0.12), 3, 4)) for s in (1, -1)))
    a.add("plate", front(pillow((0.072, 0.02, -0.03), (0.012, 0.50, 0.11), 2, 10)))
    laid(a, 0.0, 0.37)
    a.collide_hull(*a.parts["paint"])
    b = unseen(
        "bumper_b",
        "Rear bumper of a van, bare plastic, upside down.",
        9,
        0.25,
        paint=(0.16, 0.165, 0.17),
        lamp=(0.62, 0.06, 0.05),
        step=(0.28, 0.28, 0.29),
        trim=(0.5, 0.5, 0.52),
    )

    def over(s):
        return moved(s, (0, 0, 0.34), roll=math.pi + 0.08)

    skin(b, "paint", 1.92, 0.30, 0.32, over, 0.5)
    b.add("step", over(moved(pillow((0, 0, 0), (0.20, 1.3, 0.04), 4, 8), (0.16, 0, 0.31))))
    b.add("lamp", *(over(pillow((0.205, s * 0.72, 0.12), (0.04, 0.20, 0.06), 3, 5)) for s in (1, -1)))
    b.add(
        "trim",
        *(
            over(
                tube(
                    [(0.10, s * 0.5, 0.2, 0.02), (-0.12, s * 0.5, 0.22, 0.02), (-0.16, s * 0.42, 0.12, 0.02)],
                    5,
                    5,
                )
            )
            for s in (1, -1)
        ),
    )
    laid(b, -0.08, -0.02)
    b.collide_hull(*b.everything())
    c = unseen(
        "bumper_c",
        "Half of a bumper, torn and crumpled.",
        4,
        0.45,
        paint=(0.62, 0.06, 0.07),
        trim=(0.08, 0.08, 0.09),
        foam=(0.78, 0.78, 0.74),
        lamp=(0.92, 0.92, 0.88),
    )

    def torn(s):
        return moved(rough(bent(s, crumple), 0.014, 0.16, 4), (0, 0, 0.22), yaw=0.4)

    skin(c, "paint", 1.60, 0.50, 0.46, torn, 1.0, (0.0, 0.62))
    c.add("trim", torn(pillow((0.315, -0.15, 0.16), (0.07, 0.5, 0.12), 5, 5)))
    c.add("lamp", torn(pillow((0.20, -0.60, 0.33), (0.12, 0.14, 0.12), 4, 2.5)))
    c.add("foam", torn(pillow((0.12, -0.2, 0.32), (0.14, 0.95, 0.10), 5, 5)))
    laid(c, -0.06, -1.18)
    c.collide_hull(*c.everything())
    return [a, b, c]


def crumple(v: np.ndarray) -> np.ndarray:
    """A knee at two places."""
    v[:, 0] -= 0.10 * np.exp(-(((v[:, 1] + 0.45) / 0.13) ** 2))
    v[:, 2] += 0.08 * np.sin(4 * v[:, 1])
    return v


def skin(
    m: Model,
    material: str,
    width: float,
    depth: float,
    height: float,
    place,
    round_to: float,
    part=(0.0, 1.0),
) -> None:
    """A shell 8 mm thick that goes round a car's corner; its front is at +x, its lower edge at z = 0."""
    t = np.linspace(-1, 1, 27)
    t = t[int(part[0] * 26) : int(part[1] * 26) + 1]
    corner = np.clip((np.abs(t) - 0.72) / 0.28, 0, 1)
    y = (
        width
        / 2
        * np.sign(t)
        * np.where(np.abs(t) < 0.72, np.abs(t) / 0.72 * 0.86, 0.86 + 0.14 * np.sin(corner * math.pi / 2))
    )
    x = (
        depth * 0.6
        - 0.10 * round_to * (y / width * 2) ** 2
        - (depth * 0.8) * (1 - np.cos(corner * math.pi / 2))
    )
    profile = [
        (-0.05, 0.0),
        (0.0, 0.02),
        (0.03, 0.12),
        (0.035, 0.3),
        (0.0, 0.62),
        (-0.03, 0.8),
        (-0.05, 0.95),
        (-0.13, 1.0),
    ]
    outer = [(p, z * height) for p, z in profile]
    inner = [
        (p - 0.012, z * height + (0.01 if k == 0 else -0.01 if k == len(profile) - 1 else 0))
        for k, (p, z) in enumerate(profile)
    ]
    section = np.array([*outer, *reversed(inner)])
    path = np.stack([x, y, np.zeros(len(t))], 1)
    sides = frames(path)
    out_sign = 1.0 if sides[len(t) // 2][0] @ (1, 0, 0) > 0 else -1.0
    section[:, 0] *= out_sign
    m.add(material, place(sweep(path, section)))
