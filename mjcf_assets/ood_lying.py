"""Two-wheelers, bins and signs that lie where they should stand, and flat things. Only the test split shows them."""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import (
    bent,
    block,
    laid,
    outward,
    over_ground,
    pillow,
    rough,
    rounded_rectangle,
    sweep,
    torus,
    tube,
)
from solids import Solid, ball, between, cylinder, extrude_x, lathe, moved


def e_scooters() -> list[Model]:
    """Two that were kicked over, to the left and to the right, and one that stands in the way."""
    a = unseen(
        "e_scooter_a",
        "Hire e-scooter, lying on its left side.",
        26,
        0.35,
        colours={
            "paint": (0.30, 0.80, 0.20),
            "deck": (0.10, 0.10, 0.10),
            "steel": (0.40, 0.41, 0.43),
            "lamp": (0.95, 0.95, 0.88),
        },
    )
    e_scooter(a, 1.0, 0.35, lambda s: moved(s, (0, 0, 0), roll=-1.30, yaw=0.1))
    b = unseen(
        "e_scooter_b",
        "E-scooter with its stem folded, on its right side.",
        14,
        0.3,
        colours={
            "paint": (0.11, 0.11, 0.12),
            "deck": (0.20, 0.20, 0.21),
            "steel": (0.80, 0.30, 0.05),
            "lamp": (0.95, 0.95, 0.88),
        },
    )
    e_scooter(b, 0.84, -0.1, lambda s: moved(s, (0, 0, 0), roll=1.40), folded=True)
    c = unseen(
        "e_scooter_c",
        "Orange e-scooter on its stand.",
        30,
        0.4,
        colours={
            "paint": (0.94, 0.42, 0.06),
            "deck": (0.13, 0.13, 0.14),
            "steel": (0.62, 0.63, 0.65),
            "lamp": (0.95, 0.95, 0.88),
        },
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
    up = lambda s: place((s[0] * k, s[1]))  # noqa: E731
    fork = lambda s: up(moved(moved(s, (-0.45, 0, 0)), (0.45, 0, 0), yaw=steer))  # noqa: E731
    fold = (
        (lambda s: up(moved(moved(s, (-0.42, 0, -0.20)), (0.42, 0.0, 0.22), pitch=-1.42))) if folded else fork
    )  # noqa: E731
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
        colours={
            "frame": (0.10, 0.32, 0.52),
            "saddle": (0.42, 0.25, 0.13),
            "basket": (0.62, 0.46, 0.26),
            "chrome": (0.72, 0.73, 0.75),
        },
    )
    bicycle(a, 1.0, 0.32, lambda s: moved(s, (0, 0, 0), roll=-1.33))
    b = unseen(
        "bicycle_b",
        "Racing bicycle with a buckled wheel, lying.",
        9,
        0.4,
        colours={
            "frame": (0.88, 0.88, 0.86),
            "saddle": (0.07, 0.07, 0.07),
            "chrome": (0.16, 0.16, 0.17),
            "tape": (0.80, 0.10, 0.12),
        },
    )
    bicycle(b, 1.02, -0.6, lambda s: moved(s, (0, 0, 0), roll=1.42), racing=True)
    c = unseen(
        "bicycle_c",
        "Child's bicycle, upside down on saddle and handlebar.",
        9,
        0.4,
        colours={
            "frame": (0.90, 0.30, 0.55),
            "saddle": (0.95, 0.95, 0.95),
            "basket": (0.95, 0.80, 0.20),
            "chrome": (0.78, 0.79, 0.80),
            "tyre": (0.82, 0.82, 0.80),
        },
    )
    bicycle(c, 0.60, 0.0, lambda s: moved(s, (0, 0, 0), roll=math.pi, pitch=0.03), child=True)
    for m, roll, pitch in ((a, -0.18, 0.02), (b, 0.08, -0.08), (c, 0.0, -0.32)):
        laid(m, roll, pitch)
        m.collide_hull(*m.everything())
    return [a, b, c]


