"""E-scooters and bicycles that lie where they fell, each in three shapes.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import bent, block, laid, pillow, rounded_rectangle, sweep, torus, tube
from solids import Solid, ball, between, cylinder, moved


def e_scooters() -> list[Model]:
    """Two that were kicked over, to the left and to the right, and one that stands in the way."""
    a = unseen(
        "e_scooter_a",
        "Hire e-scooter, lying on its left side.",
        26,
        0.35,
        paint=(0.30, 0.80, 0.20),
        deck=(0.10, 0.10, 0.10),
        steel=(0.40, 0.41, 0.43),
        lamp=(0.95, 0.95, 0.88),
    )
    e_scooter(a, 1.0, 0.35, lambda s: moved(s, (0, 0, 0), roll=-1.30, yaw=0.1))
    b = unseen(
        "e_scooter_b",
        "E-scooter with its stem folded, on its right side.",
        14,
        0.3,
        paint=(0.11, 0.11, 0.12),
        deck=(0.20, 0.20, 0.21),
        steel=(0.80, 0.30, 0.05),
        lamp=(0.95, 0.95, 0.88),
    )
    e_scooter(b, 0.84, -0.1, lambda s: moved(s, (0, 0, 0), roll=1.40), folded=True)
    c = unseen(
        "e_scooter_c",
        "Orange e-scooter on its stand.",
        30,
        0.4,
        paint=(0.94, 0.42, 0.06),
        deck=(0.13, 0.13, 0.14),
        steel=(0.62, 0.63, 0.65),
        lamp=(0.95, 0.95, 0.88),
    )
    e_scooter(c, 1.08, 0.5, lambda s: moved(s, (0, 0, 0), roll=0.10), stand=True)
    for m, roll, pitch in ((a, -0.12, 0.01), (b, -0.68, -0.01)):
        laid(m, roll, pitch)
        m.collide_hull(*m.everything())
    laid(c, -0.06)
    c.collide_hull(*c.parts["tyre"], *c.parts["deck"], *c.parts["steel"])
    c.collide_hull(*c.parts["paint"])
    return [a, b, c]


def e_scooter(m: Model, scale: float, steer: float, place, folded: bool = False, stand: bool = False) -> None:
    """1.1 m long and high by the scale, upright along x; the front wheel is turned by steer."""
    k = scale

    def up(s):
        return place((s[0] * k, s[1]))

    def fork(s):
        return up(moved(moved(s, (-0.45, 0, 0)), (0.45, 0, 0), yaw=steer))

    fold = (
        (lambda s: up(moved(moved(s, (-0.42, 0, -0.20)), (0.42, 0.0, 0.22), pitch=-1.42))) if folded else fork
    )
    m.add(
        "deck",
        up(pillow((-0.05, 0, 0.135), (0.66, 0.17, 0.055), 5, 6)),
        up(pillow((-0.02, 0, 0.168), (0.5, 0.15, 0.012), 3, 8)),
    )
    for x, turn in ((0.46, fork), (-0.46, up)):
        m.add("tyre", turn(moved(torus(0.085, 0.026, 20, 6), (x, 0, 0.111), roll=math.pi / 2)))
        m.add("steel", turn(moved(cylinder(0.062, -0.024, 0.024, 12), (x, 0, 0.111), roll=math.pi / 2)))
        arc = [(x + 0.13 * math.cos(t), 0, 0.111 + 0.13 * math.sin(t)) for t in np.linspace(0.5, 2.6, 8)]
        m.add("deck", turn(sweep(arc, rounded_rectangle(0.07, 0.008, 0.003, 1))))
    m.add("paint", up(tube([(0.26, 0, 0.14, 0.035), (0.36, 0, 0.20, 0.032), (0.42, 0, 0.30, 0.034)], 8, 6)))
    m.add(
        "steel",
        fork(tube([(0.46, 0.045, 0.11, 0.014), (0.45, 0.04, 0.22, 0.016), (0.43, 0, 0.27, 0.02)], 6)),
        fork(tube([(0.46, -0.045, 0.11, 0.014), (0.45, -0.04, 0.22, 0.016), (0.43, 0, 0.27, 0.02)], 6)),
    )
    m.add("paint", fold(tube([(0.43, 0, 0.25, 0.032), (0.40, 0, 0.60, 0.027), (0.36, 0, 1.06, 0.024)], 9, 7)))
    m.add(
        "deck",
        fold(
            tube(
                [
                    (0.33, 0.27, 1.10, 0.013),
                    (0.355, 0.12, 1.09, 0.013),
                    (0.36, 0, 1.07, 0.016),
                    (0.355, -0.12, 1.09, 0.013),
                    (0.33, -0.27, 1.10, 0.013),
                ],
                7,
                11,
            )
        ),
    )
    m.add(
        "black",
        *(fold(tube([(0.333, s * 0.15, 1.095, 0.019), (0.318, s * 0.27, 1.10, 0.02)], 7)) for s in (1, -1)),
    )
    m.add(
        "black",
        fold(pillow((0.365, 0, 1.10), (0.09, 0.07, 0.035), 3, 4)),
        *(
            fold(
                tube(
                    [
                        (0.36, s * 0.11, 1.085, 0.006),
                        (0.40, s * 0.17, 1.075, 0.006),
                        (0.385, s * 0.23, 1.08, 0.006),
                    ],
                    4,
                )
            )
            for s in (1, -1)
        ),
    )
    m.add("lamp", fold(ball((0.395, 0, 0.98), (0.02, 0.026, 0.022), 8, 5)))
    if stand:
        m.add(
            "steel",
            up(
                tube([(0.0, -0.05, 0.12, 0.009), (0.02, -0.14, 0.018, 0.009), (0.05, -0.16, 0.014, 0.009)], 5)
            ),
        )


def bicycles() -> list[Model]:
    """A city bicycle on its side, a racing one with a buckled wheel, a child's upside down."""
    a = unseen(
        "bicycle_a",
        "City bicycle with a basket, lying on its side.",
        18,
        0.35,
        frame=(0.10, 0.32, 0.52),
        saddle=(0.42, 0.25, 0.13),
        basket=(0.62, 0.46, 0.26),
        chrome=(0.72, 0.73, 0.75),
    )
    bicycle(a, 1.0, 0.32, lambda s: moved(s, (0, 0, 0), roll=-1.33))
    b = unseen(
        "bicycle_b",
        "Racing bicycle with a buckled wheel, lying.",
        9,
        0.4,
        frame=(0.88, 0.88, 0.86),
        saddle=(0.07, 0.07, 0.07),
        chrome=(0.16, 0.16, 0.17),
        tape=(0.80, 0.10, 0.12),
    )
    bicycle(b, 1.02, -0.6, lambda s: moved(s, (0, 0, 0), roll=1.42), racing=True)
    c = unseen(
        "bicycle_c",
        "Child's bicycle, upside down on saddle and handlebar.",
        9,
        0.4,
        frame=(0.90, 0.30, 0.55),
        saddle=(0.95, 0.95, 0.95),
        basket=(0.95, 0.80, 0.20),
        chrome=(0.78, 0.79, 0.80),
        tyre=(0.82, 0.82, 0.80),
    )
    bicycle(c, 0.60, 0.0, lambda s: moved(s, (0, 0, 0), roll=math.pi, pitch=0.03), child=True)
    for m, roll, pitch in ((a, -0.18, 0.02), (b, 0.08, -0.08), (c, 0.0, -0.32)):
        laid(m, roll, pitch)
        m.collide_hull(*m.everything())
    return [a, b, c]


def bicycle(m: Model, scale: float, steer: float, place, racing: bool = False, child: bool = False) -> None:
    """1.72 m long by the scale, upright along x."""
    k, r = scale, 0.33

    def up(s):
        return place((s[0] * k, s[1]))

    def turn(s):
        return up(moved(moved(s, (-0.40, 0, 0)), (0.40, 0, 0), yaw=steer))

    fat = 1.6 if child else 1.0
    for x, side in ((0.53, turn), (-0.53, up)):

        def wheel(s, x=x):
            return moved(s, (x, 0, r), roll=math.pi / 2)

        buckle = (
            (
                lambda v, x=x: (
                    v
                    + np.stack(
                        [
                            0 * v[:, 0],
                            0.10
                            * np.cos(2 * np.arctan2(v[:, 2] - r, v[:, 0] - x))
                            * np.hypot(v[:, 2] - r, v[:, 0] - x)
                            / r,
                            0 * v[:, 0],
                        ],
                        1,
                    )
                )
            )
            if racing and x > 0
            else (lambda v: v)
        )
        tyre_r = (0.014 if racing else 0.021) * fat
        m.add("tyre", side(bent(wheel(torus(r - tyre_r, tyre_r, 22, 5)), buckle)))
        m.add("chrome", side(bent(wheel(torus(r - 0.034 * fat, 0.011 * fat, 22, 3, 1.2)), buckle)))
        m.add("chrome", side(wheel(cylinder(0.022, -0.05, 0.05, 7))))
        for j in range(8):
            t = math.pi * (j + 0.5) / 4
            spoke = between(
                (x, 0.02 * (-1) ** j, r),
                (x + (r - 0.03) * math.cos(t), 0, r + (r - 0.03) * math.sin(t)),
                0.0045,
                n=3,
            )
            m.add("chrome", side(bent(spoke, buckle)))
        if not racing:
            arc = [(x + 0.36 * math.cos(t), 0, r + 0.36 * math.sin(t)) for t in np.linspace(0.35, 2.7, 10)]
            m.add("frame", side(sweep(arc, [(-0.03, -0.008), (0.03, -0.008), (0.02, 0.006), (-0.02, 0.006)])))
    crank, seat, head, low_head = (-0.10, 0, 0.29), (-0.25, 0, 0.76), (0.33, 0, 0.86), (0.37, 0, 0.72)
    pipes = [(crank, (-0.26, 0, 0.80), 0.016), (low_head, crank, 0.020), (head, low_head, 0.020)]
    pipes.append((seat, head, 0.016) if racing else ((-0.20, 0, 0.60), low_head, 0.018))
    m.add("frame", *(up(between(p, q, w * 1.1, n=7)) for p, q, w in pipes))
    for s in (1, -1):
        m.add(
            "frame",
            up(between((-0.53, 0.055 * s, r), (-0.245, 0.02 * s, 0.74), 0.010, n=5)),
            up(between((-0.53, 0.055 * s, r), (crank[0], 0.03 * s, crank[2]), 0.011, n=5)),
        )
        m.add(
            "frame",
            turn(
                tube(
                    [
                        (0.53, 0.05 * s, r, 0.011),
                        (0.46, 0.045 * s, 0.52, 0.013),
                        (0.385, 0.03 * s, 0.70, 0.015),
                    ],
                    5,
                )
            ),
        )
        arm = (crank[0] + s * 0.09, s * 0.075, crank[2] - s * 0.14)
        m.add("chrome", up(between((crank[0], s * 0.06, crank[2]), arm, 0.011, n=5)))
        m.add("black", up(pillow((arm[0], s * 0.13, arm[2]), (0.09, 0.10, 0.025), 2, 5)))
    m.add(
        "chrome",
        up(moved(torus(0.085, 0.008, 16, 4), (crank[0], 0.045, crank[2]), roll=math.pi / 2)),
        up(between((crank[0], -0.06, crank[2]), (crank[0], 0.06, crank[2]), 0.02, n=7)),
    )
    m.add(
        "black",
        up(
            tube(
                [
                    (-0.53, 0.045, r + 0.035, 0.006),
                    (crank[0], 0.045, crank[2] + 0.085, 0.006),
                    (crank[0] + 0.08, 0.045, crank[2], 0.006),
                    (crank[0], 0.045, crank[2] - 0.085, 0.006),
                    (-0.53, 0.045, r - 0.035, 0.006),
                ],
                3,
            )
        ),
    )
    m.add(
        "saddle",
        up(
            tube(
                [
                    (-0.40, 0, 0.90, 0.05),
                    (-0.34, 0, 0.905, 0.062),
                    (-0.25, 0, 0.90, 0.035),
                    (-0.12, 0, 0.895, 0.022),
                ],
                8,
                7,
                wide=1.5,
            )
        ),
    )
    m.add(
        "chrome",
        up(between((-0.26, 0, 0.78), (-0.28, 0, 0.90), 0.013, n=6)),
        turn(between(head, (0.31, 0, 0.98), 0.014, n=6)),
    )
    if racing:
        m.add("chrome", turn(tube([(0.31, 0, 0.95, 0.015), (0.40, 0, 0.95, 0.015)], 6)))
        for s in (1, -1):
            m.add(
                "tape",
                turn(
                    tube(
                        [
                            (0.40, 0, 0.95, 0.014),
                            (0.40, s * 0.20, 0.95, 0.014),
                            (0.50, s * 0.21, 0.94, 0.015),
                            (0.52, s * 0.21, 0.87, 0.015),
                            (0.46, s * 0.21, 0.81, 0.015),
                            (0.37, s * 0.21, 0.80, 0.015),
                        ],
                        6,
                        14,
                    )
                ),
            )
    else:
        bar = [(0.10, s * 0.30, 1.02) for s in (1, -1)]
        high = 0.06 if child else 0.0
        m.add(
            "chrome",
            turn(
                tube(
                    [
                        (*bar[0][:2], 1.02 + high, 0.012),
                        (0.20, 0.29, 1.05 + high, 0.012),
                        (0.31, 0.12, 1.0, 0.012),
                        (0.31, -0.12, 1.0, 0.012),
                        (0.20, -0.29, 1.05 + high, 0.012),
                        (*bar[1][:2], 1.02 + high, 0.012),
                    ],
                    6,
                    15,
                )
            ),
        )
        m.add(
            "black",
            *(
                turn(tube([(0.18, s * 0.293, 1.043 + high, 0.018), (0.08, s * 0.30, 1.015 + high, 0.019)], 6))
                for s in (1, -1)
            ),
        )
        wire = [(0.36, -0.17, 0.80), (0.36, 0.17, 0.80), (0.58, 0.17, 0.80), (0.58, -0.17, 0.80)]
        if not child:
            m.add("basket", turn(basket(wire)))
            m.add(
                "chrome",
                up(tube([(-0.88, 0, 0.71, 0.008), (-0.50, 0.06, 0.74, 0.01), (-0.25, 0.03, 0.72, 0.008)], 5)),
                up(
                    tube(
                        [(-0.88, 0, 0.71, 0.008), (-0.50, -0.06, 0.74, 0.01), (-0.25, -0.03, 0.72, 0.008)], 5
                    )
                ),
                up(block((-0.62, 0, 0.74), (0.36, 0.13, 0.015))),
            )
            m.add("taillamp", up(ball((-0.92, 0, 0.66), (0.02, 0.03, 0.03), 7, 4)))
        m.add("lamp", turn(ball((0.45, 0, 0.76), (0.04, 0.035, 0.035), 8, 5)))
        m.colours["lamp"] = (0.92, 0.92, 0.86)


def basket(corners) -> Solid:
    """A tapered wicker basket, open at the top."""
    (x0, y0, z), (x1, y1, _) = corners[0], corners[2]
    outer = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)

    def ring(scale, height):
        return [
            (middle[0] + scale * (x - middle[0]), middle[1] + scale * (y - middle[1]), height)
            for x, y in outer
        ]

    rings = [ring(0.80, z), ring(1.0, z + 0.22), ring(0.93, z + 0.22), ring(0.73, z + 0.02)]
    v = np.array([p for one in rings for p in one] + [(*middle, z), (*middle, z + 0.02)])
    f = [
        t
        for r in range(3)
        for k in range(4)
        for t in (
            (4 * r + k, 4 * r + (k + 1) % 4, 4 * r + 4 + (k + 1) % 4),
            (4 * r + k, 4 * r + 4 + (k + 1) % 4, 4 * r + 4 + k),
        )
    ]
    f += [(16, (k + 1) % 4, k) for k in range(4)] + [(17, 12 + k, 12 + (k + 1) % 4) for k in range(4)]
    return v, np.array(f)