def bicycle(m: Model, scale: float, steer: float, place, racing: bool = False, child: bool = False) -> None:
    """1.72 m long by the scale, upright along x."""
    k, r = scale, 0.33
    up = lambda s: place((s[0] * k, s[1]))  # noqa: E731
    turn = lambda s: up(moved(moved(s, (-0.40, 0, 0)), (0.40, 0, 0), yaw=steer))  # noqa: E731
    fat = 1.6 if child else 1.0
    for x, side in ((0.53, turn), (-0.53, up)):
        wheel = lambda s, x=x: moved(s, (x, 0, r), roll=math.pi / 2)  # noqa: E731
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
        )  # noqa: E731
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
    ring = lambda scale, height: [
        (middle[0] + scale * (x - middle[0]), middle[1] + scale * (y - middle[1]), height) for x, y in outer
    ]  # noqa: E731
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


def wheelie_bins() -> list[Model]:
    """One on its face with its rubbish out, one on its side, a large one on its back with its lid open."""
    a = unseen(
        "wheelie_bin_a",
        "Bin of 120 l on its face, a bag half out.",
        14,
        0.4,
        colours={
            "body": (0.10, 0.28, 0.14),
            "lid": (0.08, 0.22, 0.11),
            "bag": (0.09, 0.09, 0.10),
            "litter": (0.86, 0.84, 0.78),
        },
    )
    wheelie_bin(a, 0.55, 0.48, 0.93, 1.2, lambda s: moved(s, (0, 0, 0.26), pitch=math.pi / 2 - 0.05))
    laid(a, 0.0, -0.02)
    a.add("bag", over_ground(rough(ball((0.98, 0.06, 0.17), (0.26, 0.22, 0.17), 12, 8), 0.035, 0.12, 4)))
    a.add(
        "litter",
        *(
            over_ground(rough(pillow((x, y, 0.045), (0.16, 0.12, 0.08), 2, 3), 0.02, 0.06, k))
            for k, (x, y) in enumerate(((1.22, -0.2), (1.10, -0.32), (1.34, 0.12)))
        ),
    )
    b = unseen(
        "wheelie_bin_b",
        "Bin of 240 l on its side, its lid swung open.",
        16,
        0.4,
        colours={
            "body": (0.20, 0.21, 0.23),
            "lid": (0.12, 0.30, 0.62),
            "bag": (0.9, 0.9, 0.9),
            "litter": (0.7, 0.6, 0.4),
        },
    )
    wheelie_bin(b, 0.72, 0.58, 1.07, 1.9, lambda s: moved(s, (0, 0, 0.29), roll=math.pi / 2 - 0.03))
    laid(b)
    b.add(
        "litter",
        *(
            over_ground(rough(pillow((x, y, 0.06), (0.24, 0.18, 0.11), 2, 4), 0.025, 0.08, k))
            for k, (x, y) in enumerate(((0.05, -1.28), (-0.22, -1.20)))
        ),
    )
    c = unseen(
        "wheelie_bin_c",
        "Bin of 360 l on its back, its lid flat on the road.",
        22,
        0.4,
        colours={
            "body": (0.48, 0.28, 0.13),
            "lid": (0.90, 0.72, 0.08),
            "bag": (0.2, 0.4, 0.6),
            "litter": (0.7, 0.6, 0.4),
        },
    )
    wheelie_bin(c, 0.85, 0.66, 1.10, 1.62, lambda s: moved(s, (0, 0, 0.42), pitch=-math.pi / 2 + 0.05))
    for m in (a, b, c):
        m.collide_hull(*m.parts["body"], *m.parts["tyre"])
        m.collide_hull(*m.parts["lid"])
    return [a, b, c]


def wheelie_bin(m: Model, d: float, w: float, h: float, open_rad: float, place) -> None:
    """Depth d along x with the handle at -x; the lid is open by an angle about its hinge."""
    rows = (
        (0.0, 0.70),
        (0.04, 0.76),
        (0.55, 0.88),
        (0.92, 0.98),
        (0.93, 1.04),
        (0.97, 1.04),
        (0.97, 0.95),
        (0.90, 0.92),
        (0.20, 0.76),
        (0.20, 0.0),
    )
    ring = lambda z, s: [
        (s * x + 0.06 * d * (1 - s), s * y, z * h) for x, y in rounded_rectangle(0.86 * d, w, 0.08, 3)
    ]  # noqa: E731
    rings = [np.array(ring(z, max(s, 0.02))) for z, s in rows]
    n = len(rings[0])
    v = np.concatenate([*rings, [(0, 0, 0)]])
    f = [
        t
        for r in range(len(rings) - 1)
        for k in range(n)
        for t in (
            (r * n + k, r * n + (k + 1) % n, (r + 1) * n + (k + 1) % n),
            (r * n + k, (r + 1) * n + (k + 1) % n, (r + 1) * n + k),
        )
    ]
    f += [(len(v) - 1, (k + 1) % n, k) for k in range(n)]
    f += [
        ((len(rings) - 1) * n, (len(rings) - 1) * n + k, (len(rings) - 1) * n + k + 1)
        for k in range(1, n - 1)
    ]
    m.add("body", place(outward((v, np.array(f)))))
    hinge = lambda s: place(moved(s, (-0.43 * d, 0, 0.985 * h), pitch=-open_rad))  # noqa: E731
    dome = pillow((0.45 * d, 0, 0.012), (0.94 * d, 1.06 * w, 0.06), 5, 7)
    m.add(
        "lid",
        hinge(
            bent(
                dome,
                lambda v: (
                    v + np.stack([0 * v[:, 0], 0 * v[:, 0], 0.05 * np.exp(-((v[:, 1] / (0.3 * w)) ** 2))], 1)
                ),
            )
        ),
    )
    m.add(
        "body",
        place(
            tube(
                [
                    (-0.44 * d, 0.36 * w, 0.94 * h, 0.018),
                    (-0.53 * d, 0.32 * w, 0.95 * h, 0.018),
                    (-0.53 * d, -0.32 * w, 0.95 * h, 0.018),
                    (-0.44 * d, -0.36 * w, 0.94 * h, 0.018),
                ],
                6,
            )
        ),
    )
    for s in (1, -1):
        m.add(
            "tyre",
            place(
                moved(
                    lathe(
                        [(0, -0.025), (0.07, -0.025), (0.1, -0.02), (0.1, 0.02), (0.07, 0.025), (0, 0.025)],
                        16,
                    ),
                    (-0.34 * d, s * 0.43 * w, 0.085),
                    roll=math.pi / 2,
                )
            ),
        )
    m.add(
        "body",
        *(place(pillow((0.0, s * 0.435 * w, 0.60 * h), (0.10 * d, 0.025, 0.55 * h), 2, 5)) for s in (1, -1)),
    )
    m.add(
        "white",
        place(
            moved(pillow((0, 0, 0), (0.012, 0.42 * w, 0.16 * h), 2, 6), (0.424 * d, 0, 0.70 * h), pitch=0.10)
        ),
    )


def fallen_signs() -> list[Model]:
    """A warning sign with its post bent off, a round one on its broken foot, a blue board that leans on its legs."""
    a = unseen(
        "fallen_sign_a",
        "Warning sign, run over: bent post, concrete at its foot.",
        24,
        0.7,
        colours={
            "face": (0.95, 0.94, 0.90),
            "rim": (0.80, 0.06, 0.06),
            "post": (0.56, 0.57, 0.59),
            "back": (0.50, 0.51, 0.52),
            "concrete": (0.60, 0.59, 0.56),
        },
    )
    way = [
        (-1.35, 0, 0.17, 0.03),
        (-0.95, 0.02, 0.16, 0.03),
        (-0.55, 0.05, 0.26, 0.03),
        (0.0, 0.06, 0.30, 0.03),
        (0.85, 0.08, 0.24, 0.03),
    ]
    a.add("post", tube(way, 9, 16))
    a.add("concrete", rough(pillow((-1.42, 0, 0.17), (0.36, 0.32, 0.34), 4, 3), 0.03, 0.12, 2))
    plate = lambda s: moved(s, (0.62, 0.08, 0.30), roll=0.5, pitch=-0.14)  # noqa: E731
    tri = lambda r: [(r * math.cos(t), r * math.sin(t)) for t in (0.0, 2.094, 4.189)]  # noqa: E731
    for material, r, z0, z1 in (
        ("rim", 0.56, 0.0, 0.012),
        ("face", 0.40, 0.012, 0.016),
        ("back", 0.55, -0.006, 0.0),
    ):
        a.add(material, plate(bent(rounded_prism(tri(r), 0.12 * r / 0.56, z0, z1), warp)))
    a.add(
        "black",
        plate(
            bent(
                rounded_prism(
                    [(0.18, 0.035), (-0.08, 0.02), (-0.08, -0.02), (0.18, -0.035)], 0.01, 0.016, 0.02
                ),
                warp,
            )
        ),
        plate(bent(moved(cylinder(0.03, 0.016, 0.02, 10), (-0.14, 0, 0)), warp)),
    )
    b = unseen(
        "fallen_sign_b",
        "Round prohibition sign on a plastic foot, tipped over.",
        30,
        0.7,
        colours={
            "face": (0.95, 0.94, 0.90),
            "rim": (0.80, 0.06, 0.06),
            "post": (0.85, 0.85, 0.83),
            "red": (0.80, 0.06, 0.06),
            "foot": (0.16, 0.15, 0.15),
            "back": (0.5, 0.51, 0.52),
        },
    )
    down = lambda s: moved(s, (0, 0, 0.20), pitch=-1.24, roll=0.0)  # noqa: E731
    b.add(
        "foot",
        down(pillow((0, 0, 0.05), (0.42, 0.80, 0.11), 4, 5)),
        *(down(pillow((x, y, 0.05), (0.16, 0.14, 0.12), 2, 4)) for x in (-0.14, 0.14) for y in (-0.28, 0.28)),
    )
    b.add(
        "post",
        down(block((0, 0, 0.85), (0.04, 0.04, 1.6))),
        *(down(block((0.021, 0, z), (0.004, 0.042, 0.16))) for z in (0.3, 0.65)),
    )
    face = lambda s: down(moved(s, (0.03, 0, 1.45), pitch=math.pi / 2))  # noqa: E731
    disc = lambda r, z0, z1: bent(lathe([(0, z0), (r, z0), (r, z1), (0, z1)], 26), warp)  # noqa: E731
    b.add("rim", face(disc(0.30, 0, 0.012)))
    b.add("face", face(disc(0.225, 0.012, 0.016)))
    b.add(
        "black",
        *(
            face(
                bent(
                    rounded_prism(
                        [
                            (x + 0.07, y + 0.02),
                            (x - 0.07, y + 0.02),
                            (x - 0.07, y - 0.02),
                            (x + 0.07, y - 0.02),
                        ],
                        0.008,
                        0.016,
                        0.02,
                    ),
                    warp,
                )
            )
            for x, y in ((0.02, 0.06), (0.02, -0.06))
        ),
    )
    b.add("back", face(disc(0.295, -0.006, 0.0)))
    c = unseen(
        "fallen_sign_c",
        "Blue diversion board with an arrow, propped askew on its frame.",
        17,
        0.75,
        colours={
            "board": (0.08, 0.20, 0.62),
            "arrow": (0.95, 0.95, 0.94),
            "frame": (0.66, 0.67, 0.68),
            "sack": (0.62, 0.50, 0.32),
            "back": (0.5, 0.51, 0.52),
        },
    )
    lean = lambda s: moved(s, (0, 0, 0.40), pitch=-0.85, roll=0.16)  # noqa: E731
    sheet = sweep(
        [(0.0, y, 0.0) for y in np.linspace(-0.62, 0.62, 9)], rounded_rectangle(0.016, 0.70, 0.006, 1)
    )
    c.add(
        "board",
        lean(
            bent(sheet, lambda v: v + np.stack([0.03 * np.cos(2.4 * v[:, 1]), 0 * v[:, 0], 0 * v[:, 0]], 1))
        ),
    )
    arrow = [
        (0.44, 0.0),
        (0.14, 0.24),
        (0.14, 0.09),
        (-0.46, 0.09),
        (-0.46, -0.09),
        (0.14, -0.09),
        (0.14, -0.24),
    ]
    c.add(
        "arrow",
        lean(
            bent(
                extrude_x([(y, z) for y, z in arrow], 0.012, 0.026),
                lambda v: v + np.stack([0.03 * np.cos(2.4 * v[:, 1]), 0 * v[:, 0], 0 * v[:, 0]], 1),
            )
        ),
    )
    for s in (1, -1):
        c.add(
            "frame",
            lean(
                tube(
                    [
                        (-0.02, s * 0.5, 0.30, 0.017),
                        (-0.03, s * 0.5, -0.36, 0.017),
                        (-0.34, s * 0.5, -0.52, 0.017),
                        (-0.62, s * 0.46, -0.26, 0.017),
                    ],
                    6,
                )
            ),
        )
    c.add("frame", lean(tube([(-0.34, -0.5, -0.52, 0.015), (-0.34, 0.5, -0.52, 0.015)], 6)))
    for m, roll, pitch in ((a, -0.68, 0.07), (b, 0.0, -0.46), (c, -0.12, 0.10)):
        laid(m, roll, pitch)
        m.collide_hull(*m.everything())
    c.add("sack", over_ground(rough(pillow((-0.40, 0.12, 0.10), (0.32, 0.56, 0.18), 5, 3), 0.03, 0.12, 5)))
    return [a, b, c]


def warp(v: np.ndarray) -> np.ndarray:
    """A sheet of metal after a wheel went over it."""
    v[:, 2] += 0.035 * np.sin(4.5 * v[:, 0] + 1) * np.cos(5 * v[:, 1])
    return v


def rounded_prism(corners, r: float, z0: float, z1: float) -> Solid:
    """A convex outline with rounded corners as a plate that can be bent: rings about its middle."""
    p = np.array(corners, float)
    out = []
    for a, b, c in zip(np.roll(p, 1, 0), p, np.roll(p, -1, 0)):
        for t in np.linspace(0, 1, 4):
            start, end = b + (a - b) / np.linalg.norm(a - b) * r, b + (c - b) / np.linalg.norm(c - b) * r
            out.append((1 - t) ** 2 * start + 2 * t * (1 - t) * b + t**2 * end)
        out += [b + (c - b) * s for s in (0.4, 0.6)]
    ring = np.array(out)
    middle, n = ring.mean(0), len(ring)
    rows = [(0.5, z0), (1.0, z0), (1.0, z1), (0.5, z1)]
    v = np.concatenate(
        [np.column_stack([middle + s * (ring - middle), np.full(n, z)]) for s, z in rows]
        + [[(*middle, z0), (*middle, z1)]]
    )
    f = [
        t
        for q in range(3)
        for k in range(n)
        for t in (
            (q * n + k, q * n + (k + 1) % n, (q + 1) * n + (k + 1) % n),
            (q * n + k, (q + 1) * n + (k + 1) % n, (q + 1) * n + k),
        )
    ]
    f += [(4 * n, (k + 1) % n, k) for k in range(n)] + [
        (4 * n + 1, 3 * n + k, 3 * n + (k + 1) % n) for k in range(n)
    ]
    return outward((v, np.array(f)))


def cardboard_sheets() -> list[Model]:
    """Harmful by area alone: a curled sheet, one with a crease that stands up, a box laid flat with its flaps."""
    a = unseen(
        "cardboard_sheet_a",
        "Large sheet of cardboard with curled corners.",
        1.6,
        0.5,
        colours={"card": (0.68, 0.52, 0.34), "tape": (0.80, 0.72, 0.50)},
    )
    curl = lambda x, y: 0.09 * max(0.0, x * y / 0.35 - 0.25) ** 1.5 + 0.012 * math.sin(5 * x + 3 * y) + 0.02  # noqa: E731
    a.add("card", sheet_of(1.5, 1.0, 15, 10, curl, lambda x, y: True))
    a.add("tape", sheet_of(1.5, 0.05, 15, 1, lambda x, y: curl(x, y) + 0.006, lambda x, y: True))
    b = unseen(
        "cardboard_sheet_b",
        "Cardboard with a crease, wet and torn at one side.",
        0.9,
        0.4,
        colours={"card": (0.52, 0.39, 0.26)},
    )
    fold = lambda x, y: (
        0.16 * max(0.0, 1 - abs(x + 0.15 * y) / 0.24) ** 1.3 + 0.014 * math.sin(9 * y + 4 * x) + 0.02
    )  # noqa: E731
    torn = lambda x, y: x < 0.42 + 0.12 * math.sin(13 * y) and not (x > 0.2 and abs(y + 0.1) < 0.06)  # noqa: E731
    b.add("card", sheet_of(1.15, 0.8, 18, 11, fold, torn))
    c = unseen(
        "cardboard_sheet_c",
        "Box of an appliance, trodden flat, its flaps out.",
        2.4,
        0.5,
        colours={"card": (0.76, 0.62, 0.44), "print": (0.12, 0.24, 0.50), "tape": (0.85, 0.8, 0.6)},
    )
    wave = lambda x, y: (
        0.028
        + 0.018 * math.sin(4 * x) * math.cos(5 * y)
        + 0.10 * max(0.0, abs(y) - 0.42)
        + 0.16 * max(0.0, x - 0.62)
    )  # noqa: E731
    cross = lambda x, y: (
        abs(y) < 0.40 or (-0.72 < x < -0.38) or (-0.30 < x < 0.28) or (0.34 < x < 0.70 and y > 0)
    )  # noqa: E731
    c.add("card", sheet_of(1.9, 1.4, 22, 16, wave, cross))
    c.add("print", sheet_of(0.5, 0.4, 6, 5, lambda x, y: wave(x, y) + 0.009, lambda x, y: True))
    for m in (a, b, c):
        m.friction = (0.7, 0.01, 0.01)
        whole = np.concatenate([s[0] for s in m.everything()])
        low, high = whole.min(0), whole.max(0)
        m.collide_box(
            ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2] + 0.02),
            (high[0] - low[0], high[1] - low[1], 0.04),
        )
    return [a, b, c]


def sheet_of(l: float, w: float, nx: int, ny: int, height, keep) -> Solid:
    """A sheet 8 mm thick over the cells of a grid that are kept, at a height (x, y)."""
    xs, ys = np.linspace(-l / 2, l / 2, nx + 1), np.linspace(-w / 2, w / 2, ny + 1)
    kept = {
        (i, j) for i in range(nx) for j in range(ny) if keep((xs[i] + xs[i + 1]) / 2, (ys[j] + ys[j + 1]) / 2)
    }
    at = lambda i, j: i * (ny + 1) + j  # noqa: E731
    n = (nx + 1) * (ny + 1)
    v = np.array([(x, y, height(x, y) + t) for t in (0.004, -0.004) for x in xs for y in ys])
    f = []
    for i, j in sorted(kept):
        quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
        f += [(quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3])]
        f += [
            tuple(k + n for k in (quad[2], quad[1], quad[0])),
            tuple(k + n for k in (quad[3], quad[2], quad[0])),
        ]
        for (di, dj), p, q in (((0, -1), 0, 1), ((1, 0), 1, 2), ((0, 1), 2, 3), ((-1, 0), 3, 0)):
            if (i + di, j + dj) not in kept:
                a, b = quad[p], quad[q]
                f += [(b, a, a + n), (b, a + n, b + n)]
    f = np.array(f)
    used, index = np.unique(f, return_inverse=True)
    return v[used], index.reshape(f.shape)


def manhole_covers() -> list[Model]:
    """Harmful by area alone: round and ajar over its hole, square and pushed off, a grating on end in its frame."""
    tones = {
        "iron": (0.25, 0.24, 0.23),
        "worn": (0.42, 0.40, 0.38),
        "hole": (0.02, 0.02, 0.02),
        "rust": (0.38, 0.24, 0.16),
    }
    a = unseen("manhole_cover_a", "Round manhole cover ajar on its frame.", 110, 0.3, colours=tones)
    a.add("iron", lathe([(0.31, 0.0), (0.40, 0.0), (0.39, 0.025), (0.325, 0.025), (0.31, 0.0)], 26))
    a.add("hole", lathe([(0, 0.0), (0.315, 0.0), (0.315, 0.006), (0, 0.006)], 22))
    lid = lambda s: moved(s, (0.20, 0.08, 0.075), pitch=0.15, yaw=0.4)  # noqa: E731
    a.add(
        "worn",
        lid(
            lathe([(0, -0.035), (0.26, -0.035), (0.31, -0.01), (0.312, 0.01), (0.30, 0.016), (0, 0.016)], 26)
        ),
    )
    for r, n in ((0.11, 6), (0.18, 10), (0.25, 14)):
        a.add(
            "iron",
            *(
                lid(
                    moved(
                        block((r, 0, 0.018), (0.035, 0.03, 0.010)),
                        yaw=2 * math.pi * (k + 0.5 * (n == 10)) / n,
                    )
                )
                for k in range(n)
            ),
        )
    a.add("hole", *(lid(moved(cylinder(0.018, 0.010, 0.0175, 8), (x, 0, 0))) for x in (0.285, -0.285)))
    b = unseen(
        "manhole_cover_b", "Square double cover, one leaf pushed across the other.", 150, 0.3, colours=tones
    )
    b.add(
        "iron",
        *(
            pillow(c, s, 2, 10)
            for c, s in (
                ((0.52, 0, 0.015), (0.06, 0.86, 0.03)),
                ((-0.52, 0, 0.015), (0.06, 0.86, 0.03)),
                ((0, 0.42, 0.015), (1.08, 0.06, 0.03)),
                ((0, -0.42, 0.015), (1.08, 0.06, 0.03)),
            )
        ),
    )
    b.add("hole", block((0, 0, 0.003), (1.0, 0.8, 0.006)))
    for pose in (((-0.25, 0, 0.02), 0.0, 0.0), ((-0.02, 0.16, 0.075), 0.35, 0.07)):
        leaf = lambda s, pose=pose: moved(s, pose[0], yaw=pose[1], pitch=pose[2])  # noqa: E731
        b.add("worn", leaf(pillow((0, 0, 0), (0.50, 0.80, 0.05), 2, 14)))
        b.add(
            "rust",
            *(
                leaf(
                    moved(
                        pillow((0, 0, 0.026), (0.10, 0.035, 0.012), 1, 3),
                        (x, y, 0),
                        yaw=0.8 * (-1) ** (i + j),
                    )
                )
                for i, x in enumerate((-0.16, 0, 0.16))
                for j, y in enumerate((-0.3, -0.15, 0, 0.15, 0.3))
            ),
        )
    c = unseen(
        "manhole_cover_c", "Street gully: its grating sits crosswise in the frame.", 60, 0.3, colours=tones
    )
    c.add(
        "iron",
        *(
            pillow(p, s, 2, 10)
            for p, s in (
                ((0.28, 0, 0.02), (0.06, 0.60, 0.04)),
                ((-0.28, 0, 0.02), (0.06, 0.60, 0.04)),
                ((0, 0.28, 0.02), (0.6, 0.06, 0.04)),
                ((0, -0.28, 0.02), (0.6, 0.06, 0.04)),
            )
        ),
    )
    c.add("hole", block((0, 0, 0.003), (0.54, 0.54, 0.006)))
    grate = lambda s: moved(s, (0.02, 0.0, 0.13), yaw=0.65, pitch=-0.42)  # noqa: E731
    c.add(
        "worn",
        *(grate(pillow((0, 0.065 * k, 0), (0.48, 0.03, 0.05), 2, 8)) for k in range(-3, 4)),
        *(grate(pillow((x, 0, 0), (0.05, 0.48, 0.055), 2, 8)) for x in (-0.22, 0, 0.22)),
    )
    for m in (a, b, c):
        m.collide_hull(*m.everything())
    return [a, b, c]
